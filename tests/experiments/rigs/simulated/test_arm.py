from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from cells import irb1600
from plain_model import MODIFIED, arm
from scipy import stats

from zerobeam.experiments.rigs.simulated.assembly import SimulatedArm, geometry_errors
from zerobeam.model.kinematics.robot import DHRow, Robot, dh_chain, rotation_about, shift

HOME = np.radians([10.0, -20.0, 30.0, 40.0, -50.0, 60.0])
OFFSETS = np.radians([0.0, -1.2, -0.7, 0.1, 0.01, -0.04])


def simulated(
    robot: Robot | None = None,
    *,
    offsets: np.ndarray | None = None,
    backlash: float = 0.0,
    resolution: float = 0.0,
    repeatability: float = 0.0,
    speed: float = 0.25,
    acceleration: float = 5.0,
    redraw: float = np.radians(2.0),
    at: np.ndarray = HOME,
    seed: int = 0,
) -> SimulatedArm:
    robot = robot or irb1600()
    each = np.ones(robot.n)
    own = SimulatedArm(
        robot,
        np.zeros(robot.n) if offsets is None else offsets,
        backlash * each,
        resolution * each,
        repeatability * each,
        speed,
        acceleration * each,
        redraw,
    )
    own.begin(np.random.default_rng(seed), at)
    return own


def only(joint: int, by: float, n: int = 6) -> np.ndarray:
    return by * np.eye(n)[joint]


# Where the links are.


def test_without_error_the_links_are_off_by_the_offsets_alone() -> None:
    """True = recorded + delta, as in the run's model."""
    own = simulated(offsets=OFFSETS)
    for joints in np.random.default_rng(1).uniform(-1, 1, (20, 6)):
        own.move(joints)
        assert (own.read() == joints).all()
        assert (own.link() == own.read() + OFFSETS).all()


def test_the_arm_stands_on_counts_of_its_encoders() -> None:
    step = np.radians(0.01)
    own = simulated(resolution=step)
    off = []
    for joints in np.random.default_rng(2).uniform(-1, 1, (20, 6)):
        own.move(joints)
        np.testing.assert_allclose(own.read() / step, np.round(own.read() / step), atol=1e-9)
        assert (own.link() == own.read()).all()
        off.append(np.abs(own.read() - joints).max())
    assert 0.3 * step < max(off) <= 0.5 * step * (1 + 1e-9)
    # A command of less than half a step moves nothing, and takes no time.
    own.move(np.zeros(6))
    assert own.move(np.full(6, 0.4 * step)) == 0.0
    assert (own.read() == 0).all()


def test_backlash_shows_between_the_two_ways_of_coming() -> None:
    width = np.radians(0.02)
    own = simulated(offsets=OFFSETS, backlash=width)
    own.move(HOME - 0.01)
    own.move(HOME)
    below = own.link()
    own.move(HOME + 0.01)
    own.move(HOME)
    above = own.link()
    np.testing.assert_allclose(above - below, width, rtol=1e-9)
    # The link lags: it has not come as far as its count.
    np.testing.assert_allclose(below - own.read() - OFFSETS, -width / 2, rtol=1e-9)


def test_a_joint_that_stays_keeps_its_side_of_the_backlash() -> None:
    width = 1e-3
    own = simulated(backlash=width)
    own.move(HOME - 0.01)
    own.move(HOME - 0.01 + only(2, 0.005))
    np.testing.assert_allclose(own.link() - own.read(), width / 2 * np.array([1, 1, -1, 1, 1, 1]), atol=1e-12)


def test_the_static_error_stays_while_the_arm_moves_little() -> None:
    """Twenty moves of 0.09 degrees are within 2 degrees of travel; three more are not."""
    own = simulated(repeatability=1e-4)
    error = own.link() - own.read()
    assert (error != 0).all()
    step = np.radians(0.09)
    for i in range(20):
        # Joints take turns, and go to and fro: the travel counts, not the distance.
        own.move(own.read() + only(i % 6, step * (-1) ** i))
        np.testing.assert_allclose(own.link() - own.read(), error, atol=1e-15)
    for _ in range(3):
        own.move(own.read() + only(0, step))
    assert (np.abs(own.link() - own.read() - error) > 1e-12).all()


def test_the_joint_that_goes_farthest_counts_as_travel() -> None:
    """All six by 0.5 degrees are half a degree of travel, not three; a prismatic joint's mm is a degree."""
    own = simulated(repeatability=1e-4)
    error = own.link() - own.read()
    own.move(HOME + np.radians(0.5))
    np.testing.assert_allclose(own.link() - own.read(), error, atol=1e-15)
    gantry = arm("gantry", Path()).robot
    for way, stays in ((1.9, True), (2.1, False)):
        own = simulated(gantry, repeatability=1e-4, at=np.zeros(4))
        error = own.link() - own.read()
        own.move(only(0, way, 4))
        assert np.allclose(own.link() - own.read(), error, atol=1e-12) == stays


def test_static_errors_are_as_large_as_stated_and_independent() -> None:
    """2,000 draws of six joints: chi-squared, normal, and correlations within 4 / sqrt(2,000)."""
    size, draws = 2e-4, 2000
    own = simulated(repeatability=size)
    errors = np.empty((draws, 6))
    for i in range(draws):
        own.move(HOME + np.radians(5.0) * (i % 2))
        errors[i] = (own.link() - own.read()) / size
    low, high = stats.chi2.ppf([0.0005, 0.9995], draws)
    for joint in errors.T:
        assert low < (joint**2).sum() < high
        assert abs(np.corrcoef(joint[1:], joint[:-1])[0, 1]) < 4 / np.sqrt(draws)
    assert stats.kstest(errors.reshape(-1), "norm").pvalue > 1e-3
    between = np.corrcoef(errors.T) - np.eye(6)
    assert np.abs(between).max() < 4 / np.sqrt(draws)


def test_what_follows_a_beginning_depends_on_it_alone() -> None:
    def links(own: SimulatedArm, seed: int) -> np.ndarray:
        own.begin(np.random.default_rng(seed), HOME)
        found = [own.link()]
        for joints in np.random.default_rng(9).uniform(-0.02, 0.02, (12, 6)):
            own.move(HOME + joints)
            found.append(own.link())
        return np.array(found)

    fresh = simulated(backlash=1e-3, resolution=1e-6, repeatability=1e-4)
    used = simulated(backlash=1e-3, resolution=1e-6, repeatability=1e-4, seed=5)
    for i in range(7):
        used.move(HOME - 0.01 * i)
    assert (links(fresh, 3) == links(used, 3)).all()
    assert (links(fresh, 3) != links(fresh, 4)).any()


def test_a_reading_is_not_the_arm_itself() -> None:
    """A glitch that a rig puts on a reading does not move the arm."""
    own = simulated()
    own.read()[2] += 1.0
    assert (own.read() == HOME).all()


# How long a motion takes.


def test_a_long_motion_of_one_joint() -> None:
    """Joint 1: 150 deg/s, a quarter of it, 5 rad/s^2: the ramps take v / a in all, the rest goes at v."""
    own = simulated()
    v = 0.25 * np.radians(150)
    assert own.move(HOME + only(0, 1.0)) == pytest.approx(1.0 / v + v / 5.0)
    # Back again takes as long, and staying takes none.
    assert own.move(HOME) == pytest.approx(1.0 / v + v / 5.0)
    assert own.move(HOME) == 0.0


def test_a_short_motion_never_reaches_its_speed() -> None:
    own = simulated()
    assert own.move(HOME + only(0, 0.01)) == pytest.approx(2 * np.sqrt(0.01 / 5.0))
    # Where the two profiles meet they agree.
    v = 0.25 * np.radians(150)
    meet = v**2 / 5.0
    times = [own.duration(only(0, meet * share)) for share in (1 - 1e-9, 1.0, 1 + 1e-9)]
    np.testing.assert_allclose(times, 2 * v / 5.0, rtol=1e-8)


def test_the_profile_integrates_to_the_way() -> None:
    """Speed ramped up, held and ramped down over the time stated, summed numerically, covers the way."""
    own = simulated()
    for way in (0.003, 0.1, 2.0):
        seconds = own.duration(only(0, way))
        t = (np.arange(200_000) + 0.5) / 200_000 * seconds
        v = np.minimum(np.minimum(5.0 * t, 5.0 * (seconds - t)), 0.25 * np.radians(150))
        assert v.mean() * seconds == pytest.approx(way, rel=1e-6)


def test_the_slowest_joint_sets_the_time() -> None:
    own = simulated()
    way = np.array([0.5, -0.2, 0.9, 0.1, 1.4, -1.6])
    alone = [own.duration(only(i, way[i])) for i in range(6)]
    assert own.duration(way) == max(alone)
    # Joint 3 of 0.9 rad at 170 deg/s, not joint 6 of 1.6 rad at 460 deg/s.
    assert int(np.argmax(alone)) == 2


def test_top_speeds_that_the_robot_file_does_not_state() -> None:
    """1 rad/s for a revolute joint, 1000 mm/s for a prismatic one."""
    robot = arm("gantry", Path()).robot
    assert all(joint.speed is None for joint in robot.joints)
    own = simulated(robot, speed=0.5, acceleration=1e6, at=np.zeros(4))
    assert own.duration(only(0, 250.0, 4)) == pytest.approx(250 / 500, rel=2e-3)
    assert own.duration(only(1, 2.0, 4)) == pytest.approx(2.0 / 0.5, rel=1e-5)


# Links that deviate from nominal geometry.


def pose(robot: Robot, joints: np.ndarray) -> np.ndarray:
    theta = ca.SX.sym("theta", robot.n)
    rotation, translation = ca.Function("pose", [theta], list(robot.flange_pose(theta)))(joints)
    return np.hstack([np.array(rotation), np.array(translation)])


def modified(rows: Sequence[tuple[float, ...]]) -> Robot:
    given = arm("modified", Path()).robot
    rad = [DHRow(a, np.radians(alpha), d, np.radians(theta)) for a, alpha, d, theta in rows]
    fixed, flange = dh_chain(rad, "modified")
    joints = tuple(dataclasses.replace(j, fixed=f) for j, f in zip(given.joints, fixed, strict=True))
    return dataclasses.replace(given, joints=joints, flange=flange)


def test_an_error_of_a_link_is_one_of_its_dh_row() -> None:
    """Craig's row ends in Rz(theta) Tz(d): a turn and a shift along z behind it are errors of theta and d."""
    drawn = modified(MODIFIED)
    a, alpha, d, theta = MODIFIED[2]
    other = modified([*MODIFIED[:2], (a, alpha, d + 0.3, theta + 0.2), *MODIFIED[3:]])
    error = rotation_about("z", np.radians(0.2)) @ shift(z=0.3)
    joints = np.random.default_rng(3).uniform(-1, 1, 6)
    true = geometry_errors(drawn, {2: error})
    np.testing.assert_allclose(pose(true, joints), pose(other, joints), atol=1e-9)
    # The same error on another link is another arm, and the drawn one is as it was.
    assert np.abs(pose(geometry_errors(drawn, {3: error}), joints) - pose(other, joints)).max() > 0.01
    np.testing.assert_allclose(pose(drawn, joints), pose(modified(MODIFIED), joints), atol=0)
    assert np.abs(pose(drawn, joints) - pose(true, joints)).max() > 0.1
