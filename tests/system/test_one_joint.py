"""Arms of one joint: nothing but the offset of joint 1, which measurements of one target do not determine."""

import json
from pathlib import Path
from typing import Any

import pytest
from command_line import zerobeam

from zerobeam.model import kernel
from zerobeam.model.likelihood import constraint

pytestmark = pytest.mark.filterwarnings("ignore::zerobeam.model.kernel.KernelWarning")
ROBOT = """schema: zerobeam/robot/1
name: one
convention: standard
joints:
  - {{kind: {kind}, a_mm: 400, alpha_deg: 10, d_mm: 100, theta_deg: 0, lower_{unit}: -170, upper_{unit}: 170}}
"""
JOINTS = (-20.0, -10.0, 0.0, 10.0, 20.0)


@pytest.fixture(autouse=True)
def without_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of these arms would be compiled for a few evaluations."""
    monkeypatch.setattr(kernel, "_compiler", lambda: None)
    monkeypatch.setattr(constraint, "_made", {})  # what is made in here stays in here


@pytest.fixture(params=["revolute laser", "revolute probe", "prismatic laser", "prismatic probe"])
def stated(request: pytest.FixtureRequest, tmp_path: Path) -> dict[str, Any]:
    """A header; its robot file is in the folder."""
    kind, tool = request.param.split()
    unit = "deg" if kind == "revolute" else "mm"
    (tmp_path / "one.yaml").write_text(ROBOT.format(kind=kind, unit=unit))
    return {
        "robot": "one.yaml",
        "tool": {"kind": tool, "point_mm": [0, 0, 65]}
        | ({"direction": [1, 0, 0]} if tool == "laser" else {}),
        "noise": {"joint_deg": 0.01, "spot_mm": 0.05} | ({"joint_mm": 0.01} if unit == "mm" else {}),
        "targets": {"psd": {"guess_mm": [900, 0, 100], "sigma_mm": 200}},
    }


def run_file(folder: Path, stated: dict[str, Any], name: str = "run.jsonl", **more: Any) -> Path:
    rows = [{"schema": "zerobeam/run/1", **stated, **more}]
    rows += [{"shot": i, "target": "psd", "joints_deg": [own]} for i, own in enumerate(JOINTS)]
    path = folder / name
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return path


@pytest.mark.parametrize("held", [None, []], ids=["held by default", "free"])
@pytest.mark.at_length(r"^(prismatic laser|revolute laser|revolute probe-free|prismatic probe-free)")
def test_no_offset_of_one_joint_is_told_as_known(
    stated: dict[str, Any], tmp_path: Path, held: list[str] | None
) -> None:
    run = run_file(tmp_path, stated, **({} if held is None else {"held": held}))
    answer = zerobeam("analyse", run, "--json", "--ess", 100)
    assert answer.status in (0, 1), answer.err
    (offset,) = [row for row in answer.json["parameters"] if row["group"] == "offset"]
    assert offset["held"] is (held is None)
    assert offset["status"] != "identified"
    assert offset["status"] == "held" or offset["std"] is None


@pytest.mark.parametrize("stated", ["revolute laser", "prismatic probe"], indirect=True)
@pytest.mark.long
def test_every_command_answers_or_refuses_in_one_message(stated: dict[str, Any], tmp_path: Path) -> None:
    run = run_file(tmp_path, stated)
    with_geometry = run_file(tmp_path, stated, "other.jsonl", geometry={})
    header, plan = tmp_path / "header.yaml", tmp_path / "plan.yaml"
    header.write_text(json.dumps(stated))
    postures = [[own] for own in JOINTS]
    plan.write_text(json.dumps({"schema": "zerobeam/plan/1", **stated, "postures_deg": postures}))
    assert zerobeam("analyse", with_geometry, "--ess", 100).status in (0, 1)
    assert zerobeam("export", "csv", run, "-o", tmp_path / "made.csv").status in (0, 1)
    robot = zerobeam("export", "robot", run, "-o", tmp_path / "no", "--unvalidated")
    assert "every offset is held" in robot.refused()
    assert "no offset to compare" in zerobeam("compare", run, with_geometry).refused()
    assert "can be rotated onto its target" in zerobeam("check", plan).refused()
    asked = ("--header", header, "--target", "900,0,100", "-o", tmp_path / "no", "--candidates", 10)
    zerobeam("plan", "x", *asked).refused()
    # A PSD that is out of view in most postures is refused before anything moves: here it is not.
    carried = zerobeam("run", plan, "-o", tmp_path / "no", "--no-camera", "--seed", 1)
    assert (carried.status, carried.err.count("error: ")) == (3, 1), carried.err
    assert "Traceback" not in carried.err
