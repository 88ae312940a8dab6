"""Where the arm's joints are when its flange is dragged: the nearest posture that has it there."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import BeforeValidator, Field

from ....model.files.header import RobotRef
from ....model.files.robot_file import load_robot
from ....model.instruments.rotations import rotation_of_quaternion
from ....model.kinematics.inverse import nearest_posture
from ....model.kinematics.pendant import beyond_limits
from ....model.parsing.validation import Vector, as_tuple
from ....model.records import it, record
from ..folder import Folder
from ..requests import end_point, wrong
from .robot_library import rounded, whole_ref

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
