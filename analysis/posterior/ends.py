"""The ends of a posterior's 95 % interval: from draws, or sharper from what was proposed to them.

The proposals of the independence move are independent draws of a density g that is known, and have been
evaluated. Weighted by w = p / g, scaled to a mean of 1, they give the posterior's distribution function by
importance sampling with g's own as control variate (Owen 2013, Monte Carlo theory, methods and examples,
9.10):

    F(t) = G(t) + mean of (w - 1) 1(x <= t)

Where g is close to p nearly all of F is G, which has no Monte Carlo error: as good are several times as many
draws of p. The error is that of the mean of w (1(x <= t) - F) - (1(x <= t) - G). Where G is not known the
weights alone give F.

Weights serve where Pareto's k of their tail is small (Vehtari et al. 2024, Pareto smoothed importance
sampling) and most draws are effective: else draws of g may miss parts of p.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from ...model.arrays import NORMAL_95, Matrix
from .convergence import tail_effective

_TAIL = 0.025
_CONTRADICTED = 4.0  # standard errors
# Weights serve up to this k, and from this effective share of the draws. In many dimensions draws that miss
# the outer part of a thin sheet have a k of 0.5 to 0.7 and a quarter of the share, and look right all the
# same.
_LARGEST_K, _LEAST_SHARE = 0.5, 0.4
_LEAST_TAIL = 5


class Ends(NamedTuple):
    """The ends of the 95 % interval of some draws, their std, and the effective sample size of the tails."""

    std: float
    q2_5: float
    q97_5: float
    ess_tail: float

    @classmethod
    def of_draws(cls, chains: Matrix) -> Ends:
        """Those of chains (chains, steps)."""
        low, high = np.quantile(chains, [_TAIL, 1 - _TAIL]).tolist()
        return cls(float(chains.std(ddof=1)), low, high, tail_effective(chains))

    def off(self, other: Ends) -> float:
        """By what share of the width of the other interval an end, or the std, is off by more than chance
        explains; 0 where chance explains it."""
        width = other.q97_5 - other.q2_5
        error = float(np.hypot(self.error, other.error))
        ends = max(abs(self.q2_5 - other.q2_5), abs(self.q97_5 - other.q97_5))
        # A width is proportional to the std, whose relative error is 1 / sqrt(2 n).
        by_std = abs(self.std / other.std - 1)
        of_std = float(np.sqrt((1 / self.ess_tail + 1 / other.ess_tail) / 2))
        return float(
            max(
                ends / width if ends > _CONTRADICTED * error else 0.0,
                by_std if by_std > _CONTRADICTED * of_std else 0.0,
            )
        )

    @property
    def error(self) -> float:
        """The standard error of an end: that of its probability over the density there, as of a normal."""
        density = np.exp(-(NORMAL_95**2) / 2) / np.sqrt(2 * np.pi)
        return float(np.sqrt(_TAIL * (1 - _TAIL) / self.ess_tail) / density * self.std)


class MarginalT(NamedTuple):
    """Student's t with `nu` degrees of freedom: what a multivariate one is for one number."""

    location: float
    scale: float
    nu: float

    def probability(self, x: Matrix) -> Matrix:
        return np.asarray(scipy.special.stdtr(self.nu, (x - self.location) / self.scale))


class Weights(NamedTuple):
    """Those of independent draws: (N,) with a mean of 1, k of their tail, and the share of the draws that is
    effective. `serve`: whether what they say may be believed."""

    values: Matrix
    pareto_k: float
    share: float

    @classmethod
    def of(cls, log_weights: Matrix) -> Weights:
        """Of ln p - ln g (N,) up to a constant."""
        values = np.exp(log_weights - log_weights.max())
        values /= values.mean()
        return cls(values, pareto_k(values), float(1 / (values**2).mean()))

    @property
    def serve(self) -> bool:
        return self.pareto_k <= _LARGEST_K and self.share >= _LEAST_SHARE


def pareto_k(weights: Matrix) -> float:
    """The shape of the generalised Pareto distribution of the largest weights (N,); infinite where fewer than
    five differ from 0. By the estimator of Zhang and Stephens (2009), with the weak prior of Vehtari et al.
    (2024, appendix G)."""
    count = len(weights)
    ordered = np.sort(weights)
    size = int(min(0.2 * count, 3 * np.sqrt(count)))
    over = ordered[count - size :] - ordered[count - size - 1]
    over = over[over > 0]
    size = len(over)
    if size < _LEAST_TAIL:
        # Equal weights have no tail; but where nearly all are 0 the others are too few.
        return -np.inf if ordered[0] == ordered[-1] else np.inf
    tries = 30 + int(np.sqrt(size))
    quartile = over[int(size / 4 + 0.5) - 1]
    rates = 1 / over[-1] + (1 - np.sqrt(tries / (np.arange(1, tries + 1) - 0.5))) / (3 * quartile)
    shapes = np.log1p(-rates[:, None] * over).mean(axis=1)
    log_likelihood = size * (np.log(-rates / shapes) - shapes - 1)
    share = np.exp(log_likelihood - log_likelihood.max())
    rate = float(rates @ share / share.sum())
    shape = float(np.log1p(-rate * over).mean())
    return (size * shape + 5) / (size + 10)


def weighted_ends(x: Matrix, weights: Weights, proposal: MarginalT | None = None) -> Ends:
    """Of independent draws x (N,) and their weights; `proposal` is how x is distributed, if that is known.

    `ess_tail` is how many independent draws of the posterior would give the ends as well.
    """
    count = len(x)
    order = np.argsort(x)
    x, w = x[order], weights.values[order]
    if proposal is None:
        distribution = np.cumsum(w) / count
    else:
        distribution = proposal.probability(x) + np.cumsum(w - 1) / count
    rising = np.maximum.accumulate(distribution)
    ends, sizes = np.zeros(2), np.zeros(2)
    for k, p in enumerate((_TAIL, 1 - _TAIL)):
        ends[k] = np.interp(p, rising, x)
        below = x <= ends[k]
        error = w * (below - p)
        if proposal is not None:
            error -= below - float(proposal.probability(ends[k]))
        sizes[k] = p * (1 - p) * count / max(float((error**2).mean()), 1e-300)
    mean = float((w * x).mean())
    std = float(np.sqrt((w * (x - mean) ** 2).mean()))
    return Ends(std, float(ends[0]), float(ends[1]), float(sizes.min()))
