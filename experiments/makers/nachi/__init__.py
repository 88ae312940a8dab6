"""Nachi: SLIM programs of joint positions."""

from ..line_format import LineFormat, LineParts


def _parts() -> LineParts:
    from ...positions.joint_lists import SLIM
    from .slim_program import named_positions, slim_program

    return LineParts(SLIM, lambda plan, motion, file: slim_program(plan, motion), named_positions, digits=3)


_FORMAT = LineFormat(
    _parts,
    ("slim", "SLIM (Nachi)", ("zb_plan.slim",), ("speed", "tool")),
    "Programs as text (NAME.001).",
    "Nachi: joint positions (MOVEX … M1J) of a program that was taught, or modified in a plan's program.",
    (r"\bM1J\b", "its joint positions (M1J), as of a SLIM program"),
)
MAKER = _FORMAT.maker("Nachi", "nachi", r"nachi|mz ?\d+\w*")
