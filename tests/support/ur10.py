"""The UR10 of Landgraf et al. (2021) with a 6D tracker: two series, imported as a person would.

Series A is a grid over the workspace, series B what a planner came to; they are of different sessions.
"""

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from command_line import Answer, zerobeam

from zerobeam.model.files.run import Run

FILES = {"A": "grid_every_eighth.csv", "B": "joint_configurations.csv"}
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
ROBOT = """\
schema: zerobeam/robot/1
name: UR10
convention: standard
joints:
  - {d_mm: 127.3, a_mm: 0, alpha_deg: 90, theta_deg: 0, lower_deg: -360, upper_deg: 360}
  - {d_mm: 0, a_mm: -612, alpha_deg: 0, theta_deg: 0, lower_deg: -360, upper_deg: 360}
  - {d_mm: 0, a_mm: -572.3, alpha_deg: 0, theta_deg: 0, lower_deg: -360, upper_deg: 360}
  - {d_mm: 163.941, a_mm: 0, alpha_deg: 90, theta_deg: 0, lower_deg: -360, upper_deg: 360}
  - {d_mm: 115.7, a_mm: 0, alpha_deg: -90, theta_deg: 0, lower_deg: -360, upper_deg: 360}
  - {d_mm: 92.2, a_mm: 0, alpha_deg: 0, theta_deg: 0, lower_deg: -360, upper_deg: 360}
"""
HEADER = """\
robot: ur10.yaml
instruments: {leica: {kind: tracker, frame: free, sigma_mm: 0.05, reflectors: {tmac: {}}}}
noise: {joint_deg: 0.01, scale: estimated}
geometry: {gravity: true, harmonics: true}
"""


def imported(data: Path, series: str, folder: Path) -> tuple[Answer, Path]:
    """What the import said, and the run with the whole ladder of the model."""
    if not (data / "ipa").is_dir():
        pytest.skip(f"no recordings of the UR10 at {data / 'ipa'}")
    (folder / "ur10.yaml").write_text(ROBOT, encoding="utf-8")
    header, run = folder / "header.yaml", folder / f"{series}.jsonl"
    header.write_text(HEADER, encoding="utf-8")
    answer = zerobeam(
        "import", "points", data / "ipa" / FILES[series],
        "--header", header,
        "--joint-columns", ",".join(f"{name}_joint" for name in JOINTS), "--joint-units", "rad",
        "--columns", "measurement_x,measurement_y,measurement_z", "--units", "mm",
        "--uncertainty", "none", "--decimal", ",",
        "-o", run,
    )  # fmt: skip
    return answer, run


def part(run: Path, rows: Sequence[int], name: str, **header: Any) -> Path:
    """A run file of some measurements of another, with other keys in its header."""
    first, *shots = run.read_text(encoding="utf-8").splitlines()
    stated = json.dumps({**json.loads(first), **header})
    path = run.with_name(f"{name}.jsonl")
    path.write_text("\n".join([stated, *(shots[i] for i in rows)]) + "\n", encoding="utf-8")
    return path


def some(run: Run, rows: Sequence[int]) -> Run:
    return dataclasses.replace(
        run, shots=tuple(run.shots[i] for i in rows), lines=tuple(run.lines[i] for i in rows)
    )
