"""VAL3: what is refused, and damaged files."""

from __future__ import annotations

from pathlib import Path

import staubli_controller as controller
from damaged_files import joints_read, lines_of, recorded, refused
from program_arm import plan_for

from zerobeam.experiments.makers.plan_programs import ProgramMotion, write_program
from zerobeam.model.files.robot_file import load_robot

ROBOT = load_robot("tx2_60")


REFUSED = [
    "movec(pAt[0],pAt[1],tGrip,mNom)",
    "movej(appro(pAt[0],{0,0,-50,0,0,0}),tGrip,mNom)",
    "movel(compose(pAt[0],fTable,trS),tGrip,mNom)",
    "movej({0,0,90,0,0,0},tGrip,mNom)",
    "movej(jAt[nI],tGrip,mNom)",
    "movej(jOther,tGrip,mNom)",
    "movej(lib:jAt[0],tGrip,mNom)",
    "movej(pAt[0],tOther,mNom)",
    "movel(pAt[1],flange,mNom)",
    "pAt[0]=here(tGrip,fTable)",
    "pAt[nI].trsf.x=5",
    "PAT[0].trsf.x=5",
    "jAt[1]=herej()",
    "jAt[nI]=herej()",
    "tGrip.trsf.z=100",
    "fTable.trsf=trS",
    "nI=setFrame(pAt[0],pAt[1],pAt[0],fTable)",
    "call pick(pAt[0])",
    "call lib:pick()",
    "call pick()",
    'taskCreate "other",100,other()',
    "movej(pAt[0],tGrip",
]


def test_damaged_recordings_are_refused_or_have_the_same_joints(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, "tx2_60", controller.TARGET, 4)
    write_program("val3", plan, ProgramMotion(), tmp_path / "zb_plan.pjx")
    text = recorded((tmp_path / "zb_plan.dtx").read_text(), r'"zb_m\d+" .* j2="')
    lines = {int(number): line for number, line in lines_of(text, r'<Data name="zb_m(\d+)"').items()}
    assert 100 < refused(joints_read("val3", plan, tmp_path / "saved.dtx"), text, lines, 200, 6) < 200
