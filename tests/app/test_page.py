"""The page of the app as a browser shows it: home, the cell and the plan; nothing that was done is lost."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from app_page import SCREENS, app, fill, press, root, wait
from cells import good_plan, pattern_plan
from chromium import LAPTOP, Size, Tab, chromium
from command_line import plan_file

pytestmark = pytest.mark.browser

U2 = "document.querySelector('.determined tbody .unidentifiable .words')?.textContent"
TABLE = "document.querySelector('.determined table').innerText"
CHECKED = "document.querySelector('.determined table') && !document.querySelector('.pending')"


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


def field(tab: Tab, label: str) -> str:
    return str(tab.on(lambda page: page.get_by_label(label, exact=True).first.input_value()))


def content(path: Path) -> Any:
    return yaml.safe_load(path.read_text())


def edited_and_undone(tab: Tab) -> None:
    word, card = (f"document.querySelector('{each}')" for each in (".message .word", ".strip li button"))
    before = tab.value(TABLE)
    # What could be misread is refused where it stands, and changes nothing.
    angle = float(field(tab, "J2, °"))
    fill(tab, "J2, °", "1,234")
    wait(tab, "document.querySelector('.number.wrong .error')")
    assert "without separators" in tab.value("document.querySelector('.number.wrong .error').textContent")
    assert tab.value(TABLE) == before
    assert "Saved." in tab.text
    # u follows a joint; what is not saved survives a reload, and is undone.
    fill(tab, "J2, °", f"{angle + 30:.1f}".replace(".", ","))
    wait(tab, f"{TABLE} !== {before!r} && {CHECKED}")
    changed = tab.value(TABLE)
    tab.reload()
    wait(tab, f"{CHECKED} && {TABLE} === {changed!r}")
    assert "were not saved are back" in tab.text
    press(tab, "Undo")
    wait(tab, f"{TABLE} === {before!r}")
    assert "Changes are not saved" not in tab.text
    # A posture beside its target says so at its card and at the picture.
    fill(tab, "J1, °", f"{float(field(tab, 'J1, °')) + 5:.1f}")
    says = ("beside the target before aiming", "without it: u ×")
    wait(tab, " && ".join(f"{card}.innerText.includes('{each}')" for each in says))
    caption = tab.value("document.querySelector('.scene figcaption').textContent")
    assert "mm beside the target" in caption
    assert "with the wrist rotated onto the target first" in caption
    press(tab, "Undo")
    # An error stands in place of the numbers.
    fill(tab, "J2, °", "900")
    wait(tab, "document.querySelector('.plan-bar ~ .error')")
    assert "outside its limits" in tab.text
    assert tab.value("document.querySelector('.determined table')") is None
    press(tab, "Undo")
    # The suggested posture is applied by the button of the message.
    wait(tab, f"{CHECKED} && {word}?.textContent.includes('Weak')")
    assert "Replace posture" in tab.value("document.querySelector('.message').innerText")
    tab.on(lambda page: page.locator(".message .do button").click())
    wait(tab, f"{word}.textContent.includes('Pass') && {CHECKED}")
    assert tab.value("document.querySelectorAll('.strip li').length") == 7
    press(tab, "Undo")
    wait(tab, f"{word}.textContent.includes('Weak') && {CHECKED}")
    # What is not determined has no number, and the arm moves along it.
    tab.value("location.hash = '#/job/cell/plan/cell/x.yaml'")
    wait(tab, f"{CHECKED} && {word}.textContent.includes('Degenerate')")
    assert tab.value(U2) == "unidentifiable from these measurements"
    press(tab, "Move the arm along it")
    wait(tab, "document.body.innerText.includes('moves along the null-space direction')")


def leaves_nobody_out(tab: Tab, size: str, address: str) -> None:
    """Every view, and it asks its server alone."""
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
        if step == "plan" and size == "phone":  # what is wider than its room shows so
            table = "document.querySelector('.determined .scroll')"
            assert "gradient" in tab.value(f"getComputedStyle({table}).backgroundImage")
        verdict = "document.querySelector('.message [role=status]').getBoundingClientRect().width"
        assert size != "tablet" or tab.value(f"{verdict} / innerWidth") > 0.5
    for hash, ready in {"#/new": ".new select", "#/": ".calibrations"}.items():
        tab.value(f"location.hash = '{hash}'")
        wait(tab, f"document.querySelector('{ready}')")
        assert (hash, tab.accessibility(), tab.overflow()) == (hash, [], 0)
    assert tab.value("document.querySelector('.calibrations .name').clientWidth") > 200
    assert tab.console == []
    assert [url for url in tab.asked if not url.startswith(root(address))] == []


def test_a_calibration_is_found_opened_edited_undone_and_left(address: str) -> None:
    with chromium().opened(address) as tab:
        wait(tab, "document.querySelectorAll('.calibrations li').length === 2")
        assert "planned: 7 measurements" in tab.text
        assert "broken" in tab.text
        tab.on(lambda page: page.get_by_label("Search").fill("irb 1600"))
        wait(tab, "document.querySelectorAll('.calibrations li').length === 1")
        tab.on(lambda page: page.locator(".calibrations a").click())
        wait(tab, CHECKED)
        assert tab.value("location.hash").startswith("#/job/cell/plan/cell/")
        # The frame is shown before the folder has been read.
        held: list[Any] = []
        hold = [held.append]
        tab.on(lambda frame: frame.page.route("**/api/home", lambda route: hold[0](route)))
        tab.reload()
        wait(tab, "document.querySelector('.rail') && document.querySelector('main [role=status]')")
        assert tab.value("document.querySelector('header h1').textContent") == "cell"
        assert "no calibration of this name" not in tab.text
        hold[0] = lambda route: route.continue_()
        tab.on(lambda frame: [route.continue_() for route in held])
        wait(tab, CHECKED)
        leaves_nobody_out(tab, "laptop", address)
        tab.value("location.hash = '#/job/cell/plan/cell/plan.yaml'")
        wait(tab, CHECKED)
        edited_and_undone(tab)
        assert [said for said in tab.console if "400" not in said] == []  # of the plan that was refused
    with plan(address) as tab:
        fill(tab, "J1, °", "10")
        wait(tab, "document.querySelector('.plan-bar output').textContent.includes('not saved')")
        press(tab, "All calibrations", "link")
        wait(tab, "document.querySelector('dialog[open]')")
        press(tab, "Stay")
        wait(tab, "!document.querySelector('dialog[open]')")
        assert tab.value("location.hash").startswith("#/job/cell/plan")
        press(tab, "All calibrations", "link")
        wait(tab, "document.querySelector('dialog[open]')")
        press(tab, "Discard")
        wait(tab, "document.querySelector('.calibrations')")
        assert tab.value("Object.keys(localStorage).length") == 0
        assert tab.console == []


@pytest.mark.long
def test_a_plan_comes_goes_is_written_again_and_not_over_another_tab(folder: Path, address: str) -> None:
    path, fault = folder / "cell" / "later.yaml", "document.querySelector('.fault')"
    saved = "document.querySelector('.plan-bar output').textContent === 'Saved.'"
    with chromium().opened(f"{address}#/job/cell/plan/cell/later.yaml", LAPTOP) as tab:
        # What is not there is said in its view alone, and opened once it is there.
        wait(tab, f"{fault}?.textContent.includes('there is no such file')")
        tab.value("location.hash = '#/job/cell/measure'")
        wait(tab, f"document.querySelector('form.start') && !{fault}")
        tab.value("location.hash = '#/job/cell/plan/cell/later.yaml'")
        wait(tab, fault)
        plan_file(path, good_plan(7))
        wait(tab, f"{CHECKED} && !{fault}")
        # Deleted unchanged it is kept as a draft, until it is there again.
        kept = path.read_bytes()
        path.unlink()
        wait(tab, "document.querySelector('dialog[open]')")
        assert "is gone" in tab.text
        tab.key("Escape")
        wait(tab, f"!({saved})")
        assert "zerobeam:draft:cell/later.yaml" in tab.value("Object.keys(localStorage)")
        path.write_bytes(kept)
        wait(tab, saved)
        assert tab.value("Object.keys(localStorage).length") == 0
        # Deleted with changes it is written again from the page.
        fill(tab, "J1, °", "10")
        path.unlink()
        wait(tab, "document.querySelector('dialog[open]')")
        press(tab, "Write the file again")
        wait(tab, saved)
        assert content(path)["postures_deg"][0][0] == 10
        # Deleted with changes before it is opened: the draft is.
        fill(tab, "J1, °", "20")
        wait(tab, f"{CHECKED} && !({saved})")
        path.unlink()
        tab.reload()
        wait(tab, "document.querySelector('dialog[open]')")
        press(tab, "Write the file again")
        wait(tab, saved)
        assert content(path)["postures_deg"][0][0] == 20
        one = tab
        # Two tabs do not write over each other.
        with chromium().opened(f"{address}#/job/cell/plan/cell/later.yaml", beside=one) as other:
            wait(other, CHECKED)
            for tab, angle in ((one, "30"), (other, "40")):
                fill(tab, "J1, °", angle)
                wait(tab, "!document.querySelector('.pending')")
            press(one, "Save")
            wait(other, "document.querySelector('dialog[open]')")  # noticed before anything is written
            assert content(path)["postures_deg"][0][0] == 30
            assert "30" in other.value("document.querySelector('dialog table').textContent")
            heading, last = (
                f"document.querySelector('dialog {each}').getBoundingClientRect()" for each in ("h2", ".bar")
            )
            assert other.value(f"{heading}.top") >= 0
            assert other.value(f"{last}.bottom <= innerHeight")
            press(other, "Overwrite the file with mine")
            wait(other, "!document.querySelector('dialog[open]')")
            wait(other, "document.querySelector('.plan-bar output').textContent === 'Saved.'")
            assert content(path)["postures_deg"][0][0] == 40
            wait(one, f"{CHECKED} && document.querySelector('[aria-label=\"J1, °\"]').value === '40'")


@pytest.mark.long
def test_every_view_leaves_nobody_out_on_a_tablet_and_a_phone(address: str) -> None:
    for size in ("tablet", "phone"):
        with plan(address, "cell/plan.yaml", SCREENS[size]) as tab:
            leaves_nobody_out(tab, size, address)
