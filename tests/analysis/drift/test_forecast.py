"""The interval between the results, against the smoother at the same time; the due date, against draws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drifting import steady

from zerobeam.analysis.drift.drift import Drift, drift, mixture_interval
from zerobeam.analysis.drift.forecast import HORIZON_YEARS, bands, due_after
from zerobeam.analysis.drift.smoother import Observation, smooth


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
