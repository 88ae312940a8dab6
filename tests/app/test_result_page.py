"""The place Result as a browser shows it, used as a person would: mouse, touch and keyboard."""

from __future__ import annotations

import json
import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
from app_page import SCREENS, app, root, wait
from chromium import LAPTOP, PHONE, Size, Tab, chromium

import zerobeam as zb
from zerobeam.experiments.demos import demo_runs
from zerobeam.face.in_app import AppView, app_of
from zerobeam.model.files.run import write_run

pytestmark = pytest.mark.browser

NAME = "<img src=x onerror=alert(1)>"
VERDICT = "document.getElementById('result-verdict').textContent.replace('Simulated: ', '').toLowerCase()"
WITHOUT = "document.getElementById('result-without').textContent"
CHOSEN = "document.getElementById('result-chosen').textContent"
CHANGES = (
    "[...document.querySelectorAll('#result-measurements td.brushed:nth-of-type(8)')]"
    ".map((e) => e.textContent)"
)
DRAWN = "document.querySelector('#result-plot canvas').toDataURL()"


@contextmanager
def result(address: str, file: str, size: Size = LAPTOP) -> Iterator[Tab]:
    with chromium().opened(f"{address}#result/{file}", size) as tab:
        wait(tab, "!document.getElementById('result-work').hidden")
        wait(tab, "document.getElementById('result-unknown').textContent")
        yield tab


def box(shot: int) -> str:
    return f"document.querySelector('#result-measurements [data-shot=\"{shot}\"] input')"


def cell(name: str, column: str) -> str:
    return f"document.querySelector('#result-table [data-of={name}] {column}').textContent"


@pytest.fixture(scope="module")
def quick(reported: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    chromium()
    folder = tmp_path_factory.mktemp("result-page") / "dir"
    shutil.copytree(reported, folder)
    shutil.copytree(folder / "good", folder / NAME)
    with app(folder) as server:
        yield server.address


def test_a_measurement_is_left_out_and_taken_back(quick: str, reported: Path) -> None:
    stated = json.loads((reported / "good/result.json").read_text())
    with result(quick, f"{NAME}/result.json") as tab:
        assert tab.value(VERDICT).startswith("pass. j2 (δ2)")
        entered = tab.value("[...document.querySelectorAll('#result-enter .copy')].map((e) => e.textContent)")
        assert entered == [own["value"] for own in stated["next_steps"]["enter"]]
        before = tab.value(cell("delta2", ".u"))
        tab.value(f"{box(2)}.click()")
        wait(tab, f"{WITHOUT}.includes('without measurement 2')")
        assert tab.value(cell("delta2", ".refit.u")) not in ("", before)
        assert tab.value(cell("delta2", ".u")) == before
        for shot in range(3, 7):
            tab.value(f"{box(shot)}.click()")
        wait(tab, f"{WITHOUT}.includes('no longer determined: J2 (δ2)')")
        assert tab.value(cell("delta2", ".refit.u")) == "not determined"
        tab.value("document.getElementById('result-all').click()")
        wait(tab, f"{WITHOUT} === ''")
        assert tab.value("document.querySelectorAll('img').length") == 0
        assert tab.dialogs == []
        assert tab.console == []


@pytest.mark.long
def test_what_is_not_determined_has_no_number_and_no_value_to_enter(quick: str) -> None:
    with result(quick, "x-pattern/result.json") as tab:
        assert tab.value(VERDICT).startswith("degenerate.")
        assert tab.value(cell("delta2", ".u")) == "not determined"
        assert tab.value("document.getElementById('result-enter')") is None
        assert "J2 (δ2): prior only" in tab.text
        tab.value("(() => { const f = document.querySelector('#result-ranges input'); f.value = 9;"
                  " f.dispatchEvent(new Event('change')); })()")  # fmt: skip
        wait(tab, f"{CHOSEN}.includes('say nothing of the residuals')")
        assert set(tab.value(CHANGES)) == {""}


@pytest.mark.long
def test_an_odd_file_is_one_clear_error(quick: str) -> None:
    with chromium().opened(f"{quick}#result/good/report.html") as tab:
        error = "document.getElementById('result-error')"
        wait(tab, f"!{error}.hidden")
        assert "not a whole result" in tab.value(f"{error}.textContent")
        assert tab.value("document.getElementById('result-work').hidden")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of one serial number, two with reports and two without; one that the model does not describe."""
    chromium()
    made = tmp_path_factory.mktemp("results") / "dir"
    made.mkdir()
    good = zb.read_run(demo_runs()[0].path)
    plan = zb.Plan.from_arrays(
        robot="irb1600",
        tool=zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
        postures=good.joints,
        unit="rad",
        noise=zb.Noise(joint_deg=0.01, spot_mm=0.05),
        target_priors={"psd": {"guess_mm": (950, 150, 100)}},
    )
    for k in range(4):
        run = zb.simulate(plan, seed=k, offsets={"delta2": 0.3})
        stated = {**run.header.provenance, "serial": "16-5", "when": f"2026-0{k + 1}-11"}
        write_run(made / f"run{k}.jsonl", run.header.model_copy(update={"provenance": stated}), run.shots)
        if k < 2:
            zb.analyse(zb.read_run(made / f"run{k}.jsonl"), ess=100).report(made / f"run{k}")
    turned = good.joints * np.where(np.arange(6) == 3, -1.0, 1.0)
    odd = zb.Run.from_arrays(
        robot="irb1600",
        tool=zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
        joints=turned,
        unit="rad",
        noise=zb.Noise(joint_deg=0.01, spot_mm=0.05),
    )
    write_run(made / "odd.jsonl", odd.header, odd.shots)
    found = zb.analyse(zb.read_run(made / "odd.jsonl"), ess=100)
    assert found.verdict == "misfit"
    found.report(made / "odd")
    return made


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    with app(folder) as server:
        yield server.address


@pytest.mark.long
@pytest.mark.parametrize("file", ["run0/result.json", "odd/result.json"])
@pytest.mark.parametrize("size", SCREENS)
def test_it_loads_from_the_server_alone_and_leaves_nobody_out(address: str, size: str, file: str) -> None:
    with result(address, file, SCREENS[size]) as tab:
        tab.value(f"{box(1)}.click()")
        wait(tab, "!document.getElementById('result-refit').hidden")
        assert tab.accessibility() == []
        assert tab.overflow() == 0
        assert tab.console == []
        assert tab.asked
        assert [url for url in tab.asked if not url.startswith(root(address))] == []


@pytest.mark.long
def test_a_misfit_comes_first_and_offers_nothing(address: str, folder: Path) -> None:
    with result(address, "odd/result.json") as tab:
        assert tab.value(VERDICT).startswith("misfit.")
        assert tab.value("document.getElementById('result-enter')") is None
        assert "What to do: Enter nothing." in tab.text
        assert tab.value(cell("delta2", ".status")) == "▲ unvalidated"
        assert "not sampled: the model does not describe the measurements" in tab.text
        tab.value("document.getElementById('export-do').click()")
        wait(tab, "document.getElementById('export-job').textContent.includes('Refused')", 60)
        assert "--unvalidated" in tab.value("document.getElementById('export-job').textContent")
        assert tab.console == []
    assert not list(folder.glob("*.yaml"))


def _drag(tab: Tab, touch: bool) -> None:
    """A region in the second panel of the first column, where J2 and J3 are."""
    tab.value("document.getElementById('result-plot').scrollIntoView()")
    left, top, width = tab.value(
        "(() => { const b = document.querySelector('#result-plot canvas').getBoundingClientRect();"
        " return [b.left, b.top, b.width]; })()"
    )
    side = (width - 58 - 8 - 6 * 4) / 5
    tall = min(side, 220) * 0.9
    x0, y0 = left + 58 + 0.5 * side, top + 8 + tall + 6 + 0.5 * tall
    places = [(x0 + k * side / 12, y0 - k * tall / 12) for k in range(6)]
    for k, (x, y) in enumerate(places):
        if touch:
            kind = "touchStart" if k == 0 else "touchMove"
            tab.call("Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": y}])
        else:
            kind = "mousePressed" if k == 0 else "mouseMoved"
            tab.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)
    if touch:
        tab.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    else:
        x, y = places[-1]
        tab.call("Input.dispatchMouseEvent", type="mouseReleased", x=x, y=y, button="left", clickCount=1)


@pytest.mark.long
@pytest.mark.parametrize("by", ["mouse", "touch", "keyboard"])
def test_draws_are_chosen_and_the_residuals_follow(address: str, by: str) -> None:
    with result(address, "run0/result.json", PHONE if by == "touch" else LAPTOP) as tab:
        assert set(tab.value(CHANGES)) == {""}
        if by == "keyboard":
            tab.value("document.querySelector('#result-plot canvas').focus()")
            for _ in range(6):
                tab.key("ArrowRight")
        else:
            _drag(tab, by == "touch")
        wait(tab, f"{CHANGES}.some((text) => text !== '' && Number(text.replace('−', '-')) !== 0)")
        assert "draws are chosen" in tab.value(CHOSEN)
        fields = "[...document.querySelectorAll('#result-ranges input')]"
        assert tab.value(f"{fields}.filter((e) => e.value).length") == 4  # from and to, of two offsets
        if by == "keyboard":
            tab.key("Escape")
        else:
            tab.value("document.getElementById('result-clear').click()")
        wait(tab, f"{CHOSEN} === ''")
        assert set(tab.value(CHANGES)) == {""}


@pytest.mark.long
def test_a_measurement_shows_its_shift_as_an_arrow(address: str) -> None:
    shift = "document.querySelector('#result-measurements [data-shot=\"0\"] button')"
    with result(address, "run0/result.json") as tab:
        before = tab.value(DRAWN)
        tab.value(f"{shift}.click()")
        wait(tab, f"{WITHOUT}.startsWith('Arrow: ')")
        assert tab.value(DRAWN) != before
        assert tab.value(f"{shift}.getAttribute('aria-pressed')") == "true"
        assert not tab.value("document.getElementById('result-table').hasAttribute('data-refit')")
        tab.value(f"{shift}.click()")
        wait(tab, f"{WITHOUT} === ''")
        wait(tab, f"{DRAWN} === {before!r}")


@pytest.mark.long
def test_the_report_stands_in_its_frame_and_everything_can_be_taken_away(address: str) -> None:
    with result(address, "run0/result.json") as tab:
        frame = "document.getElementById('result-frame')"
        assert tab.value(f"{frame}.getAttribute('sandbox')") == "allow-scripts"
        wait(tab, f"{frame}.src.endsWith('/report/run0/report.html')")
        links = tab.value("[...document.querySelectorAll('#result-downloads a')].map((a) => a.href)")
        assert len(links) > 6
        sizes = tab.value(
            "Promise.all([...document.querySelectorAll('#result-downloads a')].map((a) => fetch(a.href)"
            ".then((r) => (r.ok ? r.arrayBuffer() : new ArrayBuffer(0))).then((b) => b.byteLength)))"
        )
        assert min(sizes) > 100


@pytest.mark.long
def test_a_run_without_a_report_gets_one_is_exported_and_compared(address: str, folder: Path) -> None:
    with chromium().opened(f"{address}#result/run2.jsonl") as tab:
        wait(tab, "!document.getElementById('result-run').hidden")
        tab.value("document.getElementById('result-make').click()")
        wait(tab, "document.querySelector('#result-making progress')")
    with chromium().opened(f"{address}#result/run2.jsonl") as tab:  # as after a reload
        wait(tab, "!document.getElementById('result-work').hidden", 120)
        assert (folder / "run2-report/report.html").is_file()
        assert tab.value(VERDICT).startswith("pass.")
        assert "run2-report" in tab.value("document.getElementById('result-open').value")
        form = "document.getElementById('export-form')"
        tab.value(f"{form}.value = 'csv'; {form}.dispatchEvent(new Event('change'))")
        tab.value("document.getElementById('export-without').value = 'delta6'")
        tab.value("document.getElementById('export-do').click()")
        wait(tab, "document.querySelector('#export-job a')", 60)
        assert (folder / "run2-offsets.csv").is_file()
        chosen = "[...document.querySelectorAll('#compare-choice input')].filter((e) => /^run/.test(e.value))"
        tab.value(f"{chosen}.forEach((e) => e.click())")
        tab.value("document.getElementById('compare-do').click()")
        wait(tab, "document.querySelector('#compare-answer .word')", 120)
        assert tab.value("document.querySelector('#compare-answer .word').textContent") in (
            "Agrees.",
            "Does not agree.",
        )
        assert (folder / "comparison/compare.html").is_file()
        assert tab.console == []


@pytest.mark.long
def test_making_a_report_is_cancelled_and_leaves_nothing(address: str, folder: Path) -> None:
    with chromium().opened(f"{address}#result/run3.jsonl") as tab:
        wait(tab, "!document.getElementById('result-run').hidden")
        tab.value("document.getElementById('result-make').click()")
        wait(tab, "document.querySelector('#result-making button')")
        tab.value("document.querySelector('#result-making button').click()")
        wait(tab, "document.getElementById('result-making').textContent.includes('Cancelled')")
        assert not tab.value("document.getElementById('result-make').disabled")
    assert not (folder / "run3-report").exists()


@pytest.mark.long
def test_the_history_shows_each_joint_over_time(address: str) -> None:
    with chromium().opened(f"{address}#result") as tab:
        wait(tab, "document.querySelectorAll('#history svg').length")
        text = tab.value("document.getElementById('history').innerText")
        assert "Serial number 16-5" in text
        assert "No serial number stated" in text
        said = tab.value("document.querySelector('#history svg').getAttribute('aria-label')")
        assert "2026-01-11" in said
        assert "±" in said
        assert "unvalidated" in text
        tab.value("location.hash = 'result/run0.jsonl'")
        wait(tab, "!document.getElementById('result-work').hidden")


class _Notebook(BaseHTTPRequestHandler):
    """A page of another server of this machine."""

    content = ""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("content-type", "text/html")
        self.end_headers()
        if self.path == "/":
            self.wfile.write(self.content.encode())

    def log_message(self, format: str, *args: object) -> None:
        """Silence."""


class _Thing:
    """What a notebook holds."""


@pytest.mark.long
@pytest.mark.parametrize("ours", [True, False])
def test_a_notebook_of_this_machine_frames_its_own_app_alone(
    address: str, reported: Path, ours: bool
) -> None:
    def write(folder: Path) -> str:
        shutil.copytree(reported, folder, dirs_exist_ok=True)
        return "good/result.json"

    view = app_of(_Thing(), "result", write) if ours else AppView(f"{address}#result/run0/result.json")
    html = f"<!doctype html><title>notebook</title>{view._repr_html_()}"
    page = type("Page", (_Notebook,), {"content": html})
    with ThreadingHTTPServer(("127.0.0.1", 0), page) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            with chromium().opened(f"http://localhost:{server.server_port}/") as tab:
                time.sleep(2)
                refused = [said for said in tab.console if "frame" in said]
                assert bool(refused) != ours, tab.console
                if ours:  # by a cookie of a frame of another site: a name and an address are two
                    wait(tab.frame(root(view.address)), "!document.getElementById('result-work').hidden")
        finally:
            server.shutdown()


@pytest.mark.long
@pytest.mark.parametrize("size", SCREENS.values(), ids=SCREENS)
def test_the_pages_of_the_history_are_made_and_shown(folder: Path, tmp_path: Path, size: Size) -> None:
    there = tmp_path / "dir"
    shutil.copytree(folder, there)
    shutil.rmtree(there / "history", ignore_errors=True)
    with app(there) as server, chromium().opened(f"{server.address}#result", size) as tab:
        address = server.address
        wait(tab, "document.getElementById('drift-about').textContent.includes('of 1 arm')")
        tab.value("document.getElementById('drift-do').click()")
        wait(tab, "document.getElementById('drift-frame').src", 120)
        assert (
            tab.value("document.getElementById('drift-frame').src")
            == f"{root(address)}report/history/fleet.html"
        )
        answer = json.loads((there / "history/fleet.json").read_text())
        assert [own["serial"] for own in answer["arms"]] == ["16-5"]
        assert answer["as_of"] == tab.value("document.getElementById('drift-day').value")
        wait(tab, "document.getElementById('drift-alone').href.endsWith('fleet.html')")
        with chromium().opened(f"{root(address)}report/history/fleet.html", size, beside=tab) as page:
            page.value("document.querySelector('th a').click()")
            wait(page, "document.title === 'Arm 16-5'")
        arm = "document.getElementById('drift-arm')"
        tab.value(f"{arm}.value = '16-5'; {arm}.dispatchEvent(new Event('change'))")
        tab.value("document.getElementById('drift-do').click()")  # again: nothing is added twice
        wait(tab, "document.getElementById('drift-frame').src.endsWith('arm.html')", 120)
        assert (
            len(json.loads((there / "history-16-5/arm.json").read_text())["results"])
            == answer["arms"][0]["results"]
        )
        assert tab.value("document.documentElement.scrollWidth <= innerWidth")
        assert tab.accessibility() == []
        tab.value("document.getElementById('drift-folder').value = 'run0'")  # another's: nothing is replaced
        tab.value("document.getElementById('drift-do').click()")
        wait(tab, "document.getElementById('drift-making').textContent.includes('other things')", 60)
        assert tab.value("document.getElementById('drift-frame').hidden")
        assert tab.console == []
