"""What an arm's results say of its drift: rates of the random walk, jumps, the offsets at each result.

The drift rate of each offset is unknown and integrated over (`importance.py`): its logarithm is normal about
`MEDIAN` with the standard deviation `SPREAD`, per root year.

Jumps: an offset may change by any amount between two results. The test of one offset and interval is
predictive. Given the rates and whatever of the data a jump leaves unchanged, the score of the jump is
standard normal (de Jong and Penzer 1998); the rates have their distribution by that part of the data alone:
the posterior with the likelihood of the jump divided out. So the p-value is uniform if there is no jump, over
the prior of the rates, and a jump does not hide itself by a larger rate. Where a jump is large these two
distributions lie far apart, and rates are sampled for the test itself. The p-values are multiplied by their
number (Bonferroni): false alarms of an arm have at most the probability `ALARM`. The clearest jump is allowed
for, and the rest tested again, until none is left."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from typing import Annotated

import numpy as np
from scipy import special

from ...model.arrays import Matrix
from ...model.errors import BadInput, UnsoundResult
from ...model.records import internal, it, record
from .importance import ENOUGH, MOST, Pass, about, effective, from_pass, normalised, over_passes, sampled
from .smoother import Series, Smoothed, smooth

_KNOWN = 0.5  # std of a known log rate over that of its prior: three times the prior's information
_STEPS = 60  # of a bisection
ALARM = 0.01  # probability of a false alarm, of an arm
MEDIAN, SPREAD = 0.01, 1.5  # deg or mm per root year, and of its natural logarithm
LEVEL = 0.95
_NODES = 256  # of each pass; a power of two
_PASSES = 4  # after the first
_MOST_JUMPS = 20


@dataclass(frozen=True, eq=False)
class JumpTest:
    """Offset j between the results t and t + 1, of K rates with the `weights` (K,) that they have by all data
    but the change itself.

    `change` (K,) is the step by the results before and after, `noise` (K,) its variance by their uncertainty,
    `drift_variance` (K,) that by the drift in the interval. `rate_known`: whether the other results determine
    the rate of the drift, so that a change can be compared with it.
    """

    weights: Matrix
    change: Matrix
    noise: Matrix
    drift_variance: Matrix
    rate_known: bool

    @property
    def p_value(self) -> float:
        """Two-sided, not adjusted: of so large a change without a jump."""
        score = self.change / np.sqrt(self.noise + self.drift_variance)
        below, above = self.weights @ special.ndtr(score), self.weights @ special.ndtr(-score)
        return min(1.0, 2 * float(min(below, above)))

    @property
    def p_same(self) -> float:
        """Two-sided, not adjusted: of so large a change with neither jump nor drift."""
        return float(2 * self.weights @ special.ndtr(-np.abs(self.change) / np.sqrt(self.noise)))

    def least_jump(self, p_value: float) -> float:
        """The smallest change with this p-value."""
        std = np.sqrt(self.noise + self.drift_variance)
        low, high = 0.0, float(-special.ndtri(p_value / 2) * std.max())
        for _ in range(_STEPS):
            middle = (low + high) / 2
            too_small = 2 * self.weights @ special.ndtr(-middle / std) > p_value
            low, high = (middle, high) if too_small else (low, middle)
        return high


def _jump_tests(
    series: Series, rates: Matrix, smoothed: Smoothed, passes: Sequence[Pass], jumps: Matrix, seed: int
) -> dict[tuple[int, int], JumpTest]:
    """The tests by interval and offset, none where a jump is allowed already or one side has no result of the
    offset. `smoothed` is of the `rates` (K, m), which were sampled from the `passes`."""
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
            tests[t, j] = _jump_test(series, scored, over, passes, jumps, (t, j), seed)
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


def _jump_test(
    series: Series,
    scored: _Scored,
    over: Matrix,
    passes: Sequence[Pass],
    jumps: Matrix,
    interval: tuple[int, int],
    seed: int,
) -> JumpTest:
    """The test of one `interval` and offset by these rates; where too few of them count, by more: first with
    the prior of the rate of the tested offset, then about those that count."""
    t, j = interval
    weights = scored.weights(over)
    prior, more = passes[0], list(passes)
    while effective(weights) < ENOUGH and len(more) < len(passes) + MOST:
        more.append(
            _with_prior_of(j, passes[-1], prior)
            if len(more) == len(passes)
            else about(np.log(scored.rates), weights)
        )
        rates = np.exp(from_pass(more[-1], _NODES, seed + len(more) - 1))
        added = _Scored.of(rates, smooth(series, rates, jumps), t, j)
        scored = _Scored(*map(np.concatenate, zip(astuple(scored), astuple(added), strict=True)))
        weights = scored.weights(over_passes(np.log(scored.rates), more))
    variance = 1 / scored.power
    drift_variance = scored.rates[:, j] ** 2 * series.gaps[t]
    log_rate = np.log(scored.rates[:, j])
    spread = weights @ (log_rate - weights @ log_rate) ** 2
    return JumpTest(
        weights=weights,
        change=scored.score * np.sqrt(variance),
        noise=np.maximum(variance - drift_variance, 0.0),
        drift_variance=drift_variance,
        rate_known=bool(spread <= (_KNOWN * prior[1][j, j]) ** 2),
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
    """The offsets of an arm over time.

    `smoothed` is of the K drift rates `rates` (K, m) with the `weights` (K,); `p_first` (T - 1, m) are the
    p-values of the first tests, before any jump was allowed, not multiplied, nan where no result determines
    the offset on one side. `jumps` and `undecided` are in the order of time; `changed` is whether any change
    that is no jump exceeds its uncertainty. `effective` is the effective number of rates, `passes` what they
    are points of.
    """

    series: Series
    smoothed: Smoothed
    rates: Matrix
    weights: Matrix
    p_first: Matrix
    jumps: tuple[Jump, ...]
    undecided: tuple[Undecided, ...]
    changed: bool
    effective: float
    passes: tuple[Pass, ...]

    def interval(self, t: int, along: Matrix, level: float = LEVEL) -> tuple[float, float]:
        """The interval of the combination `along` (m,) of the offsets at result t; UnsoundResult where one
        of them is not determined there (`Series.determined`)."""
        self._require_determined(t, along)
        mean = self.smoothed.mean[:, t] @ along
        variance = np.einsum("i,kij,j->k", along, self.smoothed.covariance[:, t], along)
        variance = variance + self.shared_variance(along)
        return mixture_interval(mean, np.sqrt(variance), self.weights, level)

    def value(self, t: int, along: Matrix) -> tuple[float, float]:
        """Mean and standard uncertainty of the same."""
        self._require_determined(t, along)
        mean = self.smoothed.mean[:, t] @ along
        variance = np.einsum("i,kij,j->k", along, self.smoothed.covariance[:, t], along)
        centre = float(self.weights @ mean)
        spread = float(self.weights @ (variance + (mean - centre) ** 2)) + self.shared_variance(along)
        return centre, math.sqrt(spread)

    def _require_determined(self, t: int, along: Matrix) -> None:
        lost = np.flatnonzero((along != 0) & ~self.series.determined[t])
        if len(lost):
            names = ", ".join(self.series.names[i] for i in lost)
            raise UnsoundResult(f"no result since the last reset determines {names}")

    def shared_variance(self, along: Matrix) -> float:
        """The variance by deviations of the geometry, which many results do not average out: the largest of
        any."""
        variances = [0.0]
        for observation in self.series.observations:
            part = along[[self.series.names.index(name) for name in observation.names]]
            variances.append(float(part @ observation.shared @ part))
        return max(variances)

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

    def at_last(self) -> Drift:
        """The same with the states at the last result alone: a tenth of the memory, for many arms."""
        smoothed = self.smoothed
        few = Smoothed(
            smoothed.mean[:, -1:].copy(),
            smoothed.covariance[:, -1:].copy(),
            smoothed.log_likelihood,
            *(part[:, :0].copy() for part in (smoothed.score, smoothed.power, smoothed.step_variance)),
        )
        return replace(self, smoothed=few)


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
        rates, log_weight, smoothed, passes = integrated(series, jumps, seed)
        tests = _jump_tests(series, rates, smoothed, passes, jumps, seed)
        p_values = {interval: test.p_value for interval, test in tests.items()}
        if not jumps_found:
            for interval, p_value in p_values.items():
                p_first[interval] = p_value
        single = alarm / max(np.isfinite(p_first).sum(), 1)  # of each test
        clearest = min(p_values, key=p_values.__getitem__, default=None)
        if clearest is None or p_values[clearest] > single or len(jumps_found) >= _MOST_JUMPS:
            break
        jumps[clearest] = True
        jumps_found.append((*clearest, p_values[clearest] / single * alarm))
    weights = normalised(log_weight)
    return Drift(
        series=series,
        smoothed=smoothed,
        rates=rates,
        weights=weights,
        p_first=p_first,
        jumps=tuple(_jump(series, smoothed, weights, *jump) for jump in sorted(jumps_found)),
        undecided=tuple(_undecided(series, tests, single)),
        changed=any(test.p_same <= single for test in tests.values()),
        effective=effective(weights),
        passes=passes,
    )


def allowed(series: Series, jumps: Iterable[tuple[int, str]]) -> Matrix:
    """(T - 1, m) whether an offset may change by any amount: after `jumps` (result, offset), and resets."""
    result = np.zeros((len(series.observations) - 1, len(series.names)), dtype=bool)
    result[list(series.reset)] = True
    for after, offset in jumps:
        result[after, series.names.index(offset)] = True
    return result


def median_interval(values: Matrix, weights: Matrix) -> tuple[float, tuple[float, float]]:
    """Median and central 95 % interval of weighted values."""
    order = np.argsort(values)
    at = np.cumsum(weights[order])
    rows = np.minimum(np.searchsorted(at, (0.025, 0.5, 0.975)), len(values) - 1)
    low, middle, high = values[order][rows].tolist()
    return middle, (low, high)


def mixture_interval(mean: Matrix, std: Matrix, weights: Matrix, level: float) -> tuple[float, float]:
    """The central interval of a mixture of normal distributions, by bisection."""

    low, high = (mixture_quantile(mean, std, weights, (1 + side * level) / 2) for side in (-1, 1))
    return float(low), float(high)


def mixture_quantile(mean: Matrix, std: Matrix, weights: Matrix, q: float, *, steps: int = 60) -> Matrix:
    """The quantile q of mixtures of normal distributions (K, ...) with the `weights` (K,), by bisection."""
    low, high = (mean - 12 * std).min(axis=0), (mean + 12 * std).max(axis=0)
    for _ in range(steps):
        middle = (low + high) / 2
        below = weights @ special.ndtr((middle - mean) / std) < q
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray((low + high) / 2)


def integrated(series: Series, jumps: Matrix, seed: int) -> tuple[Matrix, Matrix, Smoothed, tuple[Pass, ...]]:
    """Rates (K, m), the logarithms of their weights (K,), the states for each, and the passes."""
    size = len(series.names)
    passes: list[Pass] = [(np.full(size, math.log(MEDIAN)), SPREAD * np.eye(size))]
    parts: list[Smoothed] = []

    def log_likelihood(points: Matrix) -> Matrix:
        parts.append(smooth(series, np.exp(points), jumps))
        return parts[-1].log_likelihood

    points, _ = sampled(log_likelihood, passes, _PASSES, _NODES, seed)
    smoothed = Smoothed(*(np.concatenate(field) for field in zip(*map(astuple, parts), strict=True)))
    log_weight = smoothed.log_likelihood + over_passes(points, passes)
    return np.exp(points), log_weight, smoothed, tuple(passes)


def _jump(series: Series, smoothed: Smoothed, weights: Matrix, t: int, j: int, p_value: float) -> Jump:
    """The size of a jump that is allowed for, the drift of that interval in it."""
    step = smoothed.mean[:, t + 1, j] - smoothed.mean[:, t, j]
    variance = smoothed.step_variance[:, t, j]
    low, high = mixture_interval(step, np.sqrt(variance), weights, LEVEL)
    return Jump(series.names[j], series.units[j], t, float(weights @ step), (low, high), p_value)


def _undecided(
    series: Series, tests: Mapping[tuple[int, int], JumpTest], p_value: float
) -> Iterator[Undecided]:
    """The changes that are no jump at this (single) p-value, and may be one."""
    for (t, j), test in sorted(tests.items()):
        if test.rate_known or test.p_same > p_value or test.p_value <= p_value:
            continue
        interval95 = mixture_interval(test.change, np.sqrt(test.noise), test.weights, LEVEL)
        size = float(test.weights @ test.change)
        yield Undecided(series.names[j], series.units[j], t, size, interval95, test.least_jump(p_value))
