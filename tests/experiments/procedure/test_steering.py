"""Steps of the wrist: what they take away, how far they go, where they end; stands come to from below."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from servo_shots import WatchedRig, plan, start

from zerobeam.experiments.procedure.rig import MeasurementRefused, RefusalReason
from zerobeam.experiments.procedure.steering import FROM_BELOW, Belief, come_to, step
from zerobeam.model.arrays import Matrix

LARGEST = np.radians(2.0)


def believed(posture: int = 3) -> tuple[Belief, Matrix]:
    shot = start(posture=posture)
    return shot.belief, shot.joints


def frame_of(belief: Belief, joints: Matrix) -> Matrix:
    """Axes of a face that is at a slant to the beam."""
    z = -belief.beam(joints)[1] + np.array([0.2, -0.3, 0.1])
    z /= np.linalg.norm(z)
    x = np.cross(z, [0.3, 1.0, 0.2])
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def with_limits(belief: Belief, lower: Matrix, upper: Matrix) -> Belief:
    robot = belief.problem.robot
    joints = tuple(
        replace(joint, lower=low, upper=high)
        for joint, low, high in zip(robot.joints, lower, upper, strict=True)
    )
    return replace(belief, problem=replace(belief.problem, robot=replace(robot, joints=joints)))


def test_the_spots_jacobian_is_exact() -> None:
    """J = B' (I - d n' / (d'n)) (dp/dq + t dd/dq), against central differences of the beam itself; without
    its second term it is far off."""
    belief, joints = believed()
    frame = frame_of(belief, joints)

    def met(there: Matrix) -> Matrix:
        origin, direction = belief.beam(there)
        normal = frame[:, 2]
        length = normal @ (belief.target - origin) / (normal @ direction)
        return frame[:, :2].T @ (origin + length * direction - belief.target)

    spot, exact = belief.spot(joints, frame)
    np.testing.assert_allclose(spot, met(joints), atol=1e-9)
    ways = 1e-6 * np.eye(6)
    differences = np.column_stack([(met(joints + way) - met(joints - way)) / 2e-6 for way in ways])
    np.testing.assert_allclose(exact, differences, atol=1e-4)
    _, direction = belief.beam(joints)
    across = np.eye(3) - np.outer(direction, frame[:, 2]) / (direction @ frame[:, 2])
    moving = np.column_stack(
        [(belief.beam(joints + way)[0] - belief.beam(joints - way)[0]) / 2e-6 for way in ways]
    )
    assert np.abs(frame[:, :2].T @ across @ moving - exact).max() > 500


def test_directions_are_turned_into_the_flange() -> None:
    belief, joints = believed()
    rotation, place = belief.flange(joints)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    points = np.random.default_rng(0).normal(size=(4, 3)) * 300
    for point in points:
        (seen,) = belief.call("seen", joints, point)
        np.testing.assert_allclose((point - place) @ rotation, seen, atol=1e-9)
    origin = belief.call("seen", joints, np.zeros(3))[0]
    np.testing.assert_allclose(
        belief.turned(joints, points), [belief.call("seen", joints, p)[0] - origin for p in points], atol=1e-9
    )


def test_another_target_leaves_the_rest() -> None:
    belief, _ = believed()
    other = belief.with_target(np.array([1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(other.target, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(other.delta, belief.delta)
    assert (other.x != belief.x).sum() == 3


def test_the_wrist_is_turned_onto_a_target_or_not_at_all() -> None:
    belief, joints = believed()
    aside = belief.with_target(belief.target + np.array([40.0, -30.0, 60.0]))
    found = aside.onto_target(joints)
    origin, direction = aside.beam(found)
    assert np.linalg.norm(np.cross(aside.target - origin, direction)) < 1e-5
    np.testing.assert_array_equal(found[:3], joints[:3])
    held = with_limits(aside, joints - 1e-3, joints + 1e-3)
    assert held.onto_target(joints) is None


def test_a_step_takes_the_error_away_with_the_smallest_turn() -> None:
    belief, joints = believed()
    _, jacobian = belief.spot(joints, frame_of(belief, joints))
    error = np.array([3.0, -2.0])
    turn = step(belief, joints, jacobian, error, LARGEST) - joints
    assert (turn[:3] == 0).all()
    np.testing.assert_allclose(turn[3:], -np.linalg.pinv(jacobian[:, 3:]) @ error, atol=1e-5)
    np.testing.assert_allclose(jacobian @ turn, -error, atol=1e-3)


def test_no_joint_turns_by_more_than_the_bound() -> None:
    belief, joints = believed()
    _, jacobian = belief.spot(joints, frame_of(belief, joints))
    error = np.array([300.0, -200.0])
    turn = step(belief, joints, jacobian, error, LARGEST) - joints
    assert np.abs(turn).max() == pytest.approx(LARGEST)
    # As far as it goes it goes the right way.
    way = jacobian @ turn
    assert way @ error == pytest.approx(-np.linalg.norm(way) * np.linalg.norm(error))


def test_a_step_across_a_singular_direction_is_short() -> None:
    """Both rows of the Jacobian nearly alike: undamped it would turn by a radian and more."""
    belief, joints = believed()
    jacobian = np.zeros((2, 6))
    jacobian[:, 3:] = [[1000.0, 500.0, 200.0], [1000.0, 500.0, 200.001]]
    across = np.array([1.0, -1.0])
    assert np.abs(np.linalg.pinv(jacobian) @ across).max() > 100
    assert np.abs(step(belief, joints, jacobian, across, np.inf) - joints).max() < 1e-3


def test_a_joint_at_its_limit_is_left_there_and_the_others_do_its_part() -> None:
    belief, joints = believed()
    _, jacobian = belief.spot(joints, frame_of(belief, joints))
    error = np.array([3.0, -2.0])
    free = step(belief, joints, jacobian, error, LARGEST) - joints
    most = int(np.argmax(np.abs(free)))
    lower, upper = belief.problem.robot.lower.copy(), belief.problem.robot.upper.copy()
    (lower if free[most] < 0 else upper)[most] = joints[most]
    turn = step(with_limits(belief, lower, upper), joints, jacobian, error, LARGEST) - joints
    assert turn[most] == 0
    np.testing.assert_allclose(jacobian @ turn, -error, atol=1e-2)


def test_a_wrist_that_cannot_is_a_reason() -> None:
    belief, joints = believed()
    _, jacobian = belief.spot(joints, frame_of(belief, joints))
    held = with_limits(belief, joints - 1e-6, joints + 1e-6)
    with pytest.raises(MeasurementRefused) as refused:
        step(held, joints, jacobian, np.array([3.0, -2.0]), LARGEST)
    assert refused.value.reason == RefusalReason.LIMIT


def stood(rig: WatchedRig, joints: Matrix, first: Matrix) -> Matrix:
    rig.move(first)
    rig.move(joints)
    return rig.link() - joints


def test_a_stand_come_to_from_below_has_the_play_always_on_one_side() -> None:
    shot = start(exact=True, arm={"backlash_deg": 0.02})
    rig, joints = shot.rig, shot.joints
    play = np.radians(0.02)
    for aside in (-0.1, 0.1):
        rig.move(joints + aside)
        come_to(rig, shot.belief, joints)
        np.testing.assert_allclose(rig.link() - joints, -play / 2, atol=1e-12)
    # The control: come to straight, it depends on the side.
    below, above = stood(rig, joints, joints - 0.1), stood(rig, joints, joints + 0.1)
    np.testing.assert_allclose(above - below, play, atol=1e-12)


def test_a_stand_near_a_lower_limit_is_come_to_within_the_limits() -> None:
    shot = start(exact=True)
    robot = plan().robot
    joints = shot.joints.copy()
    joints[3] = robot.lower[3] + np.radians(FROM_BELOW) / 2
    come_to(shot.rig, shot.belief, joints)
    assert shot.rig.moves[-2][3] == robot.lower[3]
    np.testing.assert_array_equal(shot.rig.moves[-1], joints)
