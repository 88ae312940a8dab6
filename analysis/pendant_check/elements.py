"""An arm as the product of its file's entries: each is a shift along or a rotation about one axis."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...model.arrays import Matrix
from ...model.files.robot_file import RobotFile, StatedTransform
from ...model.kinematics.dh import AXIS, LENGTHS, ORDER
from ...model.kinematics.orientation import angles_of
from ...model.kinematics.robot import Joint, Robot
from ...model.kinematics.transforms import rotation_about, shift

_SHIFTS = ("x", "y", "z")
_TURNS = ("z", "y", "x")  # roll, pitch, yaw from the left


@dataclass(frozen=True)
class Element:
    """A shift by `value` mm along a coordinate axis, or a rotation by `value` degrees about it, which is what
    `entry` of the file states."""

    entry: str
    turns: bool
    axis: str
    value: float

    def matrix(self) -> Matrix:
        if self.turns:
            return rotation_about(self.axis, np.radians(self.value))
        return shift(**{self.axis: self.value})

    def basis(self) -> list[Matrix]:
        """The matrices of which `matrix` is the sum: by 1 and the value, or by 1, its cosine and its sine."""
        if not self.turns:
            return [np.eye(4), shift(**{self.axis: 1.0}) - np.eye(4)]
        quarter, back = (rotation_about(self.axis, sign * np.pi / 2) for sign in (1, -1))
        fixed = (quarter + back) / 2
        return [fixed, np.eye(4) - fixed, (quarter - back) / 2]


@dataclass(frozen=True, eq=False)
class JointMotion:
    """The motion of joint `index` (from 0)."""

    index: int
    joint: Joint

    @property
    def turns(self) -> bool:
        return self.joint.kind == "revolute"


Part = Element | JointMotion


@dataclass(frozen=True, eq=False)
class Chain:
    """Parts in their order from the base to the flange, and the number of joints."""

    parts: tuple[Part, ...]
    n: int

    def revolute(self) -> list[bool]:
        return [part.turns for part in self.parts if isinstance(part, JointMotion)]

    def before(self, joints: Matrix) -> list[Matrix]:
        """Poses (4, 4) before each part at joints (n,), rad or mm, and behind the last: the flange's."""
        poses = [np.eye(4)]
        for part in self.parts:
            if isinstance(part, JointMotion):
                poses.append(poses[-1] @ part.joint.motion(joints[part.index]))
            else:
                poses.append(poses[-1] @ part.matrix() if part.value else poses[-1])
        return poses

    def pose(self, joints: Matrix) -> Matrix:
        """(4, 4) of the flange."""
        return self.before(joints)[-1]

    def levers(self, poses: Sequence[Matrix]) -> Matrix:
        """(n,) by how many mm the flange moves for a radian of each joint, 1 for a mm of one that slides;
        `poses` are those of `before`."""
        moving = [
            (part.index, pose[:3, :3] @ part.joint.axis, poses[-1][:3, 3] - pose[:3, 3])
            for part, pose in zip(self.parts, poses, strict=False)
            if isinstance(part, JointMotion) and part.turns
        ]
        result = np.ones(self.n)
        if moving:
            indices, axes, arms = zip(*moving, strict=True)
            result[list(indices)] = np.linalg.norm(np.cross(axes, arms), axis=1)
        return result

    def with_value(self, k: int, value: float) -> Chain:
        """The chain with another value of part `k`, an element."""
        part = self.parts[k]
        assert isinstance(part, Element)
        return replace(self, parts=(*self.parts[:k], replace(part, value=value), *self.parts[k + 1 :]))


def chain_of_rows(file: RobotFile) -> Chain:
    """The chain of a robot file; parts that a person cannot have mistyped, since the file has no number for
    them, are left out."""
    parts: list[Part] = list(_frame("base", file.base))
    for i, row in enumerate(file.joints):
        for name in ORDER[file.convention]:
            if name is None:
                parts.append(JointMotion(i, row.joint(i + 1, np.eye(4))))
            elif name != "beta" or row.beta_deg:
                turns = name not in LENGTHS
                key = f"{name}_{'deg' if turns else 'mm'}"
                parts.append(Element(f"{key} of joint {i + 1}", turns, AXIS[name], getattr(row, key)))
    parts += _frame("flange", file.flange)
    return Chain(tuple(parts), len(file.joints))


def chain_of_robot(robot: Robot) -> Chain:
    """The chain of a robot that has no rows: entries are those of the transforms between its joints."""
    parts: list[Part] = []
    for i, joint in enumerate(robot.joints):
        parts += _origin(f"of joint {joint.name}", joint.fixed)
        parts.append(JointMotion(i, joint))
    parts += _origin("of the tip", robot.flange)
    return Chain(tuple(parts), robot.n)


def _frame(key: str, frame: StatedTransform) -> Iterator[Element]:
    for axis, value in zip(_SHIFTS, frame.xyz_mm, strict=True):
        yield Element(f"{axis} of {key}.xyz_mm", False, axis, value)
    for axis, value in zip(_TURNS, reversed(frame.rpy_deg), strict=True):
        yield Element(f"turn about {axis} of {key}.rpy_deg", True, axis, value)


def _origin(joint: str, fixed: Matrix) -> Iterator[Element]:
    for axis, value in zip(_SHIFTS, fixed[:3, 3].tolist(), strict=True):
        yield Element(f"origin {axis} {joint}", False, axis, value)
    for axis, value in zip(_TURNS, reversed(angles_of(fixed[:3, :3])), strict=True):
        yield Element(f"origin rotation about {axis} {joint}", True, axis, float(np.degrees(value)))
