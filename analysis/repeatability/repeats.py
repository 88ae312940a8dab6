"""The runs that `compare` compares: read from their files, refused where they are no repeats."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from datetime import datetime
from itertools import pairwise
from pathlib import Path

import numpy as np

from ...model.arrays import Matrix, Progress
from ...model.errors import BadInput
from ...model.files.header import Header
from ...model.files.reading import LARGEST_RECORDING, read_bytes
from ...model.files.run import Run, read_run
from ...model.kinematics.robot import Robot
from ...model.likelihood.problem import Problem
from ..estimation.threads import one_blas_thread
from .offset_table import read_table
from .repeat import Kind, Repeat
from .result_files import read_result
from .run_files import fitted, problem_of, unfitted

_SAME = 1e-9  # relative: two descriptions of one arm


def read_repeats(given: Sequence[Path | Run], seed: int, progress: Progress) -> tuple[Kind, list[Repeat]]:
    """The runs in files: run files, results of `analyse --json`, or one table (see `docs/compare.md`); or the
    runs themselves.

    Raises BadInput for fewer than two, for one that is given twice, and for runs that cannot be compared.
    """
    if any(isinstance(one, Path) and one.suffix == ".csv" for one in given):
        if len(given) > 1:
            raise BadInput(
                "a table is compared alone: its runs have no uncertainties",
                found=f"{len(given)} files",
                allowed="one table (.csv), or run files and results",
            )
        return "table", list(read_table(_paths(given)[0]))
    if len(given) < 2:
        raise BadInput(
            "one run cannot be compared",
            found=str(_paths(given)[0]) if given else "no file",
            allowed="two runs or more, or a table of published offsets (.csv)",
        )
    names = _names(given)
    _refuse_twice([(name, _sha256(one)) for name, one in zip(names, given, strict=True)])
    # All that could forbid a comparison comes before the first fit.
    found: list[Repeat] = []
    problems: dict[int, tuple[Problem, Header]] = {}
    arms: list[tuple[str, Robot]] = []
    for k, (one, name) in enumerate(zip(given, names, strict=True)):
        if isinstance(one, Path) and one.suffix == ".json":
            found.append(read_result(one, name))
            continue
        run = read_run(one) if isinstance(one, Path) else one
        problem = problem_of(run)
        problems[k] = problem, run.header
        found.append(unfitted(run, problem, name))
        arms.append((name, run.robot))
    _refuse_twice([(repeat.name, repeat.sha256 or "") for repeat in found])
    for (first, robot), (other, another) in pairwise(arms):
        _require_same_arm(first, robot, other, another)
    for one_repeat, other_repeat in pairwise(found):
        _require_comparable(one_repeat, other_repeat)
    with one_blas_thread():
        for k, (problem, header) in problems.items():
            progress(f"fit, run {k + 1}/{len(given)}", k / len(given))
            found[k] = fitted(found[k], problem, header, seed)
    return "runs" if len(problems) == len(given) else "results", found


def _paths(given: Sequence[Path | Run]) -> list[Path]:
    return [one if isinstance(one, Path) else one.path for one in given]


def _names(given: Sequence[Path | Run]) -> list[str]:
    """What the runs are called: their files' names, with the folders where two are the same, and a number
    where that is not enough."""
    paths = _paths(given)
    names = [path.name for path in paths]
    if len(set(names)) < len(names):
        names = [str(path) for path in paths]
    if len(set(names)) < len(names):
        names = [f"{name} ({k})" for k, name in enumerate(names, start=1)]
    return names


def _sha256(one: Path | Run) -> str:
    if isinstance(one, Run):
        return one.sha256
    return hashlib.sha256(read_bytes(one, LARGEST_RECORDING)).hexdigest()


def _refuse_twice(named: Sequence[tuple[str, str]]) -> None:
    first: dict[str, str] = {}
    for name, sha256 in named:
        if sha256 in first:
            raise BadInput(
                "the same run is given twice: it would agree with itself",
                found=f"{first[sha256]} and {name} (SHA-256 {sha256[:12]}…)",
                allowed="each run once",
                remedy="name repeated measurements, not copies of one",
            )
        first[sha256] = name


def _require_same_arm(one: str, robot: Robot, other: str, another: Robot) -> None:
    def numbers(arm: Robot) -> Matrix:
        parts = [np.append(joint.fixed.ravel(), joint.axis) for joint in arm.joints]
        return np.append(np.ravel(parts), arm.flange.ravel())

    kinds = [[joint.kind for joint in arm.joints] for arm in (robot, another)]
    if (
        robot.name != another.name
        or kinds[0] != kinds[1]
        or not np.allclose(numbers(robot), numbers(another), rtol=_SAME, atol=_SAME)
    ):
        what = "names" if robot.name != another.name else "geometry"
        raise BadInput(
            "the runs are of different robots",
            found=f"{robot.name} in {one}, {another.name} in {other}: their {what} differ",
            allowed="runs of one robot",
            remedy="compare the runs of each robot on their own",
        )


def _require_comparable(one: Repeat, other: Repeat) -> None:
    if not one.names:
        raise BadInput(
            "there is no offset to compare: every one is held",
            found=f"held in {one.name}: {', '.join(one.held) or 'no offsets at all'}",
            remedy="free some in `held`",
        )

    def refuse(what: str, mine: object, yours: object, allowed: str, remedy: str) -> None:
        found = f"{mine} in {one.name}, {yours} in {other.name}"
        raise BadInput(what, found=found, allowed=allowed, remedy=remedy)

    if one.robot != other.robot:
        remedy = "compare the runs of each robot on their own"
        refuse("the runs are of different robots", one.robot, other.robot, "runs of one robot", remedy)
    if (one.held, one.names) != (other.held, other.names):
        refuse(
            "the runs do not hold the same offsets",
            ", ".join(one.held) or "none held",
            ", ".join(other.held) or "none held",
            "the same offsets free and the same held in all runs",
            "state the same `held`, and a tool that is calibrated in all runs or in none",
        )
    if (one.noise_dof is None) != (other.noise_dof is None):
        words = ["known" if each.noise_dof is None else "estimated" for each in (one, other)]
        refuse(
            "the noise is known in one run and estimated in another",
            words[0],
            words[1],
            "the same noise.scale in all",
            "state the same `noise.scale` in all headers",
        )


def times(repeats: Sequence[Repeat]) -> list[datetime] | None:
    """When the runs were made, if all of them say so (ISO 8601) and not all at once; else None."""
    try:
        found = [datetime.fromisoformat(repeat.when or "") for repeat in repeats]
        return found if max(found) > min(found) else None
    except (ValueError, TypeError):  # no date, or one with a time zone beside one without
        return None
