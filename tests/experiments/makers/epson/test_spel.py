"""SPEL+: what is refused, and damaged logs, programs and points: refused, or read as they are meant."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import epson_controller as controller
import numpy as np
import pytest
from damaged_files import joints_read, positions_read, refused
from program_arm import PendantArm, plan_for
from user_programs import TABLE, TOOL, judged, read, varied

from zerobeam.experiments.makers.epson.spel import SPEL
from zerobeam.experiments.makers.line_programs import for_correction
from zerobeam.experiments.makers.plan_programs import ProgramMotion, write_program
from zerobeam.experiments.makers.program_parts import ProgramFacts, Source
from zerobeam.experiments.makers.user_programs import corrected_program
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.robot import Robot

FILES = pytest.mark.parametrize("files", [40, pytest.param(200, marks=pytest.mark.long)])
PROGRAM = "Function main\n  Go JA(0, 10, -20, 0, 30, 0)\n  {}\nFend\n"


@cache
def arm() -> Robot:
    with TemporaryDirectory() as folder:
        return load_robot(controller.robot_file(Path(folder)))


def corrected(folder: Path, text: str) -> str:
    (folder / "in.prg").write_bytes(text.encode())
    return read(corrected_program(arm(), judged(arm()), folder / "in.prg", folder / "out.prg"))


def problems(text: str) -> list[str]:
    facts = ProgramFacts({"1": TOOL}, {"2": TABLE})
    parsed = for_correction(SPEL).targets(Source(text, arm(), facts))
    return [f"line {line}: {sentence}" for line, sentence in parsed.problems]


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("Go P1", "line 3: P1 has no value in this file (--leave P1?)"),
        ("Go P(1)", "line 3: Go P(1): this is not understood"),
        ("Go pick +Z(50)", "this is not understood"),
        ("Go XY(400, 0, 300, 0, 0, 180)", "this is not understood"),
        ("Go XY(400, 0, 300, 0, 0, 180) /R /A", "this is not understood"),
        ("Go XY(400, 0, 300, 0, 0, 180) /A /R /NF", "this is not understood"),
        ("Go XY(400, 0, 300, 0, 0, 180) /R /A /NF /2", "this is not understood"),
        ("Go XY(400, 0, 300, 0, 0, 180) /R /A /NF", "the program does not set the tool; state --tool"),
        ('LoadPoints "robot1.pts"', "this is not understood"),
        ("TLSet 1, XY(0, 0, 100, 0, 0, 0)", "this is not understood"),
        ("Go JA(0, 10, -20, 0, 30, 0) +Z(10)", "this is not understood"),
        ("Go JA(0, 10, -20, 0, 30, 0) Till Sw(1) = On", "this is not understood"),
        ("Go JA(a, 10, -20, 0, 30, 0)", "this is not understood"),
        ("Go JA(10, -20, 0, 30, 0)", "has 5 numbers, and not 6"),
        ("Move Here +X(10)", "this is not understood"),
        ("P1 = JA(0, 10, -20, 0, 30, 0)", "this is not understood"),
        ("Arc P1, P2", "this is not understood"),
        ("Jump P1", "this is not understood"),
        ("Hofs 0, 1, 2, 3, 4, 5", "this is not understood"),
        ("Call grip", "what grip does is not known; --call grip"),
    ],
)
def test_what_is_not_understood_is_named(tmp_path: Path, line: str, said: str) -> None:
    assert "zerobeam export program" in corrected(tmp_path, PROGRAM.format("On 3"))
    with pytest.raises(BadInput) as refused:
        corrected(tmp_path, PROGRAM.format(line))
    assert said in " ".join(str(refused.value).split())


@FILES
def test_damaged_logs_are_refused_or_read_as_they_are(tmp_path: Path, files: int) -> None:
    plan = plan_for(tmp_path, controller.robot_file(tmp_path), controller.TARGET, count=4)
    write_program("spel", plan, ProgramMotion(), tmp_path / "zb_plan.prg")
    log = controller.carried_out(tmp_path / "zb_plan.prg", PendantArm(plan))
    text = log.read_text()
    lines = {int(line.split()[2]): line for line in text.splitlines() if " posture " in line}
    assert len(lines) == 4
    assert 0.1 * files < refused(joints_read("spel", plan, log), text, lines, files) < files


def whole() -> str:
    return controller.user_program(arm(), varied(arm(), 8))


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("nNumberOfPoints=2", "nNumberOfPoints=3", "nNumberOfPoints=3: this is not understood"),
        ("nNumberOfJoints=6", "nNumberOfJoints=4", "nNumberOfJoints=4: this is not understood"),
        ('sLabel="pick"', 'sLabel="place"', "pick has no value in this file"),
        ('sLabel="pick"', 'sLabel="1st"', "Point5 {"),
        ("nNumber=5", "nNumber=1", "Point5 {"),
        ("nUndefined=0", "nUndefined=1", "Point1 {"),
        ("rT=0", "rT=12.5", "Point1 {"),
        ("nJ4Flag=0", "nJ4Flag=1", "Point1 {"),
        ("nHand=2", "nHand=3", "Point1 {"),
        ("nLocal=2", "nLocal=3", "frame 3 is not known; state --frame 3=X,Y,Z,U,V,W"),
        ("rV=", "rA=", "Point1 {"),
        ("  Tool 1", "  On 1", "the program does not set the tool; state --tool X,Y,Z,U,V,W"),
        ("  Go pick", "  On 1", "pick is not the target of a motion here (--leave pick?)"),
        ("  On 3", "  P1 = Here", "P1 is used or changed when the program runs"),
        ("  On 3", "  P5 = P1", "is used or changed when the program runs"),
    ],
)
def test_points_that_are_not_understood_are_named(before: str, after: str, message: str) -> None:
    assert problems(whole()) == []
    assert before in whole()
    sentences = problems(whole().replace(before, after, 1))
    assert any(message.lower() in sentence.lower() for sentence in sentences), sentences


def test_points_are_corrected_in_their_file_and_marked_there(tmp_path: Path) -> None:
    """A point that the program has by its number alone is that with the label, too; a second correction is
    refused."""
    program = controller.in_files(tmp_path / "job", whole().replace("  Go pick", "  Go pick\r\n  Go P5"))
    out = tmp_path / "out" / "job.prg"
    done = corrected_program(arm(), judged(arm()), program, out, controller.STATED)
    assert [path.name for path in done.files] == ["job.prg", "robot1.pts"]
    before, after = (program.with_name("robot1.pts").read_bytes(), done.files[out.with_name("robot1.pts")])
    lines = list(zip(before.split(b"\r\n"), after.split(b"\r\n"), strict=True))
    changed = {one.split(b"=")[0].strip() for one, other in lines if one != other}
    assert (
        {b"sDescription", b"rX", b"rU"}
        <= changed
        <= {b"sDescription", *(b"r" + bytes([c]) for c in b"XYZUVW")}
    )
    assert sum(b"zerobeam export program" in other for _, other in lines) == 1
    program.with_name("robot1.pts").write_bytes(after)
    with pytest.raises(BadInput, match="corrected before"):
        corrected_program(arm(), judged(arm()), program, out, controller.STATED)


@FILES
def test_damaged_programs_are_refused_or_mean_what_they_meant(files: int) -> None:
    """A position whose lines are as they were is read as it was."""
    text = whole()
    positions = positions_read(SPEL, arm(), lambda: ProgramFacts({"1": TOOL}, {"2": TABLE}))
    poses = re.findall(r"nNumber=(\d+).*?\n(\trX.*?)\trR", text, re.DOTALL)
    lines = {"pick" if number == "5" else f"P{number}": pose for number, pose in poses}
    assert len(lines) == 2
    assert 0.3 * files < refused(positions, text, lines, files) < files


@FILES
def test_damaged_joints_are_refused_or_corrected_as_they_were(tmp_path: Path, files: int) -> None:
    rows = [", ".join(f"{value:.4f}" for value in row) for row in varied(arm(), 4)]
    text = "\n".join(["Function main", *(f"  Go JA({row})" for row in rows), "  On 3", "Fend", ""])

    def moves(program: str) -> list[str]:
        return re.findall(r"Go JA\(.*\).*", program)

    def by_line(content: str) -> dict[str, str]:
        return dict(zip(moves(content), moves(corrected(tmp_path, content)), strict=True))

    lines = {line: line for line in moves(text)}
    assert len(lines) == 4
    assert 0.3 * files < refused(by_line, text, lines, files) < files


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
