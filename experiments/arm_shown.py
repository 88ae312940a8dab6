"""A robot as it is understood: what `zerobeam robot` shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ..model.arms.joint_three import J3, from_ground
from ..model.arms.orientation import Orientation, orientation
from ..model.arms.reach import reach
from ..model.errors import BadInput
from ..model.files.header import UrdfRef
from ..model.files.limits import beyond_limits
from ..model.files.robot_file import built_in_robots, load_robot, stated_rows
from ..model.robot import Matrix, Robot
from ..reports.words.wording import counted
from .importers.typed import typed_joints


@dataclass(frozen=True, eq=False)
class ShownPose:
    """The flange at `joints` (n,) rad or mm: `place_mm` (3,) and the orientation in the base frame.

    `outside` are the joints (from 1) beyond their limits.
    """

    joints: Matrix
    place_mm: tuple[float, float, float]
    orientation: Orientation
    outside: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class ShownArm:
    """A robot, what its maker calls it (None: not stated), its reach in mm, and the flange in postures."""

    robot: Robot
    model: str | None
    reach_mm: float
    poses: tuple[ShownPose, ...]


def typed_arm(ref: str | UrdfRef, joints: Sequence[str], *, units: Literal["deg", "rad"], j3: J3) -> ShownArm:
    """The robot of a name or file; `joints` are texts of joint values (none: the zero posture)."""
    robot = load_robot(ref)
    return _shown(ref, robot, [_typed(robot, text, units) for text in joints], j3)


def shown_arm(ref: str | UrdfRef, joints_deg: Sequence[Sequence[float]], *, j3: J3 = "link") -> ShownArm:
    """The same with joint values (n,) in degrees (mm) in each posture; BadInput where there are not n."""
    robot = load_robot(ref)
    for values in joints_deg:
        if len(values) != robot.n:
            raise BadInput(
                f"{robot.name} has another number of joints",
                found=counted(len(values), "joint value"),
                allowed=robot.n,
            )
    return _shown(ref, robot, [np.array(values, dtype=float) / robot.display for values in joints_deg], j3)


def _shown(ref: str | UrdfRef, robot: Robot, joints: Sequence[Matrix], j3: J3) -> ShownArm:
    rows = isinstance(ref, str) and (ref in built_in_robots() or ref.lower().endswith((".yaml", ".yml")))
    model = stated_rows(ref, Path()).model if rows and isinstance(ref, str) else None
    postures = [from_ground(own, robot) if j3 == "ground" else own for own in joints] or [np.zeros(robot.n)]
    return ShownArm(robot, model, reach(robot), tuple(_pose(robot, posture) for posture in postures))


def arm_json(arm: ShownArm) -> dict[str, Any]:
    """`zerobeam/arm/1` (docs/files.md)."""
    robot = arm.robot
    return {
        "schema": "zerobeam/arm/1",
        "name": robot.name,
        "vendor": robot.vendor,
        "model": arm.model,
        "reach_mm": round(arm.reach_mm, 1),
        "joints": [
            {
                "name": joint.name,
                "kind": joint.kind,
                "unit": joint.unit,
                "lower": joint.lower * joint.display,
                "upper": joint.upper * joint.display,
                "speed": None if joint.speed is None else joint.speed * joint.display,
            }
            for joint in robot.joints
        ],
        "poses": [
            {
                "joints_deg": (pose.joints * robot.display).tolist(),
                "outside": list(pose.outside),
                "xyz_mm": list(pose.place_mm),
                "quaternion_wxyz": list(pose.orientation.quaternion),
                "rpy_deg": list(pose.orientation.roll_pitch_yaw),
                "abc_deg": list(pose.orientation.abc),
                "rotation_vector_rad": list(pose.orientation.rotation_vector),
                "rx_ry_rz_deg": list(pose.orientation.xyz),
            }
            for pose in arm.poses
        ],
    }


def _typed(robot: Robot, text: str, units: Literal["deg", "rad"]) -> Matrix:
    """(n,) rad or mm."""
    typed = typed_joints(text, robot.n)
    if typed.unit is not None and typed.unit != units:
        raise BadInput(
            f"the joint values are in {typed.unit} and --units says {units}",
            found=text.strip(),
            remedy=f"state --units {typed.unit}",
        )
    values = np.array(typed.values)
    return values / robot.display if units == "deg" else values


def _pose(robot: Robot, joints: Matrix) -> ShownPose:
    pose = robot.fk(joints, "rad")
    x, y, z = (float(value) for value in pose[:3, 3])
    outside = np.flatnonzero(beyond_limits(robot, joints * robot.display)) + 1
    return ShownPose(joints, (x, y, z), orientation(pose[:3, :3]), tuple(int(i) for i in outside))
