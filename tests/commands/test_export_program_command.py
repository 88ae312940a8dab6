"""`zerobeam export program`: a program for the arm of a run, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from command_line import zerobeam
from export_runs import arm_run
from user_programs import UserProgram, varied, written

from zerobeam.experiments.demos import demo_runs
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import write_run

GOOD, X_PATTERN = demo_runs()[0].path, demo_runs()[1].path


def program(folder: Path, name: str = "irb1600", language: str = "rapid") -> Path:
    robot = load_robot(name)
    own = UserProgram(language, robot, varied(robot, 4))
    return written(folder, own, own.text())


def test_a_program_is_written_and_what_was_done_is_said(tmp_path: Path) -> None:
    path, out = program(tmp_path), tmp_path / "out.mod"
    told = zerobeam("export", "program", GOOD, path, "-o", out)
    assert told.status == 0
    assert "joint targets: 2, moved by up to" in told.out
    assert "not corrected, as 0: delta1" in told.out
    content = out.read_bytes()
    assert b"! not corrected, as 0: delta1" in content
    assert b"caf\xe9" in content
    again = zerobeam("export", "program", GOOD, path, "-o", out).refused()
    assert "exists already" in again
    kept = zerobeam("export", "program", GOOD, path, "-o", path, "--force").refused()
    assert "it would be lost" in kept


def test_what_is_unidentifiable_is_not_applied(tmp_path: Path) -> None:
    path, out = program(tmp_path), tmp_path / "out.mod"
    told = zerobeam("export", "program", X_PATTERN, path, "-o", out).refused()
    assert "cannot be exported" in told
    assert not out.exists()


def test_both_files_of_a_krl_program_are_written_and_other_robots_refused(tmp_path: Path) -> None:
    path = program(tmp_path, "kr6_r900", "krl")
    told = zerobeam("export", "program", GOOD, path, "-o", tmp_path / "out.src").refused()
    assert "is for robots of KUKA" in told
    assert "--tool" in zerobeam("export", "program", "--help").out
    assert not (tmp_path / "out.dat").exists()


def test_a_misfit_is_not_applied_unless_asked_for(tmp_path: Path) -> None:
    run = arm_run(tmp_path)
    rng = np.random.default_rng(0)
    shots = [
        shot.model_copy(update={"joints_deg": tuple(np.array(shot.joints_deg) + rng.normal(0, 0.1, 6))})
        for shot in run.shots
    ]
    bad = tmp_path / "bad.jsonl"
    write_run(bad, run.header, shots)
    path, out = program(tmp_path), tmp_path / "out.mod"
    told = zerobeam("export", "program", bad, path, "-o", out)
    assert told.status == 1
    assert "(misfit)" in told.err
    assert not out.exists()
    told = zerobeam("export", "program", bad, path, "-o", out, "--unvalidated")
    assert told.status == 1
    assert "UNVALIDATED" in out.read_text(encoding="latin-1")
