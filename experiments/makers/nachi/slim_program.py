"""SLIM (Nachi AX, FD): a plan as a program of joint positions, MOVEX … M1J.

Facts, as published programs and post processors agree on them (RoboDK, Cenit): M1J is followed by the joints
of mechanism 1, degrees, joint 1 first; P moves by joints and L in a straight line; H is the tool. That R is a
percentage of the speed, and that STOP stops, is to be confirmed at the controller.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from ....model.errors import BadInput
from ....model.files.plan import Plan
from ....model.parsing.reading import line_numbers
from ..format_options import ProgramMotion
from ..import_jobs import TaughtPoint
from ..maker import one_line
from ..plan_programs import decimal, head_lines, made_for, percents, steps_of
from ..taught_positions import named_by_remarks

_WIDTH = 31  # letters of a remark
_USAGE = (
    "Copy this file as UNIT.NNN (MZ07-01-A.001), and convert it to a program of the controller.",
    "At each stop: jog the beam onto the centre, and modify the position of the MOVEX above.",
    "At the end convert the program to text again, and import it.",
    "confirm: R is a percentage of the top speed. First run: step by step, at check speed.",
    "confirm: STOP stops, and the next start does not return to the position first.",
)
_LABELLED = re.compile(
    r"""^[ \t]*(?:REM[ \t]*"|')(zb_[pv][\d_]+)\b[^\n]*\n[ \t]*MOVEX\b""", re.MULTILINE | re.IGNORECASE
)


def slim_program(plan: Plan, motion: ProgramMotion) -> str:
    """Text of the program. At each posture it stops, and the person modifies the position there; a remark
    above each motion names it."""
    note = made_for(plan, "nachi", "a SLIM program", 6, "M1J")
    tool = "1" if motion.tool is None else motion.tool.strip()
    if not re.fullmatch(r"\d{1,2}", tool):
        raise BadInput("--tool is the number of a tool", found=tool, allowed="1 to 32")
    steps, percent = steps_of(plan, motion), min(percents(plan.robot, motion.speed))
    lines = [f"' {line}" for line in (*head_lines(plan, motion, note), *_USAGE)]
    for step in steps:
        for name, row in step.named.items():
            target = one_line(step.target).replace('"', "") if name.startswith("zb_p") else "via"
            lines.append(f'REM "{f"{name} {target}"[:_WIDTH]}"')
            joints = ",".join(decimal(round(value, 5) + 0.0, 5) for value in row)
            lines.append(f"MOVEX A=1,AC=0,SM=0,M1J,P,({joints}),R={percent:.1f},H={tool},MS")
        lines.append("STOP")
    return "\r\n".join([*lines, "END", ""])


def named_positions(text: str, points: Sequence[TaughtPoint]) -> list[TaughtPoint]:
    """The positions of a program, those of a plan's program by the names in its remarks."""
    if not re.search(r"^[ \t]*END\s*\Z", text, re.MULTILINE | re.IGNORECASE):
        raise BadInput("the program has no end", allowed="END in its last line", remedy="save it again")
    line_of = line_numbers(text)
    labels = [(match[1].lower(), f"line {line_of(match.end())}") for match in _LABELLED.finditer(text)]
    if not labels and "zerobeam plan" not in text:
        return list(points)
    return named_by_remarks(points, labels, [point.name for point in points], "slim")
