"""Runs of zerobeam for `compare`: read, checked and fitted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ...model.errors import BadInput
from ...model.files.header import Header
from ...model.files.run import Run
from ...model.likelihood.problem import Problem
from ..answer.findings import FileWarning, OtherBasins, moved_target
from ..ladder import solve_run
from ..solution import Solution, require_noise_data, undecided_names
from .prior_free import without_prior
from .repeat import Repeat, RunFinding, SharedDistances, SharedTolerances

WHEN = "when"  # the key of a header's provenance that says when a run was made


def problem_of(run: Run) -> Problem:
    """The problem of a run; BadInput, with its file, where it cannot be analysed."""
    try:
        run.require_analysable()
        problem = Problem.from_run(run)
        require_noise_data(problem)
    except BadInput as error:
        raise error.at(run.path, run.header_line) from error
    return problem


def unfitted(run: Run, problem: Problem, name: str) -> Repeat:
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
        status=tuple("unidentifiable" for _ in free),
        value=np.full(len(free), np.nan),
        covariance=np.full((len(free), len(free)), np.nan),
        by_geometry=np.zeros((len(free), 0)),
        geometry=(),
        joint=True,
        noise_scale=1.0,
        noise_dof=None if problem.noise.known else 1,
        findings=tuple(map(FileWarning, run.warnings)),
        failure=None,
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
        own_columns = [columns[k] for k in known]
        own = without_prior(solution.fit, own_columns)
        display = parameters.display[own_columns]
        value[known] = own.value * display
        covariance[np.ix_(known, known)] = own.covariance * np.outer(display, display)
        by_geometry[known] = own.by_geometry * display[:, None]
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
    if solution.misfit is not None:
        yield from solution.misfit.criteria
    if (moved := moved_target(solution)) is not None:
        yield moved
    if solution.fit.other_basins:
        undecided = undecided_names(solution.null_space)
        yield OtherBasins(solution.fit.other_basins, undecided)
    if solution.problem.distances:
        yield SharedDistances()
    if len(solution.problem.tolerated):
        yield SharedTolerances()
