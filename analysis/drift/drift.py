"""What an arm's results say of its drift: rates of the random walk, jumps, the offsets at each result,
between them and ahead.

The drift rate of each offset is unknown and integrated over (`importance.py`): its logarithm is normal about
`MEDIAN` with the standard deviation `SPREAD`, per root year.

Jumps: an offset may change by any amount between two results. The test of one offset and interval is
predictive. Given the rates and whatever of the data a jump leaves unchanged, the score of the jump is
standard normal (de Jong and Penzer 1998); the rates have their distribution by that part of the data alone:
the posterior with the likelihood of the jump divided out. So the p-value is uniform if there is no jump, over
the prior of the rates, and a jump does not hide itself by a larger rate. Where a jump is large these two
distributions lie far apart, and rates are sampled for the test itself. The p-values are multiplied by their
number (Bonferroni): false alarms of an arm have at most the probability `ALARM`. The clearest jump is allowed
for, and the rest tested again, until none is left.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import astuple, dataclass, replace
from functools import cache, cached_property
from typing import Annotated

import numpy as np
from scipy import optimize, special

from ...model.arrays import Matrix
from ...model.errors import BadInput, UnsoundResult
from ...model.records import internal, it, record
from .importance import (
    ENOUGH,
    MOST,
    Nodes,
    Pass,
    about,
    effective,
    even_points,
    from_pass,
    normalised,
    sampled,
)
from .smoother import Series, Smoothed, smooth

_KNOWN = 0.5  # std of a known log rate over that of its prior: three times the prior's information
_STEPS, _CLOSE = 100, 1e-9  # to a quantile, of the least std
_ROOT_2_PI = math.sqrt(2 * math.pi)
ALARM = 0.01  # probability of a false alarm, of an arm
MEDIAN, SPREAD = 0.01, 1.5  # deg or mm per root year, and of its natural logarithm
LEVEL = 0.95
_NODES = 128  # of each pass; a power of two
_PASSES = 4  # after the first
_MOST_JUMPS = 20


@dataclass(frozen=True, eq=False)
class JumpTests:
    """Tests at n `places` (result before, offset), of K rates with the `weights` (K, n) that they have by all
    data but the change itself.

    `change` (K, n) is the step by the results before and after, `noise` (K, n) its variance by their
    uncertainty, `drift_variance` (K, n) that by the drift in the interval. `rate_known` (n,): whether the
    other results determine the rate of the drift, so that a change can be compared with it.
    """

    places: Sequence[tuple[int, int]]
    weights: Matrix
    change: Matrix
    noise: Matrix
    drift_variance: Matrix
    rate_known: Matrix

    @cached_property
    def p_value(self) -> Matrix:
        """(n,) two-sided, not adjusted: of so large a change without a jump."""
        score = self.change / np.sqrt(self.noise + self.drift_variance)
        tail = special.ndtr(-np.abs(score))
        below = (self.weights * np.where(score < 0, tail, 1 - tail)).sum(axis=0)
        above = (self.weights * np.where(score > 0, tail, 1 - tail)).sum(axis=0)
        return np.asarray(np.minimum(1.0, 2 * np.minimum(below, above)))

    @cached_property
    def p_same(self) -> Matrix:
        """(n,) two-sided, not adjusted: of so large a change with neither jump nor drift."""
        tail = special.ndtr(-np.abs(self.change) / np.sqrt(self.noise))
        return np.asarray(2 * (self.weights * tail).sum(axis=0))

    def undecided(self, series: Series, single: float) -> Iterator[Undecided]:
        """The changes that are no jump at this (single) p-value, and may be one."""
        unlike = (self.p_same <= single) & (self.p_value > single) & np.logical_not(self.rate_known)
        for k in np.flatnonzero(unlike).tolist():
            (t, j), weights, change = self.places[k], self.weights[:, k], self.change[:, k]
            variance = self.noise[:, k] + self.drift_variance[:, k]
            least = mixture_quantile(np.zeros_like(change), np.sqrt(variance), weights, 1 - single / 2)
            yield Undecided(
                series.names[j],
                series.units[j],
                t,
                float(weights @ change),
                mixture_interval(change, np.sqrt(self.noise[:, k]), weights, LEVEL),
                float(least),
            )


def _jump_tests(smoothed: Smoothed, nodes: Nodes, seed: int) -> list[JumpTests]:
    """The tests, none where a jump is allowed already or one side has no result of the offset. `smoothed` is
    of rates whose logarithms are the `nodes`."""
    places = list(_between_results(smoothed.series, smoothed.jumps))
    scored = _Scored.of(smoothed, places)
    known = np.flatnonzero((scored.power > 0).all(axis=0)).tolist()
    places, scored = [places[k] for k in known], scored.at(known)
    weights = scored.weights(nodes.over)
    enough = 1 / (weights**2).sum(axis=0) >= ENOUGH
    of_all, few = np.flatnonzero(enough).tolist(), np.flatnonzero(np.logical_not(enough)).tolist()
    named = [places[k] for k in of_all]
    together = _tests(smoothed.series, named, scored.at(of_all), weights[:, of_all], nodes.passes[0])
    return [together, *(_more(smoothed, scored.at([k]), nodes, places[k], seed) for k in few)]


def _between_results(series: Series, jumps: Matrix) -> Iterator[tuple[int, int]]:
    """Intervals and offsets without a jump, with a result of the offset on both sides of it."""
    observed = series.observed
    for j in range(jumps.shape[1]):
        ends = [-1, *np.flatnonzero(jumps[:, j]).tolist(), len(jumps)]
        for t in np.flatnonzero(np.logical_not(jumps[:, j])).tolist():
            start = max(end for end in ends if end < t) + 1
            stop = min(end for end in ends if end > t) + 1
            if observed[start : t + 1, j].any() and observed[t + 1 : stop, j].any():
                yield t, j


@dataclass(frozen=True, eq=False)
class _Scored:
    """Rates (K, m) and their `log_likelihood` (K,), with the `score` and `power` (K, n) of n tests."""

    rates: Matrix
    log_likelihood: Matrix
    score: Matrix
    power: Matrix

    @staticmethod
    def of(smoothed: Smoothed, places: Sequence[tuple[int, int]]) -> _Scored:
        intervals = sorted({t for t, _ in places})
        rows, offsets = [intervals.index(t) for t, _ in places], [j for _, j in places]
        score, power = (part[rows, offsets].T for part in smoothed.jumps_after(intervals))
        return _Scored(smoothed.rates, smoothed.log_likelihood, score, power)

    def at(self, tests: Sequence[int]) -> _Scored:
        """Of some tests."""
        return replace(self, score=self.score[:, tests], power=self.power[:, tests])

    def weights(self, over: Matrix) -> Matrix:
        """(K, n) by the part of the data that a jump leaves unchanged, of rates with the prior `over` (K,)
        what they were sampled from (its logarithm)."""
        return normalised((self.log_likelihood + over)[:, None] + self.score**2 / 2 - np.log(self.power) / 2)


def _more(smoothed: Smoothed, scored: _Scored, nodes: Nodes, tested: tuple[int, int], seed: int) -> JumpTests:
    """One test (interval, offset), where too few of the rates count, by more: first with the prior of the
    rate of the tested offset, then about those that count."""
    weights, passes = scored.weights(nodes.over), nodes.passes
    while effective(weights[:, 0]) < ENOUGH and len(nodes.passes) < len(passes) + MOST:
        near = (
            _with_prior_of(tested[1], passes[-1], passes[0])
            if len(nodes.passes) == len(passes)
            else about(nodes.points, weights[:, 0])
        )
        points = from_pass(near, _NODES, seed + len(nodes.passes))
        nodes = nodes.followed_by(near, points)
        added = _Scored.of(smooth(smoothed.series, np.exp(points), smoothed.jumps), [tested])
        scored = _Scored(*map(np.concatenate, zip(astuple(scored), astuple(added), strict=True)))
        weights = scored.weights(nodes.over)
    return _tests(smoothed.series, [tested], scored, weights, passes[0])


def _tests(
    series: Series,
    places: Sequence[tuple[int, int]],
    scored: _Scored,
    weights: Matrix,
    prior: Pass,
) -> JumpTests:
    intervals, offsets = np.array(places, int).reshape(-1, 2).T
    rates, variance = scored.rates[:, offsets], 1 / scored.power
    drift_variance = rates**2 * series.gaps[intervals]
    log_rate = np.log(rates)
    spread = (weights * (log_rate - (weights * log_rate).sum(axis=0)) ** 2).sum(axis=0)
    return JumpTests(
        places=places,
        weights=weights,
        change=scored.score * np.sqrt(variance),
        noise=np.maximum(variance - drift_variance, 0.0),
        drift_variance=drift_variance,
        rate_known=spread <= (_KNOWN * np.diag(prior[1])[offsets]) ** 2,
    )


def _with_prior_of(j: int, about: Pass, prior: Pass) -> Pass:
    """The pass `about`, its coordinate j independent with the prior."""
    centre, root = about[0].copy(), about[1]
    covariance = root @ root.T
    covariance[j], covariance[:, j] = 0.0, 0.0
    centre[j], covariance[j, j] = prior[0][j], prior[1][j, j] ** 2
    return centre, np.asarray(np.linalg.cholesky(covariance), float)


@record
class OffsetChange:
    """A change of one offset between the results `place` and `place` + 1."""

    offset: Annotated[str, it("its name")]
    unit: Annotated[str, it("of the size")]
    place: Annotated[int, internal]
    size: Annotated[float, it("of the change")]
    interval95: Annotated[tuple[float, float], it("95 % interval of the size")]


@record
class Jump(OffsetChange):
    """A change that the drift does not explain; its p-value is multiplied by the number of tests."""

    p_value: Annotated[float, it("of a jump, adjusted")]


@record
class Undecided(OffsetChange):
    """A change that may be a jump or drift: the uncertainty of the results does not explain it, and the other
    results do not determine the rate of the drift."""

    least_jump: Annotated[
        float, it("of what may be drift: the size from which such a change would be a jump")
    ]


@dataclass(frozen=True, eq=False)
class Drift:
    """The offsets of an arm over time. An offset at a result is as uncertain as its noise and the drift make
    it (`by_noise`), and as the geometry does, once.

    `smoothed` is of K drift rates with the `weights` (K,); `p_first` (T - 1, m) are the
    p-values of the first tests, before any jump was allowed, not multiplied, nan where no result determines
    the offset on one side. `jumps` and `undecided` are in the order of time; `changed` is whether any change
    that is no jump exceeds its uncertainty. `effective` is the effective number of rates, `passes` what they
    are points of.
    """

    series: Series
    smoothed: Smoothed
    weights: Matrix
    p_first: Matrix
    jumps: tuple[Jump, ...]
    undecided: tuple[Undecided, ...]
    changed: bool
    effective: float
    passes: tuple[Pass, ...]

    @property
    def rates(self) -> Matrix:
        """(K, m) drift rates."""
        return self.smoothed.rates

    def interval(self, t: int, along: Matrix, level: float = LEVEL) -> tuple[float, float]:
        """The interval of the combination `along` (m,) of the offsets at result t; UnsoundResult where one
        of them is not determined there (`Series.determined`)."""
        mean, variance = self._combined(t, along)
        return mixture_interval(mean, np.sqrt(variance), self.weights, level)

    def value(self, t: int, along: Matrix) -> tuple[float, float]:
        """Mean and standard uncertainty of the same."""
        mean, variance = self._combined(t, along)
        centre = float(self.weights @ mean)
        return centre, math.sqrt(self.weights @ (variance + (mean - centre) ** 2))

    def _combined(self, t: int, along: Matrix) -> tuple[Matrix, Matrix]:
        """Its mean and variance (K,) for each of the rates."""
        self._require_determined(t, along)
        if t in (-1, len(self.series.observations) - 1):
            mean, covariance = self.by_noise.last
        else:
            mean, covariance = self.by_noise.mean[:, t], self.by_noise.covariance[:, t]
        variance = np.einsum("i,kij,j->k", along, covariance, along) + self.shared_variance(along)
        return mean @ along, variance

    def _require_determined(self, t: int, along: Matrix) -> None:
        lost = np.flatnonzero((along != 0) & ~self.series.determined[t])
        if len(lost):
            names = ", ".join(self.series.names[i] for i in lost)
            raise UnsoundResult(f"no result since the last reset determines {names}")

    @cached_property
    def by_noise(self) -> Smoothed:
        """The states for the same rates and weights, by results as uncertain as their noise makes them: what
        the geometry adds is added once (`shared_variance`), not of each result and again."""
        observations = self.series.observations
        if not any(one.shared.any() for one in observations):
            return self.smoothed
        alone = tuple(replace(one, shared=np.zeros_like(one.shared)) for one in observations)
        return smooth(replace(self.series, observations=alone), self.rates, self.smoothed.jumps)

    def shared_variance(self, along: Matrix) -> float:
        """The variance by deviations of the geometry, which many results do not average out: the largest of
        any."""
        return float(np.einsum("i,tij,j->t", along, self._shared, along).max())

    @cached_property
    def _shared(self) -> Matrix:
        """(T, m, m) what the geometry adds to each result; 0 where it does not determine an offset."""
        whole = np.zeros((len(self.series.observations), len(self.series.names), len(self.series.names)))
        for t, observation in enumerate(self.series.observations):
            at = [self.series.names.index(name) for name in observation.names]
            whole[t][np.ix_(at, at)] = observation.shared
        return whole

    def determines_rate(self, offset: str) -> bool:
        """Whether the results say anything of an offset's drift rate: two determine it without a jump or a
        reset in between. Where not, its rate is the prior alone."""
        j = self.series.names.index(offset)
        breaks = {*self.series.reset, *(jump.place for jump in self.jumps if jump.offset == offset)}
        segment = np.cumsum([0, *(t in breaks for t in range(len(self.series.observations) - 1))])
        return bool(np.bincount(segment[self.series.observed[:, j]], minlength=1).max() > 1)

    def rate(self, offset: str) -> tuple[float, tuple[float, float]]:
        """Median and 95 % interval of an offset's drift rate, per root year."""
        return median_interval(self.rates[:, self.series.names.index(offset)], self.weights)

    @property
    def allowed(self) -> Matrix:
        """(T - 1, m) where an offset may change by any amount: jumps that were found, and resets."""
        return allowed(self.series, ((jump.place, jump.offset) for jump in self.jumps))

    def without_states(self) -> Drift:
        """The same, the states that were computed forgotten: most of the memory, for many arms."""
        return replace(self, smoothed=replace(self.smoothed))


def drift(series: Series, *, alarm: float = ALARM, seed: int = 0) -> Drift:
    """The drift of an arm with two results or more; BadInput where there are fewer."""
    if len(series.observations) < 2 or not series.names:
        raise BadInput(
            "drift needs two results of the arm that determine an offset",
            found=str(len(series.observations)),
            remedy="add more results to the history",
        )
    jumps = allowed(series, ())
    p_first = np.full(jumps.shape, np.nan)
    jumps_found: list[tuple[int, int, float]] = []
    while True:
        smoothed, nodes = integrated(series, jumps, seed)
        tests = _jump_tests(smoothed, nodes, seed)
        p_values = {
            tested: p_value
            for some in tests
            for tested, p_value in zip(some.places, some.p_value.tolist(), strict=True)
        }
        if not jumps_found:
            for tested, p_value in p_values.items():
                p_first[tested] = p_value
        single = alarm / max(np.isfinite(p_first).sum(), 1)  # of each test
        clearest = min(p_values, key=p_values.__getitem__, default=None)
        if clearest is None or p_values[clearest] > single or len(jumps_found) >= _MOST_JUMPS:
            break
        jumps = jumps.copy()
        jumps[clearest] = True
        jumps_found.append((*clearest, p_values[clearest] / single * alarm))
    weights = normalised(smoothed.log_likelihood + nodes.over)
    undecided = [one for some in tests for one in some.undecided(series, single)]
    return Drift(
        series=series,
        smoothed=smoothed,
        weights=weights,
        p_first=p_first,
        jumps=tuple(_jump(smoothed, weights, *jump) for jump in sorted(jumps_found)),
        undecided=tuple(sorted(undecided, key=lambda one: (one.place, series.names.index(one.offset)))),
        changed=any((some.p_same <= single).any() for some in tests),
        effective=effective(weights),
        passes=nodes.passes,
    )


def allowed(series: Series, jumps: Iterable[tuple[int, str]]) -> Matrix:
    """(T - 1, m) whether an offset may change by any amount: after `jumps` (result, offset), and resets."""
    result = np.zeros((len(series.observations) - 1, len(series.names)), dtype=bool)
    result[list(series.reset)] = True
    for after, offset in jumps:
        result[after, series.names.index(offset)] = True
    return result


def median_interval(values: Matrix, weights: Matrix) -> tuple[float, tuple[float, float]]:
    """Median and central 95 % interval of weighted values: straight between the values, so that a small
    change of a weight is a small one of a quantile."""
    order = np.argsort(values)
    at = np.cumsum(weights[order]) - weights[order] / 2
    low, middle, high = np.interp((0.025, 0.5, 0.975), at, values[order]).tolist()
    return middle, (low, high)


def mixture_interval(mean: Matrix, std: Matrix, weights: Matrix, level: float) -> tuple[float, float]:
    """The central interval of a mixture of normal distributions."""
    low, high = (mixture_quantile(mean, std, weights, (1 + side * level) / 2) for side in (-1, 1))
    return float(low), float(high)


def mixture_quantile(mean: Matrix, std: Matrix, weights: Matrix, q: float) -> Matrix:
    """The quantile q of mixtures of normal distributions (K, ...) with the `weights` (K,), by Newton's steps
    and, where one leaves the interval that the quantile is in, bisection."""
    low, high = (mean - 12 * std).min(axis=0), (mean + 12 * std).max(axis=0)
    close, middle = _CLOSE * std.min(axis=0), weights @ mean
    spread = np.sqrt(weights @ (std**2 + (mean - middle) ** 2))
    at = np.clip(middle + special.ndtri(q) * spread, low, high)
    for _ in range(_STEPS):
        z = (at - mean) / std
        excess, slope = weights @ special.ndtr(z) - q, weights @ (np.exp(-(z**2) / 2) / std) / _ROOT_2_PI
        low, high = np.where(excess < 0, at, low), np.where(excess < 0, high, at)
        step = at - excess / np.maximum(slope, np.finfo(float).tiny)
        before, at = at, np.where((low < step) & (step < high), step, (low + high) / 2)
        if (np.abs(at - before) <= close).all():
            break
    return np.asarray(at)


def integrated(series: Series, jumps: Matrix, seed: int) -> tuple[Smoothed, Nodes]:
    """The states for K rates, and the nodes that are their logarithms."""
    size = len(series.names)
    prior: Pass = (np.full(size, math.log(MEDIAN)), SPREAD * np.eye(size))
    parts: list[Smoothed] = []

    def log_likelihood(points: Matrix) -> Matrix:
        parts.append(smooth(series, np.exp(points), jumps))
        return parts[-1].log_likelihood

    nodes, _ = sampled(log_likelihood, [prior], _PASSES, _NODES, seed)
    return Smoothed.joined(parts), nodes


def _jump(smoothed: Smoothed, weights: Matrix, t: int, j: int, p_value: float) -> Jump:
    """The size of a jump that is allowed for, the drift of that interval in it."""
    series, (mean, _, step_variance) = smoothed.series, smoothed.states(slice(t, t + 2))
    step = mean[:, 1, j] - mean[:, 0, j]
    low, high = mixture_interval(step, np.sqrt(step_variance[:, 0, j]), weights, LEVEL)
    return Jump(series.names[j], series.units[j], t, float(weights @ step), (low, high), p_value)


# The interval of one offset at the results, between them and ahead; when the next calibration is due.
#
# Between two results a random walk is a Brownian bridge: with the states a and b at their ends, the share s
# of the time passed and the variance q of the walk over all of it, its mean is (1 - s) a + s b and its
# variance s (1 - s) q. So an interval is widest in the middle. After the last result the walk goes on
# alone.

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
