"""From the empty folder to a file for a FANUC controller, by the page alone, on three screens."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from app_page import SCREENS, app, wait
from chromium import Tab, chromium

pytestmark = [pytest.mark.browser, pytest.mark.long]

_MINUTES = 240.0  # seconds: a plan is made, a run is rehearsed, a report is written


def _press(tab: Tab, name: str) -> None:
    """A click, or a touch where the screen is one."""

    def press(frame: Any) -> None:
        button = frame.get_by_role("button", name=name, exact=True).first
        touched = frame.evaluate("navigator.maxTouchPoints") > 0
        (button.tap if touched else button.click)()

    tab.on(press)


@pytest.mark.parametrize("size", SCREENS)
def test_the_whole_way_from_the_empty_folder_to_a_file_of_offsets(tmp_path: Path, size: str) -> None:
    with app(tmp_path) as served, chromium().opened(f"{served.address}#/new", SCREENS[size]) as tab:
        wait(tab, "document.querySelector('.new select')")
        tab.on(lambda frame: frame.get_by_label("Robot", exact=True).select_option(label="M-10iA"))
        _press(tab, "Make the plan")
        wait(tab, "document.querySelector('tr[data-of=delta2]')", _MINUTES)
        _press(tab, "Measure")
        wait(tab, "document.querySelector('form.start')")
        _press(tab, "Start the simulation")
        wait(tab, "document.querySelector('.message .word')?.textContent.includes('SIMULATED')", _MINUTES)
        tab.value("document.querySelectorAll('.rail a')[3].click()")
        wait(tab, "document.body.innerText.includes('Make the report')")
        _press(tab, "Make the report")
        wait(
            tab, "document.querySelector('.message .word') && document.querySelector('.inspector')", _MINUTES
        )
        tab.on(lambda frame: frame.get_by_text("Export to a controller", exact=True).click())
        wait(tab, "document.querySelector('form.exports select')")
        form = "document.querySelector('form.exports select').value"
        assert tab.value(form) == "fanuc"  # the arm's maker comes first
        _press(tab, "Export")
        wait(tab, "document.querySelector('form.exports a[download]')", _MINUTES)
        assert tab.console == []
    (sheet,) = (tmp_path / "m10ia").glob("*fanuc*.txt")
    assert "J2" in sheet.read_text(encoding="utf-8")
