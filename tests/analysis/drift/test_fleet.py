"""Shrinkage between arms: closed forms, a grid, emcee on the whole model, coverage, and a wrong model."""

import math
from dataclasses import replace

import emcee
import numpy as np
import pytest
from drifting_arms import NAMES, walked, without
from scipy import stats
from scipy.special import ndtr

from zerobeam.analysis.drift import fleet
from zerobeam.analysis.drift.drift import MEDIAN, SPREAD, Drift, drift
from zerobeam.analysis.drift.fleet import LEAST, ModelRates, model_rates
from zerobeam.analysis.drift.importance import ENOUGH, Nodes
from zerobeam.analysis.drift.smoother import Series, smooth
from zerobeam.model.arrays import Matrix


def from_prior(random: np.random.Generator, arms: int, results: int) -> tuple[list[Series], Matrix, Matrix]:
    """The arms of a model, mu (2,) and the rates (arms, 2), from the prior that is stated."""
    rho = random.uniform(LEAST, 1.0, size=2)
    mu = math.log(MEDIAN) + SPREAD * np.sqrt(1 - rho) * random.normal(size=2)
    rates = np.exp(mu + SPREAD * np.sqrt(rho) * random.normal(size=(arms, 2)))
    return [walked(random, own, results) for own in rates], mu, rates


def model_of(drifts: list[Drift], number: int) -> fleet._Model:
    """All offsets of arms that have the same, by so many rates of each."""
    return fleet._Model(tuple(fleet._Arms.grouped(drifts, NAMES)), len(NAMES), number)


def test_one_arm_alone_has_the_answer_it_has_without_a_fleet() -> None:
    alone = drift(walked(np.random.default_rng(2), (0.03, 0.005), 10))
    (arm,) = model_rates([alone]).arms
    for name in NAMES:
        own, found = alone.rate(name), arm.rate(name)
        # Two samplings of one posterior: its std over the root of the effective numbers.
        chance = 4 * SPREAD / math.sqrt(min(arm.effective, alone.effective))
        assert abs(math.log(found[0] / own[0])) < chance
        assert np.abs(np.log(np.array(found[1]) / own[1])).max() < 2 * chance


def test_the_slope_and_the_curvature_are_those_of_differences(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of arms of which one has lost an offset: those of the integral, that many rates are close to."""
    random, many, step = np.random.default_rng(12), 2**14, 1e-3
    monkeypatch.setattr(fleet, "_AT_MODE", many)
    arms = [walked(random, own, 8) for own in ((0.05, 0.004), (0.02, 0.01), (0.08, 0.003))]
    model = model_of([drift(own) for own in (*arms[:2], without(arms[2], "delta2", range(8)))], many)
    at = np.array([0.7, -0.4, 0.3, -0.8])
    _, slope, curved = model.density(at)
    for k, d in enumerate(step * np.eye(4)):
        above, below = model.density(at + d), model.density(at - d)
        points = np.array([at + d, at - d])
        high, low = model.log_likelihood(points) - (points**2).sum(axis=1) / 2
        assert above[0] == pytest.approx(high, rel=1e-12)
        assert slope[k] == pytest.approx((high - low) / (2 * step), abs=2e-3)
        np.testing.assert_allclose(curved[k], (above[1] - below[1]) / (2 * step), atol=5e-3)


def test_the_mode_is_where_the_slope_is_zero_and_none_is_near_that_is_higher() -> None:
    random = np.random.default_rng(13)
    model = model_of([drift(walked(random, (0.05, 0.004), 8)) for _ in range(6)], 128)
    mode, root = model.mode()
    value, slope, _ = model.density(mode)
    std = np.sqrt(np.diag(root @ root.T)) / fleet._NEAR
    assert (np.abs(slope) * std < 0.1).all()  # of a standard deviation
    for along in (*np.diag(0.5 * std), *np.diag(-0.5 * std)):
        assert model.density(mode + along)[0] < value


def test_the_rates_of_an_arm_far_from_its_model_agree_with_both() -> None:
    """Of rates that are sampled without its model a single one agreed, and its interval had no width."""
    alone = drift(walked(np.random.default_rng(2), (3.0, 0.003), 20))
    mu, tau = np.log([[2.0, 0.004]]), np.full((1, 2), 0.4)
    (few,), (many,) = (model_of([alone], number).arms(mu, tau) for number in (64, 4096))
    assert few.effective > 0.4 * 64
    for name in NAMES:
        chance = 4 * 0.4 / math.sqrt(few.effective)
        assert abs(math.log(few.rate(name)[0] / many.rate(name)[0])) < chance
        low, high = few.rate(name)[1]
        assert high > 1.3 * low


def shaken(own: Series, random: np.random.Generator) -> Series:
    """The same with all values and covariances changed in their twelfth digit."""
    observations = tuple(
        replace(
            one,
            values=one.values * (1 + 1e-12 * random.normal(size=len(one.values))),
            covariance=one.covariance * (1 + 1e-12 * random.normal()),
        )
        for one in own.observations
    )
    return replace(own, observations=observations)


def test_no_number_depends_on_the_twelfth_digit_of_what_it_is_made_of() -> None:
    """Where the search for the mode ended at a loose tolerance single ends of intervals differed by 13 %."""
    random = np.random.default_rng(14)
    arms = [walked(random, own, 8) for own in ((0.05, 0.004), (0.02, 0.01), (0.08, 0.003), (0.03, 0.0))]

    def numbers(series: list[Series]) -> Matrix:
        drifts = [drift(own) for own in series]
        found = model_rates(drifts)
        of_model = [
            (*ends, middle) for name in NAMES for middle, ends in (found.median(name), found.between(name))
        ]
        rates = [(*one.rate(name)[1], one.rate(name)[0]) for name in NAMES for one in (*drifts, *found.arms)]
        states = [
            (*own.interval(-1, along), own.value(-1, along)[0]) for own in drifts for along in np.eye(2)
        ]
        return np.array([*of_model, *rates, *states])

    exact = numbers(arms)
    for _ in range(3):
        np.testing.assert_allclose(numbers([shaken(own, random) for own in arms]), exact, rtol=1e-6)


def on_a_grid(drifts: list[Drift]) -> tuple[float, float, float, list[float]]:
    """Of one offset: mean and std of mu, mean of tau, the means of the arms' log rates, on plain grids."""
    log_rates = np.linspace(math.log(MEDIAN) - 5 * SPREAD, math.log(MEDIAN) + 4 * SPREAD, 400)
    logs = [smooth(own.series, np.exp(log_rates)[:, None], own.allowed).log_likelihood for own in drifts]
    rho = LEAST + (1 - LEAST) * (np.arange(40) + 0.5) / 40
    mu = math.log(MEDIAN) + SPREAD * np.linspace(-4, 4, 161)
    prior = stats.norm(math.log(MEDIAN), SPREAD * np.sqrt(1 - rho)).logpdf(mu[:, None])
    given = stats.norm(mu[:, None, None], SPREAD * np.sqrt(rho)[:, None]).pdf(log_rates)
    each = [np.log(given @ np.exp(own - own.max())) for own in logs]
    weights = np.exp(prior + sum(each) - (prior + sum(each)).max())
    weights /= weights.sum()
    of_arms = []
    for own in logs:
        like = np.exp(own - own.max())
        of_arms.append(float((weights * ((given @ (like * log_rates)) / (given @ like))).sum()))
    middle = float((weights.sum(axis=1) * mu).sum())
    std = math.sqrt((weights.sum(axis=1) * (mu - middle) ** 2).sum())
    return middle, std, float((weights.sum(axis=0) * SPREAD * np.sqrt(rho)).sum()), of_arms


def test_one_offset_has_the_answer_of_a_grid() -> None:
    random = np.random.default_rng(4)
    drifts = [
        drift(without(walked(random, (rate, rate), results), "delta2", range(results)))
        for rate, results in ((0.05, 8), (0.08, 8), (0.02, 6), (0.06, 2))
    ]
    found = model_rates(drifts)
    mu, std, tau, of_arms = on_a_grid(drifts)
    assert found.weights @ found.mu[:, 0] == pytest.approx(mu, abs=4 * std / math.sqrt(ENOUGH))
    assert found.weights @ found.tau[:, 0] == pytest.approx(tau, abs=0.1)
    for arm, exact in zip(found.arms, of_arms, strict=True):
        assert arm.weights @ np.log(arm.rates[:, 0]) == pytest.approx(exact, abs=4 * 0.8 / math.sqrt(ENOUGH))


@pytest.mark.long
def test_an_arm_with_two_results_borrows_from_the_others() -> None:
    random = np.random.default_rng(6)
    many = [drift(walked(random, (0.1, 0.1), 10)) for _ in range(8)]
    few = drift(walked(random, (0.1, 0.1), 2))
    found = model_rates([*many, few])
    own, shrunk = few.rate("delta3")[1], found.arms[-1].rate("delta3")[1]
    assert shrunk[1] / shrunk[0] < 0.5 * own[1] / own[0]
    assert shrunk[0] < 0.1 < shrunk[1]
    assert min(arm.effective for arm in found.arms) > ENOUGH / 2
    assert found.beyond("delta3", 0.02) > 0.99
    assert found.beyond("delta3", 0.5) < 0.01


def test_an_offset_that_no_arm_determines_twice_is_not_modelled() -> None:
    random = np.random.default_rng(7)
    arms = [drift(without(walked(random, (0.02, 0.02), 6), "delta2", range(1, 6))) for _ in range(3)]
    found = model_rates(arms)
    assert found.names == ("delta3",)
    assert arms[0].series.names == NAMES
    ends = np.log(found.arms[0].rate("delta2")[1])  # the prior's, as without a fleet
    np.testing.assert_allclose(ends, math.log(MEDIAN) + SPREAD * np.array([-1.96, 1.96]), atol=0.6)
    assert model_rates([]).names == ()


def sampled_by_emcee(drifts: list[Drift], steps: int) -> Matrix:
    """(steps, 2 arms + 4) log rates, coordinates of mu and rho: the whole model at once."""
    arms, size = len(drifts), len(NAMES)

    def log_density(points: Matrix) -> Matrix:
        z, share = points[:, -2 * size : -size], points[:, -size:]
        rho = LEAST + (1 - LEAST) * ndtr(share)
        mu, tau = math.log(MEDIAN) + SPREAD * np.sqrt(1 - rho) * z, SPREAD * np.sqrt(rho)
        found = -0.5 * (z**2 + share**2).sum(axis=1)
        for a, own in enumerate(drifts):
            log_rate = points[:, a * size : (a + 1) * size]
            found = found + stats.norm(mu, tau).logpdf(log_rate).sum(axis=1)
            inside = np.exp(np.clip(log_rate, -25, 5))
            found += smooth(own.series, inside, own.allowed).log_likelihood
        return np.where((np.abs(points) < 25).all(axis=1), found, -np.inf)

    width = arms * size + 2 * size
    random = np.random.default_rng(0)
    start = 0.3 * random.normal(size=(6 * width, width))
    start[:, : arms * size] += math.log(MEDIAN)
    sampler = emcee.EnsembleSampler(len(start), width, log_density, vectorize=True)
    sampler._random.seed(1)
    sampler.run_mcmc(start, steps)
    return np.asarray(sampler.get_chain(discard=steps // 3, thin=10, flat=True))


@pytest.mark.long
def test_the_whole_model_has_the_answer_of_emcee() -> None:
    random = np.random.default_rng(11)
    rates = ((0.05, 0.005), (0.08, 0.01), (0.03, 0.004))
    drifts = [drift(walked(random, own, 8)) for own in rates]
    found, chain = model_rates(drifts), sampled_by_emcee(drifts, 9000)
    rho = LEAST + (1 - LEAST) * ndtr(chain[:, -2:])
    mu = math.log(MEDIAN) + SPREAD * np.sqrt(1 - rho) * chain[:, -4:-2]
    for j, name in enumerate(NAMES):
        _assert_close(np.array(found.median(name)[1]), np.exp(np.quantile(mu[:, j], (0.025, 0.975))))
        assert math.log(found.median(name)[0]) == pytest.approx(np.median(mu[:, j]), abs=0.12)
        for a, arm in enumerate(found.arms):
            own = chain[:, 2 * a + j]
            assert math.log(arm.rate(name)[0]) == pytest.approx(np.median(own), abs=0.12)
            _assert_close(np.array(arm.rate(name)[1]), np.exp(np.quantile(own, (0.025, 0.975))))


def _assert_close(found: Matrix, expected: Matrix) -> None:
    """Ends of intervals: of some hundred effective rates the tails are known to a third of SPREAD."""
    np.testing.assert_allclose(np.log(found), np.log(expected), atol=SPREAD / 3)


def all_alike(drifts: list[Drift], j: int) -> tuple[float, float]:
    """The wrong model: all rates of an offset are one. Its 95 % interval, others as by their prior."""
    grid = np.linspace(math.log(MEDIAN) - 5 * SPREAD, math.log(MEDIAN) + 4 * SPREAD, 200)
    total = stats.norm(math.log(MEDIAN), SPREAD).logpdf(grid)
    for own in drifts:
        points = np.log(own.rates)
        base = own.smoothed.log_likelihood + Nodes.of(points, own.passes).against
        for i in range(points.shape[1]):
            if i != j:
                base = base - 0.5 * ((points[:, i] - math.log(MEDIAN)) / SPREAD) ** 2
        kernel = base - 0.5 * ((points[:, j] - grid[:, None]) / 0.1) ** 2
        total = total + np.logaddexp.reduce(kernel, axis=1)
    share = np.cumsum(np.exp(total - total.max()))
    low, high = np.interp((0.025, 0.975), share / share[-1], grid)
    return math.exp(low), math.exp(high)


def coverage(fleets: int, arms: int, results: int) -> tuple[list[int], int, int]:
    """How many intervals hold: of the arms' rates, the models' medians, the wrong model's; how many
    models drift by a probability of 99 % though their median rate is below 0.01; out of how many."""
    held, wrong, false = [0, 0, 0], 0, 0
    for number in range(fleets):
        random = np.random.default_rng([21, number])
        series, mu, rates = from_prior(random, arms, results)
        drifts = [drift(own, seed=number) for own in series]
        found: ModelRates = model_rates(drifts, seed=number)
        a, j = int(random.integers(arms)), int(random.integers(2))
        low, high = found.arms[a].rate(NAMES[j])[1]
        held[0] += low <= rates[a, j] <= high
        low, high = found.median(NAMES[j])[1]
        held[1] += low <= math.exp(mu[j]) <= high
        low, high = all_alike(drifts, j)
        held[2] += low <= rates[a, j] <= high
        flagged = found.beyond(NAMES[j], MEDIAN) > 0.99
        wrong += flagged
        false += flagged and mu[j] < math.log(MEDIAN)
    return held, wrong, false


@pytest.mark.long
def test_intervals_of_some_models_hold() -> None:
    held, _, _ = coverage(4, 3, 6)
    assert held[0] + held[1] >= 5  # of 8: fewer with a chance of 4e-4


@pytest.mark.long
def test_intervals_of_models_from_the_prior_hold_and_those_of_equal_rates_do_not() -> None:
    fleets = 400
    held, flagged, false = coverage(fleets, 6, 8)
    for own in held[:2]:
        assert stats.binomtest(own, fleets, 0.95).pvalue > 0.001, held
    assert stats.binomtest(held[2], fleets, 0.95).pvalue < 1e-6, held
    assert flagged > fleets / 20
    assert stats.binomtest(false, fleets, 0.01, alternative="greater").pvalue > 0.001, false
