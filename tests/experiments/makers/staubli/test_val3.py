"""VAL3: what is refused, and damaged files."""

from __future__ import annotations

from pathlib import Path

import staubli_controller as controller
from damaged_files import joints_read, lines_of, recorded, refused
from program_arm import plan_for

from zerobeam.experiments.makers.plan_programs import ProgramMotion, write_program


def test_damaged_recordings_are_refused_or_have_the_same_joints(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, "tx2_60", controller.TARGET, 4)
    write_program("val3", plan, ProgramMotion(), tmp_path / "zb_plan.pjx")
    text = recorded((tmp_path / "zb_plan.dtx").read_text(), r'"zb_m\d+" .* j2="')
    lines = {int(number): line for number, line in lines_of(text, r'<Data name="zb_m(\d+)"').items()}
    assert 100 < refused(joints_read("val3", plan, tmp_path / "saved.dtx"), text, lines, 200, 6) < 200
