"""Recordings: the consecutive measurements of one target, and what is left of their residuals at a fit.

The residuals r of a fit are no independent numbers even if the errors are: with whitened Jacobian A and
C = (A'A + I)^-1 their covariance is M = I - A C A'. With errors of covariance R it is M R M + A C^2 A', if
the parameters are as their priors say. With C^-1 = L L' and B = A L'^-1, the Jacobian in posterior stds, M is
I - B B', and the parts of one recording follow from its own rows of B and from B' R B. What is needed of a
long recording's covariance (its traces, its product with a vector, draws) follows from them without the
matrix, whose size grows with the square of the measurements.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...model.arrays import Index, Matrix
from ...model.likelihood.problem import Problem, Whitened
from ..estimation.fit import LikelihoodFit

_NOTHING = 1e-18  # a correlation below rounding


def by_targets(problem: Problem, whitened: Whitened) -> Matrix:
    """(N, d, 3) of the whitened residuals by their targets' coordinates in mm, held or not."""
    parameters, d = problem.parameters, problem.tool.residual_size
    own = problem.columns[:, parameters.in_shot("target")]
    jacobian = whitened.jacobian[: problem.shots * d].reshape(problem.shots, d, -1)
    by_scaled = np.take_along_axis(jacobian, np.repeat(own[:, None, :], d, axis=1), axis=2)
    return np.asarray(by_scaled / parameters.prior_std[own][:, None, :])


@dataclass(frozen=True, eq=False)
class Recording:
    """One recording: its target, its rows in the problem (n,), in the order of the file, the whitened
    residuals (n, d), their Jacobian (n d, f) by what is fitted, in posterior stds (B), and (n, d, 3) by the
    target's coordinates in mm."""

    target: str
    rows: Index
    residual: Matrix
    jacobian: Matrix
    by_target: Matrix

    @property
    def shots(self) -> int:
        return len(self.rows)


@dataclass(frozen=True, eq=False)
class Recorded:
    """All recordings of a fit, and (f, f) the information of the priors, in posterior stds."""

    every: tuple[Recording, ...]
    prior: Matrix

    def shared(self, rho: float) -> Matrix:
        """(f, f) the covariance of B'r if errors within recordings have the correlation `rho`."""
        total = self.prior.copy()
        for own in self.every:
            total += own.jacobian.T @ times_errors(own, rho)
        return total


def recording_rows(problem: Problem) -> list[Index]:
    """The places of the measurements of each recording, in the order of the file."""
    if not problem.shots:
        return []
    change = [i for i, (a, b) in enumerate(pairwise(problem.target_index.tolist()), start=1) if a != b]
    return [np.asarray(part) for part in np.split(np.arange(problem.shots), change)]


def recordings(fit: LikelihoodFit, rival: Matrix | None = None) -> Recorded:
    """The recordings of a fit, each measurement as it is (however often it counts), noise scale taken out.

    `rival` (M, g) are whitened columns of what the fit does not have but may explain the residuals too, times
    the prior stds of their parameters, such as link tolerances: they are fitted as well, by one linear step.
    """
    problem, d = fit.problem, fit.problem.tool.residual_size
    parameters, count = problem.parameters, problem.shots * d
    scale = np.ones((len(fit.whitened.residual), 1))
    scale[:count, 0] = np.sqrt(np.repeat(fit.weight / problem.weights, d))
    residual, jacobian = fit.whitened.residual * scale[:, 0], fit.whitened.jacobian * scale
    by_target = by_targets(problem, fit.whitened) * scale[:count].reshape(problem.shots, d, 1)
    columns, z = jacobian[:, parameters.free], fit.z
    if rival is not None:
        columns, z = np.hstack([columns, rival * scale]), np.append(z, np.zeros(rival.shape[1]))
    # Not by the product columns' columns: with hardly any noise the unit prior would be lost in its rounding.
    inverse = np.linalg.inv(np.linalg.qr(np.vstack([columns, np.eye(len(z))]), mode="r")).T
    by_posterior = columns @ inverse.T
    if rival is not None:
        residual = residual - by_posterior @ (by_posterior.T @ residual + inverse @ z)
    residual = residual[:count].reshape(problem.shots, d)
    by_posterior = by_posterior[:count].reshape(problem.shots, d, -1)
    every = tuple(
        Recording(
            problem.targets[problem.target_index[rows[0]]],
            rows,
            residual[rows],
            by_posterior[rows].reshape(len(rows) * d, -1),
            by_target[rows],
        )
        for rows in recording_rows(problem)
    )
    return Recorded(every, inverse @ inverse.T)


def times_errors(own: Recording, rho: float) -> Matrix:
    """(n d, f) R B of a recording: errors of variance 1, with the correlation rho^k k measurements apart."""
    if rho == 0:
        return own.jacobian
    blocks = own.jacobian.reshape(own.shots, -1)
    both = _decaying(blocks, rho) + _decaying(blocks[::-1], rho)[::-1] - blocks
    return np.asarray(both.reshape(own.jacobian.shape))


def _decaying(values: Matrix, rho: float) -> Matrix:
    """(n, …) the sums of rho^k times what is k before, over all k: by doubling."""
    total, lag, factor = values.copy(), 1, rho
    while lag < len(values) and abs(factor) > _NOTHING:
        total[lag:] += factor * total[:-lag]
        lag, factor = 2 * lag, factor**2
    return total


def traces(own: Recording, rho: float, shared: Matrix) -> tuple[float, float]:
    """The traces of the covariance of a recording's residuals: of measurements with themselves, and with
    those that follow them. `shared` is that of all recordings at `rho`."""
    d, jacobian = own.residual.shape[1], own.jacobian
    by_errors, by_shared = times_errors(own, rho), jacobian @ shared
    plain = own.shots * d - 2 * (jacobian * by_errors).sum() + (by_shared * jacobian).sum()
    following = (own.shots - 1) * d * rho
    following -= (jacobian[:-d] * by_errors[d:]).sum() + (by_errors[:-d] * jacobian[d:]).sum()
    following += (by_shared[:-d] * jacobian[d:]).sum()
    return float(plain), float(following)


def white_times(own: Recording, shared: Matrix, vector: Matrix) -> Matrix:
    """(n d,) the covariance of a recording's residuals without correlation times a vector (n d,)."""
    along = own.jacobian.T @ vector
    return np.asarray(vector + own.jacobian @ (shared @ along - 2 * along))


def covariance(own: Recording, rho: float, shared: Matrix) -> Matrix:
    """(n d, n d) of the residuals of a recording if errors have the correlation `rho`."""
    d = own.residual.shape[1]
    apart = np.abs(np.subtract.outer(np.arange(own.shots), np.arange(own.shots)))
    errors = np.kron(np.eye(own.shots) if rho == 0 else rho ** apart.astype(float), np.eye(d))
    cross = own.jacobian @ times_errors(own, rho).T
    return np.asarray(errors - cross - cross.T + own.jacobian @ shared @ own.jacobian.T, dtype=float)


def drawn(own: Recording, rho: float, shared: Matrix, count: int, rng: np.random.Generator) -> Matrix:
    """(count, n, d) residuals of a recording with that covariance, at random."""
    n, d = own.residual.shape
    errors = rng.normal(size=(n, count, d))
    errors[1:] *= np.sqrt(1 - rho**2)
    errors = _decaying(errors, rho).transpose(1, 0, 2)
    others = _root(shared - own.jacobian.T @ times_errors(own, rho))
    along = rng.normal(size=(count, len(others))) @ others.T - errors.reshape(count, n * d) @ own.jacobian
    return errors + (along @ own.jacobian.T).reshape(count, n, d)


def drawn_by_covariance(covariance: Matrix, count: int, rng: np.random.Generator) -> Matrix:
    """(count, m) normal at random with that covariance (m, m)."""
    root = _root(covariance)
    return rng.normal(size=(count, len(root))) @ root.T


def _root(covariance: Matrix) -> Matrix:
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
