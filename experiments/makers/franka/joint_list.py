"""Joints as a list in radians, for programs that move the arm by libfranka.

Facts, from the documentation of libfranka: `q` of its RobotState is joints in radians, joint 1 first. The
controller takes no offsets; programs compute with a model of the arm.
"""

from __future__ import annotations

import math

from ....model.files.plan import Plan
from ..format_options import ProgramMotion
from ..maker import one_line
from ..plan_programs import decimal, head_lines, made_for, steps_of

_AXES = 7
DIGITS = 12
_ABOUT = [
    "Radians, joint 1 first. Your own program moves the arm, slowly, in this order, and stops at each zb_p.",
    "There: guide the beam onto the centre, read q of the robot's state, and write it into a file as",
    "zb_m0 = [...], zb_m1 = [...], and so on; zerobeam import franka reads that file, or this one with it.",
]


def joint_list(plan: Plan, motion: ProgramMotion) -> str:
    """Text of the list."""
    note = made_for(plan, "franka", "a joint list of libfranka", _AXES, "the list")
    lines = [f"# {line}" for line in [*head_lines(plan, motion, note), *_ABOUT]]
    for step in steps_of(plan, motion):
        for name, row in step.named.items():
            values = ", ".join(decimal(round(math.radians(value), DIGITS) + 0.0) for value in row)
            lines.append(f"{name} = [{values}]  # {one_line(step.target)}")
    return "\n".join(lines) + "\n"
