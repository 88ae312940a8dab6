"""The error before and after is that of the controller's model: known answers, and a second minimisation."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from exact_runs import demo_runs
from scipy.optimize import least_squares

from zerobeam.analysis.acceptance import measured_error
from zerobeam.analysis.ladder import solve_run
from zerobeam.model.files.run import read_run
from zerobeam.model.likelihood.problem import Problem


@cache
def calibrated():
    run = read_run(demo_runs()[0].path)
    return run, solve_run(Problem.from_run(run), run.header)


def entered():
    """The estimates, deg."""
    return {row.name: row.estimate for row in calibrated()[1].offsets if not row.held}


def new_run(joints, targets, spots):
    """A problem of the same robot and laser."""
    run, _ = calibrated()
    return Problem.build(run.header, run.robot, joints, targets, spots)


def nominal_rms(joints, spots):
    """The least error (rms, mm) of the nominal arm over all places of the target, by SciPy; and the place."""
    run, solution = calibrated()
    problem = Problem.build(run.header, run.robot, joints, ["psd"] * len(joints), spots)
    x = problem.nominal()
    for item in problem.parameters.items:
        if item.group == "tool":
            x[problem.parameters.index(item.name)] = solution.fit.x[
                solution.problem.parameters.index(item.name)
            ]
    place = problem.parameters.block("target")

    def residual(point):
        at = x.copy()
        at[place] = point
        return problem.linearise(at)[0].ravel()

    found = least_squares(residual, x[place], xtol=1e-14, ftol=1e-14)
    return float(np.sqrt((found.fun.reshape(len(joints), -1) ** 2).sum(axis=1).mean())), problem, x, found.x


def test_both_are_the_least_error_of_the_nominal_arm():
    _, solution = calibrated()
    problem, rows = solution.problem, [1, 2, 4, 5, 6]
    block = problem.parameters.block("offset")
    joints = problem.joints[rows] + solution.fit.x[block]
    spots = problem.spots[rows]
    measured = measured_error(solution, new_run(joints, ["psd"] * len(rows), spots), entered())
    assert [one.calibration_measurement for one in measured.postures] == rows
    assert measured.before is not None
    assert measured.before.rms_mm == pytest.approx(nominal_rms(problem.joints[rows], spots)[0], rel=1e-6)
    assert measured.after.rms_mm == pytest.approx(nominal_rms(joints, spots)[0], rel=1e-6)
    assert measured.before.rms_mm > 5 * measured.after.rms_mm
    rms = np.sqrt(np.mean([one.before_mm**2 for one in measured.postures]))
    assert measured.before.rms_mm == pytest.approx(rms)
    assert measured.before.worst_mm == max(one.before_mm for one in measured.postures)


def test_a_nominal_arm_without_noise_has_no_error():
    _, solution = calibrated()
    problem = solution.problem
    _, arm, x, _ = nominal_rms(problem.joints, problem.spots)
    residual, _ = arm.linearise(x)
    columns = [
        replace(arm, spots=arm.spots + np.eye(2)[axis]).linearise(x)[0] - residual for axis in range(2)
    ]
    spots = arm.spots - np.linalg.solve(np.stack(columns, axis=2), residual[..., None])[..., 0]
    targets = ["psd"] * len(problem.joints)
    measured = measured_error(solution, new_run(problem.joints, targets, spots), entered())
    assert measured.after.worst_mm < 1e-6
    assert 0.05 < measured.noise_mm < 1.0  # at least that of the spot


def test_a_posture_that_the_calibration_has_not_leaves_as_found_unknown():
    _, solution = calibrated()
    problem = solution.problem
    joints = problem.joints[:4] + solution.fit.x[problem.parameters.block("offset")]
    joints[2] += np.radians(20.0)
    measured = measured_error(solution, new_run(joints, ["psd"] * 4, problem.spots[:4]), entered())
    assert [one.calibration_measurement for one in measured.postures] == [0, 1, None, 3]
    assert measured.before is None
    assert {one.before_mm for one in measured.postures} == {None}
