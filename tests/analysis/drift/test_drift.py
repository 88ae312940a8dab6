"""Jumps, intervals and the due date of made-up arms with known walks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drifting import NAMES, steady
from scipy.stats import norm

from zerobeam.analysis.drift.drift import MEDIAN, SPREAD, drift, mixture_interval
from zerobeam.analysis.drift.due import HORIZON_YEARS, due_after
from zerobeam.analysis.drift.importance import ENOUGH
from zerobeam.analysis.drift.series import Observation, series_of
from zerobeam.analysis.drift.smoother import smooth
from zerobeam.analysis.status import UnsoundResult
from zerobeam.model.errors import BadInput


def test_a_jump_is_found_where_it_is_and_no_other() -> None:
    found = drift(steady(0.3))
    (jump,) = found.jumps
    assert (jump.offset, jump.after) == ("delta3", 5)
    assert jump.p_value < 0.01
    assert jump.interval95[0] < 0.3 < jump.interval95[1]
    assert jump.interval95[0] < jump.size < jump.interval95[1]
    assert drift(steady()).jumps == ()


def test_a_fast_walk_is_no_jump() -> None:
    found = drift(steady(walk=0.1))
    assert found.jumps == ()
    assert found.rate("delta3")[0] > 5 * drift(steady()).rate("delta3")[0]


def test_walks_that_the_prior_did_not_expect_are_found_by_more_passes() -> None:
    """Five offsets that move by a degree a year: their rates lie beyond the prior's 99.9 %. Without
    correlations each has a posterior of its own, here on a grid."""
    names = tuple(f"delta{joint}" for joint in range(2, 7))
    states = np.cumsum(np.random.default_rng(8).normal(size=(4, 5)), axis=0)
    noise, none = 1e-4 * np.eye(5), np.zeros((5, 5))
    own = [Observation(float(t), names, row, noise, none) for t, row in enumerate(states)]
    found = drift(series_of(own, dict.fromkeys(names, "deg")))
    assert found.jumps == ()
    assert found.effective > ENOUGH
    log_rate = np.linspace(np.log(MEDIAN) - 6 * SPREAD, np.log(MEDIAN) + 6 * SPREAD, 4001)
    for j, name in enumerate(names):
        covariance = np.exp(2 * log_rate)[:, None, None] * np.eye(3) + 1e-4 * (
            2 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1)
        )
        steps = np.diff(states[:, j])
        squared = np.einsum("i,kij,j->k", steps, np.linalg.inv(covariance), steps)
        prior = ((log_rate - np.log(MEDIAN)) / SPREAD) ** 2
        density = -0.5 * (np.linalg.slogdet(covariance)[1] + squared + prior)
        cumulated = np.cumsum(np.exp(density - density.max()))
        expected = np.exp(np.interp([0.025, 0.5, 0.975], cumulated / cumulated[-1], log_rate))
        median, (low, high) = found.rate(name)
        np.testing.assert_allclose(np.log([low, median, high]), np.log(expected), atol=0.25)


def test_the_correlation_of_the_offsets_counts() -> None:
    whole = steady()
    apart = replace(
        whole,
        observations=tuple(
            replace(own, covariance=np.diag(np.diag(own.covariance))) for own in whole.observations
        ),
    )
    along = np.array([1.0, -1.0])  # what the correlation determines well
    low, high = drift(whole).interval(5, along)
    wide_low, wide_high = drift(apart).interval(5, along)
    assert (wide_high - wide_low) > 1.5 * (high - low)


def test_new_zeros_are_no_jump() -> None:
    jumped = steady(2.0)
    assert drift(replace(jumped, reset=(5,))).jumps == ()


def test_deviations_of_the_geometry_do_not_average_out() -> None:
    shared = np.eye(2) * 0.05**2
    own = steady()
    with_geometry = replace(own, observations=tuple(replace(one, shared=shared) for one in own.observations))
    assert drift(with_geometry).value(11, np.array([1.0, 0.0]))[1] > 0.05


def test_one_result_says_nothing_of_drift() -> None:
    with pytest.raises(BadInput, match="two results"):
        drift(steady(results=1))


def test_an_offset_that_is_seen_on_one_side_only_is_not_tested() -> None:
    own = steady()
    part = [
        replace(
            one,
            names=NAMES[:1],
            values=one.values[:1],
            covariance=one.covariance[:1, :1],
            shared=one.shared[:1, :1],
        )
        for one in own.observations[:8]
    ]
    found = drift(replace(own, observations=(*part, *own.observations[8:])))
    assert np.isnan(found.p_first[:8, 1]).all()
    assert np.isfinite(found.p_first[8:, 1]).all()


def test_the_interval_of_a_mixture() -> None:
    one = mixture_interval(np.array([1.0]), np.array([2.0]), np.array([1.0]), 0.95)
    np.testing.assert_allclose(one, norm(1, 2).interval(0.95), rtol=1e-9)
    low, high = mixture_interval(np.array([-3.0, 3.0]), np.ones(2), np.full(2, 0.5), 0.95)
    assert norm.cdf(low, -3) / 2 + norm.cdf(low, 3) / 2 == pytest.approx(0.025)
    assert high == pytest.approx(-low)


def test_the_due_date_is_when_the_walk_has_used_up_the_tolerance() -> None:
    found, s = drift(steady(walk=0.02)), np.diag([100.0, 100.0])  # 10 mm per degree
    years = due_after(found, s, 1.0)
    assert years is not None
    assert 0 < years < HORIZON_YEARS
    assert due_after(found, s, 1e3) is None
    assert due_after(found, s, 1e-3) == 0
    wider = due_after(found, s, 2.0)
    assert wider is None or wider > years
    # Against draws of the same law by another way.
    random = np.random.default_rng(0)
    k = random.choice(len(found.weights), size=20_000, p=found.weights)
    now = np.einsum(
        "kij,kj->ki", np.linalg.cholesky(found.smoothed.covariance[k, -1]), random.normal(size=(len(k), 2))
    )
    now += found.smoothed.mean[k, -1] - found.weights @ found.smoothed.mean[:, -1]
    apart = now + np.sqrt(years) * found.rates[k] * random.normal(size=(len(k), 2))
    assert np.mean(10 * np.linalg.norm(apart, axis=1) > 1.0) == pytest.approx(0.05, abs=0.008)


def test_new_zeros_that_no_result_determines_leave_the_offset_unknown() -> None:
    series = steady()
    alone = tuple(
        Observation(own.at, NAMES[:1], own.values[:1], own.covariance[:1, :1], own.shared[:1, :1])
        for own in series.observations[6:]
    )
    found = drift(replace(series, observations=(*series.observations[:6], *alone), reset=(5,)))
    assert found.series.determined[:, 1].tolist() == [True] * 6 + [False] * 6
    with pytest.raises(UnsoundResult, match="delta3"):
        found.value(6, np.array([0.0, 1.0]))
    with pytest.raises(UnsoundResult, match="delta3"):
        found.interval(11, np.array([1.0, 1.0]))
    assert found.value(5, np.array([0.0, 1.0]))[1] < 0.02
    assert not np.isfinite(found.p_first[5:, 1]).any()
    rates, jumps = found.rates[:1], np.zeros((11, 2), dtype=bool)
    jumps[5] = True
    both = smooth(found.series, rates, jumps)
    first = smooth(replace(series, observations=series.observations[:6]), rates, jumps[:5])
    after = smooth(series_of(alone, {"delta2": "deg"}), rates[:, :1], jumps[6:, :1])
    np.testing.assert_allclose(both.covariance[:, :6], first.covariance)
    np.testing.assert_allclose(both.mean[:, 6:, :1], after.mean)
    apart = both.log_likelihood - first.log_likelihood - after.log_likelihood
    other = smooth(found.series, 3 * rates, jumps).log_likelihood
    parts = smooth(replace(series, observations=series.observations[:6]), 3 * rates, jumps[:5])
    more = smooth(series_of(alone, {"delta2": "deg"}), 3 * rates[:, :1], jumps[6:, :1])
    np.testing.assert_allclose(other - parts.log_likelihood - more.log_likelihood, apart, atol=1e-9)
