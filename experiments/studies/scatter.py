"""The scatter of the offsets of few runs, and the joint noise that explains it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import optimize, stats

from ...analysis.estimation.midpoint import fit_midpoints
from ...analysis.observability.aim import aim, servo_joints
from ...analysis.observability.identifiability import identify
from ...analysis.status import Status
from ...model.arrays import Matrix
from ...model.files.plan import Plan
from ...model.likelihood.problem import Problem

LEAST_DEG, MOST_DEG = 1e-6, 1.0  # between which a joint noise is sought
LEVEL = 0.95


def scatter(values: Matrix) -> Matrix:
    """(..., p, p) sums of squares and products about the mean of runs (..., n, p)."""
    off = values - values.mean(axis=-2, keepdims=True)
    return np.asarray(np.swapaxes(off, -1, -2) @ off)


@dataclass(frozen=True, eq=False)
class Prediction:
    """What a plan predicts for the free offsets of an arm with the true offsets `truth` (deg, by name)."""

    plan: Plan
    truth: dict[str, float]
    _problem: Problem = field(init=False)
    _x: Matrix = field(init=False)

    def __post_init__(self) -> None:
        problem = Problem.from_plan(self.plan)
        x = problem.nominal()
        for name, value in self.truth.items():
            i = problem.parameters.index(name)
            x[i] = value / problem.parameters.items[i].display
        aimed = aim(problem, x, servo_joints(problem)).problem
        object.__setattr__(self, "_problem", aimed)
        object.__setattr__(self, "_x", x)

    def _at(self, joint_deg: float) -> Problem:
        noise = self._problem.noise
        joint = np.full_like(noise.joint, np.radians(joint_deg))
        return replace(self._problem, noise=replace(noise, joint=joint))

    def covariance(self, joint_deg: float) -> Matrix:
        """(p, p) deg^2 of the likelihood's estimates, at that joint noise and the plan's spot noise,
        without prior."""
        problem = self._at(joint_deg)
        parameters, free = problem.parameters, problem.parameters.free
        jacobian = problem.whiten(self._x).jacobian[:, free]
        inverse = np.linalg.inv(jacobian.T @ jacobian)
        scale = (parameters.prior_std * parameters.display)[free]
        offsets = parameters.group("offset")[free]
        return np.asarray((inverse * np.outer(scale, scale))[np.ix_(offsets, offsets)])

    def midpoint_covariance(self, joint_deg: float) -> Matrix:
        """(p, p) deg^2 of the estimates by eq. 8, which the paper fits: its sandwich."""
        problem = self._at(joint_deg)
        fits = fit_midpoints(problem, problem.joints[None])
        scale = (problem.parameters.prior_std * problem.parameters.display)[fits.free]
        return np.asarray(fits.covariance[0] * np.outer(scale, scale))

    def statuses(self, joint_deg: float) -> dict[str, Status]:
        status = identify(self._at(joint_deg), self._x).status
        return dict(zip(self._problem.parameters.names, status, strict=True))


@dataclass(frozen=True)
class Explained:
    """The joint noise, deg, that explains a scatter best, and the 95 % interval."""

    joint_deg: float
    low: float
    high: float


def explained(covariance: Callable[[float], Matrix], scattered: Matrix, dof: int) -> Explained:
    """The joint noise by maximum likelihood: `scattered` (p, p) is Wishart with `dof` degrees of freedom.

    tr(C^-1 A) is chi-squared with p dof degrees of freedom at the true noise, whatever the spot adds to C.
    The interval has the noises for which it is not in the tails; where the spot's share is negligible that
    is the usual interval of a standard deviation.
    """

    def deviance(log_joint: float) -> float:
        own = covariance(float(np.exp(log_joint)))
        return float(dof * np.linalg.slogdet(own)[1] + np.trace(np.linalg.solve(own, scattered)))

    def excess(log_joint: float, quantile: float) -> float:
        return float(np.trace(np.linalg.solve(covariance(float(np.exp(log_joint))), scattered))) - quantile

    least, most = np.log(LEAST_DEG), np.log(MOST_DEG)
    best = optimize.minimize_scalar(deviance, bounds=(least, most), method="bounded", options={"xatol": 1e-6})
    ends = []
    for tail in ((1 + LEVEL) / 2, (1 - LEVEL) / 2):
        quantile = float(stats.chi2.ppf(tail, dof * len(scattered)))
        # Where the spot alone scatters more than that, the joints' noise may be as small as one likes.
        none = excess(least, quantile) <= 0
        ends.append(0.0 if none else float(np.exp(optimize.brentq(excess, least, most, args=(quantile,)))))
    return Explained(float(np.exp(best.x)), ends[0], ends[1])


def unevenness(covariance: Matrix, scattered: Matrix, dof: int) -> Matrix:
    """(T,) how much better a noise for each principal axis of `covariance` (p, p) explains the scatters
    (T, p, p) than one for all: twice the logarithm of the likelihoods' ratio (Bartlett 1937).

    With fewer runs than offsets nothing more general can be asked. It does not change with the noise.
    """
    variance = along_axes(covariance, scattered) / dof
    return np.asarray(dof * (len(covariance) * np.log(variance.mean(axis=1)) - np.log(variance).sum(axis=1)))


def along_axes(covariance: Matrix, scattered: Matrix) -> Matrix:
    """(T, p) sums of squares along the principal axes, the best observable first, over the
    variances predicted."""
    variance, axes = np.linalg.eigh(covariance)
    return np.asarray(np.einsum("pa,...pq,qa->...a", axes, scattered, axes) / variance)
