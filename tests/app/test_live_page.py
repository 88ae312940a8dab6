"""A run whose joints are read from a controller, in the browser; the addresses that the server takes."""

from __future__ import annotations

from pathlib import Path

import pytest
from app_page import app, wait
from chromium import LAPTOP, Tab, chromium
from live_controllers import LiveArm, UrStandIn
from starlette.testclient import TestClient

from zerobeam.app.server.answers.forms import run_forms
from zerobeam.experiments.rigs.at_rest import SCHEMES
from zerobeam.model.files.run import read_run

AT = [20.0, -80.0, 70.0, -40.0, 60.0, 10.0]
PLAN = (
    "schema: zerobeam/plan/1\nrobot: ur5e\ngeometry: exact\n"
    "tool: {kind: probe, point_mm: [0, 0, 120]}\n"
    "noise: {joint_deg: 0.01, spot_mm: 0.05}\ntargets: {socket: {guess_mm: [500, 0, 0], sigma_mm: 900}}\n"
    f"postures_deg:\n  - {AT}\n  - {[value + 20 for value in AT]}\n"
)
ASKED = "(document.querySelector('.asked-title')?.textContent ?? '')"
DOUBT = "(document.querySelector('#hand-doubt')?.textContent ?? '')"


@pytest.mark.parametrize("vendor", [None, "universal-robots", "abb"])
def test_the_protocols_are_those_of_the_rigs_for_the_arm(vendor: str | None) -> None:
    forms = run_forms(["live"], vendor, servo=True, closing=True)
    fit = {name: one for name, one in SCHEMES.items() if vendor is None or one.vendor in (None, vendor)}
    assert {form.name: form.vendor for form in forms} == {name: one.vendor for name, one in fit.items()}
    for form in forms:
        address = form.fields[0]
        assert (address.flag, address.before, address.required) == ("--rig", f"{form.name}://", True)
        told = [f"usual: {fit[form.name].port}", *(f"{one}=" for one in fit[form.name].options)]
        assert all(words in address.help for words in told)


@pytest.mark.parametrize(
    ("rig", "what"),
    [
        ("http://10.0.0.1", "the scheme of this address is not known"),
        ("ur://", "this is not the address of a controller"),
        ("ur://user@10.0.0.1", "this is not the address of a controller"),
        ("ur://10.0.0.1/path", "this is not the address of a controller"),
        ("ur://10.0.0.1?topic=/a", "topic is not an option of ur://"),
        ("replay", "the app does not carry out this command"),
    ],
)
def test_what_is_no_address_of_a_controller_is_refused(
    client: TestClient, root: Path, rig: str, what: str
) -> None:
    (root / "live.yaml").write_text(PLAN)
    command = ["run", f"--rig={rig}", "--out=new.jsonl", "live.yaml"]
    answer = client.post("/api/jobs", json={"command": command})
    assert (answer.status_code, answer.json()["error"]["what"]) == (400, what)
    assert not (root / "new.jsonl").exists()


def press(tab: Tab, name: str) -> None:
    tab.on(lambda page: page.get_by_role("button", name=name, exact=True).click())


@pytest.mark.browser
def test_joints_are_read_where_the_person_confirms_and_a_moving_arm_is_refused(tmp_path: Path) -> None:
    (tmp_path / "cell").mkdir()
    (tmp_path / "cell" / "plan.yaml").write_text(PLAN)
    run = tmp_path / "cell" / "live.jsonl"
    with (
        UrStandIn(LiveArm([value + 1.5 for value in AT])) as server,
        app(tmp_path) as served,
        chromium().opened(f"{served.address}#/job/cell/measure", LAPTOP) as tab,
    ):
        wait(tab, "document.querySelector('form.start button.main:not(:disabled)')")
        tab.on(lambda page: page.get_by_label("joints read from the controller: Universal Robots").click())
        wait(tab, "document.querySelector('form.start button.main:disabled')")  # no address was typed
        where = f"{server.url.removeprefix('ur://')}?arm={server.serial}&dashboard={server.dashboard.port}"
        tab.on(lambda page: page.get_by_label("Controller’s address").fill(where))
        tab.on(lambda page: page.get_by_label("Run file", exact=True).fill("cell/live.jsonl"))
        press(tab, "Start: connects to the controller")
        wait(tab, f"{ASKED}.includes('Measurement 0 ')", 60)
        assert tab.value("document.querySelector('#hand-line')") is None  # nothing is typed
        server.arm.go([value + 7.5 for value in AT], 60.0)
        press(tab, "Record")
        wait(tab, f"{DOUBT}.includes('Not recorded')", 60)
        assert "mov" in tab.value(DOUBT)
        server.arm.go([value + 1.5 for value in AT], 0.0)
        press(tab, "Record")
        wait(tab, f"{ASKED}.includes('Measurement 1 ')", 60)
        press(tab, "Go on later")
        again = "document.querySelector('[aria-label=\"Resume cell/live.jsonl\"]')"
        wait(tab, f"{again}?.disabled", 60)  # the address is typed anew
        tab.on(
            lambda page: page.get_by_label("Address of the controller, for cell/live.jsonl").fill(
                f"ur://{where}"
            )
        )
        wait(tab, f"{again} && !{again}.disabled")
        press(tab, "Resume cell/live.jsonl")
        wait(tab, f"{ASKED}.includes('Measurement 1 ')", 60)
        press(tab, "Go on later")
        wait(tab, f"{again}?.disabled", 60)
    (shot,) = read_run(run).shots
    assert shot.joints_deg == pytest.approx([value + 1.5 for value in AT], abs=1e-6)
    assert read_run(run).header.provenance["controller"] == "ur 20215500123"
