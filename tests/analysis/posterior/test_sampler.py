import emcee
import numpy as np
import pytest
from arviz_stats.base import array_stats
from scipy import stats

from zerobeam.analysis.posterior import sampler
from zerobeam.analysis.posterior.sampler import (
    DifferentialMove,
    IndependenceMove,
    IndependenceProposal,
    degrees_of_freedom,
    diagnostics,
    drift,
    sample_density,
)


def t_at_zero(size, nu=6.0, scale=1.0):
    return IndependenceProposal(np.zeros(size), scale * np.eye(size), nu)


def normal(w):
    return -(w**2).sum(axis=1) / 2


def test_the_proposal_is_a_multivariate_t():
    rng = np.random.default_rng(1)
    location = np.array([1.0, -2.0, 0.5])
    factor = np.array([[2.0, 0, 0], [0.5, 1.0, 0], [-0.3, 0.2, 0.7]])
    proposal = IndependenceProposal(location, factor, 7.0)
    points = rng.normal(size=(5, 3)) * 3
    exact = stats.multivariate_t(location, factor @ factor.T, df=7).logpdf(points)
    values = proposal.log_density(points)
    np.testing.assert_allclose(values - values[0], exact - exact[0], atol=1e-12)
    # The whitened squared radius over the dimension is F(3, 7): 20 000 draws by Kolmogorov and Smirnov.
    drawn = proposal.draw(20_000, rng)
    inner = np.linalg.solve(factor, (drawn - location).T)
    assert stats.kstest((inner**2).sum(axis=0) / 3, stats.f(3, 7).cdf).pvalue > 1e-4


def test_a_walk_that_is_stopped_prints_nothing(capfd):
    points, calls = np.random.default_rng(1).normal(size=(8, 2)), 0

    def stopped(w):
        nonlocal calls
        calls += 1
        if calls > 3:
            raise KeyboardInterrupt
        return normal(w)

    moves = sampler.Moves(t_at_zero(2), np.random.default_rng(2), 0.5)
    with pytest.raises(KeyboardInterrupt):
        moves.advance(stopped, points, 20)
    assert capfd.readouterr() == ("", "")


class WrongSign(IndependenceMove):
    def factors(self, here, there):
        return -super().factors(here, there)


class NoFactors(IndependenceMove):
    def factors(self, here, there):
        return np.zeros_like(here)


class LopsidedDifference(DifferentialMove):
    """Not symmetric: every step goes to the right."""

    def settle(self, state, chosen, points, log_density, factors):
        there = state.coords[chosen]
        right = there + np.abs(points - there)
        return super().settle(state, chosen, right, normal(right), factors)


def variance_by(move, steps=800, walkers=32):
    """Variance of a unit normal as sampled by one move alone, and its standard error."""
    emcee_sampler = emcee.EnsembleSampler(walkers, 1, normal, moves=[move], vectorize=True)
    start = emcee.State(np.random.default_rng(3).normal(size=(walkers, 1)))
    emcee_sampler.run_mcmc(start, steps, skip_initial_state_check=True)
    chains = emcee_sampler.get_chain(discard=50)[:, :, 0].T
    ess = float(array_stats.ess(chains**2, method="mean"))
    return float((chains**2).mean()), np.sqrt(2 / ess)


@pytest.mark.long
def test_the_sign_of_the_factors():
    """field.md: right 0.997, wrong sign 0.52, without factors 0.685 (at its own nu); bounds from the ESS."""
    for ahead in (1, 300):
        right, error = variance_by(IndependenceMove(t_at_zero(1), np.random.default_rng(1), ahead))
        assert abs(right - 1) < 4 * error
        assert error < 0.03
    for control in (WrongSign, NoFactors):
        wrong, error = variance_by(control(t_at_zero(1), np.random.default_rng(1)))
        assert abs(wrong - 1) > 10 * error


def test_differential_evolution_leaves_the_density_as_it_is():
    right, error = variance_by(DifferentialMove(np.random.default_rng(1)))
    assert abs(right - 1) < 4 * error
    assert error < 0.06
    wrong, _ = variance_by(LopsidedDifference(np.random.default_rng(1)))
    assert abs(wrong - 1) > 0.5


def test_a_pair_never_is_one_walker_twice():
    """Else a step of nothing would be accepted for certain: in a flat density every walker moves."""
    move = DifferentialMove(np.random.default_rng(1))
    flat = emcee.EnsembleSampler(6, 1, lambda w: np.zeros(len(w)), moves=[move], vectorize=True)
    flat.run_mcmc(emcee.State(np.arange(6.0)[:, None]), 200, skip_initial_state_check=True)
    assert np.abs(np.diff(flat.get_chain()[:, :, 0], axis=0)).min() > 1e-6


def test_tails_are_lighter_in_many_dimensions():
    assert degrees_of_freedom(3) == 6.0
    assert degrees_of_freedom(12) == 24.0


def agrees(sampled, means, quantiles, k=4.5):
    """Expectations and quantiles within k MCSE: `means` (function, value), `quantiles` (j, p, value)."""
    chains = sampled.values.reshape(-1, *sampled.values.shape[2:])
    for function, value in means:
        values = function(chains)
        error = float(array_stats.mcse(values, method="mean"))
        assert abs(values.mean() - value) < k * error, (values.mean(), value, error)
    for j, p, value in quantiles:
        below = (chains[..., j] <= value).astype(float)
        error = np.sqrt(p * (1 - p) / float(array_stats.ess(below, method="mean")))
        assert abs(below.mean() - p) < k * error, (j, p, below.mean(), error)


def coordinate(j, power=1, centre=0.0):
    return lambda chains: (chains[..., j] - centre) ** power


def normal_quantiles(j, mean=0.0, std=1.0):
    return [(j, p, stats.norm(mean, std).ppf(p)) for p in (0.025, 0.25, 0.5, 0.75, 0.975)]


def passes(sampled, ess):
    assert sampled.settled
    assert sampled.rhat.max() <= 1.01
    assert sampled.ess_bulk.min() >= ess


def test_a_badly_scaled_correlated_normal():
    """Condition 1e6, from a proposal that is three times too wide one way, too narrow another."""
    rng = np.random.default_rng(1)
    axes = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    stds = np.geomspace(1e-3, 1, 6)
    mean = rng.normal(size=6)
    factor = axes * stds
    inverse = np.linalg.inv(factor)
    false = factor * np.array([3, 1 / 3, 3, 1 / 3, 3, 1 / 3])
    wrong = IndependenceProposal(mean, np.linalg.cholesky(false @ false.T), 6.0)
    sampled = sample_density(lambda w: normal((w - mean) @ inverse.T), wrong, seed=1, ess=4000)
    passes(sampled, 4000)
    covariance = factor @ factor.T
    for j in range(6):
        std = np.sqrt(covariance[j, j])
        means = [(coordinate(j), mean[j]), (coordinate(j, 2, mean[j]), std**2)]
        agrees(sampled, means, normal_quantiles(j, mean[j], std))
    # Along the axes themselves, the narrow ones among them: an std from n effective draws, 1 / sqrt(2 n).
    along = ((sampled.values - mean) @ inverse.T).reshape(-1, 6)
    assert np.abs(along.std(axis=0) - 1).max() < 4.5 / np.sqrt(2 * 2000)


def test_a_t_with_heavy_tails():
    """nu = 3, heavier than the proposal's 6: its far tails are reached by differential evolution."""

    def log_density(w):
        return -(3 + 2) / 2 * np.log1p((w**2).sum(axis=1) / 3)

    sampled = sample_density(log_density, t_at_zero(2), seed=3, ess=4000)
    passes(sampled, 4000)
    exact = stats.t(3)
    agrees(
        sampled,
        [(coordinate(0), 0.0)],
        [(j, p, exact.ppf(p)) for j in (0, 1) for p in (0.01, 0.1, 0.5, 0.9, 0.99)],
    )


def test_a_mild_funnel():
    """v ~ N(0, 1), x ~ N(0, exp(v / 2)): x has the quantiles of a mixture."""

    def log_density(w):
        return -(w[:, 0] ** 2) / 2 - w[:, 1] ** 2 / 2 * np.exp(-w[:, 0]) - w[:, 0] / 2

    nodes, weights = np.polynomial.hermite_e.hermegauss(60)
    value = 2.0
    p = float(weights @ stats.norm.cdf(value * np.exp(-nodes / 2)) / weights.sum())
    sampled = sample_density(log_density, t_at_zero(2), seed=4, ess=4000)
    passes(sampled, 4000)
    means = [(coordinate(0), 0.0), (coordinate(0, 2), 1.0), (coordinate(1), 0.0)]
    agrees(sampled, means, [*normal_quantiles(0), (1, p, value), (1, 1 - p, -value)])


def test_a_hard_edge():
    """-inf outside: a half normal next to a whole one."""

    def log_density(w):
        return np.where(w[:, 0] > 0, normal(w), -np.inf)

    inside = IndependenceProposal(np.ones(2), np.eye(2), 6.0)
    sampled = sample_density(log_density, inside, seed=4, ess=4000)
    passes(sampled, 4000)
    assert sampled.values[..., 0].min() > 0
    half = stats.halfnorm()
    means = [(coordinate(0), half.mean()), (coordinate(0, 2), 1.0)]
    agrees(sampled, means, [(0, p, half.ppf(p)) for p in (0.01, 0.25, 0.5, 0.975)] + normal_quantiles(1))


def test_a_flat_direction_next_to_narrow_ones():
    """Uniform on (-1, 1), the others 1e-4 wide."""

    def log_density(w):
        return np.where(np.abs(w[:, 0]) < 1, normal(w[:, 1:] * 1e4), -np.inf)

    proposal = IndependenceProposal(np.zeros(3), np.diag([0.6, 1e-4, 1e-4]), 6.0)
    sampled = sample_density(log_density, proposal, seed=5, ess=4000)
    passes(sampled, 4000)
    uniform = [(0, p, 2 * p - 1) for p in (0.01, 0.25, 0.5, 0.75, 0.99)]
    agrees(sampled, [(coordinate(0, 2), 1 / 3)], uniform + normal_quantiles(1, 0, 1e-4))


def two_modes(apart):
    return lambda w: np.logaddexp(
        -((w[:, 0] - apart) ** 2) / 2 + np.log(0.3), -((w[:, 0] + apart) ** 2) / 2 + np.log(0.7)
    )


def test_two_modes_within_reach():
    """0.3 N(5, 1) + 0.7 N(-5, 1) under a proposal that covers both."""
    sampled = sample_density(two_modes(5.0), t_at_zero(1, scale=5.0), seed=6, ess=4000)
    passes(sampled, 4000)
    agrees(sampled, [(coordinate(0), -2.0), (coordinate(0, 2), 26.0)], [(0, 0.7, 0.0), (0, 0.35, -5.0)])


class OneEnsembleElsewhere(IndependenceProposal):
    """The first ensemble of each step is proposed the other mode."""

    def draw(self, count, random):
        walkers = sampler._WALKERS[0]
        first = np.arange(count) % (sampler.ENSEMBLES * walkers) < walkers
        return super().draw(count, random) + 2e5 * first[:, None]


def test_two_modes_out_of_reach_do_not_pass(monkeypatch):
    """Each ensemble stays in the mode where it began, 200 000 stds from the other."""
    monkeypatch.setattr(sampler, "BUDGET", 100_000)
    monkeypatch.setattr(sampler, "_PER_ESS", 0)
    proposal = OneEnsembleElsewhere(np.array([-1e5]), np.eye(1), 6.0)
    sampled = sample_density(two_modes(1e5), proposal, seed=1, ess=400)
    assert {bool(right) for right in np.unique(sampled.values > 0)} == {True, False}
    assert not sampled.settled
    assert sampled.rhat.max() > 1.5


@pytest.mark.long
def test_walkers_that_hardly_move_do_not_pass(monkeypatch):
    """Spikes everywhere, and no way from one to the next."""
    monkeypatch.setattr(sampler, "BUDGET", 100_000)
    monkeypatch.setattr(sampler, "_PER_ESS", 0)
    sampled = sample_density(lambda w: 1e6 * np.sin(1e7 * w).sum(axis=1), t_at_zero(2), seed=1, ess=1000)
    assert sampled.acceptance < 0.05
    assert not sampled.settled


@pytest.mark.parametrize("nothing", [-np.inf, np.nan, np.inf])
def test_a_density_that_is_nowhere_possible_is_a_state(nothing):
    sampled = sample_density(lambda w: np.full(len(w), nothing), t_at_zero(2), seed=1, ess=400)
    assert not sampled.settled
    assert np.isinf(sampled.rhat).all()
    assert sampled.ess_bulk.max() == 0
    assert np.isfinite(sampled.values).all()


@pytest.mark.parametrize("nothing", [np.nan, np.inf])
def test_what_is_no_number_is_impossible(nothing):
    """The same draws as with -inf there, to the last bit."""
    first, second = (
        sample_density(lambda w, o=o: np.where(w[:, 0] > 0, normal(w), o), t_at_zero(1), seed=4, ess=400)
        for o in (-np.inf, nothing)
    )
    assert first.settled
    np.testing.assert_array_equal(first.values, second.values)


def test_the_same_seed_gives_the_same_draws_on_any_number_of_threads():
    first, second, third, other = (
        sample_density(normal, t_at_zero(2), seed=s, ess=3000, threads=n)
        for s, n in ((7, 1), (7, 1), (7, 3), (8, 1))
    )
    np.testing.assert_array_equal(first.values, second.values)
    np.testing.assert_array_equal(first.values, third.values)
    assert not np.array_equal(first.values[:, :, :5], other.values[:, :, :5])
    # The ensembles of one run are different, too.
    assert not np.array_equal(first.values[0], first.values[1])


def test_more_is_drawn_where_more_is_asked():
    shares = []
    few = sample_density(normal, t_at_zero(2), seed=1, ess=400)
    many = sample_density(normal, t_at_zero(2), seed=1, ess=8000, progress=shares.append)
    assert many.values[..., 0].size > few.values[..., 0].size
    assert many.ess_bulk.min() >= 8000
    assert shares == sorted(shares)
    assert 0 < shares[-1] <= 1


@pytest.mark.long
def test_a_run_that_goes_on_with_many_walkers_has_not_nearly_ended(monkeypatch):
    """What the run with few has told leaves room for the larger part of the work, which has advances."""
    monkeypatch.setattr(sampler, "_FEW_STEPS", 60)
    monkeypatch.setattr(sampler, "_WALKERS", (32, 32))  # too few for so many draws
    shares, many_from = [], []
    real = sampler._Run.spread

    def noted(run, values, walkers):
        many_from.append(len(shares))
        return real(run, values, walkers)

    monkeypatch.setattr(sampler._Run, "spread", noted)
    sampled = sample_density(normal, t_at_zero(2), seed=1, ess=20_000, progress=shares.append)
    assert sampled.enough
    first = many_from[0]
    assert max(shares[:first]) <= 0.2
    assert len(set(shares[first:])) >= 3
    assert shares == sorted(shares)
    assert shares[-1] <= 0.99


def test_draws_that_another_method_contradicts_are_continued_and_do_not_pass(monkeypatch):
    monkeypatch.setattr(sampler, "BUDGET", 100_000)
    monkeypatch.setattr(sampler, "_PER_ESS", 0)
    asked = []

    def agrees(judged, proposed):
        asked.append((judged.shape, proposed))
        return False

    sampled = sample_density(normal, t_at_zero(2), seed=1, ess=400, agrees=agrees)
    assert sampled.settled
    assert not sampled.done
    (few, _), (many, proposed) = asked
    assert many[1] > few[1]
    assert np.allclose(
        proposed.log_weights[:9],
        normal(proposed.points[:9]) - proposed.proposal.log_density(proposed.points[:9]),
    )
    assert sample_density(normal, t_at_zero(2), seed=1, ess=400).done


def test_a_density_unlike_the_proposal_is_given_up_at_the_first_look():
    """A ring a thousandth thick in twenty dimensions: no budget would do."""
    rows = []

    def log_density(w):
        rows.append(len(w))
        return -((np.linalg.norm(w, axis=1) - 4.5) ** 2) / 2e-6

    sampled = sample_density(log_density, t_at_zero(20), seed=1, ess=1000)
    assert not sampled.done
    assert sum(rows) < 60_000


@pytest.mark.long
def test_the_budget_is_kept(monkeypatch):
    """Evaluations are counted, and end."""
    monkeypatch.setattr(sampler, "BUDGET", 600_000)
    monkeypatch.setattr(sampler, "_PER_ESS", 0)
    rows = []

    def log_density(w):
        rows.append(len(w))
        return normal(w)

    monkeypatch.setattr(sampler, "_WALKERS", (32, 64))
    sampled = sample_density(log_density, t_at_zero(2), seed=1, ess=1e9)
    assert sampled.ess_bulk.min() < 1e9
    assert sampled.evaluations == pytest.approx(sum(rows), rel=0.1)
    assert sum(rows) < 600_000 + 4 * 512 * 400  # the burn-in's rounds and one look are always granted


@pytest.mark.long
@pytest.mark.parametrize(("size", "seeds", "nu"), [(8, 200, 8.0), (45, 60, 90.0)])
def test_the_effective_size_is_honest(size, seeds, nu):
    """The variance of means and of squares over the seeds is what the ESS says, within 4 of their errors."""
    found = [sample_density(normal, t_at_zero(size, nu), seed=s, ess=1000) for s in range(seeds)]
    for power, variance in ((1, 1.0), (2, 2.0)):
        means = np.array([(f.values**power).mean(axis=(0, 1, 2)) for f in found]) - (power == 2)
        chains = [f.values[..., j].reshape(-1, f.values.shape[2]) for f in found[:20] for j in range(size)]
        told = np.mean([float(array_stats.ess(own**power, method="mean")) for own in chains])
        # Coordinates are nearly independent: the mean of size * seeds squares.
        ratio = (means**2).mean() / (variance / told)
        assert abs(ratio - 1) < 4 * np.sqrt(2 / (size * seeds)) + 0.05, (power, ratio)


def test_diagnostics_of_independent_draws():
    values = np.random.default_rng(1).normal(size=(4, 32, 50, 2))
    rhat, bulk = diagnostics(values)
    assert rhat.max() < 1.01
    assert bulk.min() > 0.8 * 4 * 32 * 50


def test_ensembles_that_disagree_are_caught():
    """One ensemble sits half a std aside: each walker mixes perfectly, the ensembles do not agree."""
    values = np.random.default_rng(1).normal(size=(4, 32, 50, 2))
    values[2, :, :, 1] += 0.5
    rhat, _ = diagnostics(values)
    assert rhat[0] < 1.01
    assert rhat[1] > 1.01


def test_walkers_that_do_not_move_are_caught():
    rng = np.random.default_rng(2)
    values = np.repeat(rng.normal(size=(4, 32, 1, 1)), 50, axis=2)
    _, bulk = diagnostics(values + 1e-9 * rng.normal(size=values.shape))
    assert bulk[0] < 400
    rhat, bulk = diagnostics(np.zeros((4, 32, 50, 1)))
    assert np.isinf(rhat[0])
    assert bulk[0] == 0


def test_ensembles_that_drift_together_are_caught():
    """All spread out alike: they agree with each other at any time, and not with themselves later on."""
    values = np.random.default_rng(3).normal(size=(4, 32, 100, 2))
    values[..., 1] *= np.linspace(0.5, 1.5, 100)
    rhat, _ = diagnostics(values)
    assert rhat[0] < 1.01
    assert rhat[1] > 1.01


def test_a_drift_too_small_for_rhat_is_seen():
    values = np.random.default_rng(3).normal(size=(4, 512, 100, 2))
    assert drift(values) < 4.5
    values[..., 1] *= np.linspace(0.97, 1.03, 100)
    assert diagnostics(values)[0].max() < 1.01
    assert drift(values) > 4.5


def test_a_part_of_many_walkers_speaks_for_all():
    values = np.random.default_rng(4).normal(size=(4, 600, 40, 1))
    _, bulk = diagnostics(values)
    assert bulk[0] == pytest.approx(values.size, rel=0.2)
