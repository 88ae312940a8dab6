"""AS: what is corrected and what is refused, by line; damaged files."""

from __future__ import annotations

import re
from pathlib import Path

import kawasaki_controller as controller
import numpy as np
import pytest
from damaged_files import joints_read, lines_of, positions_read, refused
from program_arm import plan_for
from user_programs import OFFSETS, TABLE, corrected_for, read, varied

from zerobeam.experiments.makers.kawasaki.as_language import AS
from zerobeam.experiments.makers.line_programs import for_correction
from zerobeam.experiments.makers.program_parts import ProgramFacts, Source
from zerobeam.experiments.makers.user_programs import ProgramOptions
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot

ROBOT = load_robot("rs007n")
COUNTS = pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.long)])
JOB = """.PROGRAM job()
  TOOL TRANS(0,0,0,0,0,0)
  BASE TRANS(0,0,0,0,0,0)
  JMOVE #home
{}
.END
.JOINTS
#home 0 10 -80 0 -90 0
{}
.END
"""


def corrected(folder: Path, text: str, choices: ProgramOptions | None = None) -> str:
    path = folder / "job.as"
    path.write_text(text)
    return read(corrected_for(ROBOT, OFFSETS, ROBOT, path, choices or ProgramOptions()))


def test_what_is_understood_is_corrected(tmp_path: Path) -> None:
    pose = ROBOT.fk([5, 15, -75, 3, -85, 10], "deg")
    lines = [
        f"  LMOVE TRANS({controller._oat(pose).replace(' ', ',')}) ; there",
        "  ; JMOVE #PPOINT(1,2,3,4,5,6)",
        "  IF SIG(1001) THEN",
        "  JMOVE #PPOINT(1, 12, -78, 4, -86, 6)",
        "  END",
        '  TYPE "LMOVE nowhere"',
    ]
    text = corrected(tmp_path, JOB.format("\n".join(lines), ""))
    assert "; zerobeam export program: job.as with the offsets below" in text
    stated, literal = re.search(r"#home (.*)", text)[1], re.search(r"#PPOINT\((1,? 1.*)\)", text)[1]
    for values, old in (
        (stated.split(), [0, 10, -80, 0, -90, 0]),
        (literal.split(","), [1, 12, -78, 4, -86, 6]),
    ):
        np.testing.assert_allclose([float(value) for value in values], np.array(old) - OFFSETS, atol=1e-4)
    assert "; JMOVE #PPOINT(1,2,3,4,5,6)" in text
    there = [float(value) for value in re.search(r"LMOVE TRANS\((.*)\)", text)[1].split(",")]
    assert 0.1 < np.linalg.norm(there[:3] - pose[:3, 3]) < 30


@pytest.mark.parametrize(
    ("lines", "saved", "told"),
    [
        ("  DRAW 0,0,10", "", "line 5: DRAW 0,0,10: nothing says whether these are joints or a pose"),
        ("  LAPPRO #home,100", "", "this is not understood"),
        ("  LMOVE SHIFT(p BY 0,0,10)", "", "this is not understood"),
        ("  C1MOVE p", "", "this is not understood"),
        ("  HOME", "", "this is not understood"),
        ("  LEFTY", "", "this is not understood"),
        ("  JMOVE #there", "", "#there has no value in this file"),
        ("  JMOVE #zb_m1", "", "#zb_m1 has no value in this file"),
        ("  CALL pick", "", "what pick does is not known; --call pick"),
        ("  POINT #home = #other", "", "this is not understood"),
        ("  JMOVE #PPOINT(1,2,3,4,5)", "", "has 5 numbers, and not 6"),
        ("  JMOVE #PPOINT(1,2,3,4,5,a)", "", "this is not understood"),
        ("", ".END\n.TRANS\n#turned 1 2 3 4 5 6", "#turned 1 2 3 4 5 6: this is not understood"),
        ("", "there 1 2 3 4 5 6", "there 1 2 3 4 5 6: this is not understood"),
        ("", ".END\n#there 1 2 3 4 5 6", "nothing says whether these are joints or a pose"),
        ("", "#home 1 2 3 4 5 6", "#home has a value more than once"),
        ("  BASE table\n  LMOVE TRANS(400,0,300,0,180,0)", "", "frame table is not known; state"),
        ("  IF a THEN\n  TOOL gun\n  END\n  LMOVE TRANS(400,0,300,0,180,0)", "", "which tool is active"),
        (".PROGRAM other()\n  LMOVE TRANS(400,0,300,0,180,0)", "", "which tool"),
    ],
)
def test_what_is_not_understood_is_named(lines: str, saved: str, told: str) -> None:
    parsed = for_correction(AS).targets(Source(JOB.format(lines, saved), ROBOT, ProgramFacts()))
    sentences = [f"line {line}: {sentence}" for line, sentence in parsed.problems]
    assert any(told in sentence for sentence in sentences), sentences


def test_the_base_of_a_program_that_sets_none_is_asked_for(tmp_path: Path) -> None:
    text = JOB.format("  LMOVE TRANS(400,0,300,0,180,0)", "").replace("  BASE TRANS(0,0,0,0,0,0)\n", "")
    with pytest.raises(BadInput, match="the program does not set the frame; state --frame X,Y,Z,O,A,T"):
        corrected(tmp_path, text)


@COUNTS
def test_damaged_recordings(tmp_path: Path, count: int) -> None:
    plan = plan_for(tmp_path, "rs007n", controller.TARGET, count=5)
    rows = [" ".join(f"{v:.6f}" for v in row) for row in np.degrees(plan.postures) + 0.123456]
    lines = {i: f"#zb_m{i} {row}\n" for i, row in enumerate(rows)}
    text = ".JOINTS\n" + "".join(lines.values()) + ".END\n"
    read_joints = joints_read("as", plan, tmp_path / "saved.as")
    assert refused(read_joints, text, lines, count) < count


@COUNTS
def test_damaged_programs(count: int) -> None:
    text = controller.user_program(ROBOT, varied(ROBOT, 4)).replace("\r\n", "\n")
    positions = positions_read(AS, ROBOT, lambda: ProgramFacts(frames={"table": TABLE}))
    assert count / 2 < refused(positions, text, lines_of(text, r"(#?\w+) +-?\d+\.\d"), count) < count
