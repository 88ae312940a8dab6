"""Designs of measurements in shares, and the bounds that they prove: no choice of as many can be better.

Everything is in covariances of the scaled offsets, targets and tool eliminated: A minimises their mean
variance, D their generalised variance, E the largest variance of any combination. The unit prior is
part of the information, so that few measurements are no singular case.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from ...model.arrays import Index, Mask, Matrix
from ...model.errors import FitFailed

Criterion = Literal["A", "D", "E"]
Measure = Literal["A", "D", "E", "soft"]  # soft: a smooth stand-in for E

SOFT = 8  # power of the mean of eigenvalues that stands in for the largest
_GAP = 2e-4  # of the bound on the continuous optimum, relative
_ROUNDS = 240
_INNER = 50  # updates between two looks at all candidates
_ADDED = 40
_BEGUN_AMONG = 1000  # candidates
_CUTS = 60
_CUTS_AT_ONCE = 5
_CUTS_KEPT = 18  # whether or not they have a price
_COLUMNS = 12
_GAP_E = 2e-3
_GAP_START = 5e-4  # of the A-optimum that E begins with


@dataclass(frozen=True, eq=False)
class Candidates:
    """`roots` (C, d, f): whitened, prior-scaled Jacobians of the candidates, free parameters;
    `offsets` (f,) True for the parameters that matter, the rest is nuisance. `groups` (C,) are numbers: of
    each group as many are chosen as are asked for; by default all are of one."""

    roots: Matrix
    offsets: Mask
    groups: Index = field(default_factory=lambda: np.zeros(1, dtype=np.int64))

    @property
    def count(self) -> int:
        return len(self.roots)

    @property
    def group(self) -> Index:
        """(C,) the group of each."""
        return np.broadcast_to(self.groups, self.count)

    def some(self, rows: Index) -> Candidates:
        return Candidates(self.roots[rows], self.offsets, self.group[rows])

    def information(self, rows: Index) -> Matrix:
        """(f, f) of the chosen measurements, the unit prior included."""
        stacked = self.roots[rows].reshape(-1, self.roots.shape[2])
        result: Matrix = stacked.T @ stacked + np.eye(self.roots.shape[2])
        return result


@dataclass(frozen=True, eq=False)
class Continuous:
    """A design of measurements in shares. `weights` (C,) of sum 1; `bound` below which no design of as many
    measurements can be, in shares or whole; `gain` (C,) what each candidate promises there. `converged`: the
    bound came as near to the design as was asked for, before the steps were used up; it holds either way."""

    weights: Matrix
    bound: float
    gain: Matrix
    converged: bool = True


def variance(covariance: Matrix, criterion: Measure) -> float:
    """The criterion of a covariance (s, s) of the offsets, as a variance: mean, geometric mean, largest."""
    if criterion == "soft":
        return float(power_mean(covariance[None], SOFT)[0])
    if criterion == "A":
        return float(np.trace(covariance)) / len(covariance)
    if criterion == "D":
        return float(np.exp(np.linalg.slogdet(covariance)[1] / len(covariance)))
    return float(np.linalg.eigvalsh(covariance)[-1])


def slope_root(covariance: Matrix, criterion: Measure) -> Matrix:
    """(s, s) a root R of the criterion's slope: it falls by no more than |R' D R| where D is taken from the
    covariance (s, s), for D its log."""
    if criterion == "A":
        return np.asarray(np.eye(len(covariance)) / np.sqrt(len(covariance)))
    values, vectors = np.linalg.eigh(covariance)
    if criterion == "D":
        weights = 1 / (values * len(values))
    elif criterion == "soft":
        weights = (values / np.linalg.norm(values, SOFT)) ** (SOFT - 1)
    else:
        weights = np.equal(np.arange(len(values)), len(values) - 1).astype(float)
    return np.asarray(vectors * np.sqrt(weights))


def offset_covariance(candidates: Candidates, information: Matrix) -> Matrix:
    """(s, s) of the scaled offsets under an information matrix (f, f)."""
    return np.asarray(np.linalg.inv(information)[np.ix_(candidates.offsets, candidates.offsets)])


def continuous(
    candidates: Candidates,
    counts: Sequence[int],
    criterion: Criterion,
    *,
    most: float = 1.0,
    gap: float = _GAP,
) -> Continuous:
    """The best continuous design of so many measurements of each group, with a lower bound for every design
    that gives no candidate a share of all above `most` (1 over their number where all are different), to
    within a `gap` of it.

    Multiplicative updates on an active set, to which the candidates that violate the equivalence theorem
    (Kiefer & Wolfowitz 1960; Pukelsheim 1993, chapter 7) most are added until the bound is tight. The
    bound is the criterion's linearisation: the criterion is convex in the weights, so the bound holds
    wherever the updates stop.
    """
    shots = sum(counts)
    shares = Shares(candidates.group, np.array(counts) / shots, most)
    if criterion == "E":
        return _continuous_e(candidates, counts, shares)
    active = np.concatenate(
        [rows[_spread(candidates.some(rows), 4 * candidates.roots.shape[2])] for rows in shares.rows]
    )
    weights = shares.of(active).scaled(np.ones(len(active)))
    best_bound, converged = 0.0, False
    for _ in range(_ROUNDS):
        roots, of_active = candidates.roots[active], shares.of(active)
        for _ in range(_INNER):
            at = _Slope(candidates, roots, weights, shots, criterion)
            gain = at.gain(roots)
            total = float(weights @ gain)
            if of_active.unlimited(gain) - total <= gap / 4 * at.scale:
                break
            weights = of_active.scaled(weights * np.sqrt(gain))
        everywhere = at.gain(candidates.roots)
        bound = at.bound(shares.largest(everywhere) - total)
        best_bound = max(best_bound, bound)
        converged = bound >= at.value * (1 - gap)
        if converged:
            break
        kept = weights > 1e-6
        above = everywhere - of_active.mean(weights, gain)[candidates.group]
        promising = np.concatenate([rows[np.argsort(-above[rows])[:_ADDED]] for rows in shares.rows])
        promising = promising[above[promising] > gap / 4 * at.scale]
        fresh = np.setdiff1d(promising, active[kept])
        active = np.concatenate([active[kept], fresh])
        # Without fresh ones the updates were not done yet: they go on.
        share = 0.1 if len(fresh) else 0.0
        weights = shares.of(active).scaled(
            np.concatenate([(1 - share) * weights[kept], np.full(len(fresh), share / max(len(fresh), 1))])
        )
    result = np.zeros(candidates.count)
    result[active] = weights
    return Continuous(result, best_bound, everywhere, converged)


@dataclass(frozen=True, eq=False)
class Shares:
    """What the weights of candidates of each of G groups are together: `shares` (G,) of sum 1; no weight is
    above `most`. `group` (C,) is that of each candidate."""

    group: Index
    shares: Matrix
    most: float

    @cached_property
    def rows(self) -> list[Index]:
        """(G,) the candidates of each group."""
        return [np.flatnonzero(self.group == g) for g in range(len(self.shares))]

    def of(self, rows: Index) -> Shares:
        """Those of some candidates."""
        return Shares(self.group[rows], self.shares, self.most)

    def scaled(self, weights: Matrix) -> Matrix:
        """Weights (C,) in proportion, such that those of each group have its share."""
        sums = np.bincount(self.group, weights, len(self.shares))
        return np.asarray(weights * (self.shares / np.maximum(sums, 1e-300))[self.group])

    def mean(self, weights: Matrix, worth: Matrix) -> Matrix:
        """(G,) weighted means of the `worth` (C,) of candidates."""
        sums = np.bincount(self.group, weights * worth, len(self.shares))
        return np.asarray(sums / np.maximum(self.shares, 1e-300))

    def unlimited(self, worth: Matrix) -> float:
        """The largest sum of weights times `worth` (C,), whatever a single weight."""
        return float(sum(share * worth[r].max() for share, r in zip(self.shares, self.rows, strict=True)))

    def largest(self, worth: Matrix) -> float:
        """The largest sum of weights times `worth` (C,)."""
        return sum(self._most_of(worth[r], s) for r, s in zip(self.rows, self.shares.tolist(), strict=True))

    def _most_of(self, worth: Matrix, share: float) -> float:
        whole = min(int(share / self.most + 1e-9), len(worth))
        best = -np.sort(-worth)[: whole + 1]
        rest = (share - whole * self.most) * best[-1] if len(best) > whole else 0.0
        return float(self.most * best[:whole].sum() + rest)

    def capped(self, weights: Matrix) -> Matrix:
        """Weights of which none is above `most`: what is above is given to the others of its group evenly."""
        result = weights.copy()
        for rows, share in zip(self.rows, self.shares.tolist(), strict=True):
            some = result[rows]
            while (some > self.most * (1 + 1e-9)).any():
                some = np.minimum(some, self.most)
                free = some < self.most
                some = some + free * (share - some.sum()) / free.sum()
            result[rows] = some
        return result


class _Slope:
    """The criterion at a continuous design and its derivative by the weight of any measurement.

    For D it is the log of the generalised variance.
    """

    def __init__(
        self, candidates: Candidates, roots: Matrix, weights: Matrix, shots: int, criterion: Criterion
    ) -> None:
        size = roots.shape[2]
        stacked = (roots * np.sqrt(shots * weights)[:, None, None]).reshape(-1, size)
        inverse = np.linalg.inv(stacked.T @ stacked + np.eye(size))
        covariance: Matrix = np.asarray(inverse[np.ix_(candidates.offsets, candidates.offsets)], dtype=float)
        self._criterion, self._shots = criterion, shots
        self.value = variance(covariance, criterion)
        self._root = inverse[:, candidates.offsets] @ slope_root(covariance, criterion)

    @property
    def scale(self) -> float:
        """What a difference of gains is to be compared with."""
        return 1.0 if self._criterion == "D" else self.value

    def gain(self, roots: Matrix) -> Matrix:
        """(C,) decrease of the criterion per weight of each measurement (C, d, f)."""
        return np.asarray(self._shots * (times(roots, self._root) ** 2).sum(axis=(1, 2)))

    def bound(self, excess: float) -> float:
        """A variance that no design is below; `excess` is the largest gain minus the weighted mean."""
        if self._criterion == "D":
            return self.value * float(np.exp(-excess))
        return self.value - excess


def _continuous_e(candidates: Candidates, counts: Sequence[int], shares: Shares) -> Continuous:
    """The same for the E-criterion, whose largest eigenvalue has no gradient at the optimum: cutting planes.

    With G = M^-1 K S, S = (K' M^-1 K)^-1 the information on the offsets at any design, S(w) <= G' M(w) G
    for every w (Pukelsheim 1993, section 3.14): each eigenvector v bounds the smallest eigenvalue of S(w)
    by a linear function of w. A linear program finds the best w under all bounds so far.
    """
    start, shots = continuous(candidates, counts, "A", gap=_GAP_START), sum(counts)
    weights, gain = shares.capped(start.weights), start.gain
    size, offsets = candidates.roots.shape[2], candidates.offsets
    rows: list[Matrix] = []
    heights: list[float] = []
    best, best_value = weights, np.inf
    bound, converged = 0.0, False
    columns = np.flatnonzero(weights)
    for _ in range(_CUTS):
        used = weights > 0
        stacked = candidates.roots[used] * np.sqrt(shots * weights[used])[:, None, None]
        inverse = np.linalg.inv(np.einsum("cdf,cdg->fg", stacked, stacked) + np.eye(size))
        values, vectors = np.linalg.eigh(inverse[np.ix_(offsets, offsets)])
        if values[-1] < best_value:
            best, best_value = weights, float(values[-1])
        converged = bound >= best_value * (1 - _GAP_E)
        if converged:
            break
        for value, vector in zip(values[::-1][:_CUTS_AT_ONCE], vectors.T[::-1][:_CUTS_AT_ONCE], strict=True):
            pull = inverse[:, offsets] @ vector / value
            rows.append(shots * ((candidates.roots @ pull) ** 2).sum(axis=1))
            heights.append(float(pull @ pull))
        ahead, ceiling, price = _highest_under(np.array(rows), np.array(heights), shares, columns)
        if 1 / ceiling > bound:
            bound, gain = 1 / ceiling, price @ np.array(rows)
        columns = np.flatnonzero(ahead)
        # Cuts without a price do not hold the program back: without them it stays small.
        kept = np.flatnonzero((price > 0) | (np.arange(len(rows)) >= len(rows) - _CUTS_KEPT))
        rows, heights = [rows[i] for i in kept], [heights[i] for i in kept]
        # Half way back to the best design: the plain method swings from corner to corner.
        weights = (ahead + best) / 2
    return Continuous(best, bound, gain, converged)


def _highest_under(
    rows: Matrix, heights: Matrix, shares: Shares, columns: Index
) -> tuple[Matrix, float, Matrix]:
    """Weights w (C,) with those `shares` that raise min(heights + rows w), a ceiling of it for
    every such w, and the price of each row.

    The program has candidates as columns, at first `columns` and the most promising; its dual prices all
    others, so that the ceiling holds for them too, and those of them that are worth most join. It ends, since
    each time new ones do: with all of them its optimum is the ceiling.
    """
    from scipy.optimize import linprog  # for this criterion alone, and slow to come

    count, sums = rows.shape[1], rows.sum(axis=0)
    # So many that there is an answer at all.
    enough = [int(share / shares.most) + 1 for share in shares.shares.tolist()]
    promising = [r[np.argsort(-sums[r])[:k]] for r, k in zip(shares.rows, enough, strict=True)]
    leading = np.argpartition(-rows, min(_COLUMNS, count - 1), axis=1)[:, :_COLUMNS]
    columns = np.unique(np.concatenate([columns, *promising, leading.ravel()]))
    ceiling, groups = np.inf, np.arange(len(shares.shares))
    while True:
        scale = float(rows[:, columns].max())
        solved = linprog(
            np.append(np.zeros(len(columns)), -1.0),
            A_ub=np.hstack([-rows[:, columns] / scale, np.ones((len(rows), 1))]),
            b_ub=heights / scale,
            A_eq=np.hstack([np.equal.outer(groups, shares.group[columns]), np.zeros((len(groups), 1))]),
            b_eq=shares.shares,
            bounds=[(0, shares.most)] * len(columns) + [(None, None)],
        )
        if solved.status != 0:
            raise FitFailed(f"the bound on the best plan could not be found: {solved.message}")
        price = np.maximum(-solved.ineqlin.marginals, 0.0)
        price /= price.sum()
        worth = price @ rows
        ceiling = min(ceiling, float(price @ heights) + shares.largest(worth))
        absent = np.setdiff1d(np.arange(count), columns)
        if ceiling <= float(solved.x[-1]) * scale * (1 + _GAP) or not len(absent):
            weights = np.zeros(count)
            weights[columns] = np.maximum(solved.x[:-1], 0.0)
            return shares.scaled(weights), ceiling, price
        columns = np.union1d(columns, absent[np.argsort(-worth[absent])[:_COLUMNS]])


def _spread(candidates: Candidates, size: int) -> Index:
    """Candidates to begin with, some of all: greedily those with most information on what is not determined
    yet."""
    step = max(1, candidates.count // _BEGUN_AMONG)
    roots = candidates.roots[::step]
    covariance = np.eye(roots.shape[2])
    gain = (roots**2).sum(axis=(1, 2))
    chosen: list[int] = []
    for _ in range(min(size, len(roots))):
        best = int(np.argmax(gain))
        chosen.append(best)
        taken = covariance @ roots[best].T
        factor = np.linalg.cholesky(np.eye(roots.shape[1]) + roots[best] @ taken)
        taken = np.linalg.solve(factor, taken.T).T
        covariance = covariance - taken @ taken.T
        gain -= (times(roots, taken) ** 2).sum(axis=(1, 2))
        gain[best] = -np.inf
    return np.array(chosen, dtype=np.int64) * step


def times(roots: Matrix, by: Matrix) -> Matrix:
    """(C, d, k) `roots` (C, d, f) times `by` (f, k), as one product: many small ones take several times as
    long."""
    return np.asarray((roots.reshape(-1, roots.shape[2]) @ by).reshape(*roots.shape[:2], -1))


def power_mean(covariances: Matrix, power: int) -> Matrix:
    """(C,) root of the sum of the eigenvalues' powers (a power of 2): a little above the largest."""
    scale = np.trace(covariances, axis1=1, axis2=2)
    raised = covariances / scale[:, None, None]
    for _ in range(power.bit_length() - 1):
        raised = raised @ raised
    return np.asarray(scale * np.trace(raised, axis1=1, axis2=2) ** (1 / power))
