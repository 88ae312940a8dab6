"""Adaptive importance sampling about a normal prior: integrals over what the data determine well or not at
all.

Nodes are Sobol points of the passes: normal distributions, the first of which is the prior. Each further pass
is about what those before found. All are weighted as one mixture (Cappe et al. 2004, Population Monte Carlo).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from scipy import special
from scipy.stats import qmc

from ...model.arrays import Matrix

Pass = tuple[Matrix, Matrix]  # mean (d,), and a root (d, d) of the covariance

ENOUGH, MOST = 100, 24
_WIDER, _FLOOR = 1.2, 0.25  # the std of a pass over that of the weights so far, and the least one


def sampled(
    log_likelihood: Callable[[Matrix], Matrix], passes: list[Pass], rounds: int, nodes: int, seed: int
) -> tuple[Matrix, Matrix]:
    """The points (K, d), `nodes` (a power of two) of each of the `passes`, the first of which is the prior,
    and of `rounds` more, which are appended to `passes`; and the log-likelihood of each point (K,). Up to
    `MOST` rounds follow while fewer than `ENOUGH` points count: where the data are far from the prior."""
    points = np.concatenate([from_pass(one_pass, nodes, seed + k) for k, one_pass in enumerate(passes)])
    log_likelihoods = log_likelihood(points)
    for number in range(max(rounds, MOST)):
        weights = normalised(log_likelihoods + over_passes(points, passes))
        if number >= rounds and effective(weights) >= ENOUGH:
            break
        passes.append(about(points, weights))
        near = from_pass(passes[-1], nodes, seed + len(passes) - 1)
        log_likelihoods = np.concatenate([log_likelihoods, log_likelihood(near)])
        points = np.concatenate([points, near])
    return points, log_likelihoods


def effective(weights: Matrix) -> float:
    """The effective number of points with these `weights`, which sum to 1."""
    return float(1 / (weights**2).sum())


def about(points: Matrix, weights: Matrix) -> Pass:
    """The pass about weighted points: their mean, and their scatter made wider."""
    centre = np.asarray(weights @ points)
    apart = points - centre
    scatter = (weights[:, None] * apart).T @ apart + _FLOOR**2 * np.eye(points.shape[1])
    return centre, np.asarray(_WIDER * np.linalg.cholesky(scatter), float)


def from_pass(one_pass: Pass, nodes: int, seed: int) -> Matrix:
    """(nodes, d) Sobol points of a normal distribution."""
    centre, root = one_pass
    return np.asarray(centre + _standard_points(len(centre), nodes, seed) @ root.T)


@lru_cache(maxsize=512)
def _standard_points(size: int, nodes: int, seed: int) -> Matrix:
    """(nodes, size) Sobol points of the standard normal distribution: the same for every arm."""
    points = qmc.Sobol(size, seed=seed).random(nodes)
    standard = np.asarray(special.ndtri(np.clip(points, 1e-12, 1 - 1e-12)))
    standard.flags.writeable = False
    return standard


def over_passes(points: Matrix, passes: Sequence[Pass]) -> Matrix:
    """(K,) the logarithm of the prior, the first of the `passes`, over the mixture of all of them."""
    return np.asarray(_log_normal(points, *passes[0]) + against_passes(points, passes))


def against_passes(points: Matrix, passes: Sequence[Pass]) -> Matrix:
    """(K,) minus the logarithm of the density of the mixture, up to a constant of the dimension."""
    each = np.array([_log_normal(points, *one_pass) for one_pass in passes])
    return np.asarray(math.log(len(passes)) - np.logaddexp.reduce(each, axis=0))


def normalised(log_weight: Matrix) -> Matrix:
    """Weights that sum to 1 along the first axis."""
    weight = np.exp(log_weight - log_weight.max(axis=0))
    return np.asarray(weight / weight.sum(axis=0))


def _log_normal(points: Matrix, centre: Matrix, root: Matrix) -> Matrix:
    z = (points - centre) @ np.linalg.inv(root).T
    return np.asarray(-0.5 * np.einsum("ki,ki->k", z, z) - np.linalg.slogdet(root)[1])
