"""The rungs of the ladder share the functions of the whole geometry: against functions of their own."""

from dataclasses import replace

import numpy as np
import pytest
from cells import simulated
from exact_runs import demo_runs
from example_results import TABLE_2, three_targets
from scipy.optimize import least_squares

from zerobeam.analysis.estimation.fit import fit_from, fit_likelihood, fit_rows, start_at
from zerobeam.analysis.ladder import climb_ladder, held_out_rms, log_evidence
from zerobeam.model.files.run import read_run
from zerobeam.model.likelihood.density import Density
from zerobeam.model.likelihood.geometry import NOMINAL
from zerobeam.model.likelihood.problem import Problem


@pytest.fixture(scope="module")
def good():
    run = read_run(next(run.path for run in demo_runs() if run.name == "good"))
    return run, Problem.from_run(run)


def test_rungs_are_fits_of_their_own_geometry(good):
    run, problem = good
    fit, rungs, factors = climb_ladder(problem, run.header, 0, lambda share: None)
    whole = problem.geometry
    links = fit_likelihood(problem.with_geometry(replace(whole, gravity=None, harmonics=())))
    own = {
        "offsets": fit_likelihood(problem.with_geometry(NOMINAL), starts=0),
        "geometry": links,
        "gravity": fit_likelihood(problem.with_geometry(replace(whole, harmonics=())), starts=0),
        "harmonics": fit_likelihood(problem, starts=0),
    }
    assert [rung.rung for rung in rungs] == list(own)
    assert factors is None
    for rung, alone in zip(rungs, own.values(), strict=True):
        assert rung.parameters == int(alone.problem.parameters.free.sum())
        assert rung.log_evidence == pytest.approx(log_evidence(alone), abs=1e-4)
        assert rung.held_out_rms_mm == held_out_rms(alone)
    assert fit.problem is problem
    np.testing.assert_allclose((fit.z - own["harmonics"].z) / fit.std, 0, atol=1e-4)
    assert fit.log_posterior == pytest.approx(own["harmonics"].log_posterior, abs=1e-6)


def test_starts_that_meet_have_one_top(good):
    """Each start's row is what that start alone comes to; those of one top are the same to the last bit."""
    _, problem = good
    density = Density(problem)
    z = np.random.default_rng(3).normal(size=(5, density.size))
    start = start_at(problem, z)
    together = fit_rows(density, start, np.zeros(5, dtype=np.int64))
    for row, x in enumerate(start):
        alone = fit_from(problem, x)
        np.testing.assert_allclose((together.z[row] - alone.z) / alone.std, 0, atol=1e-3)
        np.testing.assert_allclose(together.std[row], alone.std, rtol=1e-3)
    assert len(np.unique(together.log_posterior)) < 5


def test_what_is_held_out_of_each_placement_is_what_a_fit_of_the_others_leaves_there():
    """By fits without each placement, and targets that are placed anew by their own measurements alone."""
    problem = Problem.from_run(simulated(three_targets(6), TABLE_2, 3)[1])
    squares = 0.0
    for k in range(3):
        others = fit_likelihood(problem.select(np.flatnonzero(problem.target_index != k)), starts=0)
        own = problem.select(np.flatnonzero(problem.target_index == k))
        x, block = others.x.copy(), problem.parameters.block("target", k)

        def at(place, own=own, x=x, block=block):
            x[block] = place
            return own.whiten(x)

        def left(place, at=at, own=own):
            return at(place).residual[: 2 * own.shots]

        placed = at(least_squares(left, x[block], x_scale=1e-3).x)
        missed = placed.factor @ placed.residual[: 2 * own.shots].reshape(-1, 2, 1)
        squares += (missed**2).sum()
    expected = np.sqrt(squares / problem.shots)
    assert held_out_rms(fit_likelihood(problem, starts=0)) == pytest.approx(expected, rel=0.02)
