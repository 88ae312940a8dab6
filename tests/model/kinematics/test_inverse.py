"""Inverse kinematics: every solution is one, the joints that the pose was made of are among them."""

from __future__ import annotations

import numpy as np
import pytest

from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.inverse import Solver, is_singular, longest_reach, reach


@pytest.mark.parametrize(("name", "most"), [("irb120", 8), ("ur5e", 8), ("gen3_lite", 16)])
def test_solutions_have_the_pose(name: str, most: int) -> None:
    robot = load_robot(name)
    solver = Solver(robot)
    rng = np.random.default_rng(2)
    for joints in rng.uniform(0.7 * robot.lower, 0.7 * robot.upper, (6, robot.n)):
        if is_singular(robot, joints):
            continue
        pose = robot.fk(joints, "rad")
        result = solver.solutions(pose)
        np.testing.assert_allclose(
            robot.fk(result, "rad"), np.broadcast_to(pose, (len(result), 4, 4)), atol=1e-5
        )
        assert sum(solver.same(row, joints) for row in result) == 1
        assert len(result) <= most
        assert (result >= robot.lower - 1e-6).all()
        assert (result <= robot.upper + 1e-6).all()


def test_an_arm_with_a_spherical_wrist_has_eight_postures_where_limits_allow() -> None:
    robot = load_robot("irb1200")
    assert len(Solver(robot).solutions(robot.fk([10, 60, -60, 40, 60, 30], "deg"), thorough=True)) == 8


def test_whole_turns_within_the_limits() -> None:
    solver = Solver(load_robot("ur5e"))
    row = np.radians([10.0, -80, 90, -100, -90, 20])
    turns = solver.with_turns(row)
    assert len(turns) == 2**6
    assert all(solver.same(row, other) for other in turns)
    near = row + np.radians([350, 0, 0, 0, 0, -350])
    np.testing.assert_allclose(solver.nearest_turns(row, near), row + np.radians([360, 0, 0, 0, 0, -360]))


def test_a_pose_out_of_reach_is_not_reached() -> None:
    robot = load_robot("irb120")
    pose = robot.fk(np.zeros(6), "deg")
    pose[0, 3] += 2000
    _, arrived = reach(robot, pose, np.zeros((1, 6)))
    assert not arrived.any()
    assert len(Solver(robot).solutions(pose)) == 0


def test_singularities() -> None:
    robot = load_robot("irb120")
    assert is_singular(robot, np.radians([10.0, 20, 10, 15, 0.0, 40]))
    assert not is_singular(robot, np.radians([10.0, 20, 10, 15, 40.0, 40]))


def test_the_reach_of_a_stretched_arm() -> None:
    # Axis 1 to 2, upper arm, forearm with its offset, and the flange in line with the stretched wrist.
    wrist, flange = np.hypot(35, 420), 80
    found = longest_reach(load_robot("kr6_r900"))
    assert found == pytest.approx(25 + 455 + wrist + flange, abs=1.0)
    assert found < 25 + 455 + wrist + flange + 1e-9
    # Of the paper's arm the last frame is the centre of the wrist.
    assert longest_reach(load_robot("irb1600")) == pytest.approx(150 + 700 + 600, abs=0.5)
