"""From the empty folder to files for a FANUC controller, by the page alone: by mouse, keyboard and finger."""

from collections.abc import Callable
from pathlib import Path

import pytest
from app_page import SCREENS, app, root, wait
from chromium import Size, Tab, chromium
from walkers import DESK, Finger, Keyboard, Mouse, Walker

pytestmark = [pytest.mark.browser, pytest.mark.long]

_MINUTES = 300.0  # seconds: a plan is made, a run is rehearsed, a report is written
_MOST_STOPS = 5  # to the first control
NAME = "lrmate_200id"
REPORTED = "document.querySelector('.message .word') && document.querySelector('.offsets')"

WALKS: dict[str, tuple[Callable[[Tab], Walker], Size]] = {
    "mouse": (Mouse, DESK),
    "keyboard": (Keyboard, DESK),
    "finger on a tablet": (Finger, SCREENS["tablet"]),
    "finger on a phone": (Finger, SCREENS["phone"]),
}


def to_the_result(tab: Tab, walker: Walker) -> None:
    """From Home, by New, Plan and a rehearsal, to Result with its report."""
    if isinstance(walker, Keyboard):
        walker.skip()
    walker.press("link", "New calibration")
    wait(tab, "document.querySelector('.new select')")
    walker.choose("Robot", "LR Mate 200iD")
    # What is assumed of the arm comes from the server, and moves what is below it.
    wait(tab, "document.querySelector('.new').textContent.includes('Assumed on the flange')")
    walker.press("button", "Make the plan")
    wait(tab, "document.querySelector('.determined table')", _MINUTES)
    walker.press("button", "Measure")
    wait(tab, "document.querySelector('form.start button.main:not(:disabled)')")
    walker.press("button", "Start the simulation")
    wait(tab, "document.querySelector('.message .word')?.textContent.includes('SIMULATED')", _MINUTES)
    walker.press("link", "Open the result")
    walker.press("button", "Make the report")
    wait(tab, REPORTED, _MINUTES)


def exported(tab: Tab, walker: Walker) -> None:
    """The offsets for the controller of the arm's maker, which comes first."""
    walker.press("summary", "Export to a controller")
    wait(tab, "document.querySelector('form.exports [name=format]:checked')?.value === 'fanuc'")
    walker.press("button", "Export")
    wait(tab, "document.querySelector('form.exports a[download]')", _MINUTES)


def few_stops(address: str) -> None:
    """By the keyboard the first control is a few stops from the head of each view."""
    views = ["#/", "#/new", "#/import", *(f"#/job/{NAME}/{step}" for step in ("cell", "plan", "measure"))]
    for view in views:
        with chromium().opened(f"{address}{view}", DESK) as tab:
            wait(tab, "document.querySelector('main :is(button, input, a[href]):not(:disabled)')")
            Keyboard(tab).skip()
            first = "document.activeElement.matches('main :is(a, button, input, select, summary)')"
            stops = 2  # the way to the content, by Tab and Enter
            while not tab.value(first):
                tab.key("Tab")
                stops += 1
            assert stops <= _MOST_STOPS, view


@pytest.mark.parametrize("by", WALKS)
def test_the_whole_way_from_the_empty_folder_to_files_for_the_controller(tmp_path: Path, by: str) -> None:
    make, size = WALKS[by]
    folder = tmp_path / "folder"
    folder.mkdir()
    with app(folder) as served, chromium().opened(served.address, size) as tab:
        walker = make(tab)
        wait(tab, "document.querySelector('.begin')")
        to_the_result(tab, walker)
        exported(tab, walker)
        assert "My programs" not in tab.text  # a simulated run moves no robot
        assert tab.console == []
        assert [url for url in tab.asked if not url.startswith(root(served.address))] == []
        if by == "keyboard":
            few_stops(served.address)
    (sheet,) = (folder / NAME).glob("*fanuc*.txt")
    assert "J2" in sheet.read_text(encoding="utf-8")
