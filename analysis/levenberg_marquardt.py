"""Levenberg-Marquardt with gain-ratio damping (Madsen, Nielsen & Tingleff 2004, algorithm 3.16)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from ..model.robot import Matrix

ResidualAndJacobian = Callable[[Matrix], tuple[Matrix, Matrix]]


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where the minimisation of |r(x)|^2 / 2 ended; not converging is a value, not an exception.

    `gradient` is the largest component of J'r at x, `reason` says why it stopped.
    """

    x: Matrix
    cost: float
    gradient: float
    iterations: int
    converged: bool
    reason: str


def levenberg_marquardt(
    function: ResidualAndJacobian,
    start: Matrix,
    *,
    max_iterations: int = 200,
    damping: float = 1e-3,
    tolerance: float = 1e-14,
) -> Minimum:
    """Minimise |r|^2 / 2 from `start` (p,); `function` gives r (M,) and its Jacobian (M, p).

    The step solves (J'J + mu D) h = -J'r with D the diagonal of J'J, so that it changes with no unit
    (eq. 9 of the paper has D = I, and Omega there must be the residual vector). It ends where the step
    promises to lower the cost by less than `tolerance` of it; `damping` is the first mu.
    """
    x = start.copy()
    residual, jacobian = function(x)
    cost = float(residual @ residual) / 2
    if not np.isfinite(cost):
        return Minimum(x, cost, float("inf"), 0, False, "the cost is not finite at the start")
    normal, gradient = jacobian.T @ jacobian, jacobian.T @ residual
    mu, nu = damping, 2.0
    for iteration in range(max_iterations):
        size = float(np.abs(gradient).max(initial=0.0))
        diagonal = np.maximum(normal.diagonal(), 1e-300)
        try:
            step = -cho_solve(cho_factor(normal + np.diag(mu * diagonal)), gradient)
        except LinAlgError:
            mu, nu = mu * nu, 2 * nu
            continue
        predicted = float(step @ (mu * diagonal * step - gradient)) / 2
        if predicted <= tolerance * cost + 1e-300:
            return Minimum(x, cost, size, iteration, True, "no step lowers the cost any more")
        trial = x + step
        trial_residual, trial_jacobian = function(trial)
        trial_cost = float(trial_residual @ trial_residual) / 2
        gain = (cost - trial_cost) / predicted if np.isfinite(trial_cost) else -1.0
        if gain > 0:
            x, residual, jacobian, cost = trial, trial_residual, trial_jacobian, trial_cost
            normal, gradient = jacobian.T @ jacobian, jacobian.T @ residual
            mu, nu = mu * max(1 / 3, 1 - (2 * gain - 1) ** 3), 2.0
        else:
            mu, nu = mu * nu, 2 * nu
            if not np.isfinite(mu):
                break
    size = float(np.abs(gradient).max(initial=0.0))
    return Minimum(x, cost, size, max_iterations, False, f"no convergence in {max_iterations} iterations")
