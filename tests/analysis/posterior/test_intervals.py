"""The parts of the answer that stand beside the estimates: intervals by three ways, robust, held out."""

import dataclasses
import json

import numpy as np
import pytest
from cells import (
    TABLE_2,
    good_plan,
    header,
    irb1600,
    placed_plan,
    plan_of,
    run_of,
    simulated,
)
from scipy import stats

from zerobeam.analysis import analyse as module
from zerobeam.analysis.analyse import analyse
from zerobeam.analysis.diagnostics import outliers
from zerobeam.analysis.estimation.fit import fit_likelihood
from zerobeam.analysis.posterior import profiles
from zerobeam.analysis.posterior.posterior import UNSAMPLED
from zerobeam.analysis.posterior.profiles import profile_intervals
from zerobeam.analysis.solution import solve
from zerobeam.experiments.plans.patterns import pattern
from zerobeam.model.kernel import compiled_at_once
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.finding_words import notes
from zerobeam.words.sentences import to_json

HALF = float(stats.norm.ppf(0.975))


def short_pattern(**changes):
    """Seven shots of the Y-Pattern over 0.4 of the reach: weak."""
    position = np.array([900.0, 150.0, 0.0])
    made_header = header(target=position, **changes)
    return plan_of(made_header, pattern(made_header, irb1600(), position, "y", 7, span=0.4))


@pytest.fixture(scope="module")
def weak():
    _, run = simulated(short_pattern(), TABLE_2, seed=3)
    return run, analyse(run, ess=1000).result


@pytest.fixture(scope="module")
def two_targets():
    places = {"a": (900.0, 0.0, 0.0), "b": (800.0, 300.0, 100.0)}
    return simulated(placed_plan(places, {"a": 8, "b": 8}), TABLE_2, seed=3)[1]


@pytest.mark.long
def test_weak_parameters_are_told_by_all_three_ways(weak):
    run, result = weak
    statuses = {row.name: row.status for row in result.parameters}
    answer = {row.name: row for row in result.intervals}
    assert [name for name in answer if statuses[name] == "weak"] == [
        name for name, status in statuses.items() if status == "weak" and "." not in name
    ]
    assert any(status == "weak" for status in statuses.values())
    problem = Problem.from_run(run)
    fit = fit_likelihood(problem)
    for name, row in answer.items():
        i = problem.parameters.index(name)
        ends = np.degrees(profile_intervals(problem, fit, np.array([i]), HALF)[0])
        values = next(each for each in result.parameters if each.name == name)
        drawn = next(each for each in result.posterior.parameters if each.name == name)
        assert row.unit == "deg"
        assert row.linear == values.interval95
        assert row.profile == pytest.approx(tuple(ends))
        assert row.posterior == (drawn.q2_5, drawn.q97_5)
        width = row.linear[1] - row.linear[0]
        off = max(
            abs(end - straight)
            for way in (row.profile, row.posterior)
            for end, straight in zip(way, row.linear, strict=True)
        )
        assert row.differ == (off > 0.1 * width)


def test_the_three_ways_are_about_the_same_thing(weak):
    """Each end within a quarter of the width of the others': the ridge is bent and no more."""
    _, result = weak
    for row in result.intervals:
        width = row.linear[1] - row.linear[0]
        np.testing.assert_allclose(np.array([row.profile, row.posterior]), [row.linear] * 2, atol=width / 4)


def test_on_a_good_run_there_is_nothing_to_tell():
    _, run = simulated(good_plan(12), TABLE_2, seed=2)
    result = analyse(run, ess=2000).result
    assert {row.status for row in result.parameters} == {"held", "identified", "assumed"}
    assert result.intervals == ()


@pytest.mark.long
def test_intervals_that_differ_are_told_of_identified_ones_too(monkeypatch):
    """Made so: ends of the profile that are off by 0.2 of the width, then by 0.05."""
    _, run = simulated(good_plan(12), TABLE_2, seed=2)
    real = profiles.profile_intervals
    for off, names in ((0.2, ["delta2"]), (0.05, [])):

        def moved(problem, fit, which, half, dof, off=off):
            ends = real(problem, fit, which, half, dof)
            ends[0] += off * np.diff(ends[0])
            return ends

        monkeypatch.setattr(profiles, "profile_intervals", moved)
        result = analyse(run, ess=4000).result
        assert [row.name for row in result.intervals if row.differ] == names


def test_with_an_estimated_noise_the_profile_is_that_of_each_offsets_own_degrees_of_freedom():
    """A nearly linear fit with tolerances, which do not scale with the noise: its ends are those by the
    curvature. Six degrees of freedom would make them wrong."""
    noise = {"joint_deg": 0.01, "spot_mm": 0.05, "scale": "estimated"}
    _, run = simulated(good_plan(30, noise=noise, geometry=None), TABLE_2, seed=2)
    solution = solve(Problem.from_run(run))
    which = np.array([i for i in solution.known if solution.parameters[i].group == "offset"], dtype=int)
    assert len(which) == 5
    linear = np.diff(np.array([solution.parameters[i].interval95 for i in which]))[:, 0]

    def widths(dof):
        ends = profile_intervals(solution.problem, solution.fit, which, solution.quantiles[which], dof)
        return np.degrees(np.diff(ends)[:, 0])

    np.testing.assert_allclose(widths(solution.effective_dof[which]), linear, rtol=0.005)
    assert np.all(np.abs(widths(6.0) / linear - 1) > 0.03)


def test_an_end_that_was_not_found_is_said(monkeypatch):
    _, run = simulated(good_plan(12), TABLE_2, seed=2)
    monkeypatch.setattr(
        profiles, "profile_intervals", lambda problem, fit, which, *_: np.full((len(which), 2), np.nan)
    )
    result = analyse(run, ess=400).result
    assert [row.name for row in result.intervals] == [f"delta{i}" for i in range(2, 7)]
    for row in result.intervals:
        assert row.profile is None
        assert row.differ
        assert row.linear[0] < row.linear[1]


def test_with_separate_noise_there_is_no_profile(monkeypatch):
    """The fit is at the marginal mode of the noise: a profile from there would start off its top. (The
    posterior, which has no part in that, is left out.)"""
    monkeypatch.setattr(module, "sample_posterior", lambda *args, **kwargs: (UNSAMPLED, None))
    _, run = simulated(short_pattern(noise={"scale": "separate"}), TABLE_2, seed=3)
    result = analyse(run, ess=400).result
    assert len(result.intervals) > 0
    assert [row.profile for row in result.intervals] == [None] * len(result.intervals)
    known = {row.name for row in result.parameters if row.estimate is not None}
    assert {row.name for row in result.intervals} <= known


def test_what_cannot_be_told_has_no_interval():
    """Joint 1 freed, and an X-Pattern that cannot tell joints 2 and 3 apart."""
    _, run = simulated(good_plan(10, held=[]), TABLE_2, seed=2)
    result = analyse(run, ess=400, robust="student").result
    unknown = {row.name for row in result.parameters if row.status == "unidentifiable"}
    assert "delta1" in unknown
    assert not unknown & {row.name for row in result.intervals}
    for row in result.robust.parameters:
        assert (row.estimate is None) == (row.name in unknown)


def test_a_run_of_which_no_offset_is_known_is_answered(monkeypatch):
    """Two shots: four numbers, nothing that could have an interval. The slow posterior is left out."""
    monkeypatch.setattr(module, "sample_posterior", lambda *args, **kwargs: (UNSAMPLED, None))
    _, run = simulated(good_plan(2), TABLE_2, seed=2)
    result = analyse(run, ess=400, robust="huber").result
    assert result.verdict == "degenerate"
    assert {row.status for row in result.parameters if row.group == "offset"} == {"held", "unidentifiable"}
    assert result.intervals == ()
    assert {row.std for row in result.robust.parameters} == {None}


@pytest.mark.long
def test_a_robust_fit_is_there_when_asked_for():
    _, run = simulated(good_plan(12), TABLE_2, seed=3)
    assert analyse(run, ess=400).result.robust is None
    for loss in ("huber", "student"):
        result = analyse(run, ess=400, robust=loss).result
        answer, rows = result.robust, {row.name: row for row in result.parameters}
        assert answer.loss == loss
        assert answer.converged
        assert len(answer.weights) == 12
        assert answer.outliers == ()
        quantile = stats.t.ppf(0.975, 24 - 8)
        for row in answer.parameters:
            assert row.unit == rows[row.name].unit
            assert abs(row.estimate - rows[row.name].estimate) < rows[row.name].std
            half = (row.interval95[1] - row.interval95[0]) / 2
            assert half == pytest.approx(quantile * row.std)
            assert np.mean(row.interval95) == pytest.approx(row.estimate)


def test_a_robust_fit_that_did_not_settle_has_no_numbers(monkeypatch):
    _, run = simulated(good_plan(12), TABLE_2, seed=3)
    real = outliers.fit_robust
    monkeypatch.setattr(
        outliers,
        "fit_robust",
        lambda *args: dataclasses.replace(real(*args), converged=False, reason="the weights did not settle"),
    )
    result = analyse(run, sampling="never", robust="huber").result
    for row in result.robust.parameters:
        assert (row.estimate, row.std, row.interval95) == (None, None, None)
    assert result.robust.outliers == ()
    assert any("did not converge" in note for note in notes(result))


@pytest.mark.long
def test_held_out_targets_are_in_the_answer_and_leave_it_alone(two_targets):
    with compiled_at_once():  # to the last bit
        calm = analyse(two_targets, ess=400).result
        answer = analyse(two_targets, ess=400, held_out=["b"]).result
    assert calm.hold_out is None
    assert answer.hold_out.targets == ("b",)
    assert (answer.hold_out.shots, answer.hold_out.shots_fitted) == (8, 8)
    assert answer.hold_out.p_value > 1e-3
    assert answer.findings == calm.findings
    assert answer.parameters == calm.parameters


def test_offsets_that_do_not_carry_over_are_noted(two_targets):
    """Joint 3 slips by 0.5 degrees between the two targets."""
    shots = [
        shot.model_copy(
            update={"joints_deg": (*shot.joints_deg[:2], shot.joints_deg[2] + 0.5, *shot.joints_deg[3:])}
        )
        if shot.target == "b"
        else shot
        for shot in two_targets.shots
    ]
    result = analyse(run_of(two_targets.header, shots), sampling="never", held_out=["b*"]).result
    assert result.hold_out.p_value < 1e-3
    assert any(note.startswith("At the held-out targets (b)") for note in notes(result))


def test_a_name_that_is_not_there_is_said_before_the_long_part(two_targets, refused):
    message = []
    error = refused(analyse, two_targets, held_out=["c"], progress=lambda stage, share: message.append(stage))
    assert error.found == "c"
    assert str(two_targets.path) in str(error)
    assert set(message) <= {"fit"}


@pytest.mark.long
def test_one_seed_gives_the_same_file_twice(two_targets):
    """The JSON, bytes and all, but for the seconds of the sampling."""

    def told(seed):
        answer = to_json(analyse(two_targets, seed=seed, ess=400, robust="student", held_out=["b"]).result)
        seconds = answer["posterior"].pop("seconds")
        assert seconds > 0
        return json.dumps(answer, sort_keys=True)

    first = told(3)
    assert told(3) == first
    assert told(4) != first
