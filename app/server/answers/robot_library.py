"""Robots: those of the library, one in a posture, the shapes of its links, and its joints while its flange is
dragged."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cache, lru_cache
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal
from xml.etree.ElementTree import ParseError

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field

from ....experiments.arm_shown import ShownArm, shown_arm
from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.files.header import RobotRef, UrdfRef
from ....model.files.robot_file import built_in_robots, load_robot, stated_rows
from ....model.files.urdf import visuals_of
from ....model.instruments.frames import rotation_of_quaternion
from ....model.kinematics.inverse import nearest_posture
from ....model.kinematics.orientation import Three
from ....model.kinematics.pendant import beyond_limits
from ....model.kinematics.robot import Robot
from ....model.parsing.reading import decode, read_bytes
from ....model.parsing.validation import Vector, as_tuple
from ....model.records import if_any, it, record
from ....reports.output.html import fragment
from ....reports.plan.robot_page import robot_page
from ..index import Folder
from ..requests import end_point, noted, wrong

if TYPE_CHECKING:
    from trimesh import Trimesh

LARGEST_MESH = 30 * 10**6  # bytes
_MOST_OF_FILE = 500_000  # of a file
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
    if len(mesh.faces) > _MOST_OF_FILE:
        allowed = f"at most {_MOST_OF_FILE}"
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


MOST_TRIANGLES = 3000  # of an arm: what a tablet draws while it is turned


@record(kw_only=True)
class BuiltInRobot:
    """A robot of the library."""

    name: str
    vendor: Annotated[str | None, it("null where it is not stated")]
    model: Annotated[str | None, it("null where it is not stated")]


@record(kw_only=True, eq=False)
class DrawnArm(ShownArm):
    """`zerobeam/arm/1` (docs/files.md), and the arm in its first posture, in the base frame."""

    skeleton: Annotated[list[Three], it("n + 2 points, mm: base, joints, flange")]
    axes: Annotated[list[Three], it("n unit vectors, of the joints")]
    links: Annotated[list[list[list[float]]], it("n + 1 poses of base and links: rows of 3 x 4")]
    ranges: Annotated[
        list[list[float]],
        it("n lower and upper limits, deg (mm), joint 3 from link 2; `joints` has the pendant's"),
    ]
    about: Annotated[str, it("joints, mounting and counting as `zerobeam robot` shows them, as HTML")]
    pose: Annotated[str, it("the flange in the first posture in the forms of pendants, as HTML")]
    notes: Annotated[list[str] | None, it("where numbers look wrong"), if_any] = None


@record(kw_only=True)
class LinkMesh:
    """What a URDF shows of a link."""

    link: Annotated[int, it("0: the base; k: the link behind joint k of the chain")]
    vertices: Annotated[list[Three], it("in the link's frame, mm")]
    faces: Annotated[list[list[int]], it("three vertices each")]


@record(kw_only=True)
class ArmMeshes:
    """What a URDF shows of its links."""

    meshes: list[LinkMesh]
    notes: Annotated[list[str], it("on what is left out")]


@end_point("GET /api/robots", "The built-in robots: name, vendor, model.")
@cache
def robots(_: Folder) -> list[BuiltInRobot]:
    """The built-in robots."""
    libraries = [(name, stated_rows(name, Path())) for name in built_in_robots()]
    return [BuiltInRobot(name=name, vendor=rows.vendor, model=rows.model) for name, rows in libraries]


@end_point("POST /api/robot", "A robot (zerobeam/arm/1), its skeleton and axes.")
def drawn_robot(
    folder: Folder,
    robot: Annotated[RobotRef, it("a built-in name, a robot file below the folder, or {urdf, base, tip}")],
    joints_deg: Annotated[
        Annotated[tuple[float, ...], BeforeValidator(as_tuple)] | None,
        it("joint positions, degrees (millimetres for a prismatic joint); default: 0"),
    ] = None,
    j3: Annotated[
        Literal["link", "ground", "pendant"],
        it(
            "what joint 3 is counted from: link 2, as in files; the ground; or as the robot file"
            " states of the pendant"
        ),
    ] = "link",
    as_in_files: Annotated[
        bool,
        it("joints_deg are those of a file, joint 3 from link 2, whatever j3 says of what is shown"),
    ] = False,
) -> DrawnArm:
    """An arm, drawn."""
    with noted() as notes:
        ref = whole_ref(folder, robot, folder.root)
        joints = [] if joints_deg is None else [joints_deg]
        arm = shown_arm(ref, joints, j3=None if j3 == "pendant" else j3, as_in_files=as_in_files)
    return arm_of(arm, notes)


def placed(robot: Robot, joints: Matrix) -> tuple[list[Any], list[Any], list[Any]]:
    """At each of joints (N, n), rad or mm, the n + 2 points of the arm, the joints' axes, n unit vectors, and
    the n + 1 poses of base and links."""
    points, axes, links = (np.array(part).reshape(3, len(joints), -1) for part in _placed(robot)(joints.T))
    poses = links.reshape(3, len(joints), -1, 4)
    return (
        rounded(points.transpose(1, 2, 0), 3),
        rounded(axes.transpose(1, 2, 0), 9),
        rounded(poses.transpose(1, 2, 0, 3), 6),
    )


@lru_cache(maxsize=8)
def _placed(robot: Robot) -> ca.Function:
    theta = ca.SX.sym("theta", robot.n)
    parts = robot.skeleton(theta), robot.axes(theta), robot.links(theta)
    return ca.Function("arm", [theta], [ca.densify(part) for part in parts])


def arm_of(arm: ShownArm, notes: list[str] | None = None) -> DrawnArm:
    """An arm in its first posture."""
    (skeleton,), (axes,), (links,) = placed(arm.robot, np.array([arm.poses[0].joints]))
    about, pose, *_ = robot_page(arm).sections
    return DrawnArm(
        **vars(arm),
        skeleton=skeleton,
        axes=axes,
        links=links,
        ranges=rounded(np.stack([arm.robot.lower, arm.robot.upper], axis=1) * arm.robot.display[:, None], 9),
        about=fragment([*about.lead, *about.blocks], {}),
        pose=fragment([*pose.lead, *pose.blocks], {}),
        notes=notes,
    )


def whole_ref(folder: Folder, ref: str | UrdfRef, start: Path) -> str | UrdfRef:
    """The same robot, its file with its whole path."""
    if isinstance(ref, UrdfRef):
        return ref.model_copy(update={"urdf": str(folder.inside(ref.urdf, start))})
    if ref in built_in_robots() or "." not in ref:
        return ref
    return str(folder.inside(ref, start))


def require_robot_inside(folder: Folder, content: Any, start: Path) -> None:
    reference = content.get("robot") if isinstance(content, dict) else None
    name = reference.get("urdf") if isinstance(reference, dict) else reference
    if (
        isinstance(name, str)
        and name not in built_in_robots()
        and (isinstance(reference, dict) or "." in name)
    ):
        folder.inside(name, start)


def rounded(values: Matrix, digits: int) -> Any:
    return (np.round(values, digits) + 0.0).tolist()


@end_point("POST /api/meshes", "What a URDF shows of its links, as triangles.")
def meshes(
    folder: Folder, robot: Annotated[UrdfRef, it("{urdf, base, tip}, the file below the folder")]
) -> ArmMeshes:
    """What a URDF shows of its links."""
    path = folder.inside(robot.urdf)
    shown, notes = [], []
    visuals = visuals_of(path, robot.base, robot.tip)
    for visual in visuals:
        try:
            if visual.kind == "mesh":
                mesh = read_mesh(_mesh_file(folder, visual.file, path.parent))
            else:
                mesh = solid(visual.kind)
            drawn = simplified(mesh.placed(visual.pose, visual.scale), MOST_TRIANGLES // len(visuals))
        except BadInput as error:
            notes.append(folder.without(f"{visual.file} is not drawn: {error.what}"))
        else:
            vertices = rounded(drawn.vertices, 1)
            shown.append(LinkMesh(link=visual.link, vertices=vertices, faces=drawn.faces.tolist()))
    return ArmMeshes(meshes=shown, notes=notes)


def _mesh_file(folder: Folder, name: str, start: Path) -> Path:
    """The file below the folder that a URDF in `start` names: relative to it, or in a package, a folder above
    or beside it."""
    scheme, separator, rest = name.partition("://")
    if not separator:
        return folder.inside(name, start)
    if scheme != "package":
        raise BadInput("the app reads files below its folder only")
    package, _, inner = rest.partition("/")
    above = [
        folder_above for folder_above in (start, *start.parents) if folder_above.is_relative_to(folder.root)
    ]
    for root in [folder_above for folder_above in above if folder_above.name == package] + [
        folder_above / package for folder_above in above
    ]:
        if (path := folder.inside(inner, root)).is_file():
            return path
    raise BadInput(f"there is no package {package} with this file in the app's folder")


_REACHED_MM, _REACHED_DEG = 0.01, 0.01


@record(kw_only=True)
class InversePosture:
    """The nearest posture, as near to the pose as the arm comes."""

    joints_deg: list[float]
    reached: bool
    off_mm: float
    off_deg: float
    at_limit: Annotated[list[int], it("joints, from 1, at an end of their range")]
    beyond: Annotated[list[int], it("joints, from 1, outside a range that depends on another joint")]


@end_point("POST /api/inverse", "The nearest joints with the flange there, within the limits.")
def inverse(
    folder: Folder,
    robot: Annotated[RobotRef, it("a built-in name, a robot file, or {urdf, base, tip}")],
    joints_deg: Annotated[
        tuple[float, ...],
        BeforeValidator(as_tuple),
        it("posture from which it is dragged, degrees (millimetres for a prismatic joint)"),
    ],
    position_mm: Annotated[Vector, it("of the flange, base frame, millimetres")],
    file: Annotated[
        str | None, it("the file that the robot's path is relative to (default: the folder)")
    ] = None,
    quaternion_wxyz: Annotated[
        Annotated[tuple[float, ...], BeforeValidator(as_tuple)] | None,
        it("of the flange (default: any orientation)"),
        Field(min_length=4, max_length=4),
    ] = None,
) -> InversePosture:
    """The posture nearest to the stated one with the flange at a place."""
    start = folder.root if file is None else folder.inside(file).parent
    arm = load_robot(whole_ref(folder, robot, start), start)
    if len(joints_deg) != arm.n:
        raise wrong(("joints_deg",), "another number of joints", len(joints_deg), arm.n)
    rotation = None
    if quaternion_wxyz is not None:
        quaternion = np.array(quaternion_wxyz)
        if not np.linalg.norm(quaternion) > 1e-6:
            raise wrong(("quaternion_wxyz",), "this quaternion has no length", 0, "[w, x, y, z]")
        rotation = rotation_of_quaternion(quaternion / np.linalg.norm(quaternion))
    joints = np.array(joints_deg) / arm.display
    there = nearest_posture(arm, joints, np.array(position_mm), rotation)
    off_deg = float(np.degrees(there.off_rad))
    beyond = np.flatnonzero(beyond_limits(arm, there.joints[None])[0])
    return InversePosture(
        joints_deg=rounded(there.joints * arm.display, 6),
        reached=there.off_mm <= _REACHED_MM and off_deg <= _REACHED_DEG,
        off_mm=there.off_mm,
        off_deg=off_deg,
        at_limit=list(there.at_limit),
        beyond=[int(i) + 1 for i in beyond],
    )
