"""The tool point's accuracy: closed forms, Monte Carlo, gauges, and no number where the data tell none."""

import dataclasses

import numpy as np
import pytest
from cells import (
    OPEN_LASER,
    OPEN_PROBE,
    PROBE,
    TABLE_2,
    good_plan,
    irb1600,
    pattern_plan,
    random_robot,
    simulated_problem,
)
from made_fit import by_hand
from made_problem import many_runs
from plain_model import arm, by_complex_step
from scipy import stats

from zerobeam.analysis.diagnostics.accuracy import (
    accuracy,
    arm_covariance,
    radius95,
    tool_point,
)
from zerobeam.analysis.estimation.fit import fit_likelihood, fit_rows, start_at
from zerobeam.analysis.solution import Solution, judge
from zerobeam.analysis.tcp_region import judged_axis, region_postures
from zerobeam.model.kinematics.dh import DHRow, dh_chain
from zerobeam.model.kinematics.pendant import spread_postures
from zerobeam.model.kinematics.robot import Joint, Robot
from zerobeam.model.likelihood.density import Density
from zerobeam.words.finding_words import accuracy_reason, tcp_words

CHANCE = 1e-3  # of a test that is right to fail: two sides together


def judged(problem, **changes):
    fit = dataclasses.replace(fit_likelihood(problem, starts=0), **changes)
    return judge(fit)


def answered(plan, **changes):
    return accuracy(judged(simulated_problem(plan, TABLE_2, seed=1)[1], **changes))


def binomial(inside, of, share=0.95):
    """Whether so many of so many are what chance makes of that share."""
    return stats.binom.ppf(CHANCE / 2, of, share) <= inside <= stats.binom.isf(CHANCE / 2, of, share)


def levels(answer):
    return [
        value
        for region in (answer.workspace, answer.near_shots)
        for level in (region.before_mm, region.before_std_mm, region.after95_mm, region.after_rms_mm)
        for value in dataclasses.astuple(level)
    ]


@pytest.mark.parametrize("name", ["irb1600", "modified", "scara", "gantry", "bent"])
def test_position_and_jacobian_against_the_plain_model(name, tmp_path):
    own = arm(name, tmp_path)
    n, point = own.robot.n, np.array([20.0, -30.0, 80.0])
    solution = by_hand(own.robot, PROBE, np.full(n, 0.02), np.eye(n))
    problem, fit = solution.problem, solution.fit
    joints = np.array([own.random(np.random.default_rng(i)) for i in range(4)])
    position, jacobian = tool_point(problem, fit.x, point, joints)
    # In the base frame that the encoder of joint 1 draws: its own offset does not enter.
    delta = np.full(n, 0.02) * (np.arange(n) > 0)

    def place(q):
        return lambda d: (own.pose(q + d) @ np.append(point, 1))[:3]

    for q, at, by in zip(joints, position, jacobian, strict=True):
        np.testing.assert_allclose(at, place(q)(delta).real, atol=1e-9)
        exact = by_complex_step(place(q), delta)
        assert np.abs(exact[:, 0]).max() > 0.1
        np.testing.assert_allclose(by, exact * (np.arange(n) > 0), atol=1e-8)


def test_postures_fill_the_limits_evenly():
    lower, upper = np.array([-1.0, 0.0, 5.0]), np.array([1.0, 300.0, 5.0])
    postures = spread_postures(lower, upper, 1000)
    assert (postures >= lower).all()
    assert (postures <= upper).all()
    counts, *_ = np.histogram2d(postures[:, 0], postures[:, 1], bins=5, range=[(-1, 1), (0, 300)])
    # 40 a cell; drawn by chance one of the 25 cells would be off by 12.
    assert np.abs(counts - 40).max() <= 6


def planar(prismatic=False):
    """A column that turns, then a shoulder and an elbow with level axes: links of 400 and 300 mm. Or a
    column, a level slide and a turn about its own axis."""
    rows = [DHRow(0, -np.pi / 2, 500, 0), DHRow(400, 0, 0, 0), DHRow(300, 0, 0, 0)]
    kinds = ["revolute"] * 3
    if prismatic:
        rows[1:] = [DHRow(0, 0, 0, 0), DHRow(0, 0, 300, 0)]
        kinds[1] = "prismatic"
    fixed, flange = dh_chain(rows, "standard")
    axis = np.array([0.0, 0.0, 1.0])
    half = {"revolute": np.pi, "prismatic": 250.0}
    joints = [Joint(k, k, f, axis, -half[k], half[k]) for k, f in zip(kinds, fixed, strict=True)]
    return Robot("planar", tuple(joints), flange)


AT_FLANGE = {**PROBE, "point_mm": [0, 0, 0]}


def test_one_uncertain_elbow_moves_the_hand_along_a_line():
    """T is off by 300 mm times the error of the elbow: along a line, in every posture the same."""
    std, elbow = np.radians(0.05), np.radians(1.0)
    answer = accuracy(by_hand(planar(), AT_FLANGE, [0, 0, elbow], np.diag([0, 0, std**2])))
    for region in (answer.workspace, answer.near_shots):
        assert dataclasses.astuple(region.after95_mm) == pytest.approx((1.959964 * 300 * std,) * 2, rel=1e-4)
        assert dataclasses.astuple(region.after_rms_mm) == pytest.approx((300 * std,) * 2)
        assert dataclasses.astuple(region.before_mm) == pytest.approx((600 * np.sin(elbow / 2),) * 2)
        # The way back is half the turn off the line of the error.
        assert dataclasses.astuple(region.before_std_mm) == pytest.approx(
            (300 * std * np.cos(elbow / 2),) * 2
        )


def test_shoulder_and_elbow_add_up_by_their_levers():
    """Both errors lie in the upright plane: rms^2 = (r s2)^2 + (300 s3)^2 + 2 cov (dot product of the
    levers), with r the distance from the shoulder."""
    s2, s3 = np.radians([0.03, 0.05])
    covariance = np.diag([0, s2**2, s3**2])
    covariance[1, 2] = covariance[2, 1] = -0.4 * s2 * s3
    solution = by_hand(planar(), AT_FLANGE, [0, 0.01, -0.02], covariance)
    problem = solution.problem
    postures = region_postures(problem, 4096)
    elbow = postures[:, 2] - 0.02
    r_squared = 400**2 + 300**2 + 2 * 400 * 300 * np.cos(elbow)
    both = 300 * (300 + 400 * np.cos(elbow))
    rms = np.sqrt(r_squared * s2**2 + (300 * s3) ** 2 + 2 * covariance[1, 2] * both)
    found = accuracy(solution).workspace.after_rms_mm
    assert found.worst == pytest.approx(rms.max())
    assert found.median == pytest.approx(np.sort(rms)[2047])


def test_a_slide_is_off_by_its_own_error_in_millimetres():
    solution = by_hand(planar(True), AT_FLANGE, [0.3, 2.0, 0.0], np.diag([0, 0.05**2, 0]))
    answer = accuracy(solution)
    assert levels(answer)[:8] == pytest.approx(
        [2, 2, 0.05, 0.05, 1.959964 * 0.05, 1.959964 * 0.05, 0.05, 0.05], rel=1e-4
    )


@pytest.mark.parametrize("kinds", ["pprr", "rpp"])
@pytest.mark.one_in(2)
def test_arms_with_slides(kinds):
    """Numbers for any arm; the first joint's offset has no part in them, a slide's neither."""
    n = len(kinds)
    covariance = np.diag(np.where(np.array(list(kinds)) == "r", 1e-3, 0.1) ** 2)
    robot, delta = random_robot(kinds, 3), np.where(np.array(list(kinds)) == "r", 0.01, 2.0)
    answer = accuracy(by_hand(robot, PROBE, delta, covariance))
    covariance[0, 0] *= 100
    delta[0] *= 7
    assert accuracy(by_hand(robot, PROBE, delta, covariance)) == answer
    covariance[n - 1, n - 1] *= 100
    assert accuracy(by_hand(robot, PROBE, delta, covariance)) != answer
    assert min(levels(answer)) > 0


def test_no_part_of_the_gauge_of_joint_1_enters():
    """Base and target turned about joint 1 by any amount: nothing changes, to the last bit."""
    solution = judged(simulated_problem(good_plan(8, held=[]), TABLE_2, seed=1)[1])
    problem, fit, identified = solution.problem, solution.fit, solution.identified
    assert identified.status[0] == "unidentifiable"
    answer = accuracy(solution)
    assert answer.undetermined == ()
    for turn in (0.1, -2.0):
        x = fit.x.copy()
        x[0] += turn
        c, s = np.cos(turn), np.sin(turn)
        x[6:8] = [c * x[6] - s * x[7], s * x[6] + c * x[7]]
        # It is a gauge indeed: no miss has moved.
        np.testing.assert_allclose(problem.linearise(x)[0], problem.linearise(fit.x)[0], atol=1e-9)
        assert accuracy(dataclasses.replace(solution, fit=dataclasses.replace(fit, x=x))) == answer
    x = fit.x.copy()
    x[1] += 0.001
    assert accuracy(dataclasses.replace(solution, fit=dataclasses.replace(fit, x=x))) != answer


def test_nothing_is_claimed_for_the_x_pattern():
    """Joint 2 turns with the target: the tool point's height is anything."""
    solution = judged(simulated_problem(pattern_plan("x"), TABLE_2, seed=1)[1])
    fit, identified = solution.fit, solution.identified
    answer = accuracy(solution)
    assert (answer.workspace, answer.near_shots, answer.maps, answer.weak) == (None, None, (), ())
    assert "delta2" in answer.undetermined
    why = accuracy_reason(answer)
    assert "delta2, " in why or "delta2 and" in why
    assert "unidentifiable: " in why
    assert "an offset of joint 2 is equivalent to a rotation of everything after joint 1" in why
    # Negative control: a status that is made up lets numbers through.
    wrong = dataclasses.replace(identified, status=("held",) + ("identified",) * 8)
    assert accuracy(Solution(fit, wrong)).workspace is not None


def test_an_offset_that_is_held_is_not_known():
    answer = answered(good_plan(8, held=["delta1", "delta3"]))
    assert (answer.workspace, answer.undetermined) == (None, ("delta3",))
    assert accuracy_reason(answer) == "the TCP depends on delta3, which is held: held by the header"


def test_a_fit_that_did_not_converge_claims_nothing():
    answer = answered(good_plan(8), converged=False)
    assert answer.workspace is None
    assert answer.maps == ()
    assert accuracy_reason(answer) == "the fit did not converge"


def test_weak_offsets_are_named_and_widen_the_radius():
    strong, weak = answered(good_plan(8)), answered(good_plan(8, joint_deg=0.3, spot_mm=1.5))
    assert strong.weak == ()
    assert "delta2" in weak.weak
    assert weak.workspace.after95_mm.worst > 10 * strong.workspace.after95_mm.worst


def test_the_radius_allows_for_the_noise_that_is_estimated():
    """By its degrees of freedom: six here."""
    solution = judged(simulated_problem(good_plan(7, noise={"scale": "estimated"}), TABLE_2, seed=1)[1])
    problem, fit = solution.problem, solution.fit
    joints = region_postures(problem, 4096)
    _, jacobian = tool_point(problem, fit.x, problem.tool.point, joints)
    of_point = jacobian @ arm_covariance(problem, fit.covariance) @ jacobian.transpose(0, 2, 1)
    assert solution.dof == 6
    assert accuracy(solution).workspace.after95_mm.worst == pytest.approx(radius95(of_point, 6).max())


ASIDE = [60.0, 20.0, 150.0]


@pytest.mark.parametrize("tool", [{**OPEN_LASER, "point_mm": ASIDE}, OPEN_PROBE], ids=["laser", "probe"])
@pytest.mark.parametrize("last", ["held", "unidentifiable"])
def test_with_a_lost_last_offset_the_place_is_on_the_last_axis(tool, last):
    """Where joint 6 really stands nobody knows: a point aside of its axis would be anywhere on a circle."""
    delta, covariance = np.radians([0, -1.2, -0.7, 0.1, 0, 0]), np.eye(6) * 1e-7
    made = by_hand(irb1600(), tool, delta, covariance, {5: last})
    answer = accuracy(made)
    assert answer.point_mm == pytest.approx((0, 0, 150))
    assert "axis of joint 6 nearest to the stated point of the tool, as delta6" in tcp_words(answer)
    covariance[5, 5] = 1.0
    assert accuracy(by_hand(irb1600(), tool, delta, covariance, {5: last})) == answer
    # What the offsets do to the tool's own point: that of joint 6 is a part of it.
    assert np.sqrt(answer.sensitivity_mm2[5][5]) == pytest.approx(np.radians(np.hypot(*ASIDE[:2])), rel=1e-6)
    assert judged_axis(made.problem, made.status) == 6
    asked = accuracy(made, np.array(ASIDE))
    assert asked.point_mm == tuple(ASIDE)
    assert (asked.workspace, asked.undetermined) == (None, ("delta6",))
    # With an offset that is known the point is the tool's own.
    answer = accuracy(by_hand(irb1600(), tool, delta, covariance))
    assert (answer.point_mm, tcp_words(answer)) == (tuple(ASIDE), "the stated point of the tool")
    assert judged_axis(made.problem, by_hand(irb1600(), tool, delta, covariance).status) is None


def test_maps_hold_every_posture_and_their_worst_is_the_workspaces():
    answer = answered(good_plan(8))
    vertical, horizontal = answer.maps
    assert (vertical.plane, horizontal.plane) == ("vertical", "horizontal")
    for found in answer.maps:
        postures, shots = np.array(found.postures), np.array(found.shots)
        assert max(postures.shape) <= 20
        assert (postures.sum(), shots.sum()) == (answer.workspace.postures, 8)
        for level, own in (
            (answer.workspace.before_mm, found.before_mm),
            (answer.workspace.after95_mm, found.after95_mm),
        ):
            worst, median = np.array(own.worst, dtype=float), np.array(own.median, dtype=float)
            np.testing.assert_array_equal(np.isnan(worst), postures == 0)
            assert np.nanmax(worst) == level.worst
            assert (median <= worst)[postures > 0].all()
            assert np.nanmin(median) < level.median < np.nanmax(median)


def test_cells_hold_the_postures_that_are_there():
    """Counted a second time, by the plain forward kinematics at the corner and size that are told."""
    solution = judged(simulated_problem(good_plan(8), TABLE_2, seed=1)[1])
    problem, fit = solution.problem, solution.fit
    answer = accuracy(solution)
    at, _ = tool_point(
        problem,
        fit.x,
        np.array([0, 0, 65.0]),
        region_postures(problem, 4096),
    )
    planes = {"vertical": (np.hypot(at[:, 0], at[:, 1]), at[:, 2]), "horizontal": (at[:, 0], at[:, 1])}
    for found in answer.maps:
        rows, columns = len(found.postures), len(found.postures[0])
        edges = [
            corner + found.cell_mm * np.arange(count + 1)
            for corner, count in zip(found.corner_mm, (columns, rows), strict=True)
        ]
        counts, *_ = np.histogram2d(*planes[found.plane], bins=edges)
        np.testing.assert_array_equal(counts.T, found.postures)


def test_the_vertical_map_is_about_the_axis_of_joint_1(tmp_path):
    """An arm whose first axis leans and stands aside: turning joint 1 keeps the tool point in its cell."""
    own = arm("bent", tmp_path)
    robot = own.robot
    fixed = [dataclasses.replace(robot.joints[0], lower=-2.5, upper=-2.5 + 1e-9), *robot.joints[1:]]
    still = dataclasses.replace(robot, joints=tuple(fixed))
    other = [dataclasses.replace(robot.joints[0], lower=1.0, upper=1.0 + 1e-9), *robot.joints[1:]]
    turned = dataclasses.replace(robot, joints=tuple(other))
    delta, covariance = np.full(robot.n, 0.01), np.eye(robot.n) * 1e-6
    first, second = (accuracy(by_hand(each, PROBE, delta, covariance)) for each in (still, turned))
    np.testing.assert_array_equal(first.maps[0].postures, second.maps[0].postures)
    assert first.maps[1].postures != second.maps[1].postures
    assert [found.axes for found in first.maps] == [("distance from axis 1", "height"), ("x", "y")]
    slide = accuracy(by_hand(arm("gantry", tmp_path).robot, PROBE, np.zeros(4), np.eye(4) * 1e-6))
    assert slide.maps[0].axes[0] == "distance from the base's z axis"


def random_postures(problem, count, seed):
    robot = problem.robot
    return np.random.default_rng(seed).uniform(robot.lower, robot.upper, (count, robot.n))


@pytest.mark.parametrize("count", [400, pytest.param(5000, marks=pytest.mark.long)], ids=["short", "long"])
@pytest.mark.parametrize("scale", ["known", "estimated"])
@pytest.mark.one_in(2)
def test_the_radius_holds_the_truth_behind_simulated_runs(scale, count):
    """The whole chain: simulated runs, each fitted, each looked at in a posture of its own."""
    truth, problem, recorded, spots = many_runs(good_plan(7, noise={"scale": scale}), TABLE_2, count, seed=31)
    density = Density(problem, recorded, spots)
    fits = fit_rows(density, start_at(problem, np.zeros((count, density.size)), recorded))
    assert fits.converged.all()
    point, joints = problem.tool.point, random_postures(problem, count, 6)
    true, _ = tool_point(problem, truth, point, joints)
    error, of_point = np.empty(count), np.empty((count, 3, 3))
    for i, (x, covariance) in enumerate(zip(fits.x, fits.covariance, strict=True)):
        at, jacobian = tool_point(problem, x, point, joints[i : i + 1])
        error[i] = np.linalg.norm(at[0] - true[i])
        of_point[i] = jacobian[0] @ arm_covariance(problem, covariance) @ jacobian[0].T
    dof = problem.data_size - density.size if scale == "estimated" else None
    assert binomial((error < radius95(of_point, dof)).sum(), count)
    # Negative control: stds that are understated by 2.
    assert not binomial((error < radius95(of_point / 4, dof)).sum(), count)
    if dof is not None:
        # Nor does the normal law do for a scale from six numbers.
        assert not binomial((error < radius95(of_point)).sum(), count)


def test_the_spread_of_two_joints_is_by_the_plastic_ratio() -> None:
    plastic = 1.324717957244746  # x^3 = x + 1
    expected = [[10 + 10 * ((0.5 + k / plastic**j) % 1) for j in (1, 2)] for k in range(1, 6)]
    np.testing.assert_allclose(spread_postures(np.array([10.0, 10]), np.array([20.0, 20]), 5), expected)
