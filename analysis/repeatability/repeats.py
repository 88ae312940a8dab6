"""The runs that `compare` compares: read from their files, refused where they are no repeats."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from datetime import datetime
from itertools import pairwise
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from ...model.errors import BadInput
from ...model.files.reading import read_bytes
from ...model.files.run import read_run
from ...model.problem import Problem
from ...model.robot import Matrix, Robot
from .offset_table import read_table
from .repeat import Kind, Repeat
from .result_files import read_result
from .run_files import fitted, problem_of, unfitted

Progress = Callable[[str, float], None]

_SAME = 1e-9  # relative: two descriptions of one arm


def read_repeats(paths: Sequence[Path], seed: int, progress: Progress) -> tuple[Kind, list[Repeat]]:
    """The runs in `paths`: run files, results of `analyse --json`, or one table (see `docs/compare.md`).

    Raises BadInput for fewer than two, for one that is given twice, and for runs that cannot be compared.
    """
    if any(path.suffix == ".csv" for path in paths):
        if len(paths) > 1:
            raise BadInput(
                "a table is compared alone: its runs have no uncertainties",
                found=f"{len(paths)} files",
                allowed="one table (.csv), or run files and results",
            )
        return "table", list(read_table(paths[0]))
    if len(paths) < 2:
        raise BadInput(
            "one run cannot be compared",
            found=str(paths[0]) if paths else "no file",
            allowed="two runs or more, or a table of published offsets (.csv)",
        )
    _refuse_twice([(str(path), _sha256(path)) for path in paths])
    # All that could forbid a comparison comes before the first fit.
    found: list[Repeat] = []
    problems: dict[int, Problem] = {}
    arms: list[tuple[Path, Robot]] = []
    for k, (path, name) in enumerate(zip(paths, _names(paths), strict=True)):
        if path.suffix == ".json":
            found.append(read_result(path, name))
            continue
        run = read_run(path)
        problems[k] = problem_of(run)
        found.append(unfitted(run, problems[k], name))
        arms.append((path, run.robot))
    _refuse_twice([(repeat.name, repeat.sha256 or "") for repeat in found])
    for (one, robot), (other, another) in pairwise(arms):
        _require_same_arm(one, robot, other, another)
    for one_repeat, other_repeat in pairwise(found):
        _require_comparable(one_repeat, other_repeat)
    with threadpool_limits(limits=1, user_api="blas"):
        for k, problem in problems.items():
            progress("fit", k / len(paths))
            found[k] = fitted(found[k], problem, seed)
    return "runs" if len(problems) == len(paths) else "results", found


def _names(paths: Sequence[Path]) -> list[str]:
    """What the runs are called: their files' names, with the folders where two are the same."""
    short = [path.name for path in paths]
    return short if len(set(short)) == len(short) else [str(path) for path in paths]


def _sha256(path: Path) -> str:
    return hashlib.sha256(read_bytes(path)).hexdigest()


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


def _require_same_arm(one: Path, robot: Robot, other: Path, another: Robot) -> None:
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
