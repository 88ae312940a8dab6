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
from controller_arm import ControllerArm, same_poses, with_links_moved
from ur_controller import inverse
from ur_programs import FORMS, TCP, Form, Script, Writer, good_script, nominal, with_form
from user_programs import judged, read

from zerobeam.experiments.makers.user_programs import corrected_program
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.robot import Robot

ROBOT = load_robot("ur5e")
_RUNS = 3


def true_links(rng: np.random.Generator) -> Robot:
    """A robot of which some links deviate, in one of three programs."""
    return with_links_moved(ROBOT, (1, 3) if rng.random() < 0.3 else (), 0.5, rng)


def corrected_by(
    script: Script, text: str, links: Robot, offsets: np.ndarray, folder: Path
) -> tuple[str, list[str]]:
    """The corrected program, and what is said of it."""
    (folder / "in.script").write_bytes(text.encode("latin-1"))
    calibration = judged(ROBOT, offsets)
    calibration.corrected = links.with_offsets(np.radians(offsets))
    done = corrected_program(ROBOT, calibration, folder / "in.script", folder / "out.script", script.choices)
    return read(done), done.notes


def flanges(script: Script, text: str, arm: ControllerArm, seed: int, run: int) -> np.ndarray:
    """(N, 4, 4): the poses of an arm's flange at the end of each motion."""
    rng = np.random.default_rng([seed, run])
    # The arm is anywhere before the program.
    start = script.rows[0] + rng.uniform(-60, 60, 6)
    rows = script.controller().run(text, start, rng)
    return np.array([arm.fk(row) for row in rows]).reshape(-1, 4, 4)


def agree(
    script: Script, text: str, corrected: str, links: Robot, offsets: np.ndarray, seed: int
) -> tuple[bool, float, int]:
    """Whether all poses are as meant, the most that they are off, mm, and how many there are."""
    true, right, worst, count = ControllerArm.of(links, offsets), True, 0.0, 0
    for run in range(_RUNS):
        meant, reached = (
            flanges(script, text, nominal(), seed, run),
            flanges(script, corrected, true, seed, run),
        )
        right = right and same_poses(meant, reached)
        if len(meant) == len(reached) and len(meant):
            worst = max(worst, float(np.linalg.norm((meant - reached)[:, :3, 3], axis=1).max()))
        count += len(meant)
    return right, worst, count


def checked(seed: int, folder: Path) -> tuple[bool, float, int, str]:
    """A random program: whether it is accepted, the most that a pose is off, and how many there are."""
    rng = np.random.default_rng([9, seed])
    script, links, offsets = good_script(rng), true_links(rng), np.round(rng.uniform(-1, 1, 6), 3)
    if rng.random() < 0.4 and {"W0_p", "W0_q"} <= set(re.findall(r"W0_[pq]", " ".join(script.head))):
        script = with_form(
            script, FORMS[int(rng.integers(len(FORMS)))], int(rng.integers(len(script.body) + 1))
        )
    text = script.text()
    try:
        corrected, said = corrected_by(script, text, links, offsets, folder)
    except BadInput as error:
        return False, 0.0, 0, f"{script.form}: {error}"
    right, worst, count = agree(script, text, corrected, links, offsets, seed)
    assert right, (seed, worst, text)
    if not script.form:
        assert said[0].startswith(f"positions in the program: {script.literals}; corrected: ")
    return True, worst, count, script.form


def all_right(seeds: range, folder: Path) -> tuple[int, float, int]:
    """How many are accepted, the most that a pose is off, mm, and how many poses there are."""
    results = [checked(seed, folder) for seed in seeds]
    accepted = [result for result in results if result[0]]
    assert len(accepted) >= len(results) / 4
    count = sum(result[2] for result in accepted)
    assert count > 5 * len(accepted)
    return len(accepted), max(result[1] for result in accepted), count


def test_random_programs_are_refused_or_right(tmp_path: Path) -> None:
    all_right(range(40), tmp_path)


@pytest.mark.long
def test_many_random_programs_are_refused_or_right(tmp_path: Path) -> None:
    all_right(range(40, 2100), tmp_path)


def test_the_controller_of_the_tests_finds_all_joints_of_a_pose() -> None:
    for row in np.random.default_rng(0).uniform(-150, 150, (20, 6)):
        solutions = np.degrees(inverse(nominal().fk(row)))
        for each in solutions:
            np.testing.assert_allclose(nominal().fk(each), nominal().fk(row), atol=1e-6)
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
    assert agree(script, script.text(), corrected, ROBOT, OFFSETS, 1)[0]


@pytest.mark.parametrize("form", FORMS, ids=[form.name for form in FORMS])
def test_each_form_is_refused_alone_with_its_line(form: Form, tmp_path: Path) -> None:
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
def test_a_form_that_the_rewriter_does_not_see_makes_wrong_poses(form: Form, tmp_path: Path) -> None:
    """What the comparison is worth: with the instruction hidden from the rewriter it finds the error."""
    script = plain()
    bad, text = with_form(script, form, 3), script.text()
    corrected = corrected_by(script, text, ROBOT, OFFSETS, tmp_path)[0]
    corrected = corrected[corrected.index("def job") :]
    head = tuple(corrected.splitlines()[1 : 1 + len(script.head)])
    assert not agree(bad, bad.text(), replace(bad, head=head).text(), ROBOT, OFFSETS, 1)[0]


def test_a_program_that_ends_anywhere_is_refused_or_ends_between_statements(tmp_path: Path) -> None:
    script = plain()
    text = script.text().replace("\njob()", "")
    for end in np.linspace(1, len(text) - 3, 25).astype(int):
        with pytest.raises(BadInput, match="nothing is written"):
            corrected_by(script, text[:end], ROBOT, OFFSETS, tmp_path)
