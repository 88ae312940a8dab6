import numpy as np
import pytest
from cells import TABLE_2, good_plan, pattern_plan, simulated_problem
from scipy import stats

from zerobeam.analysis import posterior
from zerobeam.analysis.fit import fit_likelihood
from zerobeam.analysis.identifiability import identify
from zerobeam.analysis.posterior import (
    IndependenceProposal,
    Whitening,
    degrees_of_freedom,
    diagnostics,
    sample_density,
    sample_posterior,
)


def t_at_zero(size, nu=6.0, scale=1.0):
    return IndependenceProposal(np.zeros(size), scale * np.eye(size), nu)


# --- the proposal ---------------------------------------------------------------------------------------


def test_the_proposal_is_a_multivariate_t():
    rng = np.random.RandomState(1)
    location = np.array([1.0, -2.0, 0.5])
    factor = np.array([[2.0, 0, 0], [0.5, 1.0, 0], [-0.3, 0.2, 0.7]])
    proposal = IndependenceProposal(location, factor, 7.0)
    points = rng.randn(5, 3) * 3
    exact = stats.multivariate_t(location, factor @ factor.T, df=7).logpdf(points)
    own = proposal.log_density(points)
    np.testing.assert_allclose(own - own[0], exact - exact[0], atol=1e-12)
    # The whitened squared radius over the dimension is F(3, 7): 20 000 draws by Kolmogorov and Smirnov.
    drawn = proposal.draw(20_000, rng)
    inner = np.linalg.solve(factor, (drawn - location).T)
    assert stats.kstest((inner**2).sum(axis=0) / 3, stats.f(3, 7).cdf).pvalue > 1e-4


class WrongSign(IndependenceProposal):
    def __call__(self, coords, random):
        proposed, factors = super().__call__(coords, random)
        return proposed, -factors


class NoFactors(IndependenceProposal):
    def __call__(self, coords, random):
        proposed, factors = super().__call__(coords, random)
        return proposed, np.zeros_like(factors)


def variance_by(proposal, steps=800, walkers=32):
    """Variance of a unit normal as sampled by the independence move alone, and its standard error."""
    import emcee
    from arviz_stats.base import array_stats

    sampler = emcee.EnsembleSampler(
        walkers,
        1,
        lambda w: -(w**2).sum(axis=1) / 2,
        moves=[emcee.moves.MHMove(proposal)],
        vectorize=True,
    )
    random = np.random.RandomState(3)
    state = emcee.State(random.randn(walkers, 1), random_state=random.get_state())
    sampler.run_mcmc(state, steps, skip_initial_state_check=True)
    chains = sampler.get_chain(discard=50)[:, :, 0].T
    ess = float(array_stats.ess(chains**2, method="mean"))
    return float((chains**2).mean()), np.sqrt(2 / ess)


def test_the_sign_of_the_factors():
    """field.md: right 0.997, wrong sign 0.52, without factors 0.685 (at its own nu); bounds from the ESS."""
    right, error = variance_by(t_at_zero(1))
    assert abs(right - 1) < 4 * error
    assert error < 0.03
    for control in (WrongSign, NoFactors):
        wrong, error = variance_by(control(np.zeros(1), np.eye(1), 6.0))
        assert abs(wrong - 1) > 10 * error


def test_tails_are_lighter_in_many_dimensions():
    assert degrees_of_freedom(3) == 6.0
    assert degrees_of_freedom(12) == 12.0


# --- the sampler on known targets ------------------------------------------------------------------------


def check_moments(sampled, mean, variance, kurtosis=3.0):
    """Means and variances within four standard errors, those by the sampler's own effective size."""
    from arviz_stats.base import array_stats

    size = sampled.values.shape[3]
    for j in range(size):
        chains = sampled.values[..., j].reshape(-1, sampled.values.shape[2])
        ess = float(array_stats.ess(chains, method="mean"))
        assert abs(chains.mean() - mean[j]) < 4 * np.sqrt(variance[j] / ess)
        square = (chains - mean[j]) ** 2
        ess = float(array_stats.ess(square, method="mean"))
        assert abs(square.mean() - variance[j]) < 4 * variance[j] * np.sqrt((kurtosis - 1) / ess)
    assert sampled.rhat.max() < 1.01
    assert sampled.ess_bulk.min() >= 2000


def test_a_correlated_normal():
    """From a proposal that knows nothing of the correlation, off centre and too narrow."""
    rng = np.random.default_rng(1)
    root = rng.normal(size=(4, 4)) * [1, 0.5, 2, 0.1]
    covariance = root @ root.T + 0.05 * np.eye(4)
    mean, inverse = np.array([0.5, -0.3, 0.2, 0.4]), np.linalg.inv(covariance)

    def log_density(w):
        return -np.einsum("ij,jk,ik->i", w - mean, inverse, w - mean) / 2

    sampled = sample_density(log_density, t_at_zero(4), seed=1, ess=2000)
    check_moments(sampled, mean, np.diag(covariance))


def test_a_banana():
    """x ~ N(0, 1), y = x^2 / 2 + N(0, 0.5): mean 1/2, variance 1/2 + 1/4, kurtosis below 9."""

    def log_density(w):
        return -(w[:, 0] ** 2) / 2 - (w[:, 1] - w[:, 0] ** 2 / 2) ** 2 / (2 * 0.25)

    sampled = sample_density(log_density, t_at_zero(2), seed=2, ess=2000)
    check_moments(sampled, [0.0, 0.5], [1.0, 0.75], kurtosis=15.0)


def test_a_t_with_heavy_tails():
    """nu = 9 in two dimensions: variance 9/7, kurtosis 3 + 6/5."""

    def log_density(w):
        return -(9 + 2) / 2 * np.log1p((w**2).sum(axis=1) / 9)

    sampled = sample_density(log_density, t_at_zero(2), seed=3, ess=2000)
    check_moments(sampled, [0.0, 0.0], [9 / 7, 9 / 7], kurtosis=4.2)


def test_a_density_with_a_hard_edge():
    """-inf outside: a half normal, mean sqrt(2 / pi)."""

    def log_density(w):
        return np.where(w[:, 0] > 0, -(w**2).sum(axis=1) / 2, -np.inf)

    inside = IndependenceProposal(np.ones(1), np.eye(1), 6.0)
    sampled = sample_density(log_density, inside, seed=4, ess=2000)
    assert sampled.values.min() > 0
    check_moments(sampled, [np.sqrt(2 / np.pi)], [1 - 2 / np.pi], kurtosis=3.9)


def test_the_same_seed_gives_the_same_draws():
    def log_density(w):
        return -(w**2).sum(axis=1) / 2

    first, second, other = (sample_density(log_density, t_at_zero(2), seed=s, ess=400) for s in (7, 7, 8))
    np.testing.assert_array_equal(first.values, second.values)
    assert not np.array_equal(first.values[:, :, :5], other.values[:, :, :5])
    # The ensembles of one run are different, too.
    assert not np.array_equal(first.values[0], first.values[1])


def test_more_is_drawn_where_more_is_asked():
    def log_density(w):
        return -(w**2).sum(axis=1) / 2

    shares = []
    few = sample_density(log_density, t_at_zero(2), seed=1, ess=400)
    many = sample_density(log_density, t_at_zero(2), seed=1, ess=8000, progress=shares.append)
    assert many.values.shape[2] > few.values.shape[2]
    assert many.ess_bulk.min() >= 8000
    assert shares == sorted(shares)
    assert 0 < shares[-1] <= 1


# --- diagnostics and gate --------------------------------------------------------------------------------


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


def test_two_far_modes_do_not_pass_the_gate():
    """Each ensemble's walkers stay near one of two modes 30 stds apart."""

    def log_density(w):
        near = -((w[:, 0] - 15) ** 2) / 2, -((w[:, 0] + 15) ** 2) / 2
        return np.logaddexp(*near)

    proposal = IndependenceProposal(np.zeros(1), 15 * np.eye(1), 6.0)
    values = np.random.default_rng(1).normal(size=(4, 32, 100, 1))
    values += np.array([15.0, -15.0, 15.0, 15.0])[:, None, None, None]
    rhat, _ = diagnostics(values)
    assert rhat[0] > 1.5
    # While the sampler itself, with a proposal that covers both, passes and finds both.
    sampled = sample_density(log_density, proposal, seed=1, ess=400)
    assert abs((sampled.values > 0).mean() - 0.5) < 0.2


def posterior_of(plan, values=TABLE_2, seed=2, **options):
    _, problem = simulated_problem(plan, values, seed)
    fit = fit_likelihood(problem, starts=0)
    status = identify(problem, fit.x, fit.weight).status
    return problem, fit, sample_posterior(problem, fit, status, seed=1, **options)


def test_the_posterior_of_a_good_run_is_nearly_normal():
    problem, fit, (summary, draws) = posterior_of(good_plan(), ess=3000)
    assert summary.converged
    assert draws.converged
    assert (summary.ensembles, summary.draws) == (4, draws.values[0, :, :, 0].size * 4)
    assert summary.rhat_max <= 1.01
    assert summary.ess_min >= 3000
    shown = problem.parameters.display[problem.parameters.free]
    mode = fit.x[problem.parameters.free] * shown
    std = fit.std * problem.parameters.prior_std[problem.parameters.free] * shown
    for row, centre, spread in zip(summary.parameters, mode, std, strict=True):
        assert row.source == "data"
        # A std of a normal from n draws is right to 1 / sqrt(2 n); 3 % more for what is not quadratic.
        assert row.std == pytest.approx(spread, rel=0.03 + 4 / np.sqrt(2 * row.ess_bulk))
        assert row.mean == pytest.approx(centre, abs=4 * row.mcse_mean + 0.1 * spread)
        assert row.q2_5 == pytest.approx(row.q50 - 1.96 * spread, abs=0.25 * spread)
        assert row.q97_5 == pytest.approx(row.q50 + 1.96 * spread, abs=0.25 * spread)
    assert draws.names == tuple(n for n in problem.parameters.names if n != "delta1")


def test_the_posterior_of_the_x_pattern_is_marked_as_the_priors():
    _, _, (summary, draws) = posterior_of(pattern_plan("x"))
    assert summary.converged
    rows = {row.name: row for row in summary.parameters}
    assert rows["delta2"].source == "prior"
    assert rows["delta4"].source == "data"
    assert draws.from_prior[draws.names.index("delta2")]
    # The prior's std, 5 degrees, to four standard errors of a std and 3 % for the little that the data say.
    assert rows["delta2"].std == pytest.approx(5.0, rel=0.03 + 4 / np.sqrt(2 * rows["delta2"].ess_bulk))
    assert rows["delta2"].mean == pytest.approx(0.0, abs=4 * rows["delta2"].mcse_mean + 0.5)


def test_an_unconverged_posterior_has_no_parameters(monkeypatch):
    """Too few steps for any agreement: the summary says so, and shows nothing."""
    monkeypatch.setattr(posterior, "_BLOCKS", (2,))
    _, _, (summary, draws) = posterior_of(good_plan())
    assert not summary.converged
    assert not draws.converged
    assert summary.parameters is None
    assert summary.message.startswith("the posterior has not converged")


def test_a_disagreeing_ensemble_closes_the_gate(monkeypatch):
    real = posterior.sample_density

    def shifted(*args, **kwargs):
        sampled = real(*args, **kwargs)
        sampled.values[0] += 1.0
        return sampled

    monkeypatch.setattr(posterior, "sample_density", shifted)
    _, _, (summary, _) = posterior_of(good_plan())
    assert not summary.converged
    assert summary.parameters is None
    assert summary.rhat_max > 1.01


def test_the_density_is_never_nan(monkeypatch):
    """Far out, and where the numbers overflow, it is -inf."""
    caught = []
    real = posterior.sample_density

    def looking(log_density, proposal, **kwargs):
        rng = np.random.default_rng(1)
        far = [
            rng.normal(size=(50, len(proposal.location))) * size
            for size in (1, 100, 1e6, 1e150, 1e200, 1e300)
        ]
        with np.errstate(all="ignore"):
            caught.append(log_density(np.concatenate(far)))
        return real(log_density, proposal, **kwargs)

    monkeypatch.setattr(posterior, "sample_density", looking)
    posterior_of(good_plan())
    assert len(caught[0]) == 300
    assert not np.isnan(caught[0]).any()
    assert np.isneginf(caught[0][-50:]).all()
    assert np.isfinite(caught[0][:50]).all()


def test_whitening_is_undone_by_its_factor():
    factor = np.array([[2.0, 0], [0.5, 0.1]])
    whitening = Whitening(np.array([3.0, -1.0]), factor)
    np.testing.assert_array_equal(whitening.undo(np.zeros((1, 2)))[0], whitening.centre)
    np.testing.assert_allclose(whitening.undo(np.array([[1.0, 0.0]]))[0], [5.0, -0.5])


def test_the_same_seed_gives_the_same_posterior():
    problem = simulated_problem(good_plan(), TABLE_2, 2)[1]
    fit = fit_likelihood(problem, starts=0)
    status = identify(problem, fit.x).status
    (a, first), (_, second) = (sample_posterior(problem, fit, status, seed=5) for _ in range(2))
    np.testing.assert_array_equal(first.values, second.values)
    _, other = sample_posterior(problem, fit, status, seed=6)
    assert not np.array_equal(first.values[0, 0], other.values[0, 0])
    assert a.converged
