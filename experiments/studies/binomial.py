"""What many runs of one plan came to, next to what was promised: errors, and shares of intervals."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import stats

from ...model.robot import Matrix


def accuracy(error: Matrix, std: Matrix) -> dict[str, float | None]:
    """Bias with its Monte Carlo standard error, rmse and predicted std of R estimates of one parameter.

    `error` (R,) is estimate minus truth, `std` (R,) what was said of each; None where fewer than two say
    anything.
    """
    if len(error) < 2:
        return nothing_known()
    return {
        "bias": float(error.mean()),
        "bias_mcse": float(error.std(ddof=1) / np.sqrt(len(error))),
        "rmse": float(np.sqrt((error**2).mean())),
        "predicted_std": float(np.sqrt((std**2).mean())),
    }


def nothing_known() -> dict[str, float | None]:
    """The same where nothing is to be said."""
    return dict.fromkeys(("bias", "bias_mcse", "rmse", "predicted_std"))


def held_share(held: int, of: int, level: float, alarm: float) -> dict[str, Any]:
    """How often intervals of `level` held the truth: the share, with its 95 % interval (Clopper and Pearson).

    It agrees unless a share so far off has a chance below `alarm` (exact binomial test).
    """
    test = stats.binomtest(held, of, level)
    interval = test.proportion_ci(0.95)
    return {
        "level": level,
        "held": held,
        "of": of,
        "share": held / of,
        "low": float(interval.low),
        "high": float(interval.high),
        "agrees": bool(test.pvalue >= alarm),
    }
