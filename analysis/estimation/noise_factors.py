"""Two noise factors with many other unknowns: found from what the other unknowns leave of the residuals.

At the common mode of all parameters the residuals are as small as the fit can make them, and a noise that is
taken from them is too small: with f unknowns of M numbers by about sqrt(1 - f / M). So the factors are
those of highest probability once the other unknowns are integrated out by Laplace's formula (restricted
maximum likelihood: Patterson & Thompson 1971), and all else is found there.
"""

from __future__ import annotations

import numpy as np

from ...model.arrays import Matrix
from ...model.likelihood.density import Density
from ...model.likelihood.problem import Problem
from .climb import Climb

_STEP = 0.1  # of the logarithms, for the differences
_LONGEST = 1.0
_ROUNDS = 30
_SETTLED = 1e-4


def marginal_noise(problem: Problem, start: Matrix) -> tuple[Matrix, Matrix, bool]:
    """x (p,) with the noise factors at their marginal mode and all else at its mode given them, its
    covariance (f, f) by the scaled parameters, and whether it settled; `start` (p,) is a fit near it."""
    parameters, density = problem.parameters, Density(problem)
    columns = np.flatnonzero(parameters.group("noise")[parameters.free])  # the noise among the free ones
    count = len(columns)
    units = np.eye(count)
    pairs = [units[i] + units[j] for i, j in zip(*np.tril_indices(count, -1), strict=True)]
    points = _STEP * np.array([np.zeros(count), *units, *-units, *pairs, *(-pair for pair in pairs)])
    held = np.zeros((len(points), density.size), dtype=bool)
    held[:, columns] = True
    climb = Climb(density, np.zeros(len(points), dtype=int), len(points), held)
    v = climb.coordinates.from_parameters(start[None])[0]
    settled = False
    for _ in range(_ROUNDS):
        near = np.tile(v, (len(points), 1))
        near[:, columns] += points
        minima = climb.up(near)
        # The held have a 1 in the information and no part in its determinant.
        log_det = np.linalg.slogdet(minima.curvature)[1]
        slope, curvature = _quadratic(-minima.cost - log_det / 2, count)
        values, vectors = np.linalg.eigh(curvature)
        step = vectors @ (vectors.T @ slope / np.maximum(np.abs(values), 1e-3))
        step *= min(1.0, _LONGEST / max(float(np.abs(step).max(initial=0.0)), 1e-300))
        by_noise = (minima.x[1 : 1 + count] - minima.x[1 + count : 1 + 2 * count]).T / (
            2 * _STEP
        )  # (f, count)
        v = minima.x[0] + by_noise @ step
        if np.abs(step).max(initial=0.0) < _SETTLED:
            settled = bool(minima.converged.all() and (values > 1e-3).all())
            break
    x = climb.coordinates.to_parameters(v[None])[0]
    rest = np.linalg.inv(minima.curvature[0])  # what is held has 1 there, and no part in the others
    rest[columns, columns] = 0.0
    covariance = rest + by_noise @ np.linalg.inv(curvature) @ by_noise.T
    by_v = climb.coordinates.jacobian(x[None])[0]
    return x, by_v @ covariance @ by_v.T, settled


def _quadratic(values: Matrix, count: int) -> tuple[Matrix, Matrix]:
    """Slope (count,) and negative curvature (count, count) of values at the points of `marginal_noise`."""
    centre, up, down = values[0], values[1 : 1 + count], values[1 + count : 1 + 2 * count]
    slope = (up - down) / (2 * _STEP)
    curvature = np.diag((2 * centre - up - down) / _STEP**2)
    rest = values[1 + 2 * count :].reshape(2, -1)
    for k, (i, j) in enumerate(zip(*np.tril_indices(count, -1), strict=True)):
        both = (2 * centre - rest[0, k] - rest[1, k]) / _STEP**2
        curvature[i, j] = curvature[j, i] = (both - curvature[i, i] - curvature[j, j]) / 2
    return slope, curvature
