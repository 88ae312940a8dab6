"""What each measurement does to the answer: leave-one-out residuals and Cook's distances, exact, by a fit
without each measurement. The tests hold them against the formulas of the linearised fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...model.density import Density
from ...model.problem import Problem
from ...model.robot import Matrix
from ..estimation.fit import LikelihoodFit, modes
from ..estimation.robust import leverages


@dataclass(frozen=True)
class ShotResult:
    """One measurement at the fit: `miss_mm` its residual (2 across the beam, or x, y, z), `whitened` its
    length in its own standard deviations, `leave_one_out` the length in mm of the residual as predicted by
    the other measurements (None where they cannot predict it), `cooks` Cook's distance."""

    shot: int
    target: str
    miss_mm: tuple[float, ...]
    whitened: float
    leave_one_out: float | None
    cooks: float | None


def shot_results(fit: LikelihoodFit) -> tuple[ShotResult, ...]:
    """One for each measurement, in their order."""
    problem, effect = fit.problem, influence(fit.problem, fit)

    def finite(value: float) -> float | None:
        return float(value) if np.isfinite(value) else None

    return tuple(
        ShotResult(
            shot=number,
            target=problem.targets[problem.target_index[i]],
            miss_mm=tuple(float(v) for v in fit.whitened.residual_mm[i]),
            whitened=float(effect.whitened[i]),
            leave_one_out=finite(effect.leave_one_out[i]),
            cooks=finite(effect.cooks[i]),
        )
        for i, number in enumerate(problem.shot_numbers)
    )


class Influence(NamedTuple):
    """Per measurement (N,): the length of its `whitened` residual, of its `leave_one_out` residual in mm, as
    the other measurements predict it (nan where they cannot), and Cook's distance (nan likewise)."""

    whitened: Matrix
    leave_one_out: Matrix
    cooks: Matrix


def influence(problem: Problem, fit: LikelihoodFit) -> Influence:
    """By N fits, each without one measurement. Where one of them fails its measurement has nan."""
    count, d = problem.shots, problem.tool.miss_size
    root = np.sqrt(fit.weight)
    _, decides = leverages(problem.roots(fit.whitened) * root, fit.covariance)
    residual = fit.whitened.residual[: count * d].reshape(count, d) * root
    density = Density(problem).weighted(1.0 - np.eye(count))
    without = modes(density, np.tile(fit.x, (count, 1)))
    move = density.scaled(without.x) - fit.z
    cooks = (move * np.linalg.solve(fit.covariance, move.T).T).sum(axis=1) / move.shape[1]
    left_out, _ = problem.linearise(without.x)
    unknown = decides | ~without.converged
    return Influence(
        np.linalg.norm(residual, axis=1) / np.sqrt(problem.weights),
        np.where(unknown, np.nan, np.linalg.norm(left_out, axis=1)),
        np.where(unknown, np.nan, cooks),
    )
