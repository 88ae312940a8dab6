"""Poses of the flange that a pendant shows at joint values, with the digits that it shows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy

from ...model.arrays import Matrix
from ...model.files.robot_file import RobotFile, StatedTransform
from ...model.kinematics.dh import AXIS, LENGTHS, ORDER
from ...model.kinematics.orientation import (
    angles_of,
    from_abc,
    from_quaternion,
    from_rotation_vector,
    from_rpy,
    from_xyz,
    from_zyz,
)
from ...model.kinematics.robot import J3, Joint, Robot, rotation_about, shift

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


AngleForm = Literal["quaternion", "abc", "wpr", "rotation-vector", "xyz", "zyz"]


def _vector_mm(values: Sequence[float]) -> Matrix:
    return from_rotation_vector([*(value / 1000 for value in values[:3]), *values[3:]])


_POSES: Mapping[AngleForm, Callable[[Sequence[float]], Matrix]] = {
    "quaternion": from_quaternion,
    "abc": from_abc,
    "wpr": from_rpy,
    "rotation-vector": _vector_mm,
    "xyz": from_xyz,
    "zyz": from_zyz,
}
FORMS: tuple[AngleForm, ...] = tuple(_POSES)
FORM_OF_VENDOR: Mapping[str, AngleForm] = {
    "abb": "quaternion",
    "comau": "zyz",
    "denso": "wpr",
    "doosan": "zyz",
    "epson": "abc",
    "fanuc": "wpr",
    "kawasaki": "zyz",
    "kuka": "abc",
    "mitsubishi": "wpr",
    "staubli": "xyz",
    "techman": "wpr",
    "ufactory": "wpr",
    "universal-robots": "rotation-vector",
    "yaskawa": "wpr",
}


def count_of(form: AngleForm) -> int:
    """How many numbers a pose has."""
    return 7 if form == "quaternion" else 6


@dataclass(frozen=True)
class PendantPose:
    """Joint values as the pendant counts them, joint 1 first, degrees (mm), and the pose that it shows there:
    X, Y, Z in mm and the orientation, in degrees but for a quaternion or a rotation vector.

    The digits are one unit of the last one shown: of the joints, of X, Y, Z, of the orientation.
    """

    counted: tuple[float, ...]
    numbers: tuple[float, ...]
    joint_digit: float
    place_digit: float
    angle_digit: float


@dataclass(frozen=True)
class Counting:
    """How values of the pendant are read: what joint 3 is counted from, a pair of joints that is exchanged,
    and a joint of the file that moves the other way (from 0), the unit of the joints; form and units of the
    pose."""

    form: AngleForm
    joint3: J3 = "link"
    reversed_joint: int | None = None
    exchanged: tuple[int, int] | None = None
    joint_factor: float = 1.0
    place_factor: float = 1.0
    angle_factor: float = 1.0

    def joints(self, pose: PendantPose, revolute: Sequence[bool]) -> Matrix:
        """(n,) rad or mm, joint 3 from link 2."""
        turns = np.array(revolute)
        values = np.array(pose.counted) * np.where(turns, self.joint_factor, 1.0)
        if self.exchanged is not None:
            i, j = self.exchanged
            values[[i, j]] = values[[j, i]]
        if self.joint3 == "ground":
            values[2] += values[1]
        if self.reversed_joint is not None:
            values[self.reversed_joint] *= -1
        return np.where(turns, np.radians(values), values)

    def pose(self, pose: PendantPose) -> Matrix:
        """(4, 4) mm."""
        position = [value * self.place_factor for value in pose.numbers[:3]]
        return _POSES[self.form]([*position, *(value * self.angle_factor for value in pose.numbers[3:])])

    def angle_bound(self, pose: PendantPose) -> float:
        """By what angle, rad, the orientation may be off for its digits."""
        match self.form:
            case "quaternion":
                return 4 * pose.angle_digit
            case "rotation-vector":
                return math.sqrt(3) * pose.angle_digit
        return math.radians(3 * pose.angle_digit * self.angle_factor)


@dataclass(frozen=True)
class Tolerance:
    """How far a computed pose may be off for the digits that are shown: mm, rad."""

    position: float
    angle: float

    def share(self, computed: Matrix, shown: Matrix) -> float:
        """The larger of both deviations over its tolerance: at most 1 where the poses agree."""
        apart = scipy.spatial.transform.Rotation.from_matrix(computed[:3, :3].T @ shown[:3, :3])
        angle = float(apart.magnitude())
        off = float(np.abs(computed[:3, 3] - shown[:3, 3]).max())
        return max(off / self.position, angle / self.angle)


def tolerance(chain: Chain, before: Sequence[Matrix], reading: Counting, pose: PendantPose) -> Tolerance:
    """Of the flange at a posture, at which the poses before each part of the chain are `before`."""
    turns = np.array(chain.revolute())
    digit = pose.joint_digit * reading.joint_factor
    steps = np.where(turns, math.radians(digit), pose.joint_digit)
    if reading.joint3 == "ground":
        steps[2] += steps[1]
    position = pose.place_digit * reading.place_factor + float(chain.levers(before) @ steps)
    return Tolerance(position, reading.angle_bound(pose) + float(steps[turns].sum()))


def agree(chain: Chain, reading: Counting, poses: Sequence[PendantPose], most: float = 1.0) -> bool:
    """Whether the chain agrees with all poses: no deviation over its tolerance is above `most`."""
    for pose in poses:
        before = chain.before(reading.joints(pose, chain.revolute()))
        allowed = tolerance(chain, before, reading, pose)
        if allowed.share(before[-1], reading.pose(pose)) > most:
            return False
    return True
