"""Adaptive importance sampling about a normal prior: integrals over what the data determine well or not at
all.

Nodes are lattice points of the passes: normal distributions, the first of which is the prior. Each further
pass is about what those before found. All are weighted as one mixture (Cappe et al. 2004, Population Monte
Carlo). Nothing in it is rounded or ordered so that a small change of the data were a large one of the answer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import special  # scipy.stats has points as even, and takes a second to come

from ...model.arrays import Matrix

Pass = tuple[Matrix, Matrix]  # mean (d,), and a root (d, d) of the covariance

ENOUGH, MOST = 100, 24
_MULTIPLIER = 2157  # of the lattice: as even as Sobol points, for 64 to 4096 points of up to 15 dimensions
_WIDER, _FLOOR = 1.2, 0.25  # the std of a pass over that of the weights so far, and the least one


@dataclass(frozen=True, eq=False)
class Nodes:
    """`points` (K, d) of the `passes`, with two logarithms of densities at each: `prior` (K,), of the first
    pass, and `mixed` (K,), of the sum of all. A pass that follows costs its own densities alone."""

    passes: tuple[Pass, ...]
    points: Matrix
    prior: Matrix
    mixed: Matrix

    @staticmethod
    def of(points: Matrix, passes: Sequence[Pass]) -> Nodes:
        each = _log_normals(points, passes)
        return Nodes(tuple(passes), points, each[0], np.logaddexp.reduce(each, axis=0))

    def followed_by(self, near: Pass, points: Matrix) -> Nodes:
        """With one more pass, and `points` of it."""
        added = Nodes.of(points, (*self.passes, near))
        return Nodes(
            added.passes,
            np.concatenate([self.points, points]),
            np.concatenate([self.prior, added.prior]),
            np.concatenate([np.logaddexp(self.mixed, _log_normals(self.points, [near])[0]), added.mixed]),
        )

    @property
    def against(self) -> Matrix:
        """(K,) minus the logarithm of the density of the mixture, up to a constant of the dimension."""
        return np.asarray(math.log(len(self.passes)) - self.mixed)

    @property
    def over(self) -> Matrix:
        """(K,) the logarithm of the prior over the mixture."""
        return self.prior + self.against


def sampled(
    log_likelihood: Callable[[Matrix], Matrix], passes: Sequence[Pass], rounds: int, count: int, seed: int
) -> tuple[Nodes, Matrix]:
    """`count` nodes (a power of two) of each of the `passes`, the first of which is the prior, and of
    `rounds` more; and the log-likelihood of each (K,). Up to `MOST` rounds follow while fewer than `ENOUGH`
    nodes count: where the data are far from the prior."""
    points = np.concatenate([from_pass(one_pass, count, seed + k) for k, one_pass in enumerate(passes)])
    nodes, log_likelihoods = Nodes.of(points, passes), log_likelihood(points)
    for number in range(max(rounds, MOST)):
        weights = normalised(log_likelihoods + nodes.over)
        if number >= rounds and effective(weights) >= ENOUGH:
            break
        near = about(nodes.points, weights)
        points = from_pass(near, count, seed + len(nodes.passes))
        nodes = nodes.followed_by(near, points)
        log_likelihoods = np.concatenate([log_likelihoods, log_likelihood(points)])
    return nodes, log_likelihoods


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
    """(nodes, d) lattice points of a normal distribution."""
    centre, root = one_pass
    return np.asarray(centre + standard_points(len(centre), nodes, seed) @ root.T)


@lru_cache(maxsize=512)
def standard_points(size: int, nodes: int, seed: int) -> Matrix:
    """(nodes, size) points of the standard normal distribution: the same for every arm."""
    standard = np.asarray(special.ndtri(even_points(size, nodes, seed)))
    standard.flags.writeable = False
    return standard


def even_points(size: int, count: int, seed: int) -> Matrix:
    """(count, size) points of a lattice of Korobov (1959) in the unit cube, shifted at random; `count` is a
    power of two."""
    steps = [pow(_MULTIPLIER, k, count) for k in range(size)]
    shift = np.random.default_rng(seed).random(size)
    return np.asarray(np.clip((np.outer(np.arange(count), steps) / count + shift) % 1.0, 1e-12, 1 - 1e-12))


def normalised(log_weight: Matrix) -> Matrix:
    """Weights that sum to 1 along the first axis."""
    weight = np.exp(log_weight - log_weight.max(axis=0))
    return np.asarray(weight / weight.sum(axis=0))


def _log_normals(points: Matrix, passes: Sequence[Pass]) -> Matrix:
    """(P, K) the logarithm of the density of each pass at the points, up to a constant of the dimension."""
    centres, roots = (np.array(part) for part in zip(*passes, strict=True))
    z = (points - centres[:, None]) @ np.linalg.inv(roots).transpose(0, 2, 1)
    return np.asarray(-0.5 * np.einsum("pki,pki->pk", z, z) - np.linalg.slogdet(roots)[1][:, None])
