"""Epson: SPEL+ programs and their points, a sheet for Calib."""

from typing import TYPE_CHECKING

from ..maker import Maker, PlanProgram, Reader
from ..manifest import ProgramName, ProgramTemplate, sheet_file

if TYPE_CHECKING:
    from ..import_jobs import Imported, ImportJob


def _read_log(job: "ImportJob") -> "Imported":
    """Epson: the log of a plan's program."""
    from ..joint_text import import_program_log

    return import_program_log(job, source="SPEL+")


_NAME = ProgramName.word("function", "SPEL+", 32, "zb_plan.prg")
_PROGRAM = ProgramTemplate("epson", "a SPEL+ program", "JA", name=_NAME)
_SHEET = "Epson: a sheet for a person, where each joint is calibrated. Nothing is applied."
MAKER = Maker(
    "Epson",
    "epson",
    r"epson|prosix\w*",
    offsets=(sheet_file("epson", _SHEET),),
    program=(PlanProgram("spel", "SPEL+ (Epson)", ("zb_plan.prg",), _PROGRAM, ("speed",)),),
    read=(Reader("spel", _read_log, "Logs of a plan's program (zb_plan.log).", program_log=True),),
)
