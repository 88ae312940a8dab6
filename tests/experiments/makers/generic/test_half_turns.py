"""Controllers that count joints from 0 to 360°, as Kinova's do."""

import numpy as np
import pytest
from command_line import zerobeam

from zerobeam.model.files.run import read_run

HEADER = """\
robot: {robot}
tool: {{kind: laser, calibrated: true, point_mm: [0, 0, 65], direction: [1, 0, 0]}}
noise: {{joint_deg: 0.01, spot_mm: 0.05}}
"""
JOINTS = np.array(
    [[10.5, -20.25, 30.5, 40.75, -50.5, 60.25, 170.5], [-170.5, 15.5, -30.75, -40.5, 50.5, -60.5, 3.25]]
)


def imported(tmp_path, joints, robot="gen3"):
    (tmp_path / "header.yaml").write_text(HEADER.format(robot=robot), encoding="utf-8")
    rows = "\n".join(",".join(map(str, row)) for row in joints.tolist())
    (tmp_path / "joints.csv").write_text(rows, encoding="utf-8")
    files = ["--units", "deg", tmp_path / "joints.csv", "--header", tmp_path / "header.yaml"]
    answer = zerobeam("import", "csv", *files, "--target", "psd", "-o", tmp_path / "run.jsonl")
    if answer.status:
        return answer, None
    return answer, [shot.joints_deg for shot in read_run(tmp_path / "run.jsonl").shots]


def test_a_turn_is_taken_from_what_a_controller_counts_to_360(tmp_path):
    answer, joints = imported(tmp_path, JOINTS % 360)
    np.testing.assert_allclose(joints, JOINTS, atol=1e-9)
    assert (
        "joints counted from 0 to 360°: of joint 1, 2, 3, 4, 5, 6 values above 180° are taken less"
        in answer.out
    )


@pytest.mark.parametrize(("robot", "columns"), [("ur5e", 6), ("gen3", 7)])
def test_control_what_is_within_the_limits_stays(robot, columns, tmp_path):
    """A UR turns to 360° itself; a negative value says that the controller does not count from 0."""
    joints = (JOINTS % 360 if robot == "ur5e" else JOINTS)[:, :columns]
    answer, read = imported(tmp_path, joints, robot)
    np.testing.assert_allclose(read, joints, atol=1e-9)
    assert "less 360" not in answer.out


def test_control_what_stays_outside_the_limits_is_refused(tmp_path):
    joints = JOINTS % 360
    joints[0, 1] = 200.0  # -160°: outside ±138° too
    answer, _ = imported(tmp_path, joints)
    assert answer.status == 2
