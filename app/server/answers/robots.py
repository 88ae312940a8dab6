"""Robots: those of the library, and one in a posture."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

import casadi as ca
import numpy as np
from pydantic import BeforeValidator, Field

from ....experiments.arm_shown import ShownArm, arm_json, shown_arm
from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.files.header import RobotRef, UrdfRef
from ....model.files.robot_file import built_in_robots, stated_rows
from ....model.files.urdf import visuals_of
from ....model.files.validation import FileModel, as_tuple
from ..end_point import EndPoint
from ..folder import Folder
from .meshes import read_mesh, simplified, solid
from .notes import noted

MOST_TRIANGLES = 3000  # of an arm: what a tablet draws while it is turned


class AskedRobot(FileModel):
    """A robot to show."""

    robot: RobotRef = Field(
        description="a built-in name, a robot file below the folder, or {urdf, base, tip}"
    )
    joints_deg: Annotated[tuple[float, ...], BeforeValidator(as_tuple)] | None = Field(
        default=None, description="joint positions, degrees (millimetres for a prismatic joint); default: 0"
    )
    j3: Literal["link", "ground", "pendant"] = Field(
        default="link",
        description="what joint 3 is counted from: link 2, as in files; the ground; or as the robot file"
        " states of the pendant",
    )


class AskedMeshes(FileModel):
    """A URDF of which the meshes are to be drawn."""

    robot: UrdfRef = Field(description="{urdf, base, tip}, the file below the folder")


@cache
def robots(_: Folder) -> list[dict[str, Any]]:
    """The built-in robots: name, vendor and model (null where they are not stated)."""
    stated = [(name, stated_rows(name, Path())) for name in built_in_robots()]
    return [{"name": name, "vendor": rows.vendor, "model": rows.model} for name, rows in stated]


def robot(folder: Folder, wanted: AskedRobot) -> dict[str, Any]:
    """`zerobeam/arm/1`, and in the first posture `skeleton` (n + 2 points, mm: base, joints, flange), `axes`
    (n unit vectors, of the joints) and `links` (n + 1 poses of base and links: rows of 3 x 4) in the base
    frame; `notes` where numbers look wrong."""
    with noted() as notes:
        ref = whole_ref(folder, wanted.robot, folder.root)
        j3 = None if wanted.j3 == "pendant" else wanted.j3
        arm = shown_arm(ref, [] if wanted.joints_deg is None else [wanted.joints_deg], j3=j3)
    return arm_of(arm) | {"notes": notes}


def arm_of(arm: ShownArm) -> dict[str, Any]:
    theta = ca.SX.sym("theta", arm.robot.n)
    parts = [arm.robot.skeleton(theta), arm.robot.axes(theta), arm.robot.links(theta)]
    placed = ca.Function("arm", [theta], [ca.densify(part) for part in parts])
    points, axes, links = (np.array(part) for part in placed(arm.poses[0].joints))
    return arm_json(arm) | {
        "skeleton": rounded(points.T, 3),
        "axes": rounded(axes.T, 9),
        "links": rounded(links.reshape(3, -1, 4).transpose(1, 0, 2), 6),
    }


def whole_ref(folder: Folder, ref: str | UrdfRef, start: Path) -> str | UrdfRef:
    """The same robot, its file with its whole path."""
    if isinstance(ref, UrdfRef):
        return ref.model_copy(update={"urdf": str(folder.inside(ref.urdf, start))})
    if ref in built_in_robots() or "." not in ref:
        return ref
    return str(folder.inside(ref, start))


def require_robot_inside(folder: Folder, content: Any, start: Path) -> None:
    stated = content.get("robot") if isinstance(content, dict) else None
    name = stated.get("urdf") if isinstance(stated, dict) else stated
    if isinstance(name, str) and name not in built_in_robots() and (isinstance(stated, dict) or "." in name):
        folder.inside(name, start)


def rounded(values: Matrix, digits: int) -> list[Any]:
    return (np.round(values, digits) + 0.0).tolist()  # type: ignore[no-any-return]


def meshes(folder: Folder, wanted: AskedMeshes) -> dict[str, Any]:
    """What a URDF shows of its links: `meshes` with `link` (0: the base; k: the link behind joint k of the
    chain), `vertices` in the link's frame, mm, and `faces` (three vertices each); `notes` on what is left
    out."""
    path = folder.inside(wanted.robot.urdf)
    shown, notes = [], []
    visuals = visuals_of(path, wanted.robot.base, wanted.robot.tip)
    for visual in visuals:
        try:
            if visual.kind == "mesh":
                mesh = read_mesh(_mesh_file(folder, visual.file, path.parent))
            else:
                mesh = solid(visual.kind)
            own = simplified(mesh.placed(visual.pose, visual.scale), MOST_TRIANGLES // len(visuals))
        except BadInput as error:
            notes.append(folder.without(f"{visual.file} is not drawn: {error.what}"))
        else:
            vertices = rounded(own.vertices, 1)
            shown.append({"link": visual.link, "vertices": vertices, "faces": own.faces.tolist()})
    return {"meshes": shown, "notes": notes}


def _mesh_file(folder: Folder, name: str, start: Path) -> Path:
    """The file below the folder that a URDF in `start` names: relative to it, or in a package, a folder above
    or beside it."""
    scheme, found, rest = name.partition("://")
    if not found:
        return folder.inside(name, start)
    if scheme != "package":
        raise BadInput("the app reads files below its folder only")
    package, _, inner = rest.partition("/")
    above = [own for own in (start, *start.parents) if own.is_relative_to(folder.root)]
    for place in [own for own in above if own.name == package] + [own / package for own in above]:
        if (path := folder.inside(inner, place)).is_file():
            return path
    raise BadInput(f"there is no package {package} with this file in the app's folder")


END_POINTS = [
    EndPoint("/api/robots", "GET", "The built-in robots: name, vendor, model.", robots),
    EndPoint("/api/robot", "POST", "A robot (zerobeam/arm/1), its skeleton and axes.", robot, AskedRobot),
    EndPoint("/api/meshes", "POST", "What a URDF shows of its links, as triangles.", meshes, AskedMeshes),
]
