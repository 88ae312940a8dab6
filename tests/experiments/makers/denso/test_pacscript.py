"""PacScript: what is corrected and what is refused, by line; damaged files."""

from __future__ import annotations

from pathlib import Path

import denso_controller as controller
import numpy as np
import pytest
from damaged_files import joints_read, lines_of, recorded, refused
from program_arm import PendantArm, plan_for

from zerobeam.experiments.makers.plan_programs import ProgramMotion, write_program
from zerobeam.model.errors import BadInput

COUNTS = pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.long)])


@pytest.mark.parametrize("stopped", ["zb_p0", "zb_p1"])
def test_a_start_that_was_stopped_on_the_way_goes_there_again(tmp_path: Path, stopped: str) -> None:
    plan = plan_for(tmp_path, "vs060", controller.TARGET, count=3)
    write_program("pacscript", plan, ProgramMotion(), tmp_path / "zb_plan.pcs")
    run = controller.PacScriptController((tmp_path / "zb_plan.pcs").read_text(), PendantArm(plan))
    for _ in range(2):
        run.stops_before = stopped
        run.start()
        run.stops_before = ""
    run.start()
    assert [line for line in run.window if "posture" in line][1:] == []
    np.testing.assert_allclose(np.array(run.arm.moves)[-1], np.degrees(plan.postures)[int(stopped[-1])])


def test_a_name_that_is_none_of_a_program_is_refused(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, "vs060", controller.TARGET, count=1)
    with pytest.raises(BadInput, match="PacScript does not allow this one"):
        write_program("pacscript", plan, ProgramMotion(), tmp_path / "1st.pcs")


@COUNTS
def test_damaged_logs(tmp_path: Path, count: int) -> None:
    plan = plan_for(tmp_path, "vs060", controller.TARGET, count=4)
    write_program("pacscript", plan, ProgramMotion(), tmp_path / "zb_plan.pcs")
    log = controller.carried_out(tmp_path / "zb_plan.pcs", PendantArm(plan))
    text = log.read_text()
    lines = {int(line.split()[3]): line for line in text.splitlines() if " posture " in line}
    assert 0.1 * count < refused(joints_read("pacscript", plan, log), text, lines, count) < count


@COUNTS
def test_damaged_recordings(tmp_path: Path, count: int) -> None:
    plan = plan_for(tmp_path, "vs060", controller.TARGET, count=4)
    write_program("pacscript", plan, ProgramMotion(), tmp_path / "zb_plan.pcs")
    text = recorded((tmp_path / "zb_plan.pcs").read_text(), r"zb_p\d+ = J\([-.\d]+,")
    lines = {int(number): line for number, line in lines_of(text, r"zb_p(\d+) = J").items()}
    read_joints = joints_read("pacscript", plan, tmp_path / "saved.pcs")
    assert count / 10 < refused(read_joints, text, lines, count) < count
