"""RAPID (ABB): the offsets as a module of functions, and a plan as a module that visits its postures.

`Stop` with NoRegain lets a person jog the arm in manual mode and start again without the arm returning first.
The time of each motion is computed in the controller from where the arm is: `speeddata` bounds the TCP, not
the joints.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from ....model.errors import BadInput
from ....model.files.plan import Plan
from ..calibration import RobotCalibration
from ..format_options import ProgramMotion
from ..maker import one_line, require_vendor
from ..plan_programs import (
    LOG,
    LOG_PLAN,
    PlanStep,
    decimal,
    head_lines,
    listed,
    made_for,
    short_hash,
    steps_of,
)

AXES = 6  # rax_1 to rax_6 of a robjoint
MODULE = "zb_offsets"


def rapid_text(calibration: RobotCalibration) -> str:
    """Text of the module: ASCII, degrees. RAPID's num holds some seven digits, so six decimals are written.

    BadInput for a robot that is not ABB's, or that a RAPID robjoint (six axes in degrees) cannot hold.
    """
    require_vendor(calibration.corrected, "abb", "a RAPID module")
    offsets = calibration.offsets
    sliding = [offset.name for offset in offsets if offset.kind == "prismatic"]
    if len(offsets) > AXES or sliding:
        raise BadInput(
            "a RAPID jointtarget has no place for this robot's joints",
            found=f"{len(offsets)} joints" + (f", prismatic: {', '.join(sliding)}" if sliding else ""),
            allowed=f"at most {AXES} revolute joints",
            remedy="export json or csv, and apply the offsets by hand",
        )
    numbers = [f"{offset.applied:.6f}" for offset in offsets] + ["0"] * (AXES - len(offsets))
    lines = [
        f"MODULE {MODULE}",
        *(f"  ! {line}" for line in calibration.head),
        "  !",
        "  ! Do not use this module once the offsets are in the controller (calibration offsets):",
        "  ! they would be applied twice. Targets that were taught on this very arm hold them already.",
        "",
        "  ! Offsets of axes 1 to 6, degrees.",
        f"  CONST num zb_offset_deg{{{AXES}}}:=[{','.join(numbers)}];",
        "",
        "  ! The joints to command so that the true joints are wanted (degrees).",
        "  FUNC jointtarget zb_command(jointtarget wanted)",
        "    VAR jointtarget result;",
        "    result:=wanted;",
        *_axes("wanted", "-"),
        "    RETURN result;",
        "  ENDFUNC",
        "",
        "  ! The true joints when the controller reads recorded (degrees).",
        "  FUNC jointtarget zb_true(jointtarget recorded)",
        "    VAR jointtarget result;",
        "    result:=recorded;",
        *_axes("recorded", "+"),
        "    RETURN result;",
        "  ENDFUNC",
        "ENDMODULE",
    ]
    return "\n".join(lines) + "\n"


def _axes(joints: str, sign: str) -> list[str]:
    return [
        f"    result.robax.rax_{i}:={joints}.robax.rax_{i}{sign}zb_offset_deg{{{i}}};"
        for i in range(1, AXES + 1)
    ]


_EXTERNAL = ",".join(["9E9"] * 6)


def rapid_program(plan: Plan, motion: ProgramMotion) -> str:
    """Text of the module `zb_plan`."""
    note = made_for(plan, "abb", "a RAPID program", AXES, "a RAPID jointtarget")
    tool = motion.tool or "tool0"
    if not re.fullmatch(r"[A-Za-z]\w{0,31}", tool):
        raise BadInput("--tool is not a name of RAPID", found=tool, allowed="the name of a tooldata: tool0")
    steps = steps_of(plan, motion)
    lines = [
        "MODULE zb_plan",
        *(f"  ! {line}" for line in head_lines(plan, motion, note)),
        "  ! Manual mode: program pointer to the routine zb_run, then Start. At each posture the program",
        "  ! stops: jog the wrist until the beam is on the centre of the PSD, then Start again. The joints",
        "  ! are written to HOME:/zb_plan.log, which zerobeam import rapid reads.",
        "",
        f"  CONST num zb_deg_s:={decimal(motion.speed)};",
        f"  CONST zonedata zb_zone:={_zone(motion.zone)};",
        *(line for step in steps for line in _targets(step)),
        "",
        "  PROC zb_run()",
        "    VAR num first;",
        '    zb_write "";',
        f'    zb_write "{LOG_PLAN} {short_hash(plan)}";',
        f'    TPReadNum first,"Begin with posture (0 to {len(steps) - 1}):";',
        *(f"    {line}" for step in steps for line in _visit(step)),
        '    TPWrite "All postures are recorded.";',
        "  ENDPROC",
        *_ROUTINES.format(tool=tool, log=LOG).splitlines(),
        "ENDMODULE",
    ]
    return "\n".join(lines) + "\n"


def _zone(mm: float) -> str:
    """As z10 and its like are defined: 1.5 times as wide for the orientation and the external axes."""
    if mm == 0:
        return "[TRUE,0,0,0,0,0,0]"
    wide, turn = decimal(1.5 * mm), decimal(0.15 * mm)
    return f"[FALSE,{decimal(mm)},{wide},{wide},{turn},{wide},{turn}]"


def _targets(step: PlanStep) -> Iterator[str]:
    for name, row in step.named.items():
        values = listed([*row, *[0.0] * (AXES - len(row))])
        yield f"  CONST jointtarget {name}:=[[{values}],[{_EXTERNAL}]];"


def _visit(step: PlanStep) -> Iterator[str]:
    names = list(step.named)
    yield f"IF first<={step.number} THEN"
    for before, there in zip(["CJointT()", *names], names, strict=False):
        yield f"  zb_go {before},{there},{'zb_zone' if there != names[-1] else 'fine'};"
    target = one_line(step.target).replace("\\", "/").replace('"', "'")[:24]
    yield f'  zb_centre {step.number},"{target}";'
    yield "ENDIF"


_ROUTINES = """
  ! From where the arm is (or will be) to a posture, no joint faster than zb_deg_s.
  PROC zb_go(jointtarget start,jointtarget goal,zonedata zone)
    VAR num far:=0;
    far:=zb_larger(far,start.robax.rax_1-goal.robax.rax_1);
    far:=zb_larger(far,start.robax.rax_2-goal.robax.rax_2);
    far:=zb_larger(far,start.robax.rax_3-goal.robax.rax_3);
    far:=zb_larger(far,start.robax.rax_4-goal.robax.rax_4);
    far:=zb_larger(far,start.robax.rax_5-goal.robax.rax_5);
    far:=zb_larger(far,start.robax.rax_6-goal.robax.rax_6);
    MoveAbsJ goal,v50\\T:=far/zb_deg_s+0.5,zone,{tool};
  ENDPROC

  FUNC num zb_larger(num one,num other)
    IF Abs(other)>one RETURN Abs(other);
    RETURN one;
  ENDFUNC

  PROC zb_centre(num posture,string target)
    VAR jointtarget now;
    TPWrite "Posture "+NumToStr(posture,0)+", target "+target;
    TPWrite "Jog the wrist: beam on the centre of the PSD.";
    TPWrite "Start records the joints and goes on.";
    Stop\\NoRegain;
    now:=CJointT();
    zb_write "{log} "+NumToStr(posture,0)+" deg";
    zb_write zb_text(now.robax.rax_1)+zb_text(now.robax.rax_2)+zb_text(now.robax.rax_3)
      +zb_text(now.robax.rax_4)+zb_text(now.robax.rax_5)+zb_text(now.robax.rax_6);
    zb_write "";
  ENDPROC

  FUNC string zb_text(num value)
    RETURN " "+NumToStr(value,4);
  ENDFUNC

  ! Text at the end of the log; an empty one ends the line. Closed each time: nothing is lost.
  PROC zb_write(string text)
    VAR iodev log;
    Open "HOME:"\\File:="zb_plan.log",log\\Append;
    IF text="" THEN
      Write log,"";
    ELSE
      Write log,text\\NoNewLine;
    ENDIF
    Close log;
  ENDPROC"""
