"""The effective degrees of freedom of standard uncertainties that come from an estimated noise, by Welch and
Satterthwaite (GUM, G.4), and what each reading does to each estimate.

Near the mode the estimate moves by -C A_i' S_i^-1 with the residual of measurement i, C the inverse of
Fisher's information. So C is a sum of parts: of the joints' noise, of the spot's, and of what is stated
besides.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from ...model.arrays import Matrix, normal_half_width
from .fit import LikelihoodFit

_NOTHING_LEFT = 0.5  # of a residual: no size is expected of it


class Gains(NamedTuple):
    """`covariance` C (f, f) by Fisher's information, `besides` (f, f) the information of distances and
    priors; (N, f, n) and (N, f, d) the estimates by one joint's and one spot reading of each measurement."""

    covariance: Matrix
    besides: Matrix
    by_joint: Matrix
    by_spot: Matrix


def gains(fit: LikelihoodFit) -> Gains:
    """Of a fit at its mode, by the scaled free parameters."""
    problem, whitened = fit.problem, fit.whitened
    rows = problem.shots * problem.tool.residual_size
    jacobian = whitened.jacobian[:, problem.parameters.free]
    by_residual, by_distance = jacobian[:rows], jacobian[rows:]
    besides = by_distance.T @ by_distance + np.eye(jacobian.shape[1])
    information = fit.weight * by_residual.T @ by_residual + besides
    covariance: Matrix = np.asarray(np.linalg.inv(information), dtype=float)
    _, jacobian_mm = problem.linearise(fit.x)
    blocks = problem.roots(whitened).transpose(0, 2, 1)
    by_spot = fit.weight * (covariance @ blocks) @ np.linalg.inv(whitened.factor)
    return Gains(covariance, besides, by_spot @ problem.by_joints(jacobian_mm), by_spot)


def noise_dof(fit: LikelihoodFit) -> float:
    """Of an estimated common noise scale, the logarithm of which has the variance 1 / (2 dof).

    With the variances a_i + s^2 of independent combinations of the readings, of which the unknowns' priors
    make a_i, it is the sum of (s^2 / (a_i + s^2))^2: 1 for each number that no unknown explains, 0 for each
    that is taken up, and between for what tolerances may explain.
    """
    each = gains(fit)
    taken = np.eye(len(each.besides)) - each.besides @ each.covariance
    numbers = fit.problem.measured_size - len(fit.problem.ties)
    return max(float(numbers - 2 * np.trace(taken) + (taken * taken.T).sum()), 1e-3)


def as_small(fit: LikelihoodFit) -> float | None:
    """The probability of residuals as small as those of a fit, the noise being as stated; None where it is
    not known.

    Of an arm and a tool that have no deviation at all: one that deviates within its tolerances leaves more. A
    residual that the priors take up by the share 1 - w has w^2 of its square left, so that the sum has the
    mean of the w^2 and twice that of the w^4 as its variance (Satterthwaite).
    """
    problem = fit.problem
    if not problem.noise.known:
        return None
    jacobian = fit.whitened.jacobian[:, problem.parameters.free]
    left = 1 / (1 + np.maximum(np.linalg.eigvalsh(jacobian.T @ jacobian), 0.0))
    mean, half_variance = (
        max(float(problem.measured_size) - float((1 - left**power).sum()), 0.0) for power in (2, 4)
    )
    scale = half_variance / max(mean, _NOTHING_LEFT)
    if mean <= _NOTHING_LEFT or scale <= _NOTHING_LEFT:
        return None
    square = float(fit.whitened.residual @ fit.whitened.residual)
    return float(scipy.special.chdtr(mean / scale, square / scale))


def log_scales(fit: LikelihoodFit) -> Matrix:
    """(g, g) covariance of the logarithms of the noise scales: that of all, or the joints' and the spot's;
    (0, 0) where the noise is known."""
    noise = fit.problem.noise
    if noise.estimated:
        return np.array([[1 / (2 * noise_dof(fit))]])
    parameters = fit.problem.parameters
    chosen = np.flatnonzero(parameters.group("noise") & parameters.free)
    at = parameters.among_free[chosen]
    std = parameters.prior_std[chosen]
    return np.asarray(fit.covariance[np.ix_(at, at)] * np.outer(std, std))


def student_half_width(dof: Matrix, level: float = 0.95) -> Matrix:
    """Half widths of central intervals that hold `level`, in standard uncertainties of so many degrees of
    freedom; a normal's of infinitely many."""
    finite, upper = np.isfinite(dof), (1 + level) / 2
    return np.where(
        finite, scipy.special.stdtrit(np.where(finite, dof, 1.0), upper), normal_half_width(level)
    )


def effective_dof(fit: LikelihoodFit) -> Matrix:
    """(f,) u^4 over half the variance of u^2, u^2 being a sum of parts that each have a scale (G.2b); inf of
    known noise."""
    problem, variances = fit.problem, np.diag(fit.covariance)
    if problem.noise.known:
        return np.full(len(variances), np.inf)
    each = gains(fit)
    if problem.noise.estimated:
        # All that was not stated has the one scale, curvature too.
        of_data = (each.covariance @ each.besides * each.covariance).sum(axis=1)
        parts = (variances - of_data)[:, None]
    else:
        of_noise = problem.variances(fit.x)
        joints = ((each.by_joint**2).sum(axis=0) * of_noise[: problem.robot.n]).sum(axis=1)
        readings = np.einsum("nfd,ind->fi", each.by_spot**2, problem.of_sources(of_noise))
        by_noise = np.hstack([joints[:, None], readings])
        noise = problem.noise
        parts = by_noise @ np.equal(np.arange(len(noise.factors)), np.array(noise.of_factor)[:, None])
    with np.errstate(divide="ignore"):
        return np.asarray(variances**2 / (2 * ((parts @ log_scales(fit)) * parts).sum(axis=1)))
