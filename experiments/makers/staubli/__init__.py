"""Stäubli: VAL3 applications."""

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

_FILES = (".pgx", ".dtx", ".pjx")


def _val3_program(plan: "Plan", motion: "ProgramMotion", file: Path) -> Mapping[Path, str]:
    from .val3_program import val3_program

    return val3_program(plan, motion, file)


def _read_val3(job: "ImportJob", points: PointNames = None) -> "Imported":
    """Stäubli: joint variables (jointRx) of a data file, taught or recorded by a plan's program."""
    from ..taught_positions import import_taught
    from .val3 import VAL3

    return import_taught(
        VAL3,
        job,
        points=points,
        vendor="staubli",
        note="Stäubli joint variables, degrees, joint 1 first",
    )


def _val3() -> "LineLanguage":
    from .val3 import VAL3

    return VAL3


MAKER = Maker(
    "Stäubli",
    "staubli",
    r"staubli|tx2?|tx2? ?\d+\w*",
    program=(
        PlanProgram(
            "val3",
            "VAL3 (Stäubli)",
            ("zb_plan.pjx", "start.pgx", "stop.pgx", "zb_plan.dtx"),
            _val3_program,
            ("speed", "zone"),
        ),
    ),
    read=(
        Reader(
            "val3",
            _read_val3,
            "Data files (.dtx).",
            marks=(
                line_mark(
                    r"type=[\"']jointRx\b", "its joint variables (jointRx), as of a VAL3 data file", _val3
                ),
            ),
        ),
    ),
    correct=(
        ProgramFiles(
            "VAL3",
            ".pgx or .dtx (Stäubli, all of the folder)",
            _FILES,
            _val3,
            paired=_FILES,
            folder=_FILES,
        ),
    ),
)
