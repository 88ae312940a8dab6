"""Whole programs: corrected, they bring the flange of the true arm to where the program means it."""

from __future__ import annotations

import re
from codecs import BOM_UTF8
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from user_programs import OFFSETS, STATED, UserProgram, flange_arm, judged, read, varied, written

from zerobeam.experiments.makers.user_programs import corrected_program
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.orientation import orientation

ARMS = {
    "irb1600": "rapid",
    "irb120": "rapid",
    "kr6_r900": "krl",
    "lrmate_200id": "fanuc",
    "ur5e": "urscript",
}


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.one_in(5)
def test_the_true_arm_reaches_what_the_program_means(tmp_path: Path, name: str) -> None:
    robot, language = load_robot(name), ARMS[name]
    program = UserProgram(language, robot, varied(robot, 10))
    text = program.text()
    # The interpreter reads the program as it is meant.
    np.testing.assert_allclose(program.commanded(text), program.rows, atol=5e-3)
    path = written(tmp_path, program, text)
    done = corrected_program(robot, judged(robot), path, tmp_path / f"out{path.suffix}", STATED.get(language))
    arm = flange_arm(robot)
    true = arm.with_offsets(np.radians(OFFSETS))
    meant = arm.fk(program.rows, "deg")
    reached = true.fk(program.commanded(read(done)), "deg")
    # A thousandth of a degree and of a mm in FANUC's listings, at up to 0.9 m; else six decimals.
    within = 0.05 if language == "fanuc" else 1e-3
    assert np.linalg.norm((reached - meant)[:, :3, 3], axis=1).max() < within
    assert np.abs((reached - meant)[:, :3, :3]).max() < within / 500
    without = np.linalg.norm((true.fk(program.rows, "deg") - meant)[:, :3, 3], axis=1)
    assert without.min() > 1.0


@pytest.mark.parametrize("name", ["irb1600", "kr6_r900", "lrmate_200id", "ur5e"])
@pytest.mark.one_in(4)
def test_a_byte_order_mark_stays_at_the_beginning(tmp_path: Path, name: str) -> None:
    robot, language = load_robot(name), ARMS[name]
    program = UserProgram(language, robot, varied(robot, 4))
    out, stated = tmp_path / "out", STATED.get(language)
    path = written(tmp_path, program, program.text())
    plain = corrected_program(robot, judged(robot), path, out.with_suffix(path.suffix), stated).files
    path.write_bytes(BOM_UTF8 + path.read_bytes())
    marked = corrected_program(robot, judged(robot), path, out.with_suffix(path.suffix), stated).files
    assert marked == {own: BOM_UTF8 * (own.suffix == path.suffix) + text for own, text in plain.items()}


@pytest.mark.parametrize("name", ["irb1600", "kr6_r900", "lrmate_200id", "ur5e"])
@pytest.mark.one_in(4)
def test_all_else_stays_byte_for_byte(tmp_path: Path, name: str) -> None:
    robot, language = load_robot(name), ARMS[name]
    program = UserProgram(language, robot, varied(robot, 4))
    path = written(tmp_path, program, program.text())
    nothing = judged(robot, np.zeros(6))
    done = corrected_program(robot, nothing, path, tmp_path / f"out{path.suffix}", STATED.get(language))
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


@pytest.mark.parametrize("name", ["irb120", "kr6_r900"])
@pytest.mark.one_in(2)
def test_links_that_deviate_are_corrected_too(tmp_path: Path, name: str) -> None:
    robot, language = load_robot(name), ARMS[name]
    joints = list(robot.joints)
    moved = joints[3].fixed.copy()
    moved[:3, 3] += [0.4, -0.7, 0.5]
    joints[3] = replace(joints[3], fixed=moved)
    true = replace(robot, joints=tuple(joints)).with_offsets(np.radians(OFFSETS))
    program = UserProgram(language, robot, varied(robot, 6))
    path = written(tmp_path, program, program.text())
    own = judged(robot)
    own.corrected = true
    done = corrected_program(robot, own, path, tmp_path / f"out{path.suffix}", STATED.get(language))
    reached = true.fk(program.commanded(read(done)), "deg")
    assert np.linalg.norm((reached - robot.fk(program.rows, "deg"))[:, :3, 3], axis=1).max() < 1e-3


def test_joints_that_bend_are_corrected_too(tmp_path: Path) -> None:
    """At commanded joints the arm is where a stiff one is at these and what gravity and harmonics add."""
    robot, language = load_robot("kr6_r900"), ARMS["kr6_r900"]

    def bending(joints: Matrix) -> Matrix:
        return np.radians(0.1) * np.array([0, np.cos(joints[1]), np.sin(joints[1] + joints[2]), 0, 0.5, 0])

    program = UserProgram(language, robot, varied(robot, 6))
    path = written(tmp_path, program, program.text())
    calibration = judged(robot)
    true, meant = robot.with_offsets(np.radians(OFFSETS)), robot.fk(program.rows, "deg")[:, :3, 3]
    off = []
    for posture_offsets in (calibration.posture_offsets, bending):
        calibration.posture_offsets = posture_offsets
        done = corrected_program(
            robot, calibration, path, tmp_path / f"out{path.suffix}", STATED.get(language)
        )
        commanded = program.commanded(read(done))
        added = np.degrees([bending(row) for row in np.radians(commanded)])
        reached = true.fk(commanded + added, "deg")[:, :3, 3]
        off.append(np.linalg.norm(reached - meant, axis=1).max())
    stiff, bent = off
    assert bent < 1e-3
    assert stiff > 0.5  # the control


def test_linear_motions_follow_the_arm_where_no_configuration_is_stated(tmp_path: Path) -> None:
    """movel to poses: the joints are those at the end of the way, and so is the correction."""
    robot = load_robot("ur5e")
    rows = np.array(
        [[10.0, -80, 95, -100, -85, 20], [25.0, -70, 80, -95, -95, 10], [-20.0, -60, 90, -120, -80, 40]]
    )
    own = UserProgram("urscript", robot, rows)
    values = [
        [*(pose[:3, 3] / 1000), *orientation(pose[:3, :3]).rotation_vector] for pose in robot.fk(rows, "deg")
    ]
    begin = ", ".join(f"{value:.9f}" for value in np.radians(rows[0]))
    moves = [f"  movel(p[{', '.join(f'{v:.9f}' for v in value)}], a=1, v=1)" for value in values[1:]]
    text = "\n".join(
        ["def job():", "  set_tcp(p[0, 0, 0, 0, 0, 0])", f"  movej([{begin}])", *moves, "end", ""]
    )
    path = written(tmp_path, own, text)
    done = corrected_program(robot, judged(robot), path, tmp_path / "out.script")
    true = robot.with_offsets(np.radians(OFFSETS))
    for i, found in enumerate(re.findall(r"movel\(p\[(.*?)\]", read(done)), start=1):
        numbers = np.array([float(each) for each in found.split(",")])
        # What the nominal arm has at the joints that are right for this one.
        right = robot.fk(rows[i] - OFFSETS, "deg")
        np.testing.assert_allclose(1000 * numbers[:3], right[:3, 3], atol=1e-4)
        np.testing.assert_allclose(true.fk(rows[i] - OFFSETS, "deg"), robot.fk(rows[i], "deg"), atol=1e-9)
