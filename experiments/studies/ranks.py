"""Simulation-based calibration (Talts et al. 2018): ranks of the truths among posterior draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ...model.likelihood.parameters import Parameter

DRAWS = 199  # of each posterior: central intervals of 50, 90, 95 and 99 % are then exact by ranks
BINS = 20
_POWER_RATIOS = (0.9, 0.8, 0.7)


@dataclass(frozen=True)
class RankedParameter:
    """How often the rank of the truth fell into each bin, and the chi-squared test for uniform ranks; the
    test is None where there are no ranks."""

    name: str
    unit: str
    ranks: tuple[int, ...]
    chi2: float | None
    p_value: float | None


@dataclass(frozen=True)
class Calibration:
    """The rank histograms of one sampler; `power` says which errors the test would detect."""

    name: str
    control: bool
    agrees: bool
    sentence: str
    parameters: tuple[RankedParameter, ...]
    power: str


def calibration(items: Sequence[Parameter], ranks: NDArray[np.int64], chance: float) -> Calibration:
    """The ranks (W, m) of the parameters `items` among DRAWS draws.

    It agrees if no p-value is below `chance` over the number of parameters (Bonferroni).
    """
    rows = []
    for j, item in enumerate(items):
        counts = np.bincount(ranks[:, j] * BINS // (DRAWS + 1), minlength=BINS)
        chi2, p = stats.chisquare(counts)
        rows.append(
            RankedParameter(item.name, item.unit, tuple(int(c) for c in counts), float(chi2), float(p))
        )
    least, alarm = min((float(row.p_value or 0.0) for row in rows), default=1.0), chance / max(len(rows), 1)
    return Calibration(
        name="posterior",
        control=False,
        agrees=least >= alarm,
        sentence=f"The ranks of the truth among the draws are {'' if least >= alarm else 'not '}uniform"
        f" (smallest p-value {least:.2g} of {len(rows)})",
        parameters=tuple(rows),
        power=power_sentence(len(ranks), alarm),
    )


def power(count: int, alarm: float, ratio: float) -> float:
    """Probability that the chi-squared test of `count` ranks detects stds that are `ratio` of the right
    ones."""
    edges = stats.norm.cdf(stats.norm.ppf(np.linspace(0, 1, BINS + 1)) * ratio)
    excess = float(count * BINS * ((np.diff(edges) - 1 / BINS) ** 2).sum())
    return float(stats.ncx2.sf(stats.chi2.isf(alarm, BINS - 1), BINS - 1, excess))


def power_sentence(count: int, alarm: float) -> str:
    return "stds too small by " + ", by ".join(
        f"{1 - ratio:.0%} would be detected with probability {power(count, alarm, ratio):.2f}"
        for ratio in _POWER_RATIOS
    )
