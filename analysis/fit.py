"""The likelihood fit: the posterior's mode (MAP), its covariance, and other basins if there are any."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..model.problem import Problem, Whitened
from ..model.robot import Matrix
from .coordinates import SeenCoordinates
from .levenberg_marquardt import levenberg_marquardt

_REFRESHES = 30
_POLISH = 60
_FLAT = 1e-3  # curvature, as a share of Gauss-Newton's, below which a direction is no ridge to trust
_DIFFERENCE = 1e-3  # step of the differences, in posterior stds
_CONVERGED = 1e-4  # size of the gradient, in posterior stds
_SAME_BASIN = 0.5  # posterior stds: two modes nearer than this are one
_WORTH_TELLING = 12.0  # log-posterior units: a basin further down carries less than 1e-5 of the mass


@dataclass(frozen=True, eq=False)
class LikelihoodFit:
    """The mode and what surrounds it.

    `x` (p,) internal units; `z` (f,) the free parameters scaled by their priors; `covariance` (f, f) of
    z from the curvature of the log-posterior there; `weight` 1 / noise scale^2; `whitened` the residuals
    at x; `gradient` the size of the log-posterior's gradient in posterior stds.
    """

    x: Matrix
    z: Matrix
    covariance: Matrix
    weight: float
    whitened: Whitened
    log_posterior: float
    gradient: float
    iterations: int
    converged: bool
    reason: str
    other_basins: int

    @property
    def std(self) -> Matrix:
        """(f,) of the free parameters, scaled by their priors."""
        return np.sqrt(np.diag(self.covariance))


def fit_likelihood(problem: Problem, *, starts: int = 8, seed: int = 0) -> LikelihoodFit:
    """Fit from zero offsets and from `starts` further points drawn from the priors; the best mode wins."""
    rng = np.random.default_rng(seed)
    climb = _Climb(problem)
    size = int(problem.parameters.free.sum())
    best = climb.from_start(np.zeros(size))
    others: list[LikelihoodFit] = []
    for _ in range(starts):
        found = climb.from_start(rng.normal(size=size), best)
        if not found.converged or found is best:
            continue
        if not best.converged or found.log_posterior > best.log_posterior + 1e-6:
            best, found = found, best
        others.append(found)
    basins: list[LikelihoodFit] = []
    for found in others:
        if not found.converged or found.log_posterior < best.log_posterior - _WORTH_TELLING:
            continue
        if all(_apart(found, known) for known in [best, *basins]):
            basins.append(found)
    return replace(best, other_basins=len(basins))


def start_at(problem: Problem, z: Matrix) -> Matrix:
    """x (p,) with the free offsets and tool at z (f,) and each target nearest to its beams there."""
    parameters = problem.parameters
    x = parameters.prior_mean.copy()
    x[parameters.free] += z * parameters.prior_std[parameters.free]
    delta, _, tool = problem.split(x)
    targets = parameters.group("target")
    nearest = problem.nearest_targets(delta, tool).reshape(-1)
    x[targets] = np.where(parameters.free[targets], nearest, parameters.prior_mean[targets])
    return x


def information(problem: Problem, x: Matrix, weight: float) -> Matrix:
    """(f, f) Gauss-Newton information of the scaled free parameters at x, the unit prior included."""
    rows = problem.shots * problem.tool.miss_size
    jacobian = problem.whiten(x).jacobian[:, problem.parameters.free]
    data, distances = jacobian[:rows], jacobian[rows:]
    return weight * data.T @ data + distances.T @ distances + np.eye(jacobian.shape[1])


def unbiased_weight(problem: Problem, x: Matrix) -> float:
    """1 / noise scale^2 at x: 1 for known noise, else (residuals - what they determine) / chi^2."""
    if not problem.noise.estimated:
        return 1.0
    rows = problem.shots * problem.tool.miss_size
    whitened = problem.whiten(x)
    data = whitened.jacobian[:rows, problem.parameters.free]
    mode_weight = problem.noise_weight(x)
    covariance = np.linalg.inv(information(problem, x, mode_weight))
    determined = mode_weight * float(np.einsum("ij,jk,ik->", data, covariance, data))
    chi2 = float(whitened.residual[:rows] @ whitened.residual[:rows])
    return max(rows - determined, 1e-3) / chi2


def _apart(a: LikelihoodFit, b: LikelihoodFit) -> bool:
    return not _same_basin(a.z, b.z, np.maximum(a.std, b.std))


def _same_basin(a: Matrix, b: Matrix, std: Matrix) -> bool:
    return bool((np.abs(a - b) <= _SAME_BASIN * std).all())


def _uphill(curvature: Matrix, slope: Matrix) -> Matrix:
    """Newton's step (f,), turned uphill along every direction in which the curvature is of the wrong sign."""
    values, vectors = np.linalg.eigh(curvature)
    step: Matrix = vectors @ (vectors.T @ slope / np.maximum(np.abs(values), _FLAT))
    return step


class _Climb:
    """One way up: Levenberg-Marquardt with refreshed weights, then Newton on the exact log-posterior."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._free = problem.parameters.free
        self._coordinates = SeenCoordinates(problem)

    def from_start(self, z: Matrix, known: LikelihoodFit | None = None) -> LikelihoodFit:
        """The mode above z (f,), or `known` itself where the way leads to the foot of it."""
        v = self._coordinates.from_parameters(start_at(self._problem, z))
        iterations, damping = 0, 1e-3
        converged, reason = False, f"the weights did not settle in {_REFRESHES} refreshes"
        for _ in range(_REFRESHES):
            found = levenberg_marquardt(self._residual(v), v, damping=damping, tolerance=1e-10)
            moved = float(np.abs(found.x - v).max(initial=0.0))
            iterations, damping, v = iterations + found.iterations, 1e-9, found.x
            if not found.converged:
                reason = found.reason
                break
            if moved < 1e-4:
                converged, reason = True, "the weights settled"
                break
        if known is not None and known.converged and _same_basin(self._z(self._x(v)), known.z, known.std):
            return known
        return self._polished(v, iterations, converged, reason)

    def _residual(self, at: Matrix) -> Callable[[Matrix], tuple[Matrix, Matrix]]:
        """Residuals and Jacobian by v, priors included, with the weights of `at` kept."""
        problem = self._problem
        x = self._x(at)
        factor = problem.whiten(x).factor
        rows = np.arange(problem.data_size) < problem.shots * problem.tool.miss_size
        root = np.where(rows, np.sqrt(problem.noise_weight(x)), 1.0)

        def residual(v: Matrix) -> tuple[Matrix, Matrix]:
            x = self._x(v)
            whitened = problem.whiten(x, factor)
            z = self._z(x)
            by_v = self._coordinates.jacobian(x)
            data = (whitened.jacobian[:, self._free] * root[:, None]) @ by_v
            return np.concatenate([whitened.residual * root, z]), np.concatenate([data, by_v])

        return residual

    def _polished(self, v: Matrix, iterations: int, converged: bool, reason: str) -> LikelihoodFit:
        """Newton's steps on the exact log-posterior, log det included, in whitened coordinates."""
        x = self._x(v)
        by_v = self._coordinates.jacobian(x)
        gauss_newton = by_v.T @ information(self._problem, x, self._problem.noise_weight(x)) @ by_v
        root = np.linalg.cholesky(np.linalg.inv(gauss_newton))
        value, slope = self._value(v), self._slope(v, root)
        curvature = self._curvature(v, root)
        for _ in range(_POLISH):
            if np.linalg.norm(slope) < 1e-3 * _CONVERGED:
                break
            step, length = root @ _uphill(curvature, slope), 1.0
            while length > 1e-4:
                trial = v + length * step
                trial_value, trial_slope = self._value(trial), self._slope(trial, root)
                # Near the top the values differ by rounding only: there the slope decides.
                if trial_value > value or np.linalg.norm(trial_slope) < 0.5 * np.linalg.norm(slope) < 1e-3:
                    break
                length /= 4
            else:
                break
            slow = np.linalg.norm(trial_slope) > 0.1 * np.linalg.norm(slope)
            v, value, slope = trial, trial_value, trial_slope
            if slow:
                curvature = self._curvature(v, root)
            iterations += 1
        size = float(np.linalg.norm(slope))
        if size < _CONVERGED:
            converged, reason = True, f"the gradient is {size:.1e} posterior standard deviations"
        elif converged:
            converged, reason = False, f"the gradient stays at {size:.1e} posterior standard deviations"
        curvature = self._curvature(v, root)
        if np.linalg.eigvalsh(curvature).min() <= _FLAT:  # no maximum: Gauss-Newton's stands in
            curvature = np.eye(len(v))
        return self._fit(v, root @ np.linalg.inv(curvature) @ root.T, size, iterations, converged, reason)

    def _fit(
        self, v: Matrix, covariance: Matrix, gradient: float, iterations: int, converged: bool, reason: str
    ) -> LikelihoodFit:
        problem = self._problem
        x = self._x(v)
        by_v = self._coordinates.jacobian(x)
        weight = unbiased_weight(problem, x)
        return LikelihoodFit(
            x=x,
            z=self._z(x),
            covariance=by_v @ covariance @ by_v.T * (problem.noise_weight(x) / weight),
            weight=weight,
            whitened=problem.whiten(x),
            log_posterior=self._value(v),
            gradient=gradient,
            iterations=iterations,
            converged=converged,
            reason=reason,
            other_basins=0,
        )

    def _x(self, v: Matrix) -> Matrix:
        return np.asarray(self._coordinates.to_parameters(v[None])[0])

    def _z(self, x: Matrix) -> Matrix:
        parameters = self._problem.parameters
        return np.asarray(((x - parameters.prior_mean) / parameters.prior_std)[self._free])

    def _value(self, v: Matrix) -> float:
        x = self._x(v)[None]
        return float(self._problem.log_likelihood(x)[0] + self._problem.log_prior(x)[0])

    def _slope(self, v: Matrix, root: Matrix) -> Matrix:
        """(f,) gradient of the log-posterior in the coordinates w of v = v0 + root w."""
        x = self._x(v)
        slope: Matrix = root.T @ (self._coordinates.jacobian(x).T @ self._problem.gradient(x)[self._free])
        return slope

    def _curvature(self, v: Matrix, root: Matrix) -> Matrix:
        """(f, f) negative Hessian in the coordinates w, by central differences of the exact gradient."""
        rows = [
            self._slope(v - _DIFFERENCE * c, root) - self._slope(v + _DIFFERENCE * c, root) for c in root.T
        ]
        hessian = np.array(rows) / (2 * _DIFFERENCE)
        return np.asarray((hessian + hessian.T) / 2)
