"""Denso: PacScript programs."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ..line_marks import line_mark
from ..maker import Maker, PlanProgram, PointNames, ProgramFiles, Reader

if TYPE_CHECKING:
    from ....model.files.plan import Plan
    from ..line_language import LineLanguage
    from ..options import ProgramMotion
    from ..recordings import Imported, ImportJob


def _pacscript_program(plan: "Plan", motion: "ProgramMotion", file: Path) -> Mapping[Path, str]:
    from .pacscript import pacscript_program

    return {file: pacscript_program(plan, motion, file)}


def _read_pacscript(job: "ImportJob", points: PointNames = None) -> "Imported":
    """Denso: the messages of a plan's program, or joint positions (J) of a PacScript program."""
    from ..joint_text import import_program_log, is_program_log
    from ..taught_positions import import_taught
    from .pacscript import PACSCRIPT

    if points is None and is_program_log(job):
        return import_program_log(job, source="PacScript")
    note = "Denso joint positions (J), degrees, joint 1 first"
    return import_taught(PACSCRIPT, job, points=points, vendor="denso", note=note)


def _pacscript() -> "LineLanguage":
    from .pacscript import PACSCRIPT

    return PACSCRIPT


MAKER = Maker(
    "Denso",
    "denso",
    r"denso|v[smp] ?\d+\w*|cobotta\w*",
    program=(
        PlanProgram("pacscript", "PacScript (Denso)", ("zb_plan.pcs",), _pacscript_program, ("speed",)),
    ),
    read=(
        Reader(
            "pacscript",
            _read_pacscript,
            "Logs of a plan's program, or PacScript files (.pcs).",
            marks=(
                line_mark(
                    r"^[ \t]*[A-Za-z]\w*(?:\[\d+\])?[ \t]*=[ \t]*J[ \t]*\(",
                    "its joint positions (… = J(…)), as of a PacScript program",
                    _pacscript,
                ),
            ),
            program_log=True,
        ),
    ),
    correct=(ProgramFiles("PacScript", ".pcs (Denso)", (".pcs",), _pacscript),),
)
