"""Stäubli: VAL3 applications."""

from ..maker import Maker, PlanProgram, TaughtFormat, TaughtPoint
from ..manifest import ProgramName, ProgramTemplate, taught_reader


def _named(text: str, points: list[TaughtPoint]) -> list[TaughtPoint]:
    """The positions of a data file: NAME is NAME[0]."""
    return [point._replace(name=point.name.removesuffix("[0]")) for point in points]


_NAME = ProgramName(
    r"[A-Za-z]\w{0,14}",
    "application",
    "VAL3",
    "a letter, then letters, digits and _: at most 15, and .pjx (zb_plan/zb_plan.pjx)",
    "choose another name for the file, in a folder of its own",
)
_FILES = ("zb_plan.pjx", "start.pgx", "stop.pgx", "zb_plan.dtx")
_PROGRAM = ProgramTemplate(
    "staubli",
    "a VAL3 application",
    "a jointRx",
    files=(".pjx", "start.pgx", "stop.pgx", ".dtx"),
    name=_NAME,
    escape=lambda text: text.replace("]]>", "]] >"),
)
_FORMAT = TaughtFormat(
    "VAL3",
    "Data files (.dtx).",
    "Stäubli: joint variables (jointRx) of a data file, taught or recorded by a plan's program.",
    ((r"type=[\"']jointRx\b", "its joint variables (jointRx), as of a VAL3 data file"),),
    named=_named,
    digits=3,
)
MAKER = Maker(
    "Stäubli",
    "staubli",
    r"staubli|tx2?|tx2? ?\d+\w*",
    program=(PlanProgram("val3", "VAL3 (Stäubli)", _FILES, _PROGRAM, ("speed", "zone")),),
    read=(taught_reader("val3", _FORMAT),),
)
