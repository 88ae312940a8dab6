"""The types of arrays and of progress that all rooms share, and the quantile of the normal distribution."""

from __future__ import annotations

from collections.abc import Callable
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
Progress = Callable[[str, float], None]  # the stage, and its share of the whole that is done, 0 to 1
ShareDone = Callable[[float], None]  # the share of the whole that is done, 0 to 1


def normal_half_width(level: float = 0.95) -> float:
    """Half width of a normal distribution's central interval that holds `level`, in standard uncertainties.

    >>> round(normal_half_width(), 6), round(normal_half_width(0.6827), 3)
    (1.959964, 1.0)
    """
    return NormalDist().inv_cdf((1 + level) / 2)


NORMAL_95 = normal_half_width()
