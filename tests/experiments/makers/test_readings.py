"""Limits exclude a unit, a sign or a convention, or do not decide: then nothing is called certain."""

import numpy as np
from recorded_logs import POSTURES

from zerobeam.experiments.makers.contents import (
    TableColumn,
    j3_reading,
    length_reading,
    proposed_columns,
    sign_readings,
    unit_reading,
)
from zerobeam.model.files.robot_file import load_robot

IRB = load_robot("irb1600")
PANDA = load_robot("panda")  # joint 4 from -176 to -4 degrees, joint 6 from -1 to 215


def test_degrees_are_decided_where_radians_leave_the_limits() -> None:
    found = unit_reading(IRB, POSTURES)
    assert (found.choice, found.decided, found.outside) == ("deg", True, {"deg": 0, "rad": 4})
    assert "J6 -4297.2 deg, limits -400 to 400" in found.why


def test_small_angles_are_proposed_as_radians_but_not_decided() -> None:
    found = unit_reading(IRB, np.radians(POSTURES))
    assert (found.choice, found.decided) == ("rad", False)
    assert "the limits allow both" in found.why


def test_radians_are_decided_where_degrees_leave_the_limits() -> None:
    recorded = np.radians([[0, 0, 0, -90, 0, 90, 0], [20, 30, 10, -120, 5, 100, 30]])
    found = unit_reading(PANDA, recorded)
    assert (found.choice, found.decided, found.outside) == ("rad", True, {"deg": 2, "rad": 0})


def test_a_few_degrees_that_are_no_radians_are_decided_by_nobody() -> None:
    found = unit_reading(IRB, np.array([[6.5, 1, 1, 1, 1, 1.0]]))
    assert found.choice == "deg"  # radians: joint 1 at 372 degrees
    found = unit_reading(IRB, np.array([[0, 0, 0, 0, 0, 6.9]]))  # 395 degrees, within 400
    assert (found.choice, found.decided, found.why) == (None, False, "not decided: the limits allow both")


def test_columns_that_are_not_stated_say_nothing() -> None:
    recorded = np.full((3, 6), np.nan)
    assert unit_reading(IRB, recorded) is None
    assert length_reading(IRB, POSTURES) is None
    recorded[:, 0] = [10.0, 20.0, 30.0]
    found = unit_reading(IRB, recorded)
    assert (found.choice, found.outside) == ("deg", {"deg": 0, "rad": 3})
    signs = sign_readings(IRB, recorded)
    assert signs[0] is not None
    assert signs[0].choice is None
    assert signs[1:] == [None] * 5


def test_a_sign_is_decided_by_limits_that_are_not_symmetric_alone() -> None:
    right = np.array([[0.0, 0, 0, -90, 0, 90, 0]])
    turned = right * [1, 1, 1, -1, 1, 1, 1]
    for joints, choice in ((right, "recorded"), (turned, "reversed")):
        found = sign_readings(PANDA, joints)
        assert [one and one.choice for one in found] == [None, None, None, choice, None, "recorded", None]
        assert all(one is not None and one.decided == (one.choice is not None) for one in found)
    fourth = sign_readings(PANDA, np.array([[0.0, 0, 0, 400, 0, 90, 0]]))[3]
    assert fourth.choice is None
    assert fourth.why.startswith("none fits")


def test_joint_3_from_the_ground_is_judged_with_joint_2() -> None:
    joints = np.array([[0.0, 100, -200, 0, 0, 0]])
    found = j3_reading(IRB, joints)
    assert found.choice is None
    found = j3_reading(IRB, np.array([[0.0, 100, -300, 0, 0, 0]]))
    assert (found.choice, found.outside) == ("ground", {"link": 1, "ground": 0})


def columns(*names: str, text: str = "") -> list[TableColumn]:
    return [
        TableColumn(name, name, None if name == text else 0.0, None if name == text else 1.0, None, None)
        for name in names
    ]


def test_columns_are_proposed_by_name_by_count_or_not_at_all() -> None:
    own = [joint.name for joint in IRB.joints]
    assert proposed_columns(columns("t", *reversed(own)), IRB) is not None
    counted = [f"a{i}" for i in range(1, 7)]
    for names in (["t", *reversed(counted)], ["t", *counted, "dx"]):
        proposed = proposed_columns(columns(*names), IRB)
        assert proposed[0] == counted
    both = [*counted, *(f"b{i}" for i in range(1, 7))]
    assert proposed_columns(columns(*both), IRB) is None
    assert proposed_columns(columns(*counted[:5], "t"), IRB) is not None  # six columns of numbers, in order
    assert proposed_columns(columns(*counted[:5], "t", "dx"), IRB) is None
    assert proposed_columns(columns(*counted, text="a3"), IRB) is None
