"""Arms as real ones are, by a simulator that shares no code with the model: what a header without `geometry`
promises of their offsets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
from cells import header, irb1600, varied_postures
from deviating_arms import Arms, Sizes
from scipy import stats

from zerobeam.analysis.estimation.threads import one_blas_thread
from zerobeam.analysis.ladder import solve_run
from zerobeam.model.likelihood.problem import Problem

TARGET = (900.0, 0.0, 0.0)
LEVEL = 1e-3  # of a test that is right


@dataclass(frozen=True, eq=False)
class Outcome:
    """Of arms: `misfit` (A,), errors of the offsets in their u (A, 5), nan where they have none."""

    misfit: np.ndarray
    z: np.ndarray

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.nanmean(self.z[~self.misfit] ** 2)))

    @property
    def coverage(self) -> float:
        z = self.z[~self.misfit]
        return float((np.abs(z[np.isfinite(z)]) < stats.norm.ppf(0.975)).mean())


@cache
def outcome(measurements: int, count: int, factor: float = 1.0, geometry: str | None = None) -> Outcome:
    """`count` arms that deviate by `factor` times the typical sizes, each measured that often and solved with
    that `geometry` in the header."""
    stated: dict[str, Any] = {"geometry": geometry}
    own = header(target=TARGET, **stated)
    rng = np.random.default_rng(2014)
    postures = varied_postures(header(target=TARGET), irb1600(), TARGET, measurements, seed=7)
    arms = Arms.at_random(count, rng, Sizes().times(factor))
    joints, hit = arms.recorded(postures, np.array(TARGET), rng)
    misfit, z = np.zeros(count, dtype=bool), np.full((count, 5), np.nan)
    with one_blas_thread():
        for k in range(count):
            seen = joints[k][hit[k]]
            solution = solve_run(Problem.build(own, irb1600(), seen, ["psd"] * len(seen)), own)
            misfit[k] = solution.misfit is not None
            z[k] = (solution.fit.x - _with(arms.offsets[k], len(solution.fit.x)))[1:6] / solution.std[1:6]
    return Outcome(misfit, z)


def _with(offsets: np.ndarray, size: int) -> np.ndarray:
    return np.pad(offsets, (0, size - len(offsets)))


def _largest_rms(count: int) -> float:
    """Of z over so many arms, whose offsets may be correlated altogether, at three standard deviations."""
    return float(np.sqrt(1 + 3 * np.sqrt(2 / count)))


def test_without_the_key_intervals_hold_for_arms_as_they_are() -> None:
    typical = outcome(12, 24)
    assert typical.rms < _largest_rms(24)
    assert stats.binomtest(int(typical.misfit.sum()), 24, 0.05, alternative="greater").pvalue > LEVEL


def test_exact_geometry_is_refuted_by_the_same_arms() -> None:
    assert outcome(12, 24, geometry="exact").misfit.mean() > 0.9


def test_arms_that_deviate_three_times_as_much_are_noticed() -> None:
    assert outcome(12, 12, 3.0).misfit.mean() > 0.9


@pytest.mark.long
@pytest.mark.parametrize("measurements", [7, 12, 30])
def test_four_hundred_arms(measurements: int) -> None:
    typical = outcome(measurements, 400)
    assert 0.93 < typical.coverage < 0.97
    assert typical.rms < _largest_rms(400)
    assert typical.misfit.mean() < 0.05


@pytest.mark.long
@pytest.mark.parametrize(("measurements", "most"), [(7, 0.35), (12, 0.05), (30, 0.0)])
def test_a_hundred_arms_three_times_as_far_off_seldom_pass(measurements: int, most: float) -> None:
    """Seven measurements leave six degrees of freedom: too few to notice every one."""
    assert 1 - outcome(measurements, 100, 3.0).misfit.mean() <= most
