"""Shapes of links as triangles, for pictures: mesh files (STL, OBJ, COLLADA) and solids, read by trimesh."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Literal
from xml.etree.ElementTree import ParseError

import numpy as np
from numpy.typing import NDArray

from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.parsing.reading import decode, read_bytes

if TYPE_CHECKING:
    from trimesh import Trimesh

LARGEST_MESH = 30 * 10**6  # bytes
MOST_TRIANGLES = 500_000  # of a file
_KINDS = (".stl", ".obj", ".dae")
_MILLIMETRES = 1000.0  # in a metre, which URDF counts in
_SIDES = 24  # of a round solid
_FINEST = 96  # cells along a mesh that is to have fewer triangles
_REFUSED_XML = ("<!DOCTYPE", "<!ENTITY", "PK\x05\x06")  # entities that grow, and an archive in disguise


@dataclass(frozen=True, eq=False)
class Mesh:
    """`vertices` (V, 3), and `faces` (F, 3): the vertices of each triangle."""

    vertices: Matrix
    faces: NDArray[np.int64]

    def placed(self, pose: Matrix, scale: Matrix) -> Mesh:
        """In mm in the frame of which `pose` (4, 4), mm, has the mesh; `scale` (3,) as URDF states it."""
        metres = self.vertices * scale * _MILLIMETRES
        return Mesh(metres @ pose[:3, :3].T + pose[:3, 3], self.faces)


def read_mesh(path: Path) -> Mesh:
    """The triangles of a file (.stl, .obj, .dae), in its own unit, a COLLADA file's in metres.

    Nothing else is opened: textures and materials that the file names are not looked for. BadInput for
    another file, one that is too large, and one without triangles.
    """
    import trimesh
    from collada.common import DaeError

    kind = path.suffix.lower()
    if kind not in _KINDS:
        raise BadInput("this is no mesh that can be drawn", found=path.name, allowed=", ".join(_KINDS))
    content = read_bytes(path, LARGEST_MESH)
    if kind == ".dae":
        text = decode(content, file=path, line=None)
        if any(part in text for part in _REFUSED_XML):
            raise BadInput("a COLLADA file may have no document type or entities", file=path)
        if "<scene" not in text:
            raise BadInput("the COLLADA file names no scene that could be drawn", file=path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # older NumPy: of a number that is none
            scene = trimesh.load_scene(BytesIO(content), file_type=kind[1:], process=False)
        mesh = _mesh(scene.to_mesh(), scene.units if kind == ".dae" else None)
    except IndexError:
        raise BadInput("a triangle of the mesh has a vertex that is not there", file=path) from None
    except (
        ValueError,
        KeyError,
        AttributeError,
        TypeError,
        RecursionError,
        DeprecationWarning,
        ParseError,
        DaeError,
    ) as error:
        raise BadInput(f"the mesh cannot be read: {error}", file=path) from None
    if not len(mesh.faces) or not np.isfinite(mesh.vertices).all():
        raise BadInput("the mesh has no triangles, or places that are no numbers", file=path)
    if len(mesh.faces) > MOST_TRIANGLES:
        allowed = f"at most {MOST_TRIANGLES}"
        raise BadInput("the mesh has too many triangles", found=len(mesh.faces), allowed=allowed, file=path)
    return mesh


def solid(kind: Literal["box", "cylinder", "sphere"]) -> Mesh:
    """A solid of extent 1 about the origin, a cylinder along z."""
    from trimesh import creation

    if kind == "box":
        return _mesh(creation.box())
    if kind == "cylinder":
        return _mesh(creation.cylinder(radius=0.5, height=1.0, sections=_SIDES))
    return _mesh(creation.icosphere(subdivisions=2, radius=0.5))


def _mesh(made: Trimesh, unit: str | None = None) -> Mesh:
    """`unit` as trimesh states that of a COLLADA file: `meters`, or a number `* meters`."""
    metres = 1.0 if unit is None or unit == "meters" else float(unit.split()[0])
    return Mesh(metres * np.asarray(made.vertices, dtype=float), np.asarray(made.faces, dtype=np.int64))


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
