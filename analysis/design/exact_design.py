"""The best k of many candidates by D-, A- or E-optimality for the offsets, with a certified bound.

For the E-criterion single exchanges end in poor designs, so two measurements are exchanged at once. All pairs
of candidates are searched, and few of them looked at. With K the columns of the offsets, every vector u with
K'u = v of length 1 bounds the smallest eigenvalue of the information on the offsets: S(M) <= u' M u
(Pukelsheim 1993, section 3.14). The bound is a sum over measurements, so that it costs a pair one addition; a
pair that is below the best design by one u is out. Each pair that is looked at gives the u that bound it
tightly."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ...model.arrays import Index, Mask, Matrix
from .continuous_design import (
    SOFT,
    Candidates,
    Criterion,
    Measure,
    continuous,
    offset_covariance,
    power_mean,
    slope_root,
    times,
    variance,
)

_STARTS = 16
_FEW_SHOTS, _STARTS_OF_FEW = 8, 64  # for E, up to so many: the local optima are many, a start is little work
_SWEEPS = 30
_NEAR = 400  # candidates among which the starts exchange, those of the largest gain at the optimum
_LOOKED_AT = 1000  # candidates at most for one exchange, those of the largest gain
_SCREENED = 64  # candidates of which E looks at the eigenvalues, the most promising by a power mean
_SHARP = 32  # power of the mean of eigenvalues by which E chooses them
_PAIRED = 300  # candidates of which E exchanges two at once
_PAIRED_STARTS = 4  # different ones that are begun from
_SEARCHES = 150  # of a start: with many measurements not every two of them are exchanged
_LOOKS = 60  # at single pairs in one search
_STEP = 1e-9  # relative: less is no improvement


@dataclass(frozen=True, eq=False)
class Design:
    """`rows` (k,) of the chosen candidates; `value` of the criterion (a variance), `bound` below which no
    choice of k of these candidates can be, `efficiency` bound / value. `converged`: no more steps would raise
    the bound."""

    criterion: Criterion
    rows: Index
    value: float
    bound: float
    support: int
    converged: bool = True

    @property
    def efficiency(self) -> float:
        return self.bound / self.value


Exchange = tuple[Candidates, Index, Criterion]
Ended = tuple[float, Index]
Each = Callable[[Callable[[Exchange], Ended], Sequence[Exchange]], Iterable[Ended]]


def design(
    candidates: Candidates,
    counts: Sequence[int],
    criterion: Criterion,
    seed: int,
    starts: int | None = None,
    each: Each = map,
) -> Design:
    """Choose so many different candidates of each group by exchanges from several starts, with a bound on the
    best.

    The starts (None: as many as usual) are rounded from the continuous optimum and drawn at random (fixed by
    `seed`). For E the best of them go on to exchanges of two measurements at once. `each` applies a function
    to every start, and gives the answers in that order.
    """
    shots, group = sum(counts), candidates.group
    if starts is None:
        starts = _STARTS_OF_FEW if criterion == "E" and shots <= _FEW_SHOTS else _STARTS
    ideal = continuous(candidates, counts, criterion, most=1 / shots)
    promising = np.argsort(-ideal.gain)
    nearest = [promising[group[promising] == g][: max(_NEAR, count)] for g, count in enumerate(counts)]
    near = np.union1d(np.concatenate(nearest), np.flatnonzero(ideal.weights > 0))
    few = candidates.some(near)
    rng = np.random.default_rng(seed)
    value_of: dict[tuple[int, ...], float] = {}
    first_rows = [
        _start(few, ideal.weights[near], counts, rng, rounded=start % 4 != 3) for start in range(starts)
    ]
    for value, rows in each(_exchanged, [(few, rows, criterion) for rows in first_rows]):
        value_of[tuple(np.sort(rows).tolist())] = value
    best = sorted(value_of, key=value_of.__getitem__)
    rows = np.array(best[0])
    if criterion == "E" and len(counts) == 1:
        promising = np.argsort(-ideal.gain[near], kind="stable")[:_PAIRED]
        rows = _exchange_two(few, best[:_PAIRED_STARTS], promising, rng)
    value, rows = exchange(candidates, near[rows], criterion)
    support = int((ideal.weights > 1e-4).sum())
    return Design(criterion, np.sort(rows), value, min(ideal.bound, value), support, ideal.converged)


def _exchanged(start: Exchange) -> Ended:
    candidates, rows, criterion = start
    if criterion == "E":
        # The largest eigenvalue has kinks in which exchanges get stuck: a smooth mean comes first.
        _, rows = exchange(candidates, rows, "soft")
    return exchange(candidates, rows, criterion)


def _start(
    candidates: Candidates,
    weights: Matrix,
    counts: Sequence[int],
    rng: np.random.Generator,
    *,
    rounded: bool,
) -> Index:
    """Different candidates of each group to start from: drawn by the continuous weights, or evenly."""
    probability = weights + 1e-9 if rounded else np.ones_like(weights)
    chosen = []
    for g, count in enumerate(counts):
        rows = np.flatnonzero(candidates.group == g)
        shares = probability[rows] / probability[rows].sum()
        chosen.append(rows[rng.choice(len(rows), size=count, replace=False, p=shares)])
    return np.concatenate(chosen)


def exchange(candidates: Candidates, rows: Index, criterion: Measure) -> tuple[float, Index]:
    """Replace one measurement at a time with the best candidate until no exchange helps (Fedorov 1972)."""
    rows = rows.copy()
    value = variance(offset_covariance(candidates, candidates.information(rows)), criterion)
    tried = unchanged = 0
    while unchanged < len(rows) and tried < _SWEEPS * len(rows):
        k = tried % len(rows)
        tried, unchanged = tried + 1, unchanged + 1
        others = np.delete(rows, k)
        information = candidates.information(others)
        covariance: Matrix = np.asarray(np.linalg.inv(information), dtype=float)
        alike = candidates.group == candidates.group[rows[k]]
        some = _promising(candidates, others, alike, covariance, value, criterion)
        if not len(some):
            continue
        values = values_with(candidates.some(some), information, covariance, criterion)
        best = int(np.argmin(values))
        if values[best] < value * (1 - _STEP):
            rows[k], value, unchanged = some[best], float(values[best]), 0
    return value, rows


def _promising(
    candidates: Candidates, others: Index, alike: Mask, covariance: Matrix, value: float, criterion: Measure
) -> Index:
    """The candidates, of those `alike` (C,), that may bring the criterion below `value` when added to the
    `others`, whose covariance is stated.

    The variance of what a candidate would measure is at least that of its noise, 1: so it lowers the
    criterion (for D its log) by no more than it would if it were that. At most so many are looked at.
    """
    of_offsets = covariance[candidates.offsets][:, candidates.offsets]
    lacking = variance(of_offsets, criterion)
    lacking = float(np.log(lacking / value)) if criterion == "D" else lacking - value
    root = covariance[:, candidates.offsets] @ slope_root(of_offsets, criterion)
    gain = (times(candidates.roots, root) ** 2).sum(axis=(1, 2))
    gain[others] = -np.inf
    some = np.flatnonzero((gain > lacking) & alike)
    return some if len(some) <= _LOOKED_AT else some[np.argsort(-gain[some])[:_LOOKED_AT]]


def _exchange_two(
    candidates: Candidates, starts: Sequence[Sequence[int]], promising: Index, rng: np.random.Generator
) -> Index:
    """The best for E of what exchanges of two at once, for the `promising` ones, make of `starts`."""
    ends = []
    for start in starts:
        among = np.union1d(promising, start)
        start_rows = np.searchsorted(among, start)
        value, rows = exchange_pairs(candidates.roots[among], candidates.offsets, start_rows, rng)
        ends.append((value, among[rows]))
    return min(ends, key=lambda end: end[0])[1]


def values_with(
    candidates: Candidates, information: Matrix, covariance: Matrix, criterion: Measure
) -> Matrix:
    """(C,) the criterion after adding each candidate to the information (rank-d updates); `covariance` is
    its inverse.

    For E it is exact for the most promising candidates and infinite for the others.
    """
    roots, offsets = candidates.roots, candidates.offsets
    unit, spread = np.eye(roots.shape[1]), times(roots, covariance)
    grams, on_offsets = spread @ roots.transpose(0, 2, 1) + unit, spread[:, :, offsets]
    of_offsets = covariance[offsets][:, offsets]
    if criterion == "D":
        log = np.linalg.slogdet(of_offsets)[1] - np.linalg.slogdet(grams)[1]
        if not offsets.all():
            # The determinant of the whole over that of the nuisance's own information.
            inner = roots[:, :, ~offsets]
            alone = np.asarray(np.linalg.inv(information[~offsets][:, ~offsets]), dtype=float)
            within = times(inner, alone) @ inner.transpose(0, 2, 1) + unit
            log = log + np.linalg.slogdet(within)[1]
        return np.asarray(np.exp(log / len(of_offsets)))
    if criterion == "A":
        return np.asarray((np.trace(of_offsets) - _squares(grams, on_offsets)) / len(of_offsets))
    after = of_offsets - on_offsets.transpose(0, 2, 1) @ np.linalg.solve(grams, on_offsets)
    if criterion == "soft":
        return power_mean(after, SOFT)
    largest = np.full(len(roots), np.inf)
    nearly = power_mean(after, _SHARP)
    screened = np.argpartition(nearly, min(_SCREENED, len(nearly)) - 1)[:_SCREENED]
    largest[screened] = np.linalg.eigvalsh(after[screened])[:, -1]
    return largest


def _squares(grams: Matrix, columns: Matrix) -> Matrix:
    """(C,) the sums of squares of `columns` (C, d, s) by the inverse of `grams` (C, d, d), by elimination."""
    grams, columns = grams.copy(), columns.copy()
    total = np.zeros(len(grams))
    for i in range(grams.shape[1]):
        total += (columns[:, i] ** 2).sum(axis=1) / grams[:, i, i]
        share = grams[:, i + 1 :, i] / grams[:, i, i, None]
        columns[:, i + 1 :] -= share[:, :, None] * columns[:, None, i]
        grams[:, i + 1 :, i + 1 :] -= share[:, :, None] * grams[:, None, i, i + 1 :]
    return total


def exchange_pairs(
    roots: Matrix, offsets: Mask, rows: Index, rng: np.random.Generator
) -> tuple[float, Index]:
    """Replace two measurements of `rows` (k,) at a time by the best two of the candidates `roots` (C, d, f)
    until none of these exchanges helps: the largest variance of the offsets, and the rows."""
    count, size = len(roots), roots.shape[2]
    unit = np.eye(size)
    cuts, least = _cuts(_added(unit, roots[rows]), offsets, int(offsets.sum()))
    pairs = list(combinations(range(len(rows)), 2))
    order = rng.permutation(len(pairs))
    failures = searches = 0
    while failures < len(pairs) and searches < _SEARCHES:
        kept = np.delete(rows, pairs[order[searches % len(pairs)]])
        free = np.setdiff1d(np.arange(count), kept)
        pair, better = _best_pair(roots[free], offsets, _added(unit, roots[kept]), cuts, least)
        searches += 1
        failures += 1
        if pair is not None:
            rows, least, failures = np.append(kept, free[pair]), better, 0
            cuts, _ = _cuts(_added(unit, roots[rows]), offsets, int(offsets.sum()))
    return 1 / least, rows


def _best_pair(
    roots: Matrix, offsets: Mask, information: Matrix, cuts: Matrix, least: float
) -> tuple[Index | None, float]:
    """The two measurements that added to `information` (f, f) raise its smallest eigenvalue most, and to
    what; None where none raises it above `least`."""
    rise = np.asarray(((roots @ cuts.T) ** 2).sum(axis=1))  # (C, cuts)
    lacking = least - ((cuts @ information) * cuts).sum(axis=1)
    # Coarsely by the first cuts, then one by one: a quarter of the memory, and most pairs are out.
    coarse, enough = rise.astype(np.float32), (lacking - 1e-5 * np.abs(least)).astype(np.float32)
    within = np.tri(len(roots), k=-1, dtype=bool)
    for u in range(min(3, len(cuts))):
        within &= coarse[:, None, u] + coarse[None, :, u] > enough[u]
    first, second = np.nonzero(within)
    spare = np.full(len(first), np.inf)
    for u in range(len(cuts)):
        margin = rise[first, u] + rise[second, u] - lacking[u]
        left = margin > _STEP * least
        first, second, spare = first[left], second[left], np.minimum(spare, margin)[left]
    best: Index | None = None
    for _ in range(_LOOKS):
        if not len(first):
            break
        promising = int(spare.argmax())
        pair = np.array([first[promising], second[promising]])
        fresh, value = _cuts(_added(information, roots[pair]), offsets, 2)
        spare[promising] = -np.inf
        if value > least * (1 + _STEP):
            spare -= value - least
            best, least = pair, value
        rise = np.asarray(((roots @ fresh.T) ** 2).sum(axis=1))
        level = least - ((fresh @ information) * fresh).sum(axis=1)
        spare = np.minimum(spare, (rise[first] + rise[second] - level).min(axis=1))
        left = spare > _STEP * least
        first, second, spare = first[left], second[left], spare[left]
    return best, least


def _added(information: Matrix, roots: Matrix) -> Matrix:
    stacked = roots.reshape(-1, roots.shape[2])
    return np.asarray(information + stacked.T @ stacked)


def _cuts(information: Matrix, offsets: Mask, count: int) -> tuple[Matrix, float]:
    """(count, f) vectors that bound the smallest eigenvalues of the information on the offsets tightly at
    this design, and the smallest."""
    inverse = np.linalg.inv(information)
    values, vectors = np.linalg.eigh(inverse[offsets][:, offsets])
    return (inverse[:, offsets] @ vectors[:, ::-1][:, :count] / values[::-1][:count]).T, 1 / float(values[-1])
