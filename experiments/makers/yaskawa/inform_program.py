"""INFORM (Yaskawa): a plan as a job.

Facts, from Yaskawa's "Job Data Format" (instructions of NX100 and DX100, Easy Offline Teaching System): C are
the positions of a job, P position variables; below ///PULSE they are pulses of S, L, U, R, B, T, below
///RECTAN X, Y, Z, Rx, Ry, Rz in mm and degrees about fixed axes, with the tool of ///TOOL, in the frame of
///POSTYPE and ///USER; the first three of ///RCONF are flip, upper arm and front, the others whether R, T and
S are beyond half a turn. Which of them the controller regards is a parameter (S2C430): here they must agree
with the joints before.
"""

from __future__ import annotations

import re
from pathlib import Path
from textwrap import wrap

import numpy as np

from ....model.errors import BadInput
from ....model.files.plan import Plan
from ....model.kinematics.pendant import Pendant
from ..format_options import ProgramMotion
from ..import_jobs import TaughtPoint
from ..maker import one_line
from ..plan_programs import head_lines, made_for, percents, require_name, steps_of
from ..taught_positions import named_by_remarks

_USAGE = (
    "At each pause: jog the beam onto the centre, put the cursor on the MOVJ above, MODIFY, ENTER.",
    "At the end save the job, and import it.",
)
_LABELLED = re.compile(
    r"^[ \t]*'(zb_(?:p\d+|v\d+_\d+))\b[^\n]*\n[ \t]*MOVJ (C\d+)", re.MULTILINE | re.IGNORECASE
)


def inform_program(plan: Plan, motion: ProgramMotion, file: Path) -> str:
    """Text of the job that has the name of `file`. At each posture it pauses, and the person modifies the
    position there; a remark above each motion names it, since jobs number positions anew. The date is fixed:
    the same plan is the same job."""
    note = made_for(plan, "yaskawa", "an INFORM job", 6, "a job's position")
    require_name(
        file,
        r"[A-Za-z][\w-]{0,7}",
        "job",
        "INFORM",
        "a letter, then letters, digits, _ and -: at most 8 (ZB_PLAN.JBI)",
    )
    tool = "0" if motion.tool is None else motion.tool.strip()
    if not re.fullmatch(r"\d{1,2}", tool):
        raise BadInput("--tool is the number of a tool file", found=tool, allowed="0 to 63")
    per_degree = Pendant(plan.robot).per_degree("pulse")
    steps, percent = steps_of(plan, motion), min(percents(plan.robot, motion.speed))
    named = [item for step in steps for item in step.named.items()]
    pulses = [np.round(np.array(row) * per_degree).astype(int).tolist() for _, row in named]
    lines = [
        "/JOB",
        f"//NAME {file.stem.upper()}",
        "//POS",
        f"///NPOS {len(named)},0,0,0,0,0",
        f"///TOOL {tool}",
        "///POSTYPE PULSE",
        "///PULSE",
        *(f"C{number:05d}={','.join(map(str, row))}" for number, row in enumerate(pulses)),
        *("//INST", "///DATE 2026/01/01 00:00", "///ATTR SC,RW", "///GROUP1 RB1", "NOP"),
    ]
    for line in [*head_lines(plan, motion, note), *_USAGE]:
        lines += [f"'{part}" for part in wrap(line, 31)]
    targets = {f"zb_p{step.number}": step.target for step in steps}
    for number, (name, _) in enumerate(named):
        lines.append(f"'{name} {one_line(targets.get(name, 'via'))}"[:32])
        lines.append(f"MOVJ C{number:05d} VJ={percent:.2f} PL=0")
        if name in targets:
            lines += [f'MSG "Posture {name[4:]}: jog, MODIFY, ENTER"', "PAUSE"]
    return "\r\n".join([*lines, "END", ""])


def named_positions(text: str, points: list[TaughtPoint]) -> list[TaughtPoint]:
    """The positions of a job, those of a plan's program by the names in its remarks."""
    labelled = [match.groups() for match in _LABELLED.finditer(text)]
    if not labelled and "zerobeam plan" not in text:
        return points
    labels = [(name.lower(), position.upper()) for name, position in labelled]
    points = [point._replace(name=point.name.upper()) for point in points]
    return named_by_remarks(points, labels, sorted({point.name for point in points}), "inform")
