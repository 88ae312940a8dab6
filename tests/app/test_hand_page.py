"""A run by hand of an instrument that is read off, in the browser of a tablet at the robot."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from app_page import SCREENS, app, wait
from chromium import Tab, chromium

from zerobeam.experiments.simulate import Truth, simulated_shots
from zerobeam.model.files.plan import read_plan
from zerobeam.model.files.run import read_run

pytestmark = pytest.mark.browser

POSTURES = [[0, 40, 20, 0, 30, 0], [20, 45, 10, 20, 35, 40], [-20, 35, 25, -20, 40, -40]]
PLAN = {
    "schema": "zerobeam/plan/1",
    "robot": "irb1600",
    "geometry": "exact",
    "instruments": {
        "it": {
            "kind": "tracker",
            "sigma_mm": 0.02,
            "guess_mm": [0, 3000, 1500],
            "reflectors": {"R1": {"guess_mm": [60, 0, 60]}, "R2": {"guess_mm": [-60, 20, 60]}},
        }
    },
    "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
    "postures_deg": [
        {"joints_deg": joints, "reflector": reflector}
        for joints, reflector in zip(POSTURES, ("R1", "R2", "R1"), strict=True)
    ],
}
ASKED = "document.querySelector('.asked-title').textContent"
READING = "Position of the reflector x, y, z (mm)"
IN_HAND = "document.querySelector('.hand').textContent"


def fill(tab: Tab, label: str, value: str) -> None:
    tab.on(lambda page: page.get_by_label(label, exact=True).fill(value))


def press(tab: Tab, name: str) -> None:
    tab.on(lambda page: page.get_by_role("button", name=name, exact=True).tap())


@pytest.mark.long
def test_what_a_tracker_reads_is_entered_as_it_is_asked_for(tmp_path: Path) -> None:
    """In the pendant's counting and in the instrument's order; what could be misread is not sent."""
    (tmp_path / "cell").mkdir()
    (tmp_path / "cell" / "plan.yaml").write_text(yaml.safe_dump(PLAN))
    plan = read_plan(tmp_path / "cell" / "plan.yaml")
    rng = np.random.default_rng(3)
    shots = list(simulated_shots(Truth.drawn(plan, rng), rng))
    on_pendant = [[*row[:2], row[2] - row[1], *row[3:]] for row in (shot.joints_deg for shot in shots)]
    joints = [" ".join(f"{value:.4f}" for value in row) for row in on_pendant]
    points = [np.array(shot.readings["measured_mm"]) for shot in shots]
    with (
        app(tmp_path) as served,
        chromium().opened(f"{served.address}#/job/cell/measure", SCREENS["tablet"]) as tab,
    ):
        wait(tab, "document.querySelector('form.start button.main:not(:disabled)')")
        tab.on(lambda page: page.get_by_label("By hand", exact=True).tap())
        tab.on(lambda page: page.get_by_label("Joint 3 is counted from").select_option("ground"))
        fill(tab, "Run file", "cell/hand.jsonl")
        press(tab, "Start")
        wait(tab, f"document.querySelector('.hand') && {ASKED}.includes('Measurement 0')")
        assert tab.value(ASKED) == "Measurement 0 (0 of 3 done), reflector R1"
        shown = tab.value("[...document.querySelectorAll('.asked li')].map((row) => row.textContent)")
        assert shown == ["J1 0.00°", "J2 40.00°", "J3 −20.00°", "J4 0.00°", "J5 30.00°", "J6 0.00°"]

        fill(tab, READING, " ".join(f"{value / 1000:.6f}" for value in points[0]))
        tab.on(lambda page: page.locator("#hand-line").fill(joints[0]))
        press(tab, "Record")
        wait(tab, f"{IN_HAND}.includes('this looks like metres')")
        press(tab, "They are metres")
        wait(tab, f"{ASKED} === 'Measurement 1 (1 of 3 done), reflector R2'")

        tab.on(lambda page: page.locator("#hand-line").fill(joints[1]))
        press(tab, "Record")
        wait(tab, f"{IN_HAND}.includes('The joint values are taken.')")
        wait(tab, f"document.activeElement.closest('label')?.textContent === {json.dumps(READING)}")
        assert (tab.accessibility(), tab.overflow()) == ([], 0)
        fill(tab, READING, "1,234 20 300")
        press(tab, "Record")
        wait(tab, f"{IN_HAND}.includes('allowed are 3 numbers')")
        fill(tab, READING, " ".join(f"{value:.4f}".replace(".", ",") for value in points[1]))
        press(tab, "Record")
        wait(tab, f"{ASKED}.startsWith('Measurement 2 (2 of 3 done)')")
        press(tab, "Skip this posture")
        wait(tab, "!document.querySelector('.stop-bar') && document.querySelector('.now')")
        assert tab.console == []
    run = read_run(tmp_path / "cell" / "hand.jsonl")
    assert [shot.shot for shot in run.shots] == [0, 1]
    for shot, row, point in zip(run.shots, shots, points, strict=False):
        np.testing.assert_allclose(shot.joints_deg, row.joints_deg, atol=1e-4)
        np.testing.assert_allclose(shot.readings["measured_mm"], point, atol=1e-3)
