"""SPEL+: what is refused, and damaged logs, programs and points: refused, or read as they are meant."""

from __future__ import annotations

from pathlib import Path

import epson_controller as controller
import numpy as np
import pytest
from damaged_files import joints_read, refused
from program_arm import PendantArm, plan_for

from zerobeam.experiments.makers.plan_programs import ProgramMotion, write_program

FILES = pytest.mark.parametrize("files", [10, pytest.param(200, marks=pytest.mark.long)])


@FILES
def test_damaged_logs_are_refused_or_read_as_they_are(tmp_path: Path, files: int) -> None:
    plan = plan_for(tmp_path, controller.robot_file(tmp_path), controller.TARGET, count=4)
    write_program("spel", plan, ProgramMotion(), tmp_path / "zb_plan.prg")
    log = controller.carried_out(tmp_path / "zb_plan.prg", PendantArm(plan))
    text = log.read_text()
    lines = {int(line.split()[2]): line for line in text.splitlines() if " posture " in line}
    assert len(lines) == 4
    assert 0.1 * files < refused(joints_read("spel", plan, log), text, lines, files) < files


def test_a_posture_that_is_not_centred_is_gone_to_again(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, controller.robot_file(tmp_path), controller.TARGET, count=3)
    write_program("spel", plan, ProgramMotion(), tmp_path / "zb_plan.prg")
    run = controller.SpelController((tmp_path / "zb_plan.prg").read_text(), PendantArm(plan))
    for answer, following in ((1, 1), (0, 1), (1, 2)):
        run.answer = answer
        run.start()
        assert run.variables["zb_next"] == following
    moves = np.array(run.arm.moves)
    np.testing.assert_allclose(moves, np.degrees(plan.postures)[[0, 0, 1]], atol=1e-9)
    assert run.log.count("zerobeam posture") == 1
