"""Deflection under gravity and harmonics: which joints, by what torque."""

import numpy as np
import pytest
from plain_geometry import chain_of_robot
from plain_model import arm

from zerobeam.model.files.header import Header
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.dh import DHRow, dh_chain
from zerobeam.model.kinematics.robot import Joint, Robot
from zerobeam.model.likelihood.geometry import Geometry


def geometry_of(robot, **stated):
    values = {"robot": "x", "tool": {"kind": "probe", "point_mm": [0, 0, 0]}}
    values["noise"] = {"joint_deg": 0.01, "spot_mm": 0.05}
    return Geometry.from_header(Header.model_validate({**values, "geometry": stated}), robot)


@pytest.fixture
def irb1600(tmp_path):
    return load_robot("irb1600", tmp_path)


def plain_torques(robot, q, masses, up):
    """(n,) by a sum over the links: each weight times its lever about the joint's axis."""
    frames = chain_of_robot(robot).frames(q, {})
    result = []
    for i in range(robot.n):
        origin, axis = frames[i][:3, 3].real, (frames[i][:3, :3] @ robot.joints[i].axis).real
        levers = [frames[k + 1][:3, 3].real - origin for k in range(i, robot.n)]
        weights = [-mass * np.array(up) / np.linalg.norm(up) for mass in masses[i:]]
        result.append(
            sum(np.cross(lever, weight) @ axis for lever, weight in zip(levers, weights, strict=True))
        )
    return np.array(result)


@pytest.mark.parametrize("masses", [None, [10.0, 30.0, 0.0, 5.0, 2.0, 1.0]])
@pytest.mark.parametrize("up", [[0, 0, 2], [1, -0.5, 0.3]])
def test_torques_are_those_of_a_plain_sum_over_the_largest(irb1600, masses, up):
    geometry = geometry_of(irb1600, masses_kg=masses, up=up)
    values = [1.0] * 6 if masses is None else masses
    rng = np.random.default_rng(4)
    many = rng.uniform(irb1600.lower, irb1600.upper, (3000, 6))
    result = geometry.recorded(irb1600, many)[:, 12:]
    bending = list(geometry.gravity.joints)
    for row in range(3):
        expected = plain_torques(irb1600, many[row], values, up)
        largest = np.where(geometry.gravity.largest > 0, geometry.gravity.largest, 1.0)
        np.testing.assert_allclose(result[row], expected / largest, atol=1e-9)
    # tau_max of other draws: the largest of many is nearly that of as many others.
    assert (np.abs(result[:, bending]).max(axis=0) > 0.85).all()
    assert (np.abs(result[:, bending]).max(axis=0) < 1.15).all()


def test_gravity_turns_no_joint_whose_axis_is_vertical(irb1600):
    """Joint 1 of an arm that stands; not of one that is mounted on a wall. Joint 6 carries nothing: the
    wrist centre is its end."""
    assert geometry_of(irb1600).gravity.joints == (1, 2)
    assert geometry_of(irb1600, up=[0, 1, 0]).gravity.joints == (0, 1, 2)
    names = [f"{of}.{axis}" for of, axis in geometry_of(irb1600).names]
    assert "joint1.gravity" not in names
    assert "joint2.gravity" in names


def test_masses_decide_the_torques_up_to_one_factor(irb1600):
    q = np.full((1, 6), 0.4)

    def torques(masses):
        return geometry_of(irb1600, masses_kg=masses).recorded(irb1600, q)[0, 12:]

    np.testing.assert_allclose(torques([3.0] * 6), torques(None), rtol=1e-12, atol=1e-9)
    assert np.abs(torques([1, 1, 50, 1, 1, 1.0]) - torques(None)).max() > 0.01


def test_without_weight_nothing_bends(irb1600):
    geometry = geometry_of(irb1600, masses_kg=[0.0] * 6)
    assert geometry.gravity is None
    assert not [axis for _, axis in geometry.names if axis == "gravity"]


def test_rounding_is_no_torque():
    """Joint 1 of this arm is vertical, joint 2 slides, and all behind joint 3 is on its axis. Negative
    control: 1 mm beside that axis joint 3 carries a torque, and it alone."""

    def bending(beside_mm):
        rows = (
            DHRow(360.693, -np.pi / 2, 335.471, -np.pi / 2),
            DHRow(0.0, np.pi / 2, 0.0, -1.9486833515399191),
            DHRow(beside_mm, -np.pi / 2, 240.191, -np.pi / 2),
        )
        fixed, flange = dh_chain(rows, "standard")
        along = np.array([0.0, 0.0, 1.0])
        joints = (
            Joint("joint1", "revolute", fixed[0], along, -np.pi, np.pi),
            Joint("joint2", "prismatic", fixed[1], along, -500.0, 500.0),
            Joint("joint3", "revolute", fixed[2], along, -np.pi, np.pi),
        )
        return geometry_of(Robot("axes without torque", joints, flange), harmonics=False).gravity

    assert bending(0.0) is None
    assert bending(1.0).joints == (2,)


def test_harmonics_are_of_revolute_joints(tmp_path):
    robot = arm("scara", tmp_path).robot
    assert geometry_of(robot).harmonics == (0, 1, 3)
    assert geometry_of(robot, harmonics=False).harmonics == ()
