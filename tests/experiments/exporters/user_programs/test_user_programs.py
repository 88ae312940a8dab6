"""Whole programs: corrected, they bring the flange of the true arm to where the program means it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from user_programs import OFFSETS, STATED, UserProgram, flange_arm, judged, read, varied, written

from zerobeam.experiments.exporters.user_programs.filtered import filtered
from zerobeam.model.files.robot_file import load_robot

ARMS = {
    "irb1600": "rapid",
    "irb120": "rapid",
    "kr6_r900": "krl",
    "lrmate_200id": "fanuc",
    "ur5e": "urscript",
}


@pytest.mark.parametrize("name", ARMS)
def test_the_true_arm_reaches_what_the_program_means(tmp_path: Path, name: str) -> None:
    robot, language = load_robot(name), ARMS[name]
    program = UserProgram(language, robot, varied(robot, 10))
    text = program.text()
    # The interpreter reads the program as it is meant.
    np.testing.assert_allclose(program.commanded(text), program.rows, atol=5e-3)
    path = written(tmp_path, program, text)
    done = filtered(robot, judged(robot), path, tmp_path / f"out{path.suffix}", STATED.get(language))
    arm = flange_arm(robot)
    true = arm.with_offsets(np.radians(OFFSETS))
    meant = arm.fk(program.rows)
    reached = true.fk(program.commanded(read(done)))
    # A thousandth of a degree and of a mm in FANUC's listings, at up to 0.9 m; else six decimals.
    within = 0.05 if language == "fanuc" else 1e-3
    assert np.linalg.norm((reached - meant)[:, :3, 3], axis=1).max() < within
    assert np.abs((reached - meant)[:, :3, :3]).max() < within / 500
    without = np.linalg.norm((true.fk(program.rows) - meant)[:, :3, 3], axis=1)
    assert without.min() > 1.0


@pytest.mark.parametrize("name", ["irb1600", "kr6_r900", "lrmate_200id", "ur5e"])
def test_all_else_stays_byte_for_byte(tmp_path: Path, name: str) -> None:
    robot, language = load_robot(name), ARMS[name]
    program = UserProgram(language, robot, varied(robot, 4))
    path = written(tmp_path, program, program.text())
    nothing = judged(robot, np.zeros(6))
    done = filtered(robot, nothing, path, tmp_path / f"out{path.suffix}", STATED.get(language))
    files = sorted(tmp_path.iterdir())
    assert sorted(own.suffix for own in done.files) == [own.suffix for own in files]
    for own in files:
        content = done.files[tmp_path / f"out{own.suffix}"]
        old = own.read_bytes()
        # Without an offset nothing changes but the comments at the head.
        head = [
            line for line in content.splitlines(keepends=True) if line not in old.splitlines(keepends=True)
        ]
        assert b"zerobeam export program" in head[0]
        assert content.replace(b"".join(head), b"") == old
        assert all(line.endswith(b"\r\n") == (b"\r\n" in old) for line in head)
