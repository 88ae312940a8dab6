"""A robot as a chain of fixed transforms (4, 4; mm, rad) and joint axes, and its forward kinematics.

Whatever a robot was written in (standard DH, modified DH, URDF), inside it is one list:
joint i sits behind the fixed transform `fixed` of the link before it and moves about
(revolute) or along (prismatic) its unit `axis`; after the last joint comes the fixed
transform `flange`. Angles are radians and lengths millimetres.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Sized
from dataclasses import dataclass, field, replace
from functools import lru_cache, reduce
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..arrays import ByValue, Matrix
from ..errors import BadInput
from ..kernel import Kernel
from ..options import J3, PendantUnit


def shift(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Matrix:
    """Translation, mm."""
    result = np.eye(4)
    result[:3, 3] = x, y, z
    return result


def rotation_about(axis: str, angle: float) -> Matrix:
    """Rotation by `angle` (rad) about the coordinate axis "x", "y" or "z"."""
    i = "xyz".index(axis)
    j, k = (i + 1) % 3, (i + 2) % 3
    result = np.eye(4)
    # Exact zeros and ones at multiples of 90 degrees keep the symbolic model free of 1e-17 terms.
    cosine, sine = (round(v) if abs(v - round(v)) < 1e-12 else v for v in (np.cos(angle), np.sin(angle)))
    result[j, j] = result[k, k] = cosine
    result[j, k], result[k, j] = -sine, sine
    return result


def euler(axes: str, angles: Sequence[float] | Matrix) -> Matrix:
    """Rotation by angles (rad) about `axes` in turn, named as by SciPy: "xyz" stay fixed, "XYZ" move with
    the body."""
    turns = [rotation_about(axis, angle) for axis, angle in zip(axes.lower(), angles, strict=True)]
    return reduce(np.matmul, turns if axes.isupper() else turns[::-1])


def pose_of(xyz_mm: Sequence[float], rpy_deg: Sequence[float]) -> Matrix:
    """A shift, then turns about the fixed axes x, y, z (roll, pitch, yaw), degrees."""
    return np.asarray(shift(*xyz_mm) @ euler("xyz", np.radians(rpy_deg)))


def rotations(axis: Matrix, angles: Matrix) -> Matrix:
    """(…, 3, 3) about a unit `axis` (3,) by angles (…), rad (Rodrigues)."""
    x, y, z = axis
    along = np.outer(axis, axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    cosine, sine = np.cos(angles)[..., None, None], np.sin(angles)[..., None, None]
    return np.asarray(along + cosine * (np.eye(3) - along) + sine * cross)


def onto_z(axis: Matrix) -> Matrix:
    """A rotation that takes z onto a unit `axis` (3,)."""
    result = np.eye(4)
    if axis[2] > -1 + 1e-12:
        vector = np.array([-axis[1], axis[0], 0.0])  # z × axis
        cross = np.array([[0, 0, vector[1]], [0, 0, -vector[0]], [-vector[1], vector[0], 0]])
        result[:3, :3] = np.eye(3) + cross + cross @ cross / (1 + axis[2])
    else:
        result[:3, :3] = np.diag([1.0, -1.0, -1.0])
    return result


JointKind = Literal["revolute", "prismatic"]
Turn = tuple[ca.SX, ca.SX]  # cosine and sine of a revolute joint, position and nothing of a prismatic one


@dataclass(frozen=True, eq=False)
class Joint(ByValue):
    """One joint: `fixed` (4, 4) goes before the motion, `axis` (3,) is its unit axis in its own frame.

    `lower`, `upper` are rad or mm, `speed` is rad/s or mm/s (None where the robot file states none).
    """

    name: str
    kind: JointKind
    fixed: Matrix
    axis: Matrix
    lower: float
    upper: float
    speed: float | None = None

    @property
    def display(self) -> float:
        """What one internal unit is in the unit that people read: degrees for rad, mm for mm."""
        return float(np.degrees(1.0)) if self.kind == "revolute" else 1.0

    @property
    def unit(self) -> str:
        return "deg" if self.kind == "revolute" else "mm"

    def motion(self, value: float) -> Matrix:
        """(4, 4) at a position, rad or mm."""
        if self.kind == "prismatic":
            return shift(*(self.axis * value))
        result = np.eye(4)
        result[:3, :3] = rotations(self.axis, np.array(value))
        return result


@dataclass(frozen=True)
class Conventions:
    """What a robot file, or the reference to a URDF, states of an arm; None where it states nothing.

    Parameters
    ----------
    below_base
        How far the mounting face is below the origin of the base frame, mm.
    joint3
        What the pendant counts joint 3 from. "ground": it shows the angle between links 2 and 3 less joint 2.
    range3
        Range of joint 3 as the pendant counts it, rad, where that is from the ground.
    order
        Indices of the joints (from 0) in the order in which the pendant shows them.
    names
        What the pendant calls the joints, joint 1 of the robot file first.
    unit, pulses_per_deg
        Of the pendant's values; the pulses are for a degree (mm) of each joint, joint 1 first.
    encoder3
        What the encoder of joint 3 measures.
    body_radius
        Of the links about their axes, mm.
    """

    below_base: float | None = None
    joint3: J3 | None = None
    range3: tuple[float, float] | None = None
    order: tuple[int, ...] | None = None
    names: tuple[str, ...] | None = None
    unit: PendantUnit = "deg"
    pulses_per_deg: tuple[float, ...] | None = None
    encoder3: J3 | None = None
    body_radius: float | None = None


NOTHING_STATED = Conventions()


@dataclass(frozen=True, eq=False, repr=False)
class Robot(ByValue):
    """A serial arm of n joints from base to flange, with nominal geometry. Robots are equal by value.

    Parameters
    ----------
    name
        What reports call it.
    joints
        The n joints, joint 1 first.
    flange
        (4, 4) from the last joint's frame, after its motion, to the flange, mm.
    vendor
        Who makes it, as in robot files ("abb", "kuka", "universal-robots"); None where not stated.
    conventions
        How it is mounted and how its pendant counts. Joint positions here count joint 3 from link 2.
    doubts
        What looks wrong in its file, in sentences, such as a length in metres.
    rounded
        Those of them on angles that are right angles rounded: no run passes before they are corrected.

    Examples
    --------
    >>> import numpy as np, zerobeam as zb
    >>> robot = zb.load_robot("irb1600")
    >>> robot.fk(np.zeros(6), "deg")[:3, 3].round(1)
    array([ 750. ,    0. , 1186.5])
    >>> robot.jacobian(np.zeros((5, 6)), "deg").shape
    (5, 6, 6)
    """

    name: str
    joints: tuple[Joint, ...]
    flange: Matrix
    vendor: str | None = None
    conventions: Conventions = NOTHING_STATED
    doubts: tuple[str, ...] = field(default=(), compare=False)
    rounded: tuple[str, ...] = field(default=(), compare=False)

    def __repr__(self) -> str:
        return f"<Robot {self.name}: {self.n} joint{'' if self.n == 1 else 's'}>"

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def lower(self) -> Matrix:
        """(n,) lower limits of the joints, rad or mm."""
        return np.array([joint.lower for joint in self.joints])

    @property
    def upper(self) -> Matrix:
        """(n,) upper limits of the joints, rad or mm."""
        return np.array([joint.upper for joint in self.joints])

    @property
    def display(self) -> Matrix:
        """(n,) degrees per radian for revolute joints, 1 for prismatic ones."""
        return np.array([joint.display for joint in self.joints])

    def fk(self, q: ArrayLike, unit: Literal["deg", "rad"]) -> Matrix:
        """Forward kinematics: the flange's pose in the base frame (eq. 1 and 4 of the paper).

        Parameters
        ----------
        q
            (..., n) joint positions; those of prismatic joints in mm whatever the unit.
        unit
            Of the revolute joints: "deg" or "rad".

        Returns
        -------
        ndarray
            (..., 4, 4) homogeneous transforms, translations in mm.

        Raises
        ------
        BadInput
            `q` has another number of joints or is not finite, or the unit is unknown.
        """
        return self.pose_and_jacobian(self._internal(q, unit))[0]

    def jacobian(self, q: ArrayLike, unit: Literal["deg", "rad"]) -> Matrix:
        """The flange's geometric Jacobian in the base frame, exact.

        Parameters
        ----------
        q
            (..., n) joint positions as for `fk`.
        unit
            Of the revolute joints in `q`; the Jacobian is by radians and mm for either.

        Returns
        -------
        ndarray
            (..., 6, n). Rows 0 to 2 are the translation of the flange's origin, mm per rad (of a prismatic
            joint mm per mm); rows 3 to 5 its rotation, rad per rad (0 of a prismatic joint).

        Raises
        ------
        BadInput
            As `fk`.
        """
        return self.pose_and_jacobian(self._internal(q, unit))[1]

    def with_offsets(self, delta: ArrayLike) -> Robot:
        """The robot that is at recorded positions where this one is at those plus `delta` (n,), rad or mm.

        The offsets are in the transforms before the joints; limits stay. BadInput for anything but n numbers.
        """
        if isinstance(delta, Mapping) or np.shape(delta) != (self.n,):
            raise BadInput(
                "these are not the offsets of all joints",
                found=f"{type(delta).__name__} of {len(delta)}" if isinstance(delta, Sized) else repr(delta),
                allowed=f"{self.n} numbers, joint 1 first, rad (mm for prismatic joints)",
                remedy="of offsets by name, degrees: numpy.radians([offsets.get(f'delta{i + 1}', 0) for i in"
                f" range({self.n})])"
                if isinstance(delta, Mapping)
                else None,
                argument="delta",
            )
        joints = tuple(
            replace(joint, fixed=joint.fixed @ joint.motion(float(value)))
            for joint, value in zip(self.joints, np.asarray(delta, dtype=float), strict=True)
        )
        return replace(self, joints=joints)

    def _internal(self, q: ArrayLike, unit: str) -> Matrix:
        """(..., n) joint positions of `fk` in rad and mm."""
        if unit not in ("deg", "rad"):
            raise BadInput(
                "there is no such unit", found=repr(unit), allowed="'deg' or 'rad'", argument="unit"
            )
        allowed = f"finite numbers of shape (..., {self.n}): {self.name} has {self.n} joints"
        try:
            joints = np.asarray(q, dtype=float)
        except (TypeError, ValueError):
            raise BadInput(
                "this is not an array of numbers", found=type(q).__name__, allowed=allowed, argument="q"
            ) from None
        if joints.ndim == 0 or joints.shape[-1] != self.n:
            raise BadInput("the array has the wrong shape", found=joints.shape, allowed=allowed, argument="q")
        if not np.isfinite(joints).all():
            raise BadInput("a joint position is not finite", allowed=allowed, argument="q")
        return joints / self.display if unit == "deg" else joints

    def pose_and_jacobian(self, joints: Matrix) -> tuple[Matrix, Matrix]:
        """What `fk` and `jacobian` return, computed together, of joint positions (..., n), rad or mm."""
        joints = np.asarray(joints, dtype=float)
        batch, rows = joints.shape[:-1], joints.reshape(-1, self.n)
        pose, jacobian = np.zeros((len(rows), 4, 4)), np.zeros((len(rows), 6, self.n))
        if len(rows):
            pose[:, :3], columns = _motion(self)(rows)
            jacobian[:] = columns.reshape(jacobian.shape)
        pose[:, 3, 3] = 1.0
        return pose.reshape(*batch, 4, 4), jacobian.reshape(*batch, 6, self.n)

    def flange_motion(self, turns: Sequence[Turn]) -> tuple[ca.SX, ca.SX, ca.SX]:
        """R (3, 3) and t (3, 1) mm of the flange in the base frame, and the (6, n) columns by which the
        joints move it: of t, then the rotation vector in the base frame."""
        rotation, translation, origins, axes, _ = self._chain(turns)
        columns = [
            ca.vertcat(ca.cross(axis, translation - origin), axis)
            if joint.kind == "revolute"
            else ca.vertcat(axis, ca.SX.zeros(3))
            for joint, origin, axis in zip(self.joints, origins, axes, strict=True)
        ]
        return rotation, translation, ca.horzcat(*columns)

    def flange_pose(self, theta: ca.SX) -> tuple[ca.SX, ca.SX]:
        """R (3, 3) and t (3, 1) mm of the flange in the base frame at the true joint positions (eq. 4).

        `theta` is (n, 1), rad or mm: the recorded positions plus the offsets (eq. 3).
        """
        rotation, translation, *_ = self._chain(self.turns(theta))
        return rotation, translation

    def skeleton(self, theta: ca.SX) -> ca.SX:
        """(3, n + 2) mm: the base, the origin of each joint and the flange, in the base frame."""
        _, translation, origins, *_ = self._chain(self.turns(theta))
        return ca.horzcat(ca.SX.zeros(3), *origins, translation)

    def links(self, theta: ca.SX) -> ca.SX:
        """(3, 4 (n + 1)): rotation and place, mm, of the base and of the link behind each joint in the base
        frame, side by side: frames that move with them, as a URDF names them."""
        poses = [ca.horzcat(ca.SX.eye(3), ca.SX.zeros(3)), *self._chain(self.turns(theta))[4]]
        return ca.horzcat(*poses)

    def axes(self, theta: ca.SX) -> ca.SX:
        """(3, n) the unit axis of each joint in the base frame."""
        return ca.horzcat(*self._chain(self.turns(theta))[3])

    def recorded_turns(self, joints: Matrix) -> Matrix:
        """(…, 2n): cosine and sine of each recorded position (…, n); the position and 0 if prismatic."""
        revolute = np.array([joint.kind == "revolute" for joint in self.joints])
        pairs = np.where(
            revolute[:, None],
            np.stack([np.cos(joints), np.sin(joints)], axis=-1),
            np.stack([joints, np.zeros_like(joints)], axis=-1),
        )
        return pairs.reshape(*joints.shape[:-1], 2 * self.n)

    def turns(self, theta: ca.SX) -> list[Turn]:
        """The motion of each joint at its true position `theta` (n, 1), rad or mm."""
        return [
            (ca.cos(theta[i]), ca.sin(theta[i])) if joint.kind == "revolute" else (theta[i], ca.SX(0))
            for i, joint in enumerate(self.joints)
        ]

    def turns_with_offsets(self, recorded: ca.SX, delta: ca.SX) -> list[Turn]:
        """The same from `recorded_turns` (2n, 1) and offsets (n, 1), by the sum of two angles.

        Sines of what is recorded are then computed once for a run, those of the offsets once for all shots.
        """
        result: list[Turn] = []
        for i, joint in enumerate(self.joints):
            a, b = recorded[2 * i], recorded[2 * i + 1]
            if joint.kind == "revolute":
                cosine, sine = ca.cos(delta[i]), ca.sin(delta[i])
                result.append((a * cosine - b * sine, b * cosine + a * sine))
            else:
                result.append((a + delta[i], ca.SX(0)))
        return result

    def in_flange(self, turns: Sequence[Turn], point: ca.SX) -> tuple[ca.SX, list[ca.SX]]:
        """A point (3, 1) of the base frame as seen from the flange, and from each joint before its motion."""
        stations: list[ca.SX] = []
        for joint, turn in zip(self.joints, turns, strict=True):
            point = ca.sparsify(ca.SX(joint.fixed[:3, :3].T)) @ (point - joint.fixed[:3, 3])
            stations.append(point)
            if joint.kind == "revolute":
                point = axis_rotation(joint.axis, *turn).T @ point
            else:
                point = point - joint.axis * turn[0]
        return ca.sparsify(ca.SX(self.flange[:3, :3].T)) @ (point - self.flange[:3, 3]), stations

    def in_flange_jacobian(
        self, turns: Sequence[Turn], stations: Sequence[ca.SX], vectors: ca.SX
    ) -> tuple[ca.SX, ca.SX]:
        """Of the components of `in_flange` along `vectors` (3, d), fixed in the flange frame: Jacobians by
        the joint positions (d, n) and by the point (d, 3).

        The vectors are carried back from joint to joint; there a turn moves the point by -axis x point.
        """
        columns: list[ca.SX] = []
        vectors = ca.sparsify(ca.SX(self.flange[:3, :3])) @ vectors
        for joint, turn, point in zip(
            reversed(self.joints), reversed(turns), reversed(stations), strict=True
        ):
            if joint.kind == "revolute":
                vectors = axis_rotation(joint.axis, *turn) @ vectors
                columns.append(-(vectors.T @ ca.cross(ca.SX(joint.axis), point)))
            else:
                columns.append(-(vectors.T @ ca.SX(joint.axis)))
            vectors = ca.sparsify(ca.SX(joint.fixed[:3, :3])) @ vectors
        return ca.horzcat(*reversed(columns)), vectors.T

    def _chain(self, turns: Sequence[Turn]) -> tuple[ca.SX, ca.SX, list[ca.SX], list[ca.SX], list[ca.SX]]:
        rotation, translation = ca.SX.eye(3), ca.SX.zeros(3)
        origins: list[ca.SX] = []
        axes: list[ca.SX] = []
        links: list[ca.SX] = []
        for joint, turn in zip(self.joints, turns, strict=True):
            translation = translation + rotation @ joint.fixed[:3, 3]
            origins.append(translation)
            rotation = rotation @ joint.fixed[:3, :3]
            axes.append(rotation @ joint.axis)
            if joint.kind == "revolute":
                rotation = rotation @ axis_rotation(joint.axis, *turn)
            else:
                translation = translation + rotation @ (joint.axis * turn[0])
            links.append(ca.horzcat(rotation, translation))
        translation = translation + rotation @ self.flange[:3, 3]
        return ca.sparsify(rotation @ self.flange[:3, :3]), translation, origins, axes, links


@lru_cache(maxsize=16)
def _motion(robot: Robot) -> Kernel:
    """Joints (n,) to the upper rows (3, 4) of the flange's pose and its Jacobian (6, n).

    By the virtual machine alone: that the numbers are always the same to the last bit is worth the time.
    """
    theta = ca.SX.sym("theta", robot.n)
    rotation, translation, jacobian = robot.flange_motion(robot.turns(theta))
    outputs = [ca.densify(ca.horzcat(rotation, translation)), ca.densify(jacobian)]
    return Kernel(
        ca.Function("pose", [theta], ca.cse(outputs), ["theta"], ["pose", "jacobian"]), compile=False
    )


def same_arm(one: Robot, other: Robot) -> bool:
    """Whether two robots have the same joints in the same places, whatever their names and limits."""
    return (
        one.n == other.n
        and all(
            a.kind == b.kind and np.allclose(a.fixed, b.fixed) and np.allclose(a.axis, b.axis)
            for a, b in zip(one.joints, other.joints, strict=True)
        )
        and np.allclose(one.flange, other.flange)
    )


def axis_rotation(axis: Matrix, cosine: ca.SX, sine: ca.SX) -> ca.SX:
    """Rotation (3, 3) about the unit `axis` (3,) by an angle given by its cosine and sine (Rodrigues)."""
    along, across, cross = _about(*axis.tolist())
    return ca.sparsify(along + cosine * across + sine * cross)


@lru_cache(maxsize=64)
def _about(x: float, y: float, z: float) -> tuple[ca.SX, ca.SX, ca.SX]:
    """uu', 1 - uu' and the matrix of u x of a unit axis u: few arms have others than z, and CasADi takes its
    time to read an array."""
    along = np.outer([x, y, z], [x, y, z])
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return ca.SX(along), ca.SX(np.eye(3) - along), ca.SX(cross)


_SAME = 1e-9  # relative: two descriptions of one arm
Difference = tuple[str, object, object]  # what differs, and what either has


def arm_difference(one: Robot, other: Robot) -> Difference | None:
    """The first difference between two robots; None of one arm."""
    if one.name != other.name:
        return "robot", one.name, other.name
    kinds = [", ".join(joint.kind for joint in arm.joints) for arm in (one, other)]
    if kinds[0] != kinds[1]:
        return "robot", f"joints {kinds[0]}", kinds[1]
    fixed = [[*(joint.fixed for joint in arm.joints), arm.flange] for arm in (one, other)]
    for k, (mine, theirs) in enumerate(zip(*fixed, strict=True), start=1):
        if not np.allclose(mine, theirs, rtol=_SAME, atol=_SAME):
            link = "flange" if k > one.n else f"link before joint {k}"
            return "geometry of the robot", f"one {link}", "another"
    mine, theirs = (np.array([joint.axis for joint in arm.joints]) for arm in (one, other))
    if not np.allclose(mine, theirs, rtol=_SAME, atol=_SAME):
        return "geometry of the robot", "one direction of an axis", "another"
    return None
