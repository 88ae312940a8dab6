"""DRL (Doosan): a plan as a program.

Facts, from the Programming Manual of Doosan Robotics and the stubs of DRL that it publishes for RoboDK: posj
is joints, degrees; posx is X, Y, Z, A, B, C, mm and degrees, of which A, B, C turn about z, the new y and the
new z; `sol` is three bits, 4 righty (else lefty), 2 above (else below), 1 flip (else no flip), and
posj(0, 0, 90, 0, 90, 0) has sol 2; set_tcp takes a name of the pendant and stays in the controller;
set_ref_coord is DR_BASE at the begin of a program; wait_manual_guide waits for a person who guides the arm;
tp_log writes up to 256 bytes to the pendant's log.
"""

from __future__ import annotations

from ....model.files.plan import Plan
from ..format_options import ProgramMotion
from ..maker import one_line
from ..plan_programs import LOG, decimal, head_lines, listed, made_for, steps_of

_ACCELERATION = 20.0  # deg/s2
_CONFIRM = [
    "confirm: this controller has wait_manual_guide, which waits while a person guides the arm.",
    "confirm: after the run the pendant's log is saved; its lines zerobeam posture are what is imported.",
]


def drl_program(plan: Plan, motion: ProgramMotion) -> str:
    """Text of the program. At each posture it waits until a person has guided the arm, and then writes the
    joints to the pendant's log."""
    note = made_for(plan, "doosan", "a DRL program", 6, "posj")
    steps = steps_of(plan, motion)
    lines = [f"# {line}" for line in [*head_lines(plan, motion, note), *_CONFIRM]]
    lines += [f"{name} = posj({listed(row)})" for step in steps for name, row in step.named.items()]
    lines += [f"set_velj({decimal(motion.speed)})", f"set_accj({decimal(_ACCELERATION)})"]
    if motion.tool is not None:
        lines.append(f'set_tcp("{one_line(motion.tool).replace(chr(34), "")}")')
    for step in steps:
        *between, here = step.named
        lines.append(f"# posture {step.number}, {one_line(step.target)}")
        lines += [f"movej({name})" for name in between]
        values = ", ".join(f"zb_now[{i}]" for i in range(plan.robot.n))
        lines += [
            f"movej({here})",
            f'tp_popup("Posture {step.number}: guide the beam onto the centre, then continue")',
            "wait_manual_guide()",
            "wait(1.0)",
            "zb_now = get_current_posj()",
            f'tp_log("{LOG} {step.number} deg{" {:.6f}" * plan.robot.n}".format({values}))',
        ]
    return "\n".join(lines) + "\n"
