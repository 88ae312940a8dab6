"""The tolerances of the geometry from the data: a factor for all lengths and one for all angles.

The factors are those of the largest marginal likelihood, all other parameters integrated out by Laplace's
formula (type II maximum likelihood: MacKay 1992), with a wide prior on their logarithms, since a few links
do not tell much. What they leave open goes into the covariance of all parameters.

Near the mode the residuals are linear, so that the marginal likelihood of any factors follows from one
Jacobian; the fit is repeated at the factors that are found until they stay.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from ...model.arrays import Matrix
from ...model.likelihood.geometry import ANGLES
from ...model.likelihood.problem import Problem
from .fit import LikelihoodFit, fit_from

_PRIOR_STD = 1.0  # of the logarithm of a factor: 95 % between 1/7 and 7
_STEP = 0.1  # of the logarithms, for differences
_ROUNDS = 10
_SETTLED = 0.01


@dataclass(frozen=True)
class Factors:
    """By what the data multiply the stated tolerances, with the standard uncertainty of each logarithm."""

    length: float
    angle: float
    log_u: tuple[float, float]


def with_factors(fit: LikelihoodFit) -> tuple[LikelihoodFit, Factors]:
    """The fit with its tolerances at the factors that the data make likeliest, their uncertainty included."""
    nominal = fit.problem.geometry
    at = np.zeros(2)
    for _ in range(_ROUNDS):
        near = _Linear(fit, at)
        logarithms = scipy.optimize.minimize(
            lambda trial, near=near: -near.log_evidence(trial), at, method="BFGS", options={"eps": 1e-4}
        ).x
        moved, at = float(np.abs(logarithms - at).max()), logarithms
        fit = fit_from(fit.problem.with_geometry(nominal.scaled(*np.exp(at).tolist())), fit.x)
        if moved < _SETTLED or not fit.converged:
            break
    length, angle = np.exp(at).tolist()
    log_u = np.sqrt(np.diag(np.linalg.inv(_Linear(fit, at).curvature(at))))
    factors = Factors(length, angle, (float(log_u[0]), float(log_u[1])))
    return with_open_factors(fit, factors), factors


def with_open_factors(fit: LikelihoodFit, factors: Factors) -> LikelihoodFit:
    """The fit, its tolerances being those times `factors`, with what the factors leave open in its
    covariance."""
    at = np.log([factors.length, factors.angle])
    near = _Linear(fit, at)
    by_factors = near.slopes(at)
    spread = np.linalg.inv(near.curvature(at))
    return replace(fit, covariance=fit.covariance + by_factors @ spread @ by_factors.T)


class _Linear:
    """The marginal likelihood near a fit, whose tolerances have the factors of the logarithms `at` (2,)."""

    def __init__(self, fit: LikelihoodFit, at: Matrix) -> None:
        problem, root = fit.problem, np.sqrt(fit.weight)
        free = problem.parameters.free
        rows = problem.shots * problem.tool.residual_size
        jacobian, residual = fit.whitened.jacobian[:, free].copy(), fit.whitened.residual.copy()
        jacobian[:rows] *= root
        residual[:rows] *= root
        self._at, self._z = at, fit.z
        self._information = jacobian.T @ jacobian
        self._slope = jacobian.T @ residual
        self._kinds = _kinds(problem)

    def _step(self, at: Matrix) -> tuple[Matrix, Matrix, Matrix, Matrix]:
        """(f,) from the mode of the fit to that of other factors; with them half the slope where it starts
        (f,), the information (f, f) and the prior precision (f,); in the units of the fit."""
        precision = np.exp(-2 * (self._kinds @ (at - self._at)))
        information = self._information + np.diag(precision)
        slope = self._slope + precision * self._z
        return -np.linalg.solve(information, slope), slope, information, precision

    def log_evidence(self, at: Matrix) -> float:
        """With the prior of the factors, up to a constant."""
        step, slope, information, precision = self._step(at)
        drop = float(-(slope @ step) - (precision * self._z) @ self._z)
        log_det = float(np.log(precision).sum() - np.linalg.slogdet(information)[1])
        return (drop + log_det - float((at**2).sum()) / _PRIOR_STD**2) / 2

    def slopes(self, at: Matrix) -> Matrix:
        """(f, 2) of the mode by the logarithms, in the units of the fit."""
        ends = [(self._step(at + step)[0], self._step(at - step)[0]) for step in _STEP * np.eye(2)]
        return np.array([(up - down) / (2 * _STEP) for up, down in ends]).T

    def curvature(self, at: Matrix) -> Matrix:
        """(2, 2) of the negative log evidence; what the data do not tell has that of the prior."""
        steps = _STEP * np.eye(2)
        signs = ((1, 1), (1, -1), (-1, 1), (-1, -1))
        mixed = np.array(
            [
                [
                    sum(p * q * self.log_evidence(at + p * one + q * other) for p, q in signs)
                    for other in steps
                ]
                for one in steps
            ]
        )
        values, vectors = np.linalg.eigh(-mixed / (4 * _STEP**2))
        return np.asarray((vectors * np.maximum(values, 1 / _PRIOR_STD**2)) @ vectors.T)


def _kinds(problem: Problem) -> Matrix:
    """(f, 2) 1 where a free parameter is a length of a link, and where it is an angle of one."""
    items = [item for item in problem.parameters.items if not item.held]
    lengths = [item.of.startswith("link") and item.axis not in ANGLES for item in items]
    angles = [item.of.startswith("link") and item.axis in ANGLES for item in items]
    of_geometry = np.array([item.group == "geometry" for item in items])
    return np.stack([of_geometry & np.array(lengths), of_geometry & np.array(angles)], axis=1).astype(float)
