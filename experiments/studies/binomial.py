"""What many runs of one plan came to, next to what was predicted: errors, and shares of intervals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import special, stats

from ...model.arrays import Matrix
from .answer import Share


class Accuracy(NamedTuple):
    """Bias with its Monte Carlo standard error, rmse and predicted standard uncertainty, or None for each."""

    bias: float | None = None
    bias_mcse: float | None = None
    rmse: float | None = None
    predicted_std: float | None = None


def accuracy(error: Matrix, std: Matrix) -> Accuracy:
    """Of R estimates of one parameter: `error` (R,) is estimate minus truth, `std` (R,) the standard
    uncertainty stated with each; without any number where there are fewer than two."""
    if len(error) < 2:
        return Accuracy()
    return Accuracy(
        bias=float(error.mean()),
        bias_mcse=float(error.std(ddof=1) / np.sqrt(len(error))),
        rmse=float(np.sqrt((error**2).mean())),
        predicted_std=float(np.sqrt((std**2).mean())),
    )


def held_share(held: int, of: int, level: float, alarm: float) -> Share:
    """The share of intervals of `level` that hold the truth.

    It agrees unless the p-value of the exact binomial test is below `alarm`.
    """
    agrees = bool(stats.binomtest(held, of, level).pvalue >= alarm)
    return Share(level, held, of, held / of, *share_interval(held, of), agrees)


def share_interval(held: int, of: int) -> tuple[float, float]:
    """The exact 95 % interval of a share (Clopper and Pearson 1934), by quantiles of beta distributions."""
    low = special.betaincinv(held, of - held + 1, 0.025) if held > 0 else 0.0
    high = special.betaincinv(held + 1, of - held, 0.975) if held < of else 1.0
    return float(low), float(high)
