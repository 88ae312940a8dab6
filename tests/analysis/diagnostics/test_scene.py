"""The scene of a run: what it holds is what the fit says, and nothing that the data do not determine."""

import dataclasses
import json

import numpy as np
import pytest
from cells import (
    PROBE,
    TABLE_2,
    good_plan,
    header,
    irb1600,
    pattern_plan,
    plan_of,
    run_of,
    simulated,
    simulated_problem,
    varied_postures,
)
from measured_arms import CELLS, PLANES, recorded
from scipy import stats

from zerobeam.analysis.diagnostics.scene_data import MOST_SHOTS, RunScene, scene
from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.solution import Solution, solve
from zerobeam.model.files.plan import Plan
from zerobeam.model.likelihood.problem import Problem


def fitted(problem: Problem) -> Solution:
    return solve(problem, starts=0)


def scene_of(plan: Plan, values: dict[str, float] | None = None, seed: int = 3) -> RunScene:
    found = scene(fitted(simulated_problem(plan, values, seed)[1]))
    return found


def gauge_problem() -> Problem:
    """An X-Pattern in which joint 1 reads the same in every shot: δ2 and the target are an exact gauge."""
    _, run = simulated(pattern_plan("x"), TABLE_2, 3)
    own = run.header.model_copy(update={"targets": {}})
    shots = [shot.model_copy(update={"joints_deg": (0.0, *shot.joints_deg[1:])}) for shot in run.shots]
    return Problem.from_run(run_of(own, shots))


def test_arm_beams_and_target_are_those_of_the_fit() -> None:
    truth, problem = simulated_problem(good_plan(), TABLE_2, 3)
    solution = fitted(problem)
    fit, found = solution.fit, scene(solution)
    origin, direction = problem.beams(fit.x)
    (target,) = found.targets
    assert target.at_mm is not None
    for i, shot in enumerate(found.shots):
        (points,) = problem.functions.kernel("skeleton")(problem.joints[i : i + 1], fit.x[: problem.robot.n])
        np.testing.assert_allclose(shot.links, [*points[0].T, origin[i]], atol=1e-9)
        assert shot.ahead
        along = np.subtract(shot.beam_to, origin[i])
        np.testing.assert_allclose(np.cross(along, direction[i]), 0, atol=1e-9)
        np.testing.assert_allclose(np.subtract(target.at_mm, shot.beam_to) @ direction[i], 0, atol=1e-9)
        assert np.linalg.norm(np.subtract(target.at_mm, shot.beam_to)) < 1.0
    std = problem.parameters.unscaled(fit.std)[6:9]
    np.testing.assert_allclose(np.sqrt(np.diag(target.covariance_mm2)), std)
    assert np.linalg.norm(target.at_mm - truth.x[6:9]) < 1.0
    assert found.radius2 == pytest.approx(stats.chi2.ppf(0.95, 3))


def test_the_ellipsoid_is_wider_where_the_noise_is_estimated() -> None:
    found = scene_of(good_plan(6, noise={"scale": "estimated"}), TABLE_2)
    assert found.radius2 == pytest.approx(3 * stats.f.ppf(0.95, 3, 12 - 8))


@pytest.mark.parametrize("count", [30, pytest.param(400, marks=pytest.mark.long)])
@pytest.mark.long
def test_the_ellipsoid_holds_the_place_as_often_as_it_says(count: int) -> None:
    plan = good_plan(6, noise={"scale": "estimated"})
    inside, by_chance, by_half = 0, 0, 0
    for seed in range(count):
        truth, problem = simulated_problem(plan, TABLE_2, seed)
        found = scene(fitted(problem))
        (target,) = found.targets
        assert target.at_mm is not None
        off = target.at_mm - truth.x[6:9]
        distance2 = off @ np.linalg.solve(np.array(target.covariance_mm2), off)
        inside += bool(distance2 <= found.radius2)
        by_half += bool(distance2 <= found.radius2 / 16)
        by_chance += bool(distance2 <= stats.chi2.ppf(0.95, 3))
    least = stats.binom.ppf(1e-3, count, 0.95)
    assert inside >= least
    # Negative controls: half axes of a quarter, and (on enough draws to tell) those of a known noise.
    assert by_half < least
    assert count < 400 or by_chance < least


def test_what_the_data_leave_open_is_drawn_at_its_prior_and_has_no_place() -> None:
    problem = gauge_problem()
    solution = fitted(problem)
    fit = solution.fit
    assert solution.status[1] == "unidentifiable"
    assert abs(np.degrees(fit.x[1])) > 0.01  # the mode has a value, which is nobody's business
    found = scene(solution)
    (target,) = found.targets
    assert target.at_mm is target.covariance_mm2 is None
    at_zero = fit.x[: problem.robot.n].copy()
    at_zero[1] = 0
    skeleton = problem.functions.kernel("skeleton")
    elbow = [(shot.links[2], shot.links[3]) for shot in found.shots]
    (by_zero,) = skeleton(problem.joints, at_zero)
    (by_mode,) = skeleton(problem.joints, fit.x[: problem.robot.n])
    np.testing.assert_allclose(elbow, by_zero.transpose(0, 2, 1)[:, 2:4], atol=0.05)
    assert np.abs(np.array(elbow) - by_mode.transpose(0, 2, 1)[:, 2:4]).max() > 0.05
    # All else is where it would be then: the beams still meet.
    ends = np.array([shot.beam_to for shot in found.shots])
    assert np.ptp(ends, axis=0).max() < 3.0


def test_a_held_place_has_no_ellipsoid() -> None:
    own = header(held=["delta1", "psd.x", "psd.y", "psd.z"])
    postures = varied_postures(own, irb1600(), (900.0, 0.0, 0.0), 10, 5)
    found = scene_of(plan_of(own, postures))
    assert found.targets[0].at_mm == (900.0, 0.0, 0.0)
    assert found.targets[0].covariance_mm2 is None


def test_a_fit_that_did_not_converge_has_no_scene() -> None:
    solution = fitted(simulated_problem(good_plan(), TABLE_2, 3)[1])
    lost = dataclasses.replace(solution, fit=dataclasses.replace(solution.fit, converged=False))
    assert scene(lost) is None


def test_of_many_shots_sixty_are_shown_evenly() -> None:
    plan = good_plan(10)
    found = scene_of(plan_of(plan.header, np.tile(plan.postures, (20, 1))))
    numbers = [shot.shot for shot in found.shots]
    assert len(numbers) == MOST_SHOTS
    assert numbers[0] == 0
    assert numbers[-1] == 199
    assert set(np.diff(numbers)) == {3, 4}
    assert len(json.dumps(dataclasses.asdict(found))) < 50_000


def test_a_probe_has_no_beam() -> None:
    found = scene_of(good_plan(tool=PROBE))
    assert all(shot.beam_to is None for shot in found.shots)
    assert found.targets[0].at_mm is not None
    for shot in found.shots:
        assert np.linalg.norm(np.subtract(shot.links[-1], found.targets[0].at_mm)) < 1.0


def test_a_laser_that_points_away_is_told_and_its_beam_shown() -> None:
    solution = fitted(simulated_problem(good_plan(), TABLE_2, 3)[1])
    fit = solution.fit
    origin, direction = fit.problem.beams(fit.x)
    behind = fit.x.copy()
    behind[6:9] = origin[0] - 500 * direction[0]
    turned = dataclasses.replace(solution, fit=dataclasses.replace(fit, x=behind))
    found = scene(turned)
    assert not found.shots[0].ahead
    np.testing.assert_allclose(found.shots[0].beam_to, origin[0] + 500 * direction[0])


def solved(kind, count=24):
    """A solution by instruments of a `kind`, and where the world is."""
    cell = CELLS[kind]
    header, robot = cell.header(geometry="exact", joint_deg=0.002), irb1600()
    arm = recorded(cell, count, np.random.default_rng(2), exact=True, joint_deg=0.002)
    problem = Problem.of_measured(header, robot, arm.joints, arm.measured)
    return solve_run(problem, header), arm


@pytest.mark.long
def test_lines_of_sight_end_where_the_tracker_and_the_socket_are():
    solution, arm = solved("tracker + plane + ballbar", 28)
    drawn = scene(solution)
    values = {row.name: row.estimate for row in solution.parameters}
    places = {name: [values[f"{name}.{axis}"] for axis in "xyz"] for name in ("leica", "s1", "s2")}
    for shot, some in zip(drawn.shots, arm.measured, strict=True):
        by_instrument = {item.instrument for item in some}
        if by_instrument == {"tip"}:  # it touches: there is no way to its target
            assert shot.sights == ()
            continue
        assert len(shot.sights) == len(some)
        to = places["leica" if by_instrument == {"leica"} else some[0].target]
        for (start, end), item in zip(shot.sights, some, strict=True):
            np.testing.assert_allclose(end, to, atol=1e-6)
            length = np.linalg.norm(np.subtract(start, end))
            read = np.linalg.norm(item.measured["measured_mm"])
            zero = values["bar.bias"] if item.instrument == "bar" else 0.0
            assert length == pytest.approx(read - zero, abs=0.5)
        assert shot.beam_to is None
    assert {target.name: target.station for target in drawn.targets} == {
        "leica": True,
        "s1": False,
        "s2": False,
    }


@pytest.mark.long
def test_planes_and_balls_are_outlined_where_they_were_touched():
    solution, _ = solved("plane")
    outlines = {outline.target: outline.lines for outline in scene(solution).outlines}
    tips = {name: [] for name in PLANES}
    for shot in scene(solution).shots:
        tips[shot.target].append(shot.links[-1])
    for name, ((first, *others),) in outlines.items():
        normal = np.cross(np.subtract(others[0], first), np.subtract(others[1], first))
        normal /= np.linalg.norm(normal)
        above = (np.array(tips[name]) - first) @ normal
        assert np.abs(above).max() < 0.5  # what was touched is on it
        assert np.abs(np.array([first, *others]) @ np.array(PLANES[name]["normal"])).max() > 100
    assert set(outlines) == set(PLANES)
    solution, _ = solved("sphere", 30)
    ((outline,), tips) = scene(solution).outlines, [shot.links[-1] for shot in scene(solution).shots]
    (target,) = scene(solution).targets
    for line in outline.lines:
        np.testing.assert_allclose(np.linalg.norm(np.subtract(line, target.at_mm), axis=1), 20.0)
    np.testing.assert_allclose(np.linalg.norm(np.subtract(tips, target.at_mm), axis=1), 20.0, atol=0.5)
