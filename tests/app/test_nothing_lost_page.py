"""What was done in the page survives what happens to the files; nothing wrong is shown or written."""

import math
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from app_page import app, fill, press, root, wait
from cells import LASER, good_plan, header, plan_of, varied_postures
from chromium import LAPTOP, Tab, chromium
from command_line import plan_file

import zerobeam as zb
from zerobeam.model.files.plan import Plan, read_plan
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import write_run
from zerobeam.model.records import dumps
from zerobeam.words.sentences import to_json

pytestmark = pytest.mark.browser

CHECKED = "document.querySelector('.determined table') && !document.querySelector('.pending')"
SAVED = "document.querySelector('.plan-bar output').textContent === 'Saved.'"
MANY = 100


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    chromium()
    made = tmp_path_factory.mktemp("kept") / "dir"
    (made / "cell").mkdir(parents=True)
    plan_file(made / "cell" / "kept.yaml", good_plan(7))  # a calibration is there while it has a plan
    return made


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    with app(folder) as opened:
        yield opened.address


def seven_joints(count: int = 6) -> Plan:
    """A plan of an arm that has another number of joints than the other plans here."""
    arm, at = load_robot("panda"), (450.0, 100.0, 200.0)
    stated = header(LASER, target=at, robot="panda")
    return plan_of(stated, varied_postures(stated, arm, at, count, 4), robot=arm)


@contextmanager
def plan(address: str, name: str, beside: Tab | None = None) -> Iterator[Tab]:
    with chromium().opened(f"{address}#/job/cell/plan/cell/{name}", LAPTOP, beside=beside) as tab:
        yield tab


def content(path: Path) -> Any:
    return yaml.safe_load(path.read_text())


def test_an_edit_is_kept_until_it_can_be_saved_and_a_tab_of_a_server_that_ended_says_so(folder: Path) -> None:
    """The file is read-only, then a folder stands in its place; then the server is started anew."""
    path = folder / "cell" / "locked.yaml"
    plan_file(path, good_plan(7))
    path.chmod(0o444)
    before = path.read_bytes()
    with app(folder) as first, plan(first.address, path.name) as tab:
        wait(tab, CHECKED)
        fill(tab, "J1, °", "10")
        wait(tab, f"{CHECKED} && !({SAVED})")
        press(tab, "Save")
        wait(tab, "document.body.innerText.includes('the file is read-only')")
        assert path.read_bytes() == before
        tab.reload()
        wait(tab, f"{CHECKED} && document.body.innerText.includes('were not saved are back')")
        path.chmod(0o644)
        press(tab, "Save")
        wait(tab, SAVED)
        assert content(path)["postures_deg"][0][0] == 10
        fill(tab, "J1, °", "20")
        wait(tab, f"{CHECKED} && !({SAVED})")
        path.unlink()
        path.mkdir()
        wait(tab, "document.querySelector('dialog[open]')")
        press(tab, "Write the file again")
        wait(tab, "document.querySelector('.plan-bar ~ .error')")
        path.rmdir()
        press(tab, "Save")
        wait(tab, SAVED)
        assert content(path)["postures_deg"][0][0] == 20
        port = int(root(first.address).rstrip("/").rpartition(":")[2])
        first.process.terminate()
        first.process.communicate(timeout=30)
        with app(folder, port) as second:
            fault = "document.querySelector('.fault')?.textContent ?? ''"
            wait(tab, f"({fault}).includes('the server was started anew')", 60)
            assert "open the address that the terminal shows" in tab.value(fault)
            tab.on(lambda page: page.goto(root(second.address)))
            wait(tab, "document.body.textContent.includes('Open the address that the terminal shows')")
            tab.on(lambda page: page.goto(second.address))
            wait(tab, "document.querySelector('main')")


@pytest.mark.long
def test_a_draft_of_another_arms_plan_is_shown_beside_the_file_until_one_is_chosen(
    folder: Path, address: str
) -> None:
    """The plan was replaced by one for another robot while nobody looked: neither is mixed with the other."""
    path = folder / "cell" / "other.yaml"
    plan_file(path, good_plan(7))
    with chromium().opened(address, LAPTOP) as home:
        with plan(address, path.name, beside=home) as tab:
            wait(tab, CHECKED)
            fill(tab, "J1, °", "10")
            wait(tab, f"{CHECKED} && !({SAVED})")
        path.unlink()
        plan_file(path, seven_joints())
        theirs = path.read_bytes()
        with plan(address, path.name, beside=home) as tab:
            dialog = "document.querySelector('dialog[open]')"
            for _ in range(2):  # a reload takes nothing for answered
                wait(tab, f"{dialog} && {CHECKED}")
                assert "of another robot than yours" in tab.value(f"{dialog}.textContent")
                assert tab.value("document.querySelectorAll('.joint').length") == 6
                tab.reload()
            wait(tab, f"{dialog} && {CHECKED}")
            tab.key("Escape")
            press(tab, "Save")
            wait(tab, dialog)
            assert path.read_bytes() == theirs
            press(tab, "Save mine as cell/other-mine.yaml")
            wait(tab, f"!{dialog} && {SAVED}")
            assert path.read_bytes() == theirs
            assert content(path.with_name("other-mine.yaml"))["postures_deg"][0][0] == 10
            wait(tab, "location.hash.endsWith('/cell/other-mine.yaml')")
            tab.value("location.hash = '#/job/cell/plan/cell/other.yaml'")
            wait(tab, f"document.querySelectorAll('.joint').length === 7 && {CHECKED}")
            assert tab.value(SAVED)
            assert [text for text in tab.console if "WebGL" not in text and "412" not in text] == []
    # Before the page has noticed the change by itself; then it is the plan of another arm.
    path = folder / "cell" / "late.yaml"
    plan_file(path, good_plan(7))
    with plan(address, path.name) as tab:
        wait(tab, CHECKED)
        fill(tab, "J1, °", "10")
        wait(tab, f"{CHECKED} && !({SAVED})")
        path.write_text(path.read_text() + "# changed elsewhere\n")
        tab.value("import('/page/core/editing.js').then((m) => m.save())")
        wait(tab, "document.querySelector('dialog[open]')")
        press(tab, "Take the file's")
        wait(tab, f"{CHECKED} && {SAVED}")
        assert "postures_deg" in tab.value("import('/page/core/editing.js').then((m) => m.plan.value)")
        fill(tab, "J1, °", "10")
        wait(tab, f"{CHECKED} && !({SAVED})")
        plan_file(folder / "other.yaml", seven_joints()).replace(path)
        wait(tab, "document.querySelector('dialog[open]')")
        press(tab, "Take the file's")
        wait(tab, f"document.querySelectorAll('.joint').length === 7 && {CHECKED} && {SAVED}")
        press(tab, "Undo")
        wait(tab, f"document.querySelectorAll('.joint').length === 6 && {CHECKED}")
        assert tab.on(lambda page: page.get_by_label("J1, °", exact=True).first.input_value()) == "10"


@pytest.mark.long
def test_the_draft_of_a_calibration_that_is_gone_is_shown_downloaded_saved_or_discarded(
    tmp_path: Path,
) -> None:
    """Its only plan is deleted with its folder: the browser alone has what was done."""
    made, kept = tmp_path / "dir", "plan.yaml"
    path = made / "cell" / kept
    dialog, drafts = "document.querySelector('dialog[open]')", "document.querySelector('.drafts a')"
    made.mkdir()
    with app(made) as opened, chromium().opened(opened.address, LAPTOP) as home:
        for given_up in (False, True):
            path.parent.mkdir(exist_ok=True)
            path.unlink(missing_ok=True)
            plan_file(path, good_plan(7))
            with plan(opened.address, kept, beside=home) as tab:
                wait(tab, CHECKED)
                fill(tab, "J1, °", "10")
                wait(tab, f"{CHECKED} && !({SAVED})")
            shutil.rmtree(path.parent)
            with chromium().opened(f"{opened.address}#/job/cell/result", LAPTOP, beside=home) as tab:
                wait(tab, f"document.body.innerText.includes('no calibration of this name') && {drafts}")
                tab.value("location.hash = '#/'")
                wait(tab, f"{drafts} && document.querySelector('.begin')")
                tab.value(f"{drafts}.click()")
                wait(tab, f"{dialog} && {CHECKED}")
                taken = tab.on(lambda frame: downloaded(frame, tmp_path / "taken.yaml"))
                assert read_plan(taken).postures[0][0] == pytest.approx(math.radians(10))
                if given_up:
                    tab.key("Escape")
                    press(tab, "Discard them")
                    wait(tab, f"location.hash === '#/' && document.querySelector('.begin') && !{drafts}")
                else:
                    press(tab, "Write the file again")
                    wait(tab, SAVED)
                    assert content(path)["postures_deg"][0][0] == 10
        assert not path.exists()


def downloaded(frame: Any, to: Path) -> Path:
    with frame.page.expect_download() as download:
        frame.get_by_role("dialog").get_by_role("link", name="Download the plan").click()
    assert download.value.suggested_filename == "plan.yaml"
    download.value.save_as(to)
    return to


@pytest.mark.long
def test_a_hundred_postures_are_edited_and_of_a_hundred_measurements_one_is_left_out(
    folder: Path, address: str
) -> None:
    plan_file(folder / "cell" / "many.yaml", good_plan(MANY))
    run = zb.simulate(good_plan(MANY), seed=1, offsets={"delta2": 0.3})
    made = folder / "many"
    made.mkdir()
    write_run(made / "run.jsonl", run.header, run.shots)
    found = zb.analyse(zb.read_run(made / "run.jsonl"), ess=100)
    (made / "report").mkdir()
    (made / "report" / "result.json").write_text(dumps(to_json(found.result)))
    with plan(address, "many.yaml") as tab:
        wait(tab, CHECKED, 120)
        wait(tab, f"document.querySelectorAll('.strip li').length === {MANY}")
        last = "document.querySelector('.strip li:last-child button')"
        tab.on(lambda page: page.get_by_role("button", name="Previous posture").click())
        wait(tab, f"document.querySelector('.scene-tools output').textContent === '{MANY} of {MANY}'")
        wait(tab, f"{last}.getAttribute('aria-current') === 'true'")
        box, strip = (
            f"{last}.getBoundingClientRect()",
            "document.querySelector('.strip').getBoundingClientRect()",
        )
        wait(tab, f"{box}.right <= {strip}.right")  # what is chosen is in sight
        fill(tab, "J2, °", "0,5")
        wait(
            tab, f"{CHECKED} && document.querySelector('.strip li:last-child small').textContent !== ''", 120
        )
        assert tab.overflow() == 0
        press(tab, "Save")
        wait(tab, SAVED)
        tab.value("location.hash = '#/job/many/result'")
        wait(tab, "document.querySelector('.offsets')", 60)
        wait(tab, f"document.querySelectorAll('.measurements tbody tr').length === {MANY}")
        wait(tab, "document.querySelector('.scene-tools output')?.textContent === '1 of 60'")
        last = f"document.querySelector('.measurements [data-shot=\"{MANY - 1}\"] input')"
        tab.value(f"{last}.scrollIntoView()")
        tab.value(f"{last}.click()")
        wait(tab, "document.querySelector('.without')?.textContent.includes('99')", 120)
        assert (tab.overflow(), [text for text in tab.console if "WebGL" not in text]) == (0, [])
