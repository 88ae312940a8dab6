"""The page Import as a person uses it: files dropped or chosen, columns and signs, a header, a run."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from app_page import SCREENS, app, give, root, touch, wait
from chromium import LAPTOP, PHONE, Size, Tab, chromium
from exact_runs import demo_runs
from recorded_logs import HEADER, POSTURES, fanuc_listing, fanuc_position, moves, table
from ros_bags import Bag, file_of
from ruamel.yaml import YAML

from zerobeam.model.files.header import write_header
from zerobeam.model.files.run import read_run

pytestmark = pytest.mark.browser

NAMES = [f"a{i}" for i in range(1, 7)]
SHOTS = table(["t", *NAMES], [[i, *row] for i, row in enumerate(POSTURES.tolist())], ",")
COMMAND = "(document.querySelector('.command')?.textContent ?? '')"
MAPPED = "document.querySelectorAll('.mapper svg').length"
PROPOSED = "document.querySelector('.proposals .proposed button')"
REFUSAL = "(document.querySelector('.fault')?.textContent ?? '')"
BUSY = "[...document.querySelectorAll('button')].some((b) => b.textContent === 'Import' && b.disabled)"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "dir"
    made.mkdir()
    (made / "header.yaml").write_text(HEADER)
    return made


@contextmanager
def page(folder: Path, size: Size = LAPTOP, file: str = "") -> Iterator[Tab]:
    browser = chromium()
    with app(folder) as server, browser.opened(f"{server.address}#/import/{file}", size) as tab:
        wait(tab, "document.querySelector('.drop')")
        yield tab


def select(label: str) -> str:
    return f"document.querySelector('select[aria-label=\"{label}\"]')"


def option(key: str) -> str:
    return f"document.querySelector('[data-option=\"{key}\"] :is(select, input)')"


def button(text: str) -> str:
    return f"[...document.querySelectorAll('button')].find((b) => b.textContent.trim() === {text!r})"


def press(tab: Tab, text: str) -> None:
    wait(tab, button(text))
    tab.value(f"{button(text)}.click()")


def drop(tab: Tab, *files: tuple[str, str]) -> None:
    tab.value(
        f"(() => {{ const d = new DataTransfer(); for (const [name, text] of {json.dumps(files)})"
        " d.items.add(new File([text], name)); document.querySelector('.drop').dispatchEvent("
        "new DragEvent('drop', {bubbles: true, cancelable: true, dataTransfer: d})); })()"
    )


def read(tab: Tab, count: int = 1) -> None:
    wait(tab, f"document.querySelectorAll('.recordings li[aria-busy=\"false\"] small').length === {count}")


def header(tab: Tab, name: str = "header.yaml") -> None:
    give(tab, select("Header or plan"), name)
    wait(tab, "document.querySelector('.chosen')")


def take_all(tab: Tab, by_touch: bool = False) -> None:
    """All proposals of the columns and the unit, one by one."""
    for _ in range(2):
        wait(tab, PROPOSED)
        before = tab.value("document.querySelector('.proposals').textContent")
        touch(tab, PROPOSED) if by_touch else tab.value(f"{PROPOSED}.click()")
        wait(tab, f"document.querySelector('.proposals').textContent !== {before!r}")
    wait(tab, f"{MAPPED} === 6")


def tried(tab: Tab, text: str = "Try") -> str:
    """What is refused, or nothing."""
    press(tab, text)
    wait(tab, f"!({BUSY}) && ({REFUSAL} || document.querySelector('.outcome'))", 60)
    return str(tab.value(REFUSAL))


def imported(tab: Tab) -> None:
    press(tab, "Import")
    wait(tab, "location.hash.startsWith('#/job/')", 60)


@pytest.mark.long
def test_a_dropped_table_is_mapped_as_the_person_takes_it_and_leads_to_its_result(folder: Path) -> None:
    with page(folder) as tab:
        drop(tab, ("shots.csv", SHOTS))
        read(tab)
        assert "4 rows of 7 columns" in tab.text
        header(tab)
        tab.value("document.querySelector('.import > section:last-child summary').click()")
        wait(tab, f"{COMMAND}.includes('state the column')")
        assert tab.value(MAPPED) == 0
        take_all(tab)
        assert tab.value(COMMAND) == (
            "zerobeam import csv --header-row --units=deg --columns=a1,a2,a3,a4,a5,a6"
            " --header=header.yaml --target=socket --out=shots/run.jsonl shots/shots.csv"
        )
        give(tab, "document.querySelector('[data-joint=\"1\"] select')", "t")
        wait(tab, "document.querySelector('[data-joint=\"1\"]').innerText.includes('0.00 to 3.00')")
        give(tab, "document.querySelector('[data-joint=\"1\"] select')", "a2")
        tab.value("document.querySelector('[data-joint=\"0\"] input').click()")
        wait(tab, "document.querySelector('[data-joint=\"0\"]').innerText.includes('−40.00 to 12.00')")
        assert "--reversed=j1" in tab.value(COMMAND)
        imported(tab)
        assert tab.value("location.hash") == "#/job/shots/result/shots/run.jsonl"
        wait(tab, "document.querySelector('.offsets')")  # the analysis that the import has made
        assert [said for said in tab.console if "WebGL" not in said] == []
    assert (folder / "shots/shots.csv").read_text() == SHOTS
    expected = POSTURES * [-1, 1, 1, 1, 1, 1]
    np.testing.assert_allclose(np.degrees(read_run(folder / "shots/run.jsonl").joints), expected, atol=1e-9)


@pytest.mark.long
def test_a_saved_file_of_a_newer_maker_is_imported_without_a_word_of_it_in_the_page(folder: Path) -> None:
    (folder / "kawasaki.yaml").write_text(HEADER.replace("robot: irb1600", "robot: rs007n"))
    rows = "".join(f"#p{i} {' '.join(map(str, row))}\n" for i, row in enumerate(POSTURES.tolist()))
    with page(folder) as tab:
        drop(tab, ("shots.as", f".JOINTS\n{rows}.END\n"))
        read(tab)
        assert "4 points, 4 with joint values" in tab.text
        header(tab, "kawasaki.yaml")
        wait(tab, "document.querySelector('.points input')")
        assert "Kawasaki: joint displacement values (#name) of a saved file" in tab.text
        tab.value("document.querySelector('.points input').click()")
        tab.value("document.querySelector('.import > section:last-child summary').click()")
        assert tried(tab) == ""
        assert tab.value(COMMAND) == (
            "zerobeam import as '--points=#p1,#p2,#p3' --header=kawasaki.yaml"
            " --target=socket --out=shots/run.jsonl shots/shots.as"
        )
        imported(tab)
    joints = np.degrees(read_run(folder / "shots/run.jsonl").joints)
    np.testing.assert_allclose(joints, POSTURES[1:], atol=1e-9)


@pytest.mark.long
def test_the_page_loads_from_the_server_alone_and_leaves_nobody_out(folder: Path) -> None:
    for size in SCREENS.values():
        with page(folder, size) as tab:
            for state in ("empty", "mapped", "dwells", "tried", "form"):
                if state == "mapped":
                    drop(tab, ("shots.csv", SHOTS))
                    read(tab)
                    header(tab)
                    take_all(tab, by_touch=size is PHONE)
                elif state == "dwells":
                    give(tab, option("--time-column"), "t")
                    wait(tab, option("--still-deg"))
                elif state == "tried":
                    give(tab, option("--time-column"), "")
                    assert tried(tab) == ""
                    assert "joint 1 (joint1): -12.00 to 40.00 deg" in tab.text
                elif state == "form":
                    give(tab, select("Header or plan"), "\0new")
                    wait(tab, "document.querySelectorAll('.header-form input').length > 5")
                    tab.value(
                        "document.querySelectorAll('.import details').forEach((d) => { d.open = true; })"
                    )
                    tab.value(
                        "document.querySelectorAll('.import details > button').forEach((b) => b.click())"
                    )
                assert tab.accessibility() == [], state
                assert tab.overflow() == 0, state
                buttons = ".import button, .import select, .import label.check"
                small = tab.value(
                    f"[...document.querySelectorAll('{buttons}')].filter("
                    "(e) => e.offsetParent && e.getBoundingClientRect().height < 39).map((e) => e.outerHTML)"
                )
                assert small == [], state
            assert tab.console == []
            assert [url for url in tab.asked if not url.startswith(root(tab.address))] == []
        assert not (folder / "shots/run.jsonl").exists()


@pytest.mark.long
def test_the_page_is_used_by_the_keyboard_alone(folder: Path) -> None:
    """Tab leads to every control in its order; letters choose in a list, Enter presses a button."""
    (folder / "shots.csv").write_text(SHOTS)

    def to(element: str) -> None:
        for _ in range(80):
            if tab.value(f"document.activeElement === {element}"):
                return
            tab.key("Tab")
        raise AssertionError(f"Tab does not lead to {element}")

    with page(folder) as tab:
        to(select("Or a file of the folder"))
        tab.key("s")
        read(tab)
        to(select("Header or plan"))
        tab.key("h")
        for _ in range(2):
            wait(tab, PROPOSED)
            before = tab.value("document.querySelector('.proposals').textContent")
            tab.value("document.activeElement.blur()")
            to(PROPOSED)
            tab.key("Enter")
            wait(tab, f"document.querySelector('.proposals').textContent !== {before!r}")
        wait(tab, f"{MAPPED} === 6")
        to(button("Import"))
        tab.key("Enter")
        wait(tab, "location.hash === '#/job/shots/result/shots/run.jsonl'", 60)
    assert (folder / "shots/run.jsonl").exists()


@pytest.mark.long
def test_what_cannot_be_imported_is_said_where_it_is_and_what_is_wrong_in_a_header(
    folder: Path, tmp_path: Path
) -> None:
    """One that the server refuses, one that is not sent, one whose name is taken; a column with NaN."""
    (tmp_path / "prose.csv").write_text("Dear all,\nplease find\n")
    (folder / "arm").mkdir()
    (folder / "arm/shots.csv").write_text("1,2\n")
    (folder / "arm/header.yaml").write_text(HEADER)
    with (tmp_path / "large.csv").open("wb") as file:
        file.truncate(65 * 10**6)
    (tmp_path / "shots.csv").write_text(SHOTS.replace("31.0", "nan", 1))
    key = "document.querySelector('.header-form [data-key=\"{}\"] {}')".format
    errors = "[...document.querySelectorAll('.header-form .error')]"
    with page(folder) as tab:
        give(tab, select("Calibration"), "arm")
        tab.choose(
            "document.querySelector('input[type=file]')",
            [tmp_path / name for name in ("prose.csv", "large.csv", "shots.csv")],
        )
        row = "document.querySelector('.recordings [data-file=\"arm/{}\"]')".format
        wait(tab, f"{row('shots.csv')}?.querySelector('.actions input')")
        assert "no column of numbers" in tab.value(f"{row('prose.csv')}.textContent")
        assert "too large to be sent" in tab.value(f"{row('large.csv')}.textContent")
        assert "nothing is replaced" in tab.text
        assert tab.value(f"{row('shots.csv')}.querySelector('.actions input').value") == "arm/shots-2.csv"
        tab.value(f"{row('shots.csv')}.querySelector('.actions button').click()")
        read(tab)
        header(tab, "arm/header.yaml")
        wait(tab, "document.querySelector('.mapper tbody tr')")
        nan = "document.querySelector('[data-joint=\"1\"] option[value=a2]')"
        assert tab.value(f"{nan}.disabled")
        assert tab.value(f"{nan}.textContent") == "a2 (no number in line 3)"
        assert tab.value(f"Boolean({PROPOSED})") is False
        # A header is filled in, with errors where they are.
        give(tab, select("Header or plan"), "\0new")
        wait(tab, "document.querySelectorAll('.header-form input').length > 5")
        press(tab, "Save header")
        wait(tab, f"{errors}.length === 2")  # robot, joint_deg
        for name, value in {
            "robot": "irb1600",
            "noise/joint_deg": "0,01",
            "noise/spot_mm": "1,500",
            "tool/point_mm": "0; 0; 32,5",
        }.items():
            tab.value(f"{key(name, 'input')}.closest('details')?.setAttribute('open', '')")
            field = "input:not([type=checkbox])"
            give(tab, key(name, field), value)
        wait(tab, f"{errors}.some((e) => e.textContent.includes('allowed: a number such as 0.5 or 0,5'))")
        give(tab, key("noise/spot_mm", "input"), "0,5")
        give(tab, key("tool/kind", "select"), "probe")
        give(tab, key("tool/calibrated", "select"), "false")
        give(tab, key("noise/spot_mm", "input"), "-0.5")
        press(tab, "Save header")
        wait(tab, "document.querySelector('[data-key=\"noise/spot_mm\"] > .error')")
        give(tab, key("noise/spot_mm", "input"), "0.5")
        press(tab, "Save header")
        wait(tab, "document.querySelector('.chosen')")
        assert "Robot irb1600; probe, not calibrated" in tab.text
    assert (folder / "arm/shots.csv").read_text() == "1,2\n"
    assert not (folder / "arm/large.csv").exists()
    saved = YAML(typ="safe").load(folder / "arm/header-2.yaml")
    assert saved["noise"] == {"joint_deg": 0.01, "spot_mm": 0.5}
    assert saved["tool"]["point_mm"] == [0, 0, 32.5]


@pytest.mark.long
def test_a_fit_proposes_what_the_limits_cannot_and_the_person_takes_it(folder: Path) -> None:
    """Columns 4 and 6 of the good demo run are exchanged: no limit excludes it, the fit does."""
    good = read_run(next(run.path for run in demo_runs() if run.name == "good"))
    own = good.header.model_copy(update={"robot": "irb1600", "schema_": None})
    write_header(folder / "good.yaml", own)
    rows = np.hstack([np.degrees(good.joints)[:, [0, 1, 2, 5, 4, 3]], good.spots])
    with page(folder) as tab:
        drop(tab, ("shots.csv", table([*NAMES, "dx", "dy"], rows.tolist(), ",")))
        read(tab)
        header(tab, "good.yaml")
        give(tab, option("--spot-columns"), "dx,dy")
        take_all(tab)
        press(tab, "Import")
        wait(tab, "document.querySelector('.diagnosis .proposed button')", 60)
        assert "J4 and J6 exchanged" in tab.value("document.querySelector('.diagnosis').textContent")
        assert "no finding is no proof" in tab.text
        verdict = tab.value("document.querySelector('.outcome .message .word').textContent")
        assert "Misfit" in verdict or "misfit" in verdict
        press(tab, "Take it, then import again")
        columns = "[...document.querySelectorAll('.mapper td select')].map((e) => e.value).join()"
        wait(tab, f"{columns} === 'a1,a2,a3,a6,a5,a4'")
        imported(tab)
        assert "contradicts neither unit nor signs nor order" in tab.text
    np.testing.assert_allclose(read_run(folder / "shots/run-2.jsonl").joints, good.joints, atol=1e-9)


def a_bag_where_the_arm_dwells(tab: Tab, folder: Path, tmp_path: Path) -> None:
    bag = Bag("mcap").states(*moves()).marker(1.0, "left").marker(2.6, "right").write(tmp_path)
    tab.choose("document.querySelector('input[type=file]')", [file_of(bag)])
    read(tab)
    assert "349 joint states on /joint_states" in tab.text
    header(tab)
    assert "needs to know what a dwell is" in tried(tab)
    give(tab, option("--still-deg"), "0,02")
    give(tab, option("--still-s"), "0.5")
    assert tried(tab) == ""
    assert "4 measurements of target 'socket'" in tab.text
    give(tab, option("--marker-topic"), "/shot")
    assert "Changed since then" in tab.text
    press(tab, "Import")
    wait(tab, f"{REFUSAL}.includes(\"the target 'left' is measured only once\")", 60)  # by the fit
    press(tab, "To the result")
    wait(tab, "location.hash === '#/job/log/result/log/run.jsonl'")
    run = read_run(folder / "log/run.jsonl")
    assert [shot.target for shot in run.shots] == ["left", "right"]
    np.testing.assert_allclose(np.degrees(run.joints), POSTURES[:2], atol=1e-6)


def points_of_a_controller_chosen(tab: Tab, folder: Path) -> None:
    listing = fanuc_listing("".join(map(fanuc_position, range(1, 5), POSTURES)))
    drop(tab, ("shots.ls", listing))
    read(tab)
    header(tab)
    tab.value("document.querySelector('.points input').click()")
    # The robot file says what joint 3 is counted from; who knows better may choose.
    give(tab, option("--j3"), "link")
    imported(tab)
    joints = np.degrees(read_run(folder / "shots/run.jsonl").joints)
    np.testing.assert_allclose(joints, POSTURES[1:], atol=1e-9)


def points_of_a_tracker_joined_to_joints(tab: Tab, folder: Path) -> None:
    """In another order, with the column names in a remark, as SpatialAnalyzer writes."""
    (folder / "tracker.yaml").write_text(
        "robot: irb1600\nnoise: {joint_deg: 0.01}\n"
        "instruments:\n  tracker: {kind: tracker, sigma_mm: 0.05, reflectors: {r1: {}}}\n"
    )
    points = [(900.0 + 50 * i, 20.0 * i, 500.5 - i) for i in range(4)]
    lines = [f"r1, p{i + 1}, {','.join(map(str, points[i]))}" for i in (2, 0, 3, 1)]
    tracked = "\n".join(["// Units: Millimeters", "// Group, Point, X, Y, Z", *lines, ""])
    joints = table(["n", *NAMES], [[i + 1, *row] for i, row in enumerate(POSTURES.tolist())], ",")
    drop(tab, ("tracked.csv", tracked), ("joints.csv", joints))
    read(tab, 2)
    header(tab, "tracker.yaml")
    assert tried(tab).startswith("Not complete: state: Joint columns")
    give(tab, option("--joints"), "tracked/joints.csv")
    for key, value in {
        "joint-columns": ",".join(NAMES),
        "joint-units": "deg",
        "match": "number",
        "number-column": "Point",
        "joints-number-column": "n",
        "reflector-column": "Group",
    }.items():
        wait(tab, option(f"--{key}"))
        give(tab, option(f"--{key}"), value)
    assert tried(tab) == ""
    press(tab, "Import")
    wait(tab, "document.querySelector('.outcome')?.innerText.includes('Written to')", 60)
    shots = read_run(folder / "tracked/run.jsonl").shots
    np.testing.assert_allclose([shot.joints_deg for shot in shots], POSTURES[[2, 0, 3, 1]])
    np.testing.assert_allclose([shot.measured_mm for shot in shots], np.array(points)[[2, 0, 3, 1]])


@pytest.mark.long
def test_recordings_of_bags_controllers_and_trackers_become_runs(folder: Path, tmp_path: Path) -> None:
    """One after the other in the same tab: the form begins anew each time."""
    with page(folder) as tab:
        a_bag_where_the_arm_dwells(tab, folder, tmp_path)
        anew(tab)
        points_of_a_controller_chosen(tab, folder)
        anew(tab)
        points_of_a_tracker_joined_to_joints(tab, folder)


def anew(tab: Tab) -> None:
    tab.on(lambda page: page.goto(f"{root(tab.address)}#/import/"))
    tab.reload()
    wait(tab, "document.querySelector('.drop')")
