"""Franka: joint lists in radians, out and back."""

from ..maker import Maker, PlanProgram, TaughtFormat
from ..manifest import ProgramTemplate, taught_reader

_PROGRAM = ProgramTemplate("franka", "a joint list of libfranka", "the list", 7)
_FORMAT = TaughtFormat(
    "joint list",
    "Joint lists (.txt, .py).",
    "Franka: joints in radians, a line each (zb_m0 = [...]), as a program of libfranka recorded them.",
    ((r"^[ \t]*\w+[ \t]*=[ \t]*\[(?:[^,\]\n]+,){6}[^,\]\n]+\]", "its lists of seven numbers"),),
    digits=12,
)
MAKER = Maker(
    "Franka",
    "franka",
    r"panda|franka|fr3",
    program=(PlanProgram("franka", "joint list (Franka)", ("zb_plan.py",), _PROGRAM, ("speed",)),),
    read=(taught_reader("franka", _FORMAT),),
)
