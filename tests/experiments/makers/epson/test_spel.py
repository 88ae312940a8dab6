"""SPEL+: what is refused, and damaged logs and programs: refused, or read as they are meant."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import epson_controller as controller
import numpy as np
import pytest
from damaged_files import damaged
from program_arm import PendantArm, plan_for
from user_programs import judged, read, varied

from zerobeam.experiments.makers.maker import makers
from zerobeam.experiments.makers.plan_programs import ProgramMotion, write_program
from zerobeam.experiments.makers.recordings import ImportJob
from zerobeam.experiments.makers.user_programs import corrected_program
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.robot import Robot

READER = next(each for maker in makers() for each in maker.read if each.name == "spel")
FILES = pytest.mark.parametrize("files", [10, pytest.param(200, marks=pytest.mark.long)])
PROGRAM = "Function main\n  Go JA(0, 10, -20, 0, 30, 0)\n  {}\nFend\n"


@cache
def arm() -> Robot:
    with TemporaryDirectory() as folder:
        return load_robot(controller.robot_file(Path(folder)))


def corrected(folder: Path, text: str) -> str:
    (folder / "in.prg").write_bytes(text.encode())
    return read(corrected_program(arm(), judged(arm()), folder / "in.prg", folder / "out.prg"))


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("Go P1", "line 3: Go P1: this is not understood"),
        ("Go pick +Z(50)", "this is not understood"),
        ("Go XY(400, 0, 300, 0, 0, 180)", "this is not understood"),
        ("Go JA(0, 10, -20, 0, 30, 0) +Z(10)", "this is not understood"),
        ("Go JA(0, 10, -20, 0, 30, 0) Till Sw(1) = On", "this is not understood"),
        ("Go JA(a, 10, -20, 0, 30, 0)", "this is not understood"),
        ("Go JA(10, -20, 0, 30, 0)", "has 5 numbers, and not 6"),
        ("Move Here +X(10)", "this is not understood"),
        ("P1 = JA(0, 10, -20, 0, 30, 0)", "this is not understood"),
        ("Arc P1, P2", "this is not understood"),
        ("Jump P1", "this is not understood"),
        ("Hofs 0, 1, 2, 3, 4, 5", "this is not understood"),
        ("Call grip", "what GRIP does is not known; --call GRIP"),
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

    def joints(content: str) -> dict[int, tuple[float, ...]]:
        log.write_text(content)
        job = ImportJob.begin([log], plan, tmp_path / "run.jsonl")
        return {shot.shot: shot.joints_deg for shot in READER.read(job).shots}

    right, refused = joints(text), 0
    lines = {int(line.split()[2]): line for line in text.splitlines() if " posture " in line}
    assert len(right) == 4
    for content in damaged(text, files):
        try:
            measured = joints(content)
        except BadInput:
            refused += 1
            continue
        for number, row in measured.items():
            assert row == right[number] or lines[number] not in content.split("\n")
    assert 0.1 * files < refused < files


@FILES
def test_damaged_programs_are_refused_or_mean_what_they_meant(tmp_path: Path, files: int) -> None:
    """A position whose line is as it was is corrected as it was."""
    text = controller.user_program(arm(), varied(arm(), 4))

    def moves(program: str) -> list[str]:
        return re.findall(r"Go JA\(.*\).*", program)

    right = dict(zip(moves(text), moves(corrected(tmp_path, text)), strict=True))
    assert len(right) == 4
    refused = 0
    for content in damaged(text, files):
        try:
            program = corrected(tmp_path, content)
        except BadInput:
            refused += 1
            continue
        for before, after in zip(moves(content), moves(program), strict=True):
            assert right.get(before, after) == after
    assert 0.3 * files < refused < files


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
