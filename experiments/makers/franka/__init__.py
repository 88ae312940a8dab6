"""Franka: joint lists in radians, out and back."""

from ..line_format import LineFormat, LineParts
from ..program_template import ProgramTemplate


def _parts() -> LineParts:
    from ...positions.joint_lists import JOINT_LIST

    return LineParts(JOINT_LIST, _PROGRAM, digits=12)


_PROGRAM = ProgramTemplate("franka", "a joint list of libfranka", "the list", 7)
_FORMAT = LineFormat(
    _parts,
    ("franka", "joint list (Franka)", ("zb_plan.py",), ("speed",)),
    "Joint lists (.txt, .py).",
    "Franka: joints in radians, a line each (zb_m0 = [...]), as a program of libfranka recorded them.",
    (r"^[ \t]*\w+[ \t]*=[ \t]*\[(?:[^,\]\n]+,){6}[^,\]\n]+\]", "its lists of seven numbers"),
)
MAKER = _FORMAT.maker("Franka", "franka", r"panda|franka|fr3")
