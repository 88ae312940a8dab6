"""Designs of measurements in shares, and the bounds that they prove: no choice of as many can be better.

Everything is in covariances of the scaled offsets, targets and tool eliminated: A minimises their mean
variance, D their generalised variance, E the largest variance of any combination. The unit prior is
part of the information, so that few measurements are no singular case.
"""

from __future__ import annotations

from dataclasses import dataclass
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
    `offsets` (f,) True for the parameters that matter, the rest is nuisance."""

    roots: Matrix
    offsets: Mask

    @property
    def count(self) -> int:
        return len(self.roots)

    def information(self, rows: Index) -> Matrix:
        """(f, f) of the chosen measurements, the unit prior included."""
        stacked = self.roots[rows].reshape(-1, self.roots.shape[2])
        result: Matrix = stacked.T @ stacked + np.eye(self.roots.shape[2])
        return result


@dataclass(frozen=True, eq=False)
class Continuous:
    """A design of measurements in shares. `weights` (C,) of sum 1; `bound` below which no design of as many
    measurements can be, in shares or whole; `gain` (C,) what each candidate promises there."""

    weights: Matrix
    bound: float
    gain: Matrix


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
    candidates: Candidates, shots: int, criterion: Criterion, *, most: float = 1.0, gap: float = _GAP
) -> Continuous:
    """The best continuous design of `shots` measurements, with a lower bound for every design that gives no
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
        roots = candidates.roots[active]
        for _ in range(_INNER):
            at = _Slope(candidates, roots, weights, shots, criterion)
            gain = at.gain(roots)
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
        root = np.linalg.cholesky(np.linalg.inv(np.eye(roots.shape[1]) + roots[best] @ taken))
        taken = taken @ root
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
