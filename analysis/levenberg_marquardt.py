"""Levenberg-Marquardt with gain-ratio damping (Madsen, Nielsen & Tingleff 2004, algorithm 3.16), row by row.

Rows are minimisations of their own (starts of one run, or runs), carried out side by side.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..model.kernel import Index
from ..model.robot import Matrix

NO_LOWER = "no step lowers the cost any more"
NOT_FINITE = "the cost is not finite at the start"


class Quadratic(NamedTuple):
    """A cost near some points: `cost` (W,), `gradient` (W, f), a positive `curvature` (W, f, f)."""

    cost: Matrix
    gradient: Matrix
    curvature: Matrix


# At points (W, f) of the minimisations of these numbers (W,).
Model = Callable[[Matrix, Index], Quadratic]


@dataclass(frozen=True, eq=False)
class Minima:
    """Where W minimisations ended; not converging is a value, not an exception.

    `x` (W, f); `slope` (W, f) the gradient there and `curvature` (W, f, f); `reason` says why each stopped.
    """

    x: Matrix
    cost: Matrix
    slope: Matrix
    curvature: Matrix
    iterations: Index
    converged: NDArray[np.bool_]
    reason: tuple[str, ...]


def least_squares(residual: Callable[[Matrix, Index], tuple[Matrix, Matrix]]) -> Model:
    """The model of |r|^2 / 2 from residuals (W, M) and their Jacobian (W, M, f): Gauss and Newton's."""

    def model(x: Matrix, rows: Index) -> Quadratic:
        r, jacobian = residual(x, rows)
        transposed = jacobian.transpose(0, 2, 1)
        return Quadratic((r**2).sum(axis=1) / 2, (transposed @ r[:, :, None])[:, :, 0], transposed @ jacobian)

    return model


def levenberg_marquardt(
    model: Model,
    start: Matrix,
    *,
    max_iterations: int = 200,
    damping: float = 1e-3,
    tolerance: float = 1e-14,
    absolute: float = 1e-300,
    longest: Matrix | float = np.inf,
) -> Minima:
    """Minimise a cost from each row of `start` (W, f).

    The step solves (C + mu D) h = -g with D the diagonal of the curvature C, so that it changes with no unit
    (eq. 9 of the paper has D = I, and Omega there must be the residual vector). A row ends where its step
    promises to lower the cost by less than `tolerance` of it, or by `absolute`; `damping` is the first mu.
    Steps are shortened so that no coordinate moves by more than its `longest` (f,).
    """
    x = start.copy()
    rows, size = x.shape
    cost, gradient, curvature = model(x, np.arange(rows))
    converged = np.zeros(rows, dtype=bool)
    reason = np.full(rows, f"no convergence in {max_iterations} iterations", dtype=object)
    iterations = np.full(rows, max_iterations)
    mu, nu = np.full(rows, damping), np.full(rows, 2.0)
    finite = np.isfinite(cost)
    reason[~finite], iterations[~finite] = NOT_FINITE, 0
    active = np.flatnonzero(finite)
    diagonal_at = np.arange(size)
    for iteration in range(max_iterations):
        if len(active) == 0:
            break
        diagonal = np.maximum(curvature[active][:, diagonal_at, diagonal_at], 1e-300)
        damped = curvature[active]
        damped[:, diagonal_at, diagonal_at] += mu[active, None] * diagonal
        step = -solve_rows(damped, gradient[active][:, :, None])[:, :, 0]  # NaN: no step worth taking
        too_long = np.abs(step / longest).max(axis=1, initial=1.0)
        step /= too_long[:, None]
        bent = (curvature[active] @ step[:, :, None])[:, :, 0]
        predicted = -(step * (gradient[active] + bent / 2)).sum(axis=1)
        done = predicted <= np.maximum(tolerance * np.abs(cost[active]), absolute)
        ended = active[done]
        converged[ended], reason[ended], iterations[ended] = True, NO_LOWER, iteration
        active, step, predicted = active[~done], step[~done], predicted[~done]
        if len(active) == 0:
            break
        trial = x[active] + step
        found = model(trial, active)
        with np.errstate(invalid="ignore"):
            gain = (cost[active] - found.cost) / predicted
        taken = gain > 0  # never for what is no number
        better = active[taken]
        x[better], cost[better] = trial[taken], found.cost[taken]
        gradient[better], curvature[better] = found.gradient[taken], found.curvature[taken]
        mu[better] *= np.maximum(1 / 3, 1 - (2 * np.minimum(gain[taken], 2.0) - 1) ** 3)
        nu[better] = 2.0
        worse = active[~taken]
        with np.errstate(over="ignore"):
            mu[worse] *= nu[worse]
        nu[worse] *= 2
        active = active[np.isfinite(mu[active])]
    return Minima(x, cost, gradient, curvature, iterations, converged, tuple(reason))


def solve_rows(matrices: Matrix, right: Matrix) -> Matrix:
    """(W, f, m) of matrices (W, f, f) and right sides (W, f, m); NaN for a row whose matrix is singular."""
    try:
        return np.asarray(np.linalg.solve(matrices, right), dtype=float)
    except np.linalg.LinAlgError:
        result = np.full_like(right, np.nan)
        for row, (matrix, own) in enumerate(zip(matrices, right, strict=True)):
            try:
                result[row] = np.linalg.solve(matrix, own)
            except np.linalg.LinAlgError:
                continue
        return result
