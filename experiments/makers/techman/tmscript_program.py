"""TMscript (Techman): a plan as a program.

Facts, from the Programming Language manual of TMscript (2.18) and the driver tmr_ros2 (TechmanRobotInc): JPP
is joints, degrees; CPP, CPR, CAP and CAR are X, Y, Z, RX, RY, RZ, mm and degrees, turned about fixed x, y, z,
of which the second letter is that of the speed and the third that of the blending; RobotBase and NOTOOL are
the arm's base and flange; Pause stops the project until a person resumes it.
"""

from __future__ import annotations

from ....model.files.plan import Plan
from ..format_options import ProgramMotion
from ..maker import one_line
from ..plan_programs import head_lines, listed, made_for, percents, steps_of

_TO_SPEED_MS = 500
_CONFIRM = [
    "confirm: the arm can be jogged while the project is paused. If not: stop, jog, and go on behind it.",
    "At each pause: write the joint angles that the pendant shows into the line of zb_p0, zb_p1, and so on;",
    "then import this file. Postures whose numbers are as they were are left out.",
]


def tmscript_program(plan: Plan, motion: ProgramMotion) -> str:
    """Text of the program. At each posture the project pauses, and a person writes the joints down."""
    note = made_for(plan, "techman", "a TMscript program", 6, "JPP")
    steps, percent = steps_of(plan, motion), min(percents(plan.robot, motion.speed))
    lines = [f"// {line}" for line in [*head_lines(plan, motion, note), *_CONFIRM]]
    lines += ["define", "{"]
    lines += [f"float[] {name} = {{{listed(row)}}}" for step in steps for name, row in step.named.items()]
    lines += ["}", "main", "{"]
    if motion.tool is not None:
        lines.append(f'ChangeTCP("{one_line(motion.tool).replace(chr(34), "")}")')
    for step in steps:
        lines.append(f"// posture {step.number}, {one_line(step.target)}")
        lines += [f'PTP("JPP",{name},{percent},{_TO_SPEED_MS},0,false)' for name in step.named]
        tag = step.number + 1
        lines += [f"QueueTag({tag})", f"WaitQueueTag({tag})", "Pause()"]
    return "\n".join([*lines, "}"]) + "\n"
