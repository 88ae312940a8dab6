"""`zerobeam plan` from a header to a checked file: what it writes, and what it refuses and why."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import LASER, header
from plan_requests import plan_request

from zerobeam.analysis.observability.check import check
from zerobeam.experiments.plans.make import MadePlan, make_plan
from zerobeam.model.errors import BadInput
from zerobeam.model.files.plan import Obstacles, read_plan
from zerobeam.words.sentences import to_json

OFFSETS = [f"delta{i}" for i in range(2, 7)]
PLANAR_ROBOT = """\
schema: zerobeam/robot/1
name: gantry arm
convention: standard
joints:
  - {kind: prismatic, a_mm: 0, alpha_deg: -90, d_mm: 300, theta_deg: 0, lower_mm: -300, upper_mm: 300}
  - {a_mm: 150, alpha_deg: -90, d_mm: 400, theta_deg: 0, lower_deg: -170, upper_deg: 170}
  - {a_mm: 500, alpha_deg: 0, d_mm: 0, theta_deg: -90, lower_deg: -90, upper_deg: 120}
  - {a_mm: 0, alpha_deg: 90, d_mm: 0, theta_deg: 180, lower_deg: -200, upper_deg: 65}
  - {a_mm: 0, alpha_deg: -90, d_mm: 400, theta_deg: 0, lower_deg: -180, upper_deg: 180}
  - {a_mm: 0, alpha_deg: 90, d_mm: 0, theta_deg: 0, lower_deg: -115, upper_deg: 115}
  - {a_mm: 0, alpha_deg: 0, d_mm: 0, theta_deg: 0, lower_deg: -300, upper_deg: 300}
"""


def made(file: Path, **changes: Any) -> MadePlan:
    return make_plan(plan_request(**changes), file, lambda stage, share: None)


@pytest.mark.parametrize("kind", ["x", "y", "optimal"])
@pytest.mark.one_in(3)
def test_a_plan_is_written_that_check_reads(kind: str, tmp_path: Path) -> None:
    file = tmp_path / "plan.yaml"
    answer = to_json(made(file, kind=kind))
    json.dumps(answer, allow_nan=False)
    plan = read_plan(file)
    again = check(plan)
    assert plan.postures.shape == (7, 6)
    assert answer["plan"] == "plan.yaml"
    assert answer["verdict"] == again.verdict == {"x": "degenerate", "y": "weak", "optimal": "pass"}[kind]
    stds = {row.name: row.std for row in again.parameters if row.name in OFFSETS}
    assert {name: answer["predicted_std"][name] for name in OFFSETS} == stds
    assert max(posture.off_mm for posture in again.postures) < 1e-3
    assert (stds["delta2"] is None) == (kind == "x")
    if kind == "optimal":
        assert 0.5 < answer["efficiency"] <= 1
        assert answer["candidates"] == 300
        assert answer["travel_s"] > 0
        assert re.match(r"300 of \d+ postures are left; ", answer["removed"])
    else:
        assert answer["efficiency"] is None
        assert answer["removed"] is None


def test_a_y_pattern_whose_line_is_stated(tmp_path: Path) -> None:
    """The best of docs/paper.md: a pass, where the usual one is weak."""
    line = {"distance_mm": 300.0, "height_mm": 700.0, "width_mm": 1600.0, "roll_deg": 0.0}
    answer = made(tmp_path / "plan.yaml", kind="y", target=(900.0, 100.0, 800.0), **line)
    assert answer.checked is not None
    assert answer.checked.verdict == "pass"
    assert max(row.std or 9 for row in answer.checked.parameters if row.name in OFFSETS) < 0.06


@pytest.mark.long
def test_without_a_file_it_is_the_same_plan(tmp_path: Path) -> None:
    written = made(tmp_path / "plan.yaml")
    plan = make_plan(plan_request(), None, lambda stage, share: None)
    assert plan.file is None
    assert plan.plan.sha256 == written.plan.sha256
    np.testing.assert_array_equal(plan.plan.postures, written.plan.postures)


def test_no_file_is_written_over(tmp_path: Path) -> None:
    file = tmp_path / "plan.yaml"
    file.write_text("mine")
    with pytest.raises(BadInput, match="exists"):
        made(file)
    assert file.read_text() == "mine"


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"target": (5000.0, 0.0, 0.0)}, r"found:.*\d+ "),
        ({"margin_deg": 200.0}, "margin"),
        ({"acceptance_deg": 0.0}, "argument acceptance_deg: the angle is out of range"),
        ({"beam_mm": (500.0, 400.0)}, "argument beam_mm: the lengths are out of order"),
        ({"facing": (0.0, 0.0, 0.0)}, "argument facing: this direction has no length"),
        ({"shots": 20, "candidates": 10}, r"too few postures to choose 20 measurements from"),
        ({"kind": "x", "target": (5000.0, 0.0, 0.0)}, "X-Pattern cannot be made"),
    ],
)
@pytest.mark.at_length(r"^changes6")
def test_what_cannot_be_is_refused_and_nothing_written(
    changes: dict[str, Any], expected: str, tmp_path: Path
) -> None:
    file = tmp_path / "plan.yaml"
    with pytest.raises(BadInput, match=expected):
        made(file, **changes)
    assert not file.exists()


@pytest.mark.long
def test_the_fewest_shots(tmp_path: Path) -> None:
    enough = to_json(made(tmp_path / "enough.yaml", shots=6))["predicted_std"]
    tolerance = 1.001 * max(enough[name] for name in OFFSETS)
    plan = made(tmp_path / "plan.yaml", tolerance=tolerance, max_shots=20, shots=99)
    answer = to_json(plan)
    assert answer["limit"] is None
    assert answer["shots"] == answer["curve"][-1]["shots"]
    assert max(answer["predicted_std"][name] for name in OFFSETS) <= tolerance * (1 + 1e-4)
    # One fewer is not enough: for the tolerance, or to notice wrong models.
    fewer = to_json(made(tmp_path / "fewer.yaml", tolerance=tolerance, max_shots=answer["shots"] - 1))
    assert (fewer["plan"], fewer["limit"] is None) == (None, False)


def test_a_tolerance_that_no_number_reaches(tmp_path: Path) -> None:
    file = tmp_path / "plan.yaml"
    answer = to_json(made(file, tolerance=0.001, max_shots=6))
    assert not file.exists()
    assert [answer[key] for key in ("plan", "verdict", "shots", "check")] == [None] * 4
    assert answer["predicted_std"] == {}
    assert "noise" in answer["limit"]
    assert re.search(r"some \d+ would be needed", answer["limit"])
    assert [point["shots"] for point in answer["curve"]][-1] == 6


def test_a_gauge_is_the_limit(tmp_path: Path) -> None:
    """With delta1 freed no number of shots will do."""
    own = header(LASER, target=None, held=[])
    answer = to_json(made(tmp_path / "plan.yaml", header=own, tolerance=0.02, max_shots=6))
    assert "delta1" in answer["limit"]
    assert "almost no information" in answer["limit"]


def test_a_header_with_another_target_is_refused(tmp_path: Path) -> None:
    own = header(LASER, target=None, targets={"ball": {"guess_mm": [1, 2, 3]}})
    with pytest.raises(BadInput, match="states other targets"):
        made(tmp_path / "plan.yaml", header=own)
    # Its own target may be there: what is known of it stays, the place is that of --target.
    own = header(LASER, target=None, targets={"psd": {"guess_mm": [1, 2, 3], "sigma_mm": 50}})
    made(tmp_path / "plan.yaml", header=own)
    stated = read_plan(tmp_path / "plan.yaml").header.targets["psd"]
    assert stated.guess_mm == (900.0, 0.0, 0.0)
    assert stated.sigma_mm == 50


@pytest.mark.long
def test_another_robot_and_its_path_as_seen_from_the_plan(tmp_path: Path) -> None:
    """Seven joints, the first prismatic; the robot file stands beside the header, the plan elsewhere."""
    (tmp_path / "cell").mkdir()
    (tmp_path / "plans").mkdir()
    (tmp_path / "cell" / "arm.yaml").write_text(PLANAR_ROBOT)
    own = header(LASER, target=None, noise={"joint_mm": 0.02}).model_copy(update={"robot": "arm.yaml"})
    file = tmp_path / "plans" / "plan.yaml"
    answer = to_json(made(
        file, header=own, header_folder=tmp_path / "cell", target=(500.0, 300.0, 0.0), shots=8,
        facing=None, bodies=Obstacles(floor_mm=None),
    ))  # fmt: skip
    plan = read_plan(file)
    assert plan.robot.name == "gantry arm"
    assert plan.header.robot == "../cell/arm.yaml"
    assert plan.postures.shape == (8, 7)
    assert np.ptp(plan.postures[:, 0]) > 1.0
    assert answer["units"]["delta2"] == "deg"
    assert answer["travel_s"] is None


@pytest.mark.long
def test_the_same_seed_gives_the_same_file(tmp_path: Path) -> None:
    files = [tmp_path / f"{i}.yaml" for i in range(3)]
    for file, seed in zip(files, (4, 4, 5), strict=True):
        made(file, seed=seed)
    assert files[0].read_bytes() == files[1].read_bytes()
    assert files[0].read_bytes() != files[2].read_bytes()


def test_a_bound_that_did_not_converge_is_said(tmp_path: Path) -> None:
    plan = made(tmp_path / "plan.yaml")
    said = "The bound did not converge within its number of steps"
    assert plan.proposal is not None
    for converged in (True, False):
        own = replace(plan, proposal=replace(plan.proposal, converged=converged))
        assert any(line.startswith(said) for line in own.sentences) == (not converged)
        assert to_json(own)["converged"] is converged
