"""What stops or misleads a person in the first hour: names, units, existing files, a rehearsal's truth."""

import os
import subprocess
import sys

import numpy as np
import pytest
from command_line import zerobeam
from exact_runs import demo_runs

from zerobeam.model.files.run import read_run
from zerobeam.model.parsing.reading import did_you_mean

HEADER = """robot: irb1600
tool: {kind: laser, point_mm: [0, 0, 65], direction: [1, 0, 0]}
noise: {joint_deg: 0.01, spot_mm: 0.05}
"""
PROBE = HEADER.replace("kind: laser", "kind: probe").replace(", direction: [1, 0, 0]", "")
TARGETS = "targets: {psd: {guess_mm: [950, 150, 100]}}\n"


@pytest.fixture
def header(tmp_path):
    path = tmp_path / "header.yaml"
    path.write_text(HEADER)
    return path


def rows(unit):
    joints = read_run(demo_runs()[0].path).joints
    values = joints if unit == "rad" else np.degrees(joints)
    return "".join(",".join(map(repr, row)) + "\n" for row in values.tolist())


def imported(tmp_path, header, *more, text=None):
    (tmp_path / "shots.csv").write_text(rows("deg") if text is None else text)
    command = ["import", "csv", tmp_path / "shots.csv", "--header", header, "--target", "psd"]
    return zerobeam(*command, "-o", tmp_path / "run.jsonl", *more)


@pytest.mark.parametrize(
    ("word", "known", "meant"),
    [
        ("a", ["a_mm", "alpha_deg", "d_mm"], "a_mm"),
        ("alpha", ["a_mm", "alpha_deg"], "alpha_deg"),
        ("d", ["a_mm", "d_mm"], "d_mm"),
        ("ball", ["laser", "probe"], "probe"),
        ("Laser", ["laser", "probe"], "laser"),
        ("spot", ["joint_deg", "spot_mm"], "spot_mm"),
    ],
)
def test_the_word_that_was_meant(word, known, meant):
    assert did_you_mean(word, known) == f"did you mean {meant!r}?"
    assert did_you_mean("qqq", known) is None


def test_a_kind_and_a_key_that_do_not_exist(tmp_path, header):
    header.write_text(HEADER.replace("laser", "ball"))
    assert "did you mean 'probe'?" in imported(tmp_path, header, "--units", "deg").refused()
    header.write_text(HEADER.replace("point_mm", "point"))
    assert "did you mean 'point_mm'?" in imported(tmp_path, header, "--units", "deg").refused()


def test_radians_that_are_called_degrees(tmp_path, header):
    said = imported(tmp_path, header, "--units", "deg", text=rows("rad")).refused()
    assert "look like radians" in said
    assert "--units rad" in said
    assert not (tmp_path / "run.jsonl").exists()
    told = imported(tmp_path, header, "--units", "deg", "--small-angles", text=rows("rad"))
    assert told.status == 0
    assert imported(tmp_path, header, "--units", "rad", "--force", text=rows("rad")).status == 0


def test_a_file_is_replaced_on_request_only(tmp_path, header):
    assert imported(tmp_path, header, "--units", "deg").status == 0
    before = (tmp_path / "run.jsonl").read_bytes()
    header.write_text(HEADER.replace("0.01", "0.02"))
    assert "exists already" in imported(tmp_path, header, "--units", "deg").refused()
    assert (tmp_path / "run.jsonl").read_bytes() == before
    assert imported(tmp_path, header, "--units", "deg", "--overwrite").status == 0
    assert (tmp_path / "run.jsonl").read_bytes() != before


@pytest.mark.long
def test_what_is_read_is_never_replaced(tmp_path, header):
    assert imported(tmp_path, header, "--units", "deg").status == 0
    robot = zerobeam("export", "robot", tmp_path / "run.jsonl", "-o", tmp_path / "arm.yaml")
    assert robot.status == 0
    arm = (tmp_path / "arm.yaml").read_text()
    header.write_text(HEADER.replace("irb1600", "arm.yaml"))
    assert imported(tmp_path, header, "--units", "deg", "--force").status == 0
    for target in ("run.jsonl", "arm.yaml"):
        asked = ["export", "robot", tmp_path / "run.jsonl", "-o", tmp_path / target, "--force"]
        assert "would be lost" in zerobeam(*asked).refused()
    assert (tmp_path / "arm.yaml").read_text() == arm
    for target in ("shots.csv", "header.yaml", "arm.yaml"):
        again = imported(tmp_path, header, "--units", "deg", "-o", tmp_path / target, "--force")
        assert "would be lost" in again.refused()
    command = ["import", "csv", tmp_path / "sh*.csv", "--header", header, "--target", "psd", "--units", "deg"]
    assert "would be lost" in zerobeam(*command, "-o", tmp_path / "shots.csv", "--force").refused()
    asked = ["plan", "y", "--header", header, "--target", "900,0,0", "-o"]
    assert "would be lost" in zerobeam(*asked, header, "--force").refused()
    assert zerobeam(*asked, tmp_path / "plan.yaml").status in (0, 1)
    assert zerobeam(*asked, tmp_path / "plan.yaml", "--force").status in (0, 1)
    for kind in ("csv", "pdf"):
        for target in ("plan.yaml", "arm.yaml"):
            asked = ["export", "plan", kind, tmp_path / "plan.yaml", "-o", tmp_path / target, "--force"]
            assert "would be lost" in zerobeam(*asked).refused()


def plan(tmp_path, header="geometry: exact\n" + HEADER + TARGETS):
    joints = np.degrees(read_run(demo_runs()[0].path).joints)
    lines = "".join(f"  - {list(map(float, row))}\n" for row in joints)
    path = tmp_path / "plan.yaml"
    path.write_text(f"schema: zerobeam/plan/1\n{header}postures_deg:\n{lines}")
    return path


@pytest.mark.long
def test_a_rehearsal_shows_the_truth_and_is_replaced_by_another(tmp_path):
    asked = ["run", plan(tmp_path), "--rig", "simulated", "--no-camera", "-o", tmp_path / "rehearsal.jsonl"]
    told = zerobeam(*asked)
    assert told.status == 0, told.err
    true = read_run(tmp_path / "rehearsal.jsonl").header.provenance["true delta2 (deg)"]
    assert "True offsets of the simulated arm: Larger than U: J4 (δ4) is off by 0.020° (U" in told.out
    assert zerobeam(*asked).status == 2
    answer = zerobeam(*asked, "--force", "--seed", "3", "--json")
    assert answer.status == 0
    again = read_run(tmp_path / "rehearsal.jsonl").header.provenance["true delta2 (deg)"]
    assert answer.json["true"]["delta2"] == again != true
    assert "contradict" in zerobeam(*asked, "--force", "--resume").refused()


def test_measurements_are_never_replaced_by_a_rehearsal(tmp_path, header):
    assert imported(tmp_path, header, "--units", "deg").status == 0
    before = (tmp_path / "run.jsonl").read_bytes()
    asked = ["run", plan(tmp_path), "--rig", "simulated", "-o", tmp_path / "run.jsonl", "--force"]
    assert "never overwritten" in zerobeam(*asked).refused()
    assert (tmp_path / "run.jsonl").read_bytes() == before


def test_check_says_what_it_wrote(tmp_path):
    told = zerobeam("check", plan(tmp_path), "--picture", tmp_path / "plan.html")
    assert told.out.endswith(f"Picture: {tmp_path / 'plan.html'}\n")


def test_a_probes_target_is_no_psd(tmp_path):
    told = zerobeam("check", plan(tmp_path, PROBE), "--full")
    assert "socket.x" in told.out
    assert "psd" not in told.out.replace(tmp_path.name, "")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
@pytest.mark.one_in(3)
def test_completion(shell):
    script = "import sys; sys.argv[0] = 'zerobeam'; from zerobeam.cli import main; main()"
    words = {"COMP_WORDS": "zerobeam ana", "COMP_CWORD": "1", "_TYPER_COMPLETE_ARGS": "zerobeam ana"}
    words |= {"_ZEROBEAM_COMPLETE": f"complete_{shell}", "_TYPER_COMPLETE_FISH_ACTION": "get-args"}
    done = subprocess.run(
        [sys.executable, "-c", script], env=os.environ | words, capture_output=True, text=True, timeout=60
    )
    assert "analyse" in done.stdout
    assert done.stderr == ""
