"""For robots of any maker: tables, robot files, URDF, RoboDK, ROS."""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from ....model.errors import BadInput
from ....model.options import Option
from ..maker import (
    Decimal,
    J3Counting,
    KnownLog,
    Maker,
    MarkerColumn,
    OffsetFile,
    PlanProgram,
    Reader,
    StillDeg,
    StillMm,
    StillSeconds,
    names_of,
)

if TYPE_CHECKING:
    from ....model.files.plan import Plan
    from ....model.files.run import Run
    from ..calibration import RobotCalibration
    from ..options import ProgramMotion
    from ..recordings import Imported, ImportJob
    from .csv_file import CsvLayout


def _robot(run: "Run", calibration: "RobotCalibration") -> str:
    """A corrected robot file: offsets, link lengths and angles in its Denavit-Hartenberg rows."""
    from .robot_rows import robot_text

    return robot_text(run, calibration)


def _urdf(run: "Run", calibration: "RobotCalibration") -> str:
    """A corrected URDF: offsets, link lengths and angles in the origins of its joints."""
    from .urdf import urdf_text

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
    from .offsets_data import json_text

    return json_text(calibration)


def _csv(run: "Run", calibration: "RobotCalibration") -> str:
    """The offsets with their uncertainty as a table, for spreadsheets."""
    from .offsets_data import csv_text

    return csv_text(calibration)


def _robodk_program(plan: "Plan", motion: "ProgramMotion", file: Path) -> Mapping[Path, str]:
    from .robodk_program import robodk_program

    return {file: robodk_program(plan, motion, file.stem)}


def _ros_program(plan: "Plan", motion: "ProgramMotion", file: Path) -> Mapping[Path, str]:
    from .plan_tables import ros_trajectories

    return {file: ros_trajectories(plan, motion)}


def _ros_counting(plan: "Plan", motion: "ProgramMotion") -> str | None:
    ground = plan.robot.conventions.joint3 == "ground"
    return "joint 3 is counted from link 2, as URDF and the drivers of ROS do" if ground else None


def _csv_program(plan: "Plan", motion: "ProgramMotion", file: Path) -> Mapping[Path, str]:
    from .plan_tables import csv_table

    return {file: csv_table(plan, motion)}


def _csv_counting(plan: "Plan", motion: "ProgramMotion") -> str | None:
    from ....model.kinematics.pendant import Pendant

    return Pendant(plan.robot, motion.j3).sentence


def _read_csv(
    job: "ImportJob",
    units: Annotated[Literal["deg", "rad", "pulse"], Option("Unit of the angles.")],
    target_column: Annotated[str | None, Option("Column with each row's target, instead.")] = None,
    lengths: Annotated[Literal["mm", "m"] | None, Option("Unit of prismatic joints.")] = None,
    header_row: Annotated[bool, Option("The first row names the columns.")] = False,
    columns: Annotated[
        str | None,
        Option(
            "Columns of joint 1, 2, …: a,b,c by name (with --header-row) or number, from 1; or A1=j1,A2=j2,…"
            " in any order."
        ),
    ] = None,
    delimiter: Annotated[str | None, Option("Delimiter between two values; found if not stated.")] = None,
    decimal: Decimal = ".",
    j3: J3Counting = None,
    spot_columns: Annotated[str | None, Option("Columns of spot_mm: dx,dy in mm.")] = None,
    shot_column: Annotated[str | None, Option("Column of the measurement numbers.")] = None,
    time_column: Annotated[str | None, Option("Column of times.")] = None,
    time_units: Annotated[Literal["s", "ms", "us", "ns"] | None, Option("Unit of the times.")] = None,
    still_deg: Annotated[
        float | None, Option("A measurement is where the arm dwells: each joint within so many degrees, …")
    ] = None,
    still_s: Annotated[float | None, Option("… for at least so many seconds.")] = None,
    still_mm: StillMm = None,
    marker_column: MarkerColumn = None,
    small_angles: Annotated[
        bool, Option("The angles are in degrees, although all are as small as radians would be.")
    ] = False,
    reversed_joints: Annotated[
        str | None, Option("Joints recorded with the other sign: j2,j5,… or names.", flag="--reversed")
    ] = None,
) -> "Imported":
    """Recorded joint positions in CSV files. Units and target names are stated, never guessed."""
    from .csv_file import CsvLayout, import_csv
    from .dwells import Stillness

    layout = CsvLayout(
        units,
        header_row,
        names_of(columns),
        delimiter,
        lengths,
        decimal,
        target_column,
        shot_column,
        names_of(spot_columns),
        time_column,
        time_units,
        marker_column,
        j3,
        small_angles=small_angles,
        reversed_joints=names_of(reversed_joints) or (),
    )
    return import_csv(job, layout, still=Stillness.of_options(still_deg, still_s, still_mm))


def _read_points(
    job: "ImportJob",
    joint_columns: Annotated[
        str,
        Option("Columns of joint 1, 2, …: a,b,c by name or number, from 1; or A1=j1,A2=j2,… in any order."),
    ],
    joint_units: Annotated[Literal["deg", "rad"], Option("Unit of the joints.")],
    units: Annotated[
        Literal["mm", "m", "inch"] | None, Option("Unit of the coordinates, unless the file says it.")
    ] = None,
    columns: Annotated[
        str | None, Option("Columns of x,y,z, by name or number (default: by these names).")
    ] = None,
    instrument: Annotated[str | None, Option("Instrument of the header, if it states several.")] = None,
    reflector: Annotated[
        str | None,
        Option("Reflector of all points, if there are several; or of each marker in a row: R1,R2,…"),
    ] = None,
    reflector_column: Annotated[str | None, Option("Column with each point's reflector, instead.")] = None,
    joints: Annotated[
        Path | None, Option("Table of the joints, if they are not in the same table as the points.")
    ] = None,
    match: Annotated[
        Literal["number", "time"] | None, Option("What joins a point of FILE and a row of --joints.")
    ] = None,
    number_column: Annotated[
        str | None, Option("Column of the points' numbers, or names that end with them.")
    ] = None,
    joints_number_column: Annotated[
        str | None, Option("The same of --joints; without both: row by row.")
    ] = None,
    time_column: Annotated[str | None, Option("Column of the points' times.")] = None,
    time_units: Annotated[
        str | None, Option("Their unit: s, ms, us, ns, iso, or a pattern such as %d.%m.%Y %H:%M:%S.")
    ] = None,
    joints_time_column: Annotated[str | None, Option("Column of times of --joints.")] = None,
    joints_time_units: Annotated[str | None, Option("Their unit, if it is another one.")] = None,
    within_s: Annotated[float | None, Option("Largest time between a point and its joints, seconds.")] = None,
    rotation_columns: Annotated[
        str | None, Option("Of poses: columns of three angles, a,b,c, in the order of --euler.")
    ] = None,
    rotation_units: Annotated[Literal["deg", "rad"] | None, Option("Unit of these angles.")] = None,
    euler: Annotated[
        str | None,
        Option(
            "Axes in the order of the columns, fixed or moving with the body: XYZ-fixed, ZYX-moving, …; find:"
            " the order that fits the nominal arm; vector: a rotation vector, as of UR."
        ),
    ] = None,
    quaternion_columns: Annotated[str | None, Option("Of poses: columns w,x,y,z instead of angles.")] = None,
    inverse: Annotated[
        str | None,
        Option(
            "Of poses: the table has the inverse rotation, the inverse pose, or none. Default: looked at."
        ),
    ] = None,
    uncertainty: Annotated[
        Literal["1sigma", "95", "none"] | None,
        Option("Level of the uncertainty columns; none: they are not used."),
    ] = None,
    uncertainty_columns: Annotated[
        str | None, Option("Columns of the uncertainty of x,y,z (default: by names such as U-x).")
    ] = None,
    lengths: Annotated[Literal["mm", "m"] | None, Option("Unit of prismatic joints.")] = None,
    delimiter: Annotated[str | None, Option("Delimiter of FILE; found if not stated.")] = None,
    decimal: Decimal = ".",
    j3: J3Counting = None,
    small_angles: Annotated[
        bool, Option("The joints are in degrees, although all are as small as radians would be.")
    ] = False,
) -> "Imported":
    """Points or poses of a tracker or CMM, with the joints at each. What is not stated is never guessed."""
    from .points import PointLayout, import_points

    layout = PointLayout(
        names_of(joint_columns) or (),
        joint_units,
        units,
        names_of(columns),
        instrument,
        reflector,
        reflector_column,
        joints,
        match,
        number_column,
        joints_number_column,
        time_column,
        time_units,
        joints_time_column,
        joints_time_units,
        within_s,
        names_of(rotation_columns),
        rotation_units,
        euler,
        names_of(quaternion_columns),
        inverse,
        uncertainty,
        names_of(uncertainty_columns),
        lengths,
        delimiter,
        decimal,
        j3,
        small_angles,
    )
    return import_points(job, layout)


def _read_ros(
    job: "ImportJob",
    still_deg: StillDeg = None,
    still_s: StillSeconds = None,
    still_mm: StillMm = None,
    columns: Annotated[
        str | None, Option("Names of joint 1, 2, … in the messages: a,b,c (default: the robot's own).")
    ] = None,
    topic: Annotated[str | None, Option("Topic of the arm, if there are several.")] = None,
    marker_topic: Annotated[
        str | None,
        Option("Only dwells at a message on this topic; a std_msgs/String names the target."),
    ] = None,
) -> "Imported":
    """Joint states: in ROS bags a measurement is where the arm dwells (at a marker, if stated).

    In the text of ros2 topic echo each message is one.
    """
    from .dwells import Stillness
    from .ros import import_joint_states, import_ros

    if all(path.suffix.lower() in (".yaml", ".yml", ".txt") for path in job.paths):
        if any(option is not None for option in (still_deg, still_s, still_mm, topic, marker_topic)):
            raise BadInput(
                "joint states in text have no times: each message is a measurement",
                remedy="leave out --still-deg, --still-s, --still-mm, --topic and --marker-topic",
            )
        return import_joint_states(job, columns=names_of(columns))
    still = Stillness.required(still_deg, still_s, still_mm)
    return import_ros(job, still=still, columns=names_of(columns), topic=topic, marker_topic=marker_topic)


def _read_robodk(job: "ImportJob", j3: J3Counting = None) -> "Imported":
    """RoboDK: what a plan's program has recorded. Logs of MonitorJoints: import log robodk."""
    from ..joint_text import import_program_log

    return import_program_log(job, source="RoboDK", j3=j3)


def _monitor_joints(joints: int) -> "CsvLayout":
    """RoboDK's macro MonitorJoints: joints in degrees, then seconds, no header, a row where they changed."""
    from .csv_file import CsvLayout

    columns = tuple(str(i + 1) for i in range(joints))
    return CsvLayout("deg", columns=columns, time_column=str(joints + 1), time_units="s", changes_only=True)


MAKER = Maker(
    "any maker",
    offsets=(
        OffsetFile("robot", _robot, holds="links", schema="robot", ending="yaml"),
        OffsetFile("urdf", _urdf, holds="links", ending="urdf", no_place=_of_a_moving_tip),
        OffsetFile("json", _json, holds="all", as_data=True, ending="json"),
        OffsetFile("csv", _csv, as_data=True, ending="csv"),
    ),
    program=(
        PlanProgram("robodk", "RoboDK (Python)", ("zb_plan.py",), _robodk_program, ("speed", "zone", "j3")),
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
