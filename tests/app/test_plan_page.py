"""The place Plan with all it can do, and the shapes of the place Robot, used as a person would."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest
from app_page import SCREENS, app, give, root, wait
from arm_with_meshes import URDF, stl
from cells import good_plan, pattern_plan
from chromium import LAPTOP, Size, Tab, chromium
from command_line import plan_file

from zerobeam.experiments.plans.obstacles import read_obstacles
from zerobeam.model.files.plan import read_plan

pytestmark = [pytest.mark.browser, pytest.mark.long]

HTML = "<img src=x onerror=alert(1)>"
U2 = "document.querySelector('#plan-table [data-of=delta2] .u').textContent"
SETTLED = "!document.querySelector('#plan .pending')"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """plan.yaml, the X-Pattern, and an arm with a mesh in the package `cell`."""
    chromium()
    made = tmp_path_factory.mktemp("plans") / "dir"
    (made / "cell").mkdir(parents=True)
    (made / "sub").mkdir()
    plan_file(made / "plan.yaml", good_plan(7))
    plan_file(made / "x.yaml", pattern_plan("x"))
    (made / "cell" / "base.stl").write_bytes(stl([[[0, 0, 0], [0.2, 0, 0], [0, 0, 0.3]]]))
    (made / "sub" / "upper.obj").write_text("v 0 0 0\nv 500 0 0\nv 500 0 50\nf 1 2 3\n")
    (made / "sub" / "arm.urdf").write_text(URDF.format(last=f"missing{quote(HTML)}.stl"))
    return made


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    with app(folder) as served:
        yield served.address


@contextmanager
def plan(address: str, size: Size = LAPTOP) -> Iterator[Tab]:
    """plan.yaml, opened by its address and checked."""
    with chromium().opened(f"{address}#plan/plan.yaml", size) as opened:
        wait(opened, f"document.querySelector('#plan-table tbody tr') && {SETTLED}")
        yield opened
        assert faults(opened) == []
        assert opened.dialogs == []


@pytest.fixture
def tab(address: str) -> Iterator[Tab]:
    with plan(address) as opened:
        yield opened


def element(name: str) -> str:
    return f"document.getElementById('{name}')"


def show(tab: Tab, name: str) -> None:
    """Open what can be folded up, as a click on its summary does."""
    tab.value(f"{element(name)}.closest('details').querySelector('summary').click()")


def faults(tab: Tab) -> list[str]:
    """What the console says but for answers that refuse: the browser notes each."""
    return [said for said in tab.console if "400 (Bad Request)" not in said]


def rows(tab: Tab, name: str) -> list[list[str]]:
    all_rows = f"[...{element(name)}.tBodies[0].rows]"
    found = tab.value(f"{all_rows}.map((r) => [...r.cells].map((c) => c.textContent))")
    return [[" ".join(cell.split()) for cell in row] for row in found]


@pytest.mark.parametrize("size", SCREENS)
def test_everything_opened_leaves_nobody_out(address: str, size: str) -> None:
    with plan(address, SCREENS[size]) as tab:
        for name in ("make", "adds-table", "beside-with", "plan-constraints", "obstacles-open", "program"):
            show(tab, name)
        give(tab, element("beside-with"), "x.yaml")
        tab.value(f"{element('obstacles-add')}.click()")
        for name in ("adds", "beside"):
            wait(tab, f"document.querySelector('#{name}-table tbody tr')")
        assert tab.accessibility() == []
        assert tab.overflow() == 0
        low = tab.value(
            "[...document.querySelectorAll('#plan summary, #plan button')].filter((e) => e.offsetParent"
            " && e.getBoundingClientRect().height < 39).map((e) => e.textContent)"
        )
        assert low == []
        clipped = tab.value(
            "[...document.querySelectorAll('#plan .joint input[type=number]')].filter((e) => {"
            " e.value = '-145.0028'; return e.scrollWidth > e.clientWidth; }).length"
        )
        assert clipped == 0
        assert tab.console == []
        assert [url for url in tab.asked if not url.startswith(root(address))] == []


def test_a_plan_is_made_with_its_certificate_and_opened(tab: Tab, folder: Path) -> None:
    show(tab, "make")
    for name, value in {"shots": 6, "candidates": 300, "file": "sub/best.yaml"}.items():
        give(tab, element(f"make-{name}"), value)
    assert tab.value(f"{element('make-x')}.value") == "900"  # the target of the plan that is open
    tab.value(f"{element('make-go')}.click()")
    wait(tab, f"{element('plan-file')}.value === 'sub/best.yaml' && {SETTLED}")
    assert len(read_plan(folder / "sub" / "best.yaml").postures) == 6
    said = tab.value(f"{element('make-said')}.textContent")
    assert "as good as the best choice from 300 candidates" in said
    assert "postures are left" in said
    # Once more: nothing is replaced, and that is said.
    tab.value(f"{element('make-go')}.click()")
    wait(tab, f"!{element('make-job')}.hidden && {element('make-job')}.textContent.includes('exists')")


def test_a_tolerance_that_no_plan_reaches_is_said(tab: Tab, folder: Path) -> None:
    show(tab, "make")
    values = {"tolerance": 0.0001, "most": 8, "candidates": 200, "file": "none.yaml"}
    for name, value in values.items():
        give(tab, element(f"make-{name}"), value)
    tab.value(f"{element('make-go')}.click()")
    wait(tab, f"{element('make-said')}.textContent.includes('No plan of up to 8 measurements')")
    assert "The limit is" in tab.value(f"{element('make-said')}.textContent")
    assert not (folder / "none.yaml").exists()


def test_a_job_can_be_cancelled(tab: Tab, folder: Path) -> None:
    show(tab, "make")
    give(tab, element("make-candidates"), 1000000)
    give(tab, element("make-file"), "long.yaml")
    tab.value(f"{element('make-go')}.click()")
    wait(tab, "document.querySelector('#make-job button')")
    tab.value("document.querySelector('#make-job button').click()")
    wait(tab, f"{element('make-job')}.textContent.includes('Cancelled')")
    assert not (folder / "long.yaml").exists()


def test_two_plans_beside_each_other_are_two_checks(tab: Tab) -> None:
    show(tab, "beside-with")
    give(tab, element("beside-with"), "x.yaml")
    wait(tab, "document.querySelector('#beside-table tbody tr')")
    table = {row[0]: row[1:] for row in rows(tab, "beside-table")}
    assert table["J2 (δ2)"][1:] == ["✕ not determined", "unidentifiable → weak"]
    assert table["J2 (δ2)"][0].removeprefix("◆ ") == tab.value(U2)
    assert table["verdict"][:2] == ["Weak", "Degenerate"]


def test_what_each_posture_adds_follows_the_plan(tab: Tab) -> None:
    show(tab, "adds-table")
    wait(tab, "document.querySelectorAll('#adds-table tbody tr').length === 7")
    before = rows(tab, "adds-table")
    assert all(float(row[2].rpartition("× ")[2]) >= 0.99 for row in before)
    tab.value(f"{element('posture-remove')}.click()")
    wait(tab, "document.querySelectorAll('#adds-table tbody tr').length === 6")


def drag(tab: Tab) -> tuple[float, float]:
    """Move the topmost thing that can be moved 40 pixels to the right; where it was taken hold of.

    It is found by moving the pointer until the cursor says so.
    """
    found = tab.value(
        "(() => { const c = document.querySelector('canvas'), box = c.getBoundingClientRect();"
        " for (let y = box.top; y < box.bottom; y += 6) for (let x = box.left; x < box.right; x += 6) {"
        " const over = {clientX: x, clientY: y, pointerType: 'mouse'};"
        " c.dispatchEvent(new PointerEvent('pointermove', over));"
        " if (c.style.cursor === 'move') return [x, y]; } return null; })()"
    )
    assert found is not None
    x, y = found
    mouse = {"button": "left", "buttons": 1, "clickCount": 1}
    tab.call("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, **mouse)
    for step in range(1, 6):
        tab.call("Input.dispatchMouseEvent", type="mouseMoved", x=x + 8 * step, y=y, **mouse)
    tab.call("Input.dispatchMouseEvent", type="mouseReleased", x=x + 40, y=y, **mouse)
    return x, y


def test_the_target_is_dragged_by_mouse_and_by_touch(tab: Tab) -> None:
    field = "document.querySelector('#plan-targets input[type=number]')"
    before, u = float(tab.value(f"{field}.value")), tab.value(U2)
    x, y = drag(tab)
    wait(tab, f"{U2} !== {u!r} && {SETTLED}")
    after = float(tab.value(f"{field}.value"))
    assert abs(after - before) > 20
    touch = [{"x": x + 40, "y": y}]
    tab.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=touch)
    tab.call("Input.dispatchTouchEvent", type="touchMove", touchPoints=[{"x": x, "y": y}])
    tab.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    wait(tab, f"Math.abs({field}.value - {before}) < 15 && {SETTLED}")
    for _ in range(2):
        tab.value(f"{element('plan-undo')}.click()")
    wait(tab, f"{U2} === {u!r}")


def test_obstacles_are_edited_flagged_and_saved(tab: Tab, folder: Path) -> None:
    show(tab, "obstacles-open")
    tab.value(f"{element('obstacles-add')}.click()")
    name = "document.querySelector('#obstacles-boxes .box input')"
    wait(tab, name)
    give(tab, name, HTML)
    low = "document.querySelectorAll('#obstacles-boxes .corners')[0].querySelectorAll('input')"
    high = "document.querySelectorAll('#obstacles-boxes .corners')[1].querySelectorAll('input')"
    for i, (least, most) in enumerate(((-2000, 2000), (-2000, 2000), (900, 2500))):
        give(tab, f"{low}[{i}]", least)
        give(tab, f"{high}[{i}]", most)
    postures = f"{element('postures')}.textContent"
    wait(tab, f"{postures}.includes('the arm hits the floor or a box')")
    give(tab, f"{high}[0]", -3000)  # below the lowest corner
    wait(tab, f"{element('plan-verdict')}.textContent.includes('is empty')")
    assert tab.value(U2) == "—"
    give(tab, f"{high}[0]", 2000)
    wait(tab, f"{U2} !== '—'")
    tab.value(f"{element('obstacles-save')}.click()")
    wait(tab, f"{element('obstacles-saved')}.textContent === 'Saved as obstacles.yaml.'")
    assert read_obstacles(folder / "obstacles.yaml").boxes[0].name == HTML
    assert tab.value("document.querySelectorAll('img').length") == 0


def test_a_constraint_is_part_of_the_plan_and_judged_on_each_edit(tab: Tab, folder: Path) -> None:
    """The target is moved to where beams come from behind: the verdict says so; undone, no more."""
    verdict = f"{element('plan-verdict')}.textContent"
    give(tab, element("constraint-facing"), "0, 0, 1")
    give(tab, element("constraint-acceptance_deg"), "89")
    wait(tab, SETTLED)
    assert tab.value(verdict).startswith("Weak")
    z = "document.querySelectorAll('#plan-targets input[type=number]')[2]"
    give(tab, z, 1400)
    wait(tab, f"{verdict}.startsWith('Constraints violated')")
    assert "from behind" in tab.value(f"{element('postures')}.textContent")
    assert tab.value("document.querySelectorAll('#postures .misses').length") > 0
    tab.value(f"{element('plan-undo')}.click()")
    wait(tab, f"{verdict}.startsWith('Weak')")
    give(tab, element("plan-file"), "constrained.yaml")
    tab.value(f"{element('plan-save')}.click()")
    wait(tab, f"{element('plan-saved')}.textContent === 'Saved as constrained.yaml.'")
    stated = read_plan(folder / "constrained.yaml").constraints
    assert (stated.facing, stated.acceptance_deg) == ((0, 0, 1), 89)
    give(tab, element("constraint-facing"), "0, 0, -1")
    wait(tab, f"{verdict}.startsWith('Constraints violated')")
    give(tab, element("constraint-facing"), "0, 0, 0")
    wait(tab, f"{verdict}.includes('has no length')")
    give(tab, element("constraint-facing"), "")
    wait(tab, f"{verdict}.startsWith('Weak')")
    show(tab, "make")
    for name, value in {"shots": 6, "candidates": 300, "file": "kept.yaml"}.items():
        give(tab, element(f"make-{name}"), value)
    tab.value(f"{element('make-go')}.click()")
    wait(tab, f"{element('plan-file')}.value === 'kept.yaml' && {SETTLED}")
    assert tab.value(f"{element('constraint-beam_mm')}.value") == "200, 2000"


def test_a_plan_is_exported_and_fetched(tab: Tab, folder: Path) -> None:
    show(tab, "program")
    tab.value(f"{element('program-go')}.click()")
    link = "document.querySelector('#program-job a')"
    wait(tab, link)
    assert tab.value(f"fetch({link}.href).then((r) => r.text())") == (folder / "plan.mod").read_text()
    # What is not saved is not exported.
    tab.value(f"{element('posture-copy')}.click()")
    tab.value(f"{element('program-go')}.click()")
    wait(tab, f"{element('program-job')}.textContent.includes('Save the plan first')")


def test_meshes_axes_and_frames_of_a_urdf(address: str) -> None:
    with chromium().opened(f"{address}#robot") as tab:
        wait(tab, "document.querySelector('#robot-pose td')")
        tab.value(
            "document.getElementById('scene').addEventListener('scene',"
            " (e) => { window.drawn = e.detail.scene.postures[0] })"
        )
        give(tab, element("robot-name"), "sub/arm.urdf")
        give(tab, element("robot-base"), "base")
        give(tab, element("robot-tip"), "hand")
        wait(tab, f"{element('fault')}.textContent.includes('tip link is not in the file')")
        give(tab, element("robot-tip"), "flange")
        wait(tab, f"!{element('robot-solid')}.hidden && window.drawn?.meshes")
        assert tab.value("window.drawn.meshes.length") == 2
        assert "is not drawn: " in tab.value(f"{element('robot-notes')}.textContent")
        for name in ("robot-axes", "robot-frames", "robot-meshes"):
            tab.value(f"{element(name)}.click()")
        drawn = tab.value("[window.drawn.axes.length, window.drawn.frames.length, window.drawn.meshes]")
        assert drawn == [2, 2, None]
        give(tab, element("robot-name"), "ur5e")
        wait(tab, f"{element('robot-solid')}.hidden")
        assert faults(tab) == []
        assert tab.dialogs == []


def test_a_changed_joint_leaves_the_rows_of_other_postures_alone(tab: Tab) -> None:
    tab.value(
        "window.rewritten = new Set(); new MutationObserver((all) => { for (const one of all)"
        " rewritten.add(one.target.closest('li').dataset.key); })"
        f".observe({element('postures')}, {{childList: true, subtree: true}})"
    )
    u, joint = tab.value(U2), "document.querySelector('#plan-joints [data-joint=\"1\"] input')"
    give(tab, joint, float(tab.value(f"{joint}.value")) + 5)
    wait(tab, f"{U2} !== {u!r} && {SETTLED}")
    assert tab.value("[...rewritten]") == ["postures_deg/0"]


def test_a_plan_is_made_edited_compared_and_saved_by_the_keyboard_alone(address: str, folder: Path) -> None:
    with plan(address) as tab:
        reach(tab, "#make-box > summary")
        press(tab, "Enter")
        for name, value in {"shots": "6", "candidates": "300", "file": "by-keys.yaml"}.items():
            reach(tab, f"#make-{name}")
            tab.call("Input.dispatchKeyEvent", type="keyDown", key="a", modifiers=2, commands=["selectAll"])
            tab.call("Input.insertText", text=value)
        press(tab, "Enter")
        wait(tab, f"{element('plan-file')}.value === 'by-keys.yaml' && {SETTLED}")
        u = tab.value(U2)
        reach(tab, "#plan-joints [data-joint='1'] input[type=range]")
        for _ in range(20):
            press(tab, "ArrowRight")
        wait(tab, f"{U2} !== {u!r} && {SETTLED}")
        changed = tab.value(U2)
        reach(tab, "#adds-box + details > summary", back=True)
        press(tab, "Enter")
        reach(tab, "#beside-with")
        tab.call("Input.insertText", text="x")
        press(tab, "x")
        wait(tab, "document.querySelector('#beside-table tbody tr')")
        assert changed in tab.value(f"{element('beside-table')}.textContent")
        tab.call("Input.dispatchKeyEvent", type="keyDown", key="s", modifiers=2)
        wait(tab, f"{element('plan-saved')}.textContent === 'Saved as by-keys.yaml.'")
        first = tab.value("Number(document.querySelector('#plan-joints [data-joint=\"1\"] input').value)")
        joints = read_plan(folder / "by-keys.yaml").postures[0]
        assert np.degrees(joints[1]) == pytest.approx(first, abs=1e-6)
        assert faults(tab) == []


KEYS = {"Tab": (9, ""), "Enter": (13, "\r"), "ArrowRight": (39, ""), "x": (88, "x")}


def press(tab: Tab, key: str, shift: bool = False) -> None:
    code, text = KEYS[key]
    own = {"key": key, "code": key, "windowsVirtualKeyCode": code, "modifiers": 8 if shift else 0}
    tab.call("Input.dispatchKeyEvent", type="keyDown", text=text, **own)
    tab.call("Input.dispatchKeyEvent", type="keyUp", **own)


def reach(tab: Tab, selector: str, back: bool = False) -> None:
    """Tab until the focus is there."""
    for _ in range(150):
        if tab.value(f"document.activeElement.matches({selector!r})"):
            return
        press(tab, "Tab", back)
    raise AssertionError(f"{selector} is never reached")


def test_a_box_is_dragged_in_the_picture(tab: Tab) -> None:
    show(tab, "obstacles-open")
    tab.value(f"{element('obstacles-add')}.click()")
    corners = "[...document.querySelectorAll('#obstacles-boxes .corners input')].map((e) => Number(e.value))"
    wait(tab, f"{SETTLED} && {corners}.length === 6")
    # Away from the target, which is in the new box.
    low, high = (f"document.querySelectorAll('#obstacles-boxes .corners')[{i}].children[2]" for i in (0, 1))
    give(tab, low, 500)
    give(tab, high, 700)
    tab.value(
        "document.getElementById('scene').addEventListener('scene',"
        " (e) => { window.drawn = e.detail.scene.boxes })"
    )
    wait(tab, "window.drawn?.[0]?.max[2] === 700")
    before = tab.value(corners)
    drag(tab)
    after = tab.value(corners)
    moved = [b - a for a, b in zip(before, after, strict=True)]
    assert moved[:3] == moved[3:]
    assert max(map(abs, moved[:2])) > 20
    wait(tab, f"JSON.stringify(window.drawn[0].min) === JSON.stringify({after[:3]})")
    assert float(tab.value("document.querySelector('#plan-targets input').value")) == 900  # stays


def test_axes_frames_and_meshes_of_the_chosen_posture(address: str, folder: Path) -> None:
    content = {
        "schema": "zerobeam/plan/1",
        "robot": {"urdf": "arm.urdf", "base": "base", "tip": "flange"},
        "tool": {"kind": "laser", "calibrated": True, "point_mm": [0, 0, 65], "direction": [1, 0, 0]},
        "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
        "targets": {"psd": {"guess_mm": [1500, 0, 400]}},
        "postures_deg": [[0, 0], [10, 5], [-10, 5]],
    }
    (folder / "sub" / "urdf.yaml").write_text(json.dumps(content))
    with chromium().opened(f"{address}#plan") as tab:
        wait(tab, "document.querySelector('#plan-open optgroup')")
        tab.value(
            "document.getElementById('scene').addEventListener('scene',"
            " (e) => { window.drawn = e.detail.scene.postures })"
        )
        give(tab, element("plan-open"), "sub/urdf.yaml")
        wait(tab, "window.drawn?.[0]?.meshes?.length === 2")
        assert "is not drawn: " in tab.value(f"{element('plan-undrawn')}.textContent")
        tab.value(f"{element('plan-frames')}.click(); {element('plan-axes')}.click()")
        wait(tab, "window.drawn[0].frames?.length === 3 && window.drawn[0].axes?.length === 2")
        tool = tab.value("window.drawn[0].frames[2]")
        assert (tool["name"], tool["at"]) == ("tool", tab.value("window.drawn[0].beam[0]"))
        flange = np.array(tab.value("window.drawn[0].frames[1]").pop("at"))
        assert np.linalg.norm(flange - tool["at"]) == pytest.approx(65, abs=0.01)
        tab.value("document.querySelectorAll('#postures button')[1].click()")
        wait(tab, "window.drawn[1].meshes && !window.drawn[0].meshes")
        for name in ("plan-frames", "plan-axes", "plan-meshes"):
            tab.value(f"{element(name)}.click()")
        wait(tab, "!window.drawn[1].meshes && !window.drawn[1].frames && !window.drawn[1].axes")
        assert faults(tab) == []
