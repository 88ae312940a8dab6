"""Tolerances of the geometry as knowledge: what the data add to each, and where they add nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...model.arrays import Matrix

_NO_INFORMATION = 1e-8  # on a geometry parameter, beside that of its tolerance
_ROUNDING = 1e-11  # singular values below this share of a unit column are rounding
_PART = 1e-6  # of a column that the others leave over: less is none


def without_own(scaled_std: Matrix, unbounded: NDArray[np.bool_]) -> Matrix:
    """(g,) std of geometry parameters, in tolerances, without the tolerance of each its own (that of the
    others stays): what the data add, nothing for those that are `unbounded` (g,)."""
    added = np.where(unbounded, 0.0, 1 / scaled_std**2 - 1)
    return np.where(added > _NO_INFORMATION, 1 / np.sqrt(np.maximum(added, _NO_INFORMATION)), np.inf)


def spanned(jacobian: Matrix, tolerated: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(g,) which geometry parameters do to the data what the others that are free can do as well.

    From A (M, f), of which the last g rows are the tolerances. Rounding hides it in a std: one direction that
    the data see a million times better than a tolerance is enough.
    """
    count = int(tolerated.sum())
    if count == 0:
        return np.zeros(0, dtype=bool)
    data = jacobian[: len(jacobian) - count]
    own, others = data[:, tolerated], data[:, ~tolerated]
    length = np.linalg.norm(others, axis=0)
    left, singular, _ = np.linalg.svd(others / np.where(length > 0, length, 1.0), full_matrices=False)
    kept = left[:, singular > _ROUNDING * max(1.0, float(singular.max(initial=0.0)))]
    beyond = own - kept @ (kept.T @ own)
    largest = float(np.linalg.norm(jacobian, axis=0).max(initial=0.0))
    bound = np.maximum(_PART * np.linalg.norm(own, axis=0), _ROUNDING * max(1.0, largest))
    return np.asarray(np.linalg.norm(beyond, axis=0) <= bound)
