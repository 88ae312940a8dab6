"""`zerobeam export …`: what is written, what is refused, and that nothing is overwritten or half written."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import pattern_plan, simulated
from command_line import zerobeam
from export_runs import TRUTH, arm_run, saved, urdf_run

from zerobeam.experiments.makers.abb import rapid_text
from zerobeam.experiments.makers.abb.moc_offsets import Gears, moc_text
from zerobeam.experiments.makers.calibration import RobotCalibration, calibration
from zerobeam.experiments.makers.generic.robot_files import robot_text, urdf_text
from zerobeam.experiments.makers.generic.written_tables import csv_text, json_text
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import Run
from zerobeam.model.kernel import compiled_at_once
from zerobeam.model.records import to_json

TEXTS: dict[str, Callable[[Run, RobotCalibration], str]] = {
    "urdf": urdf_text,
    "moc": lambda _, answer: moc_text(answer, Gears()),
    "rapid": lambda _, answer: rapid_text(answer),
    "json": lambda _, answer: json_text(answer),
    "csv": lambda _, answer: csv_text(answer),
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return urdf_run(tmp_path_factory.mktemp("arm"))


@pytest.fixture(autouse=True)
def same_kernels() -> Iterator[None]:
    """A kernel that is compiled between a command and what it is compared with changes the last digits."""
    with compiled_at_once():
        yield


@pytest.fixture(scope="module")
def poor(tmp_path_factory: pytest.TempPathFactory) -> Run:
    plan = pattern_plan("x")
    return saved(tmp_path_factory.mktemp("poor"), plan.header, simulated(plan, TRUTH, 2)[1])


def _to_twelve_digits(answer: object) -> Any:
    """What is exported beside the estimate is computed by another way, alike but for the last digit."""
    return json.loads(json.dumps(answer), parse_float=lambda number: f"{float(number):.12g}")


@pytest.mark.parametrize("what", TEXTS)
@pytest.mark.at_length(r"^urdf")
def test_the_file_is_the_text(what: str, run: Run, tmp_path: Path) -> None:
    file = tmp_path / "out"
    told = zerobeam("export", what, run.path, "-o", file)
    assert told.status == 0
    assert file.read_bytes() == TEXTS[what](run, calibration(run)).encode()
    assert "delta1 (j1): HELD at 0" in told.out
    assert "Written to" in told.out
    for text in (file.read_text(encoding="utf-8"), told.out):
        assert "Do ONE of these, never both: enter the values" in text
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    again = zerobeam("export", what, run.path, "-o", tmp_path / "two", "--json")
    assert _to_twelve_digits(again.json) == _to_twelve_digits(to_json(calibration(run)))


def test_a_robot_file_is_written_and_read_again(run: Run, tmp_path: Path) -> None:
    rows = arm_run(tmp_path)
    told = zerobeam("export", "robot", rows.path, "-o", tmp_path / "corrected.yaml")
    # How the arm is mounted and counted goes along.
    assert load_robot(tmp_path / "corrected.yaml").conventions == rows.robot.conventions
    assert told.status == 0
    assert (tmp_path / "corrected.yaml").read_bytes() == robot_text(rows, calibration(rows)).encode()
    robot = load_robot(tmp_path / "corrected.yaml")
    offsets = np.array([offset.applied for offset in calibration(rows).offsets])
    q = np.array([10.0, -20, 30, 40, 50, 60])
    np.testing.assert_allclose(robot.fk(q, "deg"), rows.robot.fk(q + offsets, "deg"), atol=1e-9)
    refused = zerobeam("export", "robot", run.path, "-o", tmp_path / "two.yaml").refused()
    assert "no Denavit-Hartenberg rows" in " ".join(refused.split())
    assert "zerobeam export urdf" in " ".join(refused.split())


@pytest.mark.parametrize("what", TEXTS)
def test_nothing_is_overwritten(what: str, run: Run, tmp_path: Path) -> None:
    file = tmp_path / "out"
    file.write_text("mine")
    assert "exists already" in zerobeam("export", what, run.path, "-o", file).refused()
    assert file.read_text() == "mine"
    assert "exists already" in zerobeam("export", what, run.path, "-o", run.path).refused()


@pytest.mark.parametrize("what", TEXTS)
@pytest.mark.one_in(5)
def test_what_is_refused_leaves_no_file(what: str, poor: Run, tmp_path: Path) -> None:
    file = tmp_path / "out"
    told = zerobeam("export", what, poor.path, "-o", file, "--allow-weak").refused()
    assert "delta2 cannot be exported" in told
    assert "--without delta2" in told
    weak = zerobeam("export", what, poor.path, "-o", file, "--without", "delta2").refused()
    assert "--allow-weak" in weak
    assert not list(tmp_path.iterdir())


def test_weak_ones_that_are_allowed(poor: Run, tmp_path: Path) -> None:
    file = tmp_path / "out.csv"
    options = ("--allow-weak", "--without", "delta2")
    assert zerobeam("export", "csv", poor.path, "-o", file, *options).status == 0
    assert ",weak,yes," in file.read_text()


def test_a_diff_against_the_controllers_file(run: Run, tmp_path: Path) -> None:
    against, file = tmp_path / "MOC.cfg", tmp_path / "moc.diff"
    motors = "".join(f'      -name "rob2_{i}" -cal_offset 1 -valid_cal_offset\n' for i in range(1, 7))
    against.write_text(f"MOC:CFG_1.0:6:0::\n#\nMOTOR_CALIB:\n\n{motors}")
    options = ("--against", against, "--unit", "rob2", "--ratio", "100,-100,90,50,50,-40")
    assert "sign must be stated" in zerobeam("export", "moc", run.path, "-o", file, *options).refused()
    told = zerobeam("export", "moc", run.path, "-o", file, *options, "--motor-sign", "-1")
    assert told.status == 0
    over = zerobeam("export", "moc", run.path, "-o", against, *options, "--motor-sign", "-1", "--force")
    assert "would be lost" in over.refused()
    assert file.read_text() == moc_text(
        calibration(run), Gears([100, -100, 90, 50, 50, -40], [-1] * 6), against, "rob2"
    )
    assert "\n+      -name" in file.read_text()


def test_options_of_another_tool_are_bad_usage(run: Run, tmp_path: Path) -> None:
    assert zerobeam("export", "csv", run.path, "-o", tmp_path / "a", "--against", run.path).status == 2
    assert (
        "--without names"
        in zerobeam("export", "csv", run.path, "-o", tmp_path / "a", "--without", "delta9").refused()
    )


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("staubli", ["not worked out here (arm.cfx holds", "export robot, export urdf"]),
        ("kawasaki", ["not worked out here", "ZZERO"]),
        ("denso", ["not worked out here", "CALSET"]),
        ("franka", ["not worked out here", "allowed: export robot, export urdf"]),
        ("abb", ["has another name", "export moc, export rapid"]),
    ],
)
def test_a_maker_without_a_file_of_offsets_has_a_way(name: str, words: list[str], tmp_path: Path) -> None:
    refused = " ".join(zerobeam("export", name, "run.jsonl", "-o", tmp_path / "out").refused().split())
    assert all(word in refused for word in words)
