"""Epson: SPEL+ programs and their points, a sheet for Calib."""

from typing import TYPE_CHECKING

from ..maker import Maker, OffsetFile, PlanProgram, Reader
from ..program_template import ProgramName, ProgramTemplate

if TYPE_CHECKING:
    from ....model.files.run import Run
    from ..calibration import RobotCalibration
    from ..import_jobs import Imported, ImportJob


def _sheet(run: "Run", calibration: "RobotCalibration") -> str:
    """Epson: a sheet for a person, where each joint is calibrated. Nothing is applied."""
    from ..sheets import sheet_text

    return sheet_text(run.robot, calibration, "epson")


def _read_log(job: "ImportJob") -> "Imported":
    """Epson: the log of a plan's program."""
    from ..joint_text import import_program_log

    return import_program_log(job, source="SPEL+")


_NAME = ProgramName(
    r"[A-Za-z]\w{0,31}", "function", "SPEL+", "a letter, then letters, digits and _: at most 32 (zb_plan.prg)"
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
