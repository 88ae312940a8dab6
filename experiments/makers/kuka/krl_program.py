"""A plan as a KRL program (KUKA): a .src that goes to one posture each start, a .dat that keeps the axes.

After a person has jogged, the controller wants block coincidence before it goes on: it would return to the
posture. So the program ends at each posture. Started again it first moves to where the arm is, which is no
motion, records the axes in its data list, which keeps them, and goes to the next posture.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from ....model.errors import BadInput
from ....model.files.plan import Plan
from ..format_options import ProgramMotion
from ..maker import one_line
from ..plan_programs import LOG_PLAN, PlanStep, decimal, head_lines, made_for, percents, short_hash, steps_of

AXES = 6
MEASURED, DONE = "ZB_M", "ZB_D"  # with the number of the posture: its recorded axes, whether they are
_NAME = re.compile(r"[A-Za-z]\w{0,23}")


def krl_program(plan: Plan, motion: ProgramMotion, file: Path) -> dict[Path, str]:
    """The .src `file` and the .dat beside it, with their texts."""
    name = file.stem
    if file.suffix.lower() != ".src":
        raise BadInput("a KRL program is a .src and a .dat", found=file.name, allowed="-o NAME.src")
    note = made_for(plan, "kuka", "a KRL program", AXES, "a KRL AXIS")
    if not _NAME.fullmatch(name):
        raise BadInput(
            "the file's name is that of the module, and KRL does not allow this one",
            found=name,
            allowed="a letter, then letters, digits and _: at most 24 (zb_plan.src)",
            remedy="choose another name for the file",
        )
    steps, head = steps_of(plan, motion), [f"; {line}" for line in head_lines(plan, motion, note)]
    return {
        file: _source(plan, motion, name, steps, head),
        file.with_suffix(".dat"): _data(plan, name, steps, head),
    }


def _source(plan: Plan, motion: ProgramMotion, name: str, steps: list[PlanStep], head: list[str]) -> str:
    lines = [
        "&ACCESS RVP",
        f"DEF {name}( )",
        *head,
        "; T1: select the program, Start. At each posture it ends: jog the wrist until the beam is on the",
        "; centre of the PSD, then reset the program and Start: it records the axes and goes on. When all",
        f"; are recorded, copy {name}.dat from the controller: zerobeam import krl reads it.",
        "BAS(#INITMOV,0)",
        *_tool(motion.tool),
        *(
            f"$VEL_AXIS[{i}]={percent}\n$ACC_AXIS[{i}]=20"
            for i, percent in enumerate(percents(plan.robot, motion.speed), start=1)
        ),
        f"$APO.CPTP={round(motion.zone)}",
        "$ADVANCE=0",
        "PTP $AXIS_ACT ; block coincidence where the arm is: no motion",
        "IF ZB_WAITS==TRUE THEN",
        "  SWITCH ZB_NEXT",
        *(line for step in steps for line in _recorded(step.number)),
        "  ENDSWITCH",
        "  ZB_WAITS=FALSE",
        "  ZB_NEXT=ZB_NEXT+1",
        "ENDIF",
        "SWITCH ZB_NEXT",
        *(line for step in steps for line in _visit(step, motion)),
        "ENDSWITCH",
        "END",
    ]
    return "\n".join(lines) + "\n"


def _tool(tool: str | None) -> list[str]:
    if tool is None:
        return ["$TOOL=$NULLFRAME", "$BASE=$NULLFRAME"]
    if not tool.isdecimal() or not 1 <= int(tool) <= 64:
        raise BadInput("--tool is not a tool number of KRL", found=tool, allowed="1 to 64")
    return [f"BAS(#TOOL,{int(tool)})", "$BASE=$NULLFRAME"]


def _recorded(number: int) -> Iterator[str]:
    yield f"  CASE {number}"
    yield f"    {MEASURED}{number}=$AXIS_ACT"
    yield f"    {DONE}{number}=TRUE"


def _visit(step: PlanStep, motion: ProgramMotion) -> Iterator[str]:
    yield f"CASE {step.number}"
    yield f"  ; posture {step.number}, {one_line(step.target)}"
    *between, there = (name.upper() for name in step.named)
    for name in between:
        yield f"  PTP {name}" + (" C_PTP" if motion.zone else "")
    yield f"  PTP {there}"
    yield "  ZB_WAITS=TRUE"


def _data(plan: Plan, name: str, steps: list[PlanStep], head: list[str]) -> str:
    zero = _axes((0.0,) * plan.robot.n)
    lines = [
        "&ACCESS RVP",
        f"DEFDAT {name} PUBLIC",
        *head,
        f"DECL CHAR ZB_PLAN_OF[{len(short_hash(plan))}]",
        f'ZB_PLAN_OF[]="{short_hash(plan)}" ; {LOG_PLAN}',
        "DECL INT ZB_NEXT=0 ; the posture that comes next; set it to begin with another one",
        "DECL BOOL ZB_WAITS=FALSE ; the arm is at it, to be centred",
    ]
    for step in steps:
        lines += [f"DECL AXIS {at.upper()}={_axes(row)}" for at, row in step.named.items()]
    for step in steps:
        lines += [f"DECL E6AXIS {MEASURED}{step.number}={zero}", f"DECL BOOL {DONE}{step.number}=FALSE"]
    return "\n".join([*lines, "ENDDAT"]) + "\n"


def _axes(row: tuple[float, ...]) -> str:
    return "{" + ",".join(f"A{i} {decimal(value)}" for i, value in enumerate(row, start=1)) + "}"
