"""INFORM: what is refused, and damaged jobs: refused, or read as they are meant."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaskawa_controller as controller
from damaged_files import joints_read, refused
from program_arm import PendantArm, plan_for

from zerobeam.experiments.makers.import_jobs import ImportJob
from zerobeam.experiments.makers.maker import makers
from zerobeam.experiments.makers.plan_programs import ProgramMotion, write_program
from zerobeam.model.errors import BadInput

READER = next(each for maker in makers() for each in maker.read if each.name == "inform")
FILES = pytest.mark.parametrize("files", [40, pytest.param(200, marks=pytest.mark.long)])


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
