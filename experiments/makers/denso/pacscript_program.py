"""PacScript (Denso RC8, RC9): a plan as a program.

Facts, from the RC8 manual of Denso Wave (IDs 5210 and 5225, Move, Speed, DriveA), its RC5 manual (joint type
constants) and published programs: J is the joints, degrees, joint 1 first; P is X, Y, Z, RX, RY, RZ, mm and
degrees, of which RX, RY, RZ turn about fixed x, y, z, and a figure; J[n] and P[n], also Jn and Pn, belong to
all programs; @E waits until the encoders have arrived; PrintDbg writes to the message output window. Whether
TakeArm changes tool and frame is not published as far as is known here: behind it both are open.
"""

from __future__ import annotations

from pathlib import Path

from ....model.files.plan import Plan
from ..format_options import ProgramMotion
from ..maker import one_line
from ..plan_programs import (
    LOG,
    LOG_PLAN,
    head_lines,
    listed,
    made_for,
    percents,
    require_name,
    short_hash,
    steps_of,
)

_STATE = "I[90]"
_USAGE = (
    "Start this program again and again: each start records where the arm is, as a line of the message",
    "output window, and goes to the next posture. In between no program runs: jog the beam onto the centre.",
    "Copy the lines of the window into zb_plan.log, or write the joints into the lines zb_p0 = J(...).",
    f"confirm: no other program uses {_STATE}, and it is 0 before the first start. It is odd at a posture",
    "that is not recorded yet; one less goes there again.",
    "confirm: CurJnt is the joints in degrees, and Joint(1, ...) joint 1 of them.",
)


def pacscript_program(plan: Plan, motion: ProgramMotion, file: Path) -> str:
    """Text of the program. Each start writes the joints of the posture where the arm is to the message output
    window, and goes to the next one; a start that was stopped on the way goes there again."""
    note = made_for(plan, "denso", "a PacScript program", 6, "J")
    require_name(
        file,
        r"[A-Za-z]\w{0,63}",
        "program",
        "PacScript",
        "a letter, then letters, digits and _: at most 64 (zb_plan.pcs)",
    )
    steps = steps_of(plan, motion)
    named = {name: row for step in steps for name, row in step.named.items()}
    joints = ' & " " & '.join(f"Str(Joint({i}, zb_here))" for i in range(1, plan.robot.n + 1))
    lines = [
        f'\'!TITLE "zerobeam plan {short_hash(plan)}"',
        *(f"' {line}" for line in (*head_lines(plan, motion, note), *_USAGE)),
        "Sub Main",
        "  Dim zb_here As Joint",
        "  Dim zb_line As String",
        *(f"  Dim {name} As Joint" for name in named),
        *(f"  {name} = J({listed(row)})" for name, row in named.items()),
        "  zb_here = CurJnt",
        f"  zb_line = {joints}",
        "  TakeArm Keep = 0",
        f"  Speed {min(percents(plan.robot, motion.speed))}",
        f"  Select Case {_STATE}",
    ]
    for step in steps:
        lines += [
            f"  Case {2 * step.number + 1}",
            f'    PrintDbg "{LOG_PLAN} {short_hash(plan)}"',
            f'    PrintDbg "{LOG} {step.number} deg " & zb_line',
            f"    {_STATE} = {2 * step.number + 2}",
        ]
    lines += ["  End Select", f"  Select Case {_STATE}"]
    for step in steps:
        lines += [
            f"  Case {2 * step.number}",
            f"    ' posture {step.number}, {one_line(step.target)}",
            *(f"    Move P, @E {name}" for name in step.named),
            f"    {_STATE} = {2 * step.number + 1}",
        ]
    return "\n".join(
        [
            *lines,
            f"  Case {2 * len(steps)}",
            '    PrintDbg "All postures are recorded."',
            f"    {_STATE} = 0",
            "  End Select",
            "  GiveArm",
            "End Sub",
            "",
        ]
    )
