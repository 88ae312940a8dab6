"""Residuals that are smaller than the stated noise: said where the noise is overstated, and not where an arm
is better than its tolerances."""

import dataclasses

import numpy as np
import pytest
from cells import good_plan, run_of, simulated
from scipy import stats

from zerobeam.analysis.estimation.fit import LikelihoodFit, as_small, fit_likelihood
from zerobeam.analysis.status import LACK_OF_FIT
from zerobeam.experiments.simulate import Truth
from zerobeam.model.likelihood.problem import Problem


def fitted(seed: int, share: float, overstated: float = 1.0, shots: int = 20) -> LikelihoodFit:
    """A run of an arm that deviates by this share of its tolerances, by a header that states so many times
    the noise."""
    plan = good_plan(shots, seed=5, geometry=None)
    drawn = share * np.random.default_rng(1000 + seed).normal(size=100)
    items = Truth.with_values(plan, {}).problem.parameters.items
    values = {
        item.name: float(value) * item.prior_std * item.display
        for item, value in zip(items, drawn, strict=False)
        if item.tolerated
    }
    _, run = simulated(plan, values, seed)
    stated = good_plan(shots, seed=5, geometry=None, joint_deg=0.01 * overstated, spot_mm=0.05 * overstated)
    return fit_likelihood(Problem.from_run(run_of(stated.header, run.shots)), starts=0)


def p_values(runs: int, share: float, overstated: float = 1.0) -> np.ndarray:
    found = [as_small(fitted(seed, share, overstated)) for seed in range(runs)]
    assert None not in found
    return np.array(found)


def most(runs: int, level: float) -> float:
    """What is exceeded once in ten thousand tests of so many runs."""
    return float(stats.binom.ppf(1 - 1e-4, runs, level))


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_an_arm_that_is_better_than_its_tolerances_is_no_sign_of_too_much_noise(share: float) -> None:
    """By the tolerances as if arms were as bad, 7 of 8 such runs were said to have too much noise stated."""
    p = p_values(6, share)
    assert (p < LACK_OF_FIT).sum() <= most(6, LACK_OF_FIT)
    assert (p < 0.1).sum() <= most(6, 0.1)


def test_noise_that_is_overstated_by_three_is_said() -> None:
    """Negative control."""
    assert (p_values(4, 0.5, overstated=3.0) < LACK_OF_FIT).all()


@pytest.mark.long
@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 1.0])
def test_the_false_alarms_of_many_arms(share: float) -> None:
    p = p_values(200, share)
    assert (p < LACK_OF_FIT).sum() <= most(200, LACK_OF_FIT)
    assert (p < 0.1).sum() <= most(200, 0.1)


@pytest.mark.long
def test_an_arm_without_deviation_has_the_level_that_is_stated() -> None:
    """The bound is reached: the test is as sharp as it can be for all arms."""
    p = p_values(200, 0.0)
    assert (p < 0.1).sum() >= stats.binom.ppf(1e-4, 200, 0.1)


@pytest.mark.long
def test_overstated_noise_of_many_arms() -> None:
    assert (p_values(40, 0.5, overstated=3.0) < LACK_OF_FIT).mean() > 0.9


def test_estimated_noise_is_not_judged() -> None:
    fit = fitted(0, 0.5)
    noise = dataclasses.replace(fit.problem.noise, estimated=True)
    estimated = dataclasses.replace(fit, problem=dataclasses.replace(fit.problem, noise=noise))
    assert as_small(estimated) is None
