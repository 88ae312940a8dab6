"""The corrected URDF: with it, what was recorded hits the target; nothing else of the file changes."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from export_runs import (
    HOSTILE,
    SLIDING,
    TURNING,
    WITHIN_NOISE_MM,
    hostile,
    poses,
    rms_mm,
    urdf_file,
    urdf_run,
)

from zerobeam.experiments.makers.calibration import JointOffset, RobotCalibration, calibration
from zerobeam.experiments.makers.generic.robot_files import urdf_text
from zerobeam.model.errors import BadInput
from zerobeam.model.files.run import Run
from zerobeam.model.files.urdf import read_urdf
from zerobeam.model.kinematics.orientation import angles_of
from zerobeam.model.kinematics.robot import Robot, euler

KINDS = {"turning": TURNING, "sliding": SLIDING}


def weakened(offset: JointOffset) -> JointOffset:
    return replace(offset, row=replace(offset.row, status="weak"))


@pytest.fixture(params=KINDS)
def told(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Run, RobotCalibration, str]:
    run = urdf_run(tmp_path, KINDS[request.param])
    answer = calibration(run)
    return run, answer, urdf_text(run, answer)


def reread(folder: Path, text: str) -> Robot:
    path = folder / "corrected.urdf"
    path.write_bytes(text.encode())
    return read_urdf(path, "base", "tool")


def test_export_then_import_is_the_same_kinematics(
    told: tuple[Run, RobotCalibration, str], tmp_path: Path
) -> None:
    """The corrected model at recorded positions is the given one at recorded plus offset."""
    run, answer, text = told
    robot = reread(tmp_path, text)
    rng = np.random.default_rng(0)
    recorded = rng.uniform(run.robot.lower, run.robot.upper, (50, 6))
    offsets = np.array([offset.applied_rad for offset in answer.offsets])
    assert (offsets[1:] != 0).all()
    np.testing.assert_allclose(poses(robot, recorded), poses(run.robot, recorded + offsets), atol=1e-9)
    other = poses(run.robot, recorded - offsets)
    assert abs(poses(robot, recorded) - other).max() > 1  # the sign matters
    assert rms_mm(run) > 10 * WITHIN_NOISE_MM  # as drawn the beams go past each other
    assert rms_mm(run, robot=robot) < WITHIN_NOISE_MM
    assert [(j.name, j.kind, j.lower, j.upper, j.speed) for j in robot.joints] == [
        (j.name, j.kind, j.lower, j.upper, j.speed) for j in run.robot.joints
    ]


def test_every_other_byte_stays(told: tuple[Run, RobotCalibration, str]) -> None:
    """Undone by hand, the five origins and the one comment give the file back."""
    run, _, text = told
    before = (run.path.parent / "arm.urdf").read_bytes().decode()
    sliding = run.robot.joints[2].kind == "prismatic"
    text, comments = re.subn(r"(?s)(version=\"1\" >)\n<!--.*?-->", r"\1", text, count=1)
    assert comments == 1
    numbers = r'"[-+.e0-9]+ [-+.e0-9]+ [-+.e0-9]+"'
    for pattern, back in (
        (rf"rpy = {numbers}", "rpy = '0 0.1 0'"),
        (rf'xyz={numbers}(/>\s*<axis xyz="0 0 1"/><limit lower="0")', rf'xyz="0 0 {SLIDING["reach"]}"\1')
        if sliding
        else (rf'rpy={numbers} (xyz="0 0 0.475")', r'rpy="0.3 -0.2 0.1" \1'),
        (rf'<origin rpy={numbers} (xyz="0.3 0 0"/>)', r"<origin \1"),
        (rf'(xyz="0.3 0 0") rpy={numbers}></origin>', r'\1 rpy="0.2 1.5707963267948966 0.4"></origin>'),
        (rf'(<joint name="j6" type="revolute">)<origin rpy={numbers}/>', r"\1"),
    ):
        text, count = re.subn(pattern, back, text)
        assert count == 1, pattern
    assert text == before


def test_line_ends_and_a_byte_order_mark_stay(tmp_path: Path) -> None:
    run = urdf_run(tmp_path)
    path = tmp_path / "arm.urdf"
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    written = urdf_text(run, calibration(run)).encode()
    assert written.startswith(b"\xef\xbb\xbf<?xml")
    assert written.count(b"\n") == written.count(b"\r\n")


def test_an_offset_that_is_not_exported_leaves_its_origin(tmp_path: Path) -> None:
    run = urdf_run(tmp_path)
    text = urdf_text(run, calibration(run, without=["delta2"]))
    assert "rpy = '0 0.1 0'" in text
    assert "delta2 (j2)" in text
    assert "EXCLUDED" in text


def test_a_weak_one_is_marked(tmp_path: Path) -> None:
    run = urdf_run(tmp_path)
    answer = calibration(run)
    weak = replace(answer, offsets=tuple(weakened(o) if o.exported else o for o in answer.offsets))
    assert urdf_text(run, weak).count("WEAK") == 5
    assert "WEAK" not in urdf_text(run, answer)


def test_hostile_names_stay_names(tmp_path: Path) -> None:
    """The file's own, and those of the run that come into the comment."""
    run = urdf_run(tmp_path)
    assert run.robot.joints[3].name == HOSTILE
    text = urdf_text(run, calibration(hostile(run)))
    top = ElementTree.fromstring(text.encode())
    before = ElementTree.parse(tmp_path / "arm.urdf").getroot()
    assert [(e.tag, e.get("name")) for e in top.iter() if e.tag != "origin"] == [
        (e.tag, e.get("name")) for e in before.iter() if e.tag != "origin"
    ]
    comment = text.split("<!--", 2)[2].split("-->")[0]
    assert "--" not in comment
    assert "ENDMODULE" in comment


def test_two_joints_of_one_name_cannot_be_told_apart(
    tmp_path: Path, refused: Callable[..., BadInput]
) -> None:
    run = urdf_run(tmp_path)
    answer = calibration(run)
    path = urdf_file(tmp_path)
    path.write_text(path.read_text().replace('name="branch"', 'name="j2"'))
    assert "2 joints of the same name" in refused(urdf_text, run, answer).what


def test_any_rotation_comes_back() -> None:
    """Also where roll and yaw turn about one axis (pitch of 90 degrees)."""
    rng = np.random.default_rng(1)
    upright = [[roll, sign * np.pi / 2, 0.7] for roll in (0, 1, 3) for sign in (-1, 1)]
    for angles in [*rng.uniform(-4, 4, (200, 3)), *upright]:
        for tilt in (0, 1e-3, 1e-7, 1e-9):
            rotation = euler("xyz", (angles[0], angles[1] + tilt, angles[2]))[:3, :3]
            again = euler("xyz", angles_of(rotation))[:3, :3]
            # SciPy takes a pitch within 1e-7 of 90 degrees for 90 degrees.
            np.testing.assert_allclose(again, rotation, atol=2e-7 if 0 < tilt < 1e-6 else 3e-12)
