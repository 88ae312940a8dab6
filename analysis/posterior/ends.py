"""The ends of a posterior's 95 % interval: from draws, or sharper from what was proposed to them.

The proposals of the independence move are independent draws of a density g that is known, and have been
evaluated. Weighted by w = p / g, scaled to a mean of 1, they give the posterior's distribution function by
importance sampling with g's own as control variate (Owen 2013, Monte Carlo theory, methods and examples,
9.10):

    F(t) = G(t) + mean of (w - 1) 1(x <= t)

Where g is close to p nearly all of F is G, which has no Monte Carlo error: as good are several times as many
draws of p. The error is that of the mean of w (1(x <= t) - F) - (1(x <= t) - G).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from ...model.arrays import NORMAL_95, Matrix
from .convergence import tail_effective

_TAIL = 0.025
_LARGEST = 0.01  # of all weight: one draw that has more says that others, not drawn, would have too
_CONTRADICTED = 4.0  # standard errors
_FEWEST = 0.5  # effective, of the draws: with fewer the weights tell less than a Markov chain


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

    @property
    def error(self) -> float:
        """The standard error of an end: that of its probability over the density there, as of a normal."""
        density = np.exp(-(NORMAL_95**2) / 2) / np.sqrt(2 * np.pi)
        return float(np.sqrt(_TAIL * (1 - _TAIL) / self.ess_tail) / density * self.std)

    def contradict(self, other: Ends) -> bool:
        """Whether chance does not explain by what these are off the other ones."""
        off = max(abs(self.q2_5 - other.q2_5), abs(self.q97_5 - other.q97_5))
        return off > _CONTRADICTED * float(np.hypot(self.error, other.error))


class MarginalT(NamedTuple):
    """Student's t with `nu` degrees of freedom: what a multivariate one is for one number."""

    location: float
    scale: float
    nu: float

    def probability(self, x: Matrix) -> Matrix:
        return np.asarray(scipy.special.stdtr(self.nu, (x - self.location) / self.scale))


def weighted_ends(x: Matrix, log_weights: Matrix, proposal: MarginalT) -> Ends | None:
    """Of independent draws x (N,) of `proposal` with ln p - ln g (N,); None where the weights do not serve.

    `ess_tail` is how many independent draws of the posterior would give the ends as well.
    """
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.mean()
    count = len(x)
    if weights.max() > _LARGEST * count or (weights**2).mean() > 1 / _FEWEST:
        return None
    order = np.argsort(x)
    x, weights = x[order], weights[order]
    known = proposal.probability(x)
    distribution = known + np.cumsum(weights - 1) / count
    rising = np.maximum.accumulate(distribution)
    ends, sizes = np.zeros(2), np.zeros(2)
    for k, p in enumerate((_TAIL, 1 - _TAIL)):
        ends[k] = np.interp(p, rising, x)
        below = x <= ends[k]
        error = weights * (below - p) - (below - float(proposal.probability(ends[k])))
        sizes[k] = p * (1 - p) * count / max(float((error**2).mean()), 1e-300)
    mean = float((weights * x).mean())
    std = float(np.sqrt((weights * (x - mean) ** 2).mean()))
    return Ends(std, float(ends[0]), float(ends[1]), float(sizes.min()))
