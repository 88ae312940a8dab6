"""The picture of a plan: what `check` says, in one file that fetches nothing and trusts no name."""

import dataclasses
import re
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import (
    AXIS_LASER,
    PROBE,
    good_plan,
    header,
    irb1600,
    pattern_plan,
    plan_of,
    random_robot,
    varied_postures,
)
from chromium import chromium
from example_results import HOSTILE_NAMES
from pages import DATA, Page, assert_fetches_nothing
from ruamel.yaml import YAML

from zerobeam.analysis.observability.aim import AimedPlan, aim_plan
from zerobeam.analysis.observability.check import Check, check
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput
from zerobeam.model.files.plan import Plan, planned
from zerobeam.model.likelihood.problem import Problem
from zerobeam.reports.plan.plan_page import (
    NOT_DETERMINED,
    plan_page,
    plan_scene,
    postures_of,
    write_plan_page,
)
from zerobeam.words import numbers
from zerobeam.words.sentences import to_json
from zerobeam.words.wording import label

Refused = Callable[..., BadInput]


def made(plan: Plan) -> tuple[str, dict[str, Any]]:
    """The page, and the answer of `check --json`."""
    turned, found = judged(plan)
    return plan_page(turned, found), to_json(found)


def judged(plan: Plan) -> tuple[AimedPlan, Check]:
    turned = aim_plan(plan)
    return turned, Check.of(turned)


def hostile_plan() -> Plan:
    """Every bad name as a target, in the plan's own name and in the robot's."""
    own = header(target=None)
    postures = varied_postures(own, irb1600(), (900.0, 0.0, 0.0), 2 * len(HOSTILE_NAMES), 3)
    plan = plan_of(own, postures, HOSTILE_NAMES * 2)
    return dataclasses.replace(
        plan,
        path=Path("</script><script>alert(1)<!--.yaml"),
        robot=dataclasses.replace(plan.robot, name=HOSTILE_NAMES[0]),
        warnings=(HOSTILE_NAMES[0], HOSTILE_NAMES[9]),
    )


def test_the_table_says_what_check_says() -> None:
    text, answer = made(good_plan())
    page = Page(text)
    told = 0
    for row in answer["parameters"]:
        shown = page.row(label(row["name"]))
        assert shown[1] == row["status"]
        if row["std"] is not None and not row["held"]:
            deviating = answer["geometry"]["consider"].get(row["name"])
            wanted = [numbers.spread(row[key], row["unit"]) for key in ("std", "data_std", "prior_std")]
            wanted.insert(1, "" if deviating is None else numbers.spread(deviating, row["unit"]))
            assert shown[2:] == wanted
            told += 1
    assert told == 8
    assert "Pass" in page.words
    assert answer["inputs"]["sha256"] in page.words
    assert f"casadi {answer['inputs']['versions']['casadi']}" in page.words


def test_what_cannot_be_known_has_no_number_but_a_reason_and_a_remedy() -> None:
    text, answer = made(pattern_plan("x"))
    page = Page(text)
    untold = [row for row in answer["parameters"] if row["status"] == "unidentifiable"]
    assert [row["name"] for row in untold] == ["delta2", "psd.x", "psd.z"]
    for row in untold:
        assert page.row(label(row["name"]))[1:] == ["unidentifiable", NOT_DETERMINED]
    assert page.row("J1 (δ1)")[1:] == ["held", "not estimated"]
    # Negative control: a row that is told does have numbers.
    assert re.search(r"\d", page.row("J4 (δ4)")[2])
    for direction in answer["identifiability"]["null_space"]:
        change, promise = direction["remedy"].split("; predicted U: ")
        assert change in page.words
        assert promise.split("→")[1] in page.words
    assert "Degenerate" in page.words
    assert "joint 1 does not change over the measurements" in page.words


def test_a_direction_lost_in_the_noise_gives_its_parameters_no_number_either() -> None:
    plan = pattern_plan("x")
    # More than joint 1 would vary by at rest.
    plan.postures[:, 0] += np.radians(0.1) * np.linspace(-1, 1, len(plan.postures))
    text, answer = made(plan)
    (row,) = [row for row in answer["parameters"] if row["name"] == "delta2"]
    assert row["status"] == "unidentifiable"
    assert row["data_std"] is not None
    assert Page(text).row("J2 (δ2)")[1:] == ["unidentifiable", NOT_DETERMINED]


def moved(plan: Plan, postures_deg: Matrix) -> Plan:
    return dataclasses.replace(plan, shots=planned(postures_deg, plan.targets))


def test_the_joints_to_copy_are_the_aimed_postures() -> None:
    plan = good_plan()
    rough = moved(plan, np.degrees(plan.postures) + np.array([0, 0, 0, 1, -1, 0]))
    text, answer = made(rough)
    page = Page(text)
    copied = YAML(typ="safe").load(StringIO(page.copied))["postures_deg"]
    again = to_json(check(moved(plan, copied)))
    assert min(posture["off_mm"] for posture in answer["postures"]) > 1
    assert max(posture["off_mm"] for posture in again["postures"]) < 1e-3
    assert "they miss it by up to" in page.words
    first = page.row("0")
    assert first[2:8] == [numbers.with_unit(numbers.fixed(value, 2), "deg") for value in copied[0]]
    assert first[-1] == numbers.significant(answer["postures"][0]["off_mm"], 2, "mm")


def test_rows_to_copy_name_their_targets_where_there_are_several() -> None:
    plan = good_plan()
    names = ("psd", 'odd "name": [') * (len(plan.postures) // 2)
    text, _ = made(plan_of(header(), plan.postures, names))
    rows = YAML(typ="safe").load(StringIO(Page(text).copied))["postures_deg"]
    assert [row["target"] for row in rows] == list(names)


def test_beams_leave_the_tool_and_end_on_the_target() -> None:
    text, _ = made(good_plan())
    scene = Page(text).scene
    (target,) = scene["targets"]
    assert target["name"] == "psd"
    for posture in scene["postures"]:
        assert len(posture["arm"]) == irb1600().n + 2
        assert posture["arm"][0] == [0, 0, 0]
        assert posture["tool"] == [posture["arm"][-1], posture["beam"][0]]
        assert posture["reaches"]
        np.testing.assert_allclose(posture["beam"][1], target["at"], atol=0.2)
        assert [number["text"] for number in posture["numbers"]] == ["1", "2", "3, 4", "5, 6"]
    low_x, high_x, low_y, high_y = scene["grid"]["bounds"]
    assert low_x < 0 < high_x
    assert low_y < 0 < high_y


def test_a_floor_is_drawn_under_postures_in_one_plane() -> None:
    low_x, high_x, low_y, high_y = Page(made(pattern_plan("x"))[0]).scene["grid"]["bounds"]
    assert high_y - low_y >= (high_x - low_x) / 3


def test_a_probe_has_no_beam() -> None:
    text, _ = made(good_plan(tool=PROBE))
    page = Page(text)
    assert all(posture["beam"] is None for posture in page.scene["postures"])
    assert "beam length" not in page.words
    assert "beam length" in Page(made(good_plan())[0]).words


def test_a_target_behind_the_laser_is_told() -> None:
    backwards = {"kind": "laser", "calibrated": True, "point_mm": [0, 0, 65], "direction": [-1, 0, 0]}
    plan = good_plan()
    turned = plan_of(header(backwards), plan.postures)
    page = Page(made(turned)[0])
    assert "is behind the laser" in page.words
    assert page.row("0")[-2] == "behind it"
    for posture in page.scene["postures"]:
        assert not posture["reaches"]
        away = np.subtract(posture["beam"][1], posture["beam"][0])
        assert away @ np.subtract(page.scene["targets"][0]["at"], posture["beam"][0]) < 0
    assert "is behind the laser" not in Page(made(plan)[0]).words


def test_a_posture_that_cannot_hit_stays_as_planned_and_says_so() -> None:
    """A laser far off the axis of the wrist passes by a target that is nearer to the wrist than it."""
    plan = good_plan(8)
    wrist, _ = Problem.from_plan(plan_of(header(AXIS_LASER), plan.postures[2:3])).beams(np.zeros(9))
    beside = {"kind": "laser", "point_mm": [0, 400, 0], "direction": [1, 0, 0]}
    near = plan_of(header(beside, target=(wrist[0] + [30.0, 0.0, 40.0]).tolist()), plan.postures)
    found = check(near)
    missed = [posture.posture for posture in found.postures if not posture.hit]
    assert 2 in missed
    page = Page(plan_page(aim_plan(near), found))
    beams = page.scene["postures"]
    assert all(not beams[i]["reaches"] for i in missed)
    np.testing.assert_array_equal(postures_of(aim_plan(near)).joints[2], plan.postures[2])
    assert page.row("2")[-2] == "misses"
    assert "does not reach its target" in page.words
    assert "does not reach its target" not in Page(made(plan)[0]).words


def test_a_prismatic_joint_is_shown_in_millimetres() -> None:
    robot = random_robot("rprrrr", 4)
    own = header(PROBE, target=(300.0, 200.0, 400.0), noise={"joint_mm": 0.01})
    plan = plan_of(own, varied_postures(own, robot, (300.0, 200.0, 400.0), 6, 2), robot=robot)
    row = Page(made(plan)[0]).row("0")
    assert row[2].endswith("°")
    assert row[3].endswith("mm")


def test_many_postures_are_all_in_the_scene_and_the_first_on_paper() -> None:
    plan = good_plan(10)
    many = plan_of(plan.header, np.tile(plan.postures, (10, 1)))
    text, _ = made(many)
    page = Page(text)
    assert len(page.scene["postures"]) == 100
    assert text.count('class="arm') == 2 * 60
    assert "the first 60 postures" in page.words
    assert len(plan_scene(many, postures_of(aim_plan(many))).postures) == 100


@pytest.mark.parametrize(
    "plan", [good_plan, lambda: pattern_plan("x"), hostile_plan], ids=["good", "x", "hostile"]
)
def test_it_fetches_nothing_and_runs_one_script(plan: Callable[[], Plan]) -> None:
    text, _ = made(plan())
    page = Page(text)
    text.encode()
    assert_fetches_nothing(page)
    style = text[text.index("<style>") : text.index("</style>")]
    assert set(re.findall(r"url\(\"?([a-z]+):", style)) == {"data"}
    assert [attributes for attributes, _ in page.scripts] == [DATA, {}]
    assert text.count("<script") == 2


def test_hostile_names_are_shown() -> None:
    text, _ = made(hostile_plan())
    for shown, harmful in (("alert(&#39;x&#39;)", "<!--"), ("{{ 7*7 }}", "\x00"), ("\\u202e", "\u202e")):
        assert shown in text
        assert harmful not in text
    names = [target["name"] for target in Page(text).scene["targets"]]
    assert len(names) == len(HOSTILE_NAMES)
    assert all(len(name) <= 24 for name in names)


@pytest.mark.parametrize(
    ("here", "instead"),
    [
        ('"use strict";', '"use strict"; 1;'),  # another script than the one of the policy
        ("</main>", "</main><script>1</script>"),
        ("</main>", '</main><p onclick="1">x</p>'),
        ("</main>", '</main><a href="http://127.0.0.1:9/">x</a>'),
        ("script-src 'sha256-", "script-src 'unsafe-inline' 'sha256-"),
    ],
)
def test_a_page_that_runs_or_fetches_more_is_caught(here: str, instead: str) -> None:
    text, _ = made(good_plan())
    assert here in text
    with pytest.raises(AssertionError):
        assert_fetches_nothing(Page(text.replace(here, instead)))


def test_it_is_small_and_serves_paper_dark_and_screen_readers() -> None:
    text, _ = made(good_plan())
    page = Page(text)
    assert len(text.encode()) < 450_000
    assert not re.search(r"\{[{%]|/\* (LIGHT|DARK) \*/", text)
    pictures = [attributes for _, attributes in page.tags if attributes.get("role") == "img"]
    assert len(pictures) == 2  # the canvas, and the drawing that stands in for it
    assert {attributes["aria-label"] for attributes in pictures} == {pictures[0]["aria-label"]}
    assert "psd at 900, 0, 0" in (pictures[0]["aria-label"] or "")
    buttons = [attributes for tag, attributes in page.tags if tag == "button"]
    assert {button["data-do"] for button in buttons} == {
        *["previous", "next", "all", "nearer", "farther", "reset"]
    }


def test_the_page_is_written_and_replaces_only_a_page_of_its_kind(tmp_path: Path, refused: Refused) -> None:
    path = tmp_path / "plan.html"
    write_plan_page(str(path), *judged(pattern_plan("x")))
    write_plan_page(path, *judged(good_plan()))
    assert "Pass" in Page(path.read_text(encoding="utf-8")).words
    assert [file.name for file in tmp_path.iterdir()] == ["plan.html"]
    foreign = tmp_path / "notes.html"
    for content in ("", "<!doctype html>\n<p>mine</p>", "x" * 2000 + path.read_text(encoding="utf-8")):
        foreign.write_text(content, encoding="utf-8")
        assert "exists already" in refused(write_plan_page, foreign, *judged(good_plan())).what
        assert foreign.read_text(encoding="utf-8") == content
    assert "folder" in refused(write_plan_page, tmp_path, *judged(good_plan())).what
    error = refused(write_plan_page, tmp_path / "nowhere" / "plan.html", *judged(good_plan()))
    assert error.remedy == "make it first"


@pytest.mark.browser
@pytest.mark.parametrize("cell", [good_plan, hostile_plan], ids=["good", "hostile"])
def test_chromium_draws_it_without_a_word_on_its_console(cell: Callable[[], Plan], tmp_path: Path) -> None:
    plan = cell()
    file = tmp_path / "plan.html"
    file.write_text(made(plan)[0], encoding="utf-8")
    with chromium().opened(file) as tab:
        assert tab.value("document.getElementById('scene').className") == "alive"
        assert tab.value("document.querySelector('[data-says=posture]').textContent") == (
            f"posture 0 (of 0 to {len(plan.postures) - 1})"
        )
        assert tab.console == []
        assert tab.asked == []
