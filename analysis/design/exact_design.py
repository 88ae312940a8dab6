"""The best shots: k of many candidates by D-, A- or E-optimality for the offsets, with a certified bound.

Everything is in covariances of the scaled offsets, targets and tool eliminated: A minimises their mean
variance, D their generalised variance, E the largest variance of any combination. The unit prior is
part of the information, so that few shots are no singular case.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...model.errors import FitFailed
from ...model.robot import Matrix
from .pair_exchange import exchange_pairs

Criterion = Literal["A", "D", "E"]
Index = NDArray[np.int64]
_Measure = Literal["A", "D", "E", "soft"]  # soft: a smooth stand-in for E

STARTS = 24
_SWEEPS = 30
_NEAR = 400  # candidates among which the starts exchange, those of the largest gain at the optimum
_NEAR_FEW = 2000  # the same with fewer numbers than unknowns, where the optimum says less of whole shots
_SCREENED = 64  # candidates of which E looks at the eigenvalues, the most promising by a power mean
_SOFT, _SHARP = 8, 32  # powers of the mean of eigenvalues that stands in for the largest
_GAP = 2e-4  # of the bound on the continuous optimum, relative
_ROUNDS = 60
_INNER = 200
_ADDED = 20
_CUTS = 60
_CUTS_AT_ONCE = 5
_CUTS_KEPT = 18  # whether or not they have a price
_COLUMNS = 12
_GAP_E = 2e-3
_GAP_START = 1e-3  # of the A-optimum that E begins with
_PAIRED = 300  # candidates of which E exchanges two at once
_PAIRED_STARTS = 4  # different ones that are begun from


@dataclass(frozen=True, eq=False)
class Candidates:
    """`roots` (C, d, f): whitened, prior-scaled Jacobians of the candidate shots, free parameters;
    `offsets` (f,) True for the parameters that matter, the rest is nuisance."""

    roots: Matrix
    offsets: NDArray[np.bool_]

    @property
    def count(self) -> int:
        return len(self.roots)

    def information(self, rows: Index) -> Matrix:
        """(f, f) of the chosen shots, the unit prior included."""
        stacked = self.roots[rows].reshape(-1, self.roots.shape[2])
        result: Matrix = stacked.T @ stacked + np.eye(self.roots.shape[2])
        return result


@dataclass(frozen=True, eq=False)
class Continuous:
    """A design of shots in shares. `weights` (C,) of sum 1; `bound` below which no design of as many
    shots can be, in shares or whole; `gain` (C,) what each candidate promises there."""

    weights: Matrix
    bound: float
    gain: Matrix


@dataclass(frozen=True, eq=False)
class Design:
    """`rows` (k,) of the chosen candidates; `value` of the criterion (a variance), `bound` below which no
    choice of k of these candidates can be, `efficiency` bound / value."""

    criterion: Criterion
    rows: Index
    value: float
    bound: float
    support: int

    @property
    def efficiency(self) -> float:
        return self.bound / self.value


def design(
    candidates: Candidates, shots: int, criterion: Criterion, seed: int, starts: int = STARTS
) -> Design:
    """Choose `shots` different candidates by exchanges from several starts, with a bound on the best.

    The starts are rounded from the continuous optimum and drawn at random (fixed by `seed`). For E the
    best of them go on to exchanges of two shots at once.
    """
    ideal = continuous(candidates, shots, criterion, most=1 / shots)
    _, numbers, unknowns = candidates.roots.shape
    most = _NEAR if shots * numbers >= unknowns else _NEAR_FEW
    near = np.union1d(np.argsort(-ideal.gain)[: max(most, shots)], np.flatnonzero(ideal.weights > 0))
    few = Candidates(candidates.roots[near], candidates.offsets)
    rng = np.random.default_rng(seed)
    found: dict[tuple[int, ...], float] = {}
    for start in range(starts):
        rows = _start(ideal.weights[near], shots, rng, rounded=start % 4 != 3)
        if criterion == "E":
            # The largest eigenvalue has kinks in which exchanges get stuck: a smooth mean comes first.
            _, rows = _exchange(few, rows, "soft")
        value, rows = _exchange(few, rows, criterion)
        found[tuple(np.sort(rows).tolist())] = value
    best = sorted(found, key=found.__getitem__)
    rows = np.array(best[0])
    if criterion == "E":
        promising = np.argsort(-ideal.gain[near], kind="stable")[:_PAIRED]
        rows = _exchange_two(few, best[:_PAIRED_STARTS], promising, rng)
    value, rows = _exchange(candidates, near[rows], criterion)
    support = int((ideal.weights > 1e-4).sum())
    return Design(criterion, np.sort(rows), value, min(ideal.bound, value), support)


def variance(covariance: Matrix, criterion: _Measure) -> float:
    """The criterion of a covariance (s, s) of the offsets, as a variance: mean, geometric mean, largest."""
    if criterion == "soft":
        return float(_power_mean(covariance[None], _SOFT)[0])
    if criterion == "A":
        return float(np.trace(covariance)) / len(covariance)
    if criterion == "D":
        return float(np.exp(np.linalg.slogdet(covariance)[1] / len(covariance)))
    return float(np.linalg.eigvalsh(covariance)[-1])


def offset_covariance(candidates: Candidates, information: Matrix) -> Matrix:
    """(s, s) of the scaled offsets under an information matrix (f, f)."""
    return np.asarray(np.linalg.inv(information)[np.ix_(candidates.offsets, candidates.offsets)])


def continuous(
    candidates: Candidates, shots: int, criterion: Criterion, *, most: float = 1.0, gap: float = _GAP
) -> Continuous:
    """The best continuous design of `shots` shots, with a lower bound for every design that gives no
    candidate a share above `most` (1 / `shots` where all are different), to within a `gap` of it.

    Multiplicative updates on an active set, to which the candidates that violate the equivalence theorem
    (Kiefer & Wolfowitz 1960; Pukelsheim 1993, chapter 7) most are added until the bound is tight. The
    bound is the criterion's linearisation: the criterion is convex in the weights, so the bound holds
    wherever the updates stop.
    """
    if criterion == "E":
        return _continuous_e(candidates, shots, most)
    active = _spread(candidates, 4 * candidates.roots.shape[2])
    weights = np.full(len(active), 1 / len(active))
    best_bound = 0.0
    for _ in range(_ROUNDS):
        own = candidates.roots[active]
        for _ in range(_INNER):
            at = _Slope(candidates, own, weights, shots, criterion)
            gain = at.gain(own)
            total = float(weights @ gain)
            if gain.max() - total <= gap / 4 * at.scale:
                break
            weights = weights * np.sqrt(gain / total)
            weights /= weights.sum()
        everywhere = at.gain(candidates.roots)
        bound = at.bound(_most_of(everywhere, most) - total)
        best_bound = max(best_bound, bound)
        if bound >= at.value * (1 - gap):
            break
        kept = weights > 1e-6
        promising = np.argsort(-everywhere)[:_ADDED]
        promising = promising[everywhere[promising] > total + gap / 4 * at.scale]
        fresh = np.setdiff1d(promising, active[kept])
        active = np.concatenate([active[kept], fresh])
        # Without fresh ones the updates were not done yet: they go on.
        share = 0.1 if len(fresh) else 0.0
        weights = np.concatenate(
            [(1 - share) * weights[kept], np.full(len(fresh), share / max(len(fresh), 1))]
        )
        weights /= weights.sum()
    result = np.zeros(candidates.count)
    result[active] = weights
    return Continuous(result, best_bound, everywhere)


class _Slope:
    """The criterion at a continuous design and its derivative by the weight of any shot.

    For D it is the log of the generalised variance.
    """

    def __init__(
        self, candidates: Candidates, roots: Matrix, weights: Matrix, shots: int, criterion: Criterion
    ) -> None:
        size = roots.shape[2]
        stacked = (roots * np.sqrt(shots * weights)[:, None, None]).reshape(-1, size)
        inverse = np.linalg.inv(stacked.T @ stacked + np.eye(size))
        own: Matrix = np.asarray(inverse[np.ix_(candidates.offsets, candidates.offsets)], dtype=float)
        count = len(own)
        self._criterion, self._shots = criterion, shots
        self.value = variance(own, criterion)
        if criterion == "A":
            root = np.eye(count) / np.sqrt(count)
        else:
            root = np.linalg.cholesky(np.linalg.inv(own) / count)
        self._root = inverse[:, candidates.offsets] @ root

    @property
    def scale(self) -> float:
        """What a difference of gains is to be compared with."""
        return 1.0 if self._criterion == "D" else self.value

    def gain(self, roots: Matrix) -> Matrix:
        """(C,) decrease of the criterion per weight of each shot (C, d, f)."""
        return np.asarray(self._shots * ((roots @ self._root) ** 2).sum(axis=(1, 2)))

    def bound(self, excess: float) -> float:
        """A variance that no design is below; `excess` is the largest gain minus the weighted mean."""
        if self._criterion == "D":
            return self.value * float(np.exp(-excess))
        return self.value - excess


def _most_of(worth: Matrix, most: float) -> float:
    """The largest sum of shares times `worth` (C,), shares of sum 1 and none above `most`."""
    whole = min(int(1 / most + 1e-9), len(worth))
    best = -np.sort(-worth)[: whole + 1]
    rest = (1 - whole * most) * best[-1] if len(best) > whole else 0.0
    return float(most * best[:whole].sum() + rest)


def _capped(weights: Matrix, most: float) -> Matrix:
    """Shares of sum 1, none above `most`: what is above is given to the others evenly."""
    while (weights > most * (1 + 1e-9)).any():
        weights = np.minimum(weights, most)
        free = weights < most
        weights = weights + free * (1 - weights.sum()) / free.sum()
    return weights


def _continuous_e(candidates: Candidates, shots: int, most: float) -> Continuous:
    """The same for the E-criterion, whose largest eigenvalue has no gradient at the optimum: cutting planes.

    With G = M^-1 K S, S = (K' M^-1 K)^-1 the information on the offsets at any design, S(w) <= G' M(w) G
    for every w (Pukelsheim 1993, section 3.14): each eigenvector v bounds the smallest eigenvalue of S(w)
    by a linear function of w. A linear program finds the best w under all bounds so far.
    """
    start = continuous(candidates, shots, "A", gap=_GAP_START)
    weights, gain = _capped(start.weights, most), start.gain
    size, offsets = candidates.roots.shape[2], candidates.offsets
    rows: list[Matrix] = []
    heights: list[float] = []
    best, best_value = weights, np.inf
    bound = 0.0
    columns = np.flatnonzero(weights)
    for _ in range(_CUTS):
        used = weights > 0
        stacked = candidates.roots[used] * np.sqrt(shots * weights[used])[:, None, None]
        inverse = np.linalg.inv(np.einsum("cdf,cdg->fg", stacked, stacked) + np.eye(size))
        values, vectors = np.linalg.eigh(inverse[np.ix_(offsets, offsets)])
        if values[-1] < best_value:
            best, best_value = weights, float(values[-1])
        if bound >= best_value * (1 - _GAP_E):
            break
        for value, vector in zip(values[::-1][:_CUTS_AT_ONCE], vectors.T[::-1][:_CUTS_AT_ONCE], strict=True):
            pull = inverse[:, offsets] @ vector / value
            rows.append(shots * ((candidates.roots @ pull) ** 2).sum(axis=1))
            heights.append(float(pull @ pull))
        ahead, ceiling, price = _highest_under(np.array(rows), np.array(heights), most, columns)
        if 1 / ceiling > bound:
            bound, gain = 1 / ceiling, price @ np.array(rows)
        columns = np.flatnonzero(ahead)
        # Cuts without a price do not hold the program back: without them it stays small.
        kept = np.flatnonzero((price > 0) | (np.arange(len(rows)) >= len(rows) - _CUTS_KEPT))
        rows, heights = [rows[i] for i in kept], [heights[i] for i in kept]
        # Half way back to the best design: the plain method swings from corner to corner.
        weights = (ahead + best) / 2
    return Continuous(best, bound, gain)


def _highest_under(
    rows: Matrix, heights: Matrix, most: float, columns: Index
) -> tuple[Matrix, float, Matrix]:
    """Weights w (C,) of sum 1, none above `most`, that raise min(heights + rows w), a ceiling of it for
    every such w, and the price of each row.

    The program has candidates as columns, at first `columns` and the most promising; its dual prices all
    others, so that the ceiling holds for them too, and those that are priced too low join.
    """
    from scipy.optimize import linprog  # for this criterion alone, and slow to come

    count = rows.shape[1]
    promising = np.argsort(-rows.sum(axis=0))[: int(1 / most) + 1]  # so many that there is an answer at all
    leading = np.argpartition(-rows, min(_COLUMNS, count - 1), axis=1)[:, :_COLUMNS]
    columns = np.unique(np.concatenate([columns, promising, leading.ravel()]))
    ceiling = np.inf
    while True:
        scale = float(rows[:, columns].max())
        solved = linprog(
            np.append(np.zeros(len(columns)), -1.0),
            A_ub=np.hstack([-rows[:, columns] / scale, np.ones((len(rows), 1))]),
            b_ub=heights / scale,
            A_eq=np.append(np.ones(len(columns)), 0.0)[None],
            b_eq=[1.0],
            bounds=[(0, most)] * len(columns) + [(None, None)],
        )
        if solved.status != 0:
            raise FitFailed(f"the bound on the best plan could not be found: {solved.message}")
        price = np.maximum(-solved.ineqlin.marginals, 0.0)
        price /= price.sum()
        worth = price @ rows
        ceiling = min(ceiling, float(price @ heights) + _most_of(worth, most))
        if ceiling <= float(solved.x[-1]) * scale * (1 + _GAP):
            weights = np.zeros(count)
            weights[columns] = np.maximum(solved.x[:-1], 0.0)
            return weights / weights.sum(), ceiling, price
        columns = np.union1d(columns, np.argsort(-worth)[:_COLUMNS])


def _spread(candidates: Candidates, size: int) -> Index:
    """Candidates to begin with: greedily those with most information on what is not determined yet."""
    roots = candidates.roots
    information = np.eye(roots.shape[2])
    chosen: list[int] = []
    for _ in range(min(size, candidates.count)):
        seen = roots @ np.linalg.cholesky(np.linalg.inv(information))
        gain = (seen**2).sum(axis=(1, 2))
        gain[chosen] = -1.0
        best = int(np.argmax(gain))
        chosen.append(best)
        information = information + roots[best].T @ roots[best]
    return np.array(chosen, dtype=np.int64)


def _start(weights: Matrix, shots: int, rng: np.random.Generator, *, rounded: bool) -> Index:
    """Different candidates to start from: drawn by the continuous weights, or evenly."""
    chance = weights + 1e-9 if rounded else np.ones_like(weights)
    return rng.choice(len(weights), size=shots, replace=False, p=chance / chance.sum())


def _exchange(candidates: Candidates, rows: Index, criterion: _Measure) -> tuple[float, Index]:
    """Replace shot by shot with the best candidate until no exchange helps (Fedorov 1972)."""
    rows = rows.copy()
    value = variance(offset_covariance(candidates, candidates.information(rows)), criterion)
    for _ in range(_SWEEPS):
        before = value
        for place in range(len(rows)):
            others = np.delete(rows, place)
            values = _values_with(candidates, candidates.information(others), criterion)
            values[others] = np.inf
            best = int(np.argmin(values))
            if values[best] < value * (1 - 1e-12):
                rows[place], value = best, float(values[best])
        if value > before * (1 - 1e-9):
            break
    return value, rows


def _exchange_two(
    candidates: Candidates, starts: Sequence[Sequence[int]], promising: Index, rng: np.random.Generator
) -> Index:
    """The best for E of what exchanges of two shots at once, for the `promising` ones, make of `starts`."""
    ends = []
    for start in starts:
        among = np.union1d(promising, start)
        own = np.searchsorted(among, start)
        value, rows = exchange_pairs(candidates.roots[among], candidates.offsets, own, rng)
        ends.append((value, among[rows]))
    return min(ends, key=lambda end: end[0])[1]


def _values_with(candidates: Candidates, information: Matrix, criterion: _Measure) -> Matrix:
    """(C,) the criterion after adding each candidate to the information (rank-d updates).

    For E it is exact for the most promising candidates and infinite for the others.
    """
    roots, offsets = candidates.roots, candidates.offsets
    covariance = np.linalg.inv(information)
    spread = roots @ covariance
    gram = spread @ roots.transpose(0, 2, 1) + np.eye(roots.shape[1])
    own, on_offsets = covariance[np.ix_(offsets, offsets)], spread[:, :, offsets]
    if criterion == "D":
        log = np.linalg.slogdet(own)[1] - np.linalg.slogdet(gram)[1]
        if not offsets.all():
            # The determinant of the whole over that of the nuisance's own information.
            inner = roots[:, :, ~offsets]
            alone = np.linalg.inv(information[np.ix_(~offsets, ~offsets)])
            within = inner @ alone @ inner.transpose(0, 2, 1) + np.eye(roots.shape[1])
            log = log + np.linalg.slogdet(within)[1]
        return np.asarray(np.exp(log / len(own)))
    solved = np.linalg.solve(gram, on_offsets)
    if criterion == "A":
        return np.asarray((np.trace(own) - (solved * on_offsets).sum(axis=(1, 2))) / len(own))
    after = own - on_offsets.transpose(0, 2, 1) @ solved
    if criterion == "soft":
        return _power_mean(after, _SOFT)
    largest = np.full(len(roots), np.inf)
    nearly = _power_mean(after, _SHARP)
    screened = np.argpartition(nearly, min(_SCREENED, len(nearly)) - 1)[:_SCREENED]
    largest[screened] = np.linalg.eigvalsh(after[screened])[:, -1]
    return largest


def _power_mean(covariances: Matrix, power: int) -> Matrix:
    """(C,) root of the sum of the eigenvalues' powers (a power of 2): a little above the largest."""
    scale = np.trace(covariances, axis1=1, axis2=2)
    raised = covariances / scale[:, None, None]
    for _ in range(power.bit_length() - 1):
        raised = raised @ raised
    return np.asarray(scale * np.trace(raised, axis1=1, axis2=2) ** (1 / power))
