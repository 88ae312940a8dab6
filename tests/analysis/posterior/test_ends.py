"""Ends of intervals by weighted proposals: numerical integration, and their own errors."""

import numpy as np
import pytest
from arviz_stats.base import array_stats
from exact_runs import demo_runs
from scipy import stats

from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.posterior.convergence import Ends, MarginalT, Weights, pareto_k, weighted_ends
from zerobeam.analysis.posterior.posterior import sample_posterior
from zerobeam.model.files.run import read_run
from zerobeam.model.likelihood.problem import Problem

PROPOSAL = MarginalT(0.1, 1.05, 20.0)


def log_density(x):
    """A normal with one tail longer than the other."""
    return -(x**2) / 2 + np.log1p(0.6 * np.tanh(x))


def true_ends():
    grid = np.linspace(-12, 12, 200_001)
    density = np.exp(log_density(grid))
    distribution = np.cumsum(density) / density.sum()
    mean = (grid * density).sum() / density.sum()
    std = np.sqrt(((grid - mean) ** 2 * density).sum() / density.sum())
    return std, *np.interp([0.025, 0.975], distribution, grid)


def drawn(seed, count=4000, density=log_density, proposal=PROPOSAL, known=True):
    t = stats.t(proposal.nu, proposal.location, proposal.scale)
    x = t.rvs(count, random_state=np.random.default_rng(seed))
    return weighted_ends(x, Weights.of(density(x) - t.logpdf(x)), proposal if known else None)


def weights(density):
    t = stats.t(PROPOSAL.nu, PROPOSAL.location, PROPOSAL.scale)
    x = t.rvs(4000, random_state=np.random.default_rng(1))
    return Weights.of(density(x) - t.logpdf(x))


@pytest.mark.long
@pytest.mark.parametrize("known", [True, False])
def test_they_are_those_of_the_density_and_their_error_is_as_told(known):
    """With the distribution of the proposal, and by the weights alone."""
    found = np.array([drawn(seed, known=known) for seed in range(300)])
    std, low, high = true_ends()
    told = found[:, 3].mean()
    for measured, end in ((found[:, 1], low), (found[:, 2], high)):
        assert abs(measured.mean() - end) < 4 * measured.std() / np.sqrt(len(found)) + 1e-3
    assert found[:, 0].mean() == pytest.approx(std, rel=2e-3)
    # In probability: the worse of the two ends scatters as so many independent draws would.
    density = np.exp(log_density(np.linspace(-12, 12, 4801))).sum() * 24 / 4800
    scatter = max(
        measured.std() * np.exp(log_density(end)) / density
        for measured, end in ((found[:, 1], low), (found[:, 2], high))
    )
    assert scatter == pytest.approx(np.sqrt(0.025 * 0.975 / told), rel=0.15)


def test_a_close_proposal_is_worth_many_draws():
    """Without the control variate 4,000 draws would give no more than 4,000."""
    close = drawn(1, density=stats.norm.logpdf, proposal=MarginalT(0.0, 1.0, 90.0))
    assert close.ess_tail > 40_000
    assert (close.q2_5, close.q97_5) == (pytest.approx(-1.96, abs=0.02), pytest.approx(1.96, abs=0.02))
    assert drawn(1).ess_tail < close.ess_tail


def test_by_the_weights_alone_they_are_worth_fewer_draws():
    close = {"density": stats.norm.logpdf, "proposal": MarginalT(0.0, 1.0, 90.0)}
    known, alone = drawn(1, **close), drawn(1, **close, known=False)
    assert alone.ess_tail < 4500 < known.ess_tail / 5
    assert not alone.off(known)
    assert not drawn(1, known=False).off(Ends(*true_ends(), 1e12))


def test_weights_that_do_not_serve_are_known_by_their_tail():
    assert weights(log_density).serve
    assert not weights(stats.cauchy.logpdf).serve
    assert not weights(lambda x: -((x - 4) ** 2) * 8).serve
    assert not weights(lambda x: np.where(np.abs(x) < 1e-3, 0.0, -np.inf)).serve
    equal = weights(stats.t(PROPOSAL.nu, PROPOSAL.location, PROPOSAL.scale).logpdf)
    assert equal.serve
    assert equal.share == pytest.approx(1.0)


@pytest.mark.parametrize("scale", [0.4, 0.6, 0.9, 1.5])
def test_paretos_k_is_that_of_arviz(scale):
    """Of a normal proposal: too narrow ones have a k above one half."""
    x = scale * np.random.default_rng(3).normal(size=20_000)
    log_weights = stats.norm.logpdf(x) - stats.norm.logpdf(x, scale=scale)
    _, expected = array_stats.psislw(-log_weights)  # as of leave-one-out log-likelihoods
    assert pareto_k(np.exp(log_weights - log_weights.max())) == pytest.approx(float(expected), abs=0.02)
    assert (scale > 0.6) or pareto_k(np.exp(log_weights)) > 0.5


def test_of_draws_alone():
    chains = np.random.default_rng(1).normal(size=(40, 500))
    ends = Ends.of_draws(chains)
    assert ends.ess_tail == pytest.approx(20_000, rel=0.1)
    assert ends.q97_5 == np.quantile(chains, 0.975)


def test_how_far_ends_are_off_beyond_chance():
    one = Ends(1.0, -1.96, 1.96, 10_000.0)
    assert one.error == pytest.approx(2.671 / 100, rel=1e-3)
    assert one.off(Ends(1.0, -1.96, 2.10, 10_000.0)) == 0
    assert one.off(Ends(1.0, -1.96, 2.12, 10_000.0)) == pytest.approx(0.16 / 4.08)
    assert one.off(Ends(1.0, -2.12, 1.96, 10_000.0)) == pytest.approx(0.16 / 4.08)
    # A std of so many draws is right to 1 %: 3 % are chance, 6 % are not.
    assert one.off(Ends(1.03, -1.96, 1.96, 10_000.0)) == 0
    assert one.off(Ends(1 / 0.94, -1.96, 1.96, 10_000.0)) == pytest.approx(0.06)
    # Few draws tell nothing.
    assert Ends(1.0, -1.96, 1.96, 100.0).off(Ends(1 / 0.94, -2.12, 2.12, 100.0)) == 0


@pytest.mark.long
def test_those_of_a_run_are_those_of_many_more_draws():
    run = read_run(next(run.path for run in demo_runs() if run.name == "good"))
    solution = solve_run(Problem.from_run(run), run.header)
    _, few = sample_posterior(solution, seed=1, ess=1000)
    summary, _ = sample_posterior(solution, seed=2, ess=50_000)
    rows = {row.name: row.ends for row in summary.parameters}
    assert list(few.ends) == ["delta2", "delta3", "delta4", "delta5", "delta6"]
    for name, ends in few.ends.items():
        assert ends.ess_tail > 2 * few.values[..., 0].size
        assert not ends.off(rows[name])
        assert ends.std == pytest.approx(rows[name].std, rel=0.02)
