"""Which instruments may be compared: by their changes on the arms that they measured."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import special

from ...model.arrays import Matrix
from .drift import ALARM, LEVEL, Drift, drift, integrated, mixture_interval
from .drift import allowed as allowed_at
from .importance import normalised
from .smoother import Observation, Series, series_of

Groups = tuple[tuple[str, ...], ...]


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
    seen = np.flatnonzero(series.observed[:, series.names.index(offset)])
    pair = instruments[seen[seen <= after][-1]], instruments[seen[seen > after][0]]
    return None if pair[0] == pair[1] else pair


def comparable_groups(changes: Iterable[tuple[str, str]]) -> Groups:
    """Instruments that are connected by `changes` from one to another without any one of these."""
    number = Counter(tuple(sorted(own)) for own in changes)
    pairs = list(number)
    bridges = [
        own for own in pairs if number[own] == 1 and not _joined(own, [one for one in pairs if one != own])
    ]
    return connected([own for own in pairs if own not in bridges])


def connected(pairs: Sequence[tuple[str, ...]]) -> Groups:
    """The groups that the pairs connect, by name."""
    groups: list[set[str]] = []
    for pair in pairs:
        touched = [own for own in groups if own & set(pair)]
        groups = [own for own in groups if not own & set(pair)]
        groups.append(set(pair).union(*touched))
    return tuple(sorted(tuple(sorted(own)) for own in groups))


def _joined(pair: tuple[str, ...], others: Sequence[tuple[str, ...]]) -> bool:
    return any(set(pair) <= set(own) for own in connected(others))


Column = tuple[str, str]  # instrument and offset
Each = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]  # as `map`, in processes of its own

_ROUNDS = 4  # of results corrected by the biases, at most
_RATES = 256  # of an arm
_DRAWS, _FIRST = 300, 30  # of the biases, and how many are forgotten


@dataclass(frozen=True, eq=False)
class Measured:
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
class Comparable:
    """Of an offset, the instruments that determine it in groups: within one they are comparable, between two
    nothing is determined."""

    offset: str
    groups: Groups


@dataclass(frozen=True)
class Instruments:
    """What the arms say of their instruments together; `unstated` counts the results that state none, which
    are not used."""

    biases: tuple[Bias, ...]
    comparable: tuple[Comparable, ...]
    unstated: int


@dataclass(frozen=True, eq=False)
class _Arm:
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
class _Part:
    """The information of an arm about the biases at the places `at` of all that are sampled."""

    at: list[int]
    matrix: Matrix
    vector: Matrix

    @staticmethod
    def of(own: _Arm, places: Mapping[Column, int]) -> _Part:
        """Of columns that have no place there is no information: no change of instrument touches them."""
        kept = [k for k, column in enumerate(own.columns) if column in places]
        return _Part(
            [places[own.columns[k]] for k in kept], own.matrix[:, kept][:, :, kept], own.vector[:, kept]
        )


@dataclass(frozen=True, eq=False)
class _Draws:
    """Of the biases `columns`: means (D, q) and covariances (D, q, q) given the rates drawn."""

    columns: tuple[Column, ...]
    mean: Matrix
    covariance: Matrix

    def added_to(self, shift: Mapping[Column, float]) -> dict[Column, float]:
        """The biases that results were corrected by, and what their mean adds to it."""
        own = dict(zip(self.columns, self.mean.mean(axis=0).tolist(), strict=True))
        return {**shift, **{column: shift.get(column, 0.0) + value for column, value in own.items()}}


def instrument_biases(
    arms: Sequence[Measured],
    each: Each = map,
    *,
    alarm: float = ALARM,
    seed: int = 0,
) -> Instruments:
    """The biases of all instruments that the arms were measured by. `each` does what is done for each arm, in
    the order of the arms."""
    unstated = sum(own.instruments.count("") for own in arms)
    raw = [own for own in each(partial(_stated, seed=seed), arms) if own is not None]
    now, shift = raw, dict[Column, float]()
    draws = _drawn(now, seed)
    for _ in range(_ROUNDS):
        if not draws.columns:
            break
        shift = draws.added_to(shift)
        before, now = now, list(each(partial(_corrected, shift=shift, seed=seed), raw))
        draws = _drawn(now, seed)
        if all(np.array_equal(own.allowed, one.allowed) for own, one in zip(now, before, strict=True)):
            break
    comparable = tuple(_comparable(now))
    return Instruments(tuple(_biases(now, comparable, draws, shift, alarm)), comparable, unstated)


def bias_information(series: Series, rates: Matrix, allowed: Matrix, design: Matrix) -> tuple[Matrix, Matrix]:
    """(K, q, q) and (K, q): information and score about q biases, at zero, for `rates` (K, m). `design`
    (T, m, q) has what each bias adds to each offset of a result. The states are eliminated."""
    information, vector = series.information()
    count, size = vector.shape
    precision = np.zeros((len(rates), count * size, count * size))
    walk = np.where(allowed, 0.0, 1 / (rates[:, None, :] ** 2 * series.gaps[:, None])).reshape(len(rates), -1)
    for t in range(count):
        at = slice(t * size, (t + 1) * size)
        precision[:, at, at] = information[t]
    before = np.arange((count - 1) * size)
    after = before + size
    precision[:, before, before] += walk
    precision[:, after, after] += walk
    precision[:, before, after] -= walk
    precision[:, after, before] -= walk
    flat = design.reshape(count * size, -1)
    seen = np.einsum("tij,tjq->tiq", information, design).reshape(count * size, -1)
    right = np.concatenate([seen, vector.reshape(-1, 1)], axis=1)
    states = np.linalg.solve(precision, np.broadcast_to(right, (len(rates), *right.shape)))
    matrix = flat.T @ seen - seen.T @ states[:, :, :-1]
    score = flat.T @ vector.ravel() - (seen.T @ states[:, :, -1:])[:, :, 0]
    return (matrix + matrix.transpose(0, 2, 1)) / 2, score


def _stated(own: Measured, seed: int) -> _Arm | None:
    """The arm by its results that state an instrument, without jumps where that changes."""
    series, found = own.drift.series, own.drift
    if "" in own.instruments:
        kept = [
            one if instrument else Observation(one.at, (), np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0)))
            for one, instrument in zip(series.observations, own.instruments, strict=True)
        ]
        series = series_of(kept, dict(zip(series.names, series.units, strict=True)), series.reset)
        if not series.names:
            return None
        found = drift(series, seed=seed)
    jumps = [(one.after, one.offset) for one in found.jumps]
    elsewhere = [one for one in jumps if change_at(series, own.instruments, *one) is None]
    if elsewhere == jumps:
        return _informed(series, own.instruments, found.rates, found.weights, found.allowed)
    allowed = allowed_at(series, elsewhere)
    rates, log_weight, _, _ = integrated(series, allowed, seed)
    return _informed(series, own.instruments, rates, normalised(log_weight), allowed)


def _corrected(own: _Arm, shift: Mapping[Column, float], seed: int) -> _Arm:
    """The arm `own`, as it was measured, with the biases `shift` taken out of its results."""
    if not own.columns:
        return own
    observations = tuple(
        replace(one, values=one.values - [shift.get((instrument, name), 0.0) for name in one.names])
        for one, instrument in zip(own.series.observations, own.instruments, strict=True)
    )
    found = drift(replace(own.series, observations=observations), seed=seed)
    return _informed(found.series, own.instruments, found.rates, found.weights, found.allowed)


def _informed(
    series: Series, instruments: tuple[str, ...], rates: Matrix, weights: Matrix, allowed: Matrix
) -> _Arm:
    """By rates that are taken at equal steps of their weights, so that each counts the same."""
    if not any(changes(series, instruments, allowed)):
        return _Arm(series, instruments, allowed, (), np.zeros((0, 0, 0)), np.zeros((0, 0)))
    columns = tuple((name, offset) for name in sorted({*instruments} - {""}) for offset in series.names)
    design = np.zeros((len(instruments), len(series.names), len(columns)))
    for k, (instrument, offset) in enumerate(columns):
        rows = [t for t, name in enumerate(instruments) if name == instrument]
        design[rows, series.names.index(offset), k] = 1.0
    some = np.searchsorted(np.cumsum(weights), (np.arange(_RATES) + 0.5) / _RATES)
    matrix, vector = bias_information(series, rates[np.minimum(some, len(rates) - 1)], allowed, design)
    return _Arm(series, instruments, allowed, columns, matrix, vector)


def _by_offset(arms: Sequence[_Arm]) -> dict[str, list[tuple[str, str]]]:
    found: dict[str, list[tuple[str, str]]] = {}
    for own in arms:
        for offset, *pair in changes(own.series, own.instruments, own.allowed):
            found.setdefault(offset, []).append((pair[0], pair[1]))
    return found


def _comparable(arms: Sequence[_Arm]) -> Iterator[Comparable]:
    pairs = _by_offset(arms)
    names = {name for own in arms for name in own.series.names}
    for offset in sorted(names, key=lambda name: (len(name), name)):
        groups = comparable_groups(pairs.get(offset, []))
        single = {
            instrument
            for own in arms
            for one, instrument in zip(own.series.observations, own.instruments, strict=True)
            if offset in one.names
        }.difference(*groups)
        yield Comparable(offset, (*groups, *((own,) for own in sorted(single))))


def _drawn(arms: Sequence[_Arm], seed: int) -> _Draws:
    """Gibbs sampling of the biases and of the rates of each arm. A shift of all instruments that changes
    connect is not determined: it is held at zero."""
    groups = {offset: connected(pairs) for offset, pairs in _by_offset(arms).items()}
    columns = tuple((name, offset) for offset, found in groups.items() for own in found for name in own)
    size = len(columns)
    if not size:
        return _Draws((), np.zeros((0, 0)), np.zeros((0, 0, 0)))
    random = np.random.default_rng(seed)
    places = {column: k for k, column in enumerate(columns)}
    parts = [_Part.of(own, places) for own in arms if own.columns]
    held = np.zeros((size, size))
    for offset, found in groups.items():
        for group in found:
            at = [columns.index((name, offset)) for name in group]
            held[np.ix_(at, at)] = 1.0
    typical = sum(float(np.trace(own.matrix.mean(axis=0))) for own in parts) / size
    held *= typical
    chosen = [0] * len(parts)
    means, covariances = [], []
    for _ in range(_FIRST + _DRAWS):
        matrix, vector = held.copy(), np.zeros(size)
        for own, k in zip(parts, chosen, strict=True):
            matrix[np.ix_(own.at, own.at)] += own.matrix[k]
            vector[own.at] += own.vector[k]
        covariance = np.linalg.inv(matrix)
        mean = covariance @ vector
        bias = mean + np.linalg.cholesky(covariance) @ random.normal(size=size)
        chosen = [_choose(own, bias[own.at], random.random()) for own in parts]
        means.append(mean)
        covariances.append(covariance)
    return _Draws(columns, np.array(means[_FIRST:]), np.array(covariances[_FIRST:]))


def _choose(own: _Part, bias: Matrix, share: float) -> int:
    squared = own.matrix.reshape(len(own.matrix), -1) @ np.outer(bias, bias).ravel()
    cumulated = np.cumsum(normalised(own.vector @ bias - squared / 2))
    return min(int(np.searchsorted(cumulated, share)), len(cumulated) - 1)


def _biases(
    arms: Sequence[_Arm],
    comparable: Sequence[Comparable],
    draws: _Draws,
    shift: Mapping[Column, float],
    alarm: float,
) -> Iterator[Bias]:
    units = {
        name: unit for own in arms for name, unit in zip(own.series.names, own.series.units, strict=True)
    }
    tested = [(own.offset, group) for own in comparable for group in own.groups if len(group) > 1]
    tests = sum(len(group) if len(group) > 2 else 1 for _, group in tested)
    for offset, group in tested:
        biased: list[str] = []
        while True:
            rest = [own for own in group if own not in biased]
            named = group[1:] if len(group) == 2 else group
            found = [
                _bias(
                    draws,
                    shift,
                    (offset, units[offset]),
                    own,
                    [one for one in rest if one != own],
                    tests,
                    alarm,
                )
                for own in named
                if rest != [own]
            ]
            odd = [own.instrument for own in found if own.alarm and own.instrument not in biased]
            if not odd:
                break
            explained = _explained(draws, shift, offset, rest)
            biased.append(max(odd, key=lambda name: explained[rest.index(name)]))
        yield from found


def _explained(draws: _Draws, shift: Mapping[Column, float], offset: str, rest: Sequence[str]) -> Matrix:
    """(n,) by how much chi-squared of the differences falls if one instrument is biased and the others are
    equal: the contrasts alone do not say whose bias it is, where that one has few results."""
    at = [draws.columns.index((name, offset)) for name in rest]
    mean = draws.mean[:, at] + [shift.get((name, offset), 0.0) for name in rest]
    centred = np.eye(len(rest)) - 1 / len(rest)
    middle = centred @ mean.mean(axis=0)
    covariance = draws.covariance[:, at][:, :, at].mean(axis=0) + np.atleast_2d(np.cov(mean.T))
    precision = np.linalg.pinv(centred @ covariance @ centred, rcond=1e-9, hermitian=True)
    return np.asarray((precision @ middle) ** 2 / np.diag(precision))


def _bias(
    draws: _Draws,
    shift: Mapping[Column, float],
    of: tuple[str, str],
    instrument: str,
    against: Collection[str],
    tests: int,
    alarm: float,
) -> Bias:
    offset, unit = of
    along = np.zeros(len(draws.columns))
    along[draws.columns.index((instrument, offset))] = 1.0
    for name in against:
        along[draws.columns.index((name, offset))] -= 1 / len(against)
    before = np.array([shift.get(column, 0.0) for column in draws.columns])
    mean = draws.mean @ along + before @ along
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
        p_value <= alarm,
    )
