"""MELFA-BASIC: what is refused, and damaged files."""

from __future__ import annotations

from pathlib import Path

import mitsubishi_controller as controller
import pytest
from damaged_files import joints_read, lines_of, recorded, refused
from program_arm import plan_for

from zerobeam.experiments.makers.plan_programs import ProgramMotion, write_program
from zerobeam.model.files.robot_file import load_robot

ROBOT = load_robot("rv2fr")


REFUSED = [
    "Mov P1,-50",
    "Mvs P1,-50",
    "Mvs ,-50",
    "Mov P1+P3",
    "Mov P1*(0,0,50,0,0,0)(0,0)",
    "Mov P_Curr",
    "Mov P1 Type 1,0",
    "Mov P(M1)",
    "Mov P99",
    "Mov J99",
    "Mov (0,0,90,0,90,0)",
    "Mvr P1,P3,P1",
    "Mvc P1,P3,P1",
    "P1=P3",
    "P1.X=P1.X+10",
    "p1.z=100",
    "J0=J_Curr",
    "J0.J1=Rad(10)",
    "P3=(1,2,3,4,5,6)(7,0)",
    "P8=(1,2,3,4,5,6)",
    "J8=(1,2,3,4,5,6)(7,0)",
    "M_Tool=2",
    "P_100=P1",
    "Mov J0 Wth M_Tool=2",
    "Base 1",
    "Tool PGRIP\r\nMov P1",
    "Tool (1,2,3,4,5)(0,0)\r\nMov P1",
    "Tool (1,2,3,4,5,6,7)(0,0)\r\nMov P1",
    "Tool (1,2,3,4,5,1e400)(0,0)\r\nMov P1",
    "*L1\r\nTool PGRIP\r\nGoTo *L1\r\nMov P1",
    'CallP "PICK"',
    "Def Act 1,M_In(8)=1 GoTo *L1",
    "Cmp Pos,&B000011",
    "Mov P1 WthIf M_In(8)=1,Skip",
]


@pytest.mark.long
def test_damaged_recordings_are_refused_or_have_the_same_joints(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, "rv2fr", controller.TARGET, 4)
    write_program("melfa", plan, ProgramMotion(), tmp_path / "zb_plan.prg")
    text = recorded((tmp_path / "zb_plan.prg").read_text(), r"JZB_P\d+=\([-+.\d]+,")
    lines = {int(number): line for number, line in lines_of(text, r"JZB_P(\d+)=").items()}
    assert 40 < refused(joints_read("melfa", plan, tmp_path / "saved.prg"), text, lines, 200, 6) < 200
