from dataclasses import replace

import numpy as np
import pytest
from cells import TABLE_2, good_plan, pattern_plan, simulated_problem

from zerobeam.analysis.estimation.fit import fit_likelihood
from zerobeam.analysis.posterior import posterior
from zerobeam.analysis.posterior.posterior import sample_posterior
from zerobeam.analysis.posterior.sampler import diagnostics
from zerobeam.analysis.solution import judge
from zerobeam.words.finding_words import posterior_message


def posterior_of(plan, values=TABLE_2, seed=2, **options):
    _, problem = simulated_problem(plan, values, seed)
    solution = judge(fit_likelihood(problem, starts=0))
    return problem, solution.fit, sample_posterior(solution, seed=1, **options)


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
    assert "delta2" not in draws.names
    (lost,) = (item for item in draws.prior_only if item.name == "delta2")
    assert (lost.unit, lost.mean, lost.std) == ("deg", 0.0, pytest.approx(5.0))
    drawn = lost.draws(np.random.default_rng(1), (4, 1000))
    assert drawn.std() == pytest.approx(5.0, rel=4 / np.sqrt(2 * drawn.size))
    # The prior's std, 5 degrees, to four standard errors of a std and 3 % for the little that the data say.
    assert rows["delta2"].std == pytest.approx(5.0, rel=0.03 + 4 / np.sqrt(2 * rows["delta2"].ess_bulk))
    assert rows["delta2"].mean == pytest.approx(0.0, abs=4 * rows["delta2"].mcse_mean + 0.5)


def cut_short(values):
    """Too few steps for any agreement."""
    return values[:, :, :2]


def one_apart(values):
    """An ensemble that disagrees."""
    values[0] += 1.0
    return values


@pytest.mark.parametrize("spoilt", [cut_short, one_apart])
def test_an_unconverged_posterior_has_no_parameters(monkeypatch, spoilt):
    real = posterior.sample_density

    def sampled(*args, **kwargs):
        found = real(*args, **kwargs)
        judged = spoilt(found.judged)
        rhat, bulk = diagnostics(judged)
        return replace(found, judged=judged, rhat=rhat, ess_bulk=bulk)

    monkeypatch.setattr(posterior, "sample_density", sampled)
    _, _, (summary, draws) = posterior_of(good_plan())
    assert not summary.converged
    assert not draws.converged
    assert summary.parameters is None
    assert spoilt is cut_short or summary.rhat_max > 1.01
    assert posterior_message(summary).startswith("the posterior has not converged")


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
