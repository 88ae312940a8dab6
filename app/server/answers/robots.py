"""Robots: those of the library, and one in a posture."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

import casadi as ca
import numpy as np
from pydantic import BeforeValidator, Field

from ....experiments.arm_shown import ShownArm, arm_json, shown_arm
from ....model.files.header import RobotRef, UrdfRef
from ....model.files.robot_file import built_in_robots, stated_rows
from ....model.files.validation import FileModel, as_tuple
from ....model.robot import Matrix
from ..end_point import EndPoint
from ..folder import Folder
from .notes import noted


class AskedRobot(FileModel):
    """A robot to show."""

    robot: RobotRef = Field(
        description="a built-in name, a robot file below the folder, or {urdf, base, tip}"
    )
    joints_deg: Annotated[tuple[float, ...], BeforeValidator(as_tuple)] | None = Field(
        default=None, description="joint positions, degrees (millimetres for a prismatic joint); default: 0"
    )
    j3: Literal["link", "ground"] = Field(default="link", description="what joint 3 is counted from")


@cache
def robots(_: Folder) -> list[dict[str, Any]]:
    """The built-in robots: name, vendor and model (null where they are not stated)."""
    stated = [(name, stated_rows(name, Path())) for name in built_in_robots()]
    return [{"name": name, "vendor": rows.vendor, "model": rows.model} for name, rows in stated]


def robot(folder: Folder, wanted: AskedRobot) -> dict[str, Any]:
    """`zerobeam/arm/1`, and in the first posture `skeleton` (n + 2 points, mm: base, joints, flange), `axes`
    (n unit vectors, of the joints) in the base frame; `notes` where numbers look wrong."""
    texts = [] if wanted.joints_deg is None else [", ".join(map(repr, map(float, wanted.joints_deg)))]
    with noted() as notes:
        ref = whole_ref(folder, wanted.robot, folder.root)
        arm = shown_arm(ref, texts, units="deg", j3=wanted.j3)
    return arm_of(arm) | {"notes": notes}


def arm_of(arm: ShownArm) -> dict[str, Any]:
    theta = ca.SX.sym("theta", arm.robot.n)
    both = [ca.densify(arm.robot.skeleton(theta)), ca.densify(arm.robot.axes(theta))]
    points, axes = ca.Function("arm", [theta], both)(arm.poses[0].joints)
    return arm_json(arm) | {
        "skeleton": rounded(np.array(points).T, 3),
        "axes": rounded(np.array(axes).T, 9),
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


END_POINTS = [
    EndPoint("/api/robots", "GET", "The built-in robots: name, vendor, model.", robots),
    EndPoint("/api/robot", "POST", "A robot (zerobeam/arm/1), its skeleton and axes.", robot, AskedRobot),
]
