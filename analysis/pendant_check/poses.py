"""Poses of the flange that a pendant shows at joint values, with the digits that it shows."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from ...model.arrays import Matrix
from ...model.kinematics.orientation import (
    from_abc,
    from_quaternion,
    from_rotation_vector,
    from_rpy,
    from_xyz,
    from_zyz,
)
from ...model.kinematics.robot import J3
from .elements import Chain

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
        angle = float(Rotation.from_matrix(computed[:3, :3].T @ shown[:3, :3]).magnitude())
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
