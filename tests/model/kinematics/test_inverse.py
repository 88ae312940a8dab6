"""Inverse kinematics: every solution is one, the joints that the pose was made of are among them."""

from dataclasses import replace

import numpy as np
import pytest

from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.inverse import (
    Branch,
    Branches,
    Solver,
    abb_configuration,
    fanuc_configuration,
    is_abb_configuration,
    is_fanuc_configuration,
    is_kuka_turn,
    is_singular,
    kuka_status,
    kuka_turn,
    longest_reach,
    reach,
)


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


def branch(name: str, joints: list[float]) -> Branch:
    robot = load_robot(name)
    return Branches(robot, -1 if robot.vendor == "kuka" else 1).of(np.array(joints))


def test_the_elbow_of_an_irb6700_changes_where_its_forearm_is_in_line() -> None:
    # Upper arm 1142.5 mm ahead and 200 mm up of axis 3: in line at -90 + atan(200 / 1142.5) degrees.
    line = -90 + float(np.degrees(np.arctan2(200, 1142.5)))
    for off, behind in ((0.01, False), (-0.01, True)):
        assert branch("irb6700", [0, 20, line + off, 0, 30, 0]).behind_arm is behind


@pytest.mark.parametrize(
    ("joints", "expected"),
    [
        ([0, 0, 0, 0, 30, 0], (0, 0, 0, 0)),
        ([-10, 0, 0, 100, -30, -100], (-1, 1, -2, 1)),
        ([100, 40, -110, -1, 30, 300], (1, -1, 3, 2)),
        ([10, -100, 0, 1, 30, 1], (0, 0, 0, 4)),
    ],
)
def test_confdata(joints: list[float], expected: tuple[int, ...]) -> None:
    configuration = branch("irb120", joints)
    assert abb_configuration(configuration, np.array(joints)) == expected
    assert is_abb_configuration(expected, configuration, np.array(joints))
    assert not is_abb_configuration((*expected[:3], (expected[3] + 1) % 8), configuration, np.array(joints))


def test_status_and_turn_of_a_kuka() -> None:
    # The usual home position, and typical values of programs: S 2, T 35 and S 6, T 27.
    home = [0, -90, 90, 0, 1, 0]
    assert kuka_status(branch("kr6_r900", home)) == 2
    assert kuka_turn(np.array(home)) == 2
    assert kuka_status(branch("kr6_r900", [-10, -90, 90, 0, 40, -10])) == 2
    assert kuka_turn(np.array([-10.0, -90, 90, 0, 40, -10])) == 35
    assert kuka_status(branch("kr6_r900", [-10, -90, 90, -5, -40, 10])) == 6
    assert kuka_turn(np.array([-10.0, -90, 90, -5, -40, 10])) == 27
    assert kuka_status(branch("kr6_r900", [0, -60, -60, 0, 40, 0])) == 0
    assert kuka_status(branch("kr6_r900", [0, -170, 40, 0, 40, 0])) == 3
    assert is_kuka_turn(35, np.array([-10.0, -90, 90, 0, 40, -10]))
    assert is_kuka_turn(43, np.array([-10.0, -90, 90, 0, 40, -10]))  # A4 at 0 has either sign
    assert not is_kuka_turn(34, np.array([-10.0, -90, 90, 0, 40, -10]))


def test_config_of_a_fanuc() -> None:
    # Flange down in front: N U T, as measured on a simulated controller; F where J5 is positive.
    down = np.array([0.0, 0, 0, 0, -90, 0])
    assert fanuc_configuration(branch("lrmate_200id", down.tolist()), down) == ("N U T", (0, 0, 0))
    flipped = np.array([0.0, 0, 0, 179, 90, 181])
    configuration = branch("lrmate_200id", flipped.tolist())
    assert fanuc_configuration(configuration, flipped) == ("F U T", (0, 0, 1))
    assert is_fanuc_configuration("F U T", (0, 0, 1), configuration, flipped)
    assert not is_fanuc_configuration("F U T", (0, 0, 0), configuration, flipped)


def test_a_mounting_changes_no_configuration() -> None:
    robot = load_robot("kr6_r900")
    turned = np.diag([1.0, -1.0, -1.0, 1.0])
    first = replace(robot.joints[0], fixed=turned @ robot.joints[0].fixed)
    hanging = replace(robot, joints=(first, *robot.joints[1:]))
    for joints in np.random.default_rng(0).uniform(-90, 90, (20, 6)):
        assert Branches(hanging, -1).of(joints) == Branches(robot, -1).of(joints)


@pytest.mark.parametrize(("name", "exist"), [("irb120", True), ("ur5e", False), ("panda", False)])
def test_only_of_arms_with_a_spherical_wrist(name: str, exist: bool) -> None:
    assert Branches(load_robot(name), 1).exist is exist


def test_the_wrist_has_no_say_in_where_its_centre_is() -> None:
    rng = np.random.default_rng(3)
    for name in ("irb120", "kr6_r900"):
        robot = load_robot(name)
        branches = Branches(robot, -1 if robot.vendor == "kuka" else 1)
        for _ in range(40):
            arm, wrist = rng.uniform(-100, 100, 3), rng.uniform(-100, 100, (2, 3))
            wrist[0, 1] = 0.01  # all but straight
            first, second = (branches.of(np.concatenate([arm, turns])) for turns in wrist)
            assert (first.behind, first.behind_arm) == (second.behind, second.behind_arm)
