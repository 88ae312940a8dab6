"""A new calibration, typed by a person: what is wrong makes nothing, and what cannot be planned is said."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from app_page import app, fill, wait
from chromium import Tab, chromium

pytestmark = pytest.mark.browser

POINT = "At a point that I state"
REFUSED = "document.querySelector('.new [aria-invalid=true]')?.closest('label').textContent"
ALERT = "document.querySelector('.new .bar [role=alert]')?.textContent ?? ''"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    chromium()
    (tmp_path / "dir").mkdir()
    return tmp_path / "dir"


@pytest.fixture
def tab(folder: Path) -> Iterator[Tab]:
    """The form, with an arm chosen."""
    with app(folder) as opened, chromium().opened(f"{opened.address}#/new") as page:
        wait(page, "document.querySelector('.new select')")
        page.on(lambda frame: frame.get_by_label("Robot").select_option("lrmate_200id"))
        wait(
            page,
            "document.body.textContent.includes('-330 mm') || document.body.textContent.includes('−330 mm')",
        )
        yield page


def make(tab: Tab) -> None:
    tab.on(lambda page: page.get_by_role("button", name="Make the plan").click())


def at_point(tab: Tab, *values: str) -> None:
    tab.on(lambda page: page.get_by_label(POINT).check())
    for axis, value in zip("xyz", values, strict=False):
        fill(tab, f"Target {axis}, mm", value)


def require_refused(tab: Tab, folder: Path, x: str, why: str) -> None:
    at_point(tab, x, "0", "0")
    make(tab)
    wait(tab, "document.querySelector('.new progress')")
    wait(tab, "document.querySelector('.new > .lines li')", 180)
    assert why in tab.text
    assert "Nothing is left in the folder" in tab.text
    assert [path for path in folder.iterdir() if not path.name.startswith(".")] == []


def test_what_is_wrong_makes_nothing_and_a_name_is_written_anew_and_taken(folder: Path, tab: Tab) -> None:
    """A refused number, a missing one, a target that cannot be reached, how the laser is mounted, a name that
    is taken."""
    title = "Name, serial number, number of measurements"
    tab.on(lambda page: page.get_by_text(title).click())
    fill(tab, "Measurements", "1,234")
    tab.on(lambda page: page.get_by_text(title).click())
    make(tab)
    wait(tab, f"({ALERT}).startsWith('Measurements: allowed')")
    fill(tab, "Measurements", "4")
    at_point(tab, "500,5")
    make(tab)
    wait(tab, f"({ALERT}).startsWith('Target y, mm: a number is missing')")
    assert [path for path in folder.iterdir() if not path.name.startswith(".")] == []
    require_refused(tab, folder, "0", "put the target elsewhere")
    tab.on(lambda page: page.get_by_label("On a stand in front of the arm").check())
    assert "Assumed on the flange: point (0, 0, 65)" in tab.text
    tab.on(lambda page: page.get_by_text("Mounted otherwise").click())
    fill(tab, "Point z, mm", "80,5")
    assert "On the flange: point (0, 0, 80.5)" in tab.text
    (folder / "taken").mkdir()
    fill(tab, "Name of the calibration", "taken")
    make(tab)
    wait(tab, f"({REFUSED})?.includes('there is a folder of this name')")
    make(tab)  # the same again is refused by the server, not by the page
    wait(tab, f"({REFUSED})?.includes('there is a folder of this name')")
    assert "Nothing was begun" not in tab.text
    tab.on(lambda page: page.locator(".new [aria-invalid=true]").fill("free"))
    wait(tab, "!document.querySelector('[aria-invalid=true]')")
    make(tab)
    wait(tab, "location.hash.startsWith('#/job/free/plan')", 180)
