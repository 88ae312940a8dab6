"""Poses of the flange that a pendant shows at joint values, with the digits that it shows, and the numbers of
an arm's file that they depend on."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import accumulate
from typing import Literal

import numpy as np
import scipy

from ...model.arrays import Matrix
from ...model.files.robot_file import RobotFile, StatedTransform
from ...model.kinematics.dh import LENGTHS, ORDER
from ...model.kinematics.orientation import (
    from_abc,
    from_quaternion,
    from_rotation_vector,
    from_rpy,
    from_xyz,
    from_zyz,
)
from ...model.kinematics.robot import Robot
from ...model.options import J3, PoseAngles

_DIGITS = 13  # of the numbers that a transform is taken apart into


@dataclass(frozen=True, eq=False)
class FileEntry:
    """A number that an arm's file states: a length, mm, or an angle, degrees; `arm` is the arm with another
    one."""

    name: str
    turns: bool
    value: float
    arm: Callable[[float], Robot]

    def parts(self, flange: Callable[[Robot], Matrix]) -> list[Matrix]:
        """What a pose of the flange is the sum of: by 1 and the value, or by 1, its cosine and its sine."""
        if not self.turns:
            fixed = flange(self.arm(0.0))
            return [fixed, flange(self.arm(1.0)) - fixed]
        ahead, across, back = (flange(self.arm(angle)) for angle in (0.0, 90.0, 180.0))
        fixed = (ahead + back) / 2
        return [fixed, ahead - fixed, across - fixed]


def entries(source: RobotFile | Robot) -> Iterator[FileEntry]:
    """All that a person can have mistyped, from the base to the flange; of a robot that has no rows the
    numbers of the transforms between its joints."""
    if isinstance(source, Robot):
        for i, joint in enumerate(source.joints):
            yield from _of_origin(f" of joint {joint.name}", joint.fixed, partial(_with_fixed, source, i))
        yield from _of_origin(" of the tip", source.flange, lambda flange: replace(source, flange=flange))
        return
    yield from _of_frame("base", source)
    for i, row in enumerate(source.joints):
        for name in ORDER[source.convention]:
            if name is not None and (name != "beta" or row.beta_deg):
                turns = name not in LENGTHS
                key = f"{name}_{'deg' if turns else 'mm'}"
                yield FileEntry(
                    f"{key} of joint {i + 1}", turns, getattr(row, key), partial(_with_entry, source, i, key)
                )
    yield from _of_frame("flange", source)


def with_row(file: RobotFile, i: int, values: Mapping[str, float]) -> RobotFile:
    """The file with other values of joint i (from 0)."""
    rows = list(file.joints)
    rows[i] = rows[i].model_copy(update=dict(values))
    return file.model_copy(update={"joints": tuple(rows)})


def _with_entry(file: RobotFile, i: int, key: str, value: float) -> Robot:
    return with_row(file, i, {key: value}).robot()


def _with_fixed(robot: Robot, i: int, fixed: Matrix) -> Robot:
    joints = list(robot.joints)
    joints[i] = replace(joints[i], fixed=fixed)
    return replace(robot, joints=tuple(joints))


def _of_frame(key: Literal["base", "flange"], file: RobotFile) -> Iterator[FileEntry]:
    def arm(frame: StatedTransform) -> Robot:
        return file.model_copy(update={key: frame}).robot()

    names = {"xyz_mm": ("", f" of {key}.xyz_mm"), "rpy_deg": ("turn about ", f" of {key}.rpy_deg")}
    yield from _of_transform(names, getattr(file, key), arm)


def _of_origin(of: str, fixed: Matrix, arm: Callable[[Matrix], Robot]) -> Iterator[FileEntry]:
    names = {"xyz_mm": ("origin ", of), "rpy_deg": ("origin rotation about ", of)}
    frame = StatedTransform().of(fixed, _DIGITS)
    yield from _of_transform(names, frame, lambda moved: arm(moved.matrix()))


def _of_transform(
    names: Mapping[str, tuple[str, str]], frame: StatedTransform, arm: Callable[[StatedTransform], Robot]
) -> Iterator[FileEntry]:
    """Its shifts, then its turns about the axes from the left; `names` are before and behind the axis."""
    for (key, (before, behind)), axes in zip(names.items(), ("xyz", "zyx"), strict=True):
        for axis in axes:
            k = "xyz".index(axis)

            def other(value: float, key: str = key, k: int = k) -> Robot:
                numbers = list(getattr(frame, key))
                numbers[k] = value
                return arm(frame.model_copy(update={key: tuple(numbers)}))

            yield FileEntry(f"{before}{axis}{behind}", key == "rpy_deg", getattr(frame, key)[k], other)


def revolute(arm: Robot) -> Matrix:
    """(n,) whether each joint turns."""
    return np.array([joint.kind == "revolute" for joint in arm.joints])


def _vector_mm(values: Sequence[float]) -> Matrix:
    return from_rotation_vector([*(value / 1000 for value in values[:3]), *values[3:]])


_POSES: Mapping[PoseAngles, Callable[[Sequence[float]], Matrix]] = {
    "quaternion": from_quaternion,
    "abc": from_abc,
    "wpr": from_rpy,
    "rotation-vector": _vector_mm,
    "xyz": from_xyz,
    "zyz": from_zyz,
}
FORMS: tuple[PoseAngles, ...] = tuple(_POSES)
FORM_OF_VENDOR: Mapping[str, PoseAngles] = {
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


def count_of(form: PoseAngles) -> int:
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

    form: PoseAngles
    joint3: J3 = "link"
    reversed_joint: int | None = None
    exchanged: tuple[int, int] | None = None
    joint_factor: float = 1.0
    place_factor: float = 1.0
    angle_factor: float = 1.0

    def joints(self, pose: PendantPose, arm: Robot) -> Matrix:
        """(n,) rad or mm, joint 3 from link 2."""
        turns = revolute(arm)
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
        off = float(np.abs(computed[:3, 3] - shown[:3, 3]).max())
        return max(off / self.position, angle_between(computed, shown) / self.angle)


def angle_between(one: Matrix, other: Matrix) -> float:
    """Of the orientations of two poses (4, 4), rad."""
    apart = scipy.spatial.transform.Rotation.from_matrix(one[:3, :3].T @ other[:3, :3])
    return float(apart.magnitude())


def poses_along(arm: Robot, joints: Matrix) -> list[Matrix]:
    """Poses (4, 4) behind each joint at joints (n,), rad or mm, and of the flange. `Robot.fk` is the same,
    and takes longer for the first posture of an arm than hundreds of changed arms take here."""
    moved = arm.with_offsets(joints)
    return list(accumulate((*(joint.fixed for joint in moved.joints), moved.flange), np.matmul))


def levers(arm: Robot, poses: Sequence[Matrix]) -> Matrix:
    """(n,) by how many mm the flange moves for a radian of each joint, 1 for a mm of one that slides; `poses`
    are those of `poses_along`."""
    behind = np.array(poses[:-1])
    axes = [pose[:3, :3] @ joint.axis for joint, pose in zip(arm.joints, behind, strict=True)]
    moved = np.cross(axes, poses[-1][:3, 3] - behind[:, :3, 3])
    return np.where(revolute(arm), np.linalg.norm(moved, axis=1), 1.0)


def flange_at(arm: Robot, reading: Counting, pose: PendantPose) -> tuple[Matrix, Tolerance]:
    """The flange's pose (4, 4) of the arm where the pendant shows a pose, and how far it may be off."""
    poses, turns = poses_along(arm, reading.joints(pose, arm)), revolute(arm)
    digit = pose.joint_digit * reading.joint_factor
    steps = np.where(turns, math.radians(digit), pose.joint_digit)
    if reading.joint3 == "ground":
        steps[2] += steps[1]
    position = pose.place_digit * reading.place_factor + float(levers(arm, poses) @ steps)
    return poses[-1], Tolerance(position, reading.angle_bound(pose) + float(steps[turns].sum()))


def agree(arm: Robot, reading: Counting, poses: Sequence[PendantPose], most: float = 1.0) -> bool:
    """Whether the arm agrees with all poses: no deviation over its tolerance is above `most`."""
    for pose in poses:
        computed, allowed = flange_at(arm, reading, pose)
        if allowed.share(computed, reading.pose(pose)) > most:
            return False
    return True
