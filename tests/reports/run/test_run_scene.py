"""The picture of a run: what it shows is what the result says, and nothing that the data do not determine."""

import dataclasses
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from chromium import LAPTOP, PAPER, chromium
from example_results import HOSTILE_NAMES, good, x_pattern
from pages import Page, assert_fetches_nothing, paragraphs

from zerobeam.analysis.answer.result import Result
from zerobeam.analysis.solution import ParameterTable
from zerobeam.reports.output.html import Turnable, scene_html, style
from zerobeam.reports.run.run_scene import half_axes, run_scene, run_turnable, scene_section
from zerobeam.reports.scene import Placed, Posed, Scene3D


def turned(result: Result) -> Turnable:
    shown = run_turnable(result)
    assert shown is not None
    return shown


def test_without_a_scene_there_is_no_section() -> None:
    lost = dataclasses.replace(good(), scene=None)
    assert scene_section(lost) is None
    assert run_turnable(lost) is None


def test_a_beam_that_does_not_reach_its_target_is_in_the_key() -> None:
    scene = good().scene
    assert scene is not None
    behind = dataclasses.replace(scene.shots[0], ahead=False)
    away = dataclasses.replace(scene, shots=(behind, *scene.shots[1:]))
    assert turned(dataclasses.replace(good(), scene=away)).unreached
    assert not turned(good()).unreached


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
    picture, shown, section = run_scene(x_pattern()), turned(x_pattern()), scene_section(x_pattern())
    assert picture is not None
    assert section is not None
    assert [(target.state, target.axes) for target in picture.targets] == [("undetermined", None)]
    assert "psd: not determined" in shown.drawing
    assert '<path class="undetermined"' in shown.drawing
    assert "<ellipse" not in shown.drawing
    assert (shown.undetermined, shown.factor) == (True, None)
    assert "J2 (δ2) is not determined by these data" in shown.caption
    assert paragraphs(section) == "In the base frame (x, y, z): psd not determined by these data."
    # Negative control: where it is determined there is an ellipsoid, a number, and no such word.
    known = turned(good())
    assert known.drawing.count("<ellipse") == 1
    assert "not determined" not in known.drawing + known.caption + known.alt
    assert re.search(r"psd at 949\.\d\d, 149\.\d\d, 100\.\d\d\u00a0mm, half axes", known.alt)
    assert "an ellipsoid is drawn 100 times its true size" in known.paper


def test_an_open_tool_is_named() -> None:
    lost = next(row for row in x_pattern().parameters if row.status == "unidentifiable")
    tool = [dataclasses.replace(lost, name=f"tool.{axis}", group="tool") for axis in "xy"]
    rows = ParameterTable((*x_pattern().parameters, *tool))
    shown = turned(dataclasses.replace(x_pattern(), parameters=rows))
    assert "tool.x and tool.y are not determined by these data: the picture has them" in shown.caption


def test_the_page_is_small_and_hostile_names_stay_names() -> None:
    scene = good().scene
    assert scene is not None
    (target,) = scene.targets
    targets = tuple(dataclasses.replace(target, name=name) for name in HOSTILE_NAMES)
    pairs = zip(scene.shots * 2, HOSTILE_NAMES, strict=False)
    shots = tuple(dataclasses.replace(shot, target=name) for shot, name in pairs)
    hostile = dataclasses.replace(good(), scene=dataclasses.replace(scene, shots=shots, targets=targets))
    text = scene_html("Scene", turned(hostile))
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
    path.write_text(scene_html("Scene", turned(good())), encoding="utf-8")
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
        assert tab.value(said("posture")) == "measurement 0 at psd (1 of 7)"
        before = tab.value(pixels)
        tab.value(slide("factor", 3))
        assert tab.value(said("factor")) == "drawn 1000 times its true size"
        tab.value(slide("factor", 0))
        assert tab.value(said("factor")) == "drawn at its true size"
        assert tab.value("document.getElementById('scene-factor').getAttribute('aria-valuetext')") == (
            "drawn at its true size"
        )
        tab.value(slide("posture", 4))
        assert tab.value(said("posture")) == "measurement 4 at psd (5 of 7)"
        tab.value("document.querySelector('canvas').focus()")
        for key in ("n", "ArrowLeft", "]"):
            tab.key(key)
        assert tab.value(said("posture")) == "measurement 5 at psd (6 of 7)"
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
