"""Robots: those of the library, and one in a posture."""

from __future__ import annotations

from functools import cache, lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

import casadi as ca
import numpy as np
from pydantic import BeforeValidator

from ....experiments.arm_shown import ShownArm, shown_arm
from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.files.header import RobotRef, UrdfRef
from ....model.files.robot_file import built_in_robots, stated_rows
from ....model.files.urdf import visuals_of
from ....model.kinematics.robot import Robot
from ....model.parsing.validation import as_tuple
from ....model.records import if_any, it, record
from ..folder import Folder
from ..requests import end_point, noted
from .meshes import read_mesh, simplified, solid

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

    skeleton: Annotated[list[list[float]], it("n + 2 points, mm: base, joints, flange")]
    axes: Annotated[list[list[float]], it("n unit vectors, of the joints")]
    links: Annotated[list[list[list[float]]], it("n + 1 poses of base and links: rows of 3 x 4")]
    ranges: Annotated[
        list[list[float]],
        it("n lower and upper limits, deg (mm), joint 3 from link 2; `joints` has the pendant's"),
    ]
    notes: Annotated[list[str] | None, it("where numbers look wrong"), if_any] = None


@record(kw_only=True)
class LinkMesh:
    """What a URDF shows of a link."""

    link: Annotated[int, it("0: the base; k: the link behind joint k of the chain")]
    vertices: Annotated[list[list[float]], it("in the link's frame, mm")]
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


def placed_links(robot: Robot, joints: Matrix) -> tuple[list[Any], list[Any]]:
    """At each of joints (N, n), rad or mm, the joints' axes, n unit vectors, and the n + 1 poses of base and
    links."""
    axes, links = (np.array(part).reshape(3, len(joints), -1) for part in _placed(robot)(joints.T))
    poses = links.reshape(3, len(joints), -1, 4)
    return rounded(axes.transpose(1, 2, 0), 9), rounded(poses.transpose(1, 2, 0, 3), 6)


@lru_cache(maxsize=8)
def _placed(robot: Robot) -> ca.Function:
    theta = ca.SX.sym("theta", robot.n)
    return ca.Function("arm", [theta], [ca.densify(part) for part in (robot.axes(theta), robot.links(theta))])


def arm_of(arm: ShownArm, notes: list[str] | None = None) -> DrawnArm:
    """An arm in its first posture."""
    theta = ca.SX.sym("theta", arm.robot.n)
    parts = [arm.robot.skeleton(theta), arm.robot.axes(theta), arm.robot.links(theta)]
    placed = ca.Function("arm", [theta], [ca.densify(part) for part in parts])
    points, axes, links = (np.array(part) for part in placed(arm.poses[0].joints))
    return DrawnArm(
        **vars(arm),
        skeleton=rounded(points.T, 3),
        axes=rounded(axes.T, 9),
        links=rounded(links.reshape(3, -1, 4).transpose(1, 0, 2), 6),
        ranges=rounded(np.stack([arm.robot.lower, arm.robot.upper], axis=1) * arm.robot.display[:, None], 9),
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


def rounded(values: Matrix, digits: int) -> list[Any]:
    return (np.round(values, digits) + 0.0).tolist()  # type: ignore[no-any-return]


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
