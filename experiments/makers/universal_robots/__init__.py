"""Universal Robots: zeros of joints, factory calibrations, URScript, RTDE recordings."""

import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ....model.errors import BadInput
from ....model.options import Option
from ..maker import (
    Decimal,
    KnownLog,
    Maker,
    MarkerColumn,
    OffsetFile,
    PlanProgram,
    Reader,
    StillDeg,
    StillSeconds,
    require_vendor,
)
from ..manifest import ProgramTemplate

if TYPE_CHECKING:
    from ....model.files.plan import Plan
    from ....model.files.run import Run
    from ...command_options import ProgramMotion
    from ..calibration import RobotCalibration
    from ..generic.layouts import CsvLayout
    from ..import_jobs import Imported, ImportJob


def _sheet(run: "Run", calibration: "RobotCalibration") -> str:
    """Universal Robots: a sheet for a person, how to set the zero of each joint. Nothing is applied."""
    from ..plan_programs import sheet_text
    from .kinematics import require_factory_arm

    require_vendor(run.robot, "universal-robots", "this sheet")
    require_factory_arm(run.header.robot, run.path.parent)
    # The motors are in the joints: none moves another one.
    return sheet_text(run.robot, calibration, "universal-robots", wrist_driven=False)


def _calibration(
    run: "Run",
    calibration: "RobotCalibration",
    against: Annotated[
        Path | None,
        Option(
            "The arm's present calibration.yaml: its hash is kept, which ROS compares with the robot's.",
            among="files",
        ),
    ] = None,
) -> str:
    """Universal Robots: a corrected calibration.yaml for ROS, of offsets, link lengths and angles."""
    from .kinematics import ur_calibration_text

    return ur_calibration_text(run, calibration, against)


def _beside_last_axis(run: "Run") -> Collection[str]:
    """The file has no place for what is behind the last joint, unless it is along its axis."""
    return [f"link{run.robot.n}.{axis}" for axis in ("a", "b", "alpha", "beta")]


_AXES = 6
_LISTENER = re.compile(r"([A-Za-z0-9][A-Za-z0-9.-]{0,252}):(\d{1,5})", re.ASCII)


def _listener(plan: "Plan", motion: "ProgramMotion") -> Mapping[str, object]:
    """Who is told the joints besides the log: host and port, None where nobody is."""
    if plan.robot.n != _AXES:
        raise BadInput("a URScript joint vector has six joints", found=f"{plan.robot.n} joints")
    if motion.listener is None:
        return {"listener": None}
    match = _LISTENER.fullmatch(motion.listener)
    if match is None or not 0 < int(match[2]) < 65536:
        raise BadInput(
            "--listener is not understood",
            found=motion.listener,
            allowed="HOST:PORT, such as 192.168.0.10:50007",
        )
    return {"listener": (match[1], int(match[2]))}


_PROGRAM = ProgramTemplate(
    "universal-robots",
    "a URScript program",
    "a URScript joint vector",
    _AXES,
    quote=lambda text: text.replace("\\", "/").replace('"', "'"),
    more=_listener,
)


def _rtde(joints: int) -> "CsvLayout":
    """`record.py` of the RTDE client: blanks between values, q in rad, time in s."""
    from ..generic.layouts import CsvLayout

    columns = tuple(f"actual_q_{i}" for i in range(joints))
    return CsvLayout(
        "rad", header_row=True, columns=columns, delimiter=" ", time_column="timestamp", time_units="s"
    )


def _read(
    job: "ImportJob",
    still_deg: StillDeg = None,
    still_s: StillSeconds = None,
    delimiter: Annotated[str | None, Option("Delimiter of a recording, if not the usual one.")] = None,
    decimal: Decimal = ".",
    marker_column: MarkerColumn = None,
) -> "Imported":
    """Universal Robots: what a plan's program has recorded, or RTDE recordings, by where the arm dwells."""
    from ..generic.layouts import Stillness
    from ..joint_text import import_program_log
    from ..known_logs import read_log

    still = Stillness(still_deg, still_s)
    if not still.defined:
        return import_program_log(job, source="URScript")
    return read_log(job, _rtde, still, delimiter, decimal, marker_column)


MAKER = Maker(
    "Universal Robots",
    "universal-robots",
    r"ur ?\d+ ?e?|universal robots?",
    offsets=(
        OffsetFile("ur", _sheet),
        OffsetFile("ur-calibration", _calibration, holds="links", ending="yaml", no_place=_beside_last_axis),
    ),
    program=(
        PlanProgram(
            "urscript",
            "URScript (Universal Robots)",
            ("zb_plan.script",),
            _PROGRAM,
            ("speed", "zone", "listener"),
        ),
    ),
    read=(
        Reader(
            "universal-robots",
            _read,
            "Logs of a plan's program, or RTDE recordings (.csv).",
            program_log=True,
        ),
    ),
    logs=(KnownLog("ur", "RTDE recording", _rtde, ("timestamp", "actual_q_0")),),
    live="ur://HOST",
)
