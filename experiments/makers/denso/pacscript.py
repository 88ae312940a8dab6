"""PacScript (Denso RC8, RC9): its positions and motions, and a plan as a program in it.

Facts, from the RC8 manual of Denso Wave (IDs 5210 and 5225, Move, Speed, DriveA), its RC5 manual (joint type
constants) and published programs: J is the joints, degrees, joint 1 first; P is X, Y, Z, RX, RY, RZ, mm and
degrees, of which RX, RY, RZ turn about fixed x, y, z, and a figure; J[n] and P[n], also Jn and Pn, belong to
all programs; @E waits until the encoders have arrived; PrintDbg writes to the message output window. Whether
TakeArm changes tool and frame is not published as far as is known here: behind it both are open.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from lark import Token, Tree

from ....model.errors import BadInput
from ....model.files.plan import Plan
from ..format_options import ProgramMotion
from ..line_language import LineLanguage, Statement
from ..maker import blanked, one_line
from ..plan_programs import LOG, LOG_PLAN, head_lines, listed, made_for, percents, short_hash, steps_of

_REMARK = r"'[^\n]*|(?i:\brem\b)[^\n]*"
_LIST = re.compile(r"(?P<kind>[A-Za-z]?)\s*\(\s*(?P<values>[^()\n]*?(?:,[^()\n]*?){5,})\s*\)")
_NAME = re.compile(r"[A-Za-z]\w{0,63}", re.ASCII)
_STATE = "I[90]"
_USAGE = (
    "Start this program again and again: each start records where the arm is, as a line of the message",
    "output window, and goes to the next posture. In between no program runs: jog the beam onto the centre.",
    "Copy the lines of the window into zb_plan.log, or write the joints into the lines zb_p0 = J(...).",
    f"confirm: no other program uses {_STATE}, and it is 0 before the first start. It is odd at a posture",
    "that is not recorded yet; one less goes there again.",
    "confirm: CurJnt is the joints in degrees, and Joint(1, ...) joint 1 of them.",
)


def _positions(text: str) -> list[tuple[int, int]]:
    """The spans of all that looks like joints or a pose, without the figure of one."""
    spans = []
    for match in _LIST.finditer(blanked(text, _REMARK)):
        values = match["values"]
        if match["kind"] in ("P", "p") and values.count(",") == 6:
            values = values[: values.rindex(",")].rstrip()
        spans.append((match.start("values"), match.start("values") + len(values)))
    return spans


def _read(text: str) -> Iterator[Statement]:
    """Each line; behind TakeArm the tool and the frame are those that the program leaves open."""
    changed = False
    for begin, end, tree in _LINES.statements(text):
        yield begin, end, tree
        if tree is None:
            continue
        changed |= tree.data in ("tool", "frame")
        if tree.data == "taken" and changed:
            for which in ("tool", "frame"):
                yield begin, begin, Tree(which, [Token("WORD", "", start_pos=begin)])


_LINES = LineLanguage(
    name="PacScript",
    grammar="denso/pacscript",
    remark=_REMARK,
    joint_decimals=4,
    positions=_positions,
)
PACSCRIPT = replace(_LINES, read=_read)


def pacscript_program(plan: Plan, motion: ProgramMotion, file: Path) -> str:
    """Text of the program. Each start writes the joints of the posture where the arm is to the message output
    window, and goes to the next one; a start that was stopped on the way goes there again."""
    note = made_for(plan, "denso", "a PacScript program", 6, "J")
    if not _NAME.fullmatch(file.stem):
        raise BadInput(
            "the file's name is that of the program, and PacScript does not allow this one",
            found=file.stem,
            allowed="a letter, then letters, digits and _: at most 64 (zb_plan.pcs)",
            remedy="choose another name for the file",
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
