"""Joints as a pendant counts, orders and limits them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from zerobeam.model.arms.joint_three import from_ground, to_ground
from zerobeam.model.arms.pendant import Pendant
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot


def test_there_and_back_for_one_posture_and_for_many() -> None:
    robot = load_robot("lrmate_200id")
    joints = np.random.default_rng(0).normal(size=(4, robot.n))
    before = joints.copy()
    assert from_ground(joints[0], robot) == pytest.approx(joints[0] + np.eye(6)[2] * joints[0, 1])
    np.testing.assert_array_equal(from_ground(joints, robot)[0], from_ground(joints[0], robot))
    assert to_ground(from_ground(joints, robot), robot) == pytest.approx(joints)
    assert not np.allclose(to_ground(joints, robot), from_ground(joints, robot))
    np.testing.assert_array_equal(joints, before)


@pytest.mark.parametrize("name", ["two", "slides"])
def test_an_arm_without_such_a_joint_is_refused(name: str) -> None:
    robot = load_robot("irb1600")
    joints = list(robot.joints)
    joints[2] = replace(joints[2], kind="prismatic")
    other = replace(robot, name=name, joints=tuple(joints[:2] if name == "two" else joints))
    for refused in (lambda arm: Pendant(arm, "ground"), lambda arm: from_ground(np.zeros(arm.n), arm)):
        with pytest.raises(BadInput, match="not counted from the ground"):
            refused(other)
