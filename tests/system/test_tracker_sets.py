"""Tracker sets with faults, from the file to the message: outliers, and joints that never move."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from command_line import zerobeam
from measured_arms import SIGMA_MM, Cell, recorded, tracker

from zerobeam.analysis.ladder import solve_run
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import read_run
from zerobeam.model.kernel import one_blas_thread
from zerobeam.model.likelihood.problem import Problem

JOINT_DEG = 0.005
TRACKER = {"leica": tracker()}
REFLECTORS = TRACKER["leica"]["reflectors"]
ONE_EACH = tuple((("leica", name, None),) for name in REFLECTORS)
SEVEN = """\
schema: zerobeam/robot/1
name: seven
convention: standard
joints:
  - {a_mm: 0, alpha_deg: -90, d_mm: 340, theta_deg: 0, lower_deg: -170, upper_deg: 170}
  - {a_mm: 0, alpha_deg: 90, d_mm: 0, theta_deg: 0, lower_deg: -170, upper_deg: 170}
  - {a_mm: 0, alpha_deg: 90, d_mm: 400, theta_deg: 0, lower_deg: -170, upper_deg: 170}
  - {a_mm: 0, alpha_deg: -90, d_mm: 0, theta_deg: 0, lower_deg: -170, upper_deg: 170}
  - {a_mm: 0, alpha_deg: -90, d_mm: 400, theta_deg: 0, lower_deg: -170, upper_deg: 170}
  - {a_mm: 0, alpha_deg: 90, d_mm: 0, theta_deg: 0, lower_deg: -170, upper_deg: 170}
  - {a_mm: 0, alpha_deg: 0, d_mm: 126, theta_deg: 0, lower_deg: -170, upper_deg: 170}
"""


def run_file(path: Path, robot: str, joints: np.ndarray, measured: list[dict[str, object]]) -> Path:
    """A run of an exact arm at `joints` (N, n) rad."""
    header = {
        "schema": "zerobeam/run/1",
        "robot": robot,
        "instruments": TRACKER,
        "noise": {"joint_deg": JOINT_DEG},
        "geometry": "exact",
    }
    rows = [
        {"shot": i, "joints_deg": np.degrees(q).tolist(), **one}
        for i, (q, one) in enumerate(zip(joints, measured, strict=True))
    ]
    path.write_text("\n".join(map(json.dumps, [header, *rows])) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("loss", ["student", pytest.param("huber", marks=pytest.mark.long)])
@pytest.mark.long
def test_two_percent_of_outliers_are_found_and_said(loss: str, tmp_path: Path) -> None:
    rng, count = np.random.default_rng(2), 150
    arm = recorded(Cell(TRACKER, {}, ONE_EACH), count, rng, exact=True, joint_deg=JOINT_DEG, lost_deg=0.0)
    measured = [
        {"reflector": one.variant, "measured_mm": np.array(one.measured["measured_mm"])}
        for (one,) in arm.measured
    ]
    off = sorted(rng.choice(count, count // 50, replace=False).tolist())
    for i in off:
        way = rng.normal(size=3)
        measured[i]["measured_mm"] += rng.uniform(5, 20) * way / np.linalg.norm(way)
    rows = [one | {"measured_mm": one["measured_mm"].tolist()} for one in measured]
    run = run_file(tmp_path / "run.jsonl", "irb1600", arm.joints, rows)
    answer = zerobeam("analyse", run, "--robust", loss)
    text = " ".join(answer.out.split())
    (named,) = re.findall(r"Outliers: (.*?)\. The", text) or re.findall(r"Outliers: (.*?)\. ", text)
    assert {int(number) for number in re.findall(r"(\d+) \(weight", named)} == set(off)
    assert "Most likely: single measurements." in text
    (dropped,) = re.findall(r"--drop ([\d,]+)", text)
    assert {int(number) for number in dropped.split(",")} == set(off)


@pytest.mark.parametrize("joints", [6, 7])
@pytest.mark.parametrize("moving", [True, False])
@pytest.mark.at_length(r"^(False|True-6)")
def test_joints_that_never_move_are_unidentifiable(joints: int, moving: bool, tmp_path: Path) -> None:
    """Of joints 3 to the last; where all move, only the last is not determined beside free reflectors."""
    rng, count = np.random.default_rng(4), 40
    name = "irb1600" if joints == 6 else "seven.yaml"
    (tmp_path / "seven.yaml").write_text(SEVEN, encoding="utf-8")
    robot = load_robot(name, tmp_path)
    q = rng.uniform(-0.8, 0.8, size=(count, joints))
    if not moving:
        q[:, 2:] = 0.4
    offsets = np.radians(0.3) * rng.normal(size=joints)
    true = robot.fk(q + offsets + np.radians(JOINT_DEG) * rng.normal(size=q.shape), unit="rad")
    measured = []
    for i, pose in enumerate(true):
        reflector = list(REFLECTORS)[i % 3]
        at = pose[:3, 3] + pose[:3, :3] @ np.array(REFLECTORS[reflector]["guess_mm"], dtype=float)
        position = at - [2500, -800, 300] + SIGMA_MM * rng.normal(size=3)
        measured.append({"reflector": reflector, "measured_mm": position.tolist()})
    run = run_file(tmp_path / "run.jsonl", name, q, measured)
    read = read_run(run)
    with one_blas_thread():
        solution = solve_run(Problem.from_run(read), read.header)
    status = [row.status for row in solution.offsets]
    assert set(status[2:-1]) <= ({"identified"} if moving else {"unidentifiable"})
    assert status[-1] in {"unidentifiable", "held"}
    assert solution.verdict == ("pass" if moving else "degenerate")
    if not moving:
        assert all(row.estimate is None for row in solution.offsets[2:-1])
