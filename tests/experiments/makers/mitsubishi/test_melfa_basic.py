"""MELFA-BASIC: what is refused, and damaged files."""

from __future__ import annotations

from pathlib import Path

import mitsubishi_controller as controller
import pytest
from damaged_files import joints_read, lines_of, recorded, refused
from program_arm import plan_for

from zerobeam.experiments.makers.plan_programs import ProgramMotion, write_program


@pytest.mark.long
def test_damaged_recordings_are_refused_or_have_the_same_joints(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, "rv2fr", controller.TARGET, 4)
    write_program("melfa", plan, ProgramMotion(), tmp_path / "zb_plan.prg")
    text = recorded((tmp_path / "zb_plan.prg").read_text(), r"JZB_P\d+=\([-+.\d]+,")
    lines = {int(number): line for number, line in lines_of(text, r"JZB_P(\d+)=").items()}
    assert 40 < refused(joints_read("melfa", plan, tmp_path / "saved.prg"), text, lines, 200, 6) < 200
