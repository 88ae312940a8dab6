"""Random URScript programs: refused, or the true arm's flange goes where the program means it.

An independent controller (`ur_controller`) runs the program on the nominal arm and the corrected one on the
true arm, with the same random inputs.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from controller_arm import ControllerArm, same_poses
from ur_controller import inverse
from ur_programs import FORMS, TCP, Form, Script, Writer, good_script, nominal, with_form
from user_programs import corrected_for, deviating, read

from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.robot import Robot

ROBOT = load_robot("ur5e")
_RUNS = 3


def corrected_by(
    script: Script, text: str, links: Robot, offsets: np.ndarray, folder: Path
) -> tuple[str, list[str]]:
    """The corrected program, and what is said of it."""
    (folder / "in.script").write_bytes(text.encode("latin-1"))
    done = corrected_for(links, offsets, ROBOT, folder / "in.script", script.choices)
    return read(done), done.notes


def flanges(script: Script, text: str, arm: ControllerArm, seed: int, run: int) -> np.ndarray:
    """(N, 4, 4): the poses of an arm's flange at the end of each motion."""
    rng = np.random.default_rng([seed, run])
    # The arm is anywhere before the program.
    start = script.rows[0] + rng.uniform(-60, 60, 6)
    rows = script.controller().run(text, start, rng)
    return np.array([arm.fk(row, "deg") for row in rows]).reshape(-1, 4, 4)


def agree(
    script: Script, text: str, corrected: str, links: Robot, offsets: np.ndarray, seed: int
) -> int | None:
    """How many poses are compared, or None where one is not as meant."""
    true, count = ControllerArm.of(links, offsets), 0
    for run in range(_RUNS):
        meant = flanges(script, text, nominal(), seed, run)
        if not same_poses(meant, flanges(script, corrected, true, seed, run)):
            return None
        count += len(meant)
    return count


def checked(seed: int, folder: Path) -> int | None:
    """A random program: how many poses it has, all right, or None where it is refused."""
    rng = np.random.default_rng([9, seed])
    script = good_script(rng)
    links = deviating(ROBOT, rng, (1, 3) if rng.random() < 0.3 else ())
    offsets = np.round(rng.uniform(-1, 1, 6), 3)
    if rng.random() < 0.4 and {"W0_p", "W0_q"} <= set(re.findall(r"W0_[pq]", " ".join(script.head))):
        script = with_form(
            script, FORMS[int(rng.integers(len(FORMS)))], int(rng.integers(len(script.body) + 1))
        )
    text = script.text()
    try:
        corrected, said = corrected_by(script, text, links, offsets, folder)
    except BadInput:
        return None
    count = agree(script, text, corrected, links, offsets, seed)
    assert count is not None, (seed, text)
    if not script.form:
        assert said[0].startswith(f"positions in the program: {script.literals}; corrected: ")
    return count


@pytest.mark.parametrize("seeds", [range(6), pytest.param(range(6, 2100), marks=pytest.mark.long)])
def test_random_programs_are_refused_or_right(seeds: range, tmp_path: Path) -> None:
    accepted = [count for seed in seeds if (count := checked(seed, tmp_path)) is not None]
    assert len(accepted) >= len(seeds) / 4
    assert sum(accepted) > 5 * len(accepted)


def test_the_controller_of_the_tests_finds_all_joints_of_a_pose() -> None:
    for row in np.random.default_rng(0).uniform(-150, 150, (20, 6)):
        solutions = np.degrees(inverse(nominal().fk(row, "deg")))
        for each in solutions:
            np.testing.assert_allclose(nominal().fk(each, "deg"), nominal().fk(row, "deg"), atol=1e-6)
        assert np.abs((solutions - row + 180) % 360 - 180).max(axis=1).min() < 1e-6


ROWS = np.array([[10.0, -80, 95, -100, -85, 20], [25.0, -70, 80, -95, -95, 10]])
OFFSETS = np.array([0.5, -0.9, 0.6, 0.4, -0.7, 0.5])


def plain() -> Script:
    """A short program that is accepted."""
    writer = Writer(np.random.default_rng(0))
    writer.rows = ROWS
    head = [f"set_tcp(p[{', '.join(map(str, TCP))}])", "global x = 0", f"global W0_p = {writer.pose(0)}"]
    head += [f"global W0_q = {writer.joints(0)}", f"global W1_p = {writer.pose(1)}"]
    body = ["movej(get_inverse_kin(W0_p, qnear=W0_q))", "movel(W1_p)", "movej(W0_q)"]
    return Script(tuple(head), tuple(body), ROWS, 4)


def test_the_short_program_is_right(tmp_path: Path) -> None:
    script = plain()
    corrected, said = corrected_by(script, script.text(), ROBOT, OFFSETS, tmp_path)
    assert said[0].endswith("4; corrected: 3; left as they are: 0; poses of tools and frames: 1")
    assert agree(script, script.text(), corrected, ROBOT, OFFSETS, 1)


# Forms that are refused where a pose is solved, near joints that are not known; the others as they are read.
SOLVED = {
    *("a pose after a branch", "a pose in an else", "a pose in a loop", "a pose in a routine"),
    *("a pose after a routine", "a pose after a routine in an expression"),
}


@pytest.mark.parametrize("form", FORMS, ids=[form.name for form in FORMS])
def test_each_form_is_refused_alone_with_its_line(
    form: Form, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    if form.name not in SOLVED:
        request.getfixturevalue("unsolved")
    script = plain()
    bad = with_form(script, form, 3)
    with pytest.raises(BadInput) as refused:
        corrected_by(bad, bad.text(), ROBOT, OFFSETS, tmp_path)
    begin = 2 + len(script.head) + 3
    named = {int(line) for line in re.findall(r"in\.script line (\d+):", str(refused.value))}
    # Which block has no end cannot be known: the end of the program is named.
    last = bad.text().count("\n") + 1 if form.name == "a block without an end" else 0
    assert named & {*range(begin, begin + len(form.lines) + 2), last}, str(refused.value)
    assert "nothing is written" in str(refused.value)


@pytest.mark.parametrize("form", [form for form in FORMS if form.runs], ids=lambda form: form.name)
@pytest.mark.one_in(3)
def test_a_form_that_the_rewriter_does_not_see_makes_wrong_poses(form: Form, tmp_path: Path) -> None:
    """What the comparison is worth: with the instruction hidden from the rewriter it finds the error."""
    script = plain()
    bad, text = with_form(script, form, 3), script.text()
    corrected = corrected_by(script, text, ROBOT, OFFSETS, tmp_path)[0]
    corrected = corrected[corrected.index("def job") :]
    head = tuple(corrected.splitlines()[1 : 1 + len(script.head)])
    assert agree(bad, bad.text(), replace(bad, head=head).text(), ROBOT, OFFSETS, 1) is None


def test_a_program_that_ends_anywhere_is_refused_or_ends_between_statements(tmp_path: Path) -> None:
    script = plain()
    text = script.text().replace("\njob()", "")
    for end in np.linspace(1, len(text) - 3, 25).astype(int):
        with pytest.raises(BadInput, match="nothing is written"):
            corrected_by(script, text[:end], ROBOT, OFFSETS, tmp_path)
