"""Levenberg-Marquardt with gain-ratio damping (Madsen, Nielsen & Tingleff 2004, algorithm 3.16), row by row.

Rows are minimisations of their own (starts of one run, or runs), carried out side by side.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...model.arrays import Index, Matrix

DAMPING, TOLERANCE = 1e-3, 1e-14
NO_LOWER = "the cost is at a minimum to rounding"
NO_STEP = "no damping gives a step that could be taken"
NOT_FINITE = "the cost is not finite at the start"


class Quadratic(NamedTuple):
    """A cost near some points: `cost` (W,), `gradient` (W, f), a positive `curvature` (W, f, f)."""

    cost: Matrix
    gradient: Matrix
    curvature: Matrix


# At points (W, f) of the minimisations of these numbers (W,).
QuadraticModel = Callable[[Matrix, Index], Quadratic]


@dataclass(frozen=True, eq=False)
class Minimised:
    """Where W minimisations ended; not converging is a value, not an exception: `reason` says why each
    stopped."""

    iterations: Index
    converged: NDArray[np.bool_]
    reason: Sequence[str]

    def of_rows(self, rows: Index) -> Self:
        """Those of some rows, as often as they are named."""
        parts = {one.name: getattr(self, one.name)[rows] for one in fields(self) if one.name != "reason"}
        return replace(self, **parts, reason=[self.reason[k] for k in rows.tolist()])


@dataclass(frozen=True, eq=False)
class Minima(Minimised):
    """`x` (W, f) where they ended; `slope` (W, f) the gradient there and `curvature` (W, f, f)."""

    reason: list[str]
    x: Matrix
    cost: Matrix
    slope: Matrix
    curvature: Matrix

    def keep(self, rows: Index, x: Matrix, cost: Matrix, slope: Matrix, curvature: Matrix) -> None:
        """Keep the state of these rows."""
        self.x[rows], self.cost[rows] = x, cost
        self.slope[rows], self.curvature[rows] = slope, curvature


def least_squares(residual: Callable[[Matrix, Index], tuple[Matrix, Matrix]]) -> QuadraticModel:
    """The model of |r|^2 / 2 from residuals (W, M) and their Jacobian (W, M, f): Gauss and Newton's."""

    def model(x: Matrix, rows: Index) -> Quadratic:
        r, jacobian = residual(x, rows)
        transposed = jacobian.transpose(0, 2, 1)
        return Quadratic((r**2).sum(axis=1) / 2, (transposed @ r[:, :, None])[:, :, 0], transposed @ jacobian)

    return model


def levenberg_marquardt(
    model: QuadraticModel,
    start: Matrix,
    *,
    max_iterations: int = 200,
    tolerance: float = TOLERANCE,
    absolute: float = 1e-300,
    longest: Matrix | float = np.inf,
) -> Minima:
    """Minimise a cost from each row of `start` (W, f).

    The step solves (C + mu D) h = -g with D the diagonal of the curvature C, so that it changes with no unit
    (eq. 9 of the paper has D = I, and Omega there must be the residual vector). A row ends where its step
    promises to lower the cost by less than `tolerance` of it, or by `absolute`.
    Steps are shortened so that no coordinate moves by more than its `longest` (f,).
    """
    rows, size = start.shape
    first = model(start, np.arange(rows))
    result = Minima(
        np.full(rows, max_iterations),
        np.zeros(rows, dtype=bool),
        [f"no convergence in {max_iterations} iterations"] * rows,
        start.copy(),
        first.cost.copy(),
        first.gradient.copy(),
        first.curvature.copy(),
    )
    # Unfinished rows are contiguous, so that a step of all is a few operations.
    finite = np.isfinite(result.cost)
    active = np.flatnonzero(finite)
    for row in np.flatnonzero(~finite):
        result.reason[row], result.iterations[row] = NOT_FINITE, 0
    x, cost, slope, curvature = (
        part[active] for part in (result.x, result.cost, result.slope, result.curvature)
    )
    mu, nu = np.full(len(active), DAMPING), np.full(len(active), 2.0)
    for iteration in range(max_iterations):
        if len(active) == 0:
            break
        damped = curvature.copy()
        diagonal = damped.reshape(len(active), size * size)[:, :: size + 1]
        diagonal += mu[:, None] * np.maximum(diagonal, 1e-300)
        step = -solve_rows(damped, slope[:, :, None])[:, :, 0]  # NaN: no step worth taking
        step /= np.abs(step / longest).max(axis=1, initial=1.0)[:, None]
        bent = (curvature @ step[:, :, None])[:, :, 0]
        predicted = -(step * (slope + bent / 2)).sum(axis=1)
        done = predicted <= np.maximum(tolerance * np.abs(cost), absolute)
        lost = ~np.isfinite(mu)  # no damping makes a step of it
        ended = done | lost
        if ended.any():
            result.keep(active, x, cost, slope, curvature)
            for row in active[done]:
                result.converged[row], result.reason[row] = True, NO_LOWER
                result.iterations[row] = iteration
            for row in active[lost]:
                result.reason[row], result.iterations[row] = NO_STEP, iteration
            left = ~ended
            active = active[left]
            if len(active) == 0:
                break
            x, cost, slope, curvature = (v[left] for v in (x, cost, slope, curvature))
            mu, nu, step, predicted = (v[left] for v in (mu, nu, step, predicted))
        trial = x + step
        quadratic = model(trial, active)
        with np.errstate(invalid="ignore", over="ignore"):
            gain = (cost - quadratic.cost) / predicted
            taken = gain > 0  # never for what is no number
            easier = np.maximum(1 / 3, 1 - (2 * np.minimum(gain, 2.0) - 1) ** 3)
            mu, nu = np.where(taken, mu * easier, mu * nu), np.where(taken, 2.0, 2 * nu)
        if taken.all():
            x, cost, slope, curvature = trial, *quadratic
        else:
            x, cost = np.where(taken[:, None], trial, x), np.where(taken, quadratic.cost, cost)
            slope = np.where(taken[:, None], quadratic.gradient, slope)
            curvature = np.where(taken[:, None, None], quadratic.curvature, curvature)
    if len(active):
        result.keep(active, x, cost, slope, curvature)
    return result


def solve_rows(matrices: Matrix, right: Matrix) -> Matrix:
    """(W, f, m) of matrices (W, f, f) and right sides (W, f, m); NaN for a row whose matrix is singular."""
    try:
        return np.asarray(np.linalg.solve(matrices, right), dtype=float)
    except np.linalg.LinAlgError:
        result = np.full_like(right, np.nan)
        for row, (matrix, side) in enumerate(zip(matrices, right, strict=True)):
            try:
                result[row] = np.linalg.solve(matrix, side)
            except np.linalg.LinAlgError:
                continue
        return result
