"""What each shot does to the answer: leave-one-out misses and Cook's distances.

Exact, by a fit without each shot, and by the formula of the linearised fit; the tests hold them together.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
            miss_mm=tuple(float(v) for v in fit.whitened.miss[i]),
            whitened=float(effect.whitened[i]),
            leave_one_out=finite(effect.leave_one_out[i]),
            cooks=finite(effect.cooks[i]),
        )
        for i, number in enumerate(problem.shot_numbers)
    )


class Influence(NamedTuple):
    """Per shot (N,): `whitened` miss in its own stds, `leave_one_out` miss in mm as the other shots
    predict it (nan where they cannot), `cooks` distance (nan likewise)."""

    whitened: Matrix
    leave_one_out: Matrix
    cooks: Matrix


def influence(problem: Problem, fit: LikelihoodFit) -> Influence:
    """By N fits, each without one shot. Where one of them fails its shot has nan."""
    count = problem.shots
    _, residual, decides = _blocks(problem, fit)
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


def influence_by_formula(problem: Problem, fit: LikelihoodFit) -> Influence:
    """From the hat matrix H_i = A_i C A_i' of each shot (Cook & Weisberg 1982, chapters 2 and 3)."""
    blocks, residual, decides = _blocks(problem, fit)
    open_part, _ = leverages(blocks, fit.covariance)
    predicted = np.linalg.solve(open_part, residual[:, :, None])
    hat = blocks @ fit.covariance @ blocks.transpose(0, 2, 1)
    cooks = (predicted.transpose(0, 2, 1) @ hat @ predicted)[:, 0, 0] / blocks.shape[2]
    length = np.linalg.norm((fit.whitened.factor @ predicted)[:, :, 0], axis=1) / np.sqrt(fit.weight)
    often = np.sqrt(problem.weights)
    return Influence(
        np.linalg.norm(residual, axis=1) / often,
        np.where(decides, np.nan, length / often),
        np.where(decides, np.nan, cooks),
    )


def _blocks(problem: Problem, fit: LikelihoodFit) -> tuple[Matrix, Matrix, NDArray[np.bool_]]:
    """Whitened Jacobians (N, d, f) and residuals (N, d) of the measurements, and which have leverage 1."""
    d, rows = problem.tool.miss_size, problem.shots * problem.tool.miss_size
    root = np.sqrt(fit.weight)
    blocks = problem.roots(fit.whitened) * root
    _, decides = leverages(blocks, fit.covariance)
    return blocks, fit.whitened.residual[:rows].reshape(problem.shots, d) * root, decides
