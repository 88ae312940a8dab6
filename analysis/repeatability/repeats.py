"""What `compare` compares: each run's offsets from its shots alone, read from runs, results or a table.

A prior pulls every estimate of a poorly told offset to the same place, and so makes runs agree that do not.
Here it is taken out again. Units are those that people read: degrees, millimetres.
"""

from __future__ import annotations

import csv
import hashlib
import io
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from threadpoolctl import threadpool_limits

from ...model.density import Density
from ...model.errors import BadInput
from ...model.files.reading import parse_json, read_bytes, read_text, shown
from ...model.files.run import Run, read_run
from ...model.problem import Problem
from ...model.robot import Matrix, Robot
from ...reports.words.findings import displacement_sentence
from ..estimation.fit import LikelihoodFit
from ..findings import LACK_OF_FIT, lack_of_fit, moved_target
from ..observability.identifiability import information_root
from ..result import RESULT_SCHEMA
from ..solution import Solution, require_noise_data, solve

Kind = Literal["runs", "results", "table"]
Progress = Callable[[str, float], None]

WHEN = "when"  # the key of a header's provenance that says when a run was made
_KNOWN = ("identified", "weak")
_SAME = 1e-9  # relative: two descriptions of one arm
_ROUNDING = 1e-11  # as in `identifiability`
_WITHOUT_PRIOR = 0.98  # std over the one without priors: from here on they have no part in an estimate
_UNITS = ("deg", "mm")


@dataclass(frozen=True, eq=False)
class Repeat:
    """One run: what its shots alone tell of the free offsets `names` (m,).

    `value` (m,) and `covariance` (m, m) are nan where the run does not tell the offset; the covariance is
    that at noise scale 1, None without a prediction, and has variances alone unless `joint`. `noise_dof` is
    None where the noise is known, else from how many spare numbers `noise_scale` comes. `held` are the other
    offsets. `sentences` are what a reader must know of the run; `failure` says why it has no numbers.
    """

    name: str
    sha256: str
    robot: str | None
    shots: int | None
    when: str | None
    names: tuple[str, ...]
    units: tuple[str, ...]
    held: tuple[str, ...]
    status: tuple[str, ...]
    value: Matrix
    covariance: Matrix | None
    joint: bool
    noise_scale: float
    noise_dof: int | None
    sentences: tuple[str, ...]
    failure: str | None


def read_repeats(paths: Sequence[Path], seed: int, progress: Progress) -> tuple[Kind, list[Repeat]]:
    """The runs in `paths`: run files, results of `analyse --json`, or one table (see `docs/compare.md`).

    Raises BadInput for fewer than two, for one that stands twice, and for runs that cannot be compared.
    """
    if any(path.suffix == ".csv" for path in paths):
        if len(paths) > 1:
            raise BadInput(
                "a table is compared alone: its runs have no uncertainties",
                found=f"{len(paths)} files",
                allowed="one table (.csv), or run files and results",
            )
        return "table", list(_from_table(paths[0]))
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
            found.append(_from_result(path, name))
            continue
        run = read_run(path)
        problems[k] = _problem(run)
        found.append(_unfitted(run, problems[k], name))
        arms.append((path, run.robot))
    _refuse_twice([(repeat.name, repeat.sha256 or "") for repeat in found])
    for (one, robot), (other, another) in pairwise(arms):
        _require_same_arm(one, robot, other, another)
    for one_repeat, other_repeat in pairwise(found):
        _require_comparable(one_repeat, other_repeat)
    with threadpool_limits(limits=1, user_api="blas"):
        for k, problem in problems.items():
            progress("fit", k / len(paths))
            found[k] = _fitted(found[k], problem, seed)
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
                "the same run stands twice: it would agree with itself",
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


# ── runs ──────────────────────────────────────────────────────────────────────────────────────


def _problem(run: Run) -> Problem:
    try:
        run.require_analysable()
        problem = Problem.from_run(run)
        require_noise_data(problem)
    except BadInput as error:
        raise error.at(run.path, run.header_line) from error
    return problem


def _unfitted(run: Run, problem: Problem, name: str) -> Repeat:
    """What is known of a run before its fit."""
    items = [item for item in problem.parameters.items if item.group == "offset"]
    free = [item for item in items if not item.held]
    when = run.header.provenance.get(WHEN)
    return Repeat(
        name=name,
        sha256=run.sha256,
        robot=run.robot.name,
        shots=problem.shots,
        when=when if isinstance(when, str) else None,
        names=tuple(item.name for item in free),
        units=tuple(item.unit for item in free),
        held=tuple(item.name for item in items if item.held),
        status=("unidentifiable",) * len(free),
        value=np.full(len(free), np.nan),
        covariance=np.full((len(free), len(free)), np.nan),
        joint=True,
        noise_scale=1.0,
        noise_dof=None if problem.noise.known else 1,
        sentences=run.warnings,
        failure=None,
    )


def _fitted(repeat: Repeat, problem: Problem, seed: int) -> Repeat:
    solution = solve(problem, seed=seed)
    if not solution.converged:
        return replace(repeat, failure=f"the fit did not converge: {solution.fit.reason}")
    parameters = problem.parameters
    columns = [parameters.index(name) for name in repeat.names]
    value, covariance = repeat.value.copy(), np.full_like(np.outer(repeat.value, repeat.value), np.nan)
    told = [k for k, column in enumerate(columns) if column in solution.known]
    if told:
        own_columns = [columns[k] for k in told]
        own_value, own_covariance = told_by_shots(solution.fit, own_columns)
        display = parameters.display[own_columns]
        value[told] = own_value * display
        covariance[np.ix_(told, told)] = own_covariance * np.outer(display, display)
    return replace(
        repeat,
        status=tuple(solution.status[column] for column in columns),
        value=value,
        covariance=covariance,
        noise_scale=solution.noise_scale,
        noise_dof=None if problem.noise.known else max(solution.dof, 1),
        sentences=(*_on_the_fit(solution), *repeat.sentences),
    )


def told_by_shots(fit: LikelihoodFit, columns: Sequence[int]) -> tuple[Matrix, Matrix]:
    """Values (m,) and covariance (m, m) at noise scale 1 of the parameters `columns`, internal units, by the
    shots and distances without any prior. The shots must tell each of them.

    At the mode the gradient of the log-likelihood is that of the prior turned round, which is z: one Newton
    step of the likelihood alone takes the prior out (exact for a linear problem). What else is unknown is
    eliminated (Schur complement), so that it may be as open as it likes.
    """
    problem, parameters = fit.problem, fit.problem.parameters
    _, root, _ = information_root(problem, fit.x, 1.0)
    own = parameters.among_free[list(columns)]
    rest = np.setdiff1d(np.arange(root.shape[1]), own)
    length = np.linalg.norm(root[:, rest], axis=0)
    length[length == 0] = 1.0
    by_rest = np.linalg.lstsq(root[:, rest] / length, root[:, own], rcond=_ROUNDING)[0] / length[:, None]
    left = root[:, own] - root[:, rest] @ by_rest
    covariance = np.linalg.inv(left.T @ left)
    weight = float(Density(problem).noise_weight(fit.x[None])[0])
    step = covariance @ (fit.z[own] - by_rest.T @ fit.z[rest]) / weight
    scale = parameters.prior_std[list(columns)]
    value = fit.x[list(columns)] + step * scale
    return value, np.asarray(covariance * np.outer(scale, scale))


def _on_the_fit(solution: Solution) -> Iterator[str]:
    fit, misfit, moved = solution.fit, lack_of_fit(solution), moved_target(solution)
    if misfit is not None:
        yield (
            "lack of fit: its residuals are larger than the stated noise explains, so its stds are too small"
            f" (p = {misfit.p_value:.0e})"
        )
    if moved is not None:
        yield displacement_sentence(moved)
    if fit.other_basins:
        yield "other offsets fit it nearly as well"
    if fit.problem.distances:
        yield (
            "it states distances between targets: where runs share one, its error is in all of them alike and"
            " they scatter less than predicted"
        )


# ── results ───────────────────────────────────────────────────────────────────────────────────


def _from_result(path: Path, name: str) -> Repeat:
    try:
        answer = parse_json(read_text(path)[0], file=path, line=1)
        if answer["schema"] != RESULT_SCHEMA:
            raise ValueError(f"schema {shown(answer['schema'])}")
        return _of_result(answer, name)
    except (KeyError, TypeError, ValueError) as error:
        raise BadInput(
            "this is not a whole result of zerobeam",
            found=f"{type(error).__name__}: {error}",
            allowed=f"a result.json of schema {RESULT_SCHEMA}, or a run file (.jsonl)",
            remedy="make it anew with zerobeam report or zerobeam analyse --json",
            file=path,
        ) from None


def _of_result(answer: dict[str, Any], name: str) -> Repeat:
    rows = [row for row in answer["parameters"] if row["group"] == "offset"]
    free = [row for row in rows if not row["held"]]
    fit, inputs = answer["fits"]["likelihood"], answer["inputs"]
    noise = inputs["header"].get("noise", {}).get("scale", "known")
    scale = float(fit["noise_scale"] or 1.0)
    value, variance, status, sentences = [], [], [], []
    for row in free:
        if row["status"] in _KNOWN and not row["std"] > 0:
            raise ValueError(f"the std of {row['name']} is not above 0")
        clean = row["status"] in _KNOWN and row["std"] >= _WITHOUT_PRIOR * row["data_std"]
        if row["status"] in _KNOWN and not clean:
            sentences.append(
                f"{row['name']} is not compared: the prior has a part in its estimate, and a result file does"
                " not say how to take it out; give the run file"
            )
        status.append(str(row["status"]) if clean or row["status"] not in _KNOWN else "prior")
        value.append(float(row["estimate"]) if clean else math.nan)
        variance.append((float(row["std"]) / scale) ** 2 if clean else math.nan)
    when = inputs["header"].get("provenance", {}).get(WHEN)
    p_value = fit["p_value"]
    if p_value is not None and p_value < LACK_OF_FIT:
        sentences.append("lack of fit: its stds are too small")
    return Repeat(
        name=name,
        sha256=str(inputs["sha256"]),
        robot=str(inputs["robot"]),
        shots=int(inputs["shots"]),
        when=when if isinstance(when, str) else None,
        names=tuple(str(row["name"]) for row in free),
        units=tuple(str(row["unit"]) for row in free),
        held=tuple(str(row["name"]) for row in rows if row["held"]),
        status=tuple(status),
        value=np.array(value),
        covariance=np.diag(variance),
        joint=False,
        noise_scale=scale,
        noise_dof=None if noise == "known" else max(int(fit["dof"] or 1), 1),
        sentences=tuple(sentences),
        failure=None if fit["converged"] else f"the fit did not converge: {fit['reason']}",
    )


# ── a table of published offsets ──────────────────────────────────────────────────────────────


def _from_table(path: Path) -> Iterator[Repeat]:
    """One for each row: `run`, then columns such as `delta2_deg`; an empty cell is an offset not given."""
    text, sha256 = read_text(path)
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader if any(row)]
    except csv.Error as error:
        raise BadInput(f"the file is not valid CSV: {error}", file=path, line=reader.line_num) from None
    line, head = rows[0]
    offsets = [_column(name, path, line) for name in head[1:]]
    names = tuple(name for name, _ in offsets)
    if head[0] != "run" or not offsets or len(set(names)) != len(names):
        raise BadInput(
            "the header row of a table of offsets is wrong",
            found=shown(",".join(head)),
            allowed="run, then each offset once with its unit: run,delta2_deg,delta3_deg",
            file=path,
            line=line,
        )
    if len(rows) < 3:
        raise BadInput("one run cannot be compared", found=f"{len(rows) - 1} rows", file=path)
    seen: set[str] = set()
    for line, row in rows[1:]:
        if len(row) != len(head) or not row[0] or row[0] in seen:
            raise BadInput(
                "this row of the table cannot be used",
                found=shown(",".join(row)),
                allowed=f"{len(head)} cells, the first a name that no other run has",
                file=path,
                line=line,
            )
        seen.add(row[0])
        value = np.array([_number(cell, path, line) for cell in row[1:]])
        yield Repeat(
            name=row[0],
            sha256=sha256,
            robot=None,
            shots=None,
            when=None,
            names=names,
            units=tuple(unit for _, unit in offsets),
            held=(),
            status=tuple("not stated" if math.isnan(own) else "stated" for own in value),
            value=value,
            covariance=None,
            joint=False,
            noise_scale=1.0,
            noise_dof=None,
            sentences=(),
            failure=None,
        )


def _column(stated: str, path: Path, line: int) -> tuple[str, str]:
    """delta2_deg: name and unit."""
    name, _, unit = stated.rpartition("_")
    if not name or unit not in _UNITS:
        raise BadInput(
            "a column of a table of offsets has no unit in its name",
            found=shown(stated),
            allowed=f"a name and one of {', '.join('_' + unit for unit in _UNITS)}, such as delta2_deg",
            file=path,
            line=line,
        )
    return name, unit


def _number(cell: str, path: Path, line: int) -> float:
    if not cell:
        return math.nan
    try:
        value = float(cell) if "_" not in cell else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise BadInput(
            "this is not an offset",
            found=shown(cell),
            allowed="a finite number with a decimal point; an empty cell where none is given",
            file=path,
            line=line,
        )
    return value


# ── their order ───────────────────────────────────────────────────────────────────────────────


def times(repeats: Sequence[Repeat]) -> list[datetime] | None:
    """When the runs were made, if all of them say so (ISO 8601) and not all at once; else None."""
    try:
        found = [datetime.fromisoformat(repeat.when or "") for repeat in repeats]
        return found if max(found) > min(found) else None
    except (ValueError, TypeError):  # no date, or one with a time zone beside one without
        return None
