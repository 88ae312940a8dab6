"""Random RAPID modules: refused, or the true arm's flange goes where the program means it.

An independent controller (`rapid_controller`) runs the program on the nominal arm and the corrected one on
the true arm, with the same random inputs.
"""

from __future__ import annotations

import random
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from controller_arm import ControllerArm, same_poses
from rapid_controller import RapidController
from rapid_programs import FORMS, Form, RapidProgram, Writer, listed
from user_programs import corrected_for, deviating, read

from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput
from zerobeam.model.kinematics.robot import Robot

RUNS = 3  # with other inputs


def true_arm(robot: Robot, seed: int) -> tuple[Robot, Matrix]:
    """The robot, with links that deviate in every third, and offsets (6,) of its joints, degrees."""
    rng = np.random.default_rng(seed)
    links = deviating(robot, rng, (1, 3) if seed % 3 == 0 else ())
    return links, rng.uniform(-1, 1, 6).round(4)


def corrected(program: RapidProgram, text: str, seed: int, folder: Path) -> tuple[str, list[str]]:
    """The corrected program, and what is said of it."""
    (folder / "in.mod").write_bytes(text.encode("latin-1"))
    done = corrected_for(*true_arm(program.robot, seed), program.robot, folder / "in.mod", program.choices)
    return read(done), done.notes


def same(program: RapidProgram, text: str, new: str, seed: int) -> bool:
    """Whether the true arm goes by the new text where the nominal one goes by the program's."""
    links, offsets = true_arm(program.robot, seed)
    nominal, true = ControllerArm.of(program.robot), ControllerArm.of(links, offsets)
    harmless = frozenset(name.lower() for name in program.choices.calls)
    meant, reached = (
        RapidController(nominal, arm, program.wrist, program.rows, program.elsewhere, harmless)
        for arm in (nominal, true)
    )
    start = program.rows[0]
    poses = [(meant.run(text, run, start), reached.run(new, run, start)) for run in range(RUNS)]
    assert sum(len(each) for each, _ in poses)
    return all(same_poses(*each) for each in poses)


def outcome(seed: int, folder: Path) -> bool:
    """Whether a random program is accepted; then it is right."""
    rng = random.Random(seed)
    forms = [FORMS[name] for name in rng.sample(sorted(FORMS), rng.choice([0, 0, 0, 1, 1, 2]))]
    program = Writer(seed).program(forms, rng.randint(3, 12))
    try:
        new, said = corrected(program, program.text, seed, folder)
    except BadInput:
        return False
    assert same(program, program.text, new, seed), program.text
    counts = program.counts
    assert said[0] == (
        f"positions in the program: {sum(counts.values())}; corrected: {counts['target']};"
        f" left as they are: {counts['left']}; poses of tools and frames: {counts['frame']}"
    )
    return True


LONG = [pytest.param(range(k, k + 100), marks=pytest.mark.long) for k in range(40, 2140, 100)]


@pytest.mark.parametrize("seeds", [range(6), pytest.param(range(6, 40), marks=pytest.mark.long), *LONG])
def test_a_random_program_is_right_or_refused(tmp_path: Path, seeds: range) -> None:
    assert sum(outcome(seed, tmp_path) for seed in seeds) >= len(seeds) / 4


# Forms that are refused where they are solved; the others as they are read.
SOLVED = {"a configuration that is none", "a pose out of reach", "a singular wrist"}


@pytest.mark.parametrize("name", sorted(FORMS))
def test_each_form_is_refused_alone(request: pytest.FixtureRequest, tmp_path: Path, name: str) -> None:
    if name not in SOLVED:
        request.getfixturevalue("unsolved")
    form, writer = FORMS[name], Writer(4)
    program = writer.program([form], 3, plain=True)
    with pytest.raises(BadInput) as refused:
        corrected(program, program.text, 4, tmp_path)
    words = "".join(writer.filled(form.named).split("\n")[0].split())
    lines = ["".join(line.split()) for line in program.text.split("\n")]
    places = [i for i, line in enumerate(lines, start=1) if words in line]
    assert any(f"in.mod line {i}:" in str(refused.value.found) for i in places), refused.value.found


def test_the_program_around_a_form_is_accepted(tmp_path: Path) -> None:
    program = Writer(4).program([], 3, plain=True)
    new, _ = corrected(program, program.text, 4, tmp_path)
    assert same(program, program.text, new, 4)


# Forms with which the corrected program moves the arm elsewhere, where their refusal is taken out.
WRONG = [
    "a component of a work object of another file",
    "a component in an instruction",
    "a component of a tool of another file",
    "a component of a declared work object",
    "a component of a target",
    "RelTool",
    "a shift of all targets",
    "a number of a frame by reference",
    "a work object by reference",
]


@pytest.mark.parametrize("name", WRONG)
@pytest.mark.one_in(9)
def test_without_its_refusal_a_form_is_found_wrong(tmp_path: Path, name: str) -> None:
    """The rewriter sees harmless lines in place of the form; the controllers run the form."""
    form, seed = FORMS[name], 4
    unseen = Form('TPWrite "form";', "! declared", "! routine", calls=form.calls)
    with_form, without = (Writer(seed).program([each], 3) for each in (form, unseen))
    new, _ = corrected(without, without.text, seed, tmp_path)
    writer = Writer(seed)
    writer.program([], 3)
    for mark, text in zip(
        ('TPWrite "form";', "! declared", "! routine"),
        (form.statement, form.declaration, form.routine),
        strict=True,
    ):
        new = new.replace(mark, writer.filled(text))
    assert not same(with_form, with_form.text, new, seed)


@pytest.mark.usefixtures("unsolved")
@pytest.mark.parametrize("at", range(40, 1500, 97))
def test_a_program_that_is_cut_is_one_clear_refusal(tmp_path: Path, at: int) -> None:
    program = Writer(4).program([], 3, plain=True)
    with pytest.raises(BadInput) as refused:
        corrected(program, program.text[:at], 4, tmp_path)
    assert "in.mod line" in str(refused.value)


@pytest.mark.parametrize(
    ("option", "name"), [("leave", "pl"), ("tools", "tHan=0,0,1,1,0,0,0"), ("frames", "wFixed=0,0,1,1,0,0,0")]
)
def test_a_name_that_the_program_does_not_have_is_an_error(tmp_path: Path, option: str, name: str) -> None:
    program = Writer(4).program([], 3, plain=True)
    choices = program.choices
    program.choices = replace(choices, **{option: [*getattr(choices, option), name]})
    with pytest.raises(BadInput, match="names what the program does not have"):
        corrected(program, program.text, 4, tmp_path)


def test_a_stated_world_frame_carries_all_work_objects(tmp_path: Path) -> None:
    """A world frame 2 mm below the base is the same as work objects that are."""
    writer = Writer(4)
    program = writer.program([], 3, plain=True)
    world = replace(program.choices, frames=[*program.choices.frames, "wobj0=0,0,-2,1,0,0,0"])
    lower = {name: [[x, y, z - 2], turn] for name, ((x, y, z), turn) in writer.frames.items()}
    text = program.text.replace(listed(writer.frames["wFix"]), listed(lower["wFix"]))
    assert text != program.text
    trans, turn = lower["wCell"]
    objects = replace(program.choices, frames=[f"wCell={','.join(map(listed, [*trans, *turn]))}"])
    values = []
    for choices, each in ((world, program.text), (objects, text)):
        program.choices = choices
        new, _ = corrected(program, each, 4, tmp_path)
        values.append(re.findall(r"robtarget p[01]:=.*", new))
    assert values[0] == values[1]
