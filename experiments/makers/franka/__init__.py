"""Franka: joint lists in radians, out and back."""

from ..line_format import LineFormat, LineParts


def _parts() -> LineParts:
    from ...positions.joint_lists import JOINT_LIST
    from .joint_list import DIGITS, joint_list

    return LineParts(JOINT_LIST, lambda plan, motion, file: joint_list(plan, motion), digits=DIGITS)


_FORMAT = LineFormat(
    _parts,
    ("franka", "joint list (Franka)", ("zb_plan.py",), ("speed",)),
    "Joint lists (.txt, .py).",
    "Franka: joints in radians, a line each (zb_m0 = [...]), as a program of libfranka recorded them.",
    (r"^[ \t]*\w+[ \t]*=[ \t]*\[(?:[^,\]\n]+,){6}[^,\]\n]+\]", "its lists of seven numbers"),
)
MAKER = _FORMAT.maker("Franka", "franka", r"panda|franka|fr3")
