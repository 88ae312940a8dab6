"""The place Import as a person uses it: files dropped or chosen, columns and signs, a header, a run."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from app_page import SCREENS, app, give, root, touch, wait
from chromium import LAPTOP, PHONE, Size, Tab, chromium
from command_line import zerobeam
from recorded_logs import HEADER, POSTURES, fanuc_listing, fanuc_position, moves, table
from recordings import PANDA_1, header_text
from ros_bags import Bag, file_of

from zerobeam.experiments.demos import demo_runs
from zerobeam.model.files.header import write_header
from zerobeam.model.files.run import read_run

pytestmark = pytest.mark.browser

NAMES = [f"a{i}" for i in range(1, 7)]
SHOTS = table(["t", *NAMES], [[i, *row] for i, row in enumerate(POSTURES.tolist())], ",")
FAULT = "document.getElementById('import-fault').textContent"
COMMAND = "document.getElementById('import-command').textContent"
MAPPED = "document.querySelectorAll('#import-mapper tbody svg').length"
PROPOSED = "document.querySelector('#import-proposals .proposed button')"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "dir"
    made.mkdir()
    (made / "header.yaml").write_text(HEADER)
    return made


@contextmanager
def place(folder: Path, size: Size = LAPTOP) -> Iterator[Tab]:
    browser = chromium()
    with app(folder) as server, browser.opened(f"{server.address}#import", size) as tab:
        wait(tab, "!document.getElementById('import').hidden")
        yield tab


def by(name: str) -> str:
    return f"document.getElementById('import-{name}')"


def drop(tab: Tab, *files: tuple[str, str]) -> None:
    tab.value(
        f"(() => {{ const d = new DataTransfer(); for (const [name, text] of {json.dumps(files)})"
        " d.items.add(new File([text], name));"
        f" {by('drop')}.dispatchEvent(new DragEvent('drop', {{bubbles: true, cancelable: true,"
        " dataTransfer: d})); })()"
    )


def choose(tab: Tab, *files: Path) -> None:
    """What the dialog for files gives."""
    tab.choose(by("choose"), files)


def said(tab: Tab, count: int = 1) -> None:
    wait(tab, f"document.querySelectorAll('#import-files li:not([aria-busy]) small').length === {count}")


def header(tab: Tab, name: str = "header.yaml") -> None:
    give(tab, by("header"), name)
    wait(tab, f"!{by('read')}.hidden || document.querySelector('#import-header-said .error')")


def take_all(tab: Tab) -> None:
    """All proposals of the columns and the unit, one by one."""
    wait(tab, PROPOSED)
    for _ in range(3):
        if not tab.value(f"Boolean({PROPOSED})"):
            break
        before = tab.value(by("proposals") + ".textContent")
        tab.value(f"{PROPOSED}.click()")
        wait(tab, f"{by('proposals')}.textContent !== {before!r}")
    wait(tab, f"{MAPPED} > 0")


def carry_out(tab: Tab, button: str) -> str:
    """What is said after a command: an error, or nothing."""
    tab.value(f"{by(button)}.click()")
    busy = f"{by('go')}.disabled"
    wait(tab, f"!{busy} && ({FAULT} || !{by('answer')}.hidden)", 120)
    return str(tab.value(FAULT))


def test_a_dropped_table_is_mapped_as_the_person_takes_it(folder: Path) -> None:
    with place(folder) as tab:
        drop(tab, ("shots.csv", SHOTS))
        said(tab)
        assert "4 rows of 7 columns" in tab.value(by("files") + ".textContent")
        header(tab)
        wait(tab, PROPOSED)
        assert tab.value(MAPPED) == 0
        assert "state the column" in tab.value(COMMAND)
        take_all(tab)
        assert tab.value(MAPPED) == 6
        told = tab.value(COMMAND)
        assert told == (
            "zerobeam import csv --header-row --units=deg --columns=a1,a2,a3,a4,a5,a6"
            " --header=header.yaml --target=socket --out=run.jsonl shots.csv"
        )
        column = "document.querySelector('[data-joint=\"1\"] select')"
        give(tab, column, "t")
        wait(tab, "document.querySelector('[data-joint=\"1\"]').innerText.includes('0.00 to 3.00')")
        sign = "document.querySelector('[data-joint=\"0\"] input')"
        tab.value(f"{sign}.click()")
        wait(tab, "document.querySelector('[data-joint=\"0\"]').innerText.includes('−40.00 to 12.00')")
        assert "--reversed=j1" in tab.value(COMMAND)
        assert tab.console == []
    assert (folder / "shots.csv").read_text() == SHOTS


@pytest.mark.long
@pytest.mark.parametrize("size", SCREENS)
def test_the_place_loads_from_the_server_alone_and_leaves_nobody_out(folder: Path, size: str) -> None:
    with place(folder, SCREENS[size]) as tab:
        for state in ("empty", "mapped", "dwells", "form", "imported"):
            if state == "mapped":
                drop(tab, ("shots.csv", SHOTS))
                said(tab)
                header(tab)
                take_all(tab)
            elif state == "dwells":
                give(tab, "document.querySelector('[data-option=measured] select')", "dwells")
            elif state == "form":
                give(tab, by("header"), "\0new")
                wait(tab, "document.querySelectorAll('#import-header-fields input').length > 5")
                tab.value("document.querySelectorAll('#import details').forEach((d) => { d.open = true; })")
                tab.value("document.querySelectorAll('#import details > button').forEach((b) => b.click())")
            elif state == "imported":
                give(tab, "document.querySelector('[data-option=measured] select')", "rows")
                header(tab)
                assert carry_out(tab, "go") == ""
            assert tab.accessibility() == [], state
            assert tab.overflow() == 0, state
            buttons = "#import button, #import select, #import label.check"
            small = tab.value(
                f"[...document.querySelectorAll('{buttons}')].filter("
                "(e) => e.offsetParent && e.getBoundingClientRect().height < 39).map((e) => e.outerHTML)"
            )
            assert small == [], state
        assert tab.console == []
        assert [url for url in tab.asked if not url.startswith(root(tab.address))] == []


@pytest.mark.long
def test_a_run_is_tried_and_imported_by_touch(folder: Path) -> None:
    with place(folder, PHONE) as tab:
        drop(tab, ("shots.csv", SHOTS))
        said(tab)
        header(tab)
        wait(tab, PROPOSED)
        for _ in range(2):
            before = tab.value(by("proposals") + ".textContent")
            touch(tab, PROPOSED)
            wait(tab, f"{by('proposals')}.textContent !== {before!r}")
        wait(tab, f"{MAPPED} === 6")
        touch(tab, by("try"))
        wait(tab, f"!{by('answer')}.hidden")
        assert "Tried: nothing was written." in tab.text
        assert not (folder / "run.jsonl").exists()
        wait(tab, f"!{by('go')}.disabled")
        touch(tab, by("go"))
        wait(tab, "document.querySelector('#import-done a')")
        assert tab.value("document.querySelector('#import-done a').hash") == "#result/run.jsonl"
        assert tab.value(by("out") + ".value") == "run-2.jsonl"
        assert "joint 1 (joint1): -12.00 to 40.00 deg" in tab.text
    np.testing.assert_allclose(np.degrees(read_run(folder / "run.jsonl").joints), POSTURES, atol=1e-9)


@pytest.mark.long
def test_the_place_is_used_by_the_keyboard_alone(folder: Path) -> None:
    """Tab leads to every control in its order; letters choose in a list, Enter presses a button."""
    (folder / "shots.csv").write_text(SHOTS)

    def press(key: str, code: int, text: str = "") -> None:
        own = {"text": text} if text else {}
        for kind in ("keyDown", "keyUp"):
            tab.call("Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=code, **own)

    def to(element: str) -> None:
        for _ in range(80):
            if tab.value(f"document.activeElement === {element}"):
                return
            press("Tab", 9)
        raise AssertionError(f"Tab does not lead to {element}")

    with place(folder) as tab:
        to(by("folder"))
        press("s", 83, "s")
        said(tab)
        to(by("header"))
        press("h", 72, "h")
        wait(tab, PROPOSED)
        for _ in range(2):
            before = tab.value(by("proposals") + ".textContent")
            tab.value("document.activeElement.blur()")
            to(PROPOSED)
            press("Enter", 13, "\r")
            wait(tab, f"{by('proposals')}.textContent !== {before!r}")
        wait(tab, f"{MAPPED} === 6")
        to(by("go"))
        press("Enter", 13, "\r")
        wait(tab, "document.querySelector('#import-done a')")
    assert (folder / "run.jsonl").exists()


@pytest.mark.long
def test_a_name_that_is_taken_gets_another_and_nothing_is_replaced(folder: Path) -> None:
    (folder / "shots.csv").write_text("1,2\n")
    with place(folder) as tab:
        drop(tab, ("shots.csv", SHOTS))
        wait(tab, "document.querySelector('#import-files .actions input')")
        assert "nothing is replaced" in tab.text
        assert tab.value("document.querySelector('#import-files .actions input').value") == "shots-2.csv"
        tab.value("document.querySelector('#import-files .actions button').click()")
        said(tab)
    assert (folder / "shots.csv").read_text() == "1,2\n"
    assert (folder / "shots-2.csv").read_text() == SHOTS


@pytest.mark.long
def test_what_cannot_be_imported_has_one_error_at_its_file(folder: Path, tmp_path: Path) -> None:
    """One that the server refuses and one that is not sent; what else is refused is the readers'."""
    (tmp_path / "prose.csv").write_text("Dear all,\nplease find\n")
    with (tmp_path / "large.csv").open("wb") as file:
        file.truncate(65 * 10**6)
    expected = {"prose.csv": "no column of numbers", "large.csv": "too large to be sent"}
    with place(folder) as tab:
        choose(tab, *(tmp_path / name for name in expected))
        wait(tab, "document.querySelectorAll('#import-files .error').length === 2")
        for name, said_of_it in expected.items():
            row = f"document.querySelector('#import-files [data-file=\"{name}\"]')"
            assert tab.value(f"{row}.querySelectorAll('.error').length") == 1
            assert said_of_it in tab.value(f"{row}.textContent"), name
        assert tab.value(by("rest") + ".hidden")
    assert not (folder / "large.csv").exists()


@pytest.mark.long
def test_nan_in_a_column_is_said_at_the_column(folder: Path) -> None:
    with place(folder) as tab:
        drop(tab, ("shots.csv", SHOTS.replace("31.0", "nan", 1)))
        said(tab)
        header(tab)
        wait(tab, "document.querySelector('#import-mapper tbody tr')")
        nan = "document.querySelector('[data-joint=\"1\"] option[value=a2]')"
        assert tab.value(f"{nan}.disabled")
        assert tab.value(f"{nan}.textContent") == "a2 (no number in line 3)"
        assert tab.value(f"Boolean({PROPOSED})") is False


@pytest.mark.long
def test_a_bag_is_imported_where_the_arm_dwells(folder: Path, tmp_path: Path) -> None:
    bag = Bag("mcap").states(*moves()).marker(1.0, "left").marker(2.6, "right").write(tmp_path)
    with place(folder) as tab:
        choose(tab, file_of(bag))
        said(tab)
        assert "349 joint states on /joint_states" in tab.text
        header(tab)
        assert carry_out(tab, "try").startswith("Not complete: state what a dwell is")
        for key, value in (("still-deg", "0.02"), ("still-s", "0.5")):
            give(tab, f"document.querySelector('[data-option=\"--{key}\"] input')", value)
        assert carry_out(tab, "try") == ""
        assert "4 measurements of target 'socket'" in tab.text
        give(tab, "document.querySelector('[data-option=\"--marker-topic\"] select')", "/shot")
        assert "Changed since then" in tab.text
        assert carry_out(tab, "go") == ""
    run = read_run(folder / "run.jsonl")
    assert [shot.target for shot in run.shots] == ["left", "right"]
    np.testing.assert_allclose(np.degrees(run.joints), POSTURES[:2], atol=1e-6)


@pytest.mark.long
def test_points_of_a_controller_are_chosen(folder: Path) -> None:
    listing = fanuc_listing("".join(map(fanuc_position, range(1, 5), POSTURES)))
    with place(folder) as tab:
        drop(tab, ("shots.ls", listing))
        said(tab)
        header(tab)
        tab.value("document.querySelector('.points input').click()")
        # The robot file says what joint 3 is counted from; who knows better may choose.
        give(tab, "document.querySelector('[data-option=\"--j3\"] select')", "link")
        assert carry_out(tab, "go") == ""
    np.testing.assert_allclose(np.degrees(read_run(folder / "run.jsonl").joints), POSTURES[1:], atol=1e-9)


@pytest.mark.long
def test_a_fit_proposes_what_the_limits_cannot_and_the_person_takes_it(folder: Path) -> None:
    """Columns 4 and 6 of the good demo run are exchanged: no limit excludes it, the fit does."""
    good = read_run(next(run.path for run in demo_runs() if run.name == "good"))
    own = good.header.model_copy(update={"robot": "irb1600", "schema_": None})
    write_header(folder / "good.yaml", own)
    rows = np.hstack([np.degrees(good.joints)[:, [0, 1, 2, 5, 4, 3]], good.spots])
    with place(folder) as tab:
        drop(tab, ("shots.csv", table([*NAMES, "dx", "dy"], rows.tolist(), ",")))
        said(tab)
        header(tab, "good.yaml")
        give(tab, "document.querySelector('[data-option=\"--spot-columns\"] input')", "dx,dy")
        take_all(tab)
        assert carry_out(tab, "go") == ""
        tab.value(f"{by('test')}.click()")
        wait(tab, "document.querySelector('#import-diagnosis li')", 120)
        assert "J4 and J6 exchanged" in tab.value(by("diagnosis") + ".textContent")
        assert "--columns=a1,a2,a3,a4,a5,a6" in tab.value(COMMAND)
        tab.value("document.querySelector('#import-diagnosis button').click()")
        wait(tab, f"{COMMAND}.includes('--columns=a1,a2,a3,a6,a5,a4')")
        assert carry_out(tab, "go") == ""
        tab.value(f"{by('test')}.click()")
        wait(tab, "document.querySelector('#import-diagnosis li')", 120)
        assert "Nothing contradicts" in tab.value(by("diagnosis") + ".textContent")
        assert "no finding is no proof" in tab.text
    np.testing.assert_allclose(read_run(folder / "run-2.jsonl").joints, good.joints, atol=1e-9)


@pytest.mark.long
def test_recordings_of_a_real_arm_with_a_header_from_the_form(
    folder: Path, tmp_path: Path, shared_data: Path
) -> None:
    """The run is the same as that of the command line with a header that was written by hand."""
    source = shared_data / "mukca" / PANDA_1.name / "front"
    shutil.copy(shared_data / "mukca" / "urdf" / PANDA_1.urdf, folder)
    key = "document.querySelector('[data-header-key=\"{}\"] {}')".format
    with place(folder) as tab:
        choose(tab, source / "hole_0.csv", source / "hole_1.csv")
        said(tab, 2)
        give(tab, by("header"), "\0new")
        wait(tab, "document.querySelectorAll('#import-header-fields input').length > 5")
        tab.value(f"{by('header-save')}.click()")
        empty = "[...document.querySelectorAll('#import-header-fields .error')].length"
        assert tab.value(empty) == 5  # robot, kind, point, joint_deg, spot_mm
        tab.value(key("robot", "input[type=checkbox]") + ".click()")
        stated = {
            "robot/urdf": PANDA_1.urdf,
            "robot/base": PANDA_1.base,
            "robot/tip": "no_such_link",
            "tool/point_mm": "0, 0, 32",
            "noise/joint_deg": "0.01",
            "noise/spot_mm": "-0.5",
        }
        for name, value in stated.items():
            give(tab, key(name, "input"), value)
        give(tab, key("tool/kind", "select"), "probe")
        give(tab, key("tool/calibrated", "select"), "false")
        add = "[...document.querySelectorAll('[data-header-key=distances] button')].at(-1)"
        tab.value(f"{add}.click()")
        for name, value in (("between", "front_0, front_1"), ("mm", "50"), ("sigma_mm", "0.1")):
            give(tab, key(f"distances/0/{name}", "input"), value)
        for name, right in (("noise/spot_mm", "0.5"), ("robot", None)):
            tab.value(f"{by('header-save')}.click()")
            wait(tab, f"document.querySelector('[data-header-key=\"{name}\"] > .error')")
            give(tab, key(name if right else "robot/tip", "input"), right or PANDA_1.tip)
        give(tab, by("header-file"), "panda.yaml")
        tab.value(f"{by('header-save')}.click()")
        wait(tab, f"{by('header')}.value === 'panda.yaml' && !{by('read')}.hidden")
        take_all(tab)
        assert carry_out(tab, "go").startswith("Not complete: state the target of each file")
        for hole in (0, 1):
            field = f"document.querySelector('#import-targets [data-file=\"hole_{hole}.csv\"]')"
            give(tab, field, f"front_{hole}")
        assert "--units=rad" in tab.value(COMMAND)
        assert carry_out(tab, "go") == ""
    by_hand = folder / "by_hand.yaml"
    text = header_text(shared_data, PANDA_1, ["front"])
    by_hand.write_text(text.replace(str((shared_data / "mukca" / "urdf").resolve()) + "/", ""))
    files = [folder / f"hole_{hole}.csv" for hole in (0, 1)]
    names = ["--target", "front_0", "--target", "front_1"]
    same_run = folder / "same.jsonl"
    zerobeam("import", "csv", *files, *names, "--units", "rad", "--header", by_hand, "-o", same_run)
    ours, same = ((folder / name).read_text().splitlines() for name in ("run.jsonl", "same.jsonl"))
    assert ours[1:] == same[1:]
    assert read_run(folder / "run.jsonl").header.distances == read_run(folder / "same.jsonl").header.distances
