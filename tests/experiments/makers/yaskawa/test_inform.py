"""INFORM: what is refused, and damaged jobs: refused, or read as they are meant."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
import yaskawa_controller as controller
from damaged_files import joints_read, refused
from program_arm import PendantArm, plan_for

from zerobeam.experiments.makers.import_jobs import ImportJob
from zerobeam.experiments.makers.maker import makers
from zerobeam.experiments.makers.plan_programs import ProgramMotion, write_program
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.robot import Robot

READER = next(each for maker in makers() for each in maker.read if each.name == "inform")
FILES = pytest.mark.parametrize("files", [40, pytest.param(200, marks=pytest.mark.long)])
JOB = """/JOB
//NAME JOB
//POS
///NPOS 2,0,0,0,0,0
///TOOL 3
///POSTYPE PULSE
///PULSE
C00000=0,20000,-30000,0,40000,0
///USER 2
///POSTYPE USER
///RECTAN
///RCONF 0,0,0,0,0,0,0,0
C00001=239.261,62.882,198.869,-151.8258,-60.8092,-66.2771
//INST
///DATE 2020/01/01 12:00
///ATTR SC,RW
///GROUP1 RB1
NOP
MOVJ C00000 VJ=50.00
{}
END
"""


@cache
def gp7() -> Robot:
    with TemporaryDirectory() as folder:
        return load_robot(controller.robot_file(Path(folder)))


@FILES
def test_damaged_files_of_a_plan_are_refused_or_read_as_they_are(tmp_path: Path, files: int) -> None:
    plan = plan_for(tmp_path, controller.robot_file(tmp_path), controller.TARGET, count=4)
    write_program("inform", plan, ProgramMotion(), tmp_path / "zb_plan.jbi")
    saved = controller.carried_out(tmp_path / "zb_plan.jbi", PendantArm(plan))
    text = saved.read_bytes().decode()
    lines = {number: f"C{number:05d}={row}" for number, row in controller.positions_of(text)}
    assert len(lines) == 4
    assert 0.5 * files < refused(joints_read("inform", plan, saved), text, lines, files) < files


def test_without_the_pulses_of_the_machine_nothing_is_written(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, "gp7", controller.TARGET, count=3)
    with pytest.raises(BadInput, match="the pulses for a degree are not stated"):
        write_program("inform", plan, ProgramMotion(), tmp_path / "zb_plan.jbi")
    assert not (tmp_path / "zb_plan.jbi").exists()


def test_a_program_whose_positions_nobody_modified_is_no_recording(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, controller.robot_file(tmp_path), controller.TARGET, count=3)
    job = tmp_path / "zb_plan.jbi"
    write_program("inform", plan, ProgramMotion(), job)
    with pytest.raises(BadInput, match="every position is still as the plan has it"):
        READER.read(ImportJob.begin([job], plan, tmp_path / "run.jsonl"))
