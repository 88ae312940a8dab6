"""Exchanges of two measurements at once for the E-criterion, whose single exchanges end in poor designs.

All pairs of candidates are searched, and few of them looked at. With K the columns of the offsets, every
vector u with K'u = v of length 1 bounds the smallest eigenvalue of the information on the offsets:
S(M) <= u' M u (Pukelsheim 1993, section 3.14). The bound is a sum over measurements, so that it costs a pair
one addition; a pair that is below the best design by one u is out. Each pair that is looked at gives the u
that bound it tightly.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ...model.arrays import Index, Matrix

_SEARCHES = 150  # of a start: with many measurements not every two of them are exchanged
_LOOKS = 60  # at single pairs in one search
_STEP = 1e-9  # relative: less is no improvement


def exchange_pairs(
    roots: Matrix, offsets: NDArray[np.bool_], rows: Index, rng: np.random.Generator
) -> tuple[float, Index]:
    """Replace two measurements of `rows` (k,) at a time by the best two of the candidates `roots` (C, d, f)
    until none of these exchanges helps: the largest variance of the offsets, and the rows."""
    count, size = len(roots), roots.shape[2]
    unit = np.eye(size)
    cuts, least = _cuts(_added(unit, roots[rows]), offsets, int(offsets.sum()))
    places = list(combinations(range(len(rows)), 2))
    order = rng.permutation(len(places))
    failures = searches = 0
    while failures < len(places) and searches < _SEARCHES:
        kept = np.delete(rows, places[order[searches % len(places)]])
        free = np.setdiff1d(np.arange(count), kept)
        found, better = _best_pair(roots[free], offsets, _added(unit, roots[kept]), cuts, least)
        searches += 1
        failures += 1
        if found is not None:
            rows, least, failures = np.append(kept, free[found]), better, 0
            cuts, _ = _cuts(_added(unit, roots[rows]), offsets, int(offsets.sum()))
    return 1 / least, rows


def _best_pair(
    roots: Matrix, offsets: NDArray[np.bool_], information: Matrix, cuts: Matrix, least: float
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
        own = rise[first, u] + rise[second, u] - lacking[u]
        left = own > _STEP * least
        first, second, spare = first[left], second[left], np.minimum(spare, own)[left]
    found: Index | None = None
    for _ in range(_LOOKS):
        if not len(first):
            break
        promising = int(spare.argmax())
        pair = np.array([first[promising], second[promising]])
        fresh, value = _cuts(_added(information, roots[pair]), offsets, 2)
        spare[promising] = -np.inf
        if value > least * (1 + _STEP):
            spare -= value - least
            found, least = pair, value
        rise = np.asarray(((roots @ fresh.T) ** 2).sum(axis=1))
        level = least - ((fresh @ information) * fresh).sum(axis=1)
        spare = np.minimum(spare, (rise[first] + rise[second] - level).min(axis=1))
        left = spare > _STEP * least
        first, second, spare = first[left], second[left], spare[left]
    return found, least


def _added(information: Matrix, roots: Matrix) -> Matrix:
    stacked = roots.reshape(-1, roots.shape[2])
    return np.asarray(information + stacked.T @ stacked)


def _cuts(information: Matrix, offsets: NDArray[np.bool_], count: int) -> tuple[Matrix, float]:
    """(count, f) vectors that bound the smallest eigenvalues of the information on the offsets tightly at
    this design, and the smallest."""
    inverse = np.linalg.inv(information)
    values, vectors = np.linalg.eigh(inverse[offsets][:, offsets])
    return (inverse[:, offsets] @ vectors[:, ::-1][:, :count] / values[::-1][:count]).T, 1 / float(values[-1])
