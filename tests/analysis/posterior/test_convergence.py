"""Ours against ArviZ's, on chains that mix well, badly and not at all."""

import numpy as np
import pytest
from arviz_stats.base import array_stats

from zerobeam.analysis.posterior.convergence import (
    effective,
    error_of_mean,
    halves,
    nested_rhat,
    normal_scores,
    tail_effective,
)


def _chains(kind: str, count: int, steps: int) -> np.ndarray:
    rng = np.random.default_rng([len(kind), count, steps])
    noise = rng.normal(size=(count, steps))
    if kind == "walk":
        return noise.cumsum(axis=1)
    if kind == "apart":
        return noise + np.arange(count)[:, None]
    if kind == "alternating":
        return noise + 3.0 * (-1.0) ** np.arange(steps)
    if kind == "stuck":  # proposals refused: each draw several times over
        return np.repeat(noise, 3, axis=1)[:, :steps]
    slow = noise.copy()
    for t in range(1, steps):
        slow[:, t] += 0.8 * slow[:, t - 1]
    return slow


KINDS = ("walk", "apart", "alternating", "stuck", "slow")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("count", "steps"), [(12, 9), (12, 60), (4, 501), (1, 200), (128, 40)])
def test_effective_sample_sizes_are_those_of_arviz(kind, count, steps):
    chains = _chains(kind, count, steps)
    assert effective(chains) == pytest.approx(float(array_stats.ess(chains, method="identity")), rel=1e-9)
    assert effective(halves(chains)) == pytest.approx(float(array_stats.ess(chains, method="mean")), rel=1e-9)
    bulk = effective(normal_scores(halves(chains)))
    assert bulk == pytest.approx(float(array_stats.ess(chains, method="bulk")), rel=1e-9)
    tail = float(array_stats.ess(chains, method="tail", prob=(0.05, 0.95)))
    assert tail_effective(chains) == pytest.approx(tail, rel=1e-9)
    error = float(array_stats.mcse(chains, method="mean"))
    assert error_of_mean(chains) == pytest.approx(error, rel=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_nested_rhat_is_that_of_arviz(kind):
    chains = _chains(kind, 24, 50)
    theirs = array_stats.rhat_nested(chains, superchain_ids=np.repeat(np.arange(4), 6), method="identity")
    assert nested_rhat(chains.reshape(4, 6, 50)) == pytest.approx(float(theirs), rel=1e-12)


def test_equal_draws_share_their_rank():
    scores = normal_scores(np.array([[3.0, 1.0], [1.0, 2.0]]))
    assert scores[0, 1] == scores[1, 0] < scores[1, 1] < scores[0, 0]
    assert normal_scores(np.array([5.0, 5.0, 5.0])) == pytest.approx([0.0, 0.0, 0.0])


def test_short_chains_say_nothing():
    assert np.isnan(error_of_mean(np.arange(12.0).reshape(6, 2)))


def test_draws_that_never_move_are_all_that_there_are():
    assert effective(np.full((4, 50), 2.0)) == 200
