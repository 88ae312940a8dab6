"""AS (Kawasaki): a plan as a program.

Facts, from the AS Language Reference Manual of Kawasaki Robotics: #names are joint displacements, degrees;
other names are transformation values X, Y, Z, O, A, T, mm and degrees, of which O, A, T turn about z, the new
y and the new z; HERE stores where the arm is; a saved file lists .JOINTS and .TRANS. TOOL and BASE stay in
the controller: a program that does not set them leaves both open.
"""

from __future__ import annotations

from pathlib import Path

from ....model.files.plan import Plan
from ..format_options import ProgramMotion
from ..maker import one_line
from ..plan_programs import decimal, head_lines, made_for, percents, require_name, steps_of


def as_program(plan: Plan, motion: ProgramMotion, file: Path) -> str:
    """Text of the program that has the name of `file`. At each posture it pauses, and then stores the joints
    as #zb_m0, #zb_m1, …, which are those of the plan before."""
    note = made_for(plan, "kawasaki", "an AS program", 6, "a joint displacement value")
    require_name(
        file,
        r"[A-Za-z]\w{0,14}",
        "program",
        "AS",
        "a letter, then letters, digits and _: at most 15 (zb_plan.as)",
    )
    steps, percent = steps_of(plan, motion), min(percents(plan.robot, motion.speed))
    lines = [f".PROGRAM {file.stem}()", *(f"  ; {line}" for line in head_lines(plan, motion, note))]
    if motion.tool is not None:
        lines.append(f"  TOOL {one_line(motion.tool)}")
    lines += [f"  POINT #zb_m{step.number} = #zb_p{step.number}" for step in steps]
    lines += [f"  SPEED {percent} ALWAYS", f"  ACCURACY {decimal(motion.zone or 1.0, 0)} ALWAYS"]
    for step in steps:
        lines.append(f"  ; posture {step.number}, {one_line(step.target)}")
        *between, here = step.named
        lines += [f"  JMOVE #{name}" for name in between]
        lines += [
            f"  JMOVE #{here}",
            "  BREAK",
            f'  TYPE "Posture {step.number}: jog the beam onto the centre, then continue"',
            "  PAUSE",
            f"  HERE #zb_m{step.number}",
        ]
    lines += [".END", ".JOINTS"]
    for step in steps:
        lines += [f"#{name} {' '.join(decimal(v, 3) for v in row)}" for name, row in step.named.items()]
    return "\n".join([*lines, ".END"]) + "\n"
