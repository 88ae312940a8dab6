"""The runs that `compare` compares: run files, results, or a table; refused where they are no repeats.

One run as `compare` takes it is its offsets without any prior, wherever they are from, in the units that
people read: degrees, millimetres.
"""

from __future__ import annotations

import csv
import hashlib
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from ...model.arrays import Matrix, Progress
from ...model.errors import BadInput, located
from ...model.files.header import WHEN_KEYS, Header, require_one_arm, stated_by
from ...model.files.run import Run, read_run
from ...model.kernel import one_blas_thread
from ...model.kinematics.robot import Robot, arm_difference
from ...model.likelihood.problem import Problem
from ...model.parsing.reading import LARGEST_RECORDING, parse_json, read_bytes, read_text, shown
from ...model.parsing.validation import LARGEST, SMALLEST
from ..answer.findings import FileWarning, OtherBasins
from ..answer.result import RESULT_SCHEMA, Result, parse_result
from ..ladder import solve_run
from ..misfit import Criterion, LackOfFit
from ..observability.causes import Cause
from ..solution import Solution, require_noise_data, undecided_names
from ..status import LACK_OF_FIT, RepeatStatus
from .consistency import without_prior

Kind = Literal["runs", "results", "table"]
# `prior`: a prior has a part in it. `stated`, `not stated`: of a table.


@dataclass(frozen=True)
class SharedDistances:
    """The run states distances or angles between targets, whose errors other runs may share."""


@dataclass(frozen=True)
class SharedTolerances:
    """The run frees the geometry, of which other runs of the arm have the same deviations."""


@dataclass(frozen=True)
class AssumedInRun:
    """An offset is as good as what was assumed of an instrument: the cause, or its words in a result."""

    name: str
    why: Cause | str | None


@dataclass(frozen=True)
class PriorInEstimate:
    """A prior has a part in an estimate of a result, which does not say how to take it out."""

    name: str


@dataclass(frozen=True)
class StatedMisfit:
    """A result file says that the model does not describe the run: its own sentence."""

    sentence: str


RunFinding = (
    Criterion
    | StatedMisfit
    | OtherBasins
    | SharedDistances
    | SharedTolerances
    | AssumedInRun
    | PriorInEstimate
    | FileWarning
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Repeat:
    """One run: what its measurements say of the free offsets `names` (m,).

    `value` (m,) and `covariance` (m, m) are nan where the run does not determine the offset; the covariance
    is by the noise at noise scale 1, None without a prediction, and has variances alone unless `joint`.
    `by_geometry` (m, g) is what each of the freed geometry parameters `geometry` adds to the offsets if it is
    one tolerance off: the same in all runs of the arm. `noise_dof`
    is None where the noise is known, else the degrees of freedom that `noise_scale` is estimated from. `held`
    are the other offsets. `failure` is why the fit did not converge, None if it did.
    """

    name: str
    sha256: str | None
    robot: str | None = None
    shots: int | None = None
    provenance: Mapping[str, object] = field(default_factory=dict)
    names: tuple[str, ...]
    units: tuple[str, ...]
    held: tuple[str, ...] = ()
    status: tuple[RepeatStatus, ...]
    value: Matrix
    covariance: Matrix | None = None
    by_geometry: Matrix
    geometry: tuple[str, ...] = ()
    joint: bool
    noise_scale: float = 1.0
    noise_dof: int | None = None
    findings: tuple[RunFinding, ...] = ()
    failure: str | None = None

    @property
    def when(self) -> str | None:
        """When it was measured, as its provenance has it."""
        return stated_by(self.provenance, WHEN_KEYS)

    @property
    def misfit(self) -> bool:
        """Whether the model does not describe the run."""
        return "unvalidated" in self.status or any(
            isinstance(finding, Criterion | StatedMisfit) for finding in self.findings
        )


_WITHOUT_PRIOR = 0.98  # std over the one without priors: from here on they have no part in an estimate


def read_result(path: Path, name: str) -> Repeat:
    """One run from its result; BadInput where the file is not a whole one."""
    text = read_text(path, LARGEST_RECORDING)[0]
    try:
        parse_json(text, file=path, line=1)  # refuses duplicate keys and NaN
        return _of_result(parse_result(text), name)
    except ValueError as error:
        raise BadInput(
            "this is not a whole result of zerobeam",
            found=str(error),
            allowed=f"a result.json of schema {RESULT_SCHEMA}, or a run file (.jsonl)",
            remedy="make it again with zerobeam report or zerobeam analyse --json",
            file=path,
        ) from None


def _of_result(result: Result, name: str) -> Repeat:
    free = [row for row in result.offsets if not row.held]
    fit, inputs = result.fits.likelihood, result.inputs
    scale = _within(fit.noise_scale or 1.0)
    if not scale >= SMALLEST:
        raise ValueError(f"the noise scale is {scale:g}")
    status: list[RepeatStatus] = []
    findings: list[RunFinding] = []
    value, variance, by_geometry = [], [], []
    for row in free:
        if row.std is None or row.estimate is None:
            status.append(row.status)
            without_prior = False
        else:
            if not row.std >= SMALLEST:
                raise ValueError(f"the std of {row.name} is not above 0")
            if row.data_std is None:
                raise ValueError(f"{row.name} has no std without prior")
            without_prior = row.std >= _WITHOUT_PRIOR * row.data_std
            status.append(row.status if without_prior else "prior")
            if not without_prior:
                findings.append(PriorInEstimate(row.name))
        if status[-1] == "assumed":
            findings.append(AssumedInRun(row.name, row.reason))
        share, std = row.tolerance_share or 0.0, row.std or math.nan
        value.append(_within(row.estimate or 0.0) if without_prior else math.nan)
        variance.append((1 - share) * (_within(std) / scale) ** 2 if without_prior else math.nan)
        by_geometry.append(math.sqrt(share) * std if without_prior else math.nan)
    if any(np.asarray(by_geometry) > 0):
        findings.append(SharedTolerances())
    if result.misfit is not None:
        findings.extend(StatedMisfit(criterion.sentence or "") for criterion in result.misfit.criteria)
    elif fit.p_value is not None and fit.p_value < LACK_OF_FIT:
        # A result of before there was a verdict for it.
        status = ["unvalidated" if one in ("identified", "weak", "assumed") else one for one in status]
        findings.append(LackOfFit(fit.chi2 or 0.0, fit.dof or 0, fit.p_value))
    return Repeat(
        name=name,
        sha256=inputs.sha256,
        robot=inputs.robot,
        shots=inputs.shots,
        provenance=inputs.provenance,
        names=tuple(row.name for row in free),
        units=tuple(row.unit for row in free),
        held=tuple(row.name for row in result.offsets if row.held),
        status=tuple(status),
        value=np.array(value),
        covariance=np.diag(variance),
        # A result does not say how deviations work together: offset by offset, each has one of its own.
        by_geometry=np.diag(by_geometry),
        geometry=tuple(row.name for row in free),
        joint=False,
        noise_scale=scale,
        noise_dof=None if inputs.noise_known else max(fit.dof or 1, 1),
        findings=tuple(findings),
        failure=None if fit.converged else fit.reason,
    )


def _within(number: float) -> float:
    if not -LARGEST["mm"] <= number <= LARGEST["mm"]:
        raise ValueError(f"the number {number:g} is out of range")
    return number


def read_table(path: Path) -> Iterator[Repeat]:
    """A run for each row: `run`, then columns such as `delta2_deg`; an empty cell is an offset not given."""
    text, sha256 = read_text(path)
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader if any(row)]
    except csv.Error as error:
        raise BadInput(f"the file is not valid CSV: {error}", file=path, line=reader.line_num) from None
    if not rows:
        raise BadInput("the table has no rows", file=path)
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
    names_read: set[str] = set()
    for line, row in rows[1:]:
        if len(row) != len(head) or not row[0] or row[0] in names_read:
            raise BadInput(
                "this row of the table cannot be used",
                found=shown(",".join(row)),
                allowed=f"{len(head)} cells, the first a name that no other run has",
                file=path,
                line=line,
            )
        names_read.add(row[0])
        units = [unit for _, unit in offsets]
        cells = zip(row[1:], units, strict=True)
        value = np.array([_number(cell, LARGEST[unit], path, line) for cell, unit in cells])
        yield Repeat(
            name=row[0],
            sha256=sha256,
            names=names,
            units=tuple(units),
            status=tuple("not stated" if math.isnan(number) else "stated" for number in value),
            value=value,
            by_geometry=np.zeros((len(names), 0)),
            joint=False,
        )


def _column(column: str, path: Path, line: int) -> tuple[str, str]:
    """delta2_deg: name and unit."""
    name, _, unit = column.rpartition("_")
    if not name or unit not in LARGEST:
        raise BadInput(
            "a column of a table of offsets has no unit in its name",
            found=shown(column),
            allowed=f"a name and one of {', '.join('_' + unit for unit in LARGEST)}, such as delta2_deg",
            file=path,
            line=line,
        )
    return name, unit


def _number(cell: str, most: float, path: Path, line: int) -> float:
    if not cell:
        return math.nan
    try:
        value = float(cell) if "_" not in cell else math.nan
    except ValueError:
        value = math.nan
    if not -most <= value <= most:
        raise BadInput(
            "this is not an offset",
            found=shown(cell),
            allowed=f"a number up to {most:g} with a decimal point; an empty cell where none is given",
            file=path,
            line=line,
        )
    return value


def problem_of(run: Run) -> Problem:
    """The problem of a run; BadInput, with its file, where it cannot be analysed."""
    with located(run.path, run.header_line):
        run.require_analysable()
        problem = Problem.from_run(run)
        require_noise_data(problem)
        return problem


def unfitted(run: Run, problem: Problem, name: str) -> Repeat:
    """A run before its fit."""
    items = [item for item in problem.parameters.items if item.group == "offset"]
    free = [item for item in items if not item.held]
    return Repeat(
        name=name,
        sha256=run.sha256,
        robot=run.robot.name,
        shots=problem.shots,
        provenance=run.header.provenance,
        names=tuple(item.name for item in free),
        units=tuple(item.unit for item in free),
        held=tuple(item.name for item in items if item.held),
        status=tuple("unidentifiable" for _ in free),
        value=np.full(len(free), np.nan),
        covariance=np.full((len(free), len(free)), np.nan),
        by_geometry=np.zeros((len(free), 0)),
        joint=True,
        noise_dof=None if problem.noise.known else 1,
        findings=tuple(map(FileWarning, run.warnings)),
    )


def fitted(repeat: Repeat, problem: Problem, header: Header, seed: int) -> Repeat:
    """The same run with what its measurements say, each number without any prior."""
    solution = solve_run(problem, header, seed=seed)
    problem = solution.problem
    if not solution.converged:
        return replace(repeat, failure=solution.fit.reason)
    parameters = problem.parameters
    columns = [parameters.index(name) for name in repeat.names]
    value, covariance = repeat.value.copy(), np.full_like(np.outer(repeat.value, repeat.value), np.nan)
    geometry = tuple(parameters.names[column] for column in problem.tolerated)
    by_geometry = np.full((len(columns), len(geometry)), np.nan)
    known = [k for k, column in enumerate(columns) if column in solution.known]
    if known:
        known_columns = [columns[k] for k in known]
        offsets = without_prior(solution.fit, known_columns)
        display = parameters.display[known_columns]
        value[known] = offsets.value * display
        covariance[np.ix_(known, known)] = offsets.covariance * np.outer(display, display)
        by_geometry[known] = offsets.by_geometry * display[:, None]
    return replace(
        repeat,
        status=tuple(solution.status[column] for column in columns),
        value=value,
        covariance=covariance,
        by_geometry=by_geometry,
        geometry=geometry,
        noise_scale=solution.noise_scale,
        noise_dof=None if problem.noise.known else max(solution.dof, 1),
        findings=(*_on_the_fit(solution), *repeat.findings),
    )


def _on_the_fit(solution: Solution) -> Iterator[RunFinding]:
    yield from solution.contradictions
    if solution.fit.other_basins:
        undecided = undecided_names(solution.identified.facts.null_space)
        yield OtherBasins(solution.fit.other_basins, undecided)
    if solution.problem.ties:
        yield SharedDistances()
    if len(solution.problem.tolerated):
        yield SharedTolerances()
    for row in solution.parameters:
        if row.group == "offset" and row.status == "assumed":
            yield AssumedInRun(row.name, row.cause)


def read_repeats(runs: Sequence[Path | Run], seed: int, progress: Progress) -> tuple[Kind, list[Repeat]]:
    """The runs in files: run files, results of `analyse --json`, or one table (see `docs/compare.md`); or the
    runs themselves.

    Raises BadInput for fewer than two, for one that is given twice, and for runs that cannot be compared.
    """
    paths = [one if isinstance(one, Path) else one.path for one in runs]
    if any(isinstance(one, Path) and one.suffix == ".csv" for one in runs):
        if len(runs) > 1:
            raise BadInput(
                "a table is compared alone: its runs have no uncertainties",
                found=f"{len(runs)} files",
                allowed="one table (.csv), or run files and results",
            )
        return "table", list(read_table(paths[0]))
    if len(runs) < 2:
        raise BadInput(
            "one run cannot be compared",
            found=str(paths[0]) if runs else "no file",
            allowed="two runs or more, or a table of published offsets (.csv)",
        )
    names = _names(paths)
    _refuse_twice([(name, _sha256(one)) for name, one in zip(names, runs, strict=True)])
    # All that could forbid a comparison comes before the first fit.
    repeats: list[Repeat] = []
    problems: dict[int, tuple[Problem, Header]] = {}
    arms: list[tuple[str, Robot]] = []
    for k, (one, name) in enumerate(zip(runs, names, strict=True)):
        if isinstance(one, Path) and one.suffix == ".json":
            repeats.append(read_result(one, name))
            continue
        run = read_run(one) if isinstance(one, Path) else one
        problem = problem_of(run)
        problems[k] = problem, run.header
        repeats.append(unfitted(run, problem, name))
        arms.append((name, run.robot))
    _refuse_twice([(repeat.name, repeat.sha256 or "") for repeat in repeats])
    for (first, robot), (other, another) in pairwise(arms):
        _require_same_arm(first, robot, other, another)
    require_one_arm((repeat.name, repeat.provenance) for repeat in repeats)
    for one_repeat, other_repeat in pairwise(repeats):
        _require_comparable(one_repeat, other_repeat)
    with one_blas_thread():
        for k, (problem, header) in problems.items():
            progress(f"fit, run {k + 1}/{len(runs)}", k / len(runs))
            repeats[k] = fitted(repeats[k], problem, header, seed)
    return "runs" if len(problems) == len(runs) else "results", repeats


def _names(paths: Sequence[Path]) -> list[str]:
    """Names of the runs: their files' names, with the folders where two are the same, and a number
    where that is not enough."""
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
    if arm_difference(robot, another) is not None:
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
        difference = f"{mine} in {one.name}, {yours} in {other.name}"
        raise BadInput(what, found=difference, allowed=allowed, remedy=remedy)

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
        dates = [datetime.fromisoformat(repeat.when or "") for repeat in repeats]
        return dates if max(dates) > min(dates) else None
    except (ValueError, TypeError):  # no date, or one with a time zone beside one without
        return None
