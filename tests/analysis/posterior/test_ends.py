"""Ends of intervals by weighted proposals: numerical integration, and their own errors."""

import numpy as np
import pytest
from scipy import stats

from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.posterior.ends import Ends, MarginalT, weighted_ends
from zerobeam.analysis.posterior.posterior import sample_posterior
from zerobeam.experiments.demos import demo_runs
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


def drawn(seed, count=4000, density=log_density, proposal=PROPOSAL):
    t = stats.t(proposal.nu, proposal.location, proposal.scale)
    x = t.rvs(count, random_state=np.random.default_rng(seed))
    return weighted_ends(x, density(x) - t.logpdf(x), proposal)


@pytest.mark.long
def test_they_are_those_of_the_density_and_their_error_is_as_told():
    found = np.array([drawn(seed) for seed in range(300)])
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


def test_weights_that_do_not_serve_are_refused():
    assert drawn(1, density=stats.cauchy.logpdf) is None
    assert drawn(1, density=lambda x: -((x - 4) ** 2) * 8) is None
    assert drawn(1, density=lambda x: np.where(np.abs(x) < 1e-3, 0.0, -np.inf)) is None


def test_of_draws_alone():
    chains = np.random.default_rng(1).normal(size=(40, 500))
    ends = Ends.of_draws(chains)
    assert ends.ess_tail == pytest.approx(20_000, rel=0.1)
    assert ends.q97_5 == np.quantile(chains, 0.975)


def test_ends_contradict_where_chance_does_not_explain_it():
    one = Ends(1.0, -1.96, 1.96, 10_000.0)
    assert one.error == pytest.approx(2.671 / 100, rel=1e-3)
    assert not one.contradict(Ends(1.0, -1.96, 2.10, 10_000.0))
    assert one.contradict(Ends(1.0, -1.96, 2.12, 10_000.0))
    assert one.contradict(Ends(1.0, -2.12, 1.96, 10_000.0))


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
        assert not ends.contradict(rows[name])
        assert ends.std == pytest.approx(rows[name].std, rel=0.02)
