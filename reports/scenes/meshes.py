"""The shapes of links as triangles, for pictures: STL, OBJ, the triangles of COLLADA files, and solids."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from ...model.arrays import Matrix
from ...model.errors import BadInput
from ...model.files.reading import decode, read_bytes

Faces = NDArray[np.int64]

LARGEST_MESH = 30 * 10**6  # bytes
MOST_TRIANGLES = 500_000  # of a file
_MILLIMETRES = 1000.0  # in a metre, which URDF counts in
_STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_SIDES = 24  # of a round solid
_FINEST = 96  # cells along a mesh that is to have fewer triangles


@dataclass(frozen=True, eq=False)
class Mesh:
    """`vertices` (V, 3), and `faces` (F, 3): the vertices of each triangle."""

    vertices: Matrix
    faces: Faces

    def placed(self, pose: Matrix, scale: Matrix) -> Mesh:
        """In mm in the frame of which `pose` (4, 4), mm, has the mesh; `scale` (3,) as URDF states it."""
        metres = self.vertices * scale * _MILLIMETRES
        return Mesh(metres @ pose[:3, :3].T + pose[:3, 3], self.faces)


def read_mesh(path: Path) -> Mesh:
    """The triangles of a file (.stl, .obj, .dae), in its own unit, a COLLADA file's in metres.

    BadInput for another file, one that is too large, and one without triangles.
    """
    readers = {".stl": _stl, ".obj": _obj, ".dae": _dae}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise BadInput("this is no mesh that can be drawn", found=path.name, allowed=", ".join(readers))
    content = read_bytes(path, LARGEST_MESH)
    try:
        mesh = reader(content, path)
    except (ValueError, IndexError, KeyError, AttributeError, ElementTree.ParseError) as error:
        raise BadInput(f"the mesh cannot be read: {error}", file=path) from None
    if not len(mesh.faces) or not np.isfinite(mesh.vertices).all():
        raise BadInput("the mesh has no triangles, or places that are no numbers", file=path)
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise BadInput("a triangle of the mesh has a vertex that is not there", file=path)
    if len(mesh.faces) > MOST_TRIANGLES:
        allowed = f"at most {MOST_TRIANGLES}"
        raise BadInput("the mesh has too many triangles", found=len(mesh.faces), allowed=allowed, file=path)
    return mesh


def solid(kind: Literal["box", "cylinder", "sphere"]) -> Mesh:
    """A solid of extent 1 about the origin, a cylinder along z."""
    turns = np.radians(np.arange(0, 360, 90 if kind == "box" else 360 / _SIDES))
    if kind == "box":
        rings = [(np.sqrt(0.5), -0.5), (np.sqrt(0.5), 0.5)]
        turns = turns + np.pi / 4
    elif kind == "cylinder":
        rings = [(0.5, -0.5), (0.5, 0.5)]
    else:
        heights = np.radians(np.linspace(-90, 90, _SIDES // 2 + 1))[1:-1]
        rings = [(0.5 * np.cos(height), 0.5 * np.sin(height)) for height in heights]
    around = [[radius * np.cos(turn), radius * np.sin(turn), z] for radius, z in rings for turn in turns]
    vertices = np.array([*around, [0, 0, -0.5], [0, 0, 0.5]])
    count, bottom, top = len(turns), len(around), len(around) + 1
    sides, last = [(k, (k + 1) % count) for k in range(count)], count * (len(rings) - 1)
    faces = [(bottom, b, a) for a, b in sides] + [(top, last + a, last + b) for a, b in sides]
    for low in range(0, last, count):
        for a, b in sides:
            faces += [(low + a, low + b, low + b + count), (low + a, low + b + count, low + a + count)]
    return Mesh(vertices, np.array(faces, dtype=np.int64))


def simplified(mesh: Mesh, most: int) -> Mesh:
    """With `most` triangles at most: vertices in one cell of a grid become one (Rossignac & Borrel 1993)."""
    cells = _FINEST
    simple = _clustered(mesh, None)
    while len(simple.faces) > most and cells >= 1:
        simple = _clustered(mesh, cells)
        cells = int(cells * 0.8)
    return simple


def _clustered(mesh: Mesh, cells: int | None) -> Mesh:
    """One vertex for each cell of a grid of so many along the mesh; for each place, without a grid."""
    low = mesh.vertices.min(axis=0)
    size = max(float(np.ptp(mesh.vertices, axis=0).max()), 1e-9)
    grid = mesh.vertices if cells is None else np.floor((mesh.vertices - low) / (size / cells * (1 + 1e-9)))
    _, which, counts = np.unique(grid, axis=0, return_inverse=True, return_counts=True)
    which = which.reshape(-1)
    middles = np.stack([np.bincount(which, column) / counts for column in mesh.vertices.T], axis=1)
    faces = which[mesh.faces]
    a, b, c = faces.T
    return Mesh(middles, np.unique(faces[(a != b) & (b != c) & (c != a)], axis=0) if len(faces) else faces)


def _of_corners(corners: Matrix) -> Mesh:
    """(F, 3, 3) three corners of each triangle."""
    return Mesh(corners.reshape(-1, 3).astype(float), np.arange(len(corners) * 3).reshape(-1, 3))


def _stl(content: bytes, path: Path) -> Mesh:
    count = int.from_bytes(content[80:84], "little")
    if len(content) >= 84 and len(content) == 84 + count * _STL.itemsize:
        return _of_corners(np.frombuffer(content, _STL, count, 84)["corners"])
    found = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", content)
    return _of_corners(np.array(found, dtype=float).reshape(-1, 3, 3))


def _obj(content: bytes, path: Path) -> Mesh:
    vertices: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    for line in decode(content, file=path, line=None).splitlines():
        kind, *words = line.split() or [""]
        if kind == "v":
            vertices.append([float(word) for word in words[:3]])
        elif kind == "f":
            corners = [int(word.split("/")[0]) for word in words]
            corners = [corner - 1 if corner > 0 else len(vertices) + corner for corner in corners]
            faces += [(corners[0], b, c) for b, c in pairwise(corners[1:])]
    places, corners_of = np.array(vertices, dtype=float), np.array(faces, dtype=np.int64)
    return Mesh(places.reshape(-1, 3), corners_of.reshape(-1, 3))


def _dae(content: bytes, path: Path) -> Mesh:
    """Of the visual scene, its nodes in place; as ROS draws it, whatever axis the file calls up."""
    text = decode(content, file=path, line=None)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise BadInput("a COLLADA file may have no document type or entities", file=path)
    root = ElementTree.fromstring(text.encode())
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    unit = root.find("asset/unit")
    metre = 1.0 if unit is None else float(unit.get("meter") or 1.0)
    geometries = {own.get("id"): own.find("mesh") for own in root.iterfind("library_geometries/geometry")}
    parts: list[Matrix] = []
    for scene in root.iterfind("library_visual_scenes/visual_scene"):
        for name, pose in _instances(scene, np.eye(4), 0):
            if (mesh := geometries.get(name)) is not None:
                corners = _dae_corners(mesh)
                parts.append(corners @ pose[:3, :3].T + pose[:3, 3])
    return _of_corners(metre * np.concatenate(parts) if parts else np.zeros((0, 3, 3)))


def _instances(node: ElementTree.Element, pose: Matrix, depth: int) -> Iterator[tuple[str, Matrix]]:
    """The geometries below a node, and where they are (4, 4)."""
    for child in node:
        if child.tag == "instance_geometry":
            yield (child.get("url") or "").removeprefix("#"), pose
        elif child.tag == "node" and depth < 50:
            yield from _instances(child, pose, depth + 1)
        elif child.tag in ("matrix", "translate", "rotate", "scale"):
            pose = pose @ _step(child.tag, np.array((child.text or "").split(), dtype=float))


def _step(kind: str, values: Matrix) -> Matrix:
    step = np.eye(4)
    if kind == "matrix":
        return values.reshape(4, 4)
    if kind == "translate":
        step[:3, 3] = values
    elif kind == "scale":
        step[:3, :3] = np.diag(values)
    else:
        x, y, z = values[:3] / np.linalg.norm(values[:3])
        across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        angle = np.radians(values[3])
        step[:3, :3] += np.sin(angle) * across + (1 - np.cos(angle)) * across @ across
    return step


def _dae_corners(mesh: ElementTree.Element) -> Matrix:
    """(F, 3, 3) of the triangles and polygons of a mesh."""
    sources = {own.get("id"): own for own in mesh.iterfind("source")}
    found = []
    for group in (*mesh.iterfind("triangles"), *mesh.iterfind("polylist")):
        inputs = {own.get("semantic"): own for own in group.iterfind("input")}
        stride = 1 + max(int(own.get("offset") or 0) for own in inputs.values())
        named = mesh.find("vertices/input[@semantic='POSITION']")
        if named is None:
            raise ValueError("it has no positions")
        source = sources[(named.get("source") or "").removeprefix("#")]
        places = np.array((source.findtext("float_array") or "").split(), dtype=float).reshape(-1, 3)
        indices = np.array((group.findtext("p") or "").split(), dtype=np.int64).reshape(-1, stride)
        own = places[indices[:, int(inputs["VERTEX"].get("offset") or 0)]]
        if group.tag == "triangles":
            found.append(own.reshape(-1, 3, 3))
            continue
        counts = np.array((group.findtext("vcount") or "").split(), dtype=np.int64)
        for polygon in np.split(own, np.cumsum(counts)[:-1]):
            fan = [polygon[[0, k, k + 1]] for k in range(1, len(polygon) - 1)]
            found.append(np.array(fan).reshape(-1, 3, 3))
    return np.concatenate(found) if found else np.zeros((0, 3, 3))
