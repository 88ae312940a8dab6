"""What a calibration with nominal geometry is worth if the arm has tolerances: consider analysis.

The estimate that takes the geometry as nominal is not changed; its uncertainty gets what the deviations of
the links do to it (Schmidt 1966; Bierman 1977, chapter 8):

    P_c = P + G C_g G',  G = -P H' R^-1 H_g

with P its stated covariance, H and H_g the Jacobians by what is estimated and by the geometry, and C_g the
tolerances. It costs one Jacobian, and needs no measurement: a plan's is known before.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ...model.arrays import Matrix
from ...model.likelihood.geometry import Geometry
from ...model.likelihood.problem import Problem

TYPICAL_MM, TYPICAL_DEG = 0.3, 0.1  # of the links of industrial arms, as measured on ten of them


def with_links(problem: Problem, x: Matrix) -> tuple[Problem, Matrix]:
    """The problem with the geometry that it states, or with typical tolerances of the links where it states
    none; and x (p,) there."""
    if len(problem.tolerated):
        return problem, x
    whole = problem.with_geometry(Geometry.of_links(problem.robot, TYPICAL_MM, TYPICAL_DEG))
    return whole, whole.parameters.with_values(whole.parameters.prior_mean, problem.parameters, x)


def link_columns(problem: Problem, x: Matrix) -> Matrix | None:
    """(M, g) what links of typical tolerances do to the whitened residuals at x (p,), each by one std; None
    where the geometry is estimated: there it is no rival of other explanations."""
    if len(problem.tolerated):
        return None
    whole, jacobian = _with_links_whitened(problem, x.tobytes())
    return jacobian[:, whole.tolerated]


@lru_cache(maxsize=1)  # of one run it is asked for several times
def _with_links_whitened(problem: Problem, x: bytes) -> tuple[Problem, Matrix]:
    """The problem of `with_links`, and (M, p) its whitened Jacobian."""
    whole, at = with_links(problem, np.frombuffer(x))
    jacobian = whole.whiten(at).jacobian
    jacobian.flags.writeable = False
    return whole, jacobian


def considered(problem: Problem, x: Matrix, weight: float = 1.0) -> Matrix:
    """(p,) std at x (p,), internal units, of the estimates that take the geometry as nominal, if the arm has
    the tolerances of `with_links`; nan of what is held, of noise factors and of the geometry itself. `weight`
    is 1 / noise scale^2."""
    parameters = problem.parameters
    whole, jacobian = _with_links_whitened(problem, x.tobytes())
    own, jacobian = whole.parameters, jacobian.copy()
    jacobian[: problem.shots * problem.tool.residual_size] *= np.sqrt(weight)
    estimated = own.free & ~own.group("geometry") & ~own.group("noise")
    by_own, by_geometry = jacobian[:, estimated], jacobian[:, whole.tolerated]
    covariance = np.linalg.inv(by_own.T @ by_own + np.eye(by_own.shape[1]))
    moved = covariance @ (by_own.T @ by_geometry)
    std = np.sqrt(np.diag(covariance) + (moved**2).sum(axis=1)) * own.prior_std[estimated]
    result = np.full(len(parameters), np.nan)
    result[parameters.free & ~parameters.group("geometry") & ~parameters.group("noise")] = std
    return result


def tolerance_share(problem: Problem, covariance: Matrix) -> Matrix:
    """(f,) the share of each variance of the scaled free parameters, covariance (f, f), that the tolerances
    of the geometry set: C L C over C, with their part L of the prior information. At most 1: where noise or
    factors of the tolerances are estimated, C is not the inverse of information and prior to the last digit.
    """
    at = problem.parameters.among_free[problem.tolerated]
    return np.asarray(np.minimum((covariance[:, at] ** 2).sum(axis=1) / np.diag(covariance), 1.0))


def with_tolerances(problem: Problem, covariance: Matrix, factor: float) -> Matrix:
    """(f,) the stds of the scaled free parameters, were all tolerances `factor` times as large.

    All nan where there is no such answer: at the mode of a model that does not describe the data the
    curvature may be less than that of the prior alone.
    """
    information = np.linalg.inv(covariance)
    at = problem.parameters.among_free[problem.tolerated]
    information[at, at] += 1 / factor**2 - 1
    try:
        root = np.linalg.inv(np.linalg.cholesky((information + information.T) / 2))
    except np.linalg.LinAlgError:
        return np.full(len(information), np.nan)
    return np.asarray(np.sqrt((root**2).sum(axis=0)))
