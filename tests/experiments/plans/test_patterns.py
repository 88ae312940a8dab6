from dataclasses import replace

import numpy as np
import pytest
from cells import OPEN_LASER, PROBE, header, irb1600, plan_of
from plain_posterior import beam

from zerobeam.analysis.observability.check import check
from zerobeam.experiments.plans.patterns import _LINES, Line, pattern, reach
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.likelihood.problem import Problem


def beams(which, aside, shots=7, tool=None):
    target = np.array([900.0, aside, 0.0])
    own = header(target=target) if tool is None else header(tool, target=target)
    postures = pattern(own, irb1600(), target, which, shots)
    origin, direction = np.array([beam(q) for q in postures]).transpose(1, 0, 2)
    return postures, origin, direction, target


def test_reach_of_the_built_in_arm():
    """a1 + a2 + d4 of Table 1 (the last two frames coincide); the base's column is no reach."""
    assert reach(irb1600()) == pytest.approx(np.hypot(150, 486.5) + 700 + 600, abs=1e-9)


@pytest.mark.parametrize(("which", "aside"), [("x", 0.0), ("y", 0.0), ("x", 400.0), ("y", 400.0)])
def test_the_beams_hit_the_target_in_front_from_a_line_within_the_limits(which, aside):
    postures, origin, direction, target = beams(which, aside)
    away = target - origin
    along = (away * direction).sum(axis=1)
    assert (along > 100).all()
    assert np.linalg.norm(away - along[:, None] * direction, axis=1).max() < 1e-3
    forward, above, span = _LINES[which]
    arm = reach(irb1600())
    axis, across = (0, 1) if which == "x" else (1, 0)
    np.testing.assert_allclose(origin[:, 2], target[2] + above * arm, atol=2e-3)
    np.testing.assert_allclose(origin[:, across], 0.0 if which == "x" else forward * arm, atol=2e-3)
    middle = forward * arm if which == "x" else 0.0
    expected = middle + np.linspace(-span / 2, span / 2, 7) * arm
    np.testing.assert_allclose(origin[:, axis], expected, atol=2e-3)
    assert (postures >= irb1600().lower).all()
    assert (postures <= irb1600().upper).all()


def test_joint_1_is_constant_in_the_x_pattern_straight_ahead():
    postures, *_ = beams("x", 0.0)
    assert np.ptp(postures[:, 0]) == 0.0
    # Not so with the target aside, nor in the Y-Pattern.
    assert np.ptp(beams("x", 400.0)[0][:, 0]) > 1e-4
    assert np.degrees(np.ptp(beams("y", 0.0)[0][:, 0])) > 30


def test_neighbours_are_near():
    """One row of postures, not a jump between branches of the inverse kinematics."""
    postures, *_ = beams("y", 0.0, shots=13)
    assert np.degrees(np.abs(np.diff(postures, axis=0)).max()) < 45


@pytest.mark.parametrize("shots", [1, 2, 4, 10])
def test_any_number_of_shots(shots):
    postures, *_ = beams("y", 100.0, shots)
    assert postures.shape == (shots, 6)


def test_an_open_laser_is_placed_at_its_nominal_beam():
    postures, *_ = beams("y", 0.0, tool=OPEN_LASER)
    np.testing.assert_allclose(postures, beams("y", 0.0)[0], atol=1e-9)


@pytest.mark.long
def test_a_target_out_of_sight_is_bad_input(refused):
    target = np.array([0.0, 0.0, 3000.0])
    error = refused(pattern, header(target=target), irb1600(), target, "x")
    assert "X-Pattern cannot be made" in str(error)
    assert "no posture has the laser at" in str(error)
    assert error.remedy
    assert isinstance(error, BadInput)


def test_a_probe_has_no_pattern(refused):
    error = refused(pattern, header(PROBE), irb1600(), np.array([900.0, 0, 0]), "x")
    assert "made for a beam" in str(error)


TABLE = np.array([900.0, 100.0, 800.0])
WIDE = Line(distance=500.0, height=500.0, width=1200.0, roll=np.radians(30))


def rolled(line, which="y", target=TABLE):
    """Postures, where their beams start, and the rotation of each flange (columns: its axes)."""
    own = header(target=target)
    postures = pattern(own, irb1600(), target, which, 7, line=line)
    problem = Problem.build(own, irb1600(), postures, ["psd"] * 7)
    x = problem.nominal()
    origin, direction = problem.beams(x)
    return postures, origin, direction, problem.poses(x)


def test_a_stated_line_and_roll_are_where_they_are_stated():
    postures, origin, direction, poses = rolled(WIDE)
    expected = np.stack([np.full(7, 500.0), np.linspace(-600, 600, 7), np.full(7, 1300.0)], axis=1)
    np.testing.assert_allclose(origin, expected, atol=2e-3)
    away = TABLE - origin
    np.testing.assert_allclose(np.cross(away, direction), 0, atol=5e-3)
    # The beam is the flange's x axis: b1 is its y axis (docs/conventions.md), 30 degrees off the line.
    for at, beam_direction in zip(poses, direction, strict=True):
        rotation = np.asarray(at)[:3, :3]
        np.testing.assert_allclose(rotation[:, 0], beam_direction, atol=1e-9)
        level = np.array([0.0, 1.0, 0.0]) - beam_direction[1] * beam_direction
        level /= np.linalg.norm(level)
        b1 = rotation[:, 1]
        roll = np.degrees(np.arctan2(b1 @ np.cross(beam_direction, level), b1 @ level))
        assert roll == pytest.approx(30, abs=1e-3)
    assert (postures >= irb1600().lower).all()
    assert (postures <= irb1600().upper).all()


def test_another_roll_is_other_postures_of_the_same_beams():
    one, other = rolled(WIDE), rolled(replace(WIDE, roll=np.radians(-30)))
    np.testing.assert_allclose(one[1], other[1], atol=4e-3)
    assert np.degrees(np.abs(one[0] - other[0])).max() > 10


def test_a_line_without_width_is_one_posture():
    """All of them the same: joint 1 is at rest, and no offset is identifiable."""
    postures, *_ = rolled(replace(WIDE, width=0.0))
    assert np.ptp(postures, axis=0).max() < 1e-6
    own = header(target=TABLE)
    assert check(plan_of(own, postures)).verdict == "degenerate"


def test_a_beam_along_the_line_has_no_roll(refused):
    target = np.array([1300.0, 0.0, 800.0])
    line = Line(distance=700.0, height=0.0, width=300.0, roll=0.0)
    error = refused(pattern, header(target=target), irb1600(), target, "x", line=line)
    assert "no roll about it" in str(error)


@pytest.mark.parametrize(("robot", "which", "ahead"), [("ur5e", "x", 600.0), ("panda", "y", 500.0)])
def test_where_its_line_cannot_be_shot_from_one_that_can_is_offered(robot, which, ahead):
    """All were told to put the target nearer to the middle of the workspace, which did not help."""
    arm, target = load_robot(robot), np.array([ahead, 0.0, 0.0])
    own = header(target=target).model_copy(update={"robot": robot})
    with pytest.raises(BadInput, match="another line serves") as caught:
        pattern(own, arm, target, which)
    words = str(caught.value.remedy).partition(": ")[2].split()
    line = Line(
        **{
            option.removeprefix("--"): float(length)
            for option, length in zip(words[::2], words[1::2], strict=True)
        }
    )
    assert line != Line()
    assert pattern(own, arm, target, which, line=line).shape == (7, arm.n)


def test_where_no_line_serves_the_postures_are_to_be_chosen_freely():
    target, line = np.array([900.0, 0.0, 0.0]), Line(distance=5000.0, height=500.0, width=500.0)
    with pytest.raises(BadInput, match="plan optimal"):
        pattern(header(target=target), irb1600(), target, "x", line=line)
