"""ABB: MOC.cfg, RAPID, logs of EGM."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ....model.options import Option
from ..maker import KnownLog, Maker, OffsetFile, PlanProgram, PointNames, TaughtFormat, require_vendor
from ..manifest import ProgramTemplate, ToolName, read_taught, taught_reader

if TYPE_CHECKING:
    from ....model.files.plan import Plan
    from ....model.files.run import Run
    from ...command_options import ProgramMotion
    from ..calibration import RobotCalibration
    from ..generic.layouts import CsvLayout
    from ..import_jobs import Imported, ImportJob

_AXES = 6  # rax_1 to rax_6 of a robjoint


def _moc(
    run: "Run",
    calibration: "RobotCalibration",
    against: Annotated[
        Path | None, Option("The controller's MOC.cfg: write a diff against it.", among="files")
    ] = None,
    motor_sign: Annotated[
        str | None,
        Option(
            "1 if a reading rises with cal_offset (at a positive ratio), -1 if it falls; one, or one a joint:"
            " 1,-1,…"
        ),
    ] = None,
    ratio: Annotated[
        str | None,
        Option("Motor turns for one turn of each joint: R1,R2,…, negative if in opposite directions."),
    ] = None,
    unit: Annotated[str, Option("Mechanical unit: its motors are UNIT_1, UNIT_2, …")] = "rob1",
) -> str:
    """ABB: changes of the motors' calibration offsets, as a diff to look at. Nothing is applied."""
    from .moc_offsets import Gears, moc_text

    return moc_text(calibration, Gears.of_options(ratio, motor_sign, run.robot.n), against, unit)


def _rapid_offsets(run: "Run", calibration: "RobotCalibration") -> str:
    """ABB: a RAPID module with functions that correct a jointtarget by the offsets."""
    return rapid_text(calibration)


def rapid_text(calibration: "RobotCalibration") -> str:
    """Text of the module: ASCII, degrees. RAPID's num holds some seven digits, so six decimals are written.

    BadInput for a robot that is not ABB's, or that a RAPID robjoint (six axes in degrees) cannot hold.
    """
    from ..calibration import NO_ROBOT
    from ..plan_programs import filled, require_axes

    remedy = "export json or csv, and apply the offsets by hand"
    require_vendor(calibration.corrected, "abb", "a RAPID module")
    require_axes(calibration.corrected, _AXES, "a RAPID jointtarget", remedy)
    numbers = [f"{offset.applied:.6f}" for offset in calibration.offsets]
    numbers += ["0"] * (_AXES - len(numbers))
    values = {
        "head": calibration.head,
        "numbers": numbers,
        "simulated": NO_ROBOT if NO_ROBOT in calibration.warnings else None,
    }
    (text,) = filled(Path(__file__).with_name("offsets.j2"), values)
    return text


def _zone(plan: "Plan", motion: "ProgramMotion") -> Mapping[str, object]:
    """As z10 and its like are defined: 1.5 times as wide for the orientation and the external axes."""
    from ..plan_programs import decimal

    if motion.zone == 0:
        return {"zone": "[TRUE,0,0,0,0,0,0]"}
    mm, wide, turn = (decimal(factor * motion.zone) for factor in (1.0, 1.5, 0.15))
    return {"zone": f"[FALSE,{mm},{wide},{wide},{turn},{wide},{turn}]"}


_PROGRAM = ProgramTemplate(
    "abb",
    "a RAPID program",
    "a RAPID jointtarget",
    tool=ToolName(r"[A-Za-z]\w{0,31}", "a name of RAPID", "the name of a tooldata: tool0", "tool0"),
    quote=lambda text: text.replace("\\", "/").replace('"', "'"),
    more=_zone,
)


_FORMAT = TaughtFormat(
    "RAPID",
    "Log of a plan's program, or modules with targets (.mod).",
    "ABB: what a plan's program has recorded, or taught jointtargets and robtargets.",
    (
        (
            r"^[^!\"\n]*\b(?:CONST|PERS|VAR)\s+(?:jointtarget|robtarget)\s",
            "its declarations of RAPID targets",
        ),
    ),
    log="RAPID",
    declared=True,
    digits=3,
    note="RAPID jointtargets, angles in degrees, rax_1 first, external axes ignored",
)


def _read(
    job: "ImportJob",
    points: PointNames = None,
    tool: Annotated[
        str | None, Option("Read robtargets too, of this tool as seen from the flange: X,Y,Z,Q1,Q2,Q3,Q4.")
    ] = None,
    frame: Annotated[str | None, Option("Their work object, if not wobj0: X,Y,Z,Q1,Q2,Q3,Q4.")] = None,
) -> "Imported":
    from ....model.errors import BadInput

    if tool is None and frame is not None:
        raise BadInput("--frame is of robtargets, and these need their tool", remedy="state --tool too")
    if tool is None:
        return read_taught(_FORMAT, job, points)
    from ..taught_positions import joints_of

    note = f"; robtargets by inverse kinematics of the nominal arm, tool {tool}, frame {frame or 'wobj0'}"
    return read_taught(_FORMAT, job, points, posed=joints_of(job.robot, tool, frame, points), note=note)


def _egm(joints: int) -> "CsvLayout":
    """EGM as logged by abb_libegm (EGMLogger): degrees, the controller's time in ms (egm.proto: tm).

    Six significant digits: angles beyond 100 degrees are cut to 0.001.
    """
    from ..generic.layouts import CsvLayout

    columns = tuple(f"R_FB_POS_RJ{i + 1}" for i in range(joints))
    return CsvLayout(
        "deg", header_row=True, columns=columns, delimiter=",", time_column="TIMESTAMP", time_units="ms"
    )


MAKER = Maker(
    "ABB",
    "abb",
    r"abb|irb ?\d*\w*|yumi|gofa|swifti",
    offsets=(OffsetFile("moc", _moc), OffsetFile("rapid", _rapid_offsets, ending="mod")),
    program=(PlanProgram("rapid", "RAPID (ABB)", ("zb_plan.mod",), _PROGRAM, ("speed", "zone", "tool")),),
    read=(taught_reader("rapid", _FORMAT, _read),),
    logs=(KnownLog("egm", "ABB EGM log of abb_libegm", _egm, ("TIMESTAMP", "R_FB_POS_RJ1")),),
    live="abb",
)
