"""FANUC: the positions of a TP program that was saved as text (.ls), or position registers (posreg.va)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from ....model.errors import BadInput, located
from ....model.kinematics.robot import J3
from ....model.parsing.reading import line_numbers
from ..import_jobs import Imported, ImportJob, TaughtPoint, import_points
from ..joint_text import PLAN_LINE, required_plan

# FANUC: a listing ends with /POS and blocks like P[3:"comment"]{ GP1: UF : 0, UT : 1, J1= 1.000 deg, … };
_POSITION = re.compile(
    r"^[ \t]*P\[\s*(?P<number>\d+)[^\]]*\]\s*\{(?P<block>.*?)\}\s*;", re.MULTILINE | re.DOTALL
)
_POSITION_START = re.compile(r"^[ \t]*P\[\s*(\d+)", re.MULTILINE)
GROUP_1 = re.compile(r"GP1\s*:(?P<values>.*?)(?=GP\d+\s*:|\Z)", re.DOTALL)
JOINT = re.compile(r"\bJ(?P<number>\d)\s*=\s*(?P<value>[-+]?(?:\d+\.?\d*|\.\d+))\s*(?P<unit>deg|mm)\b")
_ANY_JOINT = re.compile(r"\bJ\d\s*=")

# A register: [1,3] = 'comment'   Group: 1, then J1 = 1.000 deg … or X: …; or Uninitialized.
REGISTERS = "$POSREG"
_REGISTER = re.compile(r"^[ \t]*\[[ \t]*1[ \t]*,[ \t]*(?P<number>\d{1,9})[ \t]*\][ \t]*=", re.MULTILINE)
_OTHER_GROUP = re.compile(r"^[ \t]*(?:\[[ \t]*[2-9]\d*[ \t]*,|\[\*)", re.MULTILINE)
_COMMENT = re.compile(r"'[^'\n]*'")
NOT_MEASURED = 999.0  # deg, joint 1: what the program of a plan writes before it has measured


def import_fanuc(
    job: ImportJob,
    *,
    j3: J3 | None = None,
    points: Sequence[str] | None = None,
    register: int = 1,
) -> Imported:
    """Measurements at the P[n] of FANUC .ls files (group 1), or at the PR[n] of a posreg.va; `points` are
    the numbers of some, as text.

    Where the plan is stated its postures are in the registers from `register` on, where its program left
    them. `j3` says what joint 3 is counted from, where it is not as the robot file states. Both files give
    degrees to three decimals.
    """
    planned = None if job.plan is None else len(job.plan.postures)

    def parse(text: str, path: Path) -> list[TaughtPoint]:
        if REGISTERS not in text:
            if points is None and PLAN_LINE.search(text):
                required_plan(job, path)
            return fanuc_positions(text, path)
        return fanuc_registers(text, path, register, planned, points is None)

    return import_points(
        job,
        parse,
        names=points,
        j3=j3,
        vendor="fanuc",
        note="FANUC positions of group 1, angles in degrees, joint 1 first",
    )


def fanuc_positions(text: str, path: Path) -> list[TaughtPoint]:
    """All P[n] of a listing, in its order."""
    points, line_of = [], line_numbers(text)
    with located(path):
        for match in _position_blocks(text):
            line = line_of(match.start("number"))
            points.append(
                TaughtPoint(match["number"], _fanuc_joints(match["block"], match["number"], line), line)
            )
    return points


def _position_blocks(text: str) -> list[re.Match[str]]:
    """The `number` and `block` of each P[n] of a listing; BadInput where it is no listing, or not whole."""
    begin = re.search(r"^/POS\b", text, re.MULTILINE)
    if begin is None:
        raise BadInput(
            "the file is not a TP program with positions",
            found="no line /POS",
            allowed="a text listing (.ls)",
            remedy="save the program as ASCII, not as .tp",
        )
    if re.compile(r"^/END\b", re.MULTILINE).search(text, begin.end()) is None:
        raise BadInput("the listing is incomplete: its last line, /END, is missing")
    blocks = list(_POSITION.finditer(text, begin.end()))
    numbers = _POSITION_START.findall(text, begin.end())
    if numbers != [match["number"] for match in blocks]:
        raise BadInput(
            "a position of the listing is incomplete",
            found=f"{len(numbers)} begin with P[…], {len(blocks)} end with }};",
            remedy="save the program as ASCII again",
        )
    return blocks


def _fanuc_joints(block: str, number: str, line: int, what: str = "P") -> tuple[float, ...] | None:
    group = GROUP_1.search(block)
    if group is None:
        return None
    values = JOINT.findall(group["values"])
    count = len(_ANY_JOINT.findall(group["values"]))
    if not count:
        return None
    # A position that was never taught is printed as J1= ********; a slide shows mm, which is no joint here.
    orderly = [int(joint) for joint, _, _ in values] == list(range(1, count + 1))
    if not orderly or any(unit != "deg" for _, _, unit in values):
        raise BadInput(
            f"the joints of {what}[{number}] cannot be read",
            found=" ".join(group["values"].split()),
            allowed="J1=… deg, J2=… deg, …, all taught",
            line=line,
        )
    return tuple(float(value) for _, value, _ in values)


def fanuc_registers(
    text: str, path: Path, first: int, planned: int | None, all_of_them: bool
) -> list[TaughtPoint]:
    """The position registers of group 1 in joint representation, in their order.

    Those that a plan's program has not measured are left out; with `planned` (the number of postures) so are
    those before `first` and behind the last posture, and each has its posture's number. Without it and with
    `all_of_them` registers without joints are left out too.
    """
    heads = list(_REGISTER.finditer(text))
    points, line_of = [], line_numbers(text)
    for head, following in zip(heads, [*heads[1:], None], strict=True):
        block = text[head.end() : len(text) if following is None else following.start()]
        other = _OTHER_GROUP.search(block)
        block = _COMMENT.sub("", block if other is None else block[: other.start()])
        register, line = int(head["number"]), line_of(head.start("number"))
        if planned is not None and not first <= register < first + planned:
            continue
        with located(path):
            joints = _fanuc_joints(f"GP1:{block}", str(register), line, "PR")
        if joints is None and all_of_them:
            continue
        if joints is not None and joints[0] == NOT_MEASURED:
            continue
        number = None if planned is None else register - first
        points.append(TaughtPoint(str(register), joints, line, number))
    return points
