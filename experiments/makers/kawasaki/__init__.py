"""Kawasaki: AS programs."""

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


def _as_program(plan: "Plan", motion: "ProgramMotion", file: Path) -> Mapping[Path, str]:
    from .as_language import as_program

    return {file: as_program(plan, motion, file)}


def _read_as(job: "ImportJob", points: PointNames = None) -> "Imported":
    """Kawasaki: joint displacement values (#name) of a saved file, taught or recorded by a plan's program."""
    from ..taught_positions import import_taught
    from .as_language import AS

    return import_taught(
        AS,
        job,
        points=points,
        vendor="kawasaki",
        note="Kawasaki joint displacement values, degrees, joint 1 first",
    )


def _as() -> "LineLanguage":
    from .as_language import AS

    return AS


MAKER = Maker(
    "Kawasaki",
    "kawasaki",
    r"kawasaki|rs ?\d+\w*|bx ?\d+\w*|duaro\w*",
    program=(PlanProgram("as", "AS (Kawasaki)", ("zb_plan.as",), _as_program, ("speed", "zone", "tool")),),
    read=(
        Reader(
            "as",
            _read_as,
            "Saved AS files (.as, .pg).",
            marks=(
                line_mark(
                    r"^[ \t]*\.(?:PROGRAM|JOINTS|TRANS)\b",
                    "its lines .PROGRAM or .JOINTS, as of an AS file",
                    _as,
                ),
            ),
        ),
    ),
    correct=(ProgramFiles("AS", ".as or .pg (Kawasaki)", (".as", ".pg"), _as),),
)
