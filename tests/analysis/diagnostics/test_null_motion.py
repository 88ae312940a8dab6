"""The motion that no reading notices: known motions, readings by plain numpy, and what must have none."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from cells import AXIS_LASER, OPEN_LASER, OPEN_PROBE, good_plan, pattern_plan, plan_of
from example_results import good, x_pattern
from plain_model import arm, miss
from scipy.spatial.transform import Rotation

from zerobeam.analysis.diagnostics.null_motion import (
    MotionPath,
    NullSpaceMotion,
    OpenShots,
    motion_of_plan,
    motion_path,
    null_motion,
)
from zerobeam.analysis.observability.causes import NotResolvable, NullDirection, ParallelAxes
from zerobeam.analysis.observability.check import check, measured_shots
from zerobeam.analysis.observability.gauges import information_root
from zerobeam.analysis.observability.identifiability import identify
from zerobeam.model.errors import UnsoundResult
from zerobeam.model.files.plan import Plan
from zerobeam.model.likelihood.problem import Problem


def constant(count: int) -> Plan:
    """Varied postures in which the first joints do not change."""
    plan = good_plan(16)
    postures = plan.postures.copy()
    postures[:, :count] = [0.1, 0.3][:count]
    return plan_of(plan.header, postures)


def stretched() -> OpenShots:
    """Measurements with joint 5 at 0, so that the axes of joints 4 and 6 are one line."""
    plan = good_plan(24)
    postures = plan.postures.copy()
    postures[:, 4] = 0.0
    problem = Problem.from_plan(plan_of(plan.header, postures))
    x = problem.nominal()
    identified = identify(problem, x)
    aimed, _, hit = information_root(problem, x, 1.0)
    shots = aimed.select(np.flatnonzero(hit))
    return OpenShots(
        shots, x, identified.status, identified.facts.null_space, shots.shot_numbers, "measurement"
    )


PLANS = {
    "X-Pattern": lambda: pattern_plan("x"),
    "joint 1 constant": lambda: constant(1),
    "joints 1 and 2 constant": lambda: constant(2),
    "beam on the last axis": lambda: good_plan(12, 5, AXIS_LASER),
    "free laser": lambda: good_plan(16, 5, OPEN_LASER, held=["delta1"]),
    "free probe": lambda: good_plan(16, 7, OPEN_PROBE, target=(700.0, 200.0, 900.0)),
    "base frame": lambda: good_plan(16, held=[]),
}


def path_of(plan: Plan, name: str, amount_deg: float) -> tuple[Problem, MotionPath]:
    judged = check(plan)
    shots, _ = measured_shots(judged)
    direction = next(each for each in judged.identifiability.null_space if name in each.combination)
    path = motion_path(shots, judged.aimed.x, shots.parameters.index(name), direction, np.radians(amount_deg))
    assert path is not None
    return shots, path


def test_of_the_x_pattern_it_is_a_rotation_about_axis_2_with_the_target() -> None:
    shots, path = path_of(pattern_plan("x"), "delta2", 20.0)
    assert np.ptp(shots.joints[:, 0]) < 1e-12
    first = Rotation.from_euler("z", shots.joints[0, 0])  # joint 1; then a and d of the paper's Table 1
    axis, origin = first.apply([0.0, 1.0, 0.0]), first.apply([150.0, 0.0, 486.5])
    block, start = shots.parameters.block("target"), path.xs[len(path.xs) // 2]
    for x, degrees in zip(path.xs, (-20, -10, 0, 10, 20), strict=True):
        turn = Rotation.from_rotvec(np.radians(degrees) * axis)
        expected = start.copy()
        expected[shots.parameters.index("delta2")] += np.radians(degrees)
        expected[block] = origin + turn.apply(start[block] - origin)
        np.testing.assert_allclose(x, expected, atol=1e-9)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", PLANS)
def test_readings_stay_what_they_are_by_plain_numpy(name: str, tmp_path: Path) -> None:
    plan = PLANS[name]()
    judged = check(plan)
    motion = motion_of_plan(judged)
    assert motion is not None
    assert motion.drawn == 1
    assert motion.off_mm < 1e-6
    shots, path = path_of(plan, motion.offset, motion.amount)
    pose, parameters = arm("irb1600", tmp_path).pose, shots.parameters
    groups = ("offset", "target", "tool")
    for x in path.xs:
        free = np.concatenate([x[parameters.group(group)] for group in groups])
        if plan.header.kinds and shots.tool.calibrated:
            free = free[: shots.robot.n + 3]
        left = miss(pose, shots.tool.each[0], shots.joints, shots.spots[:, : shots.tool.residual_size], free)
        assert np.abs(left).max() < 1e-6
    assert abs(path.xs[-1][parameters.index(motion.offset)]) > np.radians(9.0)


def test_of_parallel_axes_two_offsets_take_part() -> None:
    shots = stretched()
    motion = null_motion(shots)
    assert motion is not None
    assert isinstance(shots.null_space[motion.direction].cause, ParallelAxes)
    assert {motion.offset, *motion.moved} >= {"delta4", "delta6"}
    assert motion.off_mm < 1e-6
    # The flange stays; what moves is the axis between the two joints.
    assert motion.marked == "axis"
    first, last = (motion.frames[k].postures[0] for k in (0, -1))
    assert first.links == last.links
    assert np.linalg.norm(np.array(first.mark) - np.array(last.mark)) > 50


def test_what_noise_hides_is_drawn_larger_and_says_how_much() -> None:
    """Joint 1 varies by a little more than nothing: the readings notice 20°, not a small part of it."""
    shots, direction, x, lead = _jittered()
    path = motion_path(shots, x, lead, direction, np.radians(20.0))
    assert path is not None
    assert np.radians(0.05) < path.amount < np.radians(20.0)
    assert 0 < path.noise_share <= 1
    assert path.off_mm > 1e-6


def _jittered() -> tuple[Problem, NullDirection, np.ndarray, int]:
    plan = pattern_plan("x")
    postures = plan.postures.copy()
    postures[:, 0] += np.random.default_rng(1).normal(size=len(postures)) * np.radians(0.2)
    judged = check(plan_of(plan.header, postures))
    shots, _ = measured_shots(judged)
    lead = shots.parameters.index("delta2")
    direction = next(each for each in judged.identifiability.null_space if "delta2" in each.combination)
    return shots, direction, judged.aimed.x, lead


def test_what_the_readings_determine_has_hardly_any_motion() -> None:
    """The control of what they do not notice: a target may not make up for an offset of a good plan."""
    judged = check(good_plan(16))
    shots, _ = measured_shots(judged)
    made_up = NullDirection({"delta2": 1.0, "psd.x": -0.3, "psd.z": -0.2}, "noise", NotResolvable())
    lead = shots.parameters.index("delta2")
    path = motion_path(shots, judged.aimed.x, lead, made_up, np.radians(20.0))
    assert path is None or path.amount < np.radians(0.2)


def test_a_plan_or_run_that_determines_all_has_no_motion() -> None:
    assert motion_of_plan(check(good_plan(16))) is None
    assert good().null_motion is None


def motion_of(result_of: object) -> NullSpaceMotion:
    motion = getattr(result_of, "null_motion", None)
    assert isinstance(motion, NullSpaceMotion)
    return motion


def test_the_posture_that_ends_it_reads_something_else_at_either_end() -> None:
    motion = motion_of(x_pattern())
    (new,) = motion.new
    assert new.off_mm > 10
    for frame in motion.frames:
        (moved,) = frame.new
        assert (moved.off_mm > 10) == (abs(frame.share) == 1) or abs(frame.share) == 0.5
        assert all(posture.off_mm < 1e-6 for posture in frame.postures)
    assert motion.frames[len(motion.frames) // 2].new[0].off_mm == 0


def test_a_posture_in_which_the_arm_blocks_the_beam_is_not_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of those of the remedy the first that is clear is; and none where none is."""
    judged = check(pattern_plan("x"))
    every = motion_of_plan(judged)
    assert every is not None
    blocked = [every.new[0].like]

    def some_blocked(shots: Problem, *_: object) -> np.ndarray:
        return np.isin(np.arange(shots.shots), blocked)

    monkeypatch.setattr("zerobeam.analysis.diagnostics.null_motion.arm_in_the_way", some_blocked)
    others = motion_of_plan(judged)
    assert others is not None
    assert others.new[0].like != every.new[0].like
    blocked.extend(range(99))
    none = motion_of_plan(judged)
    assert none is not None
    assert none.new == ()


def test_its_links_keep_their_lengths() -> None:
    """No picture of a stretched arm: the frames are of the arm itself."""
    motion = motion_of(x_pattern())
    lengths = [
        np.linalg.norm(np.diff(np.array(frame.postures[0].links), axis=0), axis=1) for frame in motion.frames
    ]
    np.testing.assert_allclose(lengths, np.tile(lengths[0], (len(lengths), 1)), atol=0.05)


def test_a_result_shows_no_offset_as_open_that_it_knows() -> None:
    motion = dataclasses.replace(motion_of(x_pattern()), offset="delta4")
    with pytest.raises(UnsoundResult, match="delta4 is determined"):
        dataclasses.replace(x_pattern(), null_motion=motion)
