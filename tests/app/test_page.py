"""The page of the app as a browser shows it: home, the cell and the plan; nothing that was done is lost."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from app_page import SCREENS, app, root, wait
from cells import good_plan, pattern_plan
from chromium import LAPTOP, Size, Tab, chromium
from command_line import plan_file

pytestmark = pytest.mark.browser

U2 = "document.querySelector('tr[data-of=delta2] .u').textContent"
TABLE = "document.querySelector('.determined table').innerText"
CHECKED = "document.querySelector('tr[data-of=delta2]') && !document.querySelector('.pending')"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A calibration with two plans: seven measurements, and the X-Pattern, in which joint 1 is still."""
    chromium()
    made = tmp_path_factory.mktemp("page") / "dir"
    (made / "cell").mkdir(parents=True)
    plan_file(made / "cell" / "x.yaml", pattern_plan("x"))
    plan_file(made / "cell" / "plan.yaml", good_plan(7))
    (made / "broken").mkdir()
    (made / "broken" / "plan.yaml").write_text("schema: zerobeam/plan/1\nrobot: [\n")
    return made


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    with app(folder) as opened:
        yield opened.address


@contextmanager
def plan(
    address: str, file: str = "cell/plan.yaml", size: Size = LAPTOP, step: str = "plan"
) -> Iterator[Tab]:
    """A plan of the folder, opened by its address and checked."""
    with chromium().opened(f"{address}#/job/cell/{step}/{file}", size) as tab:
        wait(tab, CHECKED if step == "plan" else "document.querySelector('.target input')")
        yield tab


def press(tab: Tab, name: str, role: str = "button") -> None:
    tab.on(lambda page: page.get_by_role(role, name=name, exact=True).first.click())


def fill(tab: Tab, label: str, value: str) -> None:
    tab.on(lambda page: page.get_by_label(label, exact=True).first.fill(value))


def field(tab: Tab, label: str) -> str:
    return str(tab.on(lambda page: page.get_by_label(label, exact=True).first.input_value()))


def content(path: Path) -> Any:
    return yaml.safe_load(path.read_text())


def test_the_frame_is_shown_before_the_folder_has_been_read(address: str) -> None:
    held: list[Any] = []
    with plan(address) as tab:
        tab.on(lambda frame: frame.page.route("**/api/home", lambda route: held.append(route)))
        tab.reload()
        wait(tab, "document.querySelector('.rail') && document.querySelector('main [role=status]')")
        assert tab.value("document.querySelector('header h1').textContent") == "cell"
        assert "no calibration of this name" not in tab.text
        tab.on(lambda frame: [route.continue_() for route in held])
        wait(tab, CHECKED)


def test_numbers_are_read_as_meant_or_refused(address: str) -> None:
    texts = {
        "0,5": 0.5, "0.5": 0.5, "-1,25": -1.25, "−3": -3, "1e-3": 0.001, " 12 ": 12, ",5": 0.5,
        "0,123": 0.123, "1,234": None, "1.234,5": None, "1,234.5": None, "1 000": None, "": None,
        "5°": None, "1,2,3": None,
    }  # fmt: skip
    lists = {"0, 0, 1": [0, 0, 1], "0,0,1": [0, 0, 1], "0,5; 1,5": [0.5, 1.5], "0.5 1": [0.5, 1], "1,x": None}
    with chromium().opened(address) as tab:
        module = "import('/page/core/decimal.js')"
        told = tab.value(f"{module}.then((m) => {json.dumps(list(texts))}.map(m.parsed))")
        assert dict(zip(texts, told, strict=True)) == texts
        told = tab.value(f"{module}.then((m) => {json.dumps(list(lists))}.map(m.parsedList))")
        assert dict(zip(lists, told, strict=True)) == lists


def test_home_lists_calibrations_with_what_is_broken_and_is_searched(address: str) -> None:
    with chromium().opened(address) as tab:
        wait(tab, "document.querySelectorAll('.calibrations li').length === 2")
        assert "planned: 7 measurements" in tab.text
        assert "broken" in tab.text
        tab.on(lambda page: page.get_by_label("Search").fill("irb 1600"))
        wait(tab, "document.querySelectorAll('.calibrations li').length === 1")
        tab.on(lambda page: page.locator(".calibrations a").click())
        wait(tab, CHECKED)
        assert tab.value("location.hash").startswith("#/job/cell/plan/cell/")
        tab.on(lambda frame: frame.page.go_back())
        wait(tab, "document.querySelector('.calibrations')")
        assert tab.console == []


def test_u_follows_a_joint_and_what_is_not_saved_survives_a_reload_and_is_undone(address: str) -> None:
    with plan(address) as tab:
        before = tab.value(TABLE)
        assert "°" in before
        angle = float(field(tab, "J2, °"))
        fill(tab, "J2, °", f"{angle + 30:.1f}".replace(".", ","))
        wait(tab, f"{TABLE} !== {before!r} && {CHECKED}")
        changed = tab.value(TABLE)
        tab.reload()
        wait(tab, f"{CHECKED} && {TABLE} === {changed!r}")
        assert "were not saved are back" in tab.text
        press(tab, "Undo")
        wait(tab, f"{TABLE} === {before!r}")
        assert "Changes are not saved" not in tab.text
        assert tab.console == []


def test_what_could_be_misread_is_refused_where_it_stands_and_changes_nothing(address: str) -> None:
    with plan(address) as tab:
        before = tab.value(U2)
        fill(tab, "J2, °", "1,234")
        wait(tab, "document.querySelector('.number.wrong .error')")
        assert "without separators" in tab.value("document.querySelector('.number.wrong .error').textContent")
        assert tab.value(U2) == before
        assert "Saved." in tab.text


def test_two_tabs_do_not_write_over_each_other(folder: Path, address: str) -> None:
    path = folder / "cell" / "both.yaml"
    plan_file(path, good_plan(7))
    with (
        plan(address, "cell/both.yaml") as one,
        chromium().opened(f"{address}#/job/cell/plan/cell/both.yaml", beside=one) as other,
    ):
        wait(other, CHECKED)
        for tab, angle in ((one, "10"), (other, "20")):
            fill(tab, "J1, °", angle)
            wait(tab, "!document.querySelector('.pending')")
        press(one, "Save")
        wait(other, "document.querySelector('dialog[open]')")  # noticed before anything is written
        assert content(path)["postures_deg"][0][0] == 10
        assert "10" in other.value("document.querySelector('dialog table').textContent")
        heading, last = (
            f"document.querySelector('dialog {each}').getBoundingClientRect()" for each in ("h2", ".bar")
        )
        assert other.value(f"{heading}.top") >= 0
        assert other.value(f"{last}.bottom <= innerHeight")
        press(other, "Overwrite the file with mine")
        wait(other, "!document.querySelector('dialog[open]')")
        wait(other, "document.querySelector('.plan-bar output').textContent === 'Saved.'")
        assert content(path)["postures_deg"][0][0] == 20
        wait(one, f"{CHECKED} && document.querySelector('[aria-label=\"J1, °\"]').value === '20'")


def test_a_plan_that_is_deleted_is_written_again_from_the_page(folder: Path, address: str) -> None:
    path = folder / "cell" / "gone.yaml"
    plan_file(path, good_plan(7))
    with plan(address, "cell/gone.yaml") as tab:
        fill(tab, "J1, °", "10")
        path.unlink()
        wait(tab, "document.querySelector('dialog[open]')")
        assert "is gone" in tab.text
        press(tab, "Write the file again")
        wait(tab, "document.querySelector('.plan-bar output').textContent === 'Saved.'")
    assert content(path)["postures_deg"][0][0] == 10


def test_a_plan_that_is_deleted_unchanged_is_kept_as_a_draft(folder: Path, address: str) -> None:
    path = folder / "cell" / "lost.yaml"
    plan_file(path, good_plan(7))
    kept = path.read_bytes()
    with plan(address, "cell/lost.yaml") as tab:
        path.unlink()
        wait(tab, "document.querySelector('dialog[open]')")
        assert "is gone" in tab.text
        tab.key("Escape")
        wait(tab, "document.querySelector('.plan-bar output').textContent === 'Changes are not saved.'")
        assert "zerobeam:draft:cell/lost.yaml" in tab.value("Object.keys(localStorage)")
        path.write_bytes(kept)  # as it was: nothing is unsaved any more
        wait(tab, "document.querySelector('.plan-bar output').textContent === 'Saved.'")
        assert tab.value("Object.keys(localStorage).length") == 0


def test_a_plan_that_is_not_there_is_said_in_its_view_alone_and_opened_once_it_is_there(
    folder: Path, address: str
) -> None:
    path = folder / "cell" / "later.yaml"
    fault = "document.querySelector('.fault')"
    with chromium().opened(f"{address}#/job/cell/plan/cell/later.yaml", LAPTOP) as tab:
        wait(tab, f"{fault}?.textContent.includes('there is no such file')")
        tab.value("location.hash = '#/job/cell/measure'")
        wait(tab, f"document.querySelector('form.start') && !{fault}")
        tab.value("location.hash = '#/job/cell/plan/cell/later.yaml'")
        wait(tab, fault)
        plan_file(path, good_plan(7))
        wait(tab, f"{CHECKED} && !{fault}")


def test_a_posture_beside_its_target_says_so_at_its_card_and_at_the_picture(address: str) -> None:
    with plan(address) as tab:
        card = "document.querySelector('.strip li button').innerText"
        fill(tab, "J1, °", f"{float(field(tab, 'J1, °')) + 5:.1f}")
        wait(tab, f"{card}.includes('beside the target before aiming') && {card}.includes('without it: u ×')")
        caption = tab.value("document.querySelector('.scene figcaption').textContent")
        assert "mm beside the target" in caption
        assert "with the wrist rotated onto the target first" in caption


def test_names_and_the_table_have_room_on_a_phone(address: str) -> None:
    with chromium().opened(address, SCREENS["phone"]) as tab:
        wait(tab, "document.querySelector('.calibrations .name')")
        assert tab.value("document.querySelector('.calibrations .name').clientWidth") > 200
        assert tab.overflow() == 0
    with plan(address, size=SCREENS["phone"]) as tab:
        table = "document.querySelector('.determined .scroll')"
        assert tab.value(f"{table}.scrollWidth > {table}.clientWidth")
        assert "gradient" in tab.value(f"getComputedStyle({table}).backgroundImage")
        assert tab.overflow() == 0
    with plan(address, size=SCREENS["tablet"]) as tab:
        verdict = "document.querySelector('.message [role=status]').getBoundingClientRect().width"
        assert tab.value(f"{verdict} / innerWidth") > 0.5


def test_leaving_with_changes_asks_first(address: str) -> None:
    with plan(address) as tab:
        fill(tab, "J1, °", "10")
        press(tab, "All calibrations", "link")
        wait(tab, "document.querySelector('dialog[open]')")
        press(tab, "Stay")
        assert tab.value("location.hash").startswith("#/job/cell/plan")
        press(tab, "All calibrations", "link")
        press(tab, "Discard")
        wait(tab, "document.querySelector('.calibrations')")
        assert tab.value("Object.keys(localStorage).length") == 0


def test_what_is_not_determined_has_no_number_and_the_arm_moves_along_it(address: str) -> None:
    with plan(address, "cell/x.yaml") as tab:
        assert "Degenerate" in tab.value("document.querySelector('.message .word').textContent")
        assert tab.value(U2) == "not determined"
        press(tab, "Move the arm along it")
        wait(tab, "document.body.innerText.includes('moves along the null-space direction')")


def test_the_suggested_posture_is_applied_by_the_button_of_the_message(address: str) -> None:
    word = "document.querySelector('.message .word').textContent"
    with plan(address) as tab:
        before = tab.value("document.querySelectorAll('.strip li').length")
        assert "Weak" in tab.value(word)
        assert "Replace posture" in tab.value("document.querySelector('.message').innerText")
        tab.on(lambda page: page.locator(".message .do button").click())
        wait(tab, f"{word}.includes('Pass') && {CHECKED}")
        assert tab.value("document.querySelectorAll('.strip li').length") == before
        press(tab, "Undo")
        wait(tab, f"{word}.includes('Weak') && {CHECKED}")


def test_suggested_postures_keep_their_targets_and_a_command_its_file(address: str) -> None:
    with plan(address) as tab:
        deed = {"kind": "postures", "postures_deg": [[1] * 6, [2] * 6], "targets": ["a", "b"]}
        content = "import('/page/core/editing.js').then((m) => m.plan.value)"
        before = tab.value(content)
        tab.value(f"import('/page/core/actions.js').then((m) => m.doAction({json.dumps(deed)}, () => {{}}))")
        after = tab.value(content)
        assert after["postures_deg"] == [
            {"joints_deg": [1] * 6, "target": "a"},
            {"joints_deg": [2] * 6, "target": "b"},
        ]
        assert after.get("targets") == before.get("targets")
        commands = [
            ["plan", "x", "--out=a/b.yaml"],
            ["plan", "x", "-o", "a/b.yaml"],
            ["analyse", "run.jsonl"],
        ]
        out = f"import('/page/core/jobs.js').then((m) => {json.dumps(commands)}.map(m.outOf))"
        assert tab.value(out) == ["a/b.yaml", "a/b.yaml", ""]


def test_an_error_stands_in_place_of_the_numbers(address: str) -> None:
    with plan(address) as tab:
        fill(tab, "J2, °", "900")
        wait(tab, "document.querySelector('.plan-bar ~ .error')")
        assert "outside its limits" in tab.text
        assert tab.value("document.querySelector('tr[data-of=delta2]')") is None


@pytest.mark.parametrize("size", SCREENS)
@pytest.mark.at_length(r"^(?!laptop)")
def test_every_view_leaves_nobody_out_and_asks_its_server_alone(address: str, size: str) -> None:
    with plan(address, "cell/plan.yaml", SCREENS[size]) as tab:
        views = {"plan": CHECKED, "cell": "document.querySelector('.target input')"}
        for step, ready in views.items():
            tab.value(f"location.hash = '#/job/cell/{step}/cell/plan.yaml'")
            wait(
                tab,
                f"document.querySelector('.rail [aria-current]').textContent.includes('{step.capitalize()}')"
                f" && {ready}",
            )
            tab.value("[...document.querySelectorAll('.inspector summary')].map((e) => e.click())")
            tab.value("new Promise((then) => setTimeout(then, 300))")
            assert (step, tab.accessibility(), tab.overflow()) == (step, [], 0)
        for hash, ready in {"#/new": ".new select", "#/": ".calibrations"}.items():
            tab.value(f"location.hash = '{hash}'")
            wait(tab, f"document.querySelector('{ready}')")
            assert (hash, tab.accessibility(), tab.overflow()) == (hash, [], 0)
        assert tab.console == []
        assert [url for url in tab.asked if not url.startswith(root(address))] == []
