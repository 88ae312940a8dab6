"""How well chains of draws determine what is said of them: ranks, nested R-hat, effective sample sizes.

The definitions are those of ArviZ (Vehtari et al. 2021; Margossian et al. 2024): the tests hold them to it.
ArviZ itself takes longer to load than a run to analyse.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy

from ...model.arrays import Matrix

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
