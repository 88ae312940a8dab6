"""What each measurement does to the answer: leave-one-out residuals and Cook's distances.

Up to 300 measurements they are exact, by a fit without each one. That takes time with the square of their
number: of more, one Newton step from the mode is taken in place of a fit, but for those of high leverage. A
single one of so many moves the answer by little, and the two differ by some 1e-3 of a residual's standard
deviation. The tests hold both against the formulas of the linearised fit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...model.arrays import Mask, Matrix
from ...model.likelihood.density import Density
from ...model.likelihood.problem import Problem
from ..estimation.coordinates import FlangeCoordinates
from ..estimation.fit import LikelihoodFit, modes
from ..estimation.robust import leverages

_REFITTED = 300  # measurements up to which each one is left out by a fit
_LEVERAGE = 0.5  # from which on it is in any case
_MOST_REFITTED = 100  # of these
_ROWS = 1000  # measurements of a block: their informations are (rows, f, f)


@dataclass(frozen=True)
class ShotResult:
    """One measurement at the fit: `miss_mm` its residual (2 across the beam, or x, y, z; of all that was
    read at the posture), `length_mm` the length of that (of several readings their root mean square),
    `whitened` its length in its own standard deviations, `leave_one_out` the length in mm of the residual as
    predicted by the other measurements (None where they cannot predict it), `cooks` Cook's distance;
    `miss_deg` the residual's rotation vector, where an orientation was read."""

    shot: int
    target: str
    miss_mm: tuple[float, ...]
    length_mm: float
    whitened: float
    leave_one_out: float | None
    cooks: float | None
    miss_deg: tuple[float, ...] = ()

    @property
    def size(self) -> int:
        """How many components the residual has."""
        return len(self.miss_mm) + len(self.miss_deg)


def shot_results(fit: LikelihoodFit) -> tuple[ShotResult, ...]:
    """One for each measurement, in their order."""
    problem, effect = fit.problem, influence(fit.problem, fit)
    residual = fit.whitened.residual_mm
    every = [problem.read_components(i, row) for i, row in enumerate(residual)]
    lengths = problem.length_mm(residual)

    def finite(value: float) -> float | None:
        return float(value) if np.isfinite(value) else None

    return tuple(
        ShotResult(
            shot=number,
            target=problem.targets[problem.target_index[i]],
            miss_mm=every[i][0],
            length_mm=float(lengths[i]),
            whitened=float(effect.whitened[i]),
            leave_one_out=finite(effect.leave_one_out[i]),
            cooks=finite(effect.cooks[i]),
            miss_deg=every[i][1],
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
    """By N fits, each without one measurement, or by a step instead. Where one of them fails its measurement
    has nan."""
    count, root = problem.shots, np.sqrt(fit.weight)
    open_part, decides = leverages(problem.roots(fit.whitened) * root, fit.covariance)
    density, refitted = Density(problem), np.arange(count)
    x, unknown = np.tile(fit.x, (count, 1)), decides.copy()
    if count > _REFITTED:
        x = _stepped(problem, fit, decides)
        left = np.linalg.eigvalsh(open_part)[:, 0]
        highest = np.argsort(left, kind="stable")[:_MOST_REFITTED]
        refitted = highest[1 - left[highest] > _LEVERAGE]
    if len(refitted):
        weights = np.ones((len(refitted), count))
        weights[np.arange(len(refitted)), refitted] = 0.0
        without = modes(density.weighted(weights), np.tile(fit.x, (len(refitted), 1)))
        x[refitted], unknown[refitted] = without.x, decides[refitted] | ~without.converged
    move = density.scaled(x) - fit.z
    cooks = (move * np.linalg.solve(fit.covariance, move.T).T).sum(axis=1) / move.shape[1]
    left_out, _ = problem.linearise(x)
    return Influence(
        fit.normalised_lengths,
        np.where(unknown, np.nan, problem.length_mm(left_out)),
        np.where(unknown, np.nan, cooks),
    )


def _stepped(problem: Problem, fit: LikelihoodFit, decides: Mask) -> Matrix:
    """x (N, p) after one Newton step from the mode without each measurement, in the coordinates of a fit:
    (H - H_i) step = -g_i with its own slope and information; nothing of use where it `decides` (N,) alone."""
    known, _ = problem.with_noise_of(fit.x) if problem.noise.estimated else (problem, fit.x)
    coordinates = FlangeCoordinates(Density(problem))
    v = coordinates.from_parameters(fit.x[None])
    local = coordinates.at(v)
    curvature = np.linalg.inv(coordinates.covariance(fit.x[None], fit.covariance[None]))
    x = np.empty((problem.shots, len(fit.x)))
    for k in range(len(problem.targets)):
        every = np.flatnonzero(problem.target_index == k)
        for mine in np.array_split(every, -(-len(every) // _ROWS)):
            # Data sets of one measurement each.
            one = replace(known.select(mine[:1]), ties=())
            parts = (known.joints, known.spots, known.weights, known.readings)
            singles = Density(one, *(part[mine][:, None] for part in parts))
            slopes = singles.slopes(np.tile(fit.x, (len(mine), 1)))
            gradient = (slopes.gradient + fit.z) * fit.weight
            information = (slopes.information - np.eye(singles.size)) * fit.weight
            information[decides[mine]] = 0.0
            left = curvature - local.information(information)
            step = -np.linalg.solve(left, local.gradient(gradient)[:, :, None])[:, :, 0]
            x[mine] = coordinates.to_parameters(v + step)
    return x
