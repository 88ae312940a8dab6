"""Techman: TMscript programs."""

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


def _tmscript_program(plan: "Plan", motion: "ProgramMotion", file: Path) -> Mapping[Path, str]:
    from .tmscript_language import tmscript_program

    return {file: tmscript_program(plan, motion)}


def _read_tmscript(job: "ImportJob", points: PointNames = None) -> "Imported":
    """Techman: joints in TMscript, as a person wrote them into a plan's program."""
    from ..taught_positions import import_taught
    from .tmscript_language import TMSCRIPT

    note = "Techman joint angles, degrees, joint 1 first"
    return import_taught(TMSCRIPT, job, points=points, vendor="techman", note=note)


def _tmscript() -> "LineLanguage":
    from .tmscript_language import TMSCRIPT

    return TMSCRIPT


MAKER = Maker(
    "Techman",
    "techman",
    r"techman|tm ?\d+[sx]?|tm ?\d+[sx]? \d{3,4}",
    program=(
        PlanProgram("tmscript", "TMscript (Techman)", ("zb_plan.tms",), _tmscript_program, ("speed", "tool")),
    ),
    read=(
        Reader(
            "tmscript",
            _read_tmscript,
            "TMscript files (.tms, .txt).",
            marks=(
                line_mark(
                    r"\bJPP\b|^[ \t]*float\[\][ \t]+\w+[ \t]*=[ \t]*\{",
                    "its joints (JPP, float[]), as of TMscript",
                    _tmscript,
                ),
            ),
        ),
    ),
    correct=(ProgramFiles("TMscript", ".tms (Techman)", (".tms",), _tmscript),),
)
