"""Shrinkage between arms: closed forms, a grid, emcee on the whole model, coverage, and a wrong model."""

from __future__ import annotations

import math

import emcee
import numpy as np
import pytest
from drifting_arms import NAMES, walked, without
from scipy import stats
from scipy.special import ndtr

from zerobeam.analysis.drift import fleet
from zerobeam.analysis.drift.drift import MEDIAN, SPREAD, Drift, drift
from zerobeam.analysis.drift.fleet import ENOUGH, LEAST, ModelRates, model_rates
from zerobeam.analysis.drift.importance import Nodes
from zerobeam.analysis.drift.smoother import Series, smooth
from zerobeam.model.arrays import Matrix


def from_prior(random: np.random.Generator, arms: int, results: int) -> tuple[list[Series], Matrix, Matrix]:
    """The arms of a model, mu (2,) and the rates (arms, 2), from the prior that is stated."""
    rho = random.uniform(LEAST, 1.0, size=2)
    mu = math.log(MEDIAN) + SPREAD * np.sqrt(1 - rho) * random.normal(size=2)
    rates = np.exp(mu + SPREAD * np.sqrt(rho) * random.normal(size=(arms, 2)))
    return [walked(random, own, results) for own in rates], mu, rates


def normal_likelihood(centres: Matrix, std: float) -> list[fleet._Cloud]:
    """Arms with one offset whose likelihood is normal in the logarithm of the rate."""
    random, found = np.random.default_rng(8), []
    for centre in centres:
        passes = [(np.array([math.log(MEDIAN)]), np.array([[SPREAD]])), (np.array([centre]), np.eye(1))]
        points = np.concatenate([c + random.normal(size=(4000, 1)) @ root for c, root in passes])
        log_likelihood = stats.norm(centre, std).logpdf(points[:, 0])
        series, none = without(walked(random, (0.01, 0.01), 3), NAMES[1], range(3)), np.zeros((2, 1))
        found.append(fleet._Cloud(series, none, Nodes.of(points, passes), log_likelihood, np.array([0])))
    return found


def test_more_rates_are_sampled_about_the_product_of_likelihood_and_model() -> None:
    (cloud,) = normal_likelihood(np.array([-6.0]), 0.8)
    cloud.extend(np.array([-3.0]), np.array([0.5]), 0)
    (mean,), ((root,),) = cloud.nodes.passes[-1]
    precision = 1 / 0.8**2 + 1 / 0.5**2
    assert mean == pytest.approx((-6.0 / 0.8**2 - 3.0 / 0.5**2) / precision, abs=0.1)
    assert root == pytest.approx(1.3 / math.sqrt(precision), rel=0.1)
    assert len(cloud.nodes.points) == len(cloud.log_likelihood) == 8000 + 256


def test_one_arm_alone_has_the_answer_it_has_without_a_fleet() -> None:
    alone = drift(walked(np.random.default_rng(2), (0.03, 0.005), 10))
    (arm,) = model_rates([alone]).arms
    for name in NAMES:
        own, found = alone.rate(name), arm.rate(name)
        # Two samplings of one posterior: its std over the root of the effective numbers.
        chance = 4 * SPREAD / math.sqrt(min(arm.effective, alone.effective))
        assert abs(math.log(found[0] / own[0])) < chance
        assert np.abs(np.log(np.array(found[1]) / own[1])).max() < 2 * chance


def test_normal_likelihoods_given_mu_and_tau_have_the_closed_form() -> None:
    centres, std = np.array([-6.0, -4.0, -3.0]), 0.8
    mu, tau = np.array([[-4.5], [-3.0]]), np.array([[0.5], [1.0]])
    clouds = normal_likelihood(centres, std)
    stack = fleet._Stack.of(clouds, 1)
    found = stack.log_likelihood(mu, tau)
    exact = stats.norm(mu, np.sqrt(tau**2 + std**2)).logpdf(centres).sum(axis=1)
    assert found[0] - found[1] == pytest.approx(exact[0] - exact[1], abs=0.1)
    for k, (own, centre) in enumerate(zip(clouds, centres, strict=True)):
        weights = stack.weights(k, mu[:1], tau[:1])[:, 0]
        mean = weights @ own.nodes.points[own.kept, 0]
        shrunk = (centre / std**2 + mu[0, 0] / tau[0, 0] ** 2) / (1 / std**2 + 1 / tau[0, 0] ** 2)
        assert mean == pytest.approx(shrunk, abs=0.05)


def test_the_slope_of_the_density_is_that_of_differences() -> None:
    stack, at, step = (
        fleet._Stack.of(normal_likelihood(np.array([-6.0, -4.0]), 0.8), 1),
        np.array([0.7, -0.4]),
        1e-5,
    )
    _, slope = stack.density(at)
    for k, d in enumerate(step * np.eye(2)):
        difference = (stack.density(at + d)[0] - stack.density(at - d)[0]) / (2 * step)
        assert slope[k] == pytest.approx(difference, rel=1e-5)


def test_rates_are_added_until_enough_agree_with_the_model() -> None:
    """Of an arm far from its model a single rate agreed, and its interval had no width."""
    alone = drift(walked(np.random.default_rng(2), (3.0, 0.003), 20))
    mu, tau = np.log([[2.0, 0.004]]), np.full((1, 2), 0.4)
    whole, few = fleet._arm(fleet._cloud(alone, NAMES), mu, tau, 0), fleet._cloud(alone, NAMES)
    few.nodes = Nodes.of(few.nodes.points[:256], few.nodes.passes[:1])
    few.log_likelihood = few.log_likelihood[:256]
    before = 1 / (fleet._Stack.of([few], 2).weights(0, mu, tau) ** 2).sum()
    found = fleet._arm(few, mu, tau, 0)
    assert before < 2 < fleet.FEW <= found.effective
    for name in NAMES:
        chance = 4 * 0.4 / math.sqrt(found.effective)
        assert abs(math.log(found.rate(name)[0] / whole.rate(name)[0])) < chance
        low, high = found.rate(name)[1]
        assert high > 1.3 * low


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


def test_two_offsets_whose_rates_are_correlated_are_sampled_about_their_product() -> None:
    """Of a correlated normal likelihood and N(mu, tau²): mean and covariance of the product."""
    random = np.random.default_rng(9)
    centre, covariance = np.array([-6.0, -3.5]), np.array([[0.5, 0.3], [0.3, 0.4]])
    prior = (np.full(2, math.log(MEDIAN)), SPREAD * np.eye(2))
    passes = [prior, (centre, 1.2 * np.linalg.cholesky(covariance))]
    points = np.concatenate([c + random.normal(size=(4000, 2)) @ root.T for c, root in passes])
    log_likelihood = stats.multivariate_normal(centre, covariance).logpdf(points)
    series, none = walked(random, (0.01, 0.01), 3), np.zeros((2, 2))
    cloud = fleet._Cloud(series, none, Nodes.of(points, passes), log_likelihood, np.array([0, 1]))
    mu, tau = np.array([-3.0, -4.0]), np.array([0.5, 0.8])
    cloud.extend(mu, tau, 0)
    mean, root = cloud.nodes.passes[-1]
    precision = np.linalg.inv(covariance) + np.diag(tau**-2)
    exact = np.linalg.inv(precision)
    expected = exact @ (np.linalg.solve(covariance, centre) + mu / tau**2)
    np.testing.assert_allclose(mean, expected, atol=0.1)
    np.testing.assert_allclose(root @ root.T / fleet._WIDER**2, exact, atol=0.03)
