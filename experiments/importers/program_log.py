"""Logs that a plan's program has written (zerobeam export plan): lines as of `typed.program_line`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...model.errors import BadInput
from ...model.files.limits import require_joint_count
from ...model.files.reading import read_text
from ...model.kinematics.pendant import Pendant
from ...model.kinematics.robot import J3
from .imported import Found, Imported, Job, Stated, matching
from .taught import without_unused
from .typed import PROGRAM_LINE, program_line

_PLAN = re.compile(r"zerobeam plan (?P<hash>[0-9a-f]{12})\b")


def is_program_log(files: Sequence[Path | str]) -> bool:
    """Whether the first of the files has lines of a plan's program."""
    paths = [path for file in files[:1] for path in matching(Path(file))[:1]]
    return any(PROGRAM_LINE.search(read_text(path)[0]) for path in paths)


def import_program_log(
    files: Sequence[Path | str],
    target_names: Sequence[str],
    stated: Stated,
    out: Path | str,
    *,
    source: str,
    j3: J3 | None = None,
) -> Imported:
    """Measurements from logs of a plan's program; of a posture that was recorded again the last counts.

    `source` says in the answer who wrote it, `j3` what it counts joint 3 from, if not as the
    robot file states. BadInput for the log of a rehearsal, or of another plan than
    `stated`.
    """
    job = Job.begin(files, stated)
    pendant = job.pendant(j3)
    found = [
        _found(path, target, job, pendant)
        for path, target in zip(job.paths, job.targets(target_names), strict=True)
    ]
    note = f"{source}: lines of a plan's program, in degrees, joint 1 first"
    return job.finish(found, out, [note, *([] if pendant.counting is None else [pendant.counting])])


def _found(path: Path, target: str, job: Job, pendant: Pendant) -> Found:
    text, _ = read_text(path)
    lines = text.split("\n")
    rows: dict[int, tuple[tuple[float, ...], int]] = {}
    again: list[int] = []
    notes: list[str] = []
    for line, content in enumerate(lines, start=1):
        _require_same_plan(content, job, path, line)
        if line == len(lines) and PROGRAM_LINE.search(content):
            # Without the end of the line its last number may be incomplete.
            notes.append(f"  line {line} has no end and is ignored")
            continue
        try:
            logged = program_line(content, job.robot.n)
        except BadInput as error:
            raise error.at(path, line) from None
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
        said = ", ".join(map(str, dict.fromkeys(again)))
        notes.append(f"  recorded more than once, the last one counts: posture {said}")
    return Found(
        path,
        "line",
        pendant.between_links(np.array([joints for joints, _ in rows.values()])),
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
