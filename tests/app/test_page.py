"""The page as a browser shows it: loaded from its server alone; what it says follows what is done to it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from app_page import SCREENS, app, give, root, wait
from cells import good_plan, pattern_plan
from chromium import LAPTOP, Size, Tab, chromium
from command_line import plan_file

from zerobeam.model.files.plan import read_plan

pytestmark = pytest.mark.browser

U2 = "document.querySelector('#plan-table [data-of=delta2] .u').textContent"
VERDICT = "document.getElementById('plan-verdict').textContent"
SAVED = "document.getElementById('plan-saved').textContent"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """plan.yaml, and the X-Pattern, in which joint 1 does not move."""
    chromium()
    made = tmp_path_factory.mktemp("page") / "dir"
    made.mkdir()
    plan_file(made / "plan.yaml", good_plan(7))
    plan_file(made / "x.yaml", pattern_plan("x"))
    return made


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    with app(folder) as opened:
        yield opened.address


@contextmanager
def plan(address: str, file: str, size: Size = LAPTOP) -> Iterator[Tab]:
    """The place Plan with a plan of the folder, checked."""
    with chromium().opened(f"{address}#plan", size) as tab:
        wait(tab, "document.querySelector('#plan-open optgroup')")
        give(tab, "document.getElementById('plan-open')", file)
        wait(tab, "document.querySelector('#plan-table tbody tr')")
        yield tab


def joint(number: int, kind: str = "range", place: str = "plan") -> str:
    return f"document.querySelector('#{place}-joints [data-joint=\"{number - 1}\"] input[type={kind}]')"


def test_u_follows_a_joint_and_undo_takes_it_back(address: str) -> None:
    with plan(address, "plan.yaml") as tab:
        before, verdict = tab.value(U2), tab.value(VERDICT)
        assert before.endswith("°")
        give(tab, joint(2), float(tab.value(f"{joint(2)}.value")) + 8)
        wait(tab, f"{U2} !== {before!r}")
        assert tab.value(SAVED) == "Changes are not saved."
        tab.value("document.getElementById('plan-undo').click()")
        wait(tab, f"{U2} === {before!r}")
        assert tab.value(VERDICT) == verdict
        assert tab.console == []


@pytest.mark.long
def test_u_follows_the_target_and_the_tolerance_of_the_geometry(address: str) -> None:
    target = "document.querySelector('#plan-targets input')"
    with plan(address, "plan.yaml") as tab:
        before = tab.value(U2)
        give(tab, target, float(tab.value(f"{target}.value")) + 300)
        wait(tab, f"{U2} !== {before!r} && !document.querySelector('.pending')")
        moved = tab.value(U2)
        tab.value("document.getElementById('plan-geometry').click()")
        wait(tab, f"{U2} !== {moved!r} && !document.querySelector('.pending')")
        usual = tab.value(U2)
        give(tab, "document.querySelector('[data-tolerance=length_mm]')", 0.3)
        wait(tab, f"{U2} !== {usual!r}")
        assert tab.console == []


@pytest.mark.long
def test_a_slider_is_moved_by_keys(address: str) -> None:
    with plan(address, "plan.yaml") as tab:
        before = tab.value(f"{joint(3, 'number')}.value")
        tab.value(f"{joint(3)}.focus()")
        tab.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowRight", windowsVirtualKeyCode=39)
        wait(tab, f"{joint(3, 'number')}.value !== {before!r}")


def test_what_is_not_determined_has_no_number_and_the_arm_moves_along_it(address: str) -> None:
    with plan(address, "x.yaml") as tab:
        assert tab.value(VERDICT).startswith("Degenerate.")
        assert tab.value(U2) == "not determined"
        assert "To do: " in tab.text
        drawn = "document.getElementById('scene-caption').textContent"
        assert "null-space" not in tab.value(drawn)
        tab.value("document.querySelector('[data-direction]').click()")
        wait(tab, f"{drawn}.includes('moves along the null-space direction')")
        assert tab.value("document.querySelector('[data-direction]').getAttribute('aria-pressed')") == "true"


def test_an_error_stands_at_its_posture_and_takes_the_numbers_away(address: str) -> None:
    with plan(address, "plan.yaml") as tab:
        give(tab, joint(2, "number"), 900)
        wait(tab, "document.querySelector('#postures li:first-child .error')")
        assert "outside its limits" in tab.value("document.querySelector('#postures .error').textContent")
        assert tab.value(VERDICT).startswith("Not checked.")
        assert tab.value(U2) == "—"
        tab.value("document.getElementById('plan-undo').click()")
        wait(tab, f"{U2} !== '—'")
        assert tab.value("document.querySelectorAll('#plan .error').length") == 0


@pytest.mark.long
def test_postures_are_added_removed_and_saved(address: str, folder: Path) -> None:
    with plan(address, "plan.yaml") as tab:
        postures = "document.querySelectorAll('#postures li').length"
        tab.value("document.getElementById('posture-add').click()")
        assert tab.value(postures) == 8
        tab.value("document.getElementById('posture-copy').click()")
        tab.value("document.getElementById('posture-remove').click()")
        assert tab.value(postures) == 8
        give(tab, "document.getElementById('plan-file')", "new.yaml")
        tab.value("document.getElementById('plan-save').click()")
        wait(tab, f"{SAVED} === 'Saved as new.yaml.'")
    assert len(read_plan(folder / "new.yaml").postures) == 8
    assert len(read_plan(folder / "plan.yaml").postures) == 7


@pytest.mark.long
def test_a_plan_is_begun_with_a_robot(address: str) -> None:
    with chromium().opened(f"{address}#plan") as tab:
        wait(tab, "document.querySelector('#plan-begin optgroup')")
        give(tab, "document.getElementById('plan-begin')", "irb1600")
        wait(tab, "document.querySelector('#plan-table tbody tr')")
        assert not tab.value(VERDICT).startswith("Not checked")
        assert tab.console == []


@pytest.mark.long
def test_the_pose_follows_the_joints_of_a_robot(address: str) -> None:
    with chromium().opened(f"{address}#robot") as tab:
        wait(tab, "document.querySelector('#robot-pose td')")
        pose = "document.getElementById('robot-pose').innerText.replaceAll('\\u00a0', ' ')"
        before = tab.value(pose)
        assert "−817.20 mm, −232.90 mm, 62.80 mm" in before
        give(tab, joint(1, place="robot"), 90)
        wait(tab, f"{pose}.includes('232.90 mm, −817.20 mm, 62.80 mm')")
        assert tab.console == []


@pytest.mark.long
@pytest.mark.parametrize("size", SCREENS)
def test_the_place_robot_loads_from_the_server_alone_and_leaves_nobody_out(address: str, size: str) -> None:
    """The place Plan, opened up, is in test_plan_page.py."""
    with chromium().opened(f"{address}#robot", SCREENS[size]) as tab:
        wait(tab, "document.querySelector('#robot:not([hidden]) .joint')")
        assert (tab.accessibility(), tab.overflow(), tab.console) == ([], 0, [])
        assert tab.asked
        assert [url for url in tab.asked if not url.startswith(root(address))] == []
