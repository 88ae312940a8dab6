"""What a plan's program has written (zerobeam export plan): lines with a posture's number and its joints.

    zerobeam posture 3 deg -69.348 -18.862 49.270 136.545 -39.529 -82.750

Anything may precede it on the line: the time that a controller prints. Lists of URScript have brackets and
commas, and whole millionths of a degree.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...model.errors import BadInput
from ...model.files.limits import require_joint_count
from ...model.files.reading import read_text, shown
from ...model.robot import Robot
from .imported import Found, Imported, Job, Stated, matching
from .taught import without_unused

_LINE = re.compile(r"zerobeam (?P<what>posture|rehearsal) (?P<number>\d{1,9}) (?P<unit>\w+)(?P<values>.*)")
_PLAN = re.compile(r"zerobeam plan (?P<hash>[0-9a-f]{12})\b")
_UNITS = {"deg": 1.0, "microdegrees": 1e-6}


def is_program_log(files: Sequence[Path | str]) -> bool:
    """Whether the first of the files has lines of a plan's program."""
    return any(_LINE.search(read_text(path)[0]) for file in files[:1] for path in matching(Path(file))[:1])


def import_program_log(
    files: Sequence[Path | str],
    target_names: Sequence[str],
    stated: Stated,
    out: Path | str,
    *,
    source: str,
) -> Imported:
    """Measurements from logs of a plan's program; of a posture that was recorded again the last counts.

    `source` says in the answer who wrote it. BadInput for the log of a rehearsal, or of another plan than
    `stated`.
    """
    job = Job.begin(files, stated)
    found = [
        _found(path, target, job) for path, target in zip(job.paths, job.targets(target_names), strict=True)
    ]
    return job.finish(found, out, [f"{source}: lines of a plan's program, in degrees, joint 1 first"])


def _found(path: Path, target: str, job: Job) -> Found:
    text, _ = read_text(path)
    lines = text.split("\n")
    rows: dict[int, tuple[tuple[float, ...], int]] = {}
    again: list[int] = []
    notes: list[str] = []
    for line, content in enumerate(lines, start=1):
        _require_same_plan(content, job, path, line)
        match = _LINE.search(content)
        if match is None:
            continue
        if match["what"] == "rehearsal":
            raise BadInput(
                "the log is of a rehearsal: the joints are commanded ones, not measured ones",
                found=shown(content.strip()[:60]),
                remedy="run the program on the robot",
                file=path,
                line=line,
            )
        if line == len(lines):
            # Without the end of the line its last number may be incomplete.
            notes.append(f"  line {line} has no end and is ignored")
            continue
        joints = _joints(match, job.robot, path, line)
        number = int(match["number"])
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
        said = ", ".join(map(str, dict.fromkeys(again)))
        notes.append(f"  recorded more than once, the last one counts: posture {said}")
    return Found(
        path,
        "line",
        np.array([joints for joints, _ in rows.values()]),
        [target] * len(rows),
        lines=[line for _, line in rows.values()],
        numbers=list(rows),
        notes=notes,
    )


def _require_same_plan(content: str, job: Job, path: Path, line: int) -> None:
    said = _PLAN.search(content)
    if said is not None and job.plan is not None and not job.plan.sha256.startswith(said["hash"]):
        raise BadInput(
            "the log is of another plan, or of this one before it was changed",
            found=f"plan {said['hash']}",
            allowed=f"plan {job.plan.sha256[:12]} ({job.plan.path.name})",
            remedy="import with the plan that the program was made of; use a new log for each program",
            file=path,
            line=line,
        )


def _joints(match: re.Match[str], robot: Robot, path: Path, line: int) -> tuple[float, ...]:
    """Degrees (mm)."""
    scale = _UNITS.get(match["unit"])
    try:
        values = [float(part) for part in re.split(r"[\s,\[\]]+", match["values"]) if part]
    except ValueError:
        values = [math.nan]
    if scale is None or not all(map(math.isfinite, values)) or len(values) < robot.n:
        raise BadInput(
            "the joints of a posture cannot be read",
            found=shown(match[0][:120]),
            allowed=f"zerobeam posture NUMBER deg, and {robot.n} numbers",
            remedy="remove the line, and record the posture again",
            file=path,
            line=line,
        )
    joints = without_unused(tuple(value * scale for value in values), robot)
    require_joint_count(joints, robot, f"posture {match['number']}", path, line)
    return joints
