"""Stäubli: VAL3 applications."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..line_format import LineFormat, LineParts
from ..program_template import ProgramName, ProgramTemplate

if TYPE_CHECKING:
    from ..import_jobs import TaughtPoint


def _parts() -> LineParts:
    from ...positions.position_languages import VAL3

    return LineParts(VAL3, _PROGRAM, _named, digits=3)


def _named(text: str, points: "Sequence[TaughtPoint]") -> "list[TaughtPoint]":
    """The positions of a data file: NAME is NAME[0]."""
    return [point._replace(name=point.name.removesuffix("[0]")) for point in points]


_NAME = ProgramName(
    r"[A-Za-z]\w{0,14}",
    "application",
    "VAL3",
    "a letter, then letters, digits and _: at most 15, and .pjx (zb_plan/zb_plan.pjx)",
    "choose another name for the file, in a folder of its own",
)
_PROGRAM = ProgramTemplate(
    "staubli",
    "a VAL3 application",
    "a jointRx",
    files=(".pjx", "start.pgx", "stop.pgx", ".dtx"),
    name=_NAME,
    escape=lambda text: text.replace("]]>", "]] >"),
)
_FORMAT = LineFormat(
    _parts,
    ("val3", "VAL3 (Stäubli)", ("zb_plan.pjx", "start.pgx", "stop.pgx", "zb_plan.dtx"), ("speed", "zone")),
    "Data files (.dtx).",
    "Stäubli: joint variables (jointRx) of a data file, taught or recorded by a plan's program.",
    (r"type=[\"']jointRx\b", "its joint variables (jointRx), as of a VAL3 data file"),
)
MAKER = _FORMAT.maker("Stäubli", "staubli", r"staubli|tx2?|tx2? ?\d+\w*")
