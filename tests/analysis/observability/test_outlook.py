"""What would make an answer better: what is predicted comes of it, and what does not help gains nothing."""

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cells import good_plan, header, pattern_plan, simulated
from plan_requests import plan_request

from zerobeam.analysis.analyse import analyse
from zerobeam.analysis.observability.aim import aim, servo_joints
from zerobeam.analysis.observability.better_postures import PostureSearch, kept, usual_constraints
from zerobeam.analysis.observability.check import Check
from zerobeam.analysis.observability.clearance import arm_in_the_way
from zerobeam.analysis.observability.outlook import (
    COVERAGE,
    POINTS,
    SIGMA_MM,
    Outlook,
    OutlookRow,
    constraint_options,
)
from zerobeam.analysis.observability.predictions import (
    ArmBelief,
    EstimatesOfArms,
    TcpForecast,
    predicted_covariance,
)
from zerobeam.analysis.status import known
from zerobeam.experiments.measuring_options import PlanOptions
from zerobeam.experiments.plans.constraints import check_plan
from zerobeam.experiments.plans.make import make_plan
from zerobeam.experiments.schema import json_schema
from zerobeam.model.files.plan import USUAL, Plan, StatedConstraints, read_plan
from zerobeam.model.instruments.kind import ON_FLANGE, Measurement
from zerobeam.model.likelihood.problem import Problem

TRACKER_PLAN = Path(__file__).parents[2] / "support" / "tracker_by_guess.yaml"
OFFSETS = {"delta2", "delta3", "delta4", "delta5"}


def outlook_of(plan: Plan) -> Outlook:
    outlook = check_plan(plan).outlook
    assert outlook is not None
    return outlook


def rows(outlook: Outlook, remedy: str) -> list[OutlookRow]:
    return [row for row in outlook.remedies if row.remedy == remedy]


def typical(shots: int = 7, **changes: object) -> Plan:
    """Of an arm within its tolerances, with a laser that is as usual."""
    return good_plan(shots, geometry=None, **changes)


@functools.cache
def usual() -> Check:
    """What is said of the plan that most tests begin with."""
    return check_plan(typical())


def usual_outlook() -> Outlook:
    assert usual().outlook is not None
    return usual().outlook


def expanded(check: Check) -> dict[str, float]:
    return {row.name: COVERAGE * row.std for row in check.parameters if row.std is not None}


def test_now_is_what_the_check_says_of_what_measurements_can_improve() -> None:
    check, now = usual(), usual_outlook().now
    assert set(now.U) == OFFSETS  # δ6 is as good as the laser's mounting: no measurement improves it
    assert pytest.approx({name: expanded(check)[name] for name in OFFSETS}, rel=1e-9) == now.U


def test_what_is_undetermined_now_and_would_rest_on_the_mounting_is_in_no_remedy() -> None:
    """Of two measurements nothing is determined: better postures determine all that measurements can."""
    check = check_plan(typical(2))
    assert check.outlook is not None
    assert {name: u for name, u in check.outlook.now.U.items() if u is not None} == {}
    for row in rows(check.outlook, "more"):
        assert set(row.U) == OFFSETS
        assert None not in row.U.values()


def test_a_mounting_that_is_measured_gives_what_the_header_then_gives() -> None:
    (row,) = rows(usual_outlook(), "mounting")
    assert row.state == {"tool.sigma.tilt_deg": 0.01}
    tool = {"kind": "laser", "point_mm": [0, 0, 65], "direction": [1, 0, 0], "sigma": {"tilt_deg": 0.01}}
    measured = expanded(check_plan(typical(tool=tool)))
    assert pytest.approx({name: measured[name] for name in row.U}, rel=1e-3) == row.U
    assert set(row.U) == OFFSETS | {"delta6"}


TRACKER = {
    "tracker": {
        "kind": "tracker",
        "guess_mm": [3000, 500, 800],
        "sigma_mm": SIGMA_MM,
        "reflectors": {"R1": {"guess_mm": list(ON_FLANGE)}},
    }
}


@pytest.mark.one_in(2)
@pytest.mark.parametrize("shots", [7, 20])
def test_points_of_a_tracker_give_what_a_plan_with_both_instruments_gives(shots: int) -> None:
    """The whole problem of laser and tracker, with place and reflector among its parameters."""
    plan = typical(shots)
    (row,) = rows(outlook_of(plan), "points")
    assert len(set(row.postures)) == POINTS
    own = header(target=(900.0, 0.0, 0.0), geometry=None, instruments=TRACKER)
    laser, at = Problem.from_plan(plan), list(row.postures)
    x = laser.nominal()
    joints = np.concatenate([check_joints(laser, x), check_joints(laser, x)[at]])
    measured = [[Measurement("tool", "", "psd", {})]] * shots + [[Measurement("tracker", "R1", None, {})]] * 4
    problem = Problem.of_measured(own, plan.robot, joints, measured, planned=True)
    problem = problem.at_predicted(problem.nominal())
    variances = np.diag(predicted_covariance(problem, problem.nominal()))
    items = [item for item in problem.parameters.items if not item.held]
    expected = {
        item.name: COVERAGE * np.sqrt(variance) * item.prior_std * item.display
        for item, variance in zip(items, variances, strict=True)
        if item.name in row.U
    }
    assert pytest.approx(expected, rel=0.01) == row.U


def check_joints(problem: Problem, x: np.ndarray) -> np.ndarray:
    """As a check aims them."""
    return aim(problem, x, servo_joints(problem)).problem.joints


def test_no_points_are_proposed_to_who_measures_points() -> None:
    assert rows(outlook_of(read_plan(TRACKER_PLAN)), "points") == []


def test_what_rests_on_an_exact_tool_is_never_said_to_be_improved() -> None:
    """Of an arm and a tool that are taken as exact δ6 is assumed, and no measurement changes that."""
    outlook = outlook_of(good_plan(7))
    assert all(set(row.U) == OFFSETS for row in (outlook.now, *outlook.remedies))
    assert rows(outlook, "mounting") == []
    # What is not entered is no error that the values for the other joints are distorted by.
    assert max(row.tcp_95_mm or np.inf for row in rows(outlook, "more")) < 0.5


def test_under_the_x_pattern_more_of_the_same_gains_nothing_of_joint_2() -> None:
    outlook = outlook_of(pattern_plan("x", geometry=None))
    assert outlook.now.U["delta2"] is None
    assert outlook.now.tcp_95_mm is None
    assert all(row.U["delta2"] is None for row in rows(outlook, "repeat"))
    assert all(row.gain < 0.1 for row in rows(outlook, "repeat"))
    (better,) = rows(outlook, "postures")
    assert better.U["delta2"] is not None
    assert better.gain > 0.9
    assert better.tcp_95_mm is not None


def test_more_measurements_are_better_and_links_are_the_floor() -> None:
    outlook = usual_outlook()
    twelve, twenty = sorted(rows(outlook, "more"), key=lambda row: row.shots)
    assert (twelve.shots, twenty.shots) == (12, 20)
    assert twelve.minutes == 28  # a person takes two minutes with a laser; two postures are measured again
    for name in OFFSETS:
        assert twenty.U[name] < twelve.U[name] < outlook.now.U[name]  # type: ignore[operator]
    (links,) = rows(outlook, "links")
    assert links.tcp_95_mm == outlook.now.links_95_mm
    assert twenty.links_95_mm < 0.6 * twenty.tcp_95_mm  # type: ignore[operator]
    # Offsets alone leave what links do to the TCP, at any number of measurements.
    assert twenty.tcp_median_mm == pytest.approx(twelve.tcp_median_mm, rel=0.1)


@pytest.mark.long
def test_better_postures_are_about_as_good_as_those_of_the_command() -> None:
    """Of 2000 candidates; the command has 10,000 (the long test)."""
    (better,) = rows(usual_outlook(), "postures")
    made = make_plan(plan_request(header=typical().header, shots=7, candidates=2000), None, lambda *_: None)
    assert made.checked is not None
    reached = expanded(made.checked)
    ratio = [reached[name] / (better.U[name] or 0.0) for name in OFFSETS]
    assert 0.75 < np.median(ratio) < 1.3


def test_of_a_run_the_answer_as_it_is_has_the_error_of_its_values() -> None:
    _, run = simulated(typical(12), {"delta2": 0.5, "delta3": -0.3, "delta4": 0.4, "delta5": 0.2})
    found = analyse(run, sampling="never")
    result, problem, parameters = found.result, found.problem, found.problem.parameters
    assert result.outlook is not None
    assert result.entered is not None
    assert result.entered.tcp_after is not None
    now = result.outlook.now
    assert now.tcp_median_mm == result.entered.tcp_after.median_mm
    assert now.tcp_95_mm == result.entered.tcp_after.p95_mm
    assert result.entered_geometry is not None
    assert result.entered_geometry.tcp_after is not None
    assert now.links_95_mm == result.entered_geometry.tcp_after.p95_mm
    # The linear forecast, by which the remedies are predicted, agrees with it.
    mean = ((found.fit.x - parameters.prior_mean) / parameters.prior_std)[parameters.free]
    known_now = np.array([known(status) for status in found.status])[parameters.free]
    tcp, links = TcpForecast(problem, found.fit.x, found.status).errors(
        EstimatesOfArms.made(ArmBelief(problem, mean, found.fit.covariance)), known_now
    )
    assert tcp == pytest.approx((now.tcp_median_mm, now.tcp_95_mm), rel=0.02)
    assert links == pytest.approx((now.links_median_mm, now.links_95_mm), rel=0.02)
    assert {row.remedy for row in result.outlook.remedies} >= {"more", "mounting"}


def test_the_next_postures_are_those_of_the_pool_that_lower_the_error_most() -> None:
    """By the inverse of the information, posture by posture; and clear of the arm."""
    plan = good_plan(7, geometry=None)
    found = analyse(simulated(plan, {"delta2": 0.5})[1], sampling="never")
    outlook = found.result.outlook
    assert outlook is not None
    assert outlook.u_mm is not None
    errors = [outlook.u_mm, *(each.u_mm for each in outlook.next_postures)]
    assert len(errors) == 4
    assert errors == sorted(errors, reverse=True)
    problem, x, entries = found.problem, found.fit.x, plan.header.targets
    constraints = usual_constraints(problem, x)
    search = PostureSearch(
        problem, x, entries, lambda shots: kept(constraints, shots, x, entries), 1 / found.noise_scale**2
    )
    square = TcpForecast(problem, x, found.status).mean_square
    assert outlook.u_mm == pytest.approx(np.sqrt(np.trace(found.fit.covariance @ square)))
    information = np.linalg.inv(found.fit.covariance)
    for posture in outlook.next_postures:
        tried = [np.trace(np.linalg.inv(information + root.T @ root) @ square) for root in search.pool.roots]
        best = int(np.argmin(tried))
        assert posture.u_mm == pytest.approx(np.sqrt(tried[best]), rel=1e-6)
        assert posture.joints == pytest.approx(search.pool.joints[best] * problem.robot.display, abs=1e-3)
        information = information + search.pool.roots[best].T @ search.pool.roots[best]
    for postures in (search.pool, *search.best([7, 12]).values()):
        shots = search.problem.select(postures.like).moved(postures.joints)
        assert not arm_in_the_way(shots, x, entries).any()


def test_no_next_posture_is_said_where_no_error_is_known() -> None:
    result = analyse(simulated(pattern_plan("x", geometry=None))[1], sampling="never").result
    assert result.outlook is not None
    assert (result.outlook.u_mm, result.outlook.next_postures) == (None, ())
    assert usual_outlook().next_postures == ()


@pytest.mark.one_in(3)
@pytest.mark.parametrize(("required", "reachable"), [(0.1, False), (4.0, True), (None, None)])
def test_what_is_required_is_within_reach_or_not(required: float | None, reachable: bool | None) -> None:
    changes = {} if required is None else {"required": {"tcp_mm": required}}
    outlook = outlook_of(typical(**changes))
    assert outlook.reachable is reachable


def test_the_options_are_those_by_which_the_command_keeps_the_constraints() -> None:
    assert constraint_options(USUAL) == ()
    options = PlanOptions()
    usual = (options.facing, options.acceptance_deg, options.beam_mm, options.margin_deg)
    assert usual == (USUAL.facing, USUAL.acceptance, USUAL.beam_mm, USUAL.margin_deg)
    kept = StatedConstraints(beam_mm=(300.0, 900.0), margin_deg=10.0)
    assert constraint_options(kept) == ("--facing=any", "--beam=300,900", "--margin=10")
    kept = StatedConstraints(facing=(1.0, 0.0, 0.0), acceptance_deg=45.0, beam_mm=(200.0, 2000.0))
    assert constraint_options(kept) == ("--facing=1,0,0", "--acceptance=45")


@pytest.mark.long
def test_new_postures_keep_the_constraints_of_the_plan() -> None:
    """With beams that are hardly possible there is little to choose from, and less to gain."""
    plan = typical()
    free = min(row.gain for row in rows(usual_outlook(), "more"))
    narrow = replace(plan, constraints=StatedConstraints(beam_mm=(700.0, 760.0), margin_deg=5.0))
    outlook = check_plan(narrow).outlook
    assert outlook is not None
    more = rows(outlook, "more")
    assert all("--beam=700,760" in row.options for row in more)
    assert not more or min(row.gain for row in more) < free


def test_the_schema_says_what_each_key_is() -> None:
    row = json_schema("check")["$defs"]["OutlookRow"]["properties"]
    assert all(
        "description" in row[key] for key in ("remedy", "U", "gain", "links_95_mm", "options", "state")
    )
