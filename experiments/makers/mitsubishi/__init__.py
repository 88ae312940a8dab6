"""Mitsubishi: MELFA-BASIC V and VI programs."""

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


def _melfa_program(plan: "Plan", motion: "ProgramMotion", file: Path) -> Mapping[Path, str]:
    from .melfa_basic import melfa_program

    return {file: melfa_program(plan, motion, file)}


def _read_melfa(job: "ImportJob", points: PointNames = None) -> "Imported":
    """Mitsubishi: joint variables (J…) of a program saved as text, taught at the postures."""
    from ..taught_positions import import_taught
    from .melfa_basic import MELFA_BASIC

    return import_taught(
        MELFA_BASIC,
        job,
        points=points,
        vendor="mitsubishi",
        note="Mitsubishi joint variables, degrees, joint 1 first",
    )


def _melfa() -> "LineLanguage":
    from .melfa_basic import MELFA_BASIC

    return MELFA_BASIC


MAKER = Maker(
    "Mitsubishi",
    "mitsubishi",
    r"mitsubishi|melfa|rv ?\d+\w*",
    program=(PlanProgram("melfa", "MELFA-BASIC (Mitsubishi)", ("ZB_PLAN.prg",), _melfa_program, ("speed",)),),
    read=(
        Reader(
            "melfa",
            _read_melfa,
            "Programs as text (.prg, .mb5).",
            marks=(
                line_mark(
                    r"^[ \t]*(?:\d+[ \t]+)?J\w+[ \t]*=[ \t]*\(",
                    "its joint variables (J… = (…)), as of a MELFA-BASIC program",
                    _melfa,
                ),
            ),
        ),
    ),
    correct=(ProgramFiles("MELFA-BASIC", ".prg or .mb5 (Mitsubishi)", (".prg", ".mb5"), _melfa),),
)
