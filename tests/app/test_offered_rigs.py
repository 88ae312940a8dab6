"""What the step Measure offers of a plan: what `run` would refuse is not there."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from command_line import zerobeam
from starlette.testclient import TestClient

LASER = {"kind": "laser", "calibrated": False, "point_mm": [0, 0, 65], "direction": [1, 0, 0]}
BEAM = {"tool": LASER, "targets": {"psd": {"guess_mm": [450, 0, 70], "sigma_mm": 30}}}
TRACKER = {"instruments": {"tracker": {"kind": "tracker", "sigma_mm": 0.05, "reflectors": {"r1": {}}}}}
ALL = ["simulated", "manual", "ros", "abb"]
SERVO = {"--adaptive", "--tolerance", "--repeat", "--gain"}


def offered(client: TestClient, root: Path, robot: str, more: dict[str, Any]) -> dict[str, set[str]]:
    """The rigs, and the options of each."""
    content = {
        "schema": "zerobeam/plan/1",
        "robot": robot,
        "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
        "postures_deg": [[5, -40, -51, 10, 20, 30], [-5, -40, -20, 0, 30, 60]],
        **more,
    }
    (root / "own.yaml").write_text(yaml.safe_dump(content))
    rigs = client.get("/api/plan", params={"file": "own.yaml"}).json()["rigs"]
    return {rig["name"]: {field["flag"] for field in rig["fields"]} for rig in rigs}


@pytest.mark.parametrize(
    ("robot", "more", "rigs", "servo"),
    [
        ("irb1600", BEAM, ALL, True),
        ("lrmate_200id", BEAM, ["simulated", "manual", "fanuc", "ros"], True),  # no ABB robot
        (
            "ur5e",
            TRACKER,
            ["simulated", "manual", "ur", "ros"],
            False,
        ),  # no beam for a servo, a camera or an adaptive order
    ],
)
def test_a_rig_is_offered_to_a_plan_that_it_can_carry_out(
    client: TestClient, root: Path, robot: str, more: dict[str, Any], rigs: list[str], servo: bool
) -> None:
    options = offered(client, root, robot, more)
    assert list(options) == rigs
    for rig, flags in options.items():
        assert (flags & {*SERVO, "--closing"}) == ({*SERVO, "--closing"} if servo else set()), rig
        assert ("--rig" in flags) == (rig in ("ur", "ros", "fanuc"))  # the address of its controller
        assert ("--host" in flags) == (rig == "abb")
        assert ("--units" in flags) == (rig == "manual")
    of_simulation = {"--cell", "--camera", "--seed"} if servo else {"--seed"}
    assert of_simulation <= options["simulated"]
    assert not {flag for rig in rigs[1:] for flag in options[rig]} & {"--cell", "--camera", "--seed"}


def test_the_command_line_refuses_what_is_not_offered(client: TestClient, root: Path) -> None:
    assert "--adaptive" not in offered(client, root, "ur5e", TRACKER)["simulated"]
    refused = zerobeam("run", root / "own.yaml", "-o", root / "own.jsonl", "--adaptive")
    assert (refused.status, "tracker" in refused.err) == (2, True), refused.err
    assert not (root / "own.jsonl").exists()
