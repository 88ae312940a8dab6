"""Values that do not belong to the rest: the generalised extreme Studentised deviate test.

Rosner, Technometrics 25, 1983: several outliers, of a number that is not known beforehand, among normal
values. With no outlier it names one with a chance of `level` at most; several do not hide each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy

from ...model.arrays import Matrix

FEWEST = 15  # values: from here on the stated level holds (Rosner 1983, table 3)
_MOST_ODD = 0.1  # of all values: more are no outliers but another population


class Odd(NamedTuple):
    """The value at place `row`, and how many standard deviations of the others it is off their mean."""

    row: int
    off: float


def odd_values(values: Sequence[float] | Matrix, level: float) -> list[Odd]:
    """The outliers among normal `values`, the furthest first; none among fewer than `FEWEST`."""
    all_values = np.asarray(values, dtype=float)
    count, left = len(all_values), np.arange(len(all_values))
    if count < FEWEST:
        return []
    removed: list[int] = []
    odd = 0
    for k in range(1, max(1, int(_MOST_ODD * count)) + 1):
        rest = all_values[left]
        off, std = np.abs(rest - rest.mean()), float(rest.std(ddof=1))
        if not std > 0:
            break
        furthest = int(np.argmax(off))
        removed.append(int(left[furthest]))
        left = np.delete(left, furthest)
        if off[furthest] / std > _critical(count, k, level):
            odd = k
    others = np.setdiff1d(np.arange(count), removed[:odd])
    mean, std = float(all_values[others].mean()), float(all_values[others].std(ddof=1))
    return [Odd(row, float((all_values[row] - mean) / std)) for row in removed[:odd]]


def _critical(count: int, k: int, level: float) -> float:
    """Rosner's lambda of the k-th deviate of so many values."""
    dof = count - k - 1
    t = float(scipy.special.stdtrit(dof, 1 - level / (2 * (count - k + 1))))
    return (count - k) * t / float(np.sqrt((dof + t * t) * (count - k + 1)))
