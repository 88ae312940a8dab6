"""Robust fits: Huber's or Student's loss on the residuals, with a sandwich covariance.

A shot that is far off (someone leaned on the bench) pulls the likelihood fit with the square of its residual.
Here its weight falls with the length of its residual. What is left is judged by the residuals as they are,
not by the stated noise: the sandwich of White (1980), each residual divided by what its shot leaves open (HC3
of MacKinnon & White 1985), for there are few shots.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from ...model.arrays import Index, Matrix
from ...model.likelihood.density import Density
from ...model.likelihood.problem import Problem
from .fit import LikelihoodFit, modes

Loss = Literal["huber", "student"]

STUDENT_NU = 4.0
_HUBER_SHARE = 0.95  # of normal residuals are shorter than Huber's threshold
_ROUNDS = 200
_SETTLED = 1e-6  # change of the largest weight
_DETERMINES_ITSELF = 1.0 - 1e-4  # leverage from which on a measurement determines something alone


@dataclass(frozen=True, eq=False)
class RobustFit:
    """`x` internal units, without noise factors; `weights` (N,) of the shots, 1 for a residual of no length
    (Student: at most (nu + d) / nu); `whitened` (N,) their residuals in their own stds; `covariance` (f, f)
    of the scaled free parameters, None where a measurement has leverage 1; `scale` of the noise."""

    loss: Loss
    tuning: float
    x: Matrix
    weights: Matrix
    whitened: Matrix
    covariance: Matrix | None
    scale: float
    converged: bool
    reason: str


def fit_robust(problem: Problem, fit: LikelihoodFit, loss: Loss) -> RobustFit:
    """Iteratively reweighted from the likelihood fit; Student's starts from Huber's, which has one minimum,
    and keeps its scale (as the MM-estimators of Yohai 1987 keep that of their first stage).

    An estimated noise scale is taken from the median residual, which outliers hardly move; noise factors are
    kept as they were fitted, and x is without them.
    """
    d = problem.sizes
    known, x = problem.with_noise_of(fit.x)
    tuning = np.sqrt(scipy.special.chdtri(d, 1 - _HUBER_SHARE)) if loss == "huber" else STUDENT_NU
    density, weights = Density(known), np.ones(problem.shots)
    first = fit_robust(problem, fit, "huber") if loss == "student" else None
    x = x if first is None else first.x
    # The residuals are what the fit has left of the errors.
    left = max(1 - density.size / d.sum(), 1e-3)

    def scale_of(quads: Matrix) -> float:
        if not problem.noise.estimated:
            return 1.0
        return (
            float(np.sqrt(np.median(quads / scipy.special.chdtri(d, 0.5)) / left))
            if first is None
            else first.scale
        )

    converged, reason = False, f"the weights did not settle in {_ROUNDS} rounds"
    for _ in range(_ROUNDS):
        quads = density.quads(x)
        scale = scale_of(quads)
        new = _weights(np.sqrt(quads) / scale, d, loss, tuning)
        settled = float(np.abs(new - weights).max()) < _SETTLED
        weights = new
        if settled:
            converged, reason = True, "the weights settled"
            break
        minima = modes(density.weighted((weights / scale**2)[None]), x[None])
        if not minima.converged[0]:
            reason = minima.reason[0]
            break
        x = minima.x[0]
    length = np.sqrt(density.quads(x)) / scale
    return RobustFit(
        loss,
        float(np.max(tuning)),
        x,
        weights,
        length,
        _sandwich(known, x, weights, scale, loss, tuning),
        scale,
        converged,
        reason,
    )


def _weights(length: Matrix, d: Matrix, loss: Loss, tuning: float | Matrix) -> Matrix:
    """(N,) weights of residuals of these whitened lengths: rho'(r) / r of each loss."""
    if loss == "huber":
        return np.asarray(np.minimum(1.0, tuning / np.maximum(length, 1e-300)))
    return np.asarray((tuning + d) / (tuning + length**2))


def _weight_slope(length: Matrix, d: Matrix, loss: Loss, tuning: float | Matrix) -> Matrix:
    """(N,) w'(r) / r: how the weights fall, so that the pull w m has the slope w I + (w' / r) m m'."""
    if loss == "huber":
        return np.asarray(np.where(length > tuning, -tuning / np.maximum(length, tuning) ** 3, 0.0))
    return np.asarray(-2 * (tuning + d) / (tuning + length**2) ** 2)


def _sandwich(
    problem: Problem, x: Matrix, weights: Matrix, scale: float, loss: Loss, tuning: float | Matrix
) -> Matrix | None:
    """(f, f), or None where a measurement has leverage 1 or the loss has no minimum here.

    The bread is the curvature of the loss and not the weights': a far residual pulls less the farther it is,
    and Student's even less than before (Huber & Ronchetti 2009, section 7.6).
    """
    d, rows = problem.tool.residual_size, problem.shots * problem.tool.residual_size
    whitened = problem.whiten(x)
    jacobian = problem.roots(whitened) / scale
    residuals = whitened.residual[:rows].reshape(problem.shots, d) / scale
    prior = Density(problem).prior_information(x[None])[0]
    root = np.sqrt(weights)[:, None]
    blocks = jacobian * root[:, :, None]
    open_part, decides = leverages(blocks, np.linalg.inv(np.einsum("idf,idg->fg", blocks, blocks) + prior))
    weight_slope = _weight_slope(np.linalg.norm(residuals, axis=1), problem.sizes, loss, tuning)
    slope = (
        weights[:, None, None] * np.eye(d)
        + weight_slope[:, None, None] * residuals[:, :, None] * residuals[:, None, :]
    )
    curvature = np.einsum("iaf,iab,ibg->fg", jacobian, slope, jacobian) + prior
    if decides.any() or np.linalg.eigvalsh(curvature)[0] <= 0:
        return None
    pulls = (blocks.transpose(0, 2, 1) @ np.linalg.solve(open_part, (root * residuals)[:, :, None]))[:, :, 0]
    bread = np.linalg.inv(curvature)
    covariance: Matrix = bread @ (pulls.T @ pulls + prior) @ bread
    return covariance


def outlying(length: Matrix, d: Matrix | int, level: float, dof: int | None = None) -> Index:
    """Shots whose whitened residuals are longer than one of N normal residuals is with probability `chance`,
    the longest first. `d` (N,) components each; `dof` are those of an estimated noise scale: the squares are
    then F's."""
    share = level / max(len(length), 1)
    limit = np.sqrt(
        scipy.special.chdtri(d, share) if dof is None else d * scipy.special.fdtri(d, dof, 1 - share)
    )
    order = np.argsort(-length)
    return np.asarray(order[(length > limit)[order]])


def leverages(blocks: Matrix, covariance: Matrix) -> tuple[Matrix, NDArray[np.bool_]]:
    """(N, d, d) I - H_i of whitened Jacobians (N, d, f), and (N,) where a measurement has leverage 1
    (there I - H_i is singular, and I is returned)."""
    hat = blocks @ covariance @ blocks.transpose(0, 2, 1)
    decides = np.linalg.eigvalsh(hat).max(axis=1) > _DETERMINES_ITSELF
    return np.eye(blocks.shape[1]) - np.where(decides[:, None, None], 0.0, hat), decides
