"""How well chains of draws determine what is said of them: ranks, nested R-hat, effective sample sizes, and
the ends of a 95 % interval: from draws, or sharper from what was proposed to them.

The definitions are those of ArviZ (Vehtari et al. 2021; Margossian et al. 2024): the tests hold them to it.
ArviZ itself takes longer to load than a run to analyse.

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

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from ...model.arrays import NORMAL_95, Matrix

_FEWEST = 4  # steps


def normal_scores(draws: Matrix) -> Matrix:
    """The quantile of a unit normal at each draw's rank among all; ties share the mean of their ranks."""
    flat = draws.reshape(-1)
    order = np.argsort(flat)
    ordered = flat[order]
    first = np.append(True, ordered[1:] != ordered[:-1])
    ends = np.append(np.flatnonzero(first), flat.size)
    scores = np.empty(flat.size)
    scores[order] = np.repeat(_scores(flat.size)[ends[:-1] + ends[1:] - 1], np.diff(ends))
    return scores.reshape(draws.shape)


@lru_cache(maxsize=4)
def _scores(count: int) -> Matrix:
    """(2 count - 1,) of so many draws the normal scores at the ranks 1, 1.5, 2, … count."""
    ranks = np.arange(2, 2 * count + 1) / 2
    scores: Matrix = scipy.special.ndtri((ranks - 0.375) / (count + 0.25))
    return scores


def nested_rhat(chains: Matrix) -> float:
    """Of chains (groups, chains, steps): whether the groups agree (Margossian et al. 2024, eq. 8)."""
    means = chains.mean(axis=2)
    within = chains.var(axis=2, ddof=1).mean(axis=1) + means.var(axis=1, ddof=1)
    return float(np.sqrt(1 + means.mean(axis=1).var(ddof=1) / within.mean()))


def halves(chains: Matrix) -> Matrix:
    """(2 chains, steps // 2) the first and the second half of each of chains (chains, steps)."""
    half = chains.shape[1] // 2
    return np.concatenate([chains[:, :half], chains[:, -half:]])


def effective(chains: Matrix) -> float:
    """Effective sample size of the mean of chains (chains, steps), which are taken as they are; nan if short.

    Geyer's sums of autocorrelations at two neighbouring lags: as long as they are positive, and falling.
    """
    count, steps = chains.shape
    if np.ptp(chains) < np.finfo(float).resolution:
        return float(chains.size)
    if steps < _FEWEST:
        return float("nan")
    means = chains.mean(axis=1)
    spectrum = np.fft.rfft(chains - means[:, None], n=1 << (2 * steps - 1).bit_length(), axis=1)
    covariance = np.fft.irfft((spectrum.real**2 + spectrum.imag**2).mean(axis=0))[:steps] / steps
    within = covariance[0] * steps / (steps - 1)
    total = covariance[0] + (means.var(ddof=1) if count > 1 else 0.0)
    correlation = 1 - (within - covariance) / total
    correlation[0] = 1.0
    pairs = correlation[: steps - 1 - (steps - 1) % 2].reshape(-1, 2).sum(axis=1)
    over = np.flatnonzero(pairs <= 0)
    last = int(over[0]) if len(over) else len(pairs) - 1
    positive = np.minimum.accumulate(pairs[:last]).sum()
    rest = correlation[2 * last]
    length = 2 * positive - 1 + (rest if rest > 0 or pairs[last] >= 0 else 0.0)
    return float(chains.size / max(length, 1 / np.log10(chains.size)))


def tail_effective(chains: Matrix) -> float:
    """The smaller effective sample size of the 5 % and the 95 % quantile of chains (chains, steps)."""
    return min(effective(halves(chains <= q).astype(float)) for q in np.quantile(chains, [0.05, 0.95]))


def error_of_mean(chains: Matrix) -> float:
    """Monte Carlo standard error of the mean of chains (chains, steps)."""
    return float(chains.std(ddof=1) / np.sqrt(effective(halves(chains))))


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

    @property
    def variance(self) -> float:
        """Of nu above 2."""
        return self.scale**2 * self.nu / (self.nu - 2)

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

    @property
    def acceptance(self) -> float:
        """Of a chain that proposes such draws the share that it accepts: the mean over pairs of the smaller
        weight."""
        count = len(self.values)
        return float(np.sort(self.values) @ np.arange(2 * count - 1, 0, -2)) / count**2


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
    variance = float((w * (x - mean) ** 2).mean())
    if proposal is not None:
        # With the same control variate: what is known of the proposal is not estimated.
        centred = x - proposal.location
        square = proposal.variance + float(((w - 1) * centred**2).mean())
        variance = square - float(((w - 1) * centred).mean()) ** 2
    return Ends(float(np.sqrt(variance)), float(ends[0]), float(ends[1]), float(sizes.min()))
