"""Simulated runs of one plan, each with true parameters of its own, and their likelihood fits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...analysis.estimation.fit import Fits, fit_each
from ...model.arrays import Matrix
from ...model.likelihood.problem import Problem
from ..simulate import simulated_readings

_FURTHER = 3.0  # how often more truths are drawn than needed, should some not be met


@dataclass(frozen=True, eq=False)
class DataSets:
    """W simulated runs of one plan: true parameters `truths` (W, p), `joints` (W, M, n) and `spots` as
    recorded; of `failed` further truths the arm cannot hit the target."""

    problem: Problem
    truths: Matrix
    joints: Matrix
    spots: Matrix
    failed: int

    def some(self, rows: slice) -> DataSets:
        """Some of them; who failed is counted with all."""
        return DataSets(self.problem, self.truths[rows], self.joints[rows], self.spots[rows], 0)


def drawn(problem: Problem, count: int, rng: np.random.Generator, spread: Matrix | None = None) -> DataSets:
    """Truths drawn from the priors, or with the stds `spread` (p,), and one run of the problem's postures
    with each. What is held stays held."""
    parameters = problem.parameters
    spread = parameters.prior_std if spread is None else spread
    truths = np.empty((0, len(parameters)))
    joints, spots, tried = [], [], 0
    while len(truths) < count and tried < _FURTHER * count:
        some = count - len(truths)
        x = np.tile(parameters.prior_mean, (some, 1))
        x += np.where(parameters.free, rng.normal(size=x.shape) * spread, 0.0)
        found = simulated_readings(problem, x, rng)
        truths = np.vstack([truths, x[found.met]])
        joints.append(found.joints[found.met])
        spots.append(found.spots[found.met])
        tried += some
    return DataSets(problem, truths, np.concatenate(joints), np.concatenate(spots), tried - len(truths))


def fitted(data: DataSets) -> Fits:
    """The likelihood fit of every data set, as `analyse` fits a single run."""
    return fit_each(data.problem, data.joints, data.spots)
