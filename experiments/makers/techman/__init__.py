"""Techman: TMscript programs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..maker import FormatMark, Maker, PlanProgram, PointNames, ProgramFiles, Reader, names_of

if TYPE_CHECKING:
    from ....model.files.plan import Plan
    from ..line_language import LineLanguage
    from ..plan_programs import ProgramMotion
    from ..recordings import Imported, ImportJob, TaughtPoint


def _tmscript_program(plan: "Plan", motion: "ProgramMotion", file: Path) -> Mapping[Path, str]:
    from .tmscript_language import tmscript_program

    return {file: tmscript_program(plan, motion)}


def _read_tmscript(job: "ImportJob", points: PointNames = None) -> "Imported":
    """Techman: joints in TMscript, as a person wrote them into a plan's program."""
    from ..taught_positions import import_taught
    from .tmscript_language import TMSCRIPT

    note = "Techman joint angles, degrees, joint 1 first"
    return import_taught(TMSCRIPT, job, points=names_of(points), vendor="techman", note=note)


def _tmscript() -> "LineLanguage":
    from .tmscript_language import TMSCRIPT

    return TMSCRIPT


def _points(text: str, path: Path) -> "Sequence[TaughtPoint]":
    from ..taught_positions import written_points
    from .tmscript_language import TMSCRIPT

    return written_points(TMSCRIPT, text, path)


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
                FormatMark(
                    r"\bJPP\b|^[ \t]*float\[\][ \t]+\w+[ \t]*=[ \t]*\{",
                    "its joints (JPP, float[]), as of TMscript",
                    _points,
                ),
            ),
        ),
    ),
    correct=(ProgramFiles("TMscript", ".tms (Techman)", (".tms",), _tmscript),),
)
