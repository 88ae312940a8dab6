"""The results of an arm over time, and the exact smoother of their random walk for many drift rates at once.

    x[t+1] = x[t] + w[t],  w[t] ~ N(0, diag(rate^2) gap[t]);   information J[t], J[t] y[t] of each result

with nothing known of x[0], in information form: what the results before a state say of it, and what those
after it say, by one filter that goes forward and one that goes backward (Fraser and Potter 1969). The noise
of a step is independent from offset to offset, so a step takes it in one offset after the other, each a
change of rank one. A result that does not determine a direction has no information in it and adds nothing.
Where a jump is allowed, the walk has no information: 0 in place of 1 / (rate^2 gap).

The rates are the last axis of every array within: numpy works along it, for all rates at once. Where a C
compiler is at hand, the filter and the tests of jumps are compiled (smoother.c). The numbers are the same to
rounding."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np

from ...model.arrays import Index, Matrix
from ...model.c_source import LANES
from ...model.errors import UnsoundResult
from ...model.kernel import compiled_library

_SOURCE = Path(__file__).parent / "smoother.c"
_LANES = 8  # at most, of the machine's vectors
_AT_ONCE = 256  # rates: what fast memory holds


@dataclass(frozen=True, eq=False)
class Observation:
    """One result: `at` in years, the offsets that it determines without any prior (m of them), their
    `covariance` (m, m) in full, and what the tolerances of the geometry add to it, the same in all results of
    the arm (`shared`, m x m; 0 for nominal geometry)."""

    at: float
    names: tuple[str, ...]
    values: Matrix
    covariance: Matrix
    shared: Matrix

    def __post_init__(self) -> None:
        size = len(self.names)
        if self.values.shape != (size,) or not self.covariance.shape == self.shared.shape == (size, size):
            raise UnsoundResult("values and covariance of a result are not of the offsets that it names")


@dataclass(frozen=True, eq=False)
class Series:
    """Results in the order of time. `reset` are the intervals (number of the result before) after which every
    offset begins anew: the controller got new zeros."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    observations: tuple[Observation, ...]
    reset: tuple[int, ...] = ()

    @cached_property
    def gaps(self) -> Matrix:
        """(T - 1,) years between the results; at least an hour, so that two at one time may differ."""
        return np.asarray(
            np.maximum(np.diff([observation.at for observation in self.observations]), 1 / 8766)
        )

    @cached_property
    def observed(self) -> Matrix:
        """(T, m) whether a result determines an offset."""
        return np.array(
            [[name in observation.names for name in self.names] for observation in self.observations]
        )

    @property
    def determined(self) -> Matrix:
        """(T, m) whether a result since the last reset, or until the next, determines an offset: where none
        does, nothing is known of it."""
        result = np.zeros((len(self.observations), len(self.names)), dtype=bool)
        ends = [0, *(t + 1 for t in sorted(self.reset)), len(result)]
        for begin, end in pairwise(ends):
            result[begin:end] = self.observed[begin:end].any(axis=0)
        return result

    def information(self) -> tuple[Matrix, Matrix]:
        """(T, m, m) and (T, m): the information of each result, 0 in every direction that it does not
        determine, and its product with the values.

        Where an offset is not `determined` between two resets, the first result of these has 1: it affects
        nothing else, and the states of the offset there mean nothing.
        """
        return self._information

    @cached_property
    def _information(self) -> tuple[Matrix, Matrix]:
        count, size = len(self.observations), len(self.names)
        matrix, vector = np.zeros((count, size, size)), np.zeros((count, size))
        for t, observation in enumerate(self.observations):
            at = [self.names.index(name) for name in observation.names]
            inverse = np.linalg.inv(observation.covariance + observation.shared)
            matrix[t][np.ix_(at, at)] = (inverse + inverse.T) / 2
            vector[t, at] = inverse @ observation.values
        nowhere = np.logical_not(self.determined)
        for begin in (0, *(t + 1 for t in self.reset)):
            matrix[begin, nowhere[begin], nowhere[begin]] = 1.0
        return matrix, vector


def series_of(
    observations: Sequence[Observation], units: dict[str, str], reset: Sequence[int] = ()
) -> Series:
    """A series over every offset that any of the observations determines, joint 1 first."""
    ordered = tuple(sorted(observations, key=lambda observation: observation.at))
    names = sorted(
        {name for observation in ordered for name in observation.names}, key=lambda name: (len(name), name)
    )
    return Series(tuple(names), tuple(units[name] for name in names), ordered, tuple(reset))


@dataclass(frozen=True, eq=False)
class Filtered:
    """What the results before each of T states, or before the last alone, say of it, for K rates: `precision`
    (T or 1, m, m, K) and `vectors` (T or 1, m, c, K), the result of the state itself not included. With all
    states eliminated, `explained` (c, c, K) is the quadratic form of the vectors, `log_scale` (K,) the
    logarithm of the factor beside it."""

    precision: Matrix
    vectors: Matrix
    explained: Matrix
    log_scale: Matrix

    @staticmethod
    def of(
        information: Matrix, vectors: Matrix, gaps: Matrix, rates: Matrix, jumps: Matrix, *, whole: bool
    ) -> Filtered:
        """Of results (T, m, m) and (T, m, c) in this order, with `gaps` (T - 1,) between them that offsets
        drift in by their `rates` (K, m) but where one of the `jumps` (T - 1, m) is allowed; `whole`: of all
        states."""
        (count, size, columns), number = vectors.shape, len(rates)
        # The vectors stand beside the matrix: a step changes both alike.
        added = np.concatenate([information, vectors], axis=2)
        kept = np.empty((count if whole else 1, size, size + columns, number))
        explained, factor = np.empty((columns, columns, number)), np.empty(number)
        steps = _Steps.of(gaps, rates, jumps)
        if (library := _library()) is None:
            _filter(added, steps, kept, explained, factor)
        else:
            states = len(kept) * size * (size + columns)
            work = np.empty((states + columns**2 + (size + 1) * (size + columns)) * _LANES)
            library.zb_filter(
                count, size, columns, number, _at(added), *steps.addresses, whole,
                *map(_at, (kept, explained, factor, work)),
            )  # fmt: skip
        walks = np.logical_not(jumps)
        log_variance = 2 * np.log(rates) @ walks.sum(axis=0) + np.log(gaps) @ walks.sum(axis=1)
        return Filtered(kept[:, :, :size], kept[:, :, size:], explained, -(factor + log_variance) / 2)


@dataclass(frozen=True, eq=False)
class _Steps:
    """What the steps say: 1 / gap (T - 1,) times 1 / rate^2 (m, K), nothing where `jumps` (T - 1, m)."""

    per_gap: Matrix
    precision: Matrix
    jumps: Matrix

    @staticmethod
    def of(gaps: Matrix, rates: Matrix, jumps: Matrix) -> _Steps:
        return _Steps(1 / gaps, 1 / np.ascontiguousarray(rates.T) ** 2, np.ascontiguousarray(jumps))

    @property
    def of_all(self) -> Matrix:
        """(T - 1, m, K) of each step."""
        return np.where(self.jumps[:, :, None], 0.0, self.per_gap[:, None, None] * self.precision)

    @property
    def addresses(self) -> tuple[int, int, int]:
        return _at(self.per_gap), _at(self.precision), _at(self.jumps)


@dataclass(frozen=True, eq=False)
class Smoothed:
    """The states of a series for each of the K `rates` (K, m), where `jumps` (T - 1, m) are allowed; what is
    not asked for is not computed. `forward` is what the results before the last state say of it."""

    series: Series
    rates: Matrix
    jumps: Matrix
    forward: Filtered

    @staticmethod
    def joined(parts: Sequence[Smoothed]) -> Smoothed:
        """For the rates of all parts, which are of one series."""
        arrays = [[getattr(part.forward, field.name) for part in parts] for field in fields(Filtered)]
        forward = Filtered(*(np.concatenate(array, axis=-1) for array in arrays))
        return replace(parts[0], rates=np.concatenate([part.rates for part in parts]), forward=forward)

    @cached_property
    def log_likelihood(self) -> Matrix:
        """(K,) up to a constant."""
        return np.asarray(self.forward.log_scale + self.forward.explained[0, 0] / 2)

    @cached_property
    def last(self) -> tuple[Matrix, Matrix]:
        """Mean (K, m) and covariance (K, m, m) of the state at the last result."""
        information, vector = self.series.information()
        return _state(
            self.forward.precision[-1] + information[-1][:, :, None],
            self.forward.vectors[-1, :, 0] + vector[-1][:, None],
        )

    def _both(self) -> tuple[Matrix, Matrix, Matrix, Matrix]:
        """(T, m, m, K) and (T, m, K): what the results before each say of its state, and what it and those
        after it say."""
        information, vector = self.series.information()
        forward = filtered(self.series, self.rates, self.jumps, vector[:, :, None])
        back = self.series.gaps[::-1], self.rates, self.jumps[::-1]
        behind = Filtered.of(information[::-1], vector[::-1, :, None], *back, whole=True)
        precision, weighted = behind.precision[::-1], behind.vectors[::-1, :, 0]
        of_both = precision + information[..., None], weighted + vector[..., None]
        return forward.precision, forward.vectors[:, :, 0], *of_both

    @property
    def mean(self) -> Matrix:
        """(K, T, m) of each state."""
        return self._states[0]

    @property
    def covariance(self) -> Matrix:
        """(K, T, m, m) of each state."""
        return self._states[1]

    @property
    def step_variance(self) -> Matrix:
        """(K, T - 1, m) of the change from one result to the next."""
        return self._states[2]

    @cached_property
    def _states(self) -> tuple[Matrix, Matrix, Matrix]:
        return self.states(slice(None))

    def states(self, some: slice) -> tuple[Matrix, Matrix, Matrix]:
        """Mean (K, t, m) and covariance (K, t, m, m) of some states that follow each other, and the variance
        (K, t - 1, m) of the change from one to the next."""
        before, vectors, behind, weighted = (one[some] for one in self._both())
        mean, covariance = _state(np.moveaxis(before + behind, 0, 2), np.moveaxis(vectors + weighted, 0, 1))
        information = self.series.information()[0][some]
        known = np.moveaxis(before[:-1] + information[:-1, :, :, None], 0, 2)
        block, diagonal = known.copy(), np.arange(len(known))
        steps = _Steps.of(self.series.gaps, self.rates, self.jumps).of_all[some][: len(before) - 1]
        block[diagonal, diagonal] += np.moveaxis(steps, 0, 1)
        left = _inverse(block)
        # x[t+1] - x[t] = (F + W)^-1 (F x[t+1] - what F y is).
        stay = _product(left, known)
        of_next = np.moveaxis(covariance[:, 1:], (2, 3, 1, 0), (0, 1, 2, 3))
        variance = left[diagonal, diagonal] + (_product(stay, of_next) * stay).sum(axis=1)
        return mean, covariance, np.moveaxis(variance, (0, 1, 2), (2, 1, 0))

    def jumps_after(self, intervals: Sequence[int]) -> tuple[Matrix, Matrix]:
        """Of a jump of each offset in each of n intervals (number of the result before), K rates: the `score`
        (n, m, K), r / sqrt(N) of de Jong and Penzer (1998), standard normal if there is no jump, and the
        `power` (n, m, K), the information N about a jump, 0 where nothing is known of it."""
        library, after = _library(), np.array(intervals, dtype=np.int64)
        if library is not None:
            return _compiled_jumps(library, self, after)
        if len(self.rates) > _AT_ONCE:
            some = [self.rates[k : k + _AT_ONCE] for k in range(0, len(self.rates), _AT_ONCE)]
            scores, powers = zip(*(replace(self, rates=r).jumps_after(intervals) for r in some), strict=True)
            return np.concatenate(scores, -1), np.concatenate(powers, -1)
        before, vectors, behind, weighted = (one[after + 1] for one in self._both())
        f, b = np.moveaxis(before, 0, 2), np.moveaxis(behind, 0, 2)
        v, u = np.moveaxis(vectors, 0, 1), np.moveaxis(weighted, 0, 1)
        whole = _inverse(f + b)
        # N = (F^-1 + B^-1)^-1 = F (F + B)^-1 B: without a difference, of which rounding would leave nothing.
        power = np.maximum((_product(f, whole) * b).sum(axis=1), 0.0)
        moved = _applied(f, _applied(whole, u)) - _applied(b, _applied(whole, v))
        score = np.where(power > 0, moved / np.sqrt(np.where(power > 0, power, 1.0)), 0.0)
        return np.moveaxis(score, 0, 1), np.moveaxis(power, 0, 1)


def smooth(series: Series, rates: Matrix, jumps: Matrix) -> Smoothed:
    """The states for `rates` (K, m) per root year; `jumps` (T - 1, m) says where a jump is allowed."""
    vectors = series.information()[1][:, :, None]
    return Smoothed(series, rates, jumps, filtered(series, rates, jumps, vectors, whole=False))


def filtered(
    series: Series, rates: Matrix, jumps: Matrix, vectors: Matrix, *, whole: bool = True
) -> Filtered:
    """What the results say of the states, for c columns in place of their values (T, m, c)."""
    return Filtered.of(series.information()[0], vectors, series.gaps, rates, jumps, whole=whole)


@dataclass(frozen=True, eq=False)
class SeveralSeries:
    """A series of the same offsets, their results one after the other: `added` (R, m, m + 1) information and
    its product with the values, `per_gap` (R,) and `jumps` (R, m) of the step behind each, the last of a
    series without meaning; `counts` (A,) results each."""

    names: tuple[str, ...]
    series: tuple[tuple[Series, Matrix], ...]
    added: Matrix
    per_gap: Matrix
    jumps: Matrix
    counts: Index

    @staticmethod
    def of(series: Sequence[tuple[Series, Matrix]]) -> SeveralSeries:
        """Each with the jumps (T - 1, m) that are allowed in it."""
        added = [
            np.concatenate([one.information()[0], one.information()[1][:, :, None]], 2) for one, _ in series
        ]
        per_gap = [np.append(1 / one.gaps, 1.0) for one, _ in series]
        jumps = [np.concatenate([allowed, np.ones_like(allowed[:1])]) for _, allowed in series]
        both, per_gaps, allowed_in = map(np.concatenate, (added, per_gap, jumps))
        counts = np.array([*map(len, added)])
        return SeveralSeries(series[0][0].names, tuple(series), both, per_gaps, allowed_in, counts)

    def log_likelihood(self, log_rates: Matrix) -> Matrix:
        """(A, K) for the logarithms of rates (A, K, m), up to a constant."""
        library, (arms, number, size) = _library(), log_rates.shape
        if library is None:
            each = zip(self.series, np.exp(log_rates), strict=True)
            return np.array([smooth(one, rates, jumps).log_likelihood for (one, jumps), rates in each])
        precision, result = np.exp(-2 * log_rates.swapaxes(1, 2), order="C"), np.empty((arms, number))
        work = np.empty(((2 * size + 1) * (size + 1) + 1) * _LANES)
        library.zb_likelihoods(
            arms, size, number, *map(_at, (self.counts, self.added, self.per_gap, precision, self.jumps)),
            *map(_at, (result, work)),
        )  # fmt: skip
        walks = np.logical_not(self.jumps)
        begins = np.cumsum(self.counts) - self.counts
        of_gaps = np.add.reduceat(walks.sum(axis=1) * np.log(self.per_gap), begins)
        of_rates = np.add.reduceat(walks, begins, axis=0, dtype=float)
        result -= (log_rates @ of_rates[:, :, None])[:, :, 0] - of_gaps[:, None] / 2
        return result


def _state(precision: Matrix, vector: Matrix) -> tuple[Matrix, Matrix]:
    """Mean (K, …, m) and covariance (K, …, m, m) of information (m, m, …, K) and (m, …, K)."""
    covariance = _inverse(precision)
    mean = _applied(covariance, vector)
    return np.moveaxis(mean, 0, -1).swapaxes(0, -2), np.moveaxis(covariance, (0, 1), (-2, -1)).swapaxes(0, -3)


def _inverse(matrices: Matrix) -> Matrix:
    """(m, m, …) of symmetric positive definite ones, by sweeps (Goodnight 1979)."""
    swept = matrices.copy()
    for k in range(len(swept)):
        pivot, column = swept[k, k].copy(), swept[:, k].copy()
        row = column / pivot
        swept -= column[:, None] * row
        swept[k], swept[:, k], swept[k, k] = row, row, -1 / pivot
    return -swept


def _product(one: Matrix, other: Matrix) -> Matrix:
    """(m, m, …) of two of these."""
    return np.asarray(sum(one[:, k, None] * other[k] for k in range(len(other))))


def _applied(matrices: Matrix, vectors: Matrix) -> Matrix:
    """(m, …) of (m, m, …) and (m, …)."""
    return np.asarray((matrices * vectors).sum(axis=1))


def _filter(added: Matrix, steps: _Steps, kept: Matrix, explained: Matrix, factor: Matrix) -> None:
    """The filter of `added` (T, m, m + c): `kept` (T or 1, m, m + c, K) is what is known before each result
    or before the last, `explained` (c, c, K) as of `Filtered`, `factor` (K,) the logarithm of what all
    offsets are eliminated with."""
    size = kept.shape[1]
    known = np.zeros(kept.shape[1:])
    explained[...], factor[...] = 0.0, 0.0
    # Behind the last state a step that may be anything: with it the last state is eliminated, too.
    for t, step in enumerate(np.concatenate([steps.of_all, np.zeros((1, size, len(factor)))])):
        kept[t if len(kept) > 1 else 0] = known
        known += added[t][..., None]
        for j in range(size):
            row = known[j].copy()
            over = 1 / (row[j] + step[j])
            # The offset itself without the difference, of which rounding would leave nothing where the walk
            # is slow, or allowed to jump.
            of_offset, part = row * (step[j] * over), row * over
            factor -= np.log(over)
            explained += part[size:, None] * row[size:]
            known -= part[:size, None] * row
            known[j], known[:, j] = of_offset, of_offset[:size]


def _compiled_jumps(library: ctypes.CDLL, smoothed: Smoothed, after: Index) -> tuple[Matrix, Matrix]:
    """`Smoothed.jumps_after` by C, which filters once more: what it needs of that stays in fast memory."""
    series, rates = smoothed.series, len(smoothed.rates)
    information, vector = series.information()
    count, size = vector.shape
    added = np.concatenate([information, vector[:, :, None]], axis=2)
    score, power = np.empty((2, len(after), size, rates))
    work = np.empty(((2 * count + 3) * size * (size + 1) + (size + 2) ** 2) * _LANES)
    steps = _Steps.of(series.gaps, smoothed.rates, smoothed.jumps)
    library.zb_jumps(
        count, size, rates, _at(added), *steps.addresses, len(after), *map(_at, (after, score, power, work))
    )
    return score, power


def _at(array: Matrix) -> int:
    """Where its numbers are; `array.ctypes.data` takes as long as some filters."""
    return int(array.__array_interface__["data"][0])


@cache
def _library() -> ctypes.CDLL | None:
    pointer, whole = ctypes.c_void_p, ctypes.c_longlong
    return compiled_library(
        "smoother",
        lambda: LANES + _SOURCE.read_text(encoding="utf-8"),
        {
            "zb_filter": [*([whole] * 4), *([pointer] * 4), whole, *([pointer] * 4)],
            "zb_likelihoods": [*([whole] * 3), *([pointer] * 7)],
            "zb_jumps": [*([whole] * 3), *([pointer] * 4), whole, *([pointer] * 4)],
        },
        make=True,
        flags=["-O2"],
    )
