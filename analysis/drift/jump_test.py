"""The test of one jump: whether one offset changed between two results by more than its drift explains.

The test is predictive. Given the rates and whatever of the data a jump leaves unchanged, the score of the
jump is standard normal (de Jong and Penzer 1998); the rates have their distribution by that part of the data
alone: the posterior with the likelihood of the jump divided out. Where the jump is large these two lie far
apart. The rates that explain the change as drift have next to no weight without it, and those that have
weight without it do not explain the change. Rates are then sampled for the test itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np
from scipy import special

from ...model.arrays import Matrix
from .importance import ENOUGH, MOST, Pass, about, effective, from_pass, normalised, over_passes
from .series import Series
from .smoother import Smoothed, smooth

_KNOWN = (
    0.5  # standard deviation of a known log rate over that of its prior: three times the prior's information
)
_STEPS = 60  # of a bisection


@dataclass(frozen=True, eq=False)
class JumpTest:
    """Offset j between the results t and t + 1, of K rates with the `weights` (K,) that they have by all data
    but the change itself.

    `change` (K,) is the step by the results before and after, `noise` (K,) its variance by their uncertainty,
    `walk` (K,) that of the drift in the interval. `rate_known`: whether the other results determine the rate
    of the drift, so that a change can be compared with it.
    """

    weights: Matrix
    change: Matrix
    noise: Matrix
    walk: Matrix
    rate_known: bool

    @property
    def p_value(self) -> float:
        """Two-sided, not adjusted: of so large a change without a jump."""
        score = self.change / np.sqrt(self.noise + self.walk)
        below, above = self.weights @ special.ndtr(score), self.weights @ special.ndtr(-score)
        return min(1.0, 2 * float(min(below, above)))

    @property
    def p_same(self) -> float:
        """Two-sided, not adjusted: of so large a change with neither jump nor drift."""
        return float(2 * self.weights @ special.ndtr(-np.abs(self.change) / np.sqrt(self.noise)))

    def least_jump(self, p_value: float) -> float:
        """The smallest change with this p-value."""
        std = np.sqrt(self.noise + self.walk)
        low, high = 0.0, float(-special.ndtri(p_value / 2) * std.max())
        for _ in range(_STEPS):
            middle = (low + high) / 2
            too_small = 2 * self.weights @ special.ndtr(-middle / std) > p_value
            low, high = (middle, high) if too_small else (low, middle)
        return high


def jump_tests(
    series: Series,
    rates: Matrix,
    smoothed: Smoothed,
    passes: Sequence[Pass],
    jumps: Matrix,
    *,
    nodes: int,
    seed: int,
) -> dict[tuple[int, int], JumpTest]:
    """The tests by interval and offset, none where a jump is allowed already or one side has no result of the
    offset. `smoothed` is of the `rates` (K, m), which were sampled from the `passes`, `nodes` from each."""
    observed = series.observed
    over = over_passes(np.log(rates), passes)
    tests = {}
    for j in range(jumps.shape[1]):
        ends = [-1, *np.flatnonzero(jumps[:, j]).tolist(), len(jumps)]
        for t in np.flatnonzero(np.logical_not(jumps[:, j])).tolist():
            start = max(end for end in ends if end < t) + 1
            stop = min(end for end in ends if end > t) + 1
            if not (observed[start : t + 1, j].any() and observed[t + 1 : stop, j].any()):
                continue
            if not (smoothed.power[:, t, j] > 0).all():
                continue
            scored = _Scored.of(rates, smoothed, t, j)
            tests[t, j] = _test(series, scored, over, passes, jumps, t, j, nodes, seed)
    return tests


@dataclass(frozen=True, eq=False)
class _Scored:
    """Rates (K, m) with what one test needs of them (K,)."""

    rates: Matrix
    log_likelihood: Matrix
    score: Matrix
    power: Matrix

    @staticmethod
    def of(rates: Matrix, smoothed: Smoothed, t: int, j: int) -> _Scored:
        return _Scored(rates, smoothed.log_likelihood, smoothed.score[:, t, j], smoothed.power[:, t, j])

    def weights(self, over: Matrix) -> Matrix:
        """(K,) by the part of the data that a jump leaves unchanged, of rates with the prior `over` (K,) what
        they were sampled from (its logarithm)."""
        return normalised(self.log_likelihood + self.score**2 / 2 - np.log(self.power) / 2 + over)


def _test(
    series: Series,
    own: _Scored,
    over: Matrix,
    passes: Sequence[Pass],
    jumps: Matrix,
    t: int,
    j: int,
    nodes: int,
    seed: int,
) -> JumpTest:
    """The test by these rates; where too few of them count, by more: first with the prior of the rate of the
    tested offset, then about those that count."""
    weights = own.weights(over)
    prior, more = passes[0], list(passes)
    while effective(weights) < ENOUGH and len(more) < len(passes) + MOST:
        more.append(
            _with_prior_of(j, passes[-1], prior)
            if len(more) == len(passes)
            else about(np.log(own.rates), weights)
        )
        rates = np.exp(from_pass(more[-1], nodes, seed + len(more) - 1))
        scored = _Scored.of(rates, smooth(series, rates, jumps), t, j)
        own = _Scored(*map(np.concatenate, zip(astuple(own), astuple(scored), strict=True)))
        weights = own.weights(over_passes(np.log(own.rates), more))
    variance = 1 / own.power
    walk = own.rates[:, j] ** 2 * series.gaps[t]
    log_rate = np.log(own.rates[:, j])
    spread = weights @ (log_rate - weights @ log_rate) ** 2
    return JumpTest(
        weights=weights,
        change=own.score * np.sqrt(variance),
        noise=np.maximum(variance - walk, 0.0),
        walk=walk,
        rate_known=bool(spread <= (_KNOWN * prior[1][j, j]) ** 2),
    )


def _with_prior_of(j: int, about: Pass, prior: Pass) -> Pass:
    """The pass `about`, its coordinate j independent with the prior."""
    centre, root = about[0].copy(), about[1]
    covariance = root @ root.T
    covariance[j], covariance[:, j] = 0.0, 0.0
    centre[j], covariance[j, j] = prior[0][j], prior[1][j, j] ** 2
    return centre, np.asarray(np.linalg.cholesky(covariance), float)
