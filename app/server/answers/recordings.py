"""Runs that have not reached their end: what is recorded, and how to go on with them."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from ....analysis.so_far import SoFar, so_far
from ....model.errors import BadInput
from ....model.files.plan import read_plan
from ....model.files.run import Run, recorded
from ....model.likelihood.problem import Problem
from ....words.findings import headline
from ....words.provenance import SIMULATED
from ....words.wording import person
from ..begun import BegunRuns
from ..end_point import EndPoint
from ..folder import Folder
from .notes import noted

_MOST = 20  # of its measurements after each of which u is said
_MOST_RUNS = 5  # that are offered to be resumed
_LARGEST = 2 * 10**6  # bytes of a run file that is read while somebody waits
_SAID = "plan sha256"  # in the provenance of a run that was carried out
_BY_HAND = "by hand"


def recording(folder: Folder, name: str) -> dict[str, Any]:
    """What a run file has, and how to go on with it.

    `recorded` (numbers of its measurements), `std` of each offset after them (deg; mm, null: not determined),
    `course` (the same after each of the last measurements), `headline`; `postures` of its plan (null where
    that is not in the folder), `ended` (null: not known), `torn` (its last line is cut off), and `resume`,
    the command that goes on with it, or null and `why_not`.
    """
    with noted() as notes:
        run, facts = _read(folder, name)
        states = _states(run)
        state = states[-1][1] if states else None
    return facts | {
        "std": {} if state is None else state.offset_std,
        "course": [{"recorded": count, "std": own.std} for count, own in states],
        "worst_std": None if state is None else state.worst,
        "headline": None if state is None else headline(state, person),
        "notes": notes,
    }


def unfinished(folder: Folder) -> list[dict[str, Any]]:
    """The runs that the app began and that have not reached their end, the newest first, `_MOST_RUNS` at the
    most: the same of each but what its measurements determine; `why_not` alone where it cannot be read."""
    found = []
    with noted():
        for name in BegunRuns(folder).unfinished()[:_MOST_RUNS]:
            try:
                found.append(_read(folder, name)[1])
            except BadInput as error:
                found.append({"file": name, "resume": None, "why_not": folder.without(str(error))})
    return found


def _read(folder: Folder, name: str) -> tuple[Run, dict[str, Any]]:
    """A run, and what is said of it without a fit."""
    path = folder.file(name)
    if path.stat().st_size > _LARGEST:
        remedy = "use zerobeam analyse"
        raise BadInput("the run is too long to be looked at here", remedy=remedy, file=Path(name))
    called, begun = folder.called(path), BegunRuns(folder)
    run, torn = recorded(path.read_bytes(), path)
    resume, plan, why_not = _resume(folder, called, run)
    postures = None if plan is None else len(read_plan(folder.inside(plan)).postures)
    done = [shot.shot for shot in run.shots]
    ended: bool | None = begun.ended(called)
    if not ended and postures is not None and set(range(postures)) <= set(done):
        ended = True
    elif not ended and begun.command(called) is None:
        ended = None
    return run, {
        "file": called,
        "origin": run.header.provenance.get("origin"),
        "plan": plan,
        "postures": postures,
        "recorded": done,
        "ended": ended,
        "torn": torn is not None,
        "resume": resume,
        "why_not": why_not,
    }


def _states(run: Run) -> list[tuple[int, SoFar]]:
    """How many measurements there were and what they determined, the last `_MOST` times, all at the end."""
    count = len(run.shots)
    if not count:
        return []
    problem, first = Problem.from_run(run), max(1, count - _MOST + 1)
    return [(k, so_far(problem.select(np.arange(k)))) for k in range(first, count + 1)]


def _resume(folder: Folder, name: str, run: Run) -> tuple[list[str] | None, str | None, str | None]:
    """The command that goes on with a run, its plan, or why there is none."""
    stated = run.header.provenance
    plan = _of_hash(folder, "plan", stated.get(_SAID))
    if plan is None:
        return None, None, "the plan that it was begun with is not in this folder, or has changed"
    command = BegunRuns(folder).command(name)
    if command is not None:
        return [*command[:-1], plan], plan, None
    words = ["run", "--resume", f"--out={name}"]
    origin = stated.get("origin")
    if origin == _BY_HAND:
        return [*words, "--rig=manual", plan], plan, None
    if origin != SIMULATED:
        return None, plan, "how its controller is reached is not in the run file: use zerobeam run --resume"
    cell = stated.get("cell sha256")
    if cell is not None:
        found = _of_hash(folder, "cell", cell)
        if found is None:
            return None, plan, "the cell file that it was begun with is not in this folder, or has changed"
        words.append(f"--cell={found}")
    if stated.get("camera") is False:
        words.append("--no-camera")
    return [*words, f"--seed={stated.get('seed', 0)}", plan], plan, None


def _of_hash(folder: Folder, kind: str, sha256: object) -> str | None:
    """The file of the folder of this kind and hash."""
    for file in folder.files():
        if file["kind"] == kind and file["bytes"] <= _LARGEST:
            content = folder.inside(file["path"]).read_bytes()
            if hashlib.sha256(content).hexdigest() == sha256:
                return str(file["path"])
    return None


END_POINTS = [
    EndPoint(
        "/api/run",
        "GET",
        "What a run file has so far, and how to go on with it.",
        recording,
        asked=("file",),
    ),
    EndPoint("/api/unfinished", "GET", "Runs begun here that have not reached their end.", unfinished),
]
