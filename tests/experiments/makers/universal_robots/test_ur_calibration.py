import json
from pathlib import Path

import numpy as np
import pytest
from command_line import zerobeam
from exact_runs import demo_runs

from zerobeam.experiments.makers.universal_robots.kinematics import (
    DELTAS,
    LINKS,
    read_ur_calibration,
    require_factory_arm,
)
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot, stated_rows
from zerobeam.model.files.run import read_run
from zerobeam.model.kinematics.dh import DHRow, dh_chain
from zerobeam.model.kinematics.orientation import angles_of
from zerobeam.model.kinematics.robot import Robot

# Made up, in the size of real ones: axes 2 to 4 meet metres away.
DELTA = {
    "delta_theta": [5e-5, -0.06, 0.19, -0.13, 2e-5, -4e-5],
    "delta_a": [4e-5, 4e-4, 1.5e-3, 4e-5, 5e-5, 0.0],
    "delta_d": [2e-4, -6.29, 8.57, -2.28, -7e-5, 4e-4],
    "delta_alpha": [1e-4, 2.3e-3, 0.012, 5e-4, -2e-4, 0.0],
}


def calibrated() -> tuple[list[np.ndarray], np.ndarray]:
    """The chain by the rows themselves."""
    rows = [joint.row for joint in stated_rows("ur3e", Path()).joints]
    moved = [
        DHRow(row.a + 1000 * da, row.alpha + dalpha, row.d + 1000 * dd, row.theta + dtheta)
        for row, dtheta, da, dd, dalpha in zip(rows, *DELTA.values(), strict=True)
    ]
    return dh_chain(moved, "standard")


def by_rows(joints: np.ndarray) -> np.ndarray:
    fixed, last = calibrated()
    pose = np.eye(4)
    for transform, angle in zip(fixed, joints, strict=True):
        turn = np.eye(4)
        turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        pose = pose @ transform @ turn
    return pose @ last


def conf(folder: Path) -> Path:
    path = folder / "calibration.conf"
    lines = [f"{key} = {DELTA[key]}" for key in DELTAS]
    path.write_text(
        "\n".join(["[mounting]", *lines, "calibration_status = 2 # linearised"]), encoding="utf-8"
    )
    return path


def ros(folder: Path, robot: Robot) -> Path:
    """As `ur_calibration` writes it: the calibrated arm, origins near the nominal ones."""
    path, lines = folder / "calibration.yaml", ["kinematics:"]
    keys = ("x", "y", "z", "roll", "pitch", "yaw")
    for i, (name, joint) in enumerate(zip(LINKS, robot.joints, strict=True)):
        fixed = joint.fixed if i < 5 else joint.fixed @ robot.flange
        values = [*(fixed[:3, 3] / 1000).tolist(), *angles_of(fixed[:3, :3])]
        lines.append(f"  {name}:")
        lines += [f"    {key}: {value!r}" for key, value in zip(keys, values, strict=True)]
    path.write_text("\n".join([*lines, "  hash: calib_1"]), encoding="utf-8")
    return path


def random_joints() -> np.ndarray:
    return np.random.default_rng(1).uniform(-np.pi, np.pi, (20, 6))


def test_deltas_are_the_rows_with_them_added(tmp_path: Path) -> None:
    out = tmp_path / "mine.yaml"
    answer = zerobeam("import", "ur-calibration", conf(tmp_path), "--robot", "ur3e", "-o", out)
    assert answer.status == 0, answer.err
    assert answer.err == ""
    mine, nominal = load_robot(out), load_robot("ur3e")
    for joints in random_joints():
        np.testing.assert_allclose(mine.fk(joints, "rad"), by_rows(joints), rtol=0, atol=1e-8)
    assert np.abs(mine.fk(random_joints(), "rad") - nominal.fk(random_joints(), "rad")).max() > 1.0
    # Rows that a person can read: no length of metres.
    for own, theirs in zip(
        stated_rows(str(out), Path()).joints, stated_rows("ur3e", Path()).joints, strict=True
    ):
        assert abs(own.d_mm - theirs.d_mm) < 5
        assert abs(own.a_mm - theirs.a_mm) < 5
    assert mine.vendor == "universal-robots"


def test_the_yaml_of_ros_is_the_same_arm(tmp_path: Path) -> None:
    arm = read_ur_calibration(conf(tmp_path), "ur3e").robot
    again = read_ur_calibration(ros(tmp_path, arm), "ur3e").robot
    joints = random_joints()
    found, wanted = again.fk(joints, "rad"), arm.fk(joints, "rad")
    # The last link goes into the frame of joint 6 in that form: the flange's turn about z is its own.
    np.testing.assert_allclose(found[:, :3, 3], wanted[:, :3, 3], rtol=0, atol=1e-6)
    np.testing.assert_allclose(found[:, :3, 2], wanted[:, :3, 2], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace("delta_a =", "delta_b ="), "no delta_a"),
        (lambda text: text.replace("-0.06", "x"), "delta_theta cannot be used"),
        (lambda text: text.replace("-0.06, ", ""), "delta_theta cannot be used"),
        (lambda text: text.replace("0.012", "0.3"), "not the calibration of a UR3e"),
        (lambda text: "a: 1\n", "no calibration of a UR"),
        (lambda text: "kinematics: {shoulder: {x: 0}}\n", "no shoulder, or it is incomplete"),
    ],
)
def test_another_file_is_refused(change, said: str, tmp_path: Path) -> None:
    path = conf(tmp_path)
    path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")
    out = tmp_path / "mine.yaml"
    assert said in zerobeam("import", "ur-calibration", path, "--robot", "ur3e", "-o", out).refused()
    assert not out.exists()


def test_another_vendor_s_robot_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="another vendor"):
        read_ur_calibration(conf(tmp_path), "irb120")


def measured(folder: Path, robot: str) -> Path:
    """A run of the demo's measurements, as if they were a UR's: only who made the robot counts here."""
    head, *rows = demo_runs()[0].path.read_text(encoding="utf-8").splitlines()
    header = json.loads(head)
    header |= {"robot": robot, "provenance": {}}
    path = folder / "run.jsonl"
    path.write_text("\n".join([json.dumps(header), *rows]), encoding="utf-8")
    return path


def test_what_the_factory_has_corrected_is_not_corrected_twice(tmp_path: Path) -> None:
    """A sheet needs the robot file of the factory calibration, which the controller computes with."""
    out = tmp_path / "mine.yaml"
    zerobeam("import", "ur-calibration", conf(tmp_path), "--robot", "ur3e", "-o", out)
    run = read_run(measured(tmp_path, "ur3e"))
    with pytest.raises(BadInput, match="corrected twice") as refused:
        require_factory_arm(run.header.robot, tmp_path)
    assert refused.value.found == "robot: ur3e"
    assert "import ur-calibration calibration.conf --robot ur3e -o" in (refused.value.remedy or "")
    with pytest.raises(BadInput) as refused:
        require_factory_arm("another.yaml", tmp_path)
    assert "--robot MODEL -o arm.yaml" in (refused.value.remedy or "")
    require_factory_arm("mine.yaml", tmp_path)
