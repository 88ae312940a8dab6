"""The error of a joint that rests is common to its measurements, and no slip of target or instrument."""

from pathlib import Path

import numpy as np
import pytest
from cells import irb1600, run_of

from zerobeam.analysis.recordings.steps import resting_columns, rests, steps
from zerobeam.analysis.solution import solve
from zerobeam.experiments.simulate import Truth, simulated_shots
from zerobeam.model.files.header import Header
from zerobeam.model.files.plan import Plan, planned
from zerobeam.model.likelihood.problem import Problem

JOINT_DEG, COUNT, FIRST = 0.02, 60, 18


def solution_of(rest_deg: float = 0.0, slip_mm: float = 0.0, *, resting: bool = True, seed: int = 0):
    """Joint 2 rests over the first 18 of 60 measurements, its error there `rest_deg`; the tracker slips by
    `slip_mm` after them. The other joints hardly err."""
    tracker = {"kind": "tracker", "frame": "free", "guess_mm": [2500, 500, 600], "sigma_mm": 0.02}
    own = Header.model_validate(
        {
            "robot": "irb1600",
            "geometry": "exact",
            "instruments": {"trk": {**tracker, "reflectors": {"R": {"guess_mm": [60, 0, 80]}}}},
            "noise": {"joint_deg": JOINT_DEG},
        }
    )
    rng = np.random.default_rng(seed)
    degrees = np.add([20, 10, -10, 30, 50, 20], rng.uniform(-40, 40, (COUNT, 6)))
    if resting:
        degrees[:FIRST, 1] = 10.0
    nowhere = (None,) * COUNT
    plan = Plan(own, irb1600(), planned(degrees, nowhere), nowhere, Path("plan.yaml"), "0" * 64, ())
    truth = Truth.with_values(plan, {"trk.x": 2500.0, "trk.y": 500.0, "trk.z": 600.0, "delta3": 0.4})
    shots = []
    for i, shot in enumerate(simulated_shots(truth, rng)):
        # What was read: the posture that was commanded, but for a fifth of the stated noise.
        joints = degrees[i] + 0.2 * (np.array(shot.joints_deg) - degrees[i])
        joints[1] += rest_deg if i < FIRST else 0.0
        if resting and i < FIRST:
            joints[1] = degrees[i, 1] + rest_deg
        at = np.array(shot.measured_mm) + (slip_mm if i < FIRST else 0.0) * np.array([0.6, 0.0, 0.8])
        changed = {"joints_deg": tuple(joints.tolist()), "measured_mm": tuple(at.tolist())}
        shots.append(shot.model_copy(update=changed))
    return solve(Problem.from_run(run_of(own, shots)), starts=0)


def contradicting(solution):
    return [step for step in solution.recording_steps.rows if step.contradicts]


def test_one_error_of_a_joint_that_rests_is_no_slip():
    solution = solution_of(rest_deg=1.5 * JOINT_DEG)
    ((joint, rows),) = rests(solution.problem)
    assert (joint, rows.tolist()) == (1, list(range(FIRST)))
    without = [step for step in steps(solution.fit).rows if step.contradicts]
    assert without  # what a constant error looks like
    assert (without[0].first_shot, without[0].last_shot) == (0, FIRST - 1)
    assert contradicting(solution) == []
    assert solution.misfit is None


@pytest.mark.parametrize(("resting", "slip_mm"), [(False, 1.0), (True, 10.0)])
def test_control_a_slip_is_found(resting, slip_mm):
    """Where no joint rests, and where one does that would have to err by far more than its noise."""
    (step,) = contradicting(solution_of(slip_mm=slip_mm, resting=resting))
    assert (step.first_shot, step.last_shot) == (0, FIRST - 1)
    assert step.size_mm == pytest.approx(slip_mm, rel=0.3)


def test_a_joint_that_rests_all_the_time_or_never_has_no_columns():
    assert resting_columns(solution_of(resting=False).fit) is None


def test_the_columns_are_what_the_error_does_to_the_residuals():
    """Against a difference: the recorded joint 2 moved over its rest."""
    solution = solution_of(rest_deg=JOINT_DEG)
    columns = resting_columns(solution.fit)
    problem, x = solution.problem, solution.fit.x
    step = 1e-6
    joints = problem.joints.copy()
    joints[:FIRST, 1] += step
    factor = solution.fit.whitened.factor
    moved, here = (one.linearise(x)[0].reshape(problem.shots, -1) for one in (problem.moved(joints), problem))
    by_difference = np.linalg.solve(factor, ((moved - here) / step)[:, :, None])[:, :, 0]
    expected = by_difference.ravel() * np.radians(JOINT_DEG)
    np.testing.assert_allclose(columns[: len(expected), 0], expected, rtol=1e-3, atol=1e-3)
