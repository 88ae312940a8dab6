"""Draws of many posteriors side by side: by weights, by proposals fitted anew, and by emcee's walkers."""

import functools

import numpy as np
import pytest

from zerobeam.analysis.posterior import many_posteriors
from zerobeam.analysis.posterior.convergence import Weights
from zerobeam.analysis.posterior.many_posteriors import drawn_together
from zerobeam.experiments.studies.coverage import studied_plans
from zerobeam.experiments.studies.data_sets import drawn, fitted
from zerobeam.model.likelihood.density import Density

SETS, DRAWS = 12, 400


@functools.cache
def density_of(name):
    """The density and the fits of a plan's data sets."""
    (plan,) = (plan for plan in studied_plans(0) if plan.name == name)
    data = drawn(plan.problem, SETS, np.random.default_rng(1))
    return Density(plan.problem, data.joints, data.spots), fitted(data)


def chosen_of(name):
    """Their draws by the method that is chosen: weights, where they serve."""
    return drawn_together(*density_of(name), DRAWS, np.random.default_rng(2))[0]


def both_ways(name, patch):
    """The draws by weights, and by walkers alone, with how often each was refitted."""
    refits = []
    refit = many_posteriors._Posteriors._refit
    patch.setattr(
        many_posteriors._Posteriors, "_refit", lambda self, *of: (refits.append(of[0]), refit(self, *of))
    )
    chosen = chosen_of(name)
    by_weights = len(refits)
    patch.setattr(Weights, "serve", False)
    walked, _ = drawn_together(*density_of(name), DRAWS, np.random.default_rng(3))
    return chosen, walked, by_weights


@pytest.mark.parametrize("name", ["nearly degenerate", pytest.param("good", marks=pytest.mark.long)])
def test_walkers_say_the_same_as_weights(name, monkeypatch):
    """Means and spreads of twelve data sets, by two methods: 192 numbers or more of one normal each."""
    chosen, walked, refits = both_ways(name, monkeypatch)
    assert (refits > 0) == (name == "nearly degenerate")
    error = np.sqrt((chosen.var(axis=1) + walked.var(axis=1)) / DRAWS)
    z = (chosen.mean(axis=1) - walked.mean(axis=1)) / error
    assert abs(z).max() < 4.5
    assert 0.8 < z.std() < 1.2
    ratio = np.log(chosen.std(axis=1) / walked.std(axis=1))
    assert abs(ratio).max() < 0.25  # of two stds of 400 draws each 0.05, wider of heavy tails
    assert abs(ratio.mean(axis=0)).max() < 0.07


def test_draws_without_their_weights_are_seen(monkeypatch):
    """Negative control: every proposal counts the same."""
    equal = lambda log_weights: Weights(np.ones_like(log_weights), 0.0, 1.0)  # noqa: E731
    monkeypatch.setattr(Weights, "of", equal)
    chosen = chosen_of("nearly degenerate")
    monkeypatch.undo()
    right = chosen_of("nearly degenerate")
    assert abs(np.log(chosen.std(axis=1) / right.std(axis=1)).mean(axis=0)).max() > 0.07


def test_the_acceptance_is_that_of_a_chain():
    rng = np.random.default_rng(0)
    weights = Weights.of(rng.normal(size=300))
    pairs = np.minimum(weights.values[:, None], weights.values)
    assert weights.acceptance == pytest.approx(pairs.mean())
    assert Weights.of(np.zeros(5)).acceptance == 1.0
