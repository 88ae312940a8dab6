"""The step Measure: runs begun, watched, stopped and resumed in the browser."""

import itertools
import json
import os
import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote

import pytest
import yaml
from app_jobs import unfinished_run
from app_page import SCREENS, App, app, fill, press, root, touch, wait
from cells import good_plan
from child import ABB_CONTROLLER, child
from chromium import LAPTOP, Size, Tab, chromium
from command_line import plan_file, zerobeam

from zerobeam.model.files.run import read_run

pytestmark = pytest.mark.browser

NAME = "<img src=x onerror=alert(1)>.yaml"
NOW = "(document.querySelector('.now')?.textContent ?? '')"
POSTURES = 120  # no machine has carried them out before somebody stops it
UNDER_WAY = "document.querySelector('.stop-bar')"
OVER = "!document.querySelector('.stop-bar') && document.querySelector('.now')"
RESUME = "document.querySelector('.unfinished button:not(:disabled)')"
ROWS = "document.querySelectorAll('.known [data-of]').length"
ASKED = "document.querySelector('.asked-title').textContent"
LINE = "document.getElementById('hand-line')"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    chromium()
    made = tmp_path / "dir"
    (made / "cell").mkdir(parents=True)
    plan_file(made / "cell" / "two.yaml", good_plan(2))
    plan_file(made / "cell" / "long.yaml", good_plan(POSTURES))
    plan_file(made / "cell" / NAME, good_plan(3))
    return made


@pytest.fixture
def server(folder: Path) -> Iterator[App]:
    with app(folder) as opened:
        yield opened


@contextmanager
def measure(server: App, plan: str, rig: str = "simulated", size: Size = LAPTOP) -> Iterator[Tab]:
    """The step with a plan chosen."""
    with chromium().opened(f"{server.address}#/job/cell/measure/cell/{quote(plan)}", size) as tab:
        wait(tab, "document.querySelector('form.start button.main:not(:disabled)')")
        click(tab, f"document.querySelector('form.start [value={rig}]')")
        yield tab


def click(tab: Tab, element: str) -> None:
    tab.value(f"{element}.click()")


def start(tab: Tab) -> None:
    click(tab, "document.querySelector('form.start button.main')")
    wait(tab, UNDER_WAY)


def paste(tab: Tab, text: str) -> None:
    tab.on(lambda page: page.locator("#hand-line").fill(text))
    tab.on(lambda page: page.locator("#hand-line").press("Enter"))


def unbroken(folder: Path, plan: str) -> bytes:
    zerobeam("run", folder / "cell" / plan, "-o", folder / "unbroken.jsonl")
    return (folder / "unbroken.jsonl").read_bytes()


def saved_before_it_is_measured_or_measured_as_it_was(tab: Tab, folder: Path) -> None:
    """A plan with changes."""
    path = folder / "cell" / "two.yaml"
    before = path.read_bytes()
    tab.value("location.hash = '#/job/cell/plan/cell/two.yaml'")
    wait(tab, "document.querySelector('.determined table')")
    fill(tab, "J1, °", "10")
    wait(tab, "document.querySelector('.plan-bar output').textContent !== 'Saved.'")
    tab.value("location.hash = '#/job/cell/measure/cell/two.yaml'")
    tab.reload()  # the browser alone has the changes
    wait(tab, "document.body.innerText.includes('cell/two.yaml has changes that are not saved')")
    press(tab, "Start by the plan as it was saved")
    wait(tab, UNDER_WAY)
    wait(tab, OVER)
    assert path.read_bytes() == before
    wait(tab, "document.querySelector('form.start button.main:not(:disabled)')")
    press(tab, "Save the plan. Start the simulation")
    wait(tab, "location.hash.endsWith('two-run-3.jsonl')")
    wait(tab, OVER)
    first, second = (
        read_run(folder / "cell" / f"two-run{k}.jsonl").shots[0].joints_deg[0] for k in ("-2", "-3")
    )
    assert abs(second - 10) < abs(first - 10)
    assert yaml.safe_load(path.read_text())["postures_deg"][0][0] == 10


def resumed_at_the_address_that_is_typed(server: App, tab: Tab) -> None:
    """A robot, and not at the address that the folder has, which would hear the password."""
    again = "document.querySelector('[aria-label=\"Resume cell/made.jsonl\"]')"
    wait(tab, f"{again}?.disabled")
    assert "--port=9 --speed=0.5" in tab.value("document.querySelector('.unfinished').textContent")
    fill(tab, "Password of the controller, for cell/made.jsonl", "robotics")
    assert tab.value(f"{again}.disabled")
    fill(tab, "Address of the controller, for cell/made.jsonl", "127.0.0.1")
    wait(tab, f"!{again}.disabled")
    press(tab, "Resume cell/made.jsonl")
    wait(tab, OVER, 60)  # nobody answers there
    job = server.ask("jobs")[0]
    assert "--host=127.0.0.1" in job["command"]
    assert "stranger" not in json.dumps(job)
    assert tab.accessibility() == []


OPTIONS = ["--rig=abb", "--host=stranger.example", "--port=9", "--speed=0.5"]


def test_a_run_is_watched_to_its_end(server: App, folder: Path) -> None:
    with measure(server, "two.yaml") as tab:
        start(tab)
        wait(tab, OVER)
        wait(tab, f"{NOW}.startsWith('2 measurements are kept in')")
        assert tab.value("location.hash") == "#/job/cell/measure/cell/two-run.jsonl"
        assert tab.value("document.querySelector('[data-of=delta2] .u').textContent") == "not determined yet"
        assert tab.value("document.querySelectorAll('.watch circle').length") > 0
        steps = tab.value("document.querySelector('.watch .plotted').getAttribute('aria-label')")
        assert re.fullmatch(r"Distance of the spot from the centre by step: (\d\.\d{4}(, | mm\.$))+", steps)
        shown = tab.value("document.querySelector('.residuals .plotted').getAttribute('aria-label')")
        assert re.fullmatch(r"Normalised residuals: (measurement [01]: \d\.\d\d(, |\.$)){2}", shown)
        wait(tab, "document.querySelector('.u-legend')?.textContent.includes('tolerance0.1°')")
        assert "J2 (δ2)not determined" in tab.value("document.querySelector('.u-legend').textContent")
        assert tab.value("document.querySelector('.run-lines').textContent").startswith(
            "1 "
        )  # as the sheet counts
        assert tab.console == []
    assert len(read_run(folder / "cell" / "two-run.jsonl").shots) == 2


@pytest.mark.long
def test_the_plan_of_a_run_is_changed_and_an_unfinished_one_resumed(folder: Path) -> None:
    assert zerobeam("run", folder / "cell" / "two.yaml", "-o", folder / "cell" / "two-run.jsonl").status == 1
    unfinished_run(folder, "cell/two.yaml", ["run", *OPTIONS, "--out=cell/made.jsonl", "cell/two.yaml"])
    with (
        app(folder) as later,
        chromium().opened(f"{later.address}#/job/cell/measure/cell/two-run.jsonl") as tab,
    ):
        wait(tab, f"{NOW}.startsWith('2 of 2 measurements are kept in')")
        assert "SIMULATED" in tab.value(NOW)
        tab.value("location.hash = '#/job/cell/measure/cell/two.yaml'")
        resumed_at_the_address_that_is_typed(later, tab)
        saved_before_it_is_measured_or_measured_as_it_was(tab, folder)


@pytest.mark.long
def test_a_run_is_stopped_from_elsewhere_reloaded_and_resumed(server: App, folder: Path) -> None:
    """On each screen; by touch where there is no mouse. It leaves nobody out before, while, and after; at
    last the server is killed, and the page offers to resume once it is back."""
    kept = 0
    for size, screen in SCREENS.items():
        with measure(server, "long.yaml", size=screen) as tab:
            assert (size, tab.accessibility(), tab.overflow()) == (size, [], 0)
            if kept:
                wait(tab, RESUME)
                click(tab, RESUME)
                wait(tab, UNDER_WAY)
            else:
                start(tab)
            wait(tab, ROWS)
            assert (size, tab.accessibility(), tab.overflow()) == (size, [], 0)
            tab.reload()
            wait(tab, f"{UNDER_WAY} && {ROWS}")
            tab.value("location.hash = '#/job/cell/plan/cell/two.yaml'")
            wait(tab, "document.querySelector('.plan-bar')")
            if size == "laptop":
                tab.key("Escape")
            else:
                touch(tab, "document.querySelector('.stop')")
            wait(tab, "!document.querySelector('.stop-bar')")
            before, kept = kept, len(read_run(folder / "cell" / "long-run.jsonl").shots)
            assert before <= kept < POSTURES
            assert kept
            tab.value("location.hash = '#/job/cell/measure'")
            wait(tab, f"{NOW}.startsWith('Stopped. {kept} measurement')")
            wait(tab, RESUME)
            assert (size, tab.accessibility(), tab.overflow()) == (size, [], 0)
            assert f"{kept} of {POSTURES} recorded" in tab.text
            assert tab.console == []
            assert [url for url in tab.asked if not url.startswith(root(server.address))] == []
    with chromium().opened(f"{server.address}#/job/cell/measure") as tab:
        wait(tab, RESUME)
        click(tab, RESUME)
        wait(tab, f"{UNDER_WAY} && {ROWS}")
        server.process.kill()
        server.process.wait()
        wait(tab, f"{NOW}.startsWith('The connection to the server is lost.')")
        port = int(root(server.address).rstrip("/").rpartition(":")[2])
        with app(folder, port) as again:
            with chromium().opened(again.address, beside=tab):
                """Its new token becomes the cookie of all tabs."""
            tab.call("Page.bringToFront")  # else it is not painted
            wait(tab, RESUME, 60)
            click(tab, RESUME)
            wait(tab, UNDER_WAY)
            wait(tab, OVER, 120)
            wait(tab, f"{NOW}.startsWith('{POSTURES} measurements are kept')")
    assert (folder / "cell" / "long-run.jsonl").read_bytes() == unbroken(folder, "long.yaml")


@pytest.mark.long
def test_a_person_is_led_and_a_doubt_is_at_the_field(server: App, folder: Path) -> None:
    """On a phone: the field is above the stop bar, and the scene does not stand in its way."""
    plan = good_plan(3)
    rows = [", ".join(f"{value:.4f}" for value in row) for row in plan.postures * plan.robot.display]
    with measure(server, NAME, "manual", SCREENS["phone"]) as tab:
        fill(tab, "Run file", "cell/hand.jsonl")
        start(tab)
        wait(tab, f"{LINE} && {ASKED}.startsWith('Measurement 0 (0 of 3 done)')")
        tab.value(f"{LINE}.scrollIntoView({{block: 'center'}})")
        bottom = f"{LINE}.getBoundingClientRect().bottom"
        assert tab.value(f"{bottom} < document.querySelector('.stop-bar').getBoundingClientRect().top")
        assert tab.value("getComputedStyle(document.querySelector('.centre')).position") != "sticky"
        paste(tab, "1, 2")
        wait(tab, "document.querySelector('#hand-doubt .error')")
        assert tab.value(f"{LINE}.getAttribute('aria-invalid')") == "true"
        paste(tab, rows[0])
        wait(tab, f"{ASKED}.startsWith('Measurement 1 (1 of 3 done)')")
        paste(tab, rows[2])
        wait(tab, "document.querySelectorAll('#hand-doubt button').length === 2")
        assert (tab.accessibility(), tab.overflow()) == ([], 0)
        touch(tab, "document.querySelectorAll('#hand-doubt button')[1]")  # it is posture 2
        wait(tab, f"{ASKED}.includes('Measurement 1 ')")
        press(tab, "Repeat the last")
        wait(tab, f"{ASKED}.includes('Measurement 2 ')")
        paste(tab, rows[2])
        wait(tab, f"{ASKED}.includes('Measurement 1 ')")
        tab.reload()
        wait(tab, f"{LINE} && {ASKED}.includes('Measurement 1 ')")
        press(tab, "Skip this posture")
        wait(tab, OVER)
        assert tab.value("document.querySelectorAll('img').length") == 0
        assert (tab.console, tab.dialogs) == ([], [])
    assert [shot.shot for shot in read_run(folder / "cell" / "hand.jsonl").shots] == [0, 2]


CELL = {
    "schema": "zerobeam/cell/1",
    "camera": None,
    "psd": {"rate_hz": 20_000.0, "placed": {"psd": {"centre_mm": [900.0, 0.0, 0.0]}}},
}


@pytest.mark.long
def test_a_robot_moves_once_a_person_has_confirmed(server: App, folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("abb_robot_client")
    (tmp_path / "cell.yaml").write_text(json.dumps(CELL))
    asked = [str(folder / "cell" / "two.yaml"), "--cell", str(tmp_path / "cell.yaml")]
    unbuffered = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with child([*ABB_CONTROLLER, *asked], stderr=subprocess.PIPE, env=unbuffered) as there:
        assert there.stdout is not None
        lines = itertools.takewhile(lambda line: "Ctrl-C" not in line, there.stdout)
        numbers = [re.findall(r"\d+", line)[-1] for line in lines]
        with measure(server, "two.yaml", "abb", SCREENS["tablet"]) as tab:
            tab.value("[...document.querySelectorAll('.start summary')].map((e) => e.click())")
            labels = ("Port of Robot Web Services", "Own UDP port for EGM", "Port of PSD and camera")
            wait(tab, "document.querySelector('.start .fold .fields')")
            for label, value in zip(labels, numbers, strict=True):
                fill(tab, label, value)
            fill(tab, "Controller’s address", "127.0.0.1")
            fill(tab, "Share of the joints’ top speeds", "1")
            for answer, button in (("no", "Do not move"), ("yes", "Move the robot")):
                fill(tab, "Password", "robotics")
                fill(tab, "Run file", f"cell/{answer}.jsonl")
                start(tab)
                wait(tab, "document.querySelector('.confirm')", 60)
                question = tab.value("document.querySelector('.confirm').textContent")
                assert "irb1600 is about to move, at 100\u00a0% of its joints' top speeds" in question
                assert tab.value("document.activeElement.textContent") == "Do not move"
                assert tab.accessibility() == []
                press(tab, button)
                wait(tab, OVER, 120)
                wait(tab, f"{NOW}.includes('kept in {answer}.jsonl.')")
                # A busy machine may be too late for the controller, which then stops the arm: it has moved.
                assert ("not confirmed; nothing has moved" in tab.text) == (answer == "no")
        for job in server.ask("jobs"):
            assert "robotics" not in json.dumps(server.ask(f"jobs/{job['id']}"))
        there.terminate()
        there.communicate(timeout=30)
    assert '"origin":"simulated, virtual ABB controller"' in (folder / "cell" / "yes.jsonl").read_text()
    assert len((folder / "cell" / "no.jsonl").read_text().splitlines()) == 1
