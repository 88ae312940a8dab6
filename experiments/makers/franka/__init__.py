"""Franka: joint lists in radians, out and back."""

from ..line_format import LineFormat, LineParts
from ..maker import Maker, PlanProgram, Reader


def _parts() -> LineParts:
    from ...positions.joint_lists import JOINT_LIST
    from .joint_list import DIGITS, joint_list

    return LineParts(JOINT_LIST, lambda plan, motion, file: joint_list(plan, motion), digits=DIGITS)


_FORMAT = LineFormat(_parts)
_READ = _FORMAT.reader(
    "Franka: joints in radians, a line each (zb_m0 = [...]), as a program of libfranka recorded them.",
)
MAKER = Maker(
    "Franka",
    "franka",
    r"panda|franka|fr3",
    program=(PlanProgram("franka", "joint list (Franka)", ("zb_plan.py",), _FORMAT.program, ("speed",)),),
    read=(
        Reader(
            "franka",
            _READ,
            "Joint lists (.txt, .py).",
            marks=(
                _FORMAT.mark(
                    r"^[ \t]*\w+[ \t]*=[ \t]*\[(?:[^,\]\n]+,){6}[^,\]\n]+\]", "its lists of seven numbers"
                ),
            ),
        ),
    ),
)
