"""The place Robot: meshes of a URDF, from below the folder alone."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from arm_with_meshes import URDF, stl
from node import drawn
from starlette.testclient import TestClient

from zerobeam.app.server.answers.robot_library import MOST_TRIANGLES, Mesh, read_mesh, simplified, solid
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import built_in_robots, load_robot
from zerobeam.model.files.urdf import read_urdf
from zerobeam.model.kinematics.inverse import nearest_posture
from zerobeam.model.kinematics.robot import Robot

ROBOT = {"urdf": "sub/arm.urdf", "base": "base", "tip": "flange"}


@pytest.fixture
def cell(root: Path) -> Path:
    """An arm with meshes: of the base in a package beside it, of the upper arm beside it."""
    (root / "cell").mkdir()
    (root / "cell" / "base.stl").write_bytes(stl([[[0, 0, 0], [0.2, 0, 0], [0, 0, 0.3]]]))
    (root / "sub" / "upper.obj").write_text("v 0 0 0\nv 500 0 0\nv 500 0 50\nv 0 0 50\nf 1/1 2/1 3/1 4/1\n")
    (root / "sub" / "arm.urdf").write_text(URDF.format(last="upper.obj"))
    return root


def test_the_meshes_of_a_urdf_are_in_the_frames_of_its_links(client: TestClient, cell: Path) -> None:
    found = client.post("/api/meshes", json={"robot": ROBOT}).json()
    assert found["notes"] == []
    base, upper, flange = found["meshes"]
    assert [base["link"], upper["link"], flange["link"]] == [0, 1, 2]
    assert sorted(base["vertices"]) == [[0, 0, 0], [0, 0, 300], [200, 0, 0]]
    # Turned by 90 degrees about z and 100 mm up, as its origin says.
    assert sorted(upper["vertices"]) == [[0, 0, 100], [0, 0, 150], [0, 500, 100], [0, 500, 150]]
    assert len(upper["faces"]) == 2
    assert max(map(max, flange["vertices"])) == 500_000  # mm: no scale is stated


def test_the_links_move_as_the_arm_does(client: TestClient, cell: Path) -> None:
    answer = client.post("/api/robot", json={"robot": ROBOT, "joints_deg": [30, 40]}).json()
    links = np.array(answer["links"])
    assert links.shape == (3, 3, 4)
    np.testing.assert_allclose(links[0], np.eye(4)[:3])
    arm = read_urdf(cell / "sub" / "arm.urdf", "base", "flange")
    np.testing.assert_allclose(links[2], arm.fk([30, 40], "deg")[:3], atol=1e-5)
    first = read_urdf(cell / "sub" / "arm.urdf", "base", "upper")
    np.testing.assert_allclose(links[1], first.fk([30], "deg")[:3], atol=1e-5)


@pytest.mark.parametrize(
    ("last", "said"),
    [
        ("../../outside.stl", "not below the app's folder"),
        ("/etc/passwd", "cannot be used here"),
        ("file:///etc/passwd", "below its folder only"),
        ("package://nowhere/x.stl", "no package nowhere"),
        ("package://../outside.stl", "not below"),
        ("link.stl", "not below the app's folder"),
        ("missing.stl", "no such file"),
        ("arm.urdf", "no mesh that can be drawn"),
        ("broken.stl", "no triangles"),
    ],
)
def test_a_mesh_that_cannot_be_drawn_is_left_out_and_said(
    client: TestClient, cell: Path, last: str, said: str
) -> None:
    (cell.parent / "outside.stl").write_bytes(stl([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]))
    (cell / "sub" / "link.stl").symlink_to(cell.parent / "outside.stl")
    (cell / "sub" / "broken.stl").write_text("solid\nendsolid\n")
    (cell / "sub" / "arm.urdf").write_text(URDF.format(last=last))
    found = client.post("/api/meshes", json={"robot": ROBOT}).json()
    assert [row["link"] for row in found["meshes"]] == [0, 1]
    (note,) = found["notes"]
    assert last in note
    assert said in note


@pytest.mark.parametrize(
    ("sent", "said"),
    [
        ({"urdf": "sub/arm.urdf", "base": "base", "tip": "hand"}, "tip link is not in the file"),
        ({"urdf": "sub/arm.urdf", "base": "floor", "tip": "flange"}, "base link is not in the file"),
        ({"urdf": "sub/arm.urdf", "base": "flange", "tip": "base"}, "no chain of joints"),
        ({"urdf": "sub/arm.urdf", "base": "base"}, "'tip' is missing"),
    ],
)
@pytest.mark.parametrize("point", ["robot", "meshes"])
def test_base_and_tip_are_links_of_the_file(
    client: TestClient, cell: Path, point: str, sent: dict[str, Any], said: str
) -> None:
    answer = client.post(f"/api/{point}", json={"robot": sent})
    assert answer.status_code == 400
    assert said in answer.json()["error"]["what"]


def test_boxes_cylinders_and_spheres_are_drawn_where_links_have_them(client: TestClient, cell: Path) -> None:
    path = cell / "sub" / "arm.urdf"
    mesh = '<geometry><mesh filename="package://cell/base.stl"/></geometry></visual>'
    shapes = ('<box size="0.2 0.4 0.6"/>', '<cylinder radius="0.1" length="0.5"/>', '<sphere radius="0.05"/>')
    visuals = "".join(
        f'<visual><origin xyz="0 0 1"/><geometry>{shape}</geometry></visual>' for shape in shapes
    )
    text = path.read_text()
    assert mesh in text
    path.write_text(text.replace(mesh, mesh + visuals))
    found = client.post("/api/meshes", json={"robot": ROBOT}).json()
    base = [np.array(row["vertices"]) for row in found["meshes"] if row["link"] == 0][1:]
    extents = [np.ptp(own, axis=0).tolist() for own in base]
    assert extents == [[200, 400, 600], [200, 200, 500], [100, 100, 100]]
    assert all(own.mean(axis=0) == pytest.approx([0, 0, 1000], abs=0.1) for own in base)
    path.write_text(path.read_text().replace('radius="0.05"', 'radius="-0.05"'))
    refused = client.post("/api/meshes", json={"robot": ROBOT})
    assert refused.status_code == 400
    assert "'radius' of <sphere> is no extent" in refused.json()["error"]["what"]


@pytest.mark.parametrize("joint3", ["link", "pendant"])
def test_an_arm_says_how_its_pendant_counts(client: TestClient, joint3: str) -> None:
    joints = [10.0, 57.0, -51.0, 1.0, 2.0, 3.0]
    asked = {"robot": "lrmate_200id", "joints_deg": joints, "as_in_files": True, "j3": joint3}
    arm = client.post("/api/robot", json=asked).json()
    less = arm["pendant"]["less_joint2"]
    assert less == [0, 0, 1 if joint3 == "pendant" else 0, 0, 0, 0]
    shown = [joint - share * joints[1] for joint, share in zip(joints, less, strict=True)]
    assert arm["poses"][0]["counted_deg"] == pytest.approx(shown)
    limits = [[joint["lower"], joint["upper"]] for joint in arm["joints"]]
    apart = [i for i in range(6) if limits[i] != pytest.approx(arm["ranges"][i])]
    assert apart == ([2] if joint3 == "pendant" else [])


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


CORNERS = np.array([[[0, 0, 0], [1, 0, 0], [0, 2, 0]], [[0, 0, 0], [0, 2, 0], [0, 0, 3]]], dtype=float)
FACETS = "\n".join(
    "facet normal 0 0 0\nouter loop\n" + "\n".join(f"vertex {x} {y} {z}" for x, y, z in each) + "\nendloop"
    for each in CORNERS
)
DAE = """<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema">
<asset><unit meter="0.01"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="s"><float_array id="a" count="12">0 0 0 100 0 0 0 200 0 0 0 300</float_array><technique_common>
<accessor source="#a" count="4" stride="3"><param name="X"/><param name="Y"/><param name="Z"/></accessor>
</technique_common></source>
<source id="n"><float_array id="b" count="24">0 0 1 0 0 1 0 0 1 0 0 1 0 0 1 0 0 1 0 0 1 0 0 1</float_array>
<technique_common><accessor source="#b" count="8" stride="3"><param name="X"/><param name="Y"/>
<param name="Z"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
{group}</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w"><node><translate>100 0 0</translate><rotate>0 0 1 90</rotate>
<node><instance_geometry url="#g"/></node></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#w"/></scene></COLLADA>"""
TRIANGLES = """<triangles count="2"><input semantic="VERTEX" source="#v" offset="0"/>
<p>0 1 2 0 2 3</p></triangles>"""
POLYLIST = """<polylist count="2"><input semantic="NORMAL" source="#n" offset="1"/>
<input semantic="VERTEX" source="#v" offset="0"/><vcount>3 3</vcount>
<p>0 7 1 7 2 7 0 7 2 7 3 7</p></polylist>"""


def binary() -> bytes:
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *each.ravel(), 0) for each in CORNERS)
    return b"solid is no word".ljust(80) + struct.pack("<I", len(CORNERS)) + rows


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.stl", binary()),
        ("a.STL", f"solid x\n{FACETS}\nendsolid".encode()),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 3\nf 1 2 3\nf -4 -2 -1\n"),
    ],
)
def test_the_triangles_of_a_file(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    mesh = read_mesh(tmp_path / name)
    np.testing.assert_allclose(mesh.vertices[mesh.faces], CORNERS)


@pytest.mark.parametrize("group", [TRIANGLES, POLYLIST])
def test_collada_in_metres_where_its_nodes_are(tmp_path: Path, group: str) -> None:
    (tmp_path / "a.dae").write_text(DAE.format(group=group))
    mesh = read_mesh(tmp_path / "a.dae")
    turned = CORNERS @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])  # by 90 degrees about z
    np.testing.assert_allclose(mesh.vertices[mesh.faces], turned + np.array([1, 0, 0]), atol=1e-6)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.stl", b"solid\n", "no triangles"),
        ("a.obj", b"v 0 0 0\nf 1 2 3\n", "not there"),
        ("a.obj", b"v 0 0 x\n", "cannot be read"),
        ("a.dae", b"<!DOCTYPE x [<!ENTITY a 'b'>]><COLLADA/>", "document type"),
        ("a.dae", b"<COLLADA><scene", "cannot be read"),
        ("a.dae", b"<COLLADA></COLLADA>", "names no scene"),
        ("a.ply", b"", "no mesh"),
    ],
)
def test_what_is_no_mesh_is_refused(tmp_path: Path, name: str, content: bytes, said: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(BadInput, match=said):
        read_mesh(tmp_path / name)


def test_fewer_triangles_keep_the_shape() -> None:
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 200), np.linspace(0, np.pi, 100), indexing="ij")
    ball = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1)
    index = np.arange(200 * 100).reshape(200, 100)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack(own, axis=-1).reshape(-1, 3) for own in ((a, b, c), (a, c, d))])
    mesh = Mesh(100 * ball.reshape(-1, 3), faces)
    few = simplified(mesh, 500)
    assert 100 < len(few.faces) <= 500
    np.testing.assert_allclose(np.linalg.norm(few.vertices, axis=1), 100, atol=12)
    corners = few.vertices[few.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=1).sum() / 2
    assert area == pytest.approx(4 * np.pi * 100**2, rel=0.1)


@pytest.mark.parametrize(("kind", "volume"), [("box", 1), ("cylinder", np.pi / 4), ("sphere", np.pi / 6)])
def test_a_solid_is_closed_of_its_extent_and_faces_outwards(kind: Any, volume: float) -> None:
    mesh = solid(kind)
    assert mesh.vertices.min(axis=0) == pytest.approx([-0.5] * 3)
    assert mesh.vertices.max(axis=0) == pytest.approx([0.5] * 3)
    edges = [(face[i], face[(i + 1) % 3]) for face in mesh.faces.tolist() for i in range(3)]
    assert len(edges) == len(set(edges))
    assert {(b, a) for a, b in edges} == set(edges)
    # By the divergence theorem; flat sides cut off less than 4 %.
    found = np.linalg.det(mesh.vertices[mesh.faces]).sum() / 6
    assert 0.96 * volume < found <= volume * (1 + 1e-9)


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
