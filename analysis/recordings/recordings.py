"""Recordings: the consecutive measurements of one target, and what is left of their residuals at a fit.

The residuals r of a fit are no independent numbers even if the errors are: with whitened Jacobian A and
C = (A'A + I)^-1 their covariance is M = I - A C A'. With errors of covariance R it is M R M + A C^2 A', if
the parameters are as their priors say. With C^-1 = L L' and B = A L'^-1, the Jacobian in posterior stds, M is
I - B B', and the parts of one recording follow from its own rows of B and from B' R B.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...model.kernel import Index
from ...model.problem import Problem, Whitened
from ...model.robot import Matrix
from ..estimation.fit import LikelihoodFit


def by_targets(problem: Problem, whitened: Whitened) -> Matrix:
    """(N, d, 3) of the whitened residuals by their targets' coordinates in mm, held or not."""
    parameters, d = problem.parameters, problem.tool.miss_size
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
    problem, d = fit.problem, fit.problem.tool.miss_size
    parameters, count = problem.parameters, problem.shots * d
    scale = np.ones((len(fit.whitened.residual), 1))
    scale[:count, 0] = np.sqrt(np.repeat(fit.weight / problem.weights, d))
    residual, jacobian = fit.whitened.residual * scale[:, 0], fit.whitened.jacobian * scale
    by_target = by_targets(problem, fit.whitened) * scale[:count].reshape(problem.shots, d, 1)
    columns, z = jacobian[:, parameters.free], fit.z
    if rival is not None:
        columns, z = np.hstack([columns, rival * scale]), np.append(z, np.zeros(rival.shape[1]))
    inverse = np.linalg.inv(np.linalg.cholesky(columns.T @ columns + np.eye(len(z))))
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


def correlated(shots: int, d: int, rho: float) -> Matrix:
    """(n d, n d) the covariance of errors of variance 1 with the correlation rho^k k measurements apart."""
    apart = np.abs(np.subtract.outer(np.arange(shots), np.arange(shots)))
    own = np.eye(shots) if rho == 0 else rho ** apart.astype(float)
    return np.asarray(np.kron(own, np.eye(d)), dtype=float)


def covariances(recorded: Recorded, rho: float) -> list[Matrix]:
    """(n d, n d) of the residuals of each recording if errors within recordings have the correlation rho."""
    shared = recorded.prior.copy()
    own_errors = []
    for own in recorded.every:
        errors = correlated(own.shots, own.residual.shape[1], rho)
        shared += own.jacobian.T @ errors @ own.jacobian
        own_errors.append(errors)
    result = []
    for own, errors in zip(recorded.every, own_errors, strict=True):
        cross = own.jacobian @ (own.jacobian.T @ errors)
        result.append(errors - cross - cross.T + own.jacobian @ shared @ own.jacobian.T)
    return result
