"""SLIM: joint positions there and corrected, what is refused, and damaged programs."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import nachi_controller as controller
import numpy as np
import pytest
from damaged_files import joints_read, refused
from program_arm import PendantArm, plan_for
from recorded_logs import HEADER
from user_programs import OFFSETS, judged, read, varied

from zerobeam.experiments.makers.import_jobs import ImportJob
from zerobeam.experiments.makers.maker import makers
from zerobeam.experiments.makers.plan_programs import ProgramMotion, write_program
from zerobeam.experiments.makers.user_programs import corrected_program
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.robot import Robot

READER = next(each for maker in makers() for each in maker.read if each.name == "slim")
FILES = pytest.mark.parametrize("files", [20, pytest.param(200, marks=pytest.mark.long)])


@cache
def arm() -> Robot:
    with TemporaryDirectory() as folder:
        return load_robot(controller.robot_file(Path(folder)))


def program(rows: np.ndarray, line: str = "SET [01]") -> str:
    return controller.user_program(arm(), rows, line)


def joints(text: str) -> np.ndarray:
    return controller.commanded(text, arm(), np.empty(0))


def corrected(folder: Path, text: str) -> str:
    (folder / "in.slim").write_bytes(text.encode())
    return read(corrected_program(arm(), judged(arm()), folder / "in.slim", folder / "out.slim"))


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('REM "zb_p1', 'REM "p1'),
        ('REM "zb_p1', 'REM "zb_p2'),
        ('REM "zb_p1 psd"\r\n', ""),
        ("STOP\r\nREM", "STOP\r\nMOVEX M1J,P,(0,0,0,0,30,0),R=5.0,H=1,MS\r\nREM"),
        ("END", ""),
    ],
)
def test_remarks_must_name_the_positions_of_a_plan(tmp_path: Path, before: str, after: str) -> None:
    plan = plan_for(tmp_path, controller.robot_file(tmp_path), controller.TARGET, count=3)
    write_program("slim", plan, ProgramMotion(), tmp_path / "zb_plan.slim")
    saved = controller.carried_out(tmp_path / "zb_plan.slim", PendantArm(plan))
    text, read_joints = saved.read_bytes().decode(), joints_read("slim", plan, saved)
    assert sorted(read_joints(text)) == [0, 1, 2]
    assert before in text
    with pytest.raises(BadInput, match=r"do not name its positions|has no end"):
        read_joints(text.replace(before, after, 1))


def test_the_tool_is_a_number(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, controller.robot_file(tmp_path), controller.TARGET, count=1)
    write_program("slim", plan, ProgramMotion(tool="3"), tmp_path / "zb_plan.slim")
    assert ",H=3,MS" in (tmp_path / "zb_plan.slim").read_text()
    with pytest.raises(BadInput, match="--tool is the number of a tool"):
        write_program("slim", plan, ProgramMotion(tool="grip"), tmp_path / "other.slim")


@FILES
def test_damaged_recordings_are_refused_or_read_as_they_are(tmp_path: Path, files: int) -> None:
    plan = plan_for(tmp_path, controller.robot_file(tmp_path), controller.TARGET, count=4)
    write_program("slim", plan, ProgramMotion(), tmp_path / "zb_plan.slim")
    saved = controller.carried_out(tmp_path / "zb_plan.slim", PendantArm(plan))
    text = saved.read_bytes().decode()
    motions = [line for line in text.split("\r\n") if "MOVEX" in line]
    lines = dict(enumerate(motions))
    assert 0.3 * files < refused(joints_read("slim", plan, saved), text, lines, files) <= files


def test_joints_are_corrected_and_the_flange_is_where_it_is_meant(tmp_path: Path) -> None:
    rows = varied(arm(), 4)[[0, 0, 1, 1]]  # each line ends where it begins
    text = corrected(tmp_path, program(rows))
    true = arm().with_offsets(np.radians(OFFSETS))
    assert np.abs((true.fk(joints(text), "deg") - arm().fk(rows, "deg"))[:, :3, 3]).max() < 0.05
    assert np.abs((true.fk(rows, "deg") - arm().fk(rows, "deg"))[:, :3, 3]).max() > 1
    assert text.startswith("'zerobeam export program\r\n")


@pytest.mark.parametrize(
    "line",
    [
        "MOVEX A=1,AC=0,SM=0,M1X,L,(400,0,300,0,0,180),S=60.0,H=1,MS,CONF=0000",
        "MOVEX A=1,M1J,P,(0,0,0,0,30,0),R=5.0,H=1,MS,M2J,P,(10.0),R=5.0,H=1",
        "MOVEX A=1,M1J,C1,(0,0,0,0,30,0),R=5.0,H=1,MS",
        "MOVEX A=1,M1J,P,P1,R=5.0,H=1,MS",
        "MOVEX A=1,M1J,P,(0,0,0,0,30,V1!),R=5.0,H=1,MS",
        "MOVE P,P1,S=5,H=1",
        "P1 = (0,0,0,0,30,0)",
        "SHIFTR 1,10,0,0",
    ],
)
def test_what_is_not_understood_is_named(tmp_path: Path, line: str) -> None:
    with pytest.raises(BadInput) as refused:
        corrected(tmp_path, program(varied(arm(), 1), line))
    assert f"line 3: {line[:60].strip()}: this is not understood" in " ".join(str(refused.value).split())


@FILES
def test_damaged_programs_are_refused_or_read_as_they_are(tmp_path: Path, files: int) -> None:
    """A position whose line is as it was is read, and corrected, as it was."""
    (tmp_path / "mine.yaml").write_text(controller.robot_text())
    (tmp_path / "header.yaml").write_text(HEADER.replace("robot: irb1600", "robot: mine.yaml"))
    # Hardly apart: rows that are the same would be one measurement.
    text = program(varied(arm(), 4)[[0, 0, 1, 1]] + [[0.0], [1e-3], [0.0], [1e-3]])
    path = tmp_path / "MZ07-01-A.001"

    def lines(content: str) -> list[str]:
        return [line for line in content.split("\r\n") if "MOVEX" in line and "'zerobeam" not in line]

    def measured(content: str) -> list[tuple[float, ...]]:
        path.write_bytes(content.encode())
        job = ImportJob.begin([path], tmp_path / "header.yaml", tmp_path / "run.jsonl", ["a"])
        return [shot.joints_deg for shot in READER.read(job).shots]

    def by_line(content: str) -> dict[str, tuple[tuple[float, ...], str]]:
        after = lines(corrected(tmp_path, content))
        return dict(zip(lines(content), zip(measured(content), after, strict=True), strict=True))

    np.testing.assert_array_equal(measured(text), joints(text))
    assert 0.3 * files < refused(by_line, text, {line: line for line in lines(text)}, files) < files
