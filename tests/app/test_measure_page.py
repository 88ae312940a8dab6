"""The place Measure: runs begun, watched, stopped and resumed in the browser."""

from __future__ import annotations

import itertools
import json
import os
import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from app_page import SCREENS, App, app, give, root, touch, wait
from cells import good_plan
from child import ZEROBEAM, child
from chromium import LAPTOP, Size, Tab, chromium
from command_line import plan_file, zerobeam

from zerobeam.model.files.run import read_run

pytestmark = pytest.mark.browser

NAME = "<img src=x onerror=alert(1)>.yaml"
NOW = "document.getElementById('measure-now').textContent"
STOP = "document.getElementById('measure-stop')"
POSTURES = 120  # no machine has carried them out before somebody stops it
UNDER_WAY = "!document.querySelector('.stop-bar').hidden"
OVER = "document.querySelector('.stop-bar').hidden"
RESUME = "document.querySelector('#measure-open:not([hidden]) #measure-unfinished button')"
ROWS = "document.querySelectorAll('#measure-table [data-of]').length"
ASKED = "document.getElementById('measure-asked').textContent"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    chromium()
    made = tmp_path / "dir"
    made.mkdir()
    plan_file(made / "two.yaml", good_plan(2))
    plan_file(made / "long.yaml", good_plan(POSTURES))
    plan_file(made / NAME, good_plan(3))
    return made


@pytest.mark.parametrize(
    ("stalled", "tolerance", "words"),
    [
        ("false", "null", "about 12 s left."),
        ("true", "null", "at least 12 s left."),
        ("false", "0.1", "at most 12 s left."),
        ("true", "0.1", "about 12 s left."),
    ],
)
def test_time_left_is_a_bound_where_it_is_one(server: App, stalled: str, tolerance: str, words: str) -> None:
    job = f"{{state: 'running', left_s: 12, left_at_least: {stalled}}}"
    run = f"{{recorded: [1], refused: [], postures: 7, rig: 'simulated', tolerance: {tolerance}}}"
    with chromium().opened(f"{server.address}#measure", LAPTOP) as tab:
        said = tab.value(
            f"import('/page/places/measure/live.js').then(m => m.Live.prototype.time({job}, {run}))"
        )
    assert said == f"1 measurement recorded, of 7 planned; {words}"


@pytest.fixture
def server(folder: Path) -> Iterator[App]:
    with app(folder) as opened:
        yield opened


@contextmanager
def measure(server: App, plan: str, rig: str = "simulated", size: Size = LAPTOP) -> Iterator[Tab]:
    """The place with a plan chosen."""
    with chromium().opened(f"{server.address}#measure", size) as tab:
        wait(tab, "document.querySelector('#measure-plan optgroup')")
        give(tab, "document.getElementById('measure-plan')", plan)
        click(tab, f"document.querySelector('#measure-form [value={rig}]')")
        yield tab


def click(tab: Tab, element: str) -> None:
    tab.value(f"{element}.click()")


def start(tab: Tab) -> None:
    click(tab, "document.getElementById('measure-start')")
    wait(tab, UNDER_WAY)


def reload(tab: Tab) -> None:
    tab.reload()
    wait(tab, "document.querySelector('.stop-bar')")


def paste(tab: Tab, text: str) -> None:
    tab.value("document.getElementById('measure-line').focus()")
    tab.value("document.getElementById('measure-line').select()")
    tab.call("Input.insertText", text=text)
    for kind in ("keyDown", "keyUp"):
        tab.call("Input.dispatchKeyEvent", type=kind, key="Enter", windowsVirtualKeyCode=13)


def unbroken(folder: Path, plan: str) -> bytes:
    zerobeam("run", folder / plan, "-o", folder / "unbroken.jsonl")
    return (folder / "unbroken.jsonl").read_bytes()


@pytest.mark.long
def test_a_simulated_run_is_watched_to_its_end(server: App, folder: Path) -> None:
    with measure(server, "two.yaml") as tab:
        assert tab.value("document.getElementById('measure-file').value") == "two-run.jsonl"
        click(tab, "document.getElementById('measure-camera')")
        start(tab)
        wait(tab, OVER)
        wait(tab, f"{NOW}.endsWith('2 measurements are kept in two-run.jsonl.')")
        assert tab.value("document.querySelector('[data-of=delta2] .u').textContent") == "not determined yet"
        assert tab.value("document.querySelectorAll('#measure-trace circle').length") > 1
        assert "mm; face 20 mm" in tab.value("document.getElementById('measure-psd').textContent")
        assert tab.console == []
    assert len(read_run(folder / "two-run.jsonl").shots) == 2


@pytest.mark.long
@pytest.mark.parametrize("size", SCREENS)
def test_the_place_leaves_nobody_out(server: App, size: str) -> None:
    """Before, while, and after; by touch where there is no mouse. Nothing is asked of others."""
    with measure(server, "long.yaml", size=SCREENS[size]) as tab:
        assert (tab.accessibility(), tab.overflow()) == ([], 0)
        start(tab)
        wait(tab, ROWS)
        assert (tab.accessibility(), tab.overflow()) == ([], 0)
        small = "[...document.querySelectorAll('#measure button, #measure select, .stop-bar button')]"
        small += ".filter((e) => e.offsetParent && e.getBoundingClientRect().height < 40).length"
        assert tab.value(small) == 0
        if size == "laptop":
            tab.key("Escape")
        else:
            touch(tab, STOP)
        wait(tab, f"{NOW}.startsWith('Stopped. ')")
        wait(tab, RESUME)
        assert tab.accessibility() == []
        assert tab.overflow() == 0
        assert tab.console == []
        assert [url for url in tab.asked if not url.startswith(root(server.address))] == []


@pytest.mark.long
def test_a_run_is_stopped_from_elsewhere_reloaded_and_resumed(server: App, folder: Path) -> None:
    with measure(server, "long.yaml") as tab:
        start(tab)
        wait(tab, ROWS)
        reload(tab)
        wait(tab, ROWS)
        wait(tab, "document.querySelector('.stop-bar p').textContent.includes('long-run.jsonl')")
        tab.value("location.hash = 'robot'")
        wait(tab, "!document.getElementById('robot').hidden")
        click(tab, STOP)
        wait(tab, OVER)
        kept = len(read_run(folder / "long-run.jsonl").shots)
        assert 0 < kept < POSTURES
        tab.value("location.hash = 'measure'")
        wait(tab, f"{NOW}.startsWith('Stopped. {kept} measurement')")
        wait(tab, RESUME)
        listed = tab.value("document.getElementById('measure-unfinished').textContent")
        assert f"{kept} of {POSTURES} recorded" in listed
        click(tab, RESUME)
        wait(tab, UNDER_WAY)
        wait(tab, OVER, 120)
        wait(tab, f"{NOW}.endsWith('{POSTURES} measurements are kept in long-run.jsonl.')")
        assert tab.console == []
    assert (folder / "long-run.jsonl").read_bytes() == unbroken(folder, "long.yaml")


@pytest.mark.long
def test_the_page_offers_to_resume_once_a_killed_server_is_back(server: App, folder: Path) -> None:
    with measure(server, "long.yaml") as tab:
        start(tab)
        wait(tab, ROWS)
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
            wait(tab, f"{NOW}.endsWith('{POSTURES} measurements are kept in long-run.jsonl.')")
    assert (folder / "long-run.jsonl").read_bytes() == unbroken(folder, "long.yaml")


@pytest.mark.long
@pytest.mark.parametrize("size", ["tablet", "phone"])
def test_a_person_is_led_and_a_doubt_is_said_at_the_field(server: App, folder: Path, size: str) -> None:
    plan = good_plan(3)
    rows = [", ".join(f"{value:.4f}" for value in row) for row in plan.postures * plan.robot.display]
    with measure(server, NAME, "manual", SCREENS[size]) as tab:
        give(tab, "document.getElementById('measure-file')", "hand.jsonl")
        start(tab)
        wait(tab, f"{ASKED}.startsWith('Posture 1 of 3')")
        paste(tab, "1, 2")
        wait(tab, "document.getElementById('measure-doubt').textContent")
        assert tab.value("document.getElementById('measure-line').getAttribute('aria-invalid')") == "true"
        paste(tab, rows[0])
        wait(tab, f"{ASKED}.startsWith('Posture 2 of 3')")
        paste(tab, rows[2])
        wait(tab, "document.querySelectorAll('#measure-doubt button').length === 2")
        assert (tab.accessibility(), tab.overflow()) == ([], 0)
        touch(tab, "document.querySelectorAll('#measure-doubt button')[1]")  # it is posture 2
        wait(tab, f"{ASKED}.includes('measurement 1')")
        touch(tab, "document.querySelector('[data-line=redo]')")
        wait(tab, f"{ASKED}.includes('measurement 2')")
        paste(tab, rows[2])
        wait(tab, f"{ASKED}.includes('measurement 1')")
        reload(tab)
        wait(tab, f"{ASKED}.includes('measurement 1')")
        touch(tab, "document.querySelector('[data-line=skip]')")
        wait(tab, OVER)
        assert tab.value("document.querySelectorAll('img').length") == 0
        assert (tab.console, tab.dialogs) == ([], [])
    assert [shot.shot for shot in read_run(folder / "hand.jsonl").shots] == [0, 2]


CELL = {
    "schema": "zerobeam/cell/1",
    "camera": None,
    "psd": {"rate_hz": 20_000.0, "placed": {"psd": {"centre_mm": [900.0, 0.0, 0.0]}}},
}


@pytest.mark.long
def test_a_robot_moves_once_a_person_has_confirmed(server: App, folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("abb_robot_client")
    (tmp_path / "cell.yaml").write_text(json.dumps(CELL))
    asked = ["controller", str(folder / "two.yaml"), "--cell", str(tmp_path / "cell.yaml")]
    ports = [part for name in ("--port", "--egm-port", "--sensor-port") for part in (name, "0")]
    unbuffered = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with child([*ZEROBEAM, *asked, *ports], stderr=subprocess.PIPE, env=unbuffered) as there:
        assert there.stdout is not None
        lines = itertools.takewhile(lambda line: "Ctrl-C" not in line, there.stdout)
        numbers = [re.findall(r"\d+", line)[-1] for line in lines]
        with measure(server, "two.yaml", "abb", SCREENS["tablet"]) as tab:
            stated = dict(zip(("port", "egm-port", "sensor-port"), numbers, strict=True))
            stated |= {"host": "127.0.0.1", "password": "robotics", "speed": "1"}
            for name, value in stated.items():
                give(tab, f"document.getElementById('measure-{name}')", value)
            confirm = "document.getElementById('measure-confirm')"
            for answer in ("no", "yes"):
                give(tab, "document.getElementById('measure-password')", "robotics")
                give(tab, "document.getElementById('measure-file')", f"{answer}.jsonl")
                start(tab)
                wait(tab, f"!{confirm}.hidden", 60)
                said = tab.value(f"{confirm}.textContent")
                assert "irb1600 is about to move, at 100% of its joints' top speeds" in said
                assert tab.value("document.activeElement.id") == "measure-no"
                assert tab.accessibility() == []
                click(tab, f"document.getElementById('measure-{answer}')")
                wait(tab, OVER, 120)
                wait(tab, f"{NOW}.endsWith('kept in {answer}.jsonl.')")
                # A busy machine may be too late for the controller, which then stops the arm: it has moved.
                assert ("not confirmed; nothing has moved" in tab.text) == (answer == "no")
        for job in server.ask("jobs"):
            assert "robotics" not in json.dumps(server.ask(f"jobs/{job['id']}"))
        there.terminate()
        there.communicate(timeout=30)
    assert '"origin":"simulated, virtual ABB controller"' in (folder / "yes.jsonl").read_text()
    assert len((folder / "no.jsonl").read_text().splitlines()) == 1
