"""TMscript: what is corrected and what is refused, by line; damaged files."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import techman_controller as controller
from damaged_files import joints_read, lines_of, positions_read, refused
from program_arm import plan_for
from user_programs import OFFSETS, TABLE, corrected_for, read, varied

from zerobeam.experiments.makers.line_programs import for_correction
from zerobeam.experiments.makers.program_parts import ProgramFacts, Source
from zerobeam.experiments.makers.techman.tmscript_language import TMSCRIPT
from zerobeam.experiments.makers.user_programs import ProgramOptions
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot

ROBOT = load_robot("tm5_900")
COUNTS = pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.long)])
JOB = """define
{{
float[] home = {{0, 0, 90, 0, 90, 0}}
}}
main
{{
ChangeTCP("NOTOOL")
ChangeBase("RobotBase")
PTP("JPP",home,35,200,0,false)
{}
}}
"""
HERE = "417.5,-122.2,460,180,0,90"


def corrected(folder: Path, text: str, choices: ProgramOptions | None = None) -> str:
    path = folder / "job.tms"
    path.write_text(text)
    return read(corrected_for(ROBOT, OFFSETS, ROBOT, path, choices or ProgramOptions()))


def test_what_is_understood_is_corrected(tmp_path: Path) -> None:
    lines = [
        f'Line("CPP",{HERE},10,200,0,false) // there',
        f'/* Line("CPP",{HERE},10,200,0,false)',
        "*/ QueueTag(1)",
        "float[] speeds = {10, 20}",
        "for (int i = 0; i < 2; i++)",
        "{",
        'PTP("JPP",home,speeds[0],200,0,false)',
        "}",
    ]
    text = corrected(tmp_path, JOB.format("\n".join(lines)))
    assert "// zerobeam export program: job.tms with the offsets below" in text
    moved = [float(value) for value in re.search(r"home = \{(.*)\}", text)[1].split(",")]
    np.testing.assert_allclose(moved, [0, 0, 90, 0, 90, 0] - OFFSETS, atol=1e-4)
    there, remark = re.findall(r'Line\("CPP",(.*),10,200', text)
    assert remark == HERE
    assert 0.1 < np.linalg.norm(np.array(list(map(float, there.split(","))))[:3] - [417.5, -122.2, 460]) < 30


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (f'PTP("CPP",{HERE},10,200,0,false)', "this is not understood"),
        (f'Move_Line("CPP",{HERE},10,200,0,false)', "line 10: Move_Line"),
        (f'Circle("CPP",{HERE},{HERE},10,200,0,0)', "this is not understood"),
        (f'PLine("CAP",{HERE},10,200,0)', "this is not understood"),
        ('PTP("JPP","P1",10,200,0,false)', "this is not understood"),
        ('PTP("JPP",0,0,90,0,90,10,200,0,false)', "this is not understood"),
        ('PTP("JPP",0,0,90,0,a,0,10,200,0,false)', "this is not understood"),
        ('PTP("JPP",there,10,200,0,false)', "there has no value in this file"),
        ('Line("CPP",home,10,200,0,false)', "the motion takes a pose alone"),
        ("home[0] = 10", "home is used or changed"),
        ("home = Robot[0].Joint", "this is not understood"),
        ("float[] spare = {1, 2, 3, 4, 5, 6}", "spare is not the target of a motion here"),
        ("float[] home = {1, 2, 3, 4, 5, 6}", "home has a value more than once"),
        ("StopAndClearBuffer()", "this is not understood"),
        ("moved = Move_PTP(1)", "this is not understood"),
        ("Pick()", "what Pick does is not known; --call Pick"),
        (
            f'ChangeBase("Table")\nLine("CPP",{HERE},10,200,0,false)',
            "frame Table is not known; state",
        ),
        ('if (x == 1)\nPTP("JPP",home,35,200,0,false)', "line 11: PTP"),
        (f'if (x == 1)\n{{\nChangeTCP("a")\n}}\nLine("CPP",{HERE},10,200,0,false)', "which tool is active"),
        (f'if (x == 1) {{\nChangeTCP("a")\n}} else {{\nLine("CPP",{HERE},10,200,0,false)\n}}', "which tool"),
        ('if (x == 1) PTP("JPP",home,35,200,0,false)', "this is not understood"),
        ("TBase b = {1, 2, 3, 4, 5, 6}", "this is not understood"),
        ('Vision_DoJob("a")', "this is not understood"),
    ],
)
def test_what_is_not_understood_is_named(lines: str, told: str) -> None:
    parsed = for_correction(TMSCRIPT).targets(Source(JOB.format(lines), ROBOT, ProgramFacts()))
    sentences = [f"line {line}: {sentence}" for line, sentence in parsed.problems]
    assert any(told in sentence for sentence in sentences), sentences


def test_the_base_of_a_program_that_sets_none_is_asked_for(tmp_path: Path) -> None:
    text = JOB.format(f'Line("CPP",{HERE},10,200,0,false)').replace('ChangeBase("RobotBase")', "")
    with pytest.raises(BadInput, match="the program does not set the frame; state --frame X,Y,Z,RX,RY,RZ"):
        corrected(tmp_path, text)


@COUNTS
def test_damaged_recordings(tmp_path: Path, count: int) -> None:
    plan = plan_for(tmp_path, "tm5_900", controller.TARGET, count=5)
    rows = [",".join(f"{v:.6f}" for v in row) for row in np.degrees(plan.postures) + 0.123456]
    lines = {i: f"float[] zb_p{i} = {{{row}}}\n" for i, row in enumerate(rows)}
    motions = "".join(f'PTP("JPP",zb_p{i},5,500,0,false)\n' for i in lines)
    text = "define\n{\n" + "".join(lines.values()) + "}\nmain\n{\n" + motions + "}\n"
    read_joints = joints_read("tmscript", plan, tmp_path / "edited.tms")
    assert refused(read_joints, text, lines, count) < 0.9 * count


@COUNTS
def test_damaged_programs(count: int) -> None:
    text = controller.user_program(ROBOT, varied(ROBOT, 4))
    positions = positions_read(TMSCRIPT, ROBOT, lambda: ProgramFacts(frames={"Table": TABLE}))
    assert count / 2 < refused(positions, text, lines_of(text, r"float\[\] (\w+)"), count) < count
