"""How arms are drawn, by the app and by reports: the geometry of their bodies, and names that have room."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from node import drawn

from zerobeam.app.server.answers.robot_library import MOST_TRIANGLES
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.robot import Robot

SLIDER = """
schema: zerobeam/robot/1
name: slider
convention: modified
joints:
  - {alpha_deg: 0, a_mm: 0, d_mm: 300, theta_deg: 0, lower_deg: -170, upper_deg: 170}
  - {kind: prismatic, alpha_deg: 30, a_mm: 250, d_mm: 100, theta_deg: 20, lower_mm: -400, upper_mm: 400}
  - {alpha_deg: 60, a_mm: 200, d_mm: 50, theta_deg: 10, lower_deg: -170, upper_deg: 170}
"""


def posture(robot: Robot, joints: np.ndarray) -> dict[str, Any]:
    theta = ca.SX.sym("theta", robot.n)
    parts = [robot.skeleton(theta), robot.axes(theta), robot.links(theta)]
    placed = ca.Function("arm", [theta], [ca.densify(part) for part in parts])
    points, axes, links = (np.array(part) for part in placed(joints))
    poses = links.reshape(3, -1, 4).transpose(1, 0, 2)
    return {"skeleton": points.T.tolist(), "axes": axes.T.tolist(), "links": poses.tolist()}


@pytest.fixture(params=["irb1600", "iiwa14", "slider"])
def robot(request: pytest.FixtureRequest, tmp_path: Path) -> Robot:
    if request.param != "slider":
        return load_robot(request.param)
    (tmp_path / "slider.yaml").write_text(SLIDER)
    return load_robot(str(tmp_path / "slider.yaml"))


@pytest.mark.one_in(3)
def test_an_arm_moved_by_its_joints_is_where_its_kinematics_say(robot: Robot, tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    start, by = rng.uniform(-1, 1, (2, robot.n))
    kinds = [joint.kind for joint in robot.joints]
    script = """
import { moved } from "./turning.mjs";
console.log(JSON.stringify(moved(input.from, input.by, input.kinds)));"""
    data = {"from": posture(robot, start), "by": (by * robot.display).tolist(), "kinds": kinds}
    after, expected = drawn(tmp_path, script, data), posture(robot, start + by)
    for part in ("skeleton", "axes", "links"):
        np.testing.assert_allclose(after[part], expected[part], atol=1e-6)


@pytest.mark.one_in(3)
def test_every_joint_is_joined_to_the_next_along_its_axes(robot: Robot, tmp_path: Path) -> None:
    """Each link's rods lead from its joint to the next without a gap, along an axis or across both."""
    arm = posture(robot, np.random.default_rng(3).uniform(-1, 1, robot.n))
    script = """
import { armBodies, route } from "./bodies.mjs";
const { skeleton: p, axes: a } = input.arm, n = a.length;
const routes = p.slice(1).map((to, k) => route(p[k], to, a[k - 1] ?? null, a[k] ?? null));
console.log(JSON.stringify({ routes, solids: armBodies(input.arm, 1000, { kinds: input.kinds }) }));"""
    answer = drawn(tmp_path, script, {"arm": arm, "kinds": [joint.kind for joint in robot.joints]})
    points, axes = np.array(arm["skeleton"]), np.array(arm["axes"])
    for k, corners in enumerate(answer["routes"]):
        np.testing.assert_allclose([corners[0], corners[-1]], points[k : k + 2], atol=1e-6)
        near = [axes[i] for i in (k - 1, k) if 0 <= i < robot.n]
        for way in np.diff(np.array(corners), axis=0) if k else ():
            unit = way / (np.linalg.norm(way) or 1)
            along = [abs(unit @ axis) for axis in near]
            assert max(along) > 1 - 1e-6 or min(along) < 1e-6 or len(corners) == 2, (k, along)
    rods = [solid for solid in answer["solids"] if solid["shape"] == "rod"]
    assert {rod["joint"] for rod in rods if "joint" in rod} == set(range(1, robot.n + 1))
    assert all(rod["radius"] > 0 and np.isfinite([*rod["from"], *rod["to"]]).all() for rod in rods)
    assert 24 * len(answer["solids"]) < MOST_TRIANGLES


MARKS = [
    {"kind": "psd", "normal": [0, 0, 1], "size": 20, "acceptance_deg": 30},
    {"kind": "tracker"},
    {"kind": "plane", "normal": [0, 1, 0], "outline": [[0, 0, 0], [1, 0, 0], [1, 1, 0]]},
    {"kind": "sphere", "radius": 25},
    {"kind": "ballbar", "outline": [[0, 0, 0], [100, 0, 300]]},
    {"kind": "dial", "normal": [0, 0, 1]},
    {"kind": "pose"},
    {"kind": "point", "state": "undetermined"},
]


def test_every_kind_of_instrument_has_a_body_about_its_place(tmp_path: Path) -> None:
    script = """
import { markBodies } from "./marks.mjs";
console.log(JSON.stringify(input.map((mark) => markBodies(mark, 1000, 0))));"""
    marks = [{"name": mark["kind"], "at": [400.0, 100.0, 300.0], **mark} for mark in MARKS]
    for mark, solids in zip(marks, drawn(tmp_path, script, marks), strict=True):
        assert solids, mark["kind"]
        tones = {solid["tone"] for solid in solids}
        assert ("unidentifiable" in tones) == (mark.get("state") == "undetermined")
        assert ("cone" in {solid["shape"] for solid in solids}) == ("acceptance_deg" in mark)


def test_names_do_not_lie_over_each_other(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    labels = [
        {"x": x, "y": y, "text": f"label {i}", "tone": "", "rank": int(rank)}
        for i, (x, y, rank) in enumerate(rng.uniform(0, (300, 300, 4), (60, 3)))
    ]
    script = """
import { placedLabels } from "./labels.mjs";
console.log(JSON.stringify(placedLabels(input, (l) => 7 * l.text.length, { wide: 300, high: 300 })));"""
    placed = drawn(tmp_path, script, labels)
    boxes = np.array(
        [(one["left"], one["top"], one["left"] + 7 * len(one["text"]), one["top"] + 17) for one in placed]
    )
    assert 5 < len(boxes) < len(labels)
    assert (boxes[:, :2] >= 0).all()
    assert (boxes[:, 2:] <= 300).all()
    for i, one in enumerate(boxes):
        for other in boxes[i + 1 :]:
            assert (one[2:] <= other[:2]).any() or (other[2:] <= one[:2]).any()
    firsts = [label for label in labels if label["rank"] == 0]
    assert len(firsts) / len(labels) < sum(one["rank"] == 0 for one in placed) / len(placed)
