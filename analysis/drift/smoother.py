"""The results of an arm over time, and the exact smoother of their random walk for many drift rates at once.

    x[t+1] = x[t] + w[t],  w[t] ~ N(0, diag(rate^2) gap[t]);   information J[t], J[t] y[t] of each result

with nothing known of x[0], in information form: what the results before a state say of it, and what those
after it say, by one filter that goes forward and one that goes backward (Fraser and Potter 1969). The noise
of a step is independent from offset to offset, so a step takes it in one offset after the other, each a
change of rank one. A result that does not determine a direction has no information in it and adds nothing.
Where a jump is allowed, the walk has no information: 0 in place of 1 / (rate^2 gap).

The rates are the last axis of every array within: numpy works along it, for all rates at once. Where a C
compiler is at hand, the filter and the tests of jumps are compiled (smoother.c), which take a fourth and a
sixth of numpy's time. The numbers are the same to rounding."""

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

    @property
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
    """What the results before each of T states say of it, for K rates: `precision` (T, m, m, K) and `vectors`
    (T, m, c, K), the result of the state itself not included. With all states eliminated, `explained`
    (c, c, K) is the quadratic form of the vectors, `log_scale` (K,) the logarithm of the factor beside it."""

    precision: Matrix
    vectors: Matrix
    explained: Matrix
    log_scale: Matrix

    @staticmethod
    def of(information: Matrix, vectors: Matrix, variance: Matrix, jumps: Matrix) -> Filtered:
        """Of results (T, m, m) and (T, m, c) in this order, with the `variance` (T - 1, m, K) of the steps
        between them, none where one of the `jumps` (T - 1, m) is allowed."""
        (count, size, columns), rates = vectors.shape, variance.shape[-1]
        # The vectors stand beside the matrix: a step changes both alike.
        added = np.concatenate([information, vectors], axis=2)
        kept = np.empty((count, size, size + columns, rates))
        explained, totals = np.empty((columns, columns, rates)), np.empty((count, size, rates))
        _filter(added, variance, jumps, kept, explained, totals)
        log_scale = -np.log(totals).sum(axis=(0, 1))
        log_scale -= np.log(variance).sum(axis=(0, 1), where=np.logical_not(jumps)[:, :, None])
        return Filtered(kept[:, :, :size], kept[:, :, size:], explained, log_scale / 2)


@dataclass(frozen=True, eq=False)
class Smoothed:
    """The states of a series for each of the K `rates` (K, m), where `jumps` (T - 1, m) are allowed; what is
    not asked for is not computed. `forward` is what the results before each state say of it."""

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

    def at_last(self) -> Smoothed:
        """The same with the state at the last result alone."""
        forward = self.forward
        few = forward.precision[-1:].copy(), forward.vectors[-1:].copy()
        return replace(self, forward=Filtered(*few, forward.explained, forward.log_scale))

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

    @cached_property
    def _backward(self) -> tuple[Matrix, Matrix]:
        """(T, m, m, K) and (T, m, K): what each result and those after it say of its state."""
        information, vector = self.series.information()
        steps = _step_variance(self.series, self.rates)[::-1], self.jumps[::-1]
        backward = Filtered.of(information[::-1], vector[::-1, :, None], *steps)
        return (
            backward.precision[::-1] + information[..., None],
            backward.vectors[::-1, :, 0] + vector[..., None],
        )

    def _some(self, rates: slice) -> Smoothed:
        """For some of the rates."""
        forward = Filtered(*(getattr(self.forward, field.name)[..., rates] for field in fields(Filtered)))
        return replace(self, rates=self.rates[rates], forward=forward)

    @property
    def mean(self) -> Matrix:
        """(K, T, m) of each state."""
        return self._states[0]

    @property
    def covariance(self) -> Matrix:
        """(K, T, m, m) of each state."""
        return self._states[1]

    @cached_property
    def _states(self) -> tuple[Matrix, Matrix]:
        precision, weighted = self._backward
        return _state(
            np.moveaxis(self.forward.precision + precision, 0, 2),
            np.moveaxis(self.forward.vectors[:, :, 0] + weighted, 0, 1),
        )

    @cached_property
    def step_variance(self) -> Matrix:
        """(K, T - 1, m) of the change from one result to the next."""
        information, _ = self.series.information()
        known = np.moveaxis(self.forward.precision[:-1] + information[:-1, :, :, None], 0, 2)
        block, diagonal = known.copy(), np.arange(len(known))
        step_precision = 1 / _step_variance(self.series, self.rates)
        block[diagonal, diagonal] += np.moveaxis(np.where(self.jumps[:, :, None], 0.0, step_precision), 0, 1)
        left = _inverse(block)
        # x[t+1] - x[t] = (F + W)^-1 (F x[t+1] - what F y is).
        stay = _product(left, known)
        covariance = np.moveaxis(self.covariance[:, 1:], (2, 3, 1, 0), (0, 1, 2, 3))
        of_next = (_product(stay, covariance) * stay).sum(axis=1)
        return np.moveaxis(left[diagonal, diagonal] + of_next, (0, 1, 2), (2, 1, 0))

    def jumps_after(self, intervals: Sequence[int]) -> tuple[Matrix, Matrix]:
        """Of a jump of each offset in each of n intervals (number of the result before), K rates: the `score`
        (n, m, K), r / sqrt(N) of de Jong and Penzer (1998), standard normal if there is no jump, and the
        `power` (n, m, K), the information N about a jump, 0 where nothing is known of it."""
        library = _library()
        if library is not None:
            return _compiled_jumps(library, self, np.array(intervals, dtype=np.int64))
        if len(self.rates) > _AT_ONCE:
            starts = range(0, len(self.rates), _AT_ONCE)
            parts = [self._some(slice(k, k + _AT_ONCE)).jumps_after(intervals) for k in starts]
            scores, powers = zip(*parts, strict=True)
            return np.concatenate(scores, -1), np.concatenate(powers, -1)
        at = [t + 1 for t in intervals]
        (precision, weighted), forward = self._backward, self.forward
        f, b = (np.moveaxis(one[at], 0, 2) for one in (forward.precision, precision))
        v, u = (np.moveaxis(one[at], 0, 1) for one in (forward.vectors[:, :, 0], weighted))
        whole = _inverse(f + b)
        # N = (F^-1 + B^-1)^-1 = F (F + B)^-1 B: without a difference, of which rounding would leave nothing.
        power = np.maximum((_product(f, whole) * b).sum(axis=1), 0.0)
        moved = _applied(f, _applied(whole, u)) - _applied(b, _applied(whole, v))
        score = np.where(power > 0, moved / np.sqrt(np.where(power > 0, power, 1.0)), 0.0)
        return np.moveaxis(score, 0, 1), np.moveaxis(power, 0, 1)


def smooth(series: Series, rates: Matrix, jumps: Matrix) -> Smoothed:
    """The states for `rates` (K, m) per root year; `jumps` (T - 1, m) says where a jump is allowed."""
    vectors = series.information()[1][:, :, None]
    return Smoothed(series, rates, jumps, filtered(series, rates, jumps, vectors))


def filtered(series: Series, rates: Matrix, jumps: Matrix, vectors: Matrix) -> Filtered:
    """What the results say of the states, for c columns in place of their values (T, m, c)."""
    return Filtered.of(series.information()[0], vectors, _step_variance(series, rates), jumps)


def _step_variance(series: Series, rates: Matrix) -> Matrix:
    """(T - 1, m, K) of the walk from one result to the next."""
    return np.asarray(series.gaps[:, None, None] * rates.T**2)


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


def _filter(
    added: Matrix, variance: Matrix, jumps: Matrix, kept: Matrix, explained: Matrix, totals: Matrix
) -> None:
    """The filter of `added` (T, m, m + c): `kept` (T, m, m + c, K) is what is known before each result,
    `explained` (c, c, K) as of `Filtered`, `totals` (T, m, K) what each offset is eliminated with."""
    count, size, wide, rates = kept.shape
    library, columns = _library(), wide - size
    if library is not None:
        work = np.empty((count * size * wide + columns**2 + (size + 2) * wide) * _LANES)
        arrays = (*map(np.ascontiguousarray, (added, variance, jumps)), kept, explained, totals, work)
        library.zb_filter(count, size, columns, rates, *(array.ctypes.data for array in arrays))
        return
    steps = np.zeros((count, size, rates))
    # Behind the last state a step that may be anything: with it the last state is eliminated, too.
    np.divide(1.0, variance, out=steps[:-1], where=np.logical_not(jumps)[:, :, None])
    pulled = np.empty((count, size, columns, rates))
    known, outer = np.zeros(kept.shape[1:]), np.empty(kept.shape[1:])
    for t, step in enumerate(steps):
        kept[t] = known
        known += added[t][..., None]
        for j in range(size):
            total = np.add(known[j, j], step[j], out=totals[t, j])
            # The offset itself without the difference, of which rounding would leave nothing where the walk
            # is slow, or allowed to jump.
            of_offset, row = known[j] * (step[j] / total), known[j] / np.sqrt(total)
            pulled[t, j] = row[size:]
            known -= np.multiply(row[:size, None], row, out=outer)
            known[j], known[:, j] = of_offset, of_offset[:size]
    explained[...] = np.einsum("tjck,tjdk->cdk", pulled, pulled)


def _compiled_jumps(library: ctypes.CDLL, smoothed: Smoothed, after: Index) -> tuple[Matrix, Matrix]:
    """`Smoothed.jumps_after` by C, which filters once more: what it needs of that stays in fast memory."""
    series, rates = smoothed.series, len(smoothed.rates)
    information, vector = series.information()
    count, size = vector.shape
    added = np.concatenate([information, vector[:, :, None]], axis=2)
    score, power = np.empty((2, len(after), size, rates))
    work = np.empty(((2 * count + 2) * size * (size + 1) + (size + 2) ** 2) * _LANES)
    steps = _step_variance(series, smoothed.rates), smoothed.jumps
    variance, jumps = map(np.ascontiguousarray, steps)
    library.zb_jumps(
        count, size, rates, added.ctypes.data, variance.ctypes.data, jumps.ctypes.data, len(after),
        after.ctypes.data, score.ctypes.data, power.ctypes.data, work.ctypes.data,
    )  # fmt: skip
    return score, power


@cache
def _library() -> ctypes.CDLL | None:
    pointer, whole = ctypes.c_void_p, ctypes.c_longlong
    return compiled_library(
        "smoother",
        lambda: LANES + _SOURCE.read_text(encoding="utf-8"),
        {
            "zb_filter": [*([whole] * 4), *([pointer] * 7)],
            "zb_jumps": [*([whole] * 3), *([pointer] * 3), whole, *([pointer] * 4)],
        },
        make=True,
        flags=["-O2"],
    )
