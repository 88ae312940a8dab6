"""A run without some of its measurements: fitted again by what `analyse` fits with, or written as another."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BeforeValidator, Field
from threadpoolctl import threadpool_limits

from ....analysis.estimation.fit import fit_likelihood
from ....analysis.estimation.tolerance_factors import with_open_factors
from ....analysis.ladder import solve_run
from ....analysis.observability.causes import NullDirection
from ....analysis.solution import ParameterResult, Solution, judge, require_noise_data
from ....analysis.status import Verdict, known
from ....model.arrays import Index
from ....model.errors import BadInput
from ....model.files.run import Run, read_run
from ....model.likelihood.problem import Problem
from ....model.parsing.confinement import free_path
from ....model.parsing.validation import as_tuple
from ....model.records import it, record
from ....words.message import headline
from ....words.misfit_words import criterion_sentence
from ..index import Folder
from ..requests import end_point, wrong
from ..versions import VersionOfFile, kept, version_of

MOST_MEASUREMENTS = 2000  # of a run that is fitted while somebody waits
_MOST_NAMED = 5  # measurements, in the name of a file

RunOfFolder = Annotated[str, it("a run file below the folder")]
NumbersLeftOut = Annotated[
    tuple[int, ...],
    BeforeValidator(as_tuple),
    it("numbers of the measurements to leave out"),
    Field(max_length=MOST_MEASUREMENTS),
]


@dataclass(frozen=True)
class FittedRun:
    """A run, its problem as the file states it, and the fit of all measurements."""

    run: Run
    problem: Problem
    solution: Solution


@kept(4)
def fitted(path: Path) -> FittedRun:
    """The run fitted as `analyse` does; BadInput where it cannot be, or is too long to wait for."""
    run = read_run(path)
    if len(run.shots) > MOST_MEASUREMENTS:
        raise BadInput(
            "the run is too long to be fitted while you wait",
            found=f"{len(run.shots)} measurements",
            allowed=f"at most {MOST_MEASUREMENTS}",
            remedy="use zerobeam analyse; its leave-one-out residuals are in the report",
        )
    run.require_analysable()
    problem = Problem.from_run(run)
    require_noise_data(problem)
    with threadpool_limits(limits=1, user_api="blas"):
        return FittedRun(run, problem, solve_run(problem, run.header))


@record(repr=False)
class RefitRow(ParameterResult):
    """A parameter without the measurements, and with all."""

    before: Annotated[ParameterResult, it("by all measurements")] = field(kw_only=True)


@record(kw_only=True)
class Refit:
    """The answer `without` some measurements."""

    without: list[int]
    measurements: int
    of: Annotated[int, it("measurements of the run")]
    verdict: Verdict
    verdict_before: Verdict
    headline: str
    coverage_factor: float
    parameters: Annotated[list[RefitRow], it("offsets and tool")]
    lost: Annotated[list[str], it("parameters that are unidentifiable without them, and were not")]
    null_space: tuple[NullDirection, ...]
    misfit: list[str]


@end_point(
    "POST /api/refit", "A run fitted again without some measurements: verdict, offsets before and after."
)
def refit(
    folder: Folder,
    run: RunOfFolder,
    without: NumbersLeftOut = (),
) -> Refit:
    """The answer `without` some measurements."""
    fitted_run = fitted(folder.file(run))
    whole = fitted_run.solution
    solution = whole
    if without:
        with threadpool_limits(limits=1, user_api="blas"):
            solution = _without(fitted_run, without)
    before = {row.name: row for row in whole.parameters}
    offsets = [
        RefitRow(**vars(row), before=before[row.name])
        for row in solution.parameters
        if row.group in ("offset", "tool") and not row.tolerated
    ]
    lost = [
        row.name
        for row in solution.parameters
        if row.status == "unidentifiable" and known(before[row.name].status)
    ]
    return Refit(
        without=sorted(set(without)),
        measurements=solution.problem.shots,
        of=fitted_run.problem.shots,
        verdict=solution.verdict,
        verdict_before=whole.verdict,
        headline=headline(solution),
        coverage_factor=solution.coverage_factor,
        parameters=offsets,
        lost=lost,
        null_space=solution.null_space,
        misfit=list(map(criterion_sentence, solution.contradictions)),
    )


@end_point(
    "POST /api/runs", "Writes a run without some measurements beside it: a new file that says so.", status=201
)
def save_without(
    folder: Folder,
    run: RunOfFolder,
    without: Annotated[NumbersLeftOut, Field(min_length=1)],
) -> VersionOfFile:
    """Write the run `without` some measurements; its provenance says which, and of what run."""
    path = folder.file(run)
    recorded = read_run(path)
    _left(tuple(shot.shot for shot in recorded.shots), without)
    numbers = sorted(set(without))
    named = "-".join(map(str, numbers[:_MOST_NAMED])) + ("-and-more" if len(numbers) > _MOST_NAMED else "")
    file = free_path(path.with_name(f"{path.stem}-without-{named}{path.suffix}"))
    recorded.without(numbers).saved(file)
    return VersionOfFile(file=folder.called(file), version=version_of(file))


def _left(numbers: tuple[int, ...], without: tuple[int, ...]) -> Index:
    """Which measurements, of these `numbers`, are left; Refused for a number that none has, BadInput where so
    few are left that nothing can be determined."""
    for k, number in enumerate(without):
        if number not in numbers:
            raise wrong(("without", k), "the run has no measurement of this number", number, None)
    left = np.flatnonzero(~np.isin(numbers, without))
    if len(left) < 2:
        raise BadInput(
            "so few measurements cannot determine any offset",
            found=f"{len(left)} left",
            allowed="at least 2",
            remedy="leave out fewer",
        )
    return left


def _without(fitted_run: FittedRun, without: tuple[int, ...]) -> Solution:
    left = _left(fitted_run.problem.shot_numbers, without)
    if fitted_run.run.header.arm is None:
        selected = _selected(fitted_run.problem, left)
        require_noise_data(selected)
        return solve_run(selected, fitted_run.run.header)
    # To climb the ladder again takes seconds: it is the model that all measurements chose, and their weights.
    selected = _selected(fitted_run.solution.problem, left)
    require_noise_data(selected)
    fit, factors = fit_likelihood(selected), fitted_run.solution.factors
    return judge(fit if factors is None else with_open_factors(fit, factors))


def _selected(problem: Problem, rows: Index) -> Problem:
    """The problem with some of its measurements; a target that has none left goes with them."""
    selected = problem.select(rows)
    kept = {selected.targets[k] for k in selected.target_index.tolist()}
    gone = set(selected.targets) - kept
    return selected.without_targets(gone) if gone else selected
