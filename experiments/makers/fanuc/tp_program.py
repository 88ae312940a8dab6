"""A plan as a TP program in ASCII (FANUC): J moves, PAUSE at each posture, joints into position registers.

What a register held before is overwritten by a joint 1 of 999 degrees when the program begins, so that an
importer cannot take it for a measurement.
"""

from __future__ import annotations

import re

from ....model.errors import BadInput
from ....model.files.plan import Plan
from ....model.kinematics.pendant import pendant_of
from ..format_options import ProgramMotion
from ..maker import one_line
from ..plan_programs import LOG_PLAN, decimal, made_for, percents, short_hash, steps_of

AXES = 6
_COMMENT = 32  # characters of a comment line
_REGISTERS = 100
_NAME = re.compile(r"[A-Za-z]\w{0,35}")


def registers_of(plan: Plan, motion: ProgramMotion) -> tuple[int, int]:
    """The first and the last position register that the program writes."""
    first = 1 if motion.register is None else motion.register
    return first, first + len(plan.postures) - 1


def fanuc_program(plan: Plan, motion: ProgramMotion, name: str) -> str:
    """Text of the listing `name`.ls. Joint 3 is counted from the ground, as a FANUC does, or from link 2, as
    on the few controllers that are set so."""
    made_for(plan, "fanuc", "a TP program", AXES, "a TP position")
    pendant = pendant_of(plan.robot, motion.j3, "fanuc")
    if not _NAME.fullmatch(name):
        raise BadInput(
            "the file's name is that of the program, and a FANUC does not allow this one",
            found=name,
            allowed="a letter, then letters, digits and _: at most 36 (zb_plan.ls)",
            remedy="choose another name for the file",
        )
    steps, (register, last) = steps_of(plan, motion), registers_of(plan, motion)
    if not 1 <= register <= last <= _REGISTERS:
        raise BadInput(
            "the position registers of the postures do not exist",
            found=f"PR[{register}] to PR[{last}]",
            allowed=f"PR[1] to PR[{_REGISTERS}]",
            remedy="state another --register, or divide the plan",
        )
    percent = min(percents(plan.robot, motion.speed))
    end = f"CNT{round(motion.zone)}" if motion.zone else "FINE"
    counted = f"J3 counted from {'the ground' if pendant.ground else 'link 2'}"
    remarks = (
        f"{LOG_PLAN} {short_hash(plan)}",
        counted,
        f"Joint moves, about {motion.speed:g} deg/s",
        "Not checked: collisions. First",
        "run: T1, low override",
        *(() if plan.via else ("No intermediate postures: the", "arm goes straight to the next")),
        f"OVERWRITES PR[{register}] to PR[{last}]:",
        "save posreg.va before. The",
        "recorded joints stay in them.",
        "Registers: not measured yet",
    )
    body = [_remark(line) for line in remarks]
    for step in steps:
        body += [f"  PR[{register + step.number}]=JPOS    ", f"  PR[{register + step.number},1]=999    "]
    body += ["  UFRAME_NUM=0 ", f"  UTOOL_NUM={_tool(motion.tool)} "]
    positions: list[tuple[str, tuple[float, ...]]] = []
    for step in steps:
        body.append(_remark(f"Posture {step.number}, {step.target}"))
        for i, row in enumerate(step.via, start=1):
            positions.append((f"via {i} of posture {step.number}", row))
            body.append(f"J P[{len(positions)}] {percent}% {end}    ")
        positions.append((f"posture {step.number}", step.joints))
        body.append(f"J P[{len(positions)}] {percent}% FINE    ")
        body += [_remark("Jog: beam on the PSD's centre"), "  PAUSE "]
        body.append(f"  PR[{register + step.number}]=JPOS    ")
    lines = [
        f"/PROG  {name.upper()}",
        "/ATTR",
        "OWNER\t\t= MNEDITOR;",
        'COMMENT\t\t= "zerobeam plan";',
        f"LINE_COUNT\t= {len(body)};",
        "PROTECT\t\t= READ_WRITE;",
        "DEFAULT_GROUP\t= 1,*,*,*,*;",
        "/MN",
        *(f"{number:4}:{line};" for number, line in enumerate(body, start=1)),
        "/POS",
        *(_position(n, *named, motion) for n, named in enumerate(positions, start=1)),
        "/END",
    ]
    return "\n".join(lines) + "\n"


def _tool(tool: str | None) -> int:
    if tool is not None and not (tool.isdecimal() and 1 <= int(tool) <= 10):
        raise BadInput("--tool is not a tool frame number of FANUC", found=tool, allowed="1 to 10")
    return int(tool or 1)


def _remark(text: str) -> str:
    return f"  !{one_line(text).replace(';', ',')[:_COMMENT]} "


def _position(number: int, comment: str, row: tuple[float, ...], motion: ProgramMotion) -> str:
    values = [f"J{i}= {decimal(value, 3):>9} deg" for i, value in enumerate(row, start=1)]
    rows = [",\t".join(values[i : i + 3]) for i in range(0, len(values), 3)]
    text = ",\n\t".join(rows)
    return f'P[{number}:"{comment}"]{{\n   GP1:\n\tUF : 0, UT : {_tool(motion.tool)},\n\t{text}\n}};'
