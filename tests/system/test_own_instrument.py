"""The page on an instrument of one's own, followed literally: a package with its class and entry point."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from documents import blocks, prepare, read
from ruamel.yaml import YAML
from scipy.optimize import least_squares

from zerobeam.model.files.robot_file import load_robot

PAGE = read("docs/how-to/own-instrument.md")
OFFSETS = np.radians([0.0, 0.3, -0.4, 0.25, -0.2, 0.0])
MARK, EYE = np.array([1180.0, 320.0, 210.0]), np.array([10.2, 19.7, 30.1])
COUNT = 24


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """The page's package, as pip would have installed it."""
    prepare(PAGE, tmp_path)
    (entry,) = (block.text for block in blocks(PAGE) if "entry-points" in block.text)
    named = tmp_path / "zerobeam_camera-1.0.dist-info"
    named.mkdir()
    (named / "METADATA").write_text("Metadata-Version: 2.1\nName: zerobeam-camera\nVersion: 1.0\n")
    group, line = entry.split("\n", 1)
    assert group == '[project.entry-points."zerobeam.instruments"]'
    (named / "entry_points.txt").write_text("[zerobeam.instruments]\n" + line.replace('"', ""))
    return tmp_path


def seen_from(robot, q):
    """The mark as the camera has it before it, mm, at true joint positions."""
    pose = robot.fk(q, unit="rad")
    return pose[:3, :3].T @ (MARK - pose[:3, 3]) - EYE


def write(path: Path, wrong_mm: float = 0.0) -> None:
    """A run of the page's header, of an arm with OFFSETS; of half the pictures the mark is elsewhere."""
    (header,) = (
        YAML(typ="safe").load(block.text) for block in blocks(PAGE) if "robot: irb1600" in block.text
    )
    (shot,) = (json.loads(block.text) for block in blocks(PAGE) if block.language == "json")
    rng, robot = np.random.default_rng(3), load_robot("irb1600", Path())
    lines = [{"schema": "zerobeam/run/1", "geometry": "exact", **header}]
    while len(lines) <= COUNT:
        aside = rng.normal(size=2) * 100
        near = least_squares(
            lambda q, aside=aside: (seen_from(robot, q)[:2] - aside) / 100,
            rng.uniform(robot.lower, robot.upper) * 0.4,
        ).x
        inside = (near > robot.lower).all() and (near < robot.upper).all()
        if not inside or seen_from(robot, near)[2] < 200:
            continue
        x, y, z = seen_from(robot, near + rng.normal(size=6) * np.radians(0.005))
        pixels = 1000 * np.array([x + wrong_mm * (len(lines) % 2), y]) / z + rng.normal(size=2) * 0.1
        joints = np.degrees(near - OFFSETS)
        lines.append(
            shot | {"shot": len(lines), "joints_deg": joints.tolist(), "measured_mrad": pixels.tolist()}
        )
    path.write_text("\n".join(map(json.dumps, lines)) + "\n")


def analysed(run: Path, package: Path) -> dict[str, object]:
    program = "from zerobeam.cli import main; main()"
    command = [sys.executable, "-c", program, "analyse", str(run), "--ess", "200", "--json"]
    environment = os.environ | {"PYTHONPATH": str(package)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.stderr == "", done.stderr
    return json.loads(done.stdout)


@pytest.mark.long
def test_a_kind_of_another_package_is_analysed_as_ours_are(package: Path, tmp_path: Path) -> None:
    write(tmp_path / "run.jsonl")
    answer = analysed(tmp_path / "run.jsonl", package)
    assert answer["verdict"] != "misfit"
    for row, true in zip(answer["parameters"][1:5], np.degrees(OFFSETS[1:5]), strict=True):
        assert row["status"] in ("identified", "weak")
        assert abs(row["estimate"] - true) < 4 * row["std"]
    assert any(row["name"] == "eye.eye.x" for row in answer["parameters"])


@pytest.mark.long
def test_pictures_of_something_else_are_a_misfit(package: Path, tmp_path: Path) -> None:
    write(tmp_path / "run.jsonl", wrong_mm=5.0)
    assert analysed(tmp_path / "run.jsonl", package)["verdict"] == "misfit"
