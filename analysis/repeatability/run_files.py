"""Runs of zerobeam for `compare`: read, checked and fitted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ...model.errors import BadInput
from ...model.files.run import Run
from ...model.problem import Problem
from ..analyse import require_noise_data
from ..diagnostics.displacement import displacement
from ..diagnostics.notes import LACK_OF_FIT
from ..estimation.fit import LikelihoodFit, fit_likelihood
from ..observability.identifiability import identify_at
from .prior_free import without_prior
from .repeat import FileWarning, LackOfFit, OtherOptima, Repeat, RunFinding, SharedDistances

WHEN = "when"  # the key of a header's provenance that says when a run was made
KNOWN = ("identified", "weak")


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
        joint=True,
        noise_scale=1.0,
        noise_dof=None if problem.noise.known else 1,
        findings=tuple(map(FileWarning, run.warnings)),
        failure=None,
    )


def fitted(repeat: Repeat, problem: Problem, seed: int) -> Repeat:
    """The same run with what its measurements say, each number without any prior."""
    fit = fit_likelihood(problem, seed=seed)
    if not fit.converged:
        return replace(repeat, failure=fit.reason)
    identified = identify_at(fit)
    parameters = problem.parameters
    columns = [parameters.index(name) for name in repeat.names]
    status = tuple(identified.status[column] for column in columns)
    value, covariance = repeat.value.copy(), np.full_like(np.outer(repeat.value, repeat.value), np.nan)
    known = [k for k, own in enumerate(status) if own in KNOWN]
    if known:
        own_columns = [columns[k] for k in known]
        own_value, own_covariance = without_prior(fit, own_columns)
        display = parameters.display[own_columns]
        value[known] = own_value * display
        covariance[np.ix_(known, known)] = own_covariance * np.outer(display, display)
    _, dof, p_value = fit.against_noise(identified.facts.rank)
    return replace(
        repeat,
        status=status,
        value=value,
        covariance=covariance,
        noise_scale=float(1 / np.sqrt(fit.weight)),
        noise_dof=None if problem.noise.known else max(dof, 1),
        findings=(*_on_the_fit(fit, p_value), *repeat.findings),
    )


def _on_the_fit(fit: LikelihoodFit, p_value: float | None) -> Iterator[RunFinding]:
    if p_value is not None and p_value < LACK_OF_FIT:
        yield LackOfFit(p_value)
    if (moved := displacement(fit)) is not None and moved.significant:
        yield moved
    if fit.other_basins:
        yield OtherOptima()
    if fit.problem.distances:
        yield SharedDistances()
