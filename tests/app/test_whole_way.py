"""From the empty folder to files for a FANUC controller, by the page alone: by mouse, keyboard and finger."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from app_page import SCREENS, app, root, wait
from chromium import Size, Tab, chromium
from command_line import zerobeam
from controller_arm import ControllerArm
from user_programs import STATED, UserProgram
from walkers import DESK, Finger, Keyboard, Mouse, Walker

from zerobeam.model.files.robot_file import load_robot

pytestmark = [pytest.mark.browser, pytest.mark.long]

_MINUTES = 300.0  # seconds: a plan is made, a run is rehearsed, a report is written
_MOST_STOPS = 5  # to the first control
NAME = "lrmate_200id"
ROWS = np.array(
    [
        [10, 20, 10, -30, -50, 40],
        [25, -5, 20, 15, -60, 10],
        [-40, 30, 15, 20, -45, -60],
        [5, 15, 25, -10, -70, 30],
    ]
)
REPORTED = "document.querySelector('.message .word') && document.querySelector('.offsets')"
_MM = 0.8  # gravity and harmonics, which no robot file has: 0.05 degrees at 0.7 m, and three decimals

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
    walker.press("button", "Make the plan")
    wait(tab, "document.querySelector('tr[data-of=delta2]')", _MINUTES)
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
    wait(tab, "document.querySelector('form.exports select')?.value === 'fanuc'")
    walker.press("button", "Export")
    wait(tab, "document.querySelector('form.exports a[download]')", _MINUTES)


def corrected(tab: Tab, walker: Walker, program: Path) -> None:
    """A program that is sent and corrected; what it says of tool and frame is missing at first."""
    done = (
        "[...document.querySelectorAll('a[download]')].some((a) => a.textContent.includes('-corrected.ls'))"
    )
    walker.press("summary", "Correct a program")
    walker.send("or send one", program)
    wait(tab, f"document.querySelector('.program select')?.value.endsWith({program.name!r})")
    walker.press("button", "Correct the program")
    wait(tab, "document.querySelector('.program pre.log')?.textContent.includes('tool frame 3')", _MINUTES)
    walker.write("Tool 3: X, Y, Z, W, P, R (mm, deg)", STATED["fanuc"].tools[0].removeprefix("3="))
    walker.write("Frame 2: X, Y, Z, W, P, R (mm, deg)", STATED["fanuc"].frames[0].removeprefix("2="))
    walker.press("button", "Correct the program")
    wait(tab, done, _MINUTES)


@pytest.mark.parametrize("by", WALKS)
def test_the_whole_way_from_the_empty_folder_to_a_corrected_program(tmp_path: Path, by: str) -> None:
    make, size = WALKS[by]
    folder, robot = tmp_path / "folder", load_robot(NAME)
    folder.mkdir()
    program = UserProgram("fanuc", robot, ROWS)
    listing = tmp_path / "job.ls"
    listing.write_bytes(program.text().encode("latin-1"))
    with app(folder) as served, chromium().opened(served.address, size) as tab:
        walker = make(tab)
        wait(tab, "document.querySelector('.begin')")
        to_the_result(tab, walker)
        exported(tab, walker)
        corrected(tab, walker, listing)
        assert tab.console == []
        assert [url for url in tab.asked if not url.startswith(root(served.address))] == []
    (sheet,) = (folder / NAME).glob("*fanuc*.txt")
    assert "J2" in sheet.read_text(encoding="utf-8")
    assert (folder / NAME / "job.ls").read_bytes() == listing.read_bytes()
    after = program.commanded((folder / NAME / "job-corrected.ls").read_text(encoding="latin-1"))
    arm = tmp_path / "arm.yaml"
    zerobeam("export", "robot", folder / NAME / "plan-run.jsonl", "-o", arm)
    nominal, calibrated = ControllerArm.of(robot), ControllerArm.of(load_robot(str(arm)))
    meant = nominal.frames(program.rows)[-1, :, :3, 3]
    before, reached = (calibrated.frames(rows)[-1, :, :3, 3] for rows in (program.rows, after))
    assert np.linalg.norm(before - meant, axis=1).min() > 3 * _MM
    assert np.linalg.norm(reached - meant, axis=1).max() < _MM


def test_the_first_control_is_a_few_stops_from_the_head_of_each_view(tmp_path: Path) -> None:
    with app(tmp_path) as served:
        served.ended(served.ask("jobs", {"command": served.ask("example", {})["command"]})["id"])
        name = served.ask("home")["calibrations"][0]["name"]
        views = ["#/", "#/new", "#/import", *(f"#/job/{name}/{step}" for step in ("cell", "plan", "measure"))]
        for view in views:
            with chromium().opened(f"{served.address}{view}", DESK) as tab:
                wait(tab, "document.querySelector('main :is(button, input, a[href]):not(:disabled)')")
                Keyboard(tab).skip()
                first = "document.activeElement.matches('main :is(a, button, input, select, summary)')"
                stops = 2  # the way to the content, by Tab and Enter
                while not tab.value(first):
                    tab.key("Tab")
                    stops += 1
                assert stops <= _MOST_STOPS, view
