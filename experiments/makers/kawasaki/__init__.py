"""Kawasaki: AS programs."""

from ..maker import Maker, PlanProgram, TaughtFormat
from ..manifest import ProgramName, ProgramTemplate, taught_reader

_NAME = ProgramName.word("program", "AS", 15, "zb_plan.as")
_PROGRAM = ProgramTemplate("kawasaki", "an AS program", "a joint displacement value", name=_NAME)
_FORMAT = TaughtFormat(
    "AS",
    "Saved AS files (.as, .pg).",
    "Kawasaki: joint displacement values (#name) of a saved file, taught or recorded by a plan's program.",
    ((r"^[ \t]*\.(?:PROGRAM|JOINTS|TRANS)\b", "its lines .PROGRAM or .JOINTS, as of an AS file"),),
)
MAKER = Maker(
    "Kawasaki",
    "kawasaki",
    r"kawasaki|rs ?\d+\w*|bx ?\d+\w*|duaro\w*",
    program=(PlanProgram("as", "AS (Kawasaki)", ("zb_plan.as",), _PROGRAM, ("speed", "zone", "tool")),),
    read=(taught_reader("as", _FORMAT),),
)
