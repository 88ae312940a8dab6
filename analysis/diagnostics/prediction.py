"""Measurements predicted by a fit that has not seen them, with what noise and fit let one expect.

All that the fit has is carried over by name; what it lacks (the coordinates of targets of which it has no
measurement) is placed: estimated from the predicted measurements themselves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from ...model.arrays import Mask, Matrix
from ...model.likelihood.parameters import Parameters
from ...model.likelihood.problem import Problem

_ROUNDS = 20


@dataclass(frozen=True, eq=False)
class HeldOutResiduals:
    """N measurements as predicted: their residuals (N, d), and the squared lengths (N,) mm^2 to expect, as
    `Problem.length_squares` takes them. Of the angles that are read `rms_deg` and `expected_deg` are the root
    mean squares, None where none is.

    `by_noise` by the noise once all is placed, `by_fit` by the uncertainty of what was carried over; `noise`
    is that of a measurement with nothing placed. `chi2` of the residuals against both together, `dof` the
    numbers less the rank of what was placed.
    """

    residual_mm: Matrix
    by_noise: Matrix
    by_fit: Matrix
    noise: Matrix
    chi2: float
    dof: int
    rms_deg: float | None
    expected_deg: float | None

    @property
    def expected(self) -> Matrix:
        """(N,) mm^2 the expected squared lengths of the residuals."""
        return self.by_noise + self.by_fit


def predicted(
    problem: Problem, fitted: Parameters, x: Matrix, covariance: Matrix, weight: float
) -> HeldOutResiduals:
    """The measurements of `problem` by a fit of the parameters `fitted`: its mode `x`, the `covariance` of
    its scaled free parameters, and `weight` 1 / noise scale^2. Parameters of one name have one prior in both.

    Generalised least squares with the covariance S = I / weight + B C B' of what is left at the best places,
    B the Jacobian by all that is carried over and C its covariance (Seber & Lee, Linear Regression Analysis,
    2003, section 3.10), solved as an ordinary one by the rows of C's root.
    """
    parameters = problem.parameters
    at = carried_over(problem, fitted, x, weight)
    whitened = problem.whiten(at)
    d = problem.tool.residual_size
    rows = problem.shots * d
    scale = _row_scale(problem, weight)
    residual, jacobian = whitened.residual * scale, whitened.jacobian * scale[:, None]
    by_place = jacobian[:, _placed(problem, fitted)]
    common = set(parameters.names)
    free = [item.name for item in fitted.items if not item.held and item.name in common]
    among = fitted.among_free[[fitted.index(name) for name in free]]
    values, vectors = np.linalg.eigh(covariance[np.ix_(among, among)])
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    by_rest = jacobian[:, [parameters.index(name) for name in free]] @ root
    # Only what is carried over has a prior here: the places are free.
    prior = np.hstack([np.zeros((len(free), by_place.shape[1])), np.eye(len(free))])
    columns = np.vstack([np.hstack([by_place, by_rest]), prior])
    whole = np.append(residual, np.zeros(len(free)))
    left = whole - columns @ np.linalg.lstsq(columns, whole, rcond=None)[0]
    rank = int(np.linalg.matrix_rank(by_place)) if by_place.size else 0
    basis = np.linalg.svd(by_place, full_matrices=False)[0][:, :rank]
    noise = whitened.factor / np.sqrt(weight)
    placed = basis[:rows].reshape(problem.shots, d, -1)
    rest = (by_rest - basis @ (basis.T @ by_rest))[:rows] / scale[:rows, None]
    rest = (whitened.factor @ rest.reshape(problem.shots, d, -1)) / np.sqrt(problem.weights)[:, None, None]

    def lengths(columns: Matrix) -> Matrix:
        return problem.length_squares((columns**2).sum(axis=2))

    whole_noise = lengths(noise)
    parts = [(columns**2).sum(axis=2) for columns in (noise, noise @ placed, rest)]
    components = np.maximum(parts[0] - parts[1], 0.0) + parts[2]
    return HeldOutResiduals(
        residual_mm=whitened.residual_mm,
        by_noise=np.maximum(whole_noise - lengths(noise @ placed), 0.0),
        by_fit=lengths(rest),
        noise=whole_noise,
        chi2=float(left @ left),
        dof=max(problem.measured_size - rank, 0),
        rms_deg=problem.rms_deg(whitened.residual_mm),
        expected_deg=problem.angle_deg(components),
    )


def p_value(fitted: Problem, chi2: float, dof: int) -> float:
    """Of chi-squared; by F where the noise scale is estimated from the measurements fitted."""
    free = fitted.data_size - int(fitted.parameters.free.sum())
    if not fitted.noise.estimated or free <= 0:
        return float(scipy.special.chdtrc(dof, chi2))
    return float(scipy.special.fdtrc(dof, free, chi2 / dof))


def carried_over(problem: Problem, fitted: Parameters, x: Matrix, weight: float) -> Matrix:
    """(p,) of `problem`: the values `x` of the parameters `fitted` by name, and all else placed."""
    parameters, start = problem.parameters, problem.nominal()
    common = [name for name in fitted.names if name in set(parameters.names)]
    start[[parameters.index(name) for name in common]] = x[[fitted.index(name) for name in common]]
    return settled(problem, start, weight, _placed(problem, fitted))


def settled(problem: Problem, x: Matrix, weight: float, moved: Mask) -> Matrix:
    """x (p,) with what is `moved` (p,) where residuals and distances are best met."""
    parameters, scale = problem.parameters, _row_scale(problem, weight)
    x = x.copy()
    if not moved.any():
        return x
    for _ in range(_ROUNDS):
        whitened = problem.whiten(x)
        columns = np.vstack([whitened.jacobian[:, moved] * scale[:, None], np.eye(int(moved.sum()))])
        z = (x - parameters.prior_mean)[moved] / parameters.prior_std[moved]
        step = -np.linalg.lstsq(columns, np.append(whitened.residual * scale, z), rcond=None)[0]
        x[moved] += step * parameters.prior_std[moved]
        if np.abs(step).max(initial=0.0) < 1e-12:
            break
    return x


def _placed(problem: Problem, fitted: Parameters) -> Mask:
    """(p,) True for what is free and not among the parameters of the fit."""
    carried = set(fitted.names)
    missing = np.array([name not in carried for name in problem.parameters.names], dtype=bool)
    return np.asarray(problem.parameters.free & missing)


def _row_scale(problem: Problem, weight: float) -> Matrix:
    """(M,) what multiplies whitened rows: the noise scale is that of measurements, not of distances."""
    rows = problem.shots * problem.tool.residual_size
    return np.append(np.full(rows, np.sqrt(weight)), np.ones(len(problem.ties)))
