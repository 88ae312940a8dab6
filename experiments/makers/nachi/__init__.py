"""Nachi: SLIM programs of joint positions."""

from ..line_format import LineFormat, LineParts
from ..maker import Maker, PlanProgram, Reader


def _parts() -> LineParts:
    from ...positions.joint_lists import SLIM
    from .slim_program import named_positions, slim_program

    return LineParts(SLIM, lambda plan, motion, file: slim_program(plan, motion), named_positions, digits=3)


_FORMAT = LineFormat(_parts)
_READ = _FORMAT.reader(
    "Nachi: joint positions (MOVEX … M1J) of a program that was taught, or modified in a plan's program.",
)
MAKER = Maker(
    "Nachi",
    "nachi",
    r"nachi|mz ?\d+\w*",
    program=(PlanProgram("slim", "SLIM (Nachi)", ("zb_plan.slim",), _FORMAT.program, ("speed", "tool")),),
    read=(
        Reader(
            "slim",
            _READ,
            "Programs as text (NAME.001).",
            marks=(_FORMAT.mark(r"\bM1J\b", "its joint positions (M1J), as of a SLIM program"),),
        ),
    ),
)
