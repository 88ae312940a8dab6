"""What the step Measure offers of a plan: what `run` would refuse is not there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from command_line import zerobeam
from starlette.testclient import TestClient

LASER = {"kind": "laser", "calibrated": False, "point_mm": [0, 0, 65], "direction": [1, 0, 0]}
BEAM = {"tool": LASER, "targets": {"psd": {"guess_mm": [450, 0, 70], "sigma_mm": 30}}}
TRACKER = {"instruments": {"tracker": {"kind": "tracker", "sigma_mm": 0.05, "reflectors": {"r1": {}}}}}
ALL = ["simulated", "manual", "live", "abb"]


def offered(client: TestClient, root: Path, robot: str, more: dict[str, Any]) -> dict[str, Any]:
    content = {
        "schema": "zerobeam/plan/1",
        "robot": robot,
        "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
        "postures_deg": [[5, -40, -51, 10, 20, 30], [-5, -40, -20, 0, 30, 60]],
        **more,
    }
    (root / "own.yaml").write_text(yaml.safe_dump(content))
    runs: dict[str, Any] = client.get("/api/plan", params={"file": "own.yaml"}).json()["runs"]
    return runs


@pytest.mark.parametrize(
    ("robot", "more", "rigs", "servo"),
    [
        ("irb1600", BEAM, ALL, True),
        ("lrmate_200id", BEAM, ALL[:3], True),  # no ABB robot
        ("ur5e", TRACKER, ALL[:3], False),  # no beam for a servo, a camera or an adaptive order
    ],
)
def test_a_rig_is_offered_to_a_plan_that_it_can_carry_out(
    client: TestClient, root: Path, robot: str, more: dict[str, Any], rigs: list[str], servo: bool
) -> None:
    runs = offered(client, root, robot, more)
    assert [rig["name"] for rig in runs["rigs"]] == rigs
    assert (runs["servo"], runs["closing"]) == (servo, servo)


def test_the_command_line_refuses_what_is_not_offered(client: TestClient, root: Path) -> None:
    assert not offered(client, root, "ur5e", TRACKER)["servo"]
    refused = zerobeam("run", root / "own.yaml", "-o", root / "own.jsonl", "--adaptive")
    assert (refused.status, "tracker" in refused.err) == (2, True), refused.err
    assert not (root / "own.jsonl").exists()
