"""What a plan promises: with fewer shots, with the target elsewhere, with one change. Each told once more."""

from __future__ import annotations

import numpy as np
import pytest
from cells import PROBE, good_plan, header, irb1600, pattern_plan, plan_of

from zerobeam.analysis.observability.aim import aim, servo_joints
from zerobeam.analysis.observability.check import Check, check
from zerobeam.analysis.observability.predictions import over_target, predicted_std
from zerobeam.model.files.plan import Plan
from zerobeam.model.likelihood.problem import Problem


def worst(plan: Plan) -> float:
    """The largest std (deg) of a free offset, priors included, from the plain normal matrix."""
    problem = Problem.from_plan(plan)
    x = problem.nominal()
    free = problem.parameters.free
    shots = aim(problem, x, servo_joints(problem)).problem
    jacobian = shots.whiten(x).jacobian[:, free]
    covariance = np.linalg.inv(jacobian.T @ jacobian + np.eye(int(free.sum())))
    std = np.sqrt(np.diag(covariance)) * problem.parameters.prior_std[free]
    return float(np.degrees(std[problem.parameters.group("offset")[free]].max()))


def promised(answer: Check) -> list[tuple[int, float]]:
    return [(point.shots, point.worst_std) for point in answer.curve]


@pytest.mark.parametrize("case", ["good", "x"])
def test_the_curve_is_that_of_fewer_shots(case: str) -> None:
    plan = good_plan() if case == "good" else pattern_plan("x")
    told = promised(check(plan))
    assert [shots for shots, _ in told] == list(range(2, len(plan.postures) + 1))
    for shots, value in told:
        assert value == pytest.approx(worst(plan_of(plan.header, plan.postures[:shots])), rel=1e-6)
    values = [value for _, value in told]
    assert (np.diff(values) <= 1e-9).all()
    # A gauge stays at its prior however many shots there are; a good plan does not.
    assert (values[-1] > 4.99) == (case == "x")
    assert (values[-1] < 0.1) == (case == "good")


def test_the_curve_is_in_the_order_of_the_plan() -> None:
    plan = good_plan()
    turned = promised(check(plan_of(plan.header, plan.postures[::-1])))
    told = promised(check(plan))
    assert turned[-1][1] == pytest.approx(told[-1][1], rel=1e-9)
    assert turned[2][1] != pytest.approx(told[2][1], rel=1e-3)


def stated(sigma: float | None) -> Plan:
    place = {"guess_mm": [900, 0, 0]} | ({} if sigma is None else {"sigma_mm": sigma})
    return plan_of(header(targets={"psd": place}), good_plan().postures)


def test_over_where_the_target_may_stand() -> None:
    assert check(stated(None)).over_target is None
    answers = {sigma: check(stated(sigma)) for sigma in (0.01, 100.0)}
    for answer in answers.values():
        assert answer.over_target.draws > 10
        assert 0 < answer.over_target.hit <= 1
        assert set(answer.over_target.worst_std) == {f"delta{i}" for i in range(2, 7)}
    near, far = answers[0.01], answers[100.0]
    assert near.over_target.hit == 1.0
    for row in near.parameters:
        if row.group == "offset" and not row.held:
            assert near.over_target.worst_std[row.name] == pytest.approx(row.std, rel=1e-3)
    # The worst of many places is no better than the guess, for some offset clearly worse.
    own = {row.name: row.std for row in far.parameters if row.std is not None}
    ratios = [value / own[name] for name, value in far.over_target.worst_std.items()]
    assert min(ratios) > 0.95
    assert max(ratios) > 1.1


def test_targets_out_of_reach_are_told() -> None:
    problem = Problem.from_plan(good_plan())
    spread = np.where(problem.parameters.group("target"), 1e-9, 0.0)
    whole = over_target(problem, problem.nominal(), spread)
    assert whole.hit == 1.0
    assert over_target(problem, problem.nominal(), np.zeros(len(spread))) is None


def changed(plan: Plan, answer: Check) -> Plan:
    """The plan with the advice carried out, from the postures as they are aimed."""
    advice = answer.advice
    problem = Problem.from_plan(plan)
    joints = aim(problem, problem.nominal(), servo_joints(problem)).problem.joints
    new = joints[advice.posture].copy()
    new[advice.joint - 1] += np.radians(advice.change_deg)
    kept = joints if advice.add else np.delete(joints, advice.posture, axis=0)
    return plan_of(plan.header, np.vstack([kept, new]))


@pytest.mark.parametrize("case", ["x", "x aside", "y"])
@pytest.mark.one_in(3)
def test_the_advice_does_what_it_says(case: str) -> None:
    plan = {"x": pattern_plan("x"), "x aside": pattern_plan("x", 400.0), "y": pattern_plan("y")}[case]
    before = check(plan)
    if case.startswith("x"):
        assert before.advice.joint == 1
        assert before.advice.worst_std_before is None  # 5° is the prior, and no u
    else:
        assert before.advice.worst_std_before == pytest.approx(before.curve[-1].worst_std, rel=1e-6)
    other = changed(plan, before)
    assert (other.postures >= irb1600().lower).all()
    assert (other.postures <= irb1600().upper).all()
    after = check(other)
    assert after.curve[-1].worst_std == pytest.approx(before.advice.worst_std_after, rel=0.02)
    assert before.advice.worst_std_after < 0.8 * before.curve[-1].worst_std
    assert named_std(after) == pytest.approx(before.advice.worst_std_after, rel=0.02)


def named_std(answer: Check) -> float:
    """The worst std in the table itself; all offsets are told."""
    stds = [row.std for row in answer.parameters if row.group == "offset" and not row.held]
    assert all(std is not None for std in stds)
    return max(std for std in stds if std is not None)


def test_no_advice_for_a_good_plan() -> None:
    answer = check(good_plan())
    assert answer.verdict == "pass"
    assert answer.advice is None


def test_a_mirrored_cell_has_the_mirrored_advice() -> None:
    """The arm is its own mirror image in the plane of x and z: what turned one way there turns the other."""
    plan = pattern_plan("x", 400.0)
    x, y, z = plan.header.targets["psd"].guess_mm or (0.0, 0.0, 0.0)
    mirrored = plan_of(header(target=(x, -y, z)), plan.postures * [-1, 1, 1, -1, 1, -1])
    one, other = check(plan).advice, check(mirrored).advice
    assert one is not None
    assert other is not None
    assert (one.joint, one.posture) == (other.joint, other.posture)
    assert other.change_deg == -one.change_deg


def test_the_targets_elsewhere_one_by_one() -> None:
    """Some of them out of reach of some postures."""
    problem = Problem.from_plan(plan_of(header(PROBE), good_plan().postures))
    spread = np.where(problem.parameters.group("target"), 250.0, 0.0)
    x = problem.nominal()
    told = over_target(problem, x, spread)
    assert told is not None
    assert told.hit < 1
    largest = dict.fromkeys(told.worst_std, 0.0)
    for place in x + spread * np.random.default_rng(1).normal(size=(told.draws, len(x))):
        aimed = aim(problem, place, servo_joints(problem))
        std = predicted_std(aimed.problem.select(np.flatnonzero(aimed.hit)), place)
        items = [item for item in problem.parameters.items if not item.held]
        for item, value in zip(items, std, strict=True):
            if item.group == "offset":
                largest[item.name] = max(largest[item.name], value * item.prior_std * item.display)
    assert told.worst_std == pytest.approx(largest, rel=1e-6)


def test_a_target_that_no_posture_reaches_leaves_the_prior() -> None:
    problem = Problem.from_plan(plan_of(header(PROBE), good_plan().postures))
    spread = np.where(problem.parameters.group("target"), 3000.0, 0.0)
    told = over_target(problem, problem.nominal(), spread)
    assert told is not None
    assert told.worst_std == pytest.approx(dict.fromkeys(told.worst_std, 5.0))
