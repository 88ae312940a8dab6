"""Epson: SPEL+ programs and their points, a sheet for Calib."""

from typing import TYPE_CHECKING

from ..maker import Maker, OffsetFile, PlanProgram, Reader, require_vendor
from ..program_template import ProgramName, ProgramTemplate

if TYPE_CHECKING:
    from ....model.files.run import Run
    from ..calibration import RobotCalibration
    from ..import_jobs import Imported, ImportJob

_ABOUT = [
    "Calibration sheet for Epson (SPEL+: Calib, which sets Hofs by CalPls). The present values are those",
    "that Hofs and CalPls print in the command window.",
    "Move the joint until Agl(n) is the reading in the third column: there it is truly at zero. With CalPls",
    "0,0,0,0,0,0 the command in the last column makes the pulses of this joint 0 there.",
    "confirm: Agl(n) is 0 where Pls(n) is 0, for each joint.",
    "confirm: the manual of the manipulator says which joints must be calibrated together with this one (on",
    "many arms joint 6 with joint 5, and both with joint 4): then move all of them to their readings first.",
    "confirm: where the model has joint accuracy offsets, changed Hofs values reset those of the joint.",
    "Epson advises not to change Hofs unless it is necessary.",
    "Tools and locals that were measured with the old values hold their error: measure them again.",
]


def _sheet(run: "Run", calibration: "RobotCalibration") -> str:
    """Epson: a sheet for a person, where each joint is calibrated. Nothing is applied."""
    from ....model.kinematics.pendant import Pendant, require_link_encoder
    from ..sheets import sheet_text

    require_vendor(run.robot, "epson", "this sheet")
    require_link_encoder(run.robot, "this sheet")
    table = [
        "joint  offset deg   calibrate the joint where it reads   command",
        *(
            f"J{i}   {offset.applied:+11.6f}   Agl({i}) = {-offset.applied:+11.6f} deg   Calib {i}"
            if offset.exported
            else f"J{i}   {'-':>11}   leave it as it is"
            for i, offset in enumerate(calibration.offsets, start=1)
        ),
    ]
    return sheet_text(calibration, _ABOUT, table, Pendant(run.robot))


def _read_log(job: "ImportJob") -> "Imported":
    """Epson: the log of a plan's program."""
    from ..joint_text import import_program_log

    return import_program_log(job, source="SPEL+")


_NAME = ProgramName(
    r"[A-Za-z]\w{0,31}",
    "function",
    "SPEL+",
    "a letter, then letters, digits and _: at most 32 (zb_plan.prg)",
)
_PROGRAM = ProgramTemplate("epson", "a SPEL+ program", "JA", name=_NAME)
MAKER = Maker(
    "Epson",
    "epson",
    r"epson|prosix\w*",
    offsets=(OffsetFile("epson", _sheet),),
    program=(PlanProgram("spel", "SPEL+ (Epson)", ("zb_plan.prg",), _PROGRAM, ("speed",)),),
    read=(Reader("spel", _read_log, "Logs of a plan's program (zb_plan.log).", program_log=True),),
)
