"""Joint values and poses as people type them, or paste them from a pendant, a program or a spreadsheet; and
the lines that a plan's program writes (zerobeam export plan).

    zerobeam posture 3 deg -69.348 -18.862 49.270 136.545 -39.529 -82.750

Anything may precede those on the line: the time that a controller prints. Lists of URScript have brackets and
commas, and whole millionths of a degree.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

import numpy as np

from ...analysis.pendant_check.poses import PendantPose, count_of
from ...model.errors import BadInput, located
from ...model.files.joint_values import require_joint_count
from ...model.files.plan import Plan
from ...model.kinematics.pendant import Pendant, pendant_of
from ...model.options import J3, PendantUnit, PoseAngles
from ...model.parsing.reading import read_other_text, shown
from .import_jobs import FileMeasurements, Imported, ImportJob, Keys, without_unused

_NUMBER = r"[-+]?(?:\d+(?:[.,]\d+)?|[.,]\d+)(?:[eE][-+]?\d+)?"
_LABELLED = re.compile(
    rf"(?<![A-Za-z0-9])(?:joint|axis|achse|rax|actual_q|j|a|q)[ _]?(\d{{1,2}})(?:\s*[:=]\s*|\s+)({_NUMBER})",
    re.IGNORECASE,
)
_YASKAWA = re.compile(rf"(?<![A-Za-z0-9])([SLURBT])\s*[:=]?\s*({_NUMBER})")
_CARTESIAN = re.compile(rf"(?<![A-Za-z0-9])[XYZ]\s*[:=]?\s*{_NUMBER}", re.IGNORECASE)
_INNERMOST = re.compile(r"[\[{(]([^\[\](){}]*)[\])}]")
_DECIMAL_COMMA = re.compile(r"[-+]?\d+(,\d+)?")
_MINUS = str.maketrans({"−": "-", "–": "-", "\u00a0": " ", "\u202f": " ", "°": " deg "})

PROGRAM_LINE = re.compile(
    r"zerobeam (?P<what>posture|rehearsal) (?P<number>\d{1,9}) (?P<unit>\w+)(?P<values>.*)"
)
# The beginning of such a line in quotes: the statement of a program that writes it.
_STATEMENT = re.compile(r"""["']zerobeam (?:plan|posture|rehearsal)\b""")
_PROGRAM_UNITS = {"deg": 1.0, "microdegrees": 1e-6}


@dataclass(frozen=True)
class TypedJoints:
    """Joint values as a text has them, the unit if the text states it, and the posture's number if it is the
    line of a plan's program."""

    values: tuple[float, ...]
    unit: PendantUnit | None
    number: int | None = None


def program_line(text: str, n: int) -> TypedJoints | None:
    """The joints in a line of a plan's program, degrees (mm), `n` or all that it has; None in any other line.

    BadInput for a line that cannot be read, or that a rehearsal wrote.
    """
    match = PROGRAM_LINE.search(text)
    if match is None:
        return None
    if match["what"] == "rehearsal":
        raise BadInput(
            "the log is of a rehearsal: the joints are commanded ones, not measured ones",
            found=shown(text.strip()[:60]),
            remedy="run the program on the robot",
        )
    scale = _PROGRAM_UNITS.get(match["unit"])
    try:
        values = [float(part) for part in re.split(r"[\s,\[\]]+", match["values"]) if part]
    except ValueError:
        values = []
    if scale is None or len(values) < n or not all(map(isfinite, values)):
        raise BadInput(
            "the joints of a posture cannot be read",
            found=shown(match[0][:120]),
            allowed=f"zerobeam posture NUMBER deg, and {n} numbers",
            remedy="remove the line, and record the posture again",
        )
    return TypedJoints(tuple(value * scale for value in values), "deg", int(match["number"]))


def labelled(text: str, names: Sequence[str] = ()) -> dict[int, float]:
    """Values with a joint's name before them, by its number from 1: `J1= 10 deg`, `A1 10`, `S: 10`. `names`
    are those of the pendant, joint 1 first."""
    text = text.translate(_MINUS)
    if names:
        called = "|".join(map(re.escape, names))
        pairs = re.findall(rf"(?<![\w.])({called})(?:\s*[:=]\s*|\s+)({_NUMBER})", text)
        if pairs:  # the first of each name
            return {names.index(name) + 1: _value(number) for name, number in reversed(pairs)}
    values = {int(match[1]): _value(match[2]) for match in _LABELLED.finditer(text)}
    if 0 in values:  # q0 to q5
        values = {number + 1: value for number, value in values.items()}
    if not values:
        letters = {match[1]: _value(match[2]) for match in _YASKAWA.finditer(text)}
        if {"S", "L", "U"} <= letters.keys():
            values = {"SLURBT".index(letter) + 1: value for letter, value in letters.items()}
    return values


def joints_so_far(text: str, names: Sequence[str] = ()) -> int:
    """How many joints a text has so far that may go on in the next line: with their names, the letters of a
    Yaskawa from S on, or a number alone for each; 0 where it is something else."""
    text = text.translate(_MINUS)
    by_name = labelled(text, names)
    if by_name:
        return len(by_name)
    letters = [match[1] for match in _YASKAWA.finditer(text)]
    rest = re.sub(r"[\s,;]|\b(?:deg|rad|mm|pulses?)\b", "", _YASKAWA.sub("", text))
    if letters and not rest:
        return len(letters) if letters == list("SLURBT"[: len(letters)]) else 0
    parts = text.split()
    return len(parts) if all(re.fullmatch(_NUMBER, part) for part in parts) else 0


def typed_joints(text: str, n: int, pendant: Pendant | None = None) -> TypedJoints:
    """The `n` joint values of a text, in the order of the joints: values without names are in the pendant's
    order.

    Read are numbers with blanks, tabs, commas or semicolons between them, lists in brackets (`[…]`, RAPID's
    `[[…], […]]`, KRL's `{A1 …, A2 …}`), values with the joints' names (`J1= 10.5 deg`), decimal commas where
    nothing else can be meant, and lines of a plan's program. BadInput for anything else, a Cartesian position
    included.
    """
    logged = program_line(text, n)
    if logged is not None and not any(logged.values[n:]):
        return TypedJoints(logged.values[:n], logged.unit, logged.number)
    plain = text.translate(_MINUS)
    unit = _unit(plain)
    by_name = labelled(text, [] if pendant is None else pendant.names)
    if by_name:
        missing = [number for number in range(1, n + 1) if number not in by_name]
        if missing:
            raise BadInput(
                "some joints have no value",
                found=f"{shown(text.strip())}: none for joint {', '.join(map(str, missing))}",
                allowed=f"values of joints 1 to {n}",
            )
        return TypedJoints(tuple(by_name[number] for number in range(1, n + 1)), unit)
    if _CARTESIAN.search(plain):
        raise BadInput(
            "this is a Cartesian position, and the configuration of the arm would be a guess",
            found=shown(text.strip()),
            allowed=f"{n} joint values",
            remedy="switch the pendant to joint values",
        )
    plain = re.sub(r"\b(?:deg|degrees|rad|radians|mm|pulses?)\b", " ", plain)
    order = list(range(n)) if pendant is None else pendant.order
    lists = [match[1] for match in _INNERMOST.finditer(plain)]
    values: tuple[float, ...] | None = None
    for part in (*lists, re.sub(r"[\[\](){}]", " ", plain)):
        values = plain_numbers(part, n)
        if values is not None and len(values) == n:
            return TypedJoints(tuple(values[order.index(i)] for i in range(n)), unit)
    count = "no numbers" if not values else f"{len(values)} numbers"
    raise BadInput(
        "these are not the joint values",
        found=f"{shown(text.strip()) or 'nothing'} ({count})",
        allowed=f"{n} numbers, " + ("joint 1 first" if order == sorted(order) else "in the pendant's order"),
    )


def _unit(text: str) -> PendantUnit | None:
    if re.search(r"\b(?:deg|degrees)\b", text):
        return "deg"
    if re.search(r"\bpulses?\b", text):
        return "pulse"
    return "rad" if re.search(r"\b(?:rad|radians)\b", text) else None


def plain_numbers(text: str, n: int) -> tuple[float, ...] | None:
    """All numbers of a text of numbers and delimiters; None where anything else is in it."""
    words = number_words(text, n)
    return None if words is None else tuple(map(_value, words))


def number_words(text: str, n: int) -> list[str] | None:
    """The same as they are written, decimal commas as points where `n` numbers can be meant no other way."""
    parts = [part for part in re.split(r"[;\s|]+", text) if part]
    if len(parts) == n and any("," in part for part in parts) and all(map(_DECIMAL_COMMA.fullmatch, parts)):
        return [part.replace(",", ".") for part in parts]
    parts = [part for part in re.split(r"[;,\s|]+", text) if part]
    return parts if all(re.fullmatch(_NUMBER, part) for part in parts) else None


def _value(text: str) -> float:
    value = float(text.replace(",", "."))
    if not isfinite(value):
        raise BadInput("a number is too large", found=shown(text), allowed="joint values in degrees or mm")
    return value


PLAN_LINE = re.compile(r"zerobeam plan (?P<hash>[0-9a-f]{12})\b")


def is_log_of_program(text: str) -> bool:
    """Whether a text has lines that a plan's program wrote; the program itself has them in its statements."""
    return PROGRAM_LINE.search(text) is not None and not writes_log(text)


def writes_log(text: str) -> bool:
    """Whether a text is a plan's program, which writes a log.

    >>> writes_log('tp_log("zerobeam posture 3 deg {:.6f}".format(zb_now[0]))')
    True
    >>> writes_log("zerobeam posture 3 deg -69.348")
    False
    """
    return _STATEMENT.search(text) is not None


def is_program_log(job: ImportJob) -> bool:
    """Whether the first of the files is the log of a plan's program."""
    return is_log_of_program(read_other_text(job.paths[0]))


def import_program_log(job: ImportJob, *, source: str, j3: J3 | None = None) -> Imported:
    """Measurements from logs of a plan's program; of a posture that was recorded again the last counts.

    `source` says in the answer who wrote it, `j3` what it counts joint 3 from, if not as the
    robot file states. BadInput for the log of a rehearsal, or of another plan than
    `stated`.
    """
    pendant = pendant_of(job.robot, j3)
    note = f"{source}: lines of a plan's program, in degrees, joint 1 first"
    return job.measured(lambda path, target: _logged(path, target, job, pendant), [note, pendant.counting])


def _logged(path: Path, target: str | None, job: ImportJob, pendant: Pendant) -> FileMeasurements:
    text = read_other_text(path)
    if writes_log(text):
        raise program_is_no_recording(path)
    lines = text.split("\n")
    rows: dict[int, tuple[tuple[float, ...], int]] = {}
    again: list[int] = []
    notes: list[str] = []
    for line, content in enumerate(lines, start=1):
        with located(path, line):
            require_same_plan(content, job)
            if line == len(lines) and PROGRAM_LINE.search(content):
                # Without the end of the line its last number may be incomplete.
                notes.append(f"  line {line} has no end and is ignored")
                continue
            logged = program_line(content, job.robot.n)
        if logged is None or logged.number is None:
            continue
        number, joints = logged.number, without_unused(logged.values, job.robot)
        require_joint_count(joints, job.robot, f"posture {number}", path, line)
        if rows.pop(number, None) is not None:
            again.append(number)
        rows[number] = joints, line
    if not rows:
        raise BadInput(
            "no measurements found: the file has no line of a plan's program",
            allowed="lines such as zerobeam posture 0 deg -69.348 …",
            remedy="import what the program recorded; for other recordings see zerobeam import --help",
            file=path,
        )
    if again:
        postures = ", ".join(map(str, dict.fromkeys(again)))
        notes.append(f"  recorded more than once, the last one counts: posture {postures}")
    joints, at = zip(*rows.values(), strict=True)
    keys: Keys = {"shot": list(rows), "target": [target] * len(rows)}
    return FileMeasurements(path, "line", pendant.between_links(np.array(joints)), keys, at, notes)


def require_same_plan(content: str, job: ImportJob) -> None:
    """BadInput where a line of a log or program says that it is of another plan than the job's."""
    plan_line = PLAN_LINE.search(content)
    if plan_line is not None and job.plan is not None and not job.plan.sha256.startswith(plan_line["hash"]):
        raise BadInput(
            "the log is of another plan, or of this one before it was changed",
            found=f"plan {plan_line['hash']}",
            allowed=f"plan {job.plan.sha256[:12]} ({job.plan.path.name})",
            remedy="import with the plan that the program was made of; use a new log for each program",
        )


def program_is_no_recording(path: Path) -> BadInput:
    """The error for a plan's program where what it recorded is needed."""
    return BadInput(
        "the file is a plan's program, not what the program recorded",
        found="statements that write lines of a log",
        allowed="the log that the program wrote",
        remedy="run the program on the robot, and import its log",
        file=path,
    )


def required_plan(job: ImportJob, path: Path) -> Plan:
    """The plan of which a file is the program; BadInput where the job has none."""
    if job.plan is None:
        raise BadInput(
            "the file is a plan's program, and its positions may still be the planned ones",
            found="no plan to compare them with",
            remedy="import with --plan, or name the measured positions with --points",
            file=path,
        )
    return job.plan


_LABEL = re.compile(r"(?<![\d.,])[A-Za-z_]+\d?\s*[:=]?|[\[\](){}°]")
_COARSEST_JOINT = 0.01  # deg, mm: a pendant shows two decimals; who types 20 has read 20.00
_HINT = {6: "X, Y, Z and three angles", 7: "X, Y, Z and q1, q2, q3, q4"}


def typed_poses(
    joints: Sequence[str], poses: Sequence[str], pendant: Pendant, units: PendantUnit, form: PoseAngles
) -> list[PendantPose]:
    """The poses of texts, each with the text of the joint values at which the pendant shows it.

    BadInput where there are not as many of both, where one cannot be read, or where two postures are the
    same.
    """
    if len(joints) != len(poses):
        raise BadInput(
            "each pose is of a posture",
            found=f"{len(joints)} times --joints, {len(poses)} times --pose",
            remedy="state --joints and --pose in pairs, in the same order",
        )
    counted = [_counted(pendant, text, units) for text in joints]
    if len(set(counted)) < len(counted):
        raise BadInput("two postures are the same", remedy="read the pose at another posture")
    numbers = [_words(text, count_of(form)) for text in poses]
    places, angles = [words[:3] for words in numbers], [words[3:] for words in numbers]
    joint_digit = _digit([number_words(_plain(text), pendant.robot.n) or [] for text in joints])
    if units == "deg":
        joint_digit = min(joint_digit, _COARSEST_JOINT) if joint_digit == 1 else joint_digit
    joint_digit /= min(abs(pendant.per_degree(units)).tolist())
    digits = joint_digit, _digit(places), _digit(angles)
    return [
        PendantPose(values, tuple(map(float, words)), *digits)
        for values, words in zip(counted, numbers, strict=True)
    ]


def _counted(pendant: Pendant, text: str, units: PendantUnit) -> tuple[float, ...]:
    values = typed_joints(text, pendant.robot.n, pendant).values
    return tuple((values / pendant.per_degree(units)).tolist())


def _words(text: str, count: int) -> list[str]:
    words = number_words(_plain(text), count)
    if words is None or len(words) != count or (count == 7 and not any(map(float, words[3:]))):
        raise BadInput(
            "this is not a pose as the pendant shows it",
            found=f"{shown(text.strip()) or 'nothing'} ({len(_plain(text).split())} numbers)",
            allowed=f"{count} numbers: {_HINT[count]}",
            remedy="state by --angles how the pendant shows orientations, if not as the maker's do",
        )
    return words


def _plain(text: str) -> str:
    """The text without labels and brackets."""
    return _LABEL.sub(" ", text.replace("\u2212", "-").replace("\u2013", "-"))


def _digit(texts: Sequence[Sequence[str]]) -> float:
    """One unit of the last decimal that any of the numbers has."""
    decimals = [len(word.partition(".")[2]) for words in texts for word in words if "e" not in word.lower()]
    return float(10.0 ** -max(decimals, default=0))
