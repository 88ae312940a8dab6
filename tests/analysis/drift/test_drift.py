"""Jumps, intervals and the due date of made-up arms with known walks."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from drifting import COVARIANCE, NAMES, steady
from scipy import stats
from scipy.stats import norm

from zerobeam.analysis.drift.drift import (
    HORIZON_YEARS,
    MEDIAN,
    SPREAD,
    Drift,
    bands,
    drift,
    due_after,
    mixture_interval,
)
from zerobeam.analysis.drift.importance import ENOUGH, Nodes, Pass, about, from_pass
from zerobeam.analysis.drift.smoother import Observation, Series, series_of, smooth
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput, UnsoundResult

FIVE = tuple(f"delta{joint}" for joint in range(2, 7))
LOG_RATE = np.linspace(np.log(MEDIAN) - 8 * SPREAD, np.log(MEDIAN) + 8 * SPREAD, 6001)


def yearly(values: Matrix) -> Series:
    """Results (T, 5) of a year each, with u of 0.01 degrees and no correlations."""
    noise, none = 1e-4 * np.eye(5), np.zeros((5, 5))
    own = [Observation(float(t), FIVE, row, noise, none) for t, row in enumerate(values)]
    return series_of(own, dict.fromkeys(FIVE, "deg"))


def on_grid(steps: Matrix) -> tuple[Matrix, Matrix]:
    """The logarithm of the posterior of an offset's rate on `LOG_RATE` by its three steps of `yearly`, and
    the inverse of their covariance for each rate."""
    noise = 1e-4 * (2 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1))
    covariance = np.exp(2 * LOG_RATE)[:, None, None] * np.eye(3) + noise
    inverse = np.linalg.inv(covariance)
    squared = np.einsum("i,kij,j->k", steps, inverse, steps)
    prior = ((LOG_RATE - np.log(MEDIAN)) / SPREAD) ** 2
    return -0.5 * (np.linalg.slogdet(covariance)[1] + squared + prior), inverse


def test_a_jump_is_found_where_it_is_and_no_other() -> None:
    found = drift(steady(0.3))
    (jump,) = found.jumps
    assert (jump.offset, jump.place) == ("delta3", 5)
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
    states = np.cumsum(np.random.default_rng(2).normal(size=(4, 5)), axis=0)
    found = drift(yearly(states))
    assert found.jumps == ()
    assert found.effective > ENOUGH
    for j, name in enumerate(FIVE):
        density, _ = on_grid(np.diff(states[:, j]))
        cumulated = np.cumsum(np.exp(density - density.max()))
        expected = np.exp(np.interp([0.025, 0.5, 0.975], cumulated / cumulated[-1], LOG_RATE))
        median, (low, high) = found.rate(name)
        np.testing.assert_allclose(np.log([low, median, high]), np.log(expected), atol=0.25)


@pytest.mark.parametrize("seed", [2, 4, 8])
@pytest.mark.one_in(3)
def test_p_values_of_jumps_are_exact_however_far_the_data_are_from_the_prior(seed: int) -> None:
    """The same arms, against a grid of the rates by the part of the data that a jump leaves unchanged."""
    states = np.cumsum(np.random.default_rng(seed).normal(size=(4, 5)), axis=0)
    found = drift(yearly(states))
    for j in range(len(FIVE)):
        density, inverse = on_grid(np.diff(states[:, j]))
        for t in range(3):
            power = inverse[:, t, t]
            score = inverse[:, t] @ np.diff(states[:, j]) / np.sqrt(power)
            without = density + score**2 / 2 - np.log(power) / 2
            weights = np.exp(without - without.max())
            tails = [float(weights @ norm.cdf(side * score) / weights.sum()) for side in (-1, 1)]
            np.testing.assert_allclose(found.p_first[t, j], 2 * min(tails), rtol=0.15)


@pytest.mark.parametrize("offsets", [1, 5])
def test_a_jump_of_a_hundred_uncertainties_is_found_in_two_results(offsets: int) -> None:
    states = np.zeros((2, 5))
    states[1, :offsets] = 1.0
    found = drift(yearly(states))
    assert [(own.offset, own.place) for own in found.jumps] == [(name, 0) for name in FIVE[:offsets]]
    assert all(own.p_value < 0.01 for own in found.jumps)
    assert found.undecided == ()


def test_what_may_be_a_jump_or_drift_is_undecided() -> None:
    """Twenty uncertainties in two results: no jump at the stated rate of false alarms, nor drift."""
    states = np.zeros((2, 5))
    states[1, 1] = 0.2
    found = drift(yearly(states))
    assert found.jumps == ()
    (change,) = found.undecided
    assert (change.offset, change.place) == ("delta3", 0)
    assert change.interval95[0] < 0.2 < change.interval95[1]
    assert change.interval95[1] - change.interval95[0] == pytest.approx(2 * 1.96 * 0.01 * 2**0.5, rel=0.01)
    for factor, number in ((0.9, 0), (1.1, 1)):
        states[1, 1] = factor * change.least_jump
        assert len(drift(yearly(states)).jumps) == number
    # A change within its uncertainty is none, and drift that the other results show is drift.
    states[1, 1] = 0.02
    assert drift(yearly(states)).undecided == ()
    steady_drift = np.zeros((8, 5))
    steady_drift[:, 1] = 0.2 * np.arange(8) * (-1) ** np.arange(8)
    assert drift(yearly(steady_drift)).undecided == ()


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


@pytest.mark.parametrize("shift", [0.0, 10.0])
def test_the_uncertainty_of_a_state_is_that_of_the_mixture_over_the_rates(shift: float) -> None:
    """Its variance is the mean of the squares less the square of the mean, wherever the states are; and its
    interval holds what draws of the mixture say."""
    own = steady(walk=0.1, results=4)
    shifted = tuple(replace(one, values=one.values + shift) for one in own.observations)
    found = drift(replace(own, observations=shifted))
    along = np.array([1.0, -0.5])
    mean = found.smoothed.mean[:, -1] @ along
    variance = np.einsum("i,kij,j->k", along, found.smoothed.covariance[:, -1], along)
    centre, std = found.value(3, along)
    assert centre == pytest.approx(found.weights @ mean)
    spread = found.weights @ (variance + mean**2) - centre**2
    assert std == pytest.approx(np.sqrt(spread), rel=1e-6)
    assert spread > 1.001 * (found.weights @ variance)  # the rates differ in what they say
    random = np.random.default_rng(1)
    k = random.choice(len(mean), size=400_000, p=found.weights)
    draws = mean[k] + np.sqrt(variance[k]) * random.normal(size=len(k))
    np.testing.assert_allclose(found.interval(3, along), np.quantile(draws, (0.025, 0.975)), atol=0.02 * std)


def test_new_zeros_are_no_jump() -> None:
    jumped = steady(2.0)
    assert drift(replace(jumped, reset=(5,))).jumps == ()


def test_deviations_of_the_geometry_do_not_average_out() -> None:
    shared = np.eye(2) * 0.05**2
    own = steady()
    with_geometry = replace(own, observations=tuple(replace(one, shared=shared) for one in own.observations))
    assert drift(with_geometry).value(11, np.array([1.0, 0.0]))[1] > 0.05


def test_a_result_behind_new_zeros_has_its_own_u() -> None:
    """Of noise and geometry, each once: the geometry was counted twice, and the u of a result 1.4 times so
    large where it has most part in it."""
    series = replace(steady(), reset=(10,))
    shared = 4 * COVARIANCE
    whole = tuple(replace(one, shared=shared) for one in series.observations)
    found, alone = drift(replace(series, observations=whole)), drift(series)
    for along in np.eye(2):
        u = math.sqrt(along @ (COVARIANCE + shared) @ along)
        assert found.value(11, along)[1] == pytest.approx(u, rel=1e-9)
        low, high = found.interval(11, along)
        assert high - low == pytest.approx(2 * norm.ppf(0.975) * u, rel=1e-6)
        # The average of many has less noise, and no less of the geometry.
        of_many, of_noise = found.value(5, along)[1], alone.value(5, along)[1]
        assert of_many == pytest.approx(math.sqrt(of_noise**2 + along @ shared @ along), rel=0.02)
    assert list(bands(found, "delta3"))[-1].high[-1] == pytest.approx(found.interval(11, np.eye(2)[1])[1])


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


def asked_between(found: Drift, gap: int, share: float, j: int) -> tuple[float, float]:
    """The interval at a time between two results, by a result there that determines nothing."""
    own = found.series.observations
    at = own[gap].at + share * (own[gap + 1].at - own[gap].at)
    nothing = Observation(at, (), np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0)))
    more = replace(found.series, observations=(*own[: gap + 1], nothing, *own[gap + 1 :]))
    size = len(found.series.names)
    smoothed = smooth(more, found.rates, np.zeros((len(own), size), dtype=bool))
    std = np.sqrt(smoothed.covariance[:, gap + 1, j, j])
    return mixture_interval(smoothed.mean[:, gap + 1, j], std, found.weights, 0.95)


def test_between_results_it_is_what_the_smoother_says_there() -> None:
    found = drift(steady(walk=0.02, results=6))
    (band,) = bands(found, found.series.names[0])
    times = [own.at for own in found.series.observations]
    for gap in (0, 2, 4):
        middle = int(np.argmin(abs(band.at - (0.6 * times[gap] + 0.4 * times[gap + 1]))))
        share = (band.at[middle] - times[gap]) / (times[gap + 1] - times[gap])
        told = asked_between(found, gap, float(share), 0)
        np.testing.assert_allclose((band.low[middle], band.high[middle]), told, atol=1e-6)
    along = np.eye(len(found.series.names))[0]
    for t, at in enumerate(times):
        place = int(np.argmin(abs(band.at - at)))
        np.testing.assert_allclose((band.low[place], band.high[place]), found.interval(t, along), atol=1e-6)
    width = band.high - band.low
    assert width[middle] > width[np.argmin(abs(band.at - times[4]))] * 1.02


def test_it_breaks_at_a_jump_and_goes_on_as_a_forecast() -> None:
    found = drift(steady(jump=1.0))
    (jump,) = found.jumps
    times = [own.at for own in found.series.observations]
    before, after, forecast = bands(found, jump.offset, 2.0)
    assert before.at[-1] == times[jump.place]
    assert after.at[0] == times[jump.place + 1]
    assert (forecast.forecast, forecast.at[0], forecast.at[-1]) == (True, times[-1], times[-1] + 2.0)
    width = forecast.high - forecast.low
    assert (np.diff(width) > 0).all()
    assert width[0] == pytest.approx(after.high[-1] - after.low[-1])
    other = next(name for name in found.series.names if name != jump.offset)
    assert len(list(bands(found, other))) == 1


def test_it_begins_where_a_result_determines_the_offset() -> None:
    series = steady()
    name, *others = series.names
    keep = np.arange(1, len(series.names))

    def without(own: Observation) -> Observation:
        block = np.ix_(keep, keep)
        return Observation(own.at, tuple(others), own.values[keep], own.covariance[block], own.shared[block])

    lost = (0, 1, 2, 8, 9, 10, 11)
    partly = tuple(without(own) if t in lost else own for t, own in enumerate(series.observations))
    found = drift(replace(series, observations=partly, reset=(7,)))
    (band,) = bands(found, name, 1.0)
    assert (band.at[0], band.at[-1]) == (partly[3].at, partly[7].at)
    assert len(list(bands(found, others[0], 1.0))) == 3


def test_the_due_date_is_when_the_walk_has_used_up_the_tolerance() -> None:
    found, s = drift(steady(walk=0.02)), np.diag([100.0, 100.0])  # 10 mm per degree
    years = due_after(found, s, 1.0)
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


def test_nodes_that_passes_were_added_to_have_the_densities_of_the_whole_mixture() -> None:
    prior: Pass = (np.array([-4.0, -5.0]), 1.5 * np.eye(2))
    nodes = Nodes.of(from_pass(prior, 16, 0), [prior])
    for number in (1, 2):
        near = about(nodes.points, np.exp(nodes.points[:, 0]) / np.exp(nodes.points[:, 0]).sum())
        nodes = nodes.followed_by(near, from_pass(near, 16, number))
    assert (len(nodes.passes), len(nodes.points)) == (3, 48)
    densities = [stats.multivariate_normal(c, r @ r.T).pdf(nodes.points) for c, r in nodes.passes]
    np.testing.assert_allclose(np.exp(nodes.over), densities[0] / np.mean(densities, axis=0), rtol=1e-12)
    against = np.exp(nodes.against) * np.mean(densities, axis=0)
    np.testing.assert_allclose(against, against[0], rtol=1e-12)
