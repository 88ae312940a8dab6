"""MELFA-BASIC: what is refused, and damaged files."""

from __future__ import annotations

from pathlib import Path

import mitsubishi_controller as controller
import pytest
from damaged_files import joints_read, lines_of, positions_read, recorded, refused
from program_arm import plan_for
from user_programs import judged, read, varied

from zerobeam.experiments.makers.mitsubishi.melfa_basic import MELFA_BASIC
from zerobeam.experiments.makers.plan_programs import ProgramMotion, write_program
from zerobeam.experiments.makers.user_programs import ProgramOptions, corrected_program
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot

ROBOT = load_robot("rv2fr")
WHOLE = controller.user_program(ROBOT, varied(ROBOT, 4))


def corrected(folder: Path, text: str, options: ProgramOptions = controller.STATED) -> str:
    job = folder / "job.prg"
    job.write_bytes(text.encode())
    return read(corrected_program(ROBOT, judged(ROBOT), job, job, options))


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


@pytest.mark.parametrize("line", REFUSED)
@pytest.mark.usefixtures("unsolved")
def test_a_statement_that_must_not_pass_is_refused_by_its_line(tmp_path: Path, line: str) -> None:
    text = WHOLE.replace("M_Out(8)=1", f"{line}\r\nM_Out(8)=1")
    first = WHOLE[: WHOLE.index("M_Out(8)=1")].count("\n") + 1
    lines = [f"line {first + i}: " for i in range(line.count("\n") + 1)]
    with pytest.raises(BadInput) as refused:
        corrected(tmp_path, text)
    assert any(each in str(refused.value) for each in lines) or "more than once" in str(refused.value)


def test_a_program_with_branches_numbers_and_signals_is_corrected(tmp_path: Path) -> None:
    branch = "*L1\r\nIf M_In(1)=1 Then *L2\r\nM1=M1-1\r\n*L2\r\nFor M2=1 To 3\r\nDly 0.5\r\nNext M2\r\nHlt"
    branch += "\r\nC1$=\"it's\" ' Mov P1\r\nRem Mvs P1,-50"
    text = WHOLE.replace("M_Out(8)=1", f"{branch}\r\nMov J0 Wth M_Out(9)=1\r\nM_Out(8)=1")
    head, code = text.split("End\r\n")[0].splitlines(), text.split("End\r\n")[1]
    numbered = "\r\n".join([*(f"{10 * i} {line}" for i, line in enumerate(head, start=1)), "990 End", code])
    before, after = numbered.splitlines(), corrected(tmp_path, numbered).splitlines()[-numbered.count("\n") :]
    assert [line.split("=")[0] for line in before] == [line.split("=")[0] for line in after]
    assert sum(one != other for one, other in zip(before, after, strict=True)) == 6  # J0, J2, P1, P3 and near


def test_tool_and_base_of_the_controller_must_be_stated(tmp_path: Path) -> None:
    open_frames = "\r\n".join(line for line in WHOLE.splitlines() if not line.startswith(("Tool", "Base")))
    with pytest.raises(BadInput, match=r"the program does not set the tool; state --tool X,Y,Z,A,B,C"):
        corrected(tmp_path, open_frames, ProgramOptions())
    with pytest.raises(BadInput, match=r"frame ptable is not known"):
        corrected(tmp_path, WHOLE, ProgramOptions())


@pytest.mark.parametrize("many", [40, pytest.param(200, marks=pytest.mark.long)])
def test_damaged_programs_are_refused_or_have_the_same_positions(many: int) -> None:
    text = WHOLE.replace("Base PTABLE", "Base P_NBase")
    lines = lines_of(text, r"([JP]\w*)=\(")
    assert many / 5 < refused(positions_read(MELFA_BASIC, ROBOT), text, lines, many, 5) < many


@pytest.mark.long
def test_damaged_recordings_are_refused_or_have_the_same_joints(tmp_path: Path) -> None:
    plan = plan_for(tmp_path, "rv2fr", controller.TARGET, 4)
    write_program("melfa", plan, ProgramMotion(), tmp_path / "zb_plan.prg")
    text = recorded((tmp_path / "zb_plan.prg").read_text(), r"JZB_P\d+=\([-+.\d]+,")
    lines = {int(number): line for number, line in lines_of(text, r"JZB_P(\d+)=").items()}
    assert 40 < refused(joints_read("melfa", plan, tmp_path / "saved.prg"), text, lines, 200, 6) < 200
