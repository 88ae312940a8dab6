import numpy as np
from cells import AXIS_LASER, OPEN_LASER, OPEN_PROBE, good_plan, header, pattern_plan, plan_of, random_robot

from zerobeam.analysis.observability.mechanisms import mechanisms, too_few_measurements
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.observability import reason, remedy


def told(plan):
    """{names that move together: (reason, remedy)} of the mechanisms thought of for these shots."""
    problem = Problem.from_plan(plan)
    names = np.array(problem.parameters.names)
    return {tuple(names[m.support]): (reason(m.cause), remedy(m.cause)) for m in mechanisms(problem)}


TARGET = ("psd.x", "psd.y", "psd.z")


def test_what_is_thought_of_for_a_calibrated_laser():
    found = told(good_plan())
    assert TARGET in found
    assert ("delta6",) in found
    for i in range(2, 7):
        assert (f"delta{i}", *TARGET) in found
    assert ("delta1", *TARGET) not in found  # held: it can explain nothing


def test_the_base_frame_only_where_delta1_is_free():
    why, what = told(good_plan(held=[]))["delta1", *TARGET]
    assert "base frame" in why
    assert "hold delta1" in what


def test_an_open_tool():
    tool = ("tool.tilt1", "tool.tilt2", "tool.shift1", "tool.shift2")
    held = told(good_plan(12, 5, OPEN_LASER))
    assert ("delta6", *tool) not in held
    assert (*TARGET, *tool) in held
    freed = told(good_plan(12, 5, OPEN_LASER, held=["delta1"]))
    assert "uncalibrated laser" in freed["delta6", *tool][0]
    probe = told(good_plan(12, 5, OPEN_PROBE))
    assert "free probe tip" in probe["delta6", "tool.x", "tool.y", "tool.z"][0]


def test_what_lies_on_the_last_axis_is_named():
    assert told(good_plan(12, 5, AXIS_LASER))["delta6",][0].startswith("the beam lies on or near")
    assert told(good_plan(12, 5, OPEN_PROBE))["delta6",][0].startswith("the probe tip lies on or near")


def test_how_much_the_joints_before_vary():
    plan = pattern_plan("x")
    why, what = told(plan)["delta2", *TARGET]
    assert why.startswith("joint 1 does not change over the measurements")
    assert "X-Pattern" in why
    assert what == "vary joint 1 by 30° or more between measurements"
    # Joint 2 does change: the same thing about joint 3 has another reason.
    assert told(plan)["delta3", *TARGET][0].startswith(
        "a rotation about the axis of joint 3 moves the target nearly"
    )
    postures = plan.postures.copy()
    postures[0, 0] += np.radians(4.0)
    why, _ = told(plan_of(plan.header, postures))["delta2", *TARGET]
    assert why.startswith("joint 1 varies by no more than 4.0°")
    postures[0, 0] += np.radians(30.0)
    why, _ = told(plan_of(plan.header, postures))["delta2", *TARGET]
    assert "although joint 1 varies by up to 34°" in why


def test_a_slide_is_not_varied_by_degrees():
    robot = random_robot("prrr", 1)
    own = header({"kind": "probe", "point_mm": [0, 0, 100]}, noise={"joint_mm": 0.02})
    _, what = told(plan_of(own, np.zeros((4, 4)), robot=robot))["delta2", *TARGET]
    assert what == "vary joint 1 by a third of the range or more between measurements"


def test_each_target_has_a_mechanism_of_its_own():
    own = header(targets={"a": {}, "b": {}})
    found = told(plan_of(own, good_plan().postures, ["a", "b"] * 5))
    assert "the target b is measured" in found["b.x", "b.y", "b.z"][0]
    assert ("delta2", "a.x", "a.y", "a.z", "b.x", "b.y", "b.z") in found


def test_too_few_shots_counts():
    plan = good_plan()
    few = Problem.from_plan(plan_of(plan.header, plan.postures[:3]))
    found = too_few_measurements(few, 8)
    assert reason(found.cause) == "too few measurements: 3 give 6 numbers for 8 unknowns"
    assert remedy(found.cause).startswith("record at least 4 measurements")
    assert too_few_measurements(Problem.from_plan(plan_of(plan.header, plan.postures[:4])), 8) is None
    probe = good_plan(3, 5, OPEN_PROBE)
    assert "at least 4 measurements" in remedy(too_few_measurements(Problem.from_plan(probe), 11).cause)
