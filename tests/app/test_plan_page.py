"""The step Plan at work: plans made and compared, obstacles and joints moved, meshes drawn."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from app_page import app, fill, press, wait
from arm_with_meshes import URDF, stl
from cells import good_plan
from chromium import Tab, chromium
from command_line import plan_file, zerobeam

pytestmark = pytest.mark.browser

CHECKED = "document.querySelector('.determined table') && !document.querySelector('.pending')"
CONTENT = "import('/page/core/editing.js').then((m) => m.plan.value)"
UNSAVED = "document.querySelector('.plan-bar output').textContent !== 'Saved.'"
PICTURE = "document.querySelector('canvas.scene-picture')"
TRIANGLE = [[[0.0, -0.2, 0.0], [0.0, 0.2, 0.0], [0.5, 0.0, 0.2]]]
LOWEST_X = "lowest x, mm"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    chromium()
    made = tmp_path_factory.mktemp("plans") / "dir"
    (made / "cell").mkdir(parents=True)
    plan_file(made / "cell" / "plan.yaml", good_plan(7))
    plan_file(made / "cell" / "fewer.yaml", good_plan(4))
    return made


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    with app(folder) as opened:
        yield opened.address


@pytest.fixture
def tab(address: str) -> Iterator[Tab]:
    """The plan of seven measurements, checked and drawn."""
    with chromium().opened(f"{address}#/job/cell/plan/cell/plan.yaml") as opened:
        wait(opened, f"{CHECKED} && {PICTURE}")
        yield opened
        assert opened.console == []


def unfold(tab: Tab, title: str) -> None:
    tab.on(lambda page: page.get_by_text(title, exact=True).first.click())


def choose(tab: Tab, label: str, value: str) -> None:
    tab.on(lambda page: page.get_by_label(label, exact=True).first.select_option(value))


def field(tab: Tab, label: str) -> str:
    return str(tab.on(lambda page: page.get_by_label(label, exact=True).first.input_value()))


def another(tab: Tab, name: str) -> None:
    """The plan of another calibration, in the same tab."""
    wait(tab, f"import('/page/core/store.js').then((m) => m.ofKind('plan').includes('{name}/plan.yaml'))")
    tab.value(f"location.hash = '#/job/{name}/plan/{name}/plan.yaml'")
    wait(tab, f"document.querySelector('header h1').textContent === '{name}' && {CHECKED} && {PICTURE}")


def compared_with_another(tab: Tab) -> None:
    unfold(tab, "Compare with another plan")
    choose(tab, "Other plan", "cell/fewer.yaml")
    wait(tab, "document.querySelector('[aria-label=\"Two plans\"] tbody tr')")
    rows = tab.value(
        "[...document.querySelectorAll('[aria-label=\"Two plans\"] tbody tr')]"
        ".map((row) => [...row.children].map((cell) => cell.textContent))"
    )
    table = {row[0]: row[1:] for row in rows}
    assert table["measurements"][:2] == ["7", "4"]
    ours, theirs, ratio = table["J2 (δ2)"]
    assert ours.startswith(("●", "◆"))
    assert float(ratio.removeprefix("× ")) < 1 if "°" in theirs else "→" in ratio


def refused_at_its_field(tab: Tab) -> None:
    """What the server refuses of an option is said there, and nothing is begun."""
    unfold(tab, "Make another plan")
    unfold(tab, "Constraints and search")
    fill(tab, "Normal of the target, or any", "up")
    press(tab, "Make the plan")
    facing = "document.querySelector('[data-option=\"--facing\"]')"
    wait(tab, f"{facing}.querySelector('.error')")
    assert "3 numbers up to" in tab.value(f"{facing}.textContent")
    assert tab.value(f"{facing}.querySelector('input').getAttribute('aria-invalid')") == "true"
    assert tab.value("document.querySelector('.making progress')") is None
    tab.on(lambda page: page.locator("[data-option='--facing'] input").fill("0,0,1"))
    wait(tab, f"!{facing}.querySelector('.error')")
    assert [said for said in tab.console if "400" not in said] == []
    tab.messages.clear()


def exported_for_a_newer_maker(tab: Tab, folder: Path, tmp_path: Path) -> None:
    """A VAL3 application is four files, and those of the command line."""
    at = folder / "staubli"
    at.mkdir()
    content = yaml.safe_load((folder / "cell" / "fewer.yaml").read_text())
    (at / "plan.yaml").write_text(yaml.safe_dump({**content, "robot": "tx2_60"}))
    assert zerobeam("export", "plan", "val3", at / "plan.yaml", "-o", tmp_path / "zb_plan.pjx").status == 0
    files = {file.name: file.read_text() for file in tmp_path.iterdir()}
    another(tab, "staubli")
    unfold(tab, "Export for a controller, or as a sheet")
    choose(tab, "Form", "val3")
    wait(
        tab,
        "[...document.querySelectorAll('input')].some((i) => i.placeholder === 'staubli/zb_plan.pjx')",
    )
    press(tab, "Export")
    links = "[...document.querySelectorAll('a[download]')].map((one) => one.textContent)"
    wait(tab, f"{links}.length === 4", 60)
    assert {link.removeprefix("Download ").strip() for link in tab.value(links)} == {*files}
    wait(tab, "document.querySelector('form a[download]')")
    assert {name: (at / name).read_text() for name in files} == files


LRMATE = {
    "schema": "zerobeam/plan/1",
    "robot": "lrmate_200id",
    "tool": {"kind": "laser", "calibrated": False, "point_mm": [0, 0, 65], "direction": [1, 0, 0]},
    "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
    "targets": {"psd": {"guess_mm": [450, 0, 70], "sigma_mm": 30}},
    "postures_deg": [[5, -57.133, -51.194, 10, 20, 30], [-5, -40, -20, 0, 30, 60]],
}


def counted_as_by_the_pendant(tab: Tab, folder: Path) -> None:
    (folder / "fanuc").mkdir()
    file = folder / "fanuc/plan.yaml"
    file.write_text(yaml.safe_dump(LRMATE))
    another(tab, "fanuc")
    assert "joint 3 from the ground" in tab.text
    assert "point (0, 0, 65)" in tab.text
    assert field(tab, "J3, °") == "5.939"  # -51.194 + 57.133
    # The pendant's J2 moves link 2 alone: the angle between the links follows, its J3 stays.
    fill(tab, "J2, °", "-50")
    assert field(tab, "J3, °") == "5.939"
    fill(tab, "J3, °", "7,25")
    wait(tab, f"{CONTENT}.then((plan) => plan.postures_deg[0][2] === -42.75)")
    assert tab.value(CONTENT)["postures_deg"][0] == [5, -50, -42.75, 10, 20, 30]
    # A difference to the file is told in the same counting.
    changed = LRMATE | {"postures_deg": [[5, -57.133, -52.194, 10, 20, 30], LRMATE["postures_deg"][1]]}
    file.write_text(yaml.safe_dump(changed))
    press(tab, "Save")
    wait(tab, "document.querySelector('dialog table')")
    rows = tab.value(
        "[...document.querySelectorAll('dialog tbody tr')]"
        ".map((row) => [...row.children].map((cell) => cell.textContent))"
    )
    assert ["postures_deg / 0 / J3", "7.25", "4.939"] in rows


@pytest.mark.long
def test_a_plan_is_compared_exported_and_counted_as_by_the_pendant(
    tab: Tab, folder: Path, tmp_path: Path
) -> None:
    compared_with_another(tab)
    refused_at_its_field(tab)
    exported_for_a_newer_maker(tab, folder, tmp_path)
    counted_as_by_the_pendant(tab, folder)
    assert [said for said in tab.console if "412" not in said] == []
    tab.messages.clear()


def _over_a_joint(tab: Tab) -> tuple[float, float]:
    """Where the pointer meets a body that can be turned, on the grid of the picture."""
    box = tab.value(
        f"(({{x, y, width, height}}) => [x, y, width, height])({PICTURE}.getBoundingClientRect())"
    )
    for row in range(3, 20):
        for column in range(4, 20):
            x, y = box[0] + box[2] * column / 24, box[1] + box[3] * row / 24
            tab.on(lambda frame, x=x, y=y: frame.page.mouse.move(x, y))
            if tab.value(f"{PICTURE}.classList.contains('over')"):
                return x, y
    raise AssertionError("no body of the arm is under the pointer anywhere")


def moved_in_the_picture_and_undone(tab: Tab) -> None:
    before = tab.value(CONTENT)["postures_deg"]
    x, y = _over_a_joint(tab)

    def drag(frame: Any) -> None:
        mouse = frame.page.mouse
        mouse.down()
        mouse.move(x + 30, y + 25, steps=4)
        mouse.up()

    tab.on(drag)
    wait(tab, UNSAVED)
    after = tab.value(CONTENT)["postures_deg"]
    assert after[1:] == before[1:]
    assert sum(a != b for a, b in zip(after[0], before[0], strict=True)) == 1
    wait(tab, CHECKED)
    press(tab, "Undo")
    assert tab.value(CONTENT)["postures_deg"] == before
    assert not tab.value(UNSAVED)
    # An obstacle of the list, too.
    tab.value("location.hash = '#/job/cell/cell/cell/plan.yaml'")
    wait(tab, f"document.querySelector('.target input') && {PICTURE}")
    unfold(tab, "Obstacles")
    press(tab, "Add a box")
    wait(tab, "document.querySelector('fieldset.box')")
    start = field(tab, LOWEST_X)
    fill(tab, LOWEST_X, "-700,5")
    fill(tab, "highest x, mm", "-500")
    # Grab goes through what can be held: the box comes after the target.
    held = "document.querySelector('.scene-held output')?.textContent"
    for _ in range(4):
        press(tab, "Grab")
        wait(tab, f"{held} !== undefined")
        if tab.value(held) == "box 1":
            break
    assert tab.value(held) == "box 1"
    tab.value(f"{PICTURE}.focus()")
    tab.key("Shift+ArrowRight")
    wait(tab, "document.querySelector('[aria-label=\"highest x, mm\"]').value === '-490'")
    (box,) = tab.value(CONTENT)["constraints"]["obstacles"]["boxes"]
    assert box["min_mm"][0] == pytest.approx(-690, abs=1)
    for _ in range(4):
        press(tab, "Undo")
    wait(tab, "!document.querySelector('fieldset.box')")
    assert not tab.value(UNSAVED)
    press(tab, "Redo")
    wait(tab, "document.querySelector('fieldset.box')")
    assert field(tab, LOWEST_X) == start


def made_and_opened(folder: Path, tab: Tab) -> None:
    unfold(tab, "Make another plan")
    for kind in ("optimal", "x"):
        choose(tab, "Kind", kind)
        fill(tab, "Measurements", "6")
        fill(tab, "New file", f"cell/{kind}.yaml")
        if kind == "optimal":
            unfold(tab, "Constraints and search")
            fill(tab, "Candidates", "300")
        press(tab, "Make the plan")
        opened = f"location.hash.endsWith('/plan/cell/{kind}.yaml')"
        wait(tab, f"{opened} && document.querySelectorAll('.strip li').length === 8 && {CHECKED}", 180)
        assert len(yaml.safe_load((folder / "cell" / f"{kind}.yaml").read_text())["postures_deg"]) == 8
        assert "8 measurements" in tab.text


def plan_with_meshes(folder: Path) -> None:
    made = folder / "two"
    made.mkdir()
    (made / "arm.urdf").write_text(URDF.format(last="flange.stl").replace("package://cell/", ""))
    for name in ("base.stl", "flange.stl"):
        (made / name).write_bytes(stl(TRIANGLE))
    (made / "upper.obj").write_text("v 0 -100 0\nv 0 100 0\nv 500 0 200\nf 1 2 3\n")
    content = {
        "schema": "zerobeam/plan/1",
        "robot": {"urdf": "arm.urdf", "base": "base", "tip": "flange"},
        "tool": {"kind": "probe", "calibrated": True, "point_mm": [0, 0, 100]},
        "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
        "targets": {"psd": {"guess_mm": [500, 0, 500]}},
        "postures_deg": [[0, 10], [30, 40], [-40, 20]],
    }
    (made / "plan.yaml").write_text(yaml.safe_dump(content))


def meshes_are_drawn(tab: Tab) -> None:
    meshes = "import('/page/plan/picture.js').then((m) => m.meshes.value?.map((one) => one.link))"
    wait(tab, PICTURE)
    assert tab.wait(f"{meshes}", 30)
    tab.value("new Promise((then) => setTimeout(then, 500))")
    assert tab.value(meshes) == [0, 1, 2]
    drawn = tab.on(lambda page: page.locator("canvas.scene-picture").screenshot())
    tab.value("import('/page/plan/picture.js').then((m) => { m.meshes.value = undefined; })")
    tab.value("new Promise((then) => setTimeout(then, 500))")
    bare = tab.on(lambda page: page.locator("canvas.scene-picture").screenshot())
    assert struct.unpack(">II", drawn[16:24]) == struct.unpack(">II", bare[16:24])
    assert drawn != bare


@pytest.mark.long
def test_what_is_moved_in_the_picture_is_undone_plans_are_made_and_meshes_drawn(
    folder: Path, address: str, tab: Tab
) -> None:
    moved_in_the_picture_and_undone(tab)
    press(tab, "Undo")
    tab.value("location.hash = '#/job/cell/plan/cell/plan.yaml'")
    wait(tab, f"{CHECKED} && {PICTURE}")
    made_and_opened(folder, tab)
    plan_with_meshes(folder)
    with chromium().opened(f"{address}#/job/two/plan/two/plan.yaml") as other:
        meshes_are_drawn(other)
        assert other.console == []
