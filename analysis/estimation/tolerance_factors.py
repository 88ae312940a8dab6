"""The tolerances of the geometry from the data: a factor for all lengths, one for all angles, one for gravity
and one for harmonics.

The factors are those of the largest marginal likelihood, all other parameters integrated out by Laplace's
formula (type II maximum likelihood: MacKay 1992). A few measurements do not separate the factors, but show
whether the whole arm is better or worse than stated: so each is one of the whole arm times one of its group,
both of lognormal prior. What they leave open goes into the covariance of all parameters. The mounting of a
tool stays as stated: its maker is another.

Near the mode the residuals are linear, so that the marginal likelihood of any factors follows from one
Jacobian; the fit is repeated at the factors that are found until they stay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
import scipy

from ...model.arrays import Matrix
from ...model.files.header import GeometryKind
from ...model.likelihood.geometry import kind_of_axis
from ...model.likelihood.problem import Problem
from .fit import LikelihoodFit, fit_from

_OF_ARM = 0.7  # prior std of the logarithm of the whole arm's factor: 95 % between 1/4 and 4
_OF_GROUP = 0.5  # of a group's beside it: 95 % between 3/8 and 8/3
_STEP = 0.1  # of the coordinates of the factors, for differences
_ROUNDS = 10
_SETTLED = 0.01


@dataclass(frozen=True)
class Factors:
    """By what the data multiply the stated tolerances, None where nothing of a kind is estimated; `log_u` has
    the standard uncertainty of each logarithm."""

    length: float | None
    angle: float | None
    gravity: float | None
    harmonics: float | None
    log_u: tuple[float | None, ...]

    def by_kind(self) -> dict[str, float]:
        """Of each kind that is estimated, as people call it."""
        every = (self.length, self.angle, self.gravity, self.harmonics)
        return {name: factor for name, factor in zip(KINDS, every, strict=True) if factor is not None}


KINDS = ("lengths", "angles", "gravity", "harmonics")  # in the order of GeometryKind


def with_factors(fit: LikelihoodFit) -> tuple[LikelihoodFit, Factors | None]:
    """The fit with its tolerances at the factors that the data make likeliest, their uncertainty included; no
    factors where no tolerance is estimated."""
    nominal, kinds = fit.problem.geometry, _kinds(fit.problem)
    present, root = kinds.any(axis=0), _prior_root(kinds)
    at = np.zeros(root.shape[1])
    if not len(at):
        return fit, None
    for _ in range(_ROUNDS):
        near = _Linear(fit, at)
        coordinates = scipy.optimize.minimize(
            lambda trial, near=near: -near.log_evidence(trial), at, method="BFGS", options={"eps": 1e-4}
        ).x
        moved, at = float(np.abs(root @ (coordinates - at)).max()), coordinates
        fit = fit_from(fit.problem.with_geometry(nominal.scaled(*np.exp(root @ at).tolist())), fit.x)
        if moved < _SETTLED or not fit.converged:
            break
    spread = root @ np.linalg.inv(_Linear(fit, at).curvature(at)) @ root.T
    logarithms, log_u = root @ at, np.sqrt(np.diag(spread))
    there = np.flatnonzero(present).tolist()
    values = {k: math.exp(logarithms[k]) for k in there}
    u = {k: float(log_u[k]) for k in there}
    factors = Factors(
        values.get(0), values.get(1), values.get(2), values.get(3), tuple(u.get(k) for k in range(len(KINDS)))
    )
    return with_open_factors(fit, factors), factors


def with_open_factors(fit: LikelihoodFit, factors: Factors) -> LikelihoodFit:
    """The fit, its tolerances being those times `factors`, with what the factors leave open in its
    covariance."""
    kinds = _kinds(fit.problem)
    logarithms = np.log([factors.by_kind().get(kind, 1.0) for kind in KINDS])
    at = np.asarray(np.linalg.pinv(_prior_root(kinds)) @ logarithms, dtype=np.float64)
    return replace(fit, covariance=fit.covariance + _Linear(fit, at).open_covariance(at))


class _Linear:
    """The marginal likelihood near a fit whose tolerances have the factors at the coordinates `at` (k,), each
    of the prior N(0, 1)."""

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
        kinds = _kinds(problem)
        self._logarithms = kinds @ _prior_root(kinds)

    def _step(self, at: Matrix) -> tuple[Matrix, Matrix, Matrix, Matrix]:
        """(f,) from the mode of the fit to that of other factors; with them half the slope where it starts
        (f,), the information (f, f) and the prior precision (f,); in the units of the fit."""
        precision = np.exp(-2 * (self._logarithms @ (at - self._at)))
        information = self._information + np.diag(precision)
        slope = self._slope + precision * self._z
        return -np.linalg.solve(information, slope), slope, information, precision

    def log_evidence(self, at: Matrix) -> float:
        """With the prior of the factors, up to a constant."""
        step, slope, information, precision = self._step(at)
        drop = float(-(slope @ step) - (precision * self._z) @ self._z)
        log_det = float(np.log(precision).sum() - np.linalg.slogdet(information)[1])
        return (drop + log_det - float((at**2).sum())) / 2

    def open_covariance(self, at: Matrix) -> Matrix:
        """(f, f) by how much the total variance over the factors exceeds the variance at these, in the units
        of the fit: the mean of the variances and the spread of the modes, each at 2 k points (cubature:
        Arasaratnam and Haykin 2009). A variance grows with the square of a factor, so that its mean is more
        than that at the mean of the logarithm."""
        root = np.linalg.cholesky(np.linalg.inv(self.curvature(at))) * np.sqrt(len(at))
        middle, _, information, _ = self._step(at)
        added = -np.linalg.inv(information)
        for away in [*root.T, *-root.T]:
            step, _, information, _ = self._step(at + away)
            moved = step - middle
            added = added + (np.linalg.inv(information) + np.outer(moved, moved)) / (2 * len(at))
        values, vectors = np.linalg.eigh((added + added.T) / 2)
        return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)

    def curvature(self, at: Matrix) -> Matrix:
        """(k, k) of the negative log evidence; what the data do not tell has that of the prior."""
        steps = _STEP * np.eye(len(at))
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
        return np.asarray((vectors * np.maximum(values, 1.0)) @ vectors.T)


def _kinds(problem: Problem) -> Matrix:
    """(f, 4) 1 where a free parameter is a length of a link, an angle of one, of gravity, of harmonics."""
    items = [item for item in problem.parameters.items if not item.held]
    kinds = [kind_of_axis(item.axis) if item.group == "geometry" else None for item in items]
    return np.array([[float(kind == each) for each in get_args(GeometryKind)] for kind in kinds])


def _prior_root(kinds: Matrix) -> Matrix:
    """(4, k) the logarithms of the factors by coordinates of the prior N(0, 1): of the k kinds that are
    estimated, the others are 0."""
    present = np.flatnonzero(kinds.any(axis=0))
    covariance = _OF_ARM**2 + _OF_GROUP**2 * np.eye(len(present))
    root = np.zeros((len(KINDS), len(present)))
    root[present] = np.linalg.cholesky(covariance)
    return root
