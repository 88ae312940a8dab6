"""The interval of one offset at the results, between them and ahead; when the next calibration is due.

Between two results a random walk is a Brownian bridge: with the states a and b at their ends, the share s of
the time passed and the variance q of the walk over all of it, its mean is (1 - s) a + s b and its variance
s (1 - s) q. So an interval is widest in the middle. After the last result the walk goes on alone."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy import optimize, special

from ...model.arrays import Matrix
from .drift import LEVEL, Drift, mixture_quantile
from .importance import even_points

HORIZON_YEARS = 20.0
_DRAWS = 4096  # a power of two
_POINTS = 100  # of an offset, about
_MOST_BETWEEN = 5  # points from one result to the next
_TAIL = 1e-6  # rates of this weight together are left out


def due_after(drift: Drift, sensitivity_mm2: Matrix, tolerance_mm: float) -> float | None:
    """Years after the last result until which the TCP error stays within the tolerance with 95 % probability,
    if the offsets as estimated at the last result are applied; 0 where it does not even then, None beyond
    the horizon of 20 years.

    The error is root mean square over the region, by `sensitivity_mm2` (m, m) of the offsets of the series
    (as `accuracy.sensitivity_mm2` of a result). Future jumps are not foreseen.
    """
    size = len(drift.series.names)
    share, z = _draws(size)
    chosen = np.minimum(np.searchsorted(np.cumsum(drift.weights), share), len(drift.weights) - 1)
    mean, covariance = drift.smoothed.last
    root = np.linalg.cholesky(covariance)
    now = mean[chosen] - drift.weights @ mean + np.einsum("kij,kj->ki", root[chosen], z[:, :size])
    drawn_rates = drift.rates[chosen] * z[:, size:]
    # The error is a square in the root of the time.
    by_now, by_rates = now @ sensitivity_mm2, drawn_rates @ sensitivity_mm2
    at_now, grown = (by_now * now).sum(axis=1), (by_rates * drawn_rates).sum(axis=1)
    mixed = (by_now * drawn_rates).sum(axis=1) + (by_rates * now).sum(axis=1)

    rank = LEVEL * (len(at_now) - 1)
    below = math.floor(rank)

    def error_mm(years: float) -> float:
        squared = at_now + np.sqrt(years) * mixed + years * grown
        # The quantile, as numpy's, which takes ten times as long.
        low, high = np.partition(squared, (below, below + 1))[below : below + 2].tolist()
        return math.sqrt(max(low + (high - low) * (rank - below), 0.0))

    if error_mm(0.0) > tolerance_mm:
        return 0.0
    if error_mm(HORIZON_YEARS) <= tolerance_mm:
        return None
    return float(optimize.brentq(lambda years: error_mm(years) - tolerance_mm, 0.0, HORIZON_YEARS, xtol=1e-9))


@cache
def _draws(size: int) -> tuple[Matrix, Matrix]:
    """Even points, the same for every arm: shares (N,) to choose rates by, (N, 2 size) standard normal."""
    points = even_points(2 * size + 1, _DRAWS, 0)
    return points[:, 0], np.asarray(special.ndtri(points[:, 1:]))


@dataclass(frozen=True, eq=False)
class Band:
    """Intervals `low` to `high` at the times `at` (years, as those of the series), without a jump or a reset
    in between; `forecast` after the last result."""

    at: Matrix
    low: Matrix
    high: Matrix
    forecast: bool = False


def bands(drift: Drift, offset: str, ahead_years: float = 0.0) -> Iterator[Band]:
    """The 95 % bands of an offset from one jump or reset to the next, each from the first result in it that
    determines the offset; none where no result does. Then the forecast for `ahead_years`."""
    j = drift.series.names.index(offset)
    times = np.array([observation.at for observation in drift.series.observations])
    last = len(times) - 1
    breaks = sorted({*drift.series.reset, *(jump.place for jump in drift.jumps if jump.offset == offset)})
    each = int(np.clip(_POINTS // max(last, 1), 1, _MOST_BETWEEN))
    for begin, end in zip([0, *(t + 1 for t in breaks)], [*breaks, last], strict=True):
        determined = np.flatnonzero(drift.series.observed[begin : end + 1, j])
        if not len(determined):
            continue
        first = begin + int(determined[0])
        shares = np.arange(each) / each
        points = [(t, share) for t in range(first, end) for share in shares] + [(end, 0.0)]
        before = np.array([t for t, _ in points])
        share = np.array([share_after for _, share_after in points])
        after = np.minimum(before + 1, last)
        at = times[before] + share * (times[after] - times[before])
        yield Band(at, *_interval(drift, j, *_between(drift, j, before, share)))
        if end == last and ahead_years > 0:
            years = ahead_years * np.linspace(0, 1, 13) ** 2
            now, covariance = drift.by_noise.last
            mean = np.repeat(now[:, j, None], len(years), axis=1)
            variance = covariance[:, j, j, None] + drift.rates[:, j, None] ** 2 * years
            yield Band(times[-1] + years, *_interval(drift, j, mean, variance), forecast=True)


def _between(drift: Drift, j: int, before: Matrix, share: Matrix) -> tuple[Matrix, Matrix]:
    """Mean and variance (K, P) of offset j at the `share` of the time after the results `before`."""
    last = len(drift.series.observations) - 1
    after = np.minimum(before + 1, last)
    gap = np.minimum(before, last - 1)
    state, spread = drift.by_noise.mean[:, :, j], drift.by_noise.covariance[:, :, j, j]
    a, b = spread[:, before], spread[:, after]
    common = (a + b - drift.by_noise.step_variance[:, gap, j]) / 2
    step_variance = drift.rates[:, j, None] ** 2 * drift.series.gaps[gap]
    rest = 1 - share
    mean = rest * state[:, before] + share * state[:, after]
    return mean, rest**2 * a + share**2 * b + share * rest * (2 * common + step_variance)


def _interval(drift: Drift, j: int, mean: Matrix, variance: Matrix) -> tuple[Matrix, Matrix]:
    order = np.argsort(drift.weights)
    kept = order[np.cumsum(drift.weights[order]) > _TAIL]
    along = np.eye(len(drift.series.names))[j]
    std = np.sqrt(variance[kept] + drift.shared_variance(along))
    weights = drift.weights[kept] / drift.weights[kept].sum()
    low, high = (mixture_quantile(mean[kept], std, weights, (1 + side * LEVEL) / 2) for side in (-1, 1))
    return low, high
