"""The simulated arms of one plan, and what each way to treat the geometry states of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ....analysis.estimation.fit import fit_each, single
from ....analysis.observability.geometry import considered
from ....analysis.solution import Solution, judge
from ....analysis.status import known
from ....model.arrays import Matrix
from ....model.likelihood.geometry import NOMINAL
from ....model.likelihood.problem import Problem
from ..data_sets import DataSets, drawn

_TIP_MM = 2.0  # of a free tip from where the header has it: far less than its prior

Weigh = Callable[[Solution, Problem], Matrix]  # the std (p,) stated with a solution, internal units


@dataclass(frozen=True, eq=False)
class Stated:
    """What W arms state of m offsets: `error` (estimate minus truth) and `std` (W, m), deg or mm, nan where
    an arm's own answer does not determine it; `converged`, `misfit` (W,) of each answer."""

    error: Matrix
    std: Matrix
    converged: NDArray[np.bool_]
    misfit: NDArray[np.bool_]


def arms(problem: Problem, count: int, offset_deg: float, rng: np.random.Generator) -> DataSets:
    """So many arms with random offsets (and a free tip that is a little off), and links off by their
    tolerances, each measured once."""
    parameters = problem.parameters
    spread = np.where(parameters.group("offset"), offset_deg / _display(problem), 0.0)
    spread = np.where(parameters.group("tool"), np.minimum(parameters.prior_std, _TIP_MM), spread)
    spread = np.where(parameters.group("geometry"), parameters.prior_std, spread)
    return drawn(problem, count, rng, spread)


def freed(data: DataSets) -> Stated:
    """With the geometry estimated, as `analyse` does it where the header has the key `geometry`."""
    (own,) = _stated(data, data.problem, _own_std)
    return own


def nominal(data: DataSets) -> tuple[Stated, Stated]:
    """With nominal geometry: with the uncertainty that the noise alone gives, and with that of the consider
    analysis for the tolerances."""
    own, weighed = _stated(data, data.problem.with_geometry(NOMINAL), _own_std, _considered_std)
    return own, weighed


def understated(data: DataSets, factor: float) -> Stated:
    """With the geometry estimated, but its tolerances stated as so much smaller than they are."""
    closer = data.problem.geometry.scaled(1 / factor, 1 / factor)
    (own,) = _stated(data, data.problem.with_geometry(closer), _own_std)
    return own


def _own_std(solution: Solution, whole: Problem) -> Matrix:
    return solution.std


def _considered_std(solution: Solution, whole: Problem) -> Matrix:
    own, all_of_it = solution.problem.parameters, whole.parameters
    x = all_of_it.with_values(all_of_it.prior_mean, own, solution.fit.x)
    std = considered(whole, x)[~all_of_it.group("geometry")]
    return np.where([known(status) for status in solution.status], std, np.nan)


def _stated(data: DataSets, problem: Problem, *weighs: Weigh) -> list[Stated]:
    """By the fits of `problem`, with the stds of each of `weighs`."""
    fits = fit_each(problem, data.joints, data.spots)
    at = np.flatnonzero(problem.parameters.group("offset") & problem.parameters.free)
    std = np.full((len(weighs), len(fits.x), len(at)), np.nan)
    misfit = np.zeros(len(fits.x), dtype=bool)
    for row, (joints, spots) in enumerate(zip(data.joints, data.spots, strict=True)):
        solution = judge(single(problem.moved(joints, spots), fits, row))
        misfit[row] = solution.misfit is not None
        for k, weigh in enumerate(weighs):
            std[k, row] = weigh(solution, data.problem.moved(joints, spots))[at]
    display = _display(problem)[at]
    error = (fits.x[:, at] - data.truths[:, at]) * display  # offsets come first, whatever the geometry
    return [
        Stated(np.where(np.isnan(own), np.nan, error), own * display, fits.converged, misfit) for own in std
    ]


def _display(problem: Problem) -> Matrix:
    return np.array([item.display for item in problem.parameters.items])
