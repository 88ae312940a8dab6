"""The picture of a run: what it shows is what the fit says, and nothing that the data do not determine."""

from __future__ import annotations

import dataclasses
import functools
import json
import re
from pathlib import Path
from typing import Any

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
from chromium import LAPTOP, PAPER, chromium
from example_results import HOSTILE_NAMES
from pages import Page, assert_fetches_nothing
from scipy import stats

from zerobeam.analysis.diagnostics.scene import MOST_SHOTS, RunScene, scene
from zerobeam.analysis.solution import ParameterResult, Solution, solve
from zerobeam.model.files.plan import Plan
from zerobeam.model.likelihood.problem import Problem
from zerobeam.reports.output.html import scene_html, style
from zerobeam.reports.run.run_scene import half_axes, run_scene, run_turnable, scene_section
from zerobeam.reports.scenes.scene import Placed, Posed, Scene3D


@dataclasses.dataclass(frozen=True)
class Pictured:
    """As much of a Result as the picture needs."""

    scene: RunScene | None
    parameters: tuple[ParameterResult, ...]
    shots: tuple[None, ...]


def fitted(problem: Problem) -> Solution:
    return solve(problem, starts=0)


def scene_of(plan: Plan, values: dict[str, float] | None = None, seed: int = 3) -> RunScene:
    found = scene(fitted(simulated_problem(plan, values, seed)[1]))
    assert found is not None
    return found


def gauge_problem() -> Problem:
    """An X-Pattern in which joint 1 reads the same in every shot: δ2 and the target are an exact gauge."""
    _, run = simulated(pattern_plan("x"), TABLE_2, 3)
    own = run.header.model_copy(update={"targets": {}})
    shots = [shot.model_copy(update={"joints_deg": (0.0, *shot.joints_deg[1:])}) for shot in run.shots]
    return Problem.from_run(run_of(own, shots))


def answer_of(solution: Solution) -> Any:
    return Pictured(scene(solution), tuple(solution.parameters), (None,) * solution.problem.shots)


@functools.cache
def good_answer() -> Any:
    return answer_of(fitted(simulated_problem(good_plan(), TABLE_2, 3)[1]))


@functools.cache
def gauge_answer() -> Any:
    return answer_of(fitted(gauge_problem()))


# ── what the fit says ─────────────────────────────────────────────────────────────────────────


def test_arm_beams_and_target_are_those_of_the_fit() -> None:
    truth, problem = simulated_problem(good_plan(), TABLE_2, 3)
    solution = fitted(problem)
    fit, found = solution.fit, scene(solution)
    assert found is not None
    origin, direction = problem.beams(fit.x)
    (target,) = found.targets
    assert target.at_mm is not None
    assert target.covariance_mm2 is not None
    for i, shot in enumerate(found.shots):
        (points,) = problem.functions.kernel("skeleton")(problem.joints[i : i + 1], fit.x[: problem.robot.n])
        np.testing.assert_allclose(shot.links, [*points[0].T, origin[i]], atol=1e-9)
        assert shot.beam_to is not None
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
def test_the_ellipsoid_holds_the_place_as_often_as_it_says(count: int) -> None:
    plan = good_plan(6, noise={"scale": "estimated"})
    inside, by_chance, by_half = 0, 0, 0
    for seed in range(count):
        truth, problem = simulated_problem(plan, TABLE_2, seed)
        found = scene(fitted(problem))
        assert found is not None
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
    assert found is not None
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
    answer = answer_of(lost)
    assert scene_section(answer) is None
    assert run_turnable(answer) is None


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
    assert found is not None
    assert not found.shots[0].ahead
    np.testing.assert_allclose(found.shots[0].beam_to, origin[0] + 500 * direction[0])
    answer = answer_of(turned)
    shown, good = run_turnable(answer), run_turnable(good_answer())
    assert shown is not None
    assert good is not None
    assert shown.unreached
    assert not good.unreached


# ── what the picture shows ────────────────────────────────────────────────────────────────────


def test_half_axes_of_a_known_covariance() -> None:
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    axes = half_axes(turn @ np.diag([4.0, 9.0, 1.0]) @ turn.T, 7.0)
    np.testing.assert_allclose(np.linalg.norm(axes, axis=1), np.sqrt(7.0) * np.array([1, 2, 3]))
    np.testing.assert_allclose(np.abs(axes @ turn[:, 1]), [0, 0, 3 * np.sqrt(7.0)], atol=1e-9)


def test_ellipsoids_are_exaggerated_by_a_power_of_ten_that_can_be_seen() -> None:
    arm = np.array([[0.0, 0, 0], [0, 0, 500], [500, 0, 500]])
    posed = Posed("one", arm, arm[-1], None, True)
    for size, factor in ((0.001, 1000), (0.3, 100), (3.0, 10), (400.0, 1)):
        told = Placed("psd", np.zeros(3), "estimated", size * np.eye(3))
        assert Scene3D([posed], [told]).factor == factor
    assert Scene3D([posed], [Placed("psd", np.zeros(3), "undetermined")]).factor is None


def test_an_undetermined_target_is_a_cross_with_words_and_no_number() -> None:
    answer = gauge_answer()
    picture, shown = run_scene(answer), run_turnable(answer)
    assert picture is not None
    assert shown is not None
    assert [target.state for target in picture.targets] == ["undetermined"]
    assert [target.axes for target in picture.targets] == [None]
    assert "psd: not determined" in shown.drawing
    assert '<path class="undetermined"' in shown.drawing
    assert "<ellipse" not in shown.drawing
    assert shown.undetermined
    assert shown.factor is None
    assert "J2 (δ2) is not determined by these data" in shown.caption
    section = scene_section(answer)
    assert section is not None
    assert section.blocks[0].text == "In the base frame (x, y, z): psd not determined by these data."
    # Negative control: where it is determined there is an ellipsoid, a number, and no such word.
    good = run_turnable(good_answer())
    assert good is not None
    assert good.drawing.count("<ellipse") == 1
    assert "not determined" not in good.drawing + good.caption + good.alt
    assert re.search(r"psd at 899\.\d\d, 0\.\d\d, 0\.\d\d\u00a0mm, half axes", good.alt)
    assert "an ellipsoid is drawn 100 times its true size" in good.paper


def test_an_open_tool_is_named() -> None:
    answer = good_answer()
    lost = next(row for row in gauge_answer().parameters if row.status == "unidentifiable")
    tool = [dataclasses.replace(lost, name=f"tool.{axis}", group="tool") for axis in "xy"]
    shown = run_turnable(dataclasses.replace(answer, parameters=(*answer.parameters, *tool)))
    assert shown is not None
    assert "tool.x and tool.y are not determined by these data: the picture has them" in shown.caption


def page_of(answer: Any) -> str:
    """A page with nothing but the picture."""
    shown = run_turnable(answer)
    assert shown is not None
    return scene_html("Scene", shown)


def test_the_page_is_small_and_hostile_names_stay_names() -> None:
    answer = good_answer()
    (target,) = answer.scene.targets
    targets = tuple(dataclasses.replace(target, name=name) for name in HOSTILE_NAMES)
    pairs = zip(answer.scene.shots, HOSTILE_NAMES, strict=True)
    shots = tuple(dataclasses.replace(shot, target=name) for shot, name in pairs)
    seen = dataclasses.replace(answer.scene, shots=shots, targets=targets)
    text = page_of(dataclasses.replace(answer, scene=seen))
    text.encode()
    page = Page(text)
    assert_fetches_nothing(page)
    assert text.count("<script") == 2
    assert "\x00" not in text
    assert "\u202e" not in text
    assert len(text) - len(style()) < 60_000
    assert len(page.scene["targets"]) == len(HOSTILE_NAMES)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "scene.html"
    path.write_text(page_of(good_answer()), encoding="utf-8")
    return path


@pytest.mark.browser
def test_sliders_and_keys_say_in_words_what_they_do(file: Path) -> None:
    said = "document.querySelector('[data-says={}]').textContent".format
    slide = (
        "(() => {{ const s = document.querySelector('[data-of={}]');"
        " s.value = {}; s.dispatchEvent(new Event('input')); }})()"
    ).format
    pixels = "document.querySelector('canvas').toDataURL()"
    with chromium().opened(file) as tab:
        assert tab.value(said("factor")) == "drawn 100 times its true size"
        assert tab.value(said("posture")) == "measurement 0 at psd (1 of 10)"
        before = tab.value(pixels)
        tab.value(slide("factor", 3))
        assert tab.value(said("factor")) == "drawn 1000 times its true size"
        tab.value(slide("factor", 0))
        assert tab.value(said("factor")) == "drawn at its true size"
        assert tab.value("document.getElementById('scene-factor').getAttribute('aria-valuetext')") == (
            "drawn at its true size"
        )
        tab.value(slide("posture", 4))
        assert tab.value(said("posture")) == "measurement 4 at psd (5 of 10)"
        tab.value("document.querySelector('canvas').focus()")
        for key in ("n", "ArrowLeft", "]"):
            tab.key(key)
        assert tab.value(said("posture")) == "measurement 5 at psd (6 of 10)"
        assert tab.value(said("factor")) == "drawn 2 times its true size"
        drawn = f"new Promise((then) => requestAnimationFrame(() => then({pixels})))"
        assert tab.value(drawn) != before
        assert tab.value("document.getAnimations().length") == 0  # nothing moves by itself
        assert tab.console == []
        assert tab.accessibility() == []


@pytest.mark.browser
@pytest.mark.parametrize(("script", "size"), [(False, LAPTOP), (True, PAPER), (True, LAPTOP)])
def test_without_script_and_on_paper_a_drawing_stands_in(file: Path, script: bool, size: Any) -> None:
    seen = "getComputedStyle(document.querySelector('{}')).display".format
    with chromium().opened(file, size, script) as tab:
        still = not script or size.print
        assert (tab.value(seen(".still")) == "none") is not still
        assert (tab.value(seen(".turnable")) == "none") is still
        assert tab.console == []
