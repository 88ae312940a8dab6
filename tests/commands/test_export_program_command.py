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
    for sentence in (
        "Do ONE of these, never both: enter the values at the controller, or use corrected programs",
        "targets that were taught on this arm hold the offsets already",
        "tools and frames that were measured with the uncorrected arm",
        "first run: reduced speed",
    ):
        assert sentence in told.out
        assert sentence.encode() in content
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


def test_each_corrected_target_is_shown_with_its_joints_and_how_far_it_moves(tmp_path: Path) -> None:
    """The table is behind the long list of parameters; its numbers are those of the nominal arm."""
    robot = load_robot("irb1600")
    rows = varied(robot, 4)
    path, out = program(tmp_path), tmp_path / "out.mod"
    answer = zerobeam("export", "program", GOOD, path, "-o", out)
    lines = answer.out.splitlines()
    table = next(i for i, line in enumerate(lines) if line.startswith("corrected target"))
    assert max(i for i, line in enumerate(lines) if line.startswith("link")) < table
    assert next(i for i, line in enumerate(lines) if "moved by up to" in line) > table
    answer = zerobeam("export", "program", GOOD, path, "-o", out, "--force", "--json")
    targets = {target["name"]: target for target in answer.json["targets"]}
    assert set(targets) == {"j0", "p1", "j2", "p3"}
    assert [targets[name]["kind"] for name in ("j0", "p1")] == ["joints", "pose"]
    corrected = UserProgram("rapid", robot, rows).commanded(out.read_text(encoding="latin-1"))
    for i, name in enumerate(("j0", "p1", "j2", "p3")):
        np.testing.assert_allclose(targets[name]["joints_deg"], rows[i], atol=1e-5)
        assert abs(targets[name]["moved_deg"] - np.abs(corrected[i] - rows[i]).max()) < 1e-4
        apart = robot.fk(corrected[i], "deg")[:3, 3] - robot.fk(rows[i], "deg")[:3, 3]
        assert abs(targets[name]["moved_mm"] - np.linalg.norm(apart)) < 0.2 * np.linalg.norm(apart)  # tool
    assert targets["p1"]["configuration"] == str(UserProgram("rapid", robot, rows).confdata(rows[1])).replace(
        " ", ""
    )
    assert targets["j0"]["configuration"] is None


def test_a_run_of_a_corrected_robot_file_corrects_no_program(tmp_path: Path) -> None:
    """Beside that file nothing is left to correct, and the controller computes with the nominal arm."""
    arm, run, path = tmp_path / "corrected.yaml", tmp_path / "run.jsonl", program(tmp_path)
    assert zerobeam("export", "robot", GOOD, "-o", arm).status == 0
    assert "never both" in " ".join(arm.read_text(encoding="utf-8").split())
    run.write_text(GOOD.read_text().replace('"robot":"irb1600"', '"robot":"corrected.yaml"', 1))
    refused = zerobeam("export", "program", run, path, "-o", tmp_path / "out.mod").refused()
    assert "is a corrected arm already" in " ".join(refused.split())
    assert not (tmp_path / "out.mod").exists()
    sheet = zerobeam("export", "rapid", run, "-o", tmp_path / "offsets.mod")
    assert "(corrected.yaml) is a corrected arm already" in " ".join(sheet.out.split())
    assert zerobeam("robot", "irb1600", "-o", tmp_path / "nominal.yaml").status == 0  # the control
    run.write_text(GOOD.read_text().replace('"robot":"irb1600"', '"robot":"nominal.yaml"', 1))
    assert zerobeam("export", "program", run, path, "-o", tmp_path / "out.mod").status == 0


def test_programs_of_another_maker_and_folders_are_refused_with_what_to_name(tmp_path: Path) -> None:
    listing = program(tmp_path, "lrmate_200id", "fanuc")
    refused = " ".join(
        zerobeam("export", "program", GOOD, listing, "-o", tmp_path / "a.ls").refused().split()
    )
    assert "is for robots of FANUC" in refused
    assert "name a program of this robot's controller: .mod (RAPID)" in refused
    whole = " ".join(zerobeam("export", "program", GOOD, tmp_path, "-o", tmp_path / "b").refused().split())
    assert f"{tmp_path.name}/{listing.name} -o corrected/{listing.name}" in whole


def test_a_folder_is_made_for_a_program_that_is_corrected_and_for_no_other(tmp_path: Path) -> None:
    path, out = program(tmp_path), tmp_path / "corr" / "job.mod"
    text = path.read_bytes()
    path.write_bytes(
        text.replace(b"    MoveJ p1", b"    MoveL Offs(p1,0,0,5),v100,fine,tGrip;\r\n    MoveJ p1")
    )
    assert "is computed" in zerobeam("export", "program", GOOD, path, "-o", out).refused()
    assert not out.parent.exists()
    path.write_bytes(text)
    assert zerobeam("export", "program", GOOD, path, "-o", out).status == 0
    assert out.is_file()
