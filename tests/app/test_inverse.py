"""The flange is dragged: the nearest posture that has it there, within the limits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

from zerobeam.model.files.robot_file import built_in_robots, load_robot
from zerobeam.model.kinematics.inverse import nearest_posture

START = [10.0, -20.0, 30.0, 15.0, 40.0, 20.0]


def dragged(client: TestClient, **other: Any) -> Any:
    answer = client.post("/api/inverse", json={"robot": "irb1600", "joints_deg": START} | other)
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_where_the_flange_is_nothing_moves(client: TestClient) -> None:
    at = load_robot("irb1600").fk(START, "deg")[:3, 3]
    answer = dragged(client, position_mm=at.tolist())
    assert answer["reached"]
    np.testing.assert_allclose(answer["joints_deg"], START, atol=1e-6)


@pytest.mark.parametrize("name", ["irb1600", "ur5e", "panda", "m10ia", "irb6700"])
def test_a_posture_near_by_is_met_with_its_pose(name: str) -> None:
    robot, rng = load_robot(name), np.random.default_rng(3)
    for _ in range(10):
        joints = rng.uniform(0.6 * robot.lower + 0.4 * robot.upper, 0.4 * robot.lower + 0.6 * robot.upper)
        pose = robot.fk(joints, unit="rad")
        met = nearest_posture(robot, joints + 0.05 * rng.normal(size=robot.n), pose[:3, 3], pose[:3, :3])
        np.testing.assert_allclose(robot.fk(met.joints, unit="rad"), pose, atol=1e-4)


def test_without_an_orientation_the_joints_move_least(client: TestClient) -> None:
    at = load_robot("irb1600").fk(START, "deg")[:3, 3] + np.array([1.0, 2.0, -1.0])
    answer = dragged(client, position_mm=at.tolist())
    assert (answer["reached"], answer["off_deg"]) == (True, 0.0)
    moved = np.radians(np.array(answer["joints_deg"]) - START)
    jacobian = load_robot("irb1600").jacobian(START, "deg")[:3]
    least = np.linalg.pinv(jacobian) @ [1.0, 2.0, -1.0]
    np.testing.assert_allclose(moved, least, atol=3e-5)


def test_out_of_reach_the_arm_points_there(client: TestClient) -> None:
    answer = dragged(client, position_mm=[5000.0, 0.0, 500.0])
    assert not answer["reached"]
    assert answer["off_mm"] > 3000
    at = load_robot("irb1600").fk(answer["joints_deg"], "deg")[:3, 3]
    assert np.linalg.norm(at - [5000, 0, 500]) == pytest.approx(answer["off_mm"], abs=1e-3)
    assert np.linalg.norm(at[:2]) > 1400


@pytest.mark.parametrize("name", built_in_robots())
@pytest.mark.one_in(8)
def test_no_joint_leaves_its_range(name: str) -> None:
    robot, rng = load_robot(name), np.random.default_rng(0)
    for _ in range(4):
        met = nearest_posture(robot, rng.uniform(robot.lower, robot.upper), 900 * rng.normal(size=3))
        assert (met.joints >= robot.lower).all()
        assert (met.joints <= robot.upper).all()
        ends = np.minimum(met.joints - robot.lower, robot.upper - met.joints) <= 1e-9
        assert met.at_limit == tuple(np.flatnonzero(ends) + 1)


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"joints_deg": [1, 2]}, ["joints_deg"]),
        ({"position_mm": [1, 2]}, ["position_mm"]),
        ({"quaternion_wxyz": [0, 0, 0, 0]}, ["quaternion_wxyz"]),
        ({"quaternion_wxyz": [1, 0, 0]}, ["quaternion_wxyz"]),
    ],
)
def test_what_is_no_pose_is_refused(client: TestClient, change: dict[str, Any], key: list[str]) -> None:
    sent = {"robot": "irb1600", "joints_deg": START, "position_mm": [900, 0, 900]} | change
    answer = client.post("/api/inverse", json=sent)
    assert (answer.status_code, answer.json()["error"]["key"]) == (400, key)
