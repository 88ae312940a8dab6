"""SLIM: joint positions there and corrected, what is refused, and damaged programs."""

from __future__ import annotations

from pathlib import Path

import nachi_controller as controller
import pytest
from damaged_files import joints_read, refused
from program_arm import PendantArm, plan_for

from zerobeam.experiments.makers.plan_programs import ProgramMotion, write_program
from zerobeam.model.errors import BadInput

FILES = pytest.mark.parametrize("files", [20, pytest.param(200, marks=pytest.mark.long)])


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
    with pytest.raises(BadInput, match="--tool is not the number of a tool"):
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
