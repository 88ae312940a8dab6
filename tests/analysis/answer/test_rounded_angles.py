"""A run of an arm whose file has a right angle rounded is no pass, and nothing is to be entered."""

from __future__ import annotations

import json
import math
import warnings
from pathlib import Path

import pytest
from command_line import zerobeam
from exact_runs import demo_runs

from zerobeam.model.kinematics.plausible import DoubtfulRobot


@pytest.mark.long
@pytest.mark.at_length(r"pass")
@pytest.mark.parametrize(("alpha_deg", "verdict"), [(-90.0, "pass"), (-math.degrees(1.57), "weak")])
def test_no_run_of_rounded_angles_passes(alpha_deg: float, verdict: str, tmp_path: Path) -> None:
    assert zerobeam("robot", "irb1600", "-o", tmp_path / "arm.yaml").status == 0
    text = (tmp_path / "arm.yaml").read_text()
    assert text.count("alpha_deg: -90") > 1
    (tmp_path / "arm.yaml").write_text(text.replace("alpha_deg: -90", f"alpha_deg: {alpha_deg:.7f}", 1))
    header, *shots = demo_runs()[0].path.read_text().splitlines()
    content = {k: v for k, v in json.loads(header).items() if k != "provenance"}
    run = tmp_path / "run.jsonl"
    run.write_text("\n".join([json.dumps(content | {"robot": "arm.yaml"}), *shots]) + "\n")
    with warnings.catch_warnings(action="ignore", category=DoubtfulRobot):
        answer = zerobeam("analyse", run, "--ess", 100, "--json").json
        printed = zerobeam("analyse", run, "--ess", 100).out
        exported = zerobeam("export", "rapid", run, "-o", tmp_path / "offsets.mod")
    assert answer["verdict"] == verdict
    assert answer["message"]["may"]["enter"] == answer["message"]["may"]["export"] == (verdict == "pass")
    assert (exported.status == 0) == (verdict == "pass")
    assert ("● yes" in printed) == (verdict == "pass")
    assert ("◆ no: see what is to be done" in printed) == (verdict == "weak")
    if verdict == "weak":
        (said,) = (note for note in answer["notes"] if "alpha_deg of joint" in note)
        assert "correct these angles" in answer["message"]["action"]["text"]
        assert said[1:] in answer["message"]["cause"]
        assert all(row["status"] == "identified" for row in answer["parameters"] if row["name"] == "delta2")
