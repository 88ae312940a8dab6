"""When the next calibration is due: until the walk has moved the TCP farther than is tolerated."""

from __future__ import annotations

import numpy as np
from scipy import special
from scipy.stats import qmc

from ...model.arrays import Matrix
from .drift import Drift

COVERAGE = 0.95
HORIZON_YEARS = 20.0
_DRAWS = 4096  # a power of two


def due_after(drift: Drift, sensitivity_mm2: Matrix, tolerance_mm: float) -> float | None:
    """Years after the last result until which the TCP error stays within the tolerance with 95 % probability,
    if the offsets as estimated at the last result are applied; 0 where it does not even then, None beyond
    the horizon of 20 years.

    The error is root mean square over the workspace, by `sensitivity_mm2` (m, m) of the offsets of the series
    (as `accuracy.sensitivity_mm2` of a result). Future jumps are not foreseen.
    """
    size = len(drift.series.names)
    points = qmc.Sobol(2 * size + 1, seed=0).random(_DRAWS)
    z = special.ndtri(np.clip(points[:, 1:], 1e-12, 1 - 1e-12))
    chosen = np.minimum(np.searchsorted(np.cumsum(drift.weights), points[:, 0]), len(drift.weights) - 1)
    mean = drift.smoothed.mean[:, -1]
    root = np.linalg.cholesky(drift.smoothed.covariance[:, -1])
    now = mean[chosen] - drift.weights @ mean + np.einsum("kij,kj->ki", root[chosen], z[:, :size])
    walk = drift.rates[chosen] * z[:, size:]

    def error_mm(years: float) -> float:
        apart = now + np.sqrt(years) * walk
        squared = np.einsum("ki,ij,kj->k", apart, sensitivity_mm2, apart)
        return float(np.quantile(np.sqrt(np.maximum(squared, 0.0)), COVERAGE))

    if error_mm(0.0) > tolerance_mm:
        return 0.0
    low, high = 0.0, HORIZON_YEARS
    if error_mm(high) <= tolerance_mm:
        return None
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if error_mm(middle) <= tolerance_mm else (low, middle)
    return low
