"""The place Robot: meshes of a URDF, from below the folder alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arm_with_meshes import URDF, stl
from starlette.testclient import TestClient

from zerobeam.model.files.urdf import read_urdf

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
