import json
import warnings

import numpy as np
import pytest
from cells import AXIS_LASER, TABLE_2, good_plan, header, pattern_plan, plan_of, simulated

from zerobeam.analysis.analyse import analyse
from zerobeam.analysis.observability.aim import aim, aim_plan, servo_joints
from zerobeam.analysis.observability.check import Check, check
from zerobeam.model import kernel
from zerobeam.model.files.header import StatedGeometry
from zerobeam.model.likelihood import constraint
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.message import headline
from zerobeam.words.observability import reason
from zerobeam.words.plan_catalogue import check_notes
from zerobeam.words.sentences import to_json


def rows(answer):
    return {row.name: row for row in answer.parameters}


def test_a_good_plan():
    answer = check(good_plan())
    assert answer.verdict == "pass"
    assert headline(answer) == (
        "delta2, delta3, delta4 and delta5 are identified. delta6 is as good as the laser's mounting: that it"
        " is exactly as stated is assumed, not measured."
    )
    assert check_notes(answer) == ()
    first = rows(answer)["delta1"]
    assert (first.status, first.held, first.data_std, first.std) == ("held", True, None, None)
    assert "base frame" in reason(first.cause)
    for name, row in rows(answer).items():
        if name != "delta1":
            assert row.status == ("assumed" if name == "delta6" else "identified")
            assert (row.cause is None) == (name != "delta6")
            # The prior can only add to what the data say, and adds next to nothing here.
            assert 0.99 * row.data_std < row.std <= row.data_std * (1 + 1e-9)


@pytest.mark.parametrize("case", ["good", "y", "x aside"])
@pytest.mark.one_in(3)
def test_what_was_promised_is_what_comes(case):
    """The std before the shots against the std after them, with the true offsets of Table 2: 20 %."""
    plan = {
        "good": good_plan(),
        "y": pattern_plan("y"),
        "x aside": pattern_plan("x", 400.0),
    }[case]
    before = rows(check(plan))
    result = analyse(simulated(plan, TABLE_2, seed=3)[1], sampling="never").result
    compared = 0
    for after in result.parameters:
        if after.group == "offset" and after.std is not None and before[after.name].std is not None:
            assert after.std == pytest.approx(before[after.name].std, rel=0.2)
            compared += 1
    assert compared >= 4


def test_what_an_offset_is_confounded_with_is_the_largest_correlation():
    """By the inverse of the information, in numpy alone."""
    plan = good_plan()
    plan = plan_of(plan.header.model_copy(update={"geometry": StatedGeometry()}), plan.postures)
    turned = aim_plan(plan)
    problem = turned.problem
    jacobian = problem.whiten(turned.x).jacobian[:, problem.parameters.free]
    covariance = np.linalg.inv(jacobian.T @ jacobian + np.eye(jacobian.shape[1]))
    std = np.sqrt(np.diag(covariance))
    names = [item.name for item in problem.parameters.items if not item.held]
    found = Check.of(turned).geometry.confounded
    assert {row.offset for row in found} == {f"delta{i}" for i in range(2, 7)}
    for row in found:
        own = names.index(row.offset)
        correlation = covariance[own] / (std * std[own])
        group = ("tool",) if row.parameter.startswith("tool") else ("link", "joint")
        rivals = [k for k, name in enumerate(names) if name.startswith(group)]
        most = max(rivals, key=lambda k: abs(correlation[k]))
        assert names[most] == row.parameter
        assert row.correlation == pytest.approx(correlation[most], rel=1e-6)
    assert check(good_plan()).geometry.confounded == ()


def test_how_far_each_posture_is_off():
    plan = good_plan()
    postures = plan.postures.copy()
    postures[3, 4] += np.radians(2.0)
    answer = check(plan_of(plan.header, postures))
    off = [posture.off_mm for posture in answer.postures]
    problem = Problem.from_plan(plan_of(plan.header, postures))
    miss, _ = problem.linearise(problem.nominal())
    np.testing.assert_allclose(off, np.linalg.norm(miss, axis=1), atol=1e-9)
    assert off[3] > 5
    assert max(off[:3] + off[4:]) < 1e-6
    assert all(posture.hit for posture in answer.postures)
    assert [posture.posture for posture in answer.postures] == list(range(10))
    # Turned onto the target it is nearly the plan that it was.
    assert answer.verdict == "pass"


def test_without_a_guess_the_beams_say_where_the_target_is():
    plan = good_plan()
    bare = plan_of(header(target=None), plan.postures)
    told, guessed = rows(check(bare)), rows(check(plan))
    for name in ("delta2", "delta5"):
        assert told[name].data_std == pytest.approx(guessed[name].data_std, rel=1e-6)


def test_a_posture_from_which_the_target_cannot_be_hit():
    """A laser far off the axis of the wrist passes by a target that is nearer to the wrist than it."""
    tool = {"kind": "laser", "point_mm": [0, 400, 0], "direction": [1, 0, 0]}
    plan = good_plan(8)
    wrist_centre, _ = Problem.from_plan(plan_of(header(AXIS_LASER), plan.postures[2:3])).beams(np.zeros(9))
    own = header(tool, target=(wrist_centre[0] + [30.0, 0.0, 40.0]).tolist())
    answer = check(plan_of(own, plan.postures))
    missed = [p.posture for p in answer.postures if not p.hit]
    assert 2 in missed
    assert len(missed) < 4
    named = " and ".join(map(str, missed))
    assert (
        check_notes(answer)[0]
        == f"From posture {named} the target cannot be hit: no measurement is counted there"
    )
    rest = check(plan_of(own, np.delete(plan.postures, missed, axis=0)))
    for row, other in zip(answer.parameters, rest.parameters, strict=True):
        assert row.status == other.status
        assert row.data_std == (other.data_std and pytest.approx(other.data_std, rel=1e-6))


def test_no_posture_at_all_can_hit(refused):
    tool = {"kind": "laser", "point_mm": [0, 400, 0], "direction": [1, 0, 0]}
    plan = good_plan()
    place, _ = Problem.from_plan(plan_of(header(AXIS_LASER), plan.postures[:1])).beams(np.zeros(9))
    own = header(tool, target=(place[0] + [30.0, 0.0, 40.0]).tolist())
    error = refused(check, plan_of(own, np.repeat(plan.postures[:1], 4, axis=0)))
    assert "no posture of the plan can be rotated onto its target" in str(error)


def test_a_joint_turned_beyond_its_limits_is_noted():
    """A target behind the laser: the wrist has to turn right over."""
    plan = good_plan()
    own = header(target=(-900.0, 0.0, 900.0))
    answer = check(plan_of(own, plan.postures))
    beyond = [note for note in check_notes(answer) if "outside" in note]
    problem = Problem.from_plan(plan_of(own, plan.postures))
    turned = aim(problem, problem.nominal(), servo_joints(problem)).problem.joints
    outside = (turned < plan.robot.lower) | (turned > plan.robot.upper)
    assert outside.any()
    assert len(beyond) == outside.sum()
    i, j = np.argwhere(outside)[0]
    assert beyond[0].startswith(f"Rotated onto the target, joint {j + 1} of posture {i} is at")


def test_no_compiler_is_asked_for(monkeypatch):
    plan = good_plan()
    monkeypatch.setattr(kernel, "_compiler", lambda: None)
    monkeypatch.setattr(constraint, "_made", {})  # what is made in here stays in here
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert check(plan).verdict == "pass"


def test_as_json():
    answer = to_json(check(pattern_plan("x")))
    text = json.dumps(answer, allow_nan=False)
    assert answer["schema"] == "zerobeam/check/1"
    again = json.loads(text)
    delta2 = next(row for row in again["parameters"] if row["name"] == "delta2")
    assert delta2["data_std"] is None
    assert delta2["std"] is None
    assert again["verdict"] == "degenerate"
    assert again["headline"].startswith(
        "delta2 is unidentifiable from these measurements: joint 1 does not change"
    )
    assert again["inputs"]["plan"] == "plan.yaml"
    null = again["identifiability"]["null_space"][0]
    assert null["kind"] == "exact"
    assert "vary joint 1" in null["remedy"]
