"""For robots of any maker: tables, robot files, URDF, RoboDK, ROS."""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ....model.errors import BadInput
from ....model.options import J3Origin, Option, names_typed
from ..maker import KnownLog, Maker, OffsetFile, PlanProgram, Reader
from ..manifest import ProgramTemplate
from .layouts import NO_DWELLS, CsvLayout, PointLayout, Stillness

if TYPE_CHECKING:
    from ....model.files.plan import Plan
    from ....model.files.run import Run
    from ...command_options import ProgramMotion
    from ..calibration import RobotCalibration
    from ..import_jobs import Imported, ImportJob


def _robot(run: "Run", calibration: "RobotCalibration") -> str:
    """A corrected robot file: offsets, link lengths and angles in its Denavit-Hartenberg rows."""
    from .robot_files import robot_text

    return robot_text(run, calibration)


def _urdf(run: "Run", calibration: "RobotCalibration") -> str:
    """A corrected URDF: offsets, link lengths and angles in the origins of its joints."""
    from .robot_files import urdf_text

    return urdf_text(run, calibration)


def _of_a_moving_tip(run: "Run") -> Collection[str]:
    """A URDF file whose last joint moves the tip itself has no place for the last link."""
    from ....model.files.header import UrdfRef
    from ....model.files.urdf import last_joint

    ref = run.header.robot
    if (
        not isinstance(ref, UrdfRef)
        or last_joint(run.path.parent / ref.urdf, ref.base, ref.tip)[1] == "fixed"
    ):
        return ()
    return [f"link{run.robot.n}.{axis}" for axis in ("a", "b", "d", "alpha", "beta", "theta")]


def _json(run: "Run", calibration: "RobotCalibration") -> str:
    """All parameters with uncertainty and covariance as JSON, for programs."""
    from .written_tables import json_text

    return json_text(calibration)


def _csv(run: "Run", calibration: "RobotCalibration") -> str:
    """The offsets with their uncertainty as a table, for spreadsheets."""
    from .written_tables import csv_text

    return csv_text(calibration)


_ROBODK = ProgramTemplate(
    None,
    "a program for RoboDK",
    "the program",
    template="robodk.j2",
    quote=lambda text: text.replace("\\", "/").replace('"', "'"),
)


def _ros_program(plan: "Plan", motion: "ProgramMotion", file: Path) -> Mapping[Path, str]:
    from .written_tables import ros_trajectories

    return {file: ros_trajectories(plan, motion)}


def _ros_counting(plan: "Plan", motion: "ProgramMotion") -> str | None:
    ground = plan.robot.conventions.joint3 == "ground"
    return "joint 3 is counted from link 2, as URDF and the drivers of ROS do" if ground else None


def _csv_program(plan: "Plan", motion: "ProgramMotion", file: Path) -> Mapping[Path, str]:
    from .written_tables import csv_table

    return {file: csv_table(plan, motion)}


def _csv_counting(plan: "Plan", motion: "ProgramMotion") -> str | None:
    from ....model.kinematics.pendant import Pendant

    return Pendant(plan.robot, motion.j3).sentence


def _read_csv(job: "ImportJob", layout: CsvLayout, still: Stillness) -> "Imported":
    """Recorded joint positions in CSV files. Units and target names are stated, never guessed."""
    from .joint_logs import import_csv

    return import_csv(job, layout, still)


def _read_points(job: "ImportJob", layout: PointLayout) -> "Imported":
    """Points or poses of a tracker or CMM, with the joints at each. What is not stated is never guessed."""
    from .points import import_points

    return import_points(job, layout)


def _read_ros(
    job: "ImportJob",
    still: Stillness = NO_DWELLS,
    columns: Annotated[
        Sequence[str] | None,
        Option("Names of joint 1, 2, … in the messages: a,b,c (default: the robot's own).", text=names_typed),
    ] = None,
    topic: Annotated[str | None, Option("Topic of the arm, if there are several.", among="topics")] = None,
    marker_topic: Annotated[
        str | None,
        Option(
            "Only dwells at a message on this topic; a std_msgs/String names the target.",
            label="Marker topic (trigger)",
            among="other topics",
        ),
    ] = None,
) -> "Imported":
    """Joint states: in ROS bags a measurement is where the arm dwells (at a marker, if stated).

    In the text of ros2 topic echo each message is one.
    """
    from .ros import import_joint_states, import_ros

    if all(path.suffix.lower() in (".yaml", ".yml", ".txt") for path in job.paths):
        if still.defined or topic is not None or marker_topic is not None:
            raise BadInput(
                "joint states in text have no times: each message is a measurement",
                remedy="leave out --still-deg, --still-s, --still-mm, --topic and --marker-topic",
            )
        return import_joint_states(job, columns=columns)
    return import_ros(job, still=still.required(), columns=columns, topic=topic, marker_topic=marker_topic)


def _read_robodk(job: "ImportJob", j3: J3Origin = None) -> "Imported":
    """RoboDK: what a plan's program has recorded. Logs of MonitorJoints: import log robodk."""
    from ..joint_text import import_program_log

    return import_program_log(job, source="RoboDK", j3=j3)


def _monitor_joints(joints: int) -> CsvLayout:
    """RoboDK's macro MonitorJoints: joints in degrees, then seconds, no header, a row where they changed."""

    columns = tuple(str(i + 1) for i in range(joints))
    return CsvLayout(
        "deg", delimiter=",", columns=columns, time_column=str(joints + 1), time_units="s", changes_only=True
    )


MAKER = Maker(
    "any maker",
    offsets=(
        OffsetFile("robot", _robot, holds="links", schema="robot", ending="yaml"),
        OffsetFile("urdf", _urdf, holds="links", ending="urdf", no_place=_of_a_moving_tip),
        OffsetFile("json", _json, holds="all", as_data=True, ending="json"),
        OffsetFile("csv", _csv, as_data=True, ending="csv"),
    ),
    program=(
        PlanProgram("robodk", "RoboDK (Python)", ("zb_plan.py",), _ROBODK, ("speed", "zone", "j3")),
        PlanProgram("ros", "ROS JointTrajectory", ("zb_plan.yaml",), _ros_program, ("speed",), _ros_counting),
        PlanProgram("csv", "table (CSV)", ("zb_plan.csv",), _csv_program, ("j3",), _csv_counting),
    ),
    read=(
        Reader("csv", _read_csv, "CSV files, one posture a row.", first=("files", "units")),
        Reader(
            "points",
            _read_points,
            "Table of points: SpatialAnalyzer text, CSV of any other software.",
            first=("files", "file", "header", "joints", "joint_columns", "joint_units"),
        ),
        Reader(
            "ros",
            _read_ros,
            "ROS 1 or 2 bags (.bag, .mcap, .db3 or folder), or joint states in text (.yaml).",
            first=("files", "file", "header", "plan", "still_deg", "still_s", "still_mm"),
        ),
        Reader("robodk", _read_robodk, "Log of a plan's program.", program_log=True),
    ),
    logs=(KnownLog("robodk", "MonitorJoints", _monitor_joints),),
    live="ros://HOST",
)
