"""The step Result as a browser shows it, used as a person would: mouse, touch and keyboard."""

import json
import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from app_page import SCREENS, app, give, root, wait
from chromium import LAPTOP, PHONE, Size, Tab, chromium
from exact_runs import demo_runs

import zerobeam as zb
from zerobeam.face.notebook import AppView, app_of
from zerobeam.model.files.run import read_run, write_run
from zerobeam.model.records import dumps
from zerobeam.words.sentences import to_json

pytestmark = pytest.mark.browser

WORD = "document.querySelector('.top-message .word').textContent"
FIRST = "[...document.querySelector('.front table').tBodies[0].rows]"
CHOSEN = "document.querySelector('.chosen').textContent"
CHANGES = "[...document.querySelectorAll('.measurements td.change')].map((e) => e.textContent)"
DRAWN = "document.querySelector('.pairs canvas').toDataURL()"


@contextmanager
def result(address: str, name: str, file: str = "", size: Size = LAPTOP) -> Iterator[Tab]:
    with chromium().opened(f"{address}#/job/{name}/result{file and f'/{file}'}", size) as tab:
        wait(tab, "document.querySelector('.offsets')")
        yield tab


def problems(tab: Tab) -> list[str]:
    """What the page says, but for the remarks of a driver that draws by software."""
    return [said for said in tab.console if "WebGL" not in said]


def unfold(tab: Tab, title: str) -> None:
    fold = f"[...document.querySelectorAll('.fold')].find((f) => f.firstChild.textContent === {title!r})"
    tab.value(f"{fold}.firstChild.click()")
    wait(tab, f"{fold}.childElementCount > 1")


def box(shot: int) -> str:
    return f"document.querySelector('.measurements [data-shot=\"{shot}\"] input')"


def cell(name: str, column: str) -> str:
    return f"document.querySelector('.offsets [data-of={name}] {column}')?.textContent"


def button(text: str) -> str:
    return f"[...document.querySelectorAll('button')].find((b) => b.textContent === {text!r})"


@pytest.fixture(scope="module")
def quick(reported: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Two calibrations: each a folder with a run, and a report in a folder below it."""
    chromium()
    folder = tmp_path_factory.mktemp("result-page") / "dir"
    for name in ("good", "x-pattern"):
        (folder / name).mkdir(parents=True)
        shutil.copy(reported / f"{name}.jsonl", folder / name / "run.jsonl")
        shutil.copytree(reported / name, folder / name / "report")
    with app(folder) as server:
        yield server.address


def looked_at_without_a_measurement_and_taken_away(quick: str, reported: Path) -> None:
    stated = json.loads((reported / "good/result.json").read_text())
    with result(quick, "good") as tab:
        assert tab.value("location.hash") == "#/job/good/result"
        assert tab.value(WORD).startswith(stated["message"]["verdict"])
        assert stated["message"]["action"]["text"] in tab.text
        entered = tab.value(f"{FIRST}.map((row) => row.cells[1].textContent.trim()).filter(Boolean)")
        assert entered == [own["value"] for own in stated["next_steps"]["enter"]]
        before = tab.value(cell("delta2", ".u"))
        tab.value(f"{box(2)}.click()")
        wait(tab, "document.querySelector('.without')?.textContent.includes('without measurement 2')")
        assert tab.value(cell("delta2", ".refit")) not in ("", before)
        assert tab.value(cell("delta2", ".u")) == before
        for shot in range(3, 7):
            tab.value(f"{box(shot)}.click()")
        wait(tab, "document.querySelector('.without').textContent.includes('determined: J2 (δ2)')")
        assert tab.value(cell("delta2", ".refit")) == "not determined"
        tab.value(f"{button('Leave none out')}.click()")
        wait(tab, "!document.querySelector('.without')")
        # The report opens alone, and everything can be taken away.
        assert tab.value("document.querySelector('iframe')") is None
        assert tab.value("document.querySelector('a.report').target") == "_blank"
        unfold(tab, "Files")
        links = "[...document.querySelectorAll('.downloads a, a.report')]"
        sizes = tab.value(
            f"Promise.all({links}.map((a) => fetch(a.href).then((r) => (r.ok ? r.arrayBuffer()"
            " : new ArrayBuffer(0))).then((b) => b.byteLength)))"
        )
        assert len(sizes) > 6
        assert min(sizes) >= 10  # the pages of this report are stubs
        assert problems(tab) == []


MODULE = """MODULE {0}
  CONST jointtarget p{0}:=[[10,20,-30,40,50,{1}],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PROC go{0}()
    MoveAbsJ p{0},v100,fine,tool0;
  ENDPROC
ENDMODULE
"""


@pytest.mark.long
def test_my_programs_are_sent_as_several_files_a_folder_or_a_zip(reported: Path, tmp_path: Path) -> None:
    """By a run that does not say that it is simulated: by another one none is converted."""
    run, result_file = (tmp_path / "dir" / "good" / name for name in ("run.jsonl", "report/result.json"))
    shutil.copytree(reported / "good", result_file.parent)
    simulated = (reported / "good.jsonl").read_bytes()
    assert simulated.count(b'"simulated"') == 1
    run.write_bytes(simulated.replace(b'"simulated"', b'"cell 4"'))
    old, new = (read_run(each).sha256 for each in (reported / "good.jsonl", run))
    stated = (reported / "good" / "result.json").read_text()
    assert old in stated
    result_file.write_text(
        stated.replace(old, new).replace("Simulated: ", "").replace('"simulated"', '"cell 4"')
    )
    backup = tmp_path / "Cell 7"
    (backup / "TASK1").mkdir(parents=True)
    files = [backup / "TASK1" / f"{name}.mod" for name in "AB"]
    for number, path in enumerate(files):
        path.write_text(MODULE.format(path.stem, number))
    (backup / "photo.png").write_bytes(b"no program")
    archive = Path(shutil.make_archive(str(tmp_path / "sent"), "zip", backup))
    one, many = "[webkitdirectory]", ":not([webkitdirectory])"
    ways: list[tuple[str, Any, str]] = [
        (many, files, "programs"),
        (one, backup, "Cell 7"),
        (many, archive, "sent.zip"),
    ]
    inputs = "form.program input[type=file]"
    links = "[...document.querySelectorAll('form.program a[download]')].map((a) => a.textContent)"
    shutil.copytree(reported / "good", tmp_path / "dir" / "made" / "report")
    shutil.copy(reported / "good.jsonl", tmp_path / "dir" / "made" / "run.jsonl")
    with app(tmp_path / "dir") as server, result(server.address, "made") as tab:
        assert "My programs" not in tab.text
    with app(tmp_path / "dir") as server, result(server.address, "good") as tab:
        unfold(tab, "My programs")
        wait(tab, f"document.querySelector({inputs!r})?.accept.includes('.mod')")
        for which, sent, name in ways:
            tab.on(lambda frame, which=which, sent=sent: frame.page.set_input_files(inputs + which, sent))
            wait(tab, f"document.querySelector('.program select').value === 'good/{name}'")
            wait(tab, f"{links}.length === 0")
            tab.value(f"{button('Convert the positions')}.click()")
            wait(tab, f"{links}.some((text) => text.includes('B.mod'))", 120)
            written = ("positions.html", "audit.json", "A.mod", "B.mod")
            assert tab.value(links) == [f"Download {each}" for each in written]
        assert problems(tab) == []


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of one serial number, two with reports and two without; one that the model does not describe."""
    chromium()
    made = tmp_path_factory.mktemp("results") / "dir"
    made.mkdir()
    good = zb.read_run(demo_runs()[0].path)
    tool, noise = zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)), zb.Noise(joint_deg=0.01, spot_mm=0.05)
    plan = zb.Plan.from_arrays(
        robot="irb1600",
        tool=tool,
        postures=good.joints,
        unit="rad",
        noise=noise,
        target_priors={"psd": {"guess_mm": (950, 150, 100)}},
    )
    for k in range(4):
        run = zb.simulate(plan, seed=k, offsets={"delta2": 0.3})
        stated = {**run.header.provenance, "serial": "16-5", "when": f"2026-0{k + 1}-11"}
        (made / f"arm{k}").mkdir()
        path = made / f"arm{k}/run.jsonl"
        write_run(path, run.header.model_copy(update={"provenance": stated}), run.shots)
        if k < 2:
            zb.analyse(zb.read_run(path), ess=100).report(made / f"arm{k}/report")
    turned = good.joints.copy()
    turned[:, 3] *= -1
    odd = zb.Run.from_arrays(robot="irb1600", tool=tool, joints=turned, unit="rad", noise=noise)
    (made / "odd").mkdir()
    write_run(made / "odd/run.jsonl", odd.header, odd.shots)
    zb.analyse(zb.read_run(made / "odd/run.jsonl"), ess=100).report(made / "odd/report")
    return made


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    with app(folder) as server:
        yield server.address


@pytest.mark.long
def test_it_loads_from_the_server_alone_and_leaves_nobody_out(address: str) -> None:
    for size in SCREENS.values():
        for name in ("arm0", "odd"):
            with result(address, name, size=size) as tab:
                tab.value("document.querySelectorAll('.fold > summary').forEach((e) => e.click())")
                tab.value(f"{box(1)}.click()")
                wait(tab, "document.querySelector('.without')")
                seen = (tab.accessibility(), tab.overflow(), problems(tab))
                assert (name, size, *seen) == (name, size, [], 0, [])
                assert [url for url in tab.asked if not url.startswith((root(address), "blob:"))] == []


def _drag(tab: Tab, touch: bool) -> None:
    """A region in the second panel of the first column, where J2 and J3 are."""
    tab.value("document.querySelector('.pairs').scrollIntoView()")
    left, top, width = tab.value(
        "(({left, top, width}) => [left, top, width])"
        "(document.querySelector('.pairs canvas').getBoundingClientRect())"
    )
    side = (width - 58 - 8 - 6 * 4) / 5
    tall = min(side, 220) * 0.9
    x0, y0 = left + 58 + 0.5 * side, top + 8 + tall + 6 + 0.5 * tall
    points = [(x0 + k * side / 12, y0 - k * tall / 12) for k in range(6)]
    for k, (x, y) in enumerate(points):
        if touch:
            kind = "touchMove" if k else "touchStart"
            tab.call("Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": y}])
        else:
            kind = "mouseMoved" if k else "mousePressed"
            tab.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)
    if touch:
        tab.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    else:
        x, y = points[-1]
        tab.call("Input.dispatchMouseEvent", type="mouseReleased", x=x, y=y, button="left", clickCount=1)


def _choose(tab: Tab, by: str) -> None:
    """Draws are chosen by a region, and none at last."""
    wait(tab, "document.querySelector('.offsets')")
    if tab.value("document.querySelector('.pairs canvas')") is None:
        unfold(tab, "Posterior of the offsets, pair by pair")
        wait(tab, "document.querySelector('.pairs canvas')?.width > 300")
        unfold(tab, "Choose draws by numbers")
    if by == "keyboard":
        tab.value("document.querySelector('.pairs canvas').focus()")
        for _ in range(6):
            tab.key("ArrowRight")
    else:
        _drag(tab, by == "touch")
    wait(tab, f"{CHANGES}.some((text) => text !== '' && Number(text.replace('−', '-')) !== 0)")
    assert "draws are chosen" in tab.value(CHOSEN)
    fields = "[...document.querySelectorAll('.ranges input')]"
    assert tab.value(f"{fields}.filter((e) => e.value).length") == 4  # from and to, of two offsets
    if by == "keyboard":
        tab.key("Escape")
    else:
        tab.value(f"{button('Choose no draws')}.click()")
    wait(tab, f"{CHOSEN} === ''")
    assert tab.value(CHANGES) == []


def draws_are_chosen_and_the_residuals_follow(quick: str) -> None:
    """By mouse, by keyboard and by touch."""
    with result(quick, "good") as tab:
        _choose(tab, "mouse")
        # A measurement alone shows its shift as an arrow.
        before = tab.value(DRAWN)
        shift = "document.querySelector('.measurements [data-shot=\"0\"] button')"
        tab.value(f"{shift}.click()")
        wait(tab, "document.body.innerText.includes('Arrow: the estimates without measurement 0')")
        wait(tab, f"{DRAWN} !== {before!r}")
        assert tab.value("document.querySelector('.refit')") is None
        tab.value(f"{shift}.click()")
        wait(tab, f"{DRAWN} === {before!r}")
        _choose(tab, "keyboard")
    with result(quick, "good", size=PHONE) as tab:
        _choose(tab, "touch")


def not_determined_or_no_result(quick: str) -> None:
    with result(quick, "x-pattern") as tab:
        assert "degenerate" in tab.value(WORD)
        assert tab.value(cell("delta2", ".u")) == "not determined"
        assert tab.value(f"{FIRST}[1].cells[1].textContent.trim()") == "not determined by these data"
        assert "enter" not in tab.value("document.querySelector('.front table').tHead.textContent")
        unfold(tab, "Posterior of the offsets, pair by pair")
        wait(tab, "document.body.innerText.includes('J2 (δ2): prior only')")
        unfold(tab, "Choose draws by numbers")
        give(tab, "document.querySelector('.ranges input')", "9")
        wait(tab, f"{CHOSEN}.includes('say nothing of the residuals')")
        assert tab.value(CHANGES) == []
        # What is no result is one clear error.
        tab.value("location.hash = '#/job/x-pattern/result/x-pattern/report/report.html'")
        wait(tab, "document.querySelector('.fault')?.textContent.includes('not a whole result')")
        assert tab.value("document.querySelector('.offsets')") is None


@pytest.mark.long
def test_a_result_is_looked_at_without_measurements_by_draws_and_where_nothing_is_determined(
    quick: str, reported: Path
) -> None:
    looked_at_without_a_measurement_and_taken_away(quick, reported)
    draws_are_chosen_and_the_residuals_follow(quick)
    not_determined_or_no_result(quick)


def a_report_is_cancelled_and_an_analysis_needs_none(tab: Tab, folder: Path) -> None:
    tab.value("location.hash = '#/job/arm3/result/arm3/run.jsonl'")
    wait(tab, button("Make the report"))
    tab.value(f"{button('Make the report')}.click()")
    wait(tab, button("Cancel"))
    tab.value(f"{button('Cancel')}.click()")
    wait(tab, "document.querySelector('.bare').textContent.includes('Cancelled')")
    tab.value(f"{button('Only analyse')}.click()")
    wait(tab, "document.querySelector('.offsets')", 60)
    assert "has no report yet" in tab.text
    assert [path.name for path in (folder / "arm3").iterdir()] == ["run.jsonl"]


def a_misfit_comes_first_and_offers_nothing(tab: Tab, folder: Path) -> None:
    tab.value("location.hash = '#/job/odd/result'")
    wait(tab, f"document.querySelector('.offsets') && {WORD}.toLowerCase().startsWith('misfit')")
    assert tab.value("document.querySelector('.front table')") is None
    assert "TCP error: not claimed" in tab.text
    assert "Enter nothing." in tab.text
    assert tab.value(cell("delta2", ".status")) == "▲ unvalidated"
    unfold(tab, "Export to a controller")
    wait(tab, button("Export as moc"))
    tab.value(f"{button('Export as moc')}.click()")
    wait(tab, "document.querySelector('.exports .job')?.textContent.includes('--unvalidated')", 60)
    # However small u is, it reaches no tolerance.
    tab.value("location.hash = '#/job/odd/measure/odd/run.jsonl'")
    wait(tab, "document.querySelector('.known')?.textContent.includes('not claimed')")
    assert "reached" not in tab.value("document.querySelector('.known').textContent")
    assert {path.name for path in (folder / "odd").iterdir()} == {"run.jsonl", "report"}


def reported_after_a_reload_exported_and_compared(tab: Tab, folder: Path) -> None:
    make, run = button("Make the report"), "arm2/run.jsonl"
    tab.value("location.hash = '#/job/arm2/result'")
    wait(tab, make)
    tab.value(f"{make}.click()")
    wait(tab, "document.querySelector('.bare progress')")
    tab.reload()
    wait(tab, "document.querySelector('.offsets')", 120)
    assert tab.value("location.hash") == "#/job/arm2/result/arm2/run-report/result.json"
    assert (folder / "arm2/run-report/report.html").is_file()
    unfold(tab, "Export to a controller")
    shown = "[...document.querySelectorAll('.exports [name=format]')].map((one) => one.value)"
    wait(tab, button("Export as moc"))
    assert tab.value(shown) == ["moc", "rapid"]  # those of the arm's maker; the others are folded
    unfold(tab, "Other formats")
    wait(tab, f"{shown}.length > 2")
    others = {"robot", "urdf", "ur", "ur-calibration", "kuka", "fanuc", "json", "csv"}
    assert others <= {*tab.value(shown)}
    tab.value("document.querySelector('.exports [value=csv]').click()")
    wait(tab, button("Export as csv"))
    tab.value(f"{button('Export as csv')}.click()")
    wait(tab, "document.querySelector('.exports a')", 60)
    assert (folder / "arm2/run-csv.csv").is_file()
    unfold(tab, "Compare runs or results")
    boxes = "[...document.querySelectorAll('.choice-of input')]"
    wait(tab, f"{boxes}.some((e) => e.closest('label').dataset.file === {run!r})")
    tab.value(f"{boxes}.slice(0, 2).forEach((e) => e.click())")
    wait(tab, f"{button('Compare')}.disabled === false")
    tab.value(f"{button('Compare')}.click()")
    wait(tab, "document.querySelector('form iframe.report')", 120)
    assert (folder / "arm2/comparison/compare.html").is_file()
    tab.on(lambda page: page.frame_locator("iframe.report").get_by_text("Mean and scatter").first.wait_for())


@pytest.mark.long
def test_a_run_gets_its_report_is_exported_and_compared_and_a_misfit_offers_nothing(
    address: str, folder: Path
) -> None:
    with chromium().opened(address) as tab:
        a_report_is_cancelled_and_an_analysis_needs_none(tab, folder)
        a_misfit_comes_first_and_offers_nothing(tab, folder)
        reported_after_a_reload_exported_and_compared(tab, folder)


@pytest.mark.long
def test_a_mistyped_joint_is_left_out_saved_reported_and_exported_by_the_page(tmp_path: Path) -> None:
    there = tmp_path / "cells/arm"
    there.mkdir(parents=True)
    run = zb.read_run(next(run.path for run in demo_runs() if run.name == "good"))
    typed = [*run.shots[3].joints_deg]
    typed[2] += 2.0
    shots = [*run.shots[:3], run.shots[3].model_copy(update={"joints_deg": tuple(typed)}), *run.shots[4:]]
    write_run(there / "run.jsonl", run.header, shots)
    found = zb.analyse(zb.read_run(there / "run.jsonl"), ess=100)
    assert found.verdict == "misfit"
    (there / "report").mkdir()
    (there / "report/result.json").write_text(dumps(to_json(found.result)))
    (there / "report/report.html").touch()
    with app(there.parent) as server, result(server.address, "arm", "arm/report/result.json") as tab:
        tab.value(f"{button('Leave out measurement 3')}.click()")
        wait(tab, button("Save as a run without it"), 60)
        assert tab.value(f"{box(3)}.checked")
        assert "Fitted again without measurement 3: 6 of 7 are left." in tab.text
        tab.value(f"{button('Save as a run without it')}.click()")
        wait(tab, button("Make the report"))
        assert "arm/run-without-3.jsonl has no report yet" in tab.text
        tab.value(f"{button('Make the report')}.click()")
        wait(tab, f"document.querySelector('.front') && {WORD}.startsWith('Simulated: weakly')", 180)
        unfold(tab, "Export to a controller")
        assert problems(tab) == []
    made = json.loads((there / "run-without-3-report/result.json").read_text())
    assert made["inputs"]["header"]["provenance"]["without measurements"] == "3"


@pytest.mark.long
def test_the_history_shows_each_joint_over_time_and_makes_the_pages(folder: Path, tmp_path: Path) -> None:
    there = tmp_path / "dir"
    shutil.copytree(folder, there)
    with app(there) as server, result(server.address, "arm0") as tab:
        unfold(tab, "History of this arm, and drift")
        wait(tab, "document.querySelectorAll('.trend canvas').length >= 4")
        said = tab.value("document.querySelector('.trend [role=img]').getAttribute('aria-label')")
        assert "2026-01-11: " in said
        assert "±" in said
        rows = tab.value("[...document.querySelectorAll('.history tbody th')].map((e) => e.textContent)")
        assert rows == [f"arm{k}/run.jsonl" for k in range(4)]
        assert "of 1 arm" in tab.text
        wait(tab, button("Make the pages"))
        tab.value(f"{button('Make the pages')}.click()")
        opened = "document.querySelector('.drift .job a')"
        wait(tab, opened, 120)
        assert tab.value(f"{opened}.href") == f"{root(server.address)}report/history-16-5/arm.html"
        answer = json.loads((there / "history-16-5/arm.json").read_text())
        assert len(answer["results"]) == len(list(there.glob("arm?/*/result.json"))) >= 2


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
def test_a_notebook_of_this_machine_frames_its_own_app_alone(quick: str, reported: Path) -> None:
    for ours in (True, False):

        def write(folder: Path) -> str:
            shutil.copytree(reported, folder, dirs_exist_ok=True)
            return "good/result.json"

        view = app_of(_Thing(), "result", write) if ours else AppView(f"{quick}#/job/good/result")
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
                        wait(tab.frame(root(view.address)), "document.querySelector('.offsets')")
            finally:
                server.shutdown()
