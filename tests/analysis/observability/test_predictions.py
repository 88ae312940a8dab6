"""What a plan promises: with fewer shots, with the target elsewhere. Each told once more."""

import numpy as np
import pytest
from cells import PROBE, good_plan, header, pattern_plan, plan_of

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
