"""Random KRL programs: refused, or the true arm does with the corrected one what the program means.

The original runs on the nominal arm, the corrected one on the true arm, by a controller that shares no code
with what is tested.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from controller_arm import ControllerArm, same_poses
from krl_controller import Controller, Invalid
from krl_random import BAD, Program, Writer
from user_programs import corrected_for, deviating, read

from zerobeam.experiments.makers.user_programs import CorrectedProgram
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.robot import Robot

ROBOT = load_robot("kr6_r900")
LOWER, UPPER = np.degrees(ROBOT.lower), np.degrees(ROBOT.upper)
NOMINAL = ControllerArm.of(ROBOT)
_ALONE = [name for name in BAD if name != "an end without a begin"]  # it may close another structure


def true_arm(rng: np.random.Generator) -> tuple[Robot, Matrix]:
    """An arm whose links may deviate, and its offsets, up to a degree."""
    offsets = np.append(0.0, rng.uniform(-1, 1, 5))
    return deviating(ROBOT, rng, (1, 2, 3) if rng.random() < 0.3 else (), 0.8), offsets


def corrected(folder: Path, program: Program, robot: Robot, offsets: Matrix) -> CorrectedProgram:
    (folder / "job.src").write_text(program.src)
    (folder / "job.dat").write_text(program.dat)
    return corrected_for(robot, offsets, ROBOT, folder / "job.src", program.choices)


def poses(program: Program, text: str, arm: ControllerArm, seed: int) -> Matrix:
    """(N, 4, 4) of the flange of an arm, at the ends of the motions that are not left."""
    foreign: dict[str, Any] = {"GRIPPER": lambda _: None}
    limits = LOWER, UPPER
    run = Controller(text, NOMINAL, arm, program.rows, limits, seed, program.config(), foreign, ["XHOME"])
    return run.run()


def counts(done: CorrectedProgram) -> Counter[str]:
    said = next(line for line in done.notes if line.startswith("positions in the program"))
    numbers = [int(number) for number in re.findall(r"\d+", said)]
    assert numbers[0] == sum(numbers[1:])
    return Counter({"target": numbers[1], "left": numbers[2], "frame": numbers[3]})


def judge(folder: Path, seed: int, inputs: int) -> str:
    """Write a program, correct it, run both with different inputs: what came of it."""
    rng = np.random.default_rng([7, seed])
    bad = [str(rng.choice(_ALONE)) for _ in range(int(rng.choice([0, 0, 0, 0, 1, 2])))]
    program = Writer(seed, NOMINAL, LOWER, UPPER).program(bad)
    robot, offsets = true_arm(rng)
    try:
        done = corrected(folder, program, robot, offsets)
    except BadInput:
        return "refused"
    assert not bad, f"{seed}: accepted with {bad}"
    assert counts(done) == program.literals, seed
    arm, runs = ControllerArm.of(robot, offsets), 0
    for again in range(inputs):
        try:
            meant = poses(program, program.text, NOMINAL, again)
        except Invalid:
            continue
        reached = poses(program, read(done), arm, again)
        assert same_poses(meant, reached), f"{seed}, run {again}"
        runs += bool(len(meant))
    return "accepted" if runs else "not run"


@pytest.mark.parametrize(("count", "inputs"), [(6, 1), pytest.param(2000, 3, marks=pytest.mark.long)])
def test_random_programs(tmp_path: Path, count: int, inputs: int) -> None:
    found = Counter(judge(tmp_path, seed, inputs) for seed in range(count))
    assert found["accepted"] >= count / 4, found


def program_with(name: str | None) -> Program:
    """A good program, with one thing in it that has to be refused."""
    writer = Writer(1, NOMINAL, LOWER, UPPER)
    writer.point(3, 2)
    writer.say("BAS(#INITMOV,0)", "BAS(#TOOL,3)", "BAS(#BASE,2)", f"PTP {writer.axes()}", "PTP XP1")
    if name is not None:
        writer.bad(name)
    writer.say("BAS(#TOOL,3)", "BAS(#BASE,2)", "PTP XP1", "PTP XHOME")
    return writer.finished([], home=True)


def test_the_program_without_what_is_refused_is_corrected(tmp_path: Path) -> None:
    done = corrected(tmp_path, program_with(None), ROBOT, np.full(6, 0.3))
    assert "corrected: 2; left as they are: 0; poses of tools and frames: 0" in done.notes[0]


@pytest.mark.usefixtures("unsolved")
@pytest.mark.parametrize("name", BAD)
def test_each_alone_is_refused_with_its_line(tmp_path: Path, name: str) -> None:
    program = program_with(name)
    with pytest.raises(BadInput) as refused:
        corrected(tmp_path, program, ROBOT, np.full(6, 0.3))
    said = str(refused.value)
    assert "nothing is written" in said
    for file, text in (("job.src", program.src), ("job.dat", program.dat)):
        for number, line in enumerate(text.splitlines(), start=1):
            assert (f"{file} line {number}:" in said) >= line.endswith(";BAD"), said


@pytest.mark.parametrize(
    "name",
    [
        "a component of the base",
        "a base and a shift",
        "a base that is computed for a spline",
        "a component of the tool",
        "a component of a tool of the controller",
        "another base for an inline form",
        "a base of the controller from a variable",
        "a component of a target",
        "a target and a shift",
        "a relative linear motion",
        "a trigger that shifts the base",
    ],
)
@pytest.mark.one_in(4)
def test_the_controller_shows_what_the_refusal_prevents(tmp_path: Path, name: str) -> None:
    """With the refused lines out of sight of what is tested, the arm goes to other places than are meant."""
    program = program_with(name)
    by_data = "{data}" in BAD[name].lines[0]
    use = ["FDAT_ACT=FP1", "BAS(#CP_PARAMS,0.1)"] if by_data else []
    lines = program.src.splitlines()
    behind = max(i for i, line in enumerate(lines) if line.endswith(";BAD")) + 1
    behind += 2 if lines[behind - 1].startswith("SPLINE") else 0
    hidden = [re.sub("^(SPLINE )?", r"\1;HIDDEN ", line) if line.endswith(";BAD") else line for line in lines]
    src = "\n".join([*hidden[:behind], *use, "LIN XP1", "LIN XP1", *hidden[behind:], ""])
    dat = re.sub("^(.*SHIFTED)", r";HIDDEN \1", program.dat, flags=re.MULTILINE)
    program = replace(program, src=src, dat=dat)
    offsets = np.array([0, 0.8, -0.9, 0.7, 0.9, -0.5])
    done = corrected(tmp_path, program, ROBOT, offsets)
    meant = poses(program, program.text.replace(";HIDDEN ", ""), NOMINAL, 0)
    reached = poses(program, read(done).replace(";HIDDEN ", ""), ControllerArm.of(ROBOT, offsets), 0)
    assert len(meant)
    assert not same_poses(meant, reached)
