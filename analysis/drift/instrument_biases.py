"""Biases of instruments: what an instrument adds to an offset of every arm that it measures.

A result is y = x + b + noise: x the offsets, which drift, and b those of the instrument, the same in all
arms. Given the drift rates, the data are normal and linear in b: each arm adds to its information and score
(generalised least squares, the offsets of the arm eliminated as nothing is known of where they begin). The
rates are integrated over together with b, which has a flat prior, by Gibbs sampling: b given the rates is
normal; a rate of an arm given b has the weight of its likelihood. So intervals are exact, and p-values
uniform without a bias, over the prior of the rates, as those of jumps (`drift.py`); a bias does not hide
itself by a faster drift.

What is determined follows from who measured what. A bias common to all instruments is a shift of all arms:
only differences are determined. Two instruments are compared where one follows the other on an arm, both
determine the offset, and no new zeros, nor a jump that was found, are in between. A jump of the arm at that
time would look the same. So one such change determines nothing: two instruments are comparable if they are
connected without any one of the changes (2-edge-connected components).

Each instrument is tested against the mean of those that it is comparable to. p-values are multiplied by the
number of tests (Bonferroni): false alarms of the fleet have at most the probability `ALARM`. The clearest
bias is taken out of the mean and the rest tested again, until none is left; of two instruments only the
difference is known, not whose it is.

A jump that is allowed where the instrument changes would hide its bias. So b is estimated without those
first; then the results are corrected by it, and the jumps that still are found are allowed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import special

from ...model.arrays import Index, Matrix
from .drift import ALARM, LEVEL, Drift, drift, integrated, mixture_interval
from .drift import allowed as allowed_at
from .importance import normalised
from .smoother import Observation, Series, filtered, series_of

Groups = tuple[tuple[str, ...], ...]
_ROUNDS = 4  # of results corrected by the biases, at most
_RATES = 128  # of an arm
_DRAWS, _FIRST = 300, 30  # of the biases, and how many are forgotten


def changes(series: Series, instruments: Sequence[str], allowed: Matrix) -> Iterator[tuple[str, str, str]]:
    """Offset, and the instruments of two results that follow each other and determine it, where these differ
    and no jump of the offset is `allowed` (T - 1, m) in between."""
    observed = series.observed
    for j, offset in enumerate(series.names):
        for t, later in pairwise(np.flatnonzero(observed[:, j]).tolist()):
            pair = instruments[t], instruments[later]
            if pair[0] != pair[1] and not allowed[t:later, j].any():
                yield offset, *pair


def change_at(series: Series, instruments: Sequence[str], after: int, offset: str) -> tuple[str, str] | None:
    """The instruments before and after a jump between the results `after` and `after` + 1, of the nearest
    results that determine the offset; None where they are the same."""
    determined = np.flatnonzero(series.observed[:, series.names.index(offset)])
    pair = instruments[determined[determined <= after][-1]], instruments[determined[determined > after][0]]
    return None if pair[0] == pair[1] else pair


def comparable_groups(changes: Iterable[tuple[str, str]]) -> Groups:
    """Instruments that are connected by `changes` from one to another without any one of these."""
    number = Counter(tuple(sorted(pair)) for pair in changes)
    pairs = list(number)
    bridges = [
        pair
        for pair in pairs
        if number[pair] == 1 and not _joined(pair, [other for other in pairs if other != pair])
    ]
    return connected([pair for pair in pairs if pair not in bridges])


def connected(pairs: Sequence[tuple[str, ...]]) -> Groups:
    """The groups that the pairs connect, by name."""
    groups: list[set[str]] = []
    for pair in pairs:
        touched = [group for group in groups if group & set(pair)]
        groups = [group for group in groups if not group & set(pair)]
        groups.append(set(pair).union(*touched))
    return tuple(sorted(tuple(sorted(group)) for group in groups))


def _joined(pair: tuple[str, ...], others: Sequence[tuple[str, ...]]) -> bool:
    return any(set(pair) <= set(group) for group in connected(others))


Column = tuple[str, str]  # instrument and offset
Each = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]  # as `map`, in processes of its own


@dataclass(frozen=True, eq=False)
class MeasuredArm:
    """The drift of an arm, and the instrument of each of its results, "" where it is not stated."""

    drift: Drift
    instruments: tuple[str, ...]


@dataclass(frozen=True)
class Bias:
    """An instrument's bias of an offset less the mean of those `against`. `p_value` is multiplied by the
    number of tests; `alarm` says whether it is below the stated probability."""

    offset: str
    unit: str
    instrument: str
    against: tuple[str, ...]
    estimate: float
    std: float
    interval95: tuple[float, float]
    p_value: float
    alarm: bool


@dataclass(frozen=True)
class ComparableInstruments:
    """The instruments that determine an offset, in groups: within one they are comparable, between two
    nothing is determined."""

    offset: str
    groups: Groups


@dataclass(frozen=True)
class Instruments:
    """The biases and the groups of comparable instruments; `unstated` counts the results that state no
    instrument, which are not used."""

    biases: tuple[Bias, ...]
    comparable: tuple[ComparableInstruments, ...]
    unstated: int


@dataclass(frozen=True, eq=False)
class _CorrectedArm:
    """An arm whose results are corrected by biases: its series, where jumps are `allowed`, and for each of
    its rates the information about its biases `columns`: `matrix` (K, q, q), `vector` (K, q); none where the
    instrument does not change."""

    series: Series
    instruments: tuple[str, ...]
    allowed: Matrix
    columns: tuple[Column, ...]
    matrix: Matrix
    vector: Matrix


@dataclass(frozen=True, eq=False)
class _BiasInformation:
    """The information of A arms about q biases each, at the places `at` (A, q) of all that are sampled, for
    each of their rates: `vector` (A, K, q), `matrix` (A, K, q, q). `arms` (A,) are their places among those
    that change the instrument."""

    arms: Index
    at: Index
    vector: Matrix
    matrix: Matrix

    @staticmethod
    def of(arms: Sequence[_CorrectedArm], rows: Mapping[Column, int]) -> list[_BiasInformation]:
        """Of the columns in `rows`: no change of instrument touches the others. Arms of as many biases are
        together."""
        kept = [[k for k, column in enumerate(arm.columns) if column in rows] for arm in arms]
        together = []
        for size in dict.fromkeys(map(len, kept)):
            members = [i for i, of_arm in enumerate(kept) if len(of_arm) == size]
            at = [[rows[arms[i].columns[k]] for k in kept[i]] for i in members]
            vectors = np.array([arms[i].vector[:, kept[i]] for i in members])
            matrices = np.array([arms[i].matrix[:, kept[i]][:, :, kept[i]] for i in members])
            together.append(_BiasInformation(np.array(members), np.array(at), vectors, matrices))
        return together

    def trace(self) -> float:
        """The sum of the mean traces of the matrices."""
        return float(self.matrix.mean(axis=1).trace(axis1=1, axis2=2).sum())

    def add_to(self, matrix: Matrix, vector: Matrix, chosen: Index) -> None:
        """Add what each arm says at its `chosen` rate."""
        arms = np.arange(len(chosen))
        np.add.at(vector, self.at, self.vector[arms, chosen])
        np.add.at(matrix, (self.at[:, :, None], self.at[:, None]), self.matrix[arms, chosen])

    def choose(self, bias: Matrix, shares: Matrix) -> Index:
        """(A,) rates drawn given all biases: each where its cumulated weight exceeds its share (A,)."""
        biases = bias[self.at]
        pairs = (biases[:, :, None] * biases[:, None]).reshape(len(biases), -1, 1)
        squared = self.matrix.reshape(*self.matrix.shape[:2], -1) @ pairs
        log_weights = (self.vector @ biases[:, :, None] - squared / 2)[:, :, 0]
        cumulated = np.cumsum(normalised(log_weights.T), axis=0)
        return np.asarray(np.minimum((cumulated < shares).sum(axis=0), len(cumulated) - 1))


@dataclass(frozen=True, eq=False)
class _BiasDraws:
    """Of the biases `columns`: means (D, q) and covariances (D, q, q) given the rates drawn."""

    columns: tuple[Column, ...]
    mean: Matrix
    covariance: Matrix

    def added_to(self, shift: Mapping[Column, float]) -> dict[Column, float]:
        """The biases that results were corrected by, and what their mean adds to it."""
        means = dict(zip(self.columns, self.mean.mean(axis=0).tolist(), strict=True))
        return {**shift, **{column: shift.get(column, 0.0) + value for column, value in means.items()}}


def instrument_biases(
    arms: Sequence[MeasuredArm],
    each: Each = map,
    *,
    seed: int = 0,
) -> Instruments:
    """The biases of all instruments that the arms were measured by. `each` does what is done for each arm, in
    the order of the arms."""
    unstated = sum(arm.instruments.count("") for arm in arms)
    raw = [arm for arm in each(partial(_corrected_from, seed=seed), arms) if arm is not None]
    now, shift = raw, dict[Column, float]()
    draws = _drawn(now, seed)
    for _ in range(_ROUNDS):
        if not draws.columns:
            break
        shift = draws.added_to(shift)
        before, now = now, list(each(partial(_corrected, shift=shift, seed=seed), raw))
        draws = _drawn(now, seed)
        if all(
            np.array_equal(arm.allowed, previous.allowed) for arm, previous in zip(now, before, strict=True)
        ):
            break
    comparable = tuple(_comparable(now))
    total = replace(draws, mean=draws.mean + [shift.get(column, 0.0) for column in draws.columns])
    return Instruments(tuple(_biases(now, comparable, total)), comparable, unstated)


def bias_information(series: Series, rates: Matrix, allowed: Matrix, design: Matrix) -> tuple[Matrix, Matrix]:
    """(K, q, q) and (K, q): information and score about q biases, at zero, for `rates` (K, m). `design`
    (T, m, q) has what each bias adds to each offset of a result. The states are eliminated."""
    information, vector = series.information()
    by_design = np.einsum("tij,tjq->tiq", information, design)
    columns = np.concatenate([by_design, vector[:, :, None]], axis=2)
    explained = np.moveaxis(filtered(series, rates, allowed, columns).explained, -1, 0)
    matrix = np.einsum("tiq,tir->qr", design, by_design) - explained[:, :-1, :-1]
    score = np.einsum("tiq,ti->q", design, vector) - explained[:, :-1, -1]
    return (matrix + matrix.transpose(0, 2, 1)) / 2, score


def _corrected_from(arm: MeasuredArm, seed: int) -> _CorrectedArm | None:
    """The arm by its results that state an instrument, without jumps where that changes."""
    series, arm_drift = arm.drift.series, arm.drift
    if "" in arm.instruments:
        kept = [
            one if instrument else Observation(one.at, (), np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0)))
            for one, instrument in zip(series.observations, arm.instruments, strict=True)
        ]
        series = series_of(kept, dict(zip(series.names, series.units, strict=True)), series.reset)
        if not series.names:
            return None
        arm_drift = drift(series, seed=seed)
    jumps = [(one.place, one.offset) for one in arm_drift.jumps]
    elsewhere = [one for one in jumps if change_at(series, arm.instruments, *one) is None]
    if elsewhere == jumps:
        return _informed(series, arm.instruments, arm_drift.rates, arm_drift.weights, arm_drift.allowed)
    allowed = allowed_at(series, elsewhere)
    smoothed, nodes = integrated(series, allowed, seed)
    weights = normalised(smoothed.log_likelihood + nodes.over)
    return _informed(series, arm.instruments, smoothed.rates, weights, allowed)


def _corrected(arm: _CorrectedArm, shift: Mapping[Column, float], seed: int) -> _CorrectedArm:
    """The arm `own`, as it was measured, with the biases `shift` taken out of its results."""
    if not arm.columns:
        return arm
    observations = tuple(
        replace(one, values=one.values - [shift.get((instrument, name), 0.0) for name in one.names])
        for one, instrument in zip(arm.series.observations, arm.instruments, strict=True)
    )
    arm_drift = drift(replace(arm.series, observations=observations), seed=seed)
    return _informed(arm_drift.series, arm.instruments, arm_drift.rates, arm_drift.weights, arm_drift.allowed)


def _informed(
    series: Series, instruments: tuple[str, ...], rates: Matrix, weights: Matrix, allowed: Matrix
) -> _CorrectedArm:
    """By rates that are taken at equal steps of their weights, so that each counts the same."""
    if not any(changes(series, instruments, allowed)):
        return _CorrectedArm(series, instruments, allowed, (), np.zeros((0, 0, 0)), np.zeros((0, 0)))
    columns = tuple((name, offset) for name in sorted({*instruments} - {""}) for offset in series.names)
    design = np.zeros((len(instruments), len(series.names), len(columns)))
    for k, (instrument, offset) in enumerate(columns):
        rows = [t for t, name in enumerate(instruments) if name == instrument]
        design[rows, series.names.index(offset), k] = 1.0
    some = np.searchsorted(np.cumsum(weights), (np.arange(_RATES) + 0.5) / _RATES)
    matrix, vector = bias_information(series, rates[np.minimum(some, len(rates) - 1)], allowed, design)
    return _CorrectedArm(series, instruments, allowed, columns, matrix, vector)


def _by_offset(arms: Sequence[_CorrectedArm]) -> dict[str, list[tuple[str, str]]]:
    pairs: dict[str, list[tuple[str, str]]] = {}
    for arm in arms:
        for offset, *pair in changes(arm.series, arm.instruments, arm.allowed):
            pairs.setdefault(offset, []).append((pair[0], pair[1]))
    return pairs


def _comparable(arms: Sequence[_CorrectedArm]) -> Iterator[ComparableInstruments]:
    pairs = _by_offset(arms)
    names = {name for arm in arms for name in arm.series.names}
    for offset in sorted(names, key=lambda name: (len(name), name)):
        groups = comparable_groups(pairs.get(offset, []))
        single = {
            instrument
            for arm in arms
            for observation, instrument in zip(arm.series.observations, arm.instruments, strict=True)
            if offset in observation.names
        }.difference(*groups)
        yield ComparableInstruments(offset, (*groups, *((name,) for name in sorted(single))))


def _drawn(arms: Sequence[_CorrectedArm], seed: int) -> _BiasDraws:
    """Gibbs sampling of the biases and of the rates of each arm. A shift of all instruments that changes
    connect is not determined: it is held at zero."""
    groups = {offset: connected(pairs) for offset, pairs in _by_offset(arms).items()}
    columns = tuple(
        (name, offset)
        for offset, connected_groups in groups.items()
        for group in connected_groups
        for name in group
    )
    size = len(columns)
    if not size:
        return _BiasDraws((), np.zeros((0, 0)), np.zeros((0, 0, 0)))
    random = np.random.default_rng(seed)
    rows = {column: k for k, column in enumerate(columns)}
    changed = [arm for arm in arms if arm.columns]
    parts = _BiasInformation.of(changed, rows)
    held = np.zeros((size, size))
    for offset, connected_groups in groups.items():
        for group in connected_groups:
            at = [columns.index((name, offset)) for name in group]
            held[np.ix_(at, at)] = 1.0
    held *= sum(part.trace() for part in parts) / size
    chosen = np.zeros(len(changed), dtype=np.int64)
    means, covariances = [], []
    for _ in range(_FIRST + _DRAWS):
        matrix, vector = held.copy(), np.zeros(size)
        for part in parts:
            part.add_to(matrix, vector, chosen[part.arms])
        covariance = np.linalg.inv(matrix)
        mean = covariance @ vector
        bias = mean + np.linalg.cholesky(covariance) @ random.normal(size=size)
        shares = random.random(len(changed))
        for part in parts:
            chosen[part.arms] = part.choose(bias, shares[part.arms])
        means.append(mean)
        covariances.append(covariance)
    return _BiasDraws(columns, np.array(means[_FIRST:]), np.array(covariances[_FIRST:]))


def _biases(
    arms: Sequence[_CorrectedArm],
    comparable: Sequence[ComparableInstruments],
    draws: _BiasDraws,
) -> Iterator[Bias]:
    units = {
        name: unit for arm in arms for name, unit in zip(arm.series.names, arm.series.units, strict=True)
    }
    tested = [(row.offset, group) for row in comparable for group in row.groups if len(group) > 1]
    tests = sum(len(group) if len(group) > 2 else 1 for _, group in tested)
    for offset, group in tested:
        biased: list[str] = []
        while True:
            rest = [name for name in group if name not in biased]
            named = group[1:] if len(group) == 2 else group
            biases = [
                _bias(draws, (offset, units[offset]), instrument, set(rest) - {instrument}, tests)
                for instrument in named
                if rest != [instrument]
            ]
            outlying = [bias.instrument for bias in biases if bias.alarm and bias.instrument not in biased]
            if not outlying:
                break
            explained = _explained(draws, offset, rest)
            biased.append(max(outlying, key=lambda name: explained[rest.index(name)]))
        yield from biases


def _explained(draws: _BiasDraws, offset: str, rest: Sequence[str]) -> Matrix:
    """(n,) by how much chi-squared of the differences falls if one instrument is biased and the others are
    equal: the contrasts alone do not say whose bias it is, where that one has few results."""
    at = [draws.columns.index((name, offset)) for name in rest]
    mean = draws.mean[:, at]
    centred = np.eye(len(rest)) - 1 / len(rest)
    middle = centred @ mean.mean(axis=0)
    covariance = draws.covariance[:, at][:, :, at].mean(axis=0) + np.atleast_2d(np.cov(mean.T))
    precision = np.linalg.pinv(centred @ covariance @ centred, rcond=1e-9, hermitian=True)
    return np.asarray((precision @ middle) ** 2 / np.diag(precision))


def _bias(
    draws: _BiasDraws,
    of: tuple[str, str],
    instrument: str,
    others: Collection[str],
    tests: int,
) -> Bias:
    """Of an offset and its unit: an instrument against the mean of the others, by the draws of the biases."""
    (offset, unit), against = of, sorted(others)
    along = np.zeros(len(draws.columns))
    along[draws.columns.index((instrument, offset))] = 1.0
    for name in against:
        along[draws.columns.index((name, offset))] -= 1 / len(against)
    mean = draws.mean @ along
    std = np.sqrt(np.einsum("i,dij,j->d", along, draws.covariance, along))
    even = np.full(len(mean), 1 / len(mean))
    below = min(float(special.ndtr(mean / std).mean()), float(special.ndtr(-mean / std).mean()))
    p_value = min(1.0, 2 * below * tests)
    return Bias(
        offset,
        unit,
        instrument,
        tuple(against),
        float(mean.mean()),
        float(np.sqrt((std**2).mean() + mean.var())),
        mixture_interval(mean, std, even, LEVEL),
        p_value,
        p_value <= ALARM,
    )
