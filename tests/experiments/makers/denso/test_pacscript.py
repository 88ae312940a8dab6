"""PacScript: what is corrected and what is refused, by line; damaged files."""

from __future__ import annotations

import re
from pathlib import Path

import denso_controller as controller
import numpy as np
import pytest
from damaged_files import joints_read, lines_of, positions_read, recorded, refused
from program_arm import PendantArm, plan_for
from user_programs import OFFSETS, TABLE, TOOL, corrected_for, read, varied

from zerobeam.experiments.makers.denso.pacscript import PACSCRIPT
from zerobeam.experiments.makers.line_programs import for_correction
from zerobeam.experiments.makers.plan_programs import ProgramMotion, write_program
from zerobeam.experiments.makers.program_parts import ProgramFacts, Source
from zerobeam.experiments.makers.user_programs import ProgramOptions
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot

ROBOT = load_robot("vs060")
COUNTS = pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.long)])
P = "P(400, 100, 300, 180, 0, 180, 5)"
JOB = """Sub Main
  Dim home As Joint
  home = J(0, 20, 80, 0, 70, 0)
  TakeArm Keep = 0
  ChangeTool 1
  ChangeWork 0
  Move P, @E home, Speed = 30
  {}
End Sub
"""


def corrected(folder: Path, text: str, *leave: str) -> str:
    path = folder / "job.pcs"
    path.write_text(text)
    tools = ["1=0,0,100,0,0,0"] if "ChangeTool 1" in text else []
    return read(corrected_for(ROBOT, OFFSETS, ROBOT, path, ProgramOptions(tools, leave=leave)))


@pytest.mark.parametrize(
    "lines",
    [
        f"Move L, {P}, S = 50, Next",
        f"move p, @0 {P.lower()}, speed = Mps(0.1)",
        "Move P, @P J( 10, 20, 80, 0, 70, 0 ), @E home, J(10, 30, 80, 0, 70, 0, 0, 0)",
        f"Do While IO[128] = 0\n  Move P, home\n  Move L, {P}\nLoop",
        'If I[3] > 2 And IO[24] = On Then\nPrintDbg "J(1,2,3,4,5,6) " & Str(I[3])\nElse\nDelay 100\nEnd If',
        "Select Case I[1]\nCase 1, 2\nMove P, home\nCase Else\nExit Sub\nEnd Select\nSet IO[24]\nI1 = I1 + 1",
        f"aside = {P} ' as it was taught\nrem Approach P, aside, 50\nMove P, home\nMove P, @E aside",
    ],
)
def test_what_is_understood_is_corrected(tmp_path: Path, lines: str) -> None:
    text = corrected(tmp_path, JOB.format(lines))
    assert "  ' zerobeam export program: job.pcs with the offsets below" in text
    moved = [float(value) for value in re.search(r"home = J\((.*)\)", text)[1].split(",")]
    np.testing.assert_allclose(np.array(moved), [0, 20, 80, 0, 70, 0] - OFFSETS, atol=1e-4)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (f"Approach P, {P}, 50", "line 8: Approach P, P(400, 100, 300, 180, 0, 180, 5), 50: this is not"),
        ("Depart L, 50", "line 8: Depart L, 50: this is not understood"),
        ("Draw L, V( 50, 10, 50 )", "this is not understood"),
        ("DriveA (1, 30)", "this is not understood"),
        (f"Move C, {P}, {P}", "this is not understood"),
        ("Move P, home Ex(7, 10)", "this is not understood"),
        ("Move P, P(400, 100, 300, 180, 0, 180, -1)", "this is not understood"),
        ("Move P, P(400, 100, 300, 180, 0, 180)", "this is not understood"),
        ("Move P, P(400, 100, 300, 180, 0, 5)", "this is not understood"),
        ("Move P, J(10, 20, 80)", "has 3 numbers, and not 6"),
        ("Move P, J(10, 20, 80, 0, 70, 0, 5)", "has 7 numbers, and not 6"),
        ("Move P, J(a, 20, 80, 0, 70, 0)", "this is not understood"),
        ("Move P, Dev(home, P(0, 0, 10, 0, 0, 0))", "this is not understood"),
        ("Move P, P10", "P10 has no value in this file (--leave P10?)"),
        ("Move P, J[2]", "J[2] has no value in this file (--leave J[2]?)"),
        ("J2 = J(10, 20, 80, 0, 70, 0)", "J2 belongs to other programs too (--leave J2?)"),
        ("home = CurJnt", "home is used or changed when the program runs"),
        ("home = J(0, 30, 80, 0, 70, 0)", "home has a value more than once"),
        ("LetX aside = 5", "this is not understood"),
        ("Tool 1, P(0, 0, 50, 0, 0, 0, 0)", "this is not understood"),
        ("Run other", "this is not understood"),
        ("Call grip", "what grip does is not known; --call grip"),
        (f"ChangeTool 2\n  Move L, {P}", "tool 2 is not known; state --tool 2=X,Y,Z,RX,RY,RZ"),
        (f"TakeArm\n  Move L, {P}", "the program does not set the tool; state --tool X,Y,Z,RX,RY,RZ"),
        (f"If I[1] = 0 Then\n  ChangeTool 2\nEnd If\nMove L, {P}", "which tool is active here is not known"),
        (f"*L:\n  Move L, {P}\n  TakeArm\n  GoTo *L", "which tool is active here is not known"),
        ("spare = J(1, 2, 3, 4, 5, 6, 7)", "spare has 7 numbers, and not 6"),
    ],
)
def test_what_is_not_understood_is_named(lines: str, message: str) -> None:
    facts = ProgramFacts({"1": np.eye(4)})
    parsed = for_correction(PACSCRIPT).targets(Source(JOB.format(lines), ROBOT, facts))
    sentences = [f"line {line}: {sentence}" for line, sentence in parsed.problems]
    assert any(message in sentence for sentence in sentences), sentences


def test_a_position_of_all_programs_is_left_by_its_name(tmp_path: Path) -> None:
    text = corrected(tmp_path, JOB.format("P[3] = P( 1, 2, 3, 4, 5, 6, 5 )\n  Move P, P[3]"), "P[3]")
    assert "P[3] = P( 1, 2, 3, 4, 5, 6, 5 )" in text


def test_numbers_that_look_like_a_position_are_none_of_a_message(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"line 8: (1,2,3,4,5,6|Move.*): (it is not said|this is not)"):
        corrected(tmp_path, JOB.format("Move P, home, Speed = (1,2,3,4,5,6)"))


def test_a_figure_goes_with_one_branch(tmp_path: Path) -> None:
    other = P.replace(", 5)", ", 1)")
    with pytest.raises(BadInput, match=r"its configuration 1 and that of .* do not go with"):
        corrected(tmp_path, JOB.format(f"Move P, {P}\n  Move P, {other}"))


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


@COUNTS
def test_damaged_programs(count: int) -> None:
    text = controller.user_program(ROBOT, varied(ROBOT, 4))
    facts = {"1": TOOL}, {"2": TABLE}
    positions = positions_read(PACSCRIPT, ROBOT, lambda: ProgramFacts(*facts))
    assert count / 3 < refused(positions, text, lines_of(text, r"([jp]_\d) = "), count) < count
