"""MELFA-BASIC V (Mitsubishi): a plan as a program.

Facts, from the instruction manual of the CR750 and CR800 (detailed explanations of functions and operations)
and a driver of melfa (Melfa::moveTo): names that begin with J are joints, degrees, with P positions X, Y, Z,
A, B, C, mm and degrees, of which A, B, C turn about fixed x, y, z; their flags have the configuration and the
turns. Tool and Base stay in the controller: a program that does not set them leaves both open.
"""

from __future__ import annotations

from pathlib import Path

from ....model.files.plan import Plan
from ..format_options import ProgramMotion
from ..maker import one_line
from ..plan_programs import decimal, head_lines, made_for, percents, require_name, steps_of

DIGITS = 2  # of the values of a program that the controller saves
_CONFIRM = (
    "At each posture the program stops (Hlt): jog the beam onto the centre, and teach the joint variable of",
    "the posture again (JZB_P0, JZB_P1, ...). Then start; confirm: the arm goes on to the next posture, or",
    "returns to where it stopped first (parameter RETPATH). At the end save the program as text, with its",
    "variables.",
)


def melfa_program(plan: Plan, motion: ProgramMotion, file: Path) -> str:
    """Text of the program. At each posture it stops, for its joint variable to be taught again."""
    note = made_for(plan, "mitsubishi", "a MELFA-BASIC program", 6, "a joint variable")
    require_name(
        file,
        r"[A-Za-z0-9]\w{0,15}",
        "program",
        "the controller",
        "letters, digits and _: at most 16 (ZB_PLAN.prg)",
    )
    steps, percent = steps_of(plan, motion), min(percents(plan.robot, motion.speed))
    lines = [f"' {line}" for line in (*head_lines(plan, motion, note), *_CONFIRM)]
    lines += [f"JOvrd {percent}", "Cnt 0"]
    for step in steps:
        lines.append(f"' posture {step.number}, {one_line(step.target)}")
        lines += [f"Mov J{name.upper()}" for name in step.named]
        lines.append("Hlt")
    lines.append("End")
    for step in steps:
        for name, row in step.named.items():
            values = ",".join(
                f"{'+' if value >= 0 else ''}{decimal(round(value, DIGITS) + 0.0, 2)}" for value in row
            )
            lines.append(f"J{name.upper()}=({values})")
    return "\n".join(lines) + "\n"
