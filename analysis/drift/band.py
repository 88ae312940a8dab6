"""The interval of one offset over time, at the results and between them, for figures.

Between two results a random walk is a Brownian bridge: with the states a and b at their ends, the share s of
the time passed and the variance q of the walk over all of it, its mean is (1 - s) a + s b and its variance
s (1 - s) q. So an interval is widest in the middle. After the last result the walk goes on alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...model.arrays import Matrix
from .drift import LEVEL, Drift, mixture_quantile

_POINTS = 100  # of an offset, about
_MOST_BETWEEN = 5  # points from one result to the next
_STEPS = 22  # of the bisection: a hundred thousandth of a standard deviation
_TAIL = 1e-6  # rates of this weight together are left out


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
    times = np.array([own.at for own in drift.series.observations])
    last = len(times) - 1
    breaks = sorted({*drift.series.reset, *(own.after for own in drift.jumps if own.offset == offset)})
    each = int(np.clip(_POINTS // max(last, 1), 1, _MOST_BETWEEN))
    for begin, end in zip([0, *(t + 1 for t in breaks)], [*breaks, last], strict=True):
        seen = np.flatnonzero(drift.series.observed[begin : end + 1, j])
        if not len(seen):
            continue
        first = begin + int(seen[0])
        shares = np.arange(each) / each
        places = [(t, share) for t in range(first, end) for share in shares] + [(end, 0.0)]
        before = np.array([t for t, _ in places])
        share = np.array([own for _, own in places])
        after = np.minimum(before + 1, last)
        at = times[before] + share * (times[after] - times[before])
        yield Band(at, *_interval(drift, j, *_between(drift, j, before, share)))
        if end == last and ahead_years > 0:
            years = ahead_years * np.linspace(0, 1, 13) ** 2
            mean = np.repeat(drift.smoothed.mean[:, -1, j][:, None], len(years), axis=1)
            variance = drift.smoothed.covariance[:, -1, j, j][:, None] + drift.rates[:, j, None] ** 2 * years
            yield Band(times[-1] + years, *_interval(drift, j, mean, variance), forecast=True)


def _between(drift: Drift, j: int, before: Matrix, share: Matrix) -> tuple[Matrix, Matrix]:
    """Mean and variance (K, P) of offset j at the `share` of the time after the results `before`."""
    last = len(drift.series.observations) - 1
    after = np.minimum(before + 1, last)
    gap = np.minimum(before, last - 1)
    state, spread = drift.smoothed.mean[:, :, j], drift.smoothed.covariance[:, :, j, j]
    a, b = spread[:, before], spread[:, after]
    common = (a + b - drift.smoothed.step_variance[:, gap, j]) / 2
    walk = drift.rates[:, j, None] ** 2 * drift.series.gaps[gap]
    rest = 1 - share
    mean = rest * state[:, before] + share * state[:, after]
    return mean, rest**2 * a + share**2 * b + share * rest * (2 * common + walk)


def _interval(drift: Drift, j: int, mean: Matrix, variance: Matrix) -> tuple[Matrix, Matrix]:
    order = np.argsort(drift.weights)
    kept = order[np.cumsum(drift.weights[order]) > _TAIL]
    along = np.eye(len(drift.series.names))[j]
    std = np.sqrt(variance[kept] + drift.shared_variance(along))
    weights = drift.weights[kept] / drift.weights[kept].sum()
    low, high = (
        mixture_quantile(mean[kept], std, weights, (1 + side * LEVEL) / 2, steps=_STEPS) for side in (-1, 1)
    )
    return low, high
