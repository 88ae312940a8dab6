"""Meshes of links: each form of file gives the same triangles; few triangles keep the shape."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from zerobeam.app.server.answers.robot_library import Mesh, read_mesh, simplified, solid
from zerobeam.model.errors import BadInput

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
