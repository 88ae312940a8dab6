"""Nachi: SLIM programs of joint positions."""

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


def _slim_program(plan: "Plan", motion: "ProgramMotion", file: Path) -> Mapping[Path, str]:
    from .slim import slim_program

    return {file: slim_program(plan, motion)}


def _read_slim(job: "ImportJob", points: PointNames = None) -> "Imported":
    """Nachi: joint positions (MOVEX … M1J) of a program that was taught, or modified in a plan's program."""
    from ..taught_positions import import_taught
    from .slim import SLIM, named_positions

    return import_taught(
        SLIM,
        job,
        points=points,
        vendor="nachi",
        note="Nachi joint positions (M1J), degrees, joint 1 first",
        named=named_positions,
    )


def _slim() -> "LineLanguage":
    from .slim import SLIM

    return SLIM


MAKER = Maker(
    "Nachi",
    "nachi",
    r"nachi|mz ?\d+\w*",
    program=(PlanProgram("slim", "SLIM (Nachi)", ("zb_plan.slim",), _slim_program, ("speed", "tool")),),
    read=(
        Reader(
            "slim",
            _read_slim,
            "Programs as text (NAME.001).",
            marks=(line_mark(r"\bM1J\b", "its joint positions (M1J), as of a SLIM program", _slim),),
        ),
    ),
    correct=(ProgramFiles("SLIM", ".slim (Nachi, a copy of NAME.001)", (".slim",), _slim),),
)
