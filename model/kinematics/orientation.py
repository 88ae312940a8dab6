"""Orientations in the forms that pendants show, from and to rotation matrices (3, 3)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..arrays import Matrix
from .robot import rotation_about


def roll_pitch_yaw(roll: float, pitch: float, yaw: float) -> Matrix:
    """Homogeneous rotation (4, 4) by roll, pitch, yaw (rad) about the fixed axes x, y, z, in this order."""
    return rotation_about("z", yaw) @ rotation_about("y", pitch) @ rotation_about("x", roll)


def angles_of(rotation: Matrix) -> tuple[float, float, float]:
    """Roll, pitch and yaw, rad, of R = Rz(yaw) Ry(pitch) Rx(roll), (3, 3).

    Pitch and roll are taken from Rz(-yaw) R, so that they suit whatever yaw came out where the pitch is near
    90 degrees and roll and yaw turn about one axis.
    """
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    if math.hypot(rotation[1, 0], rotation[0, 0]) < 1e-9:
        yaw = 0.0  # x along z: any yaw will do
    cosine, sine = math.cos(yaw), math.sin(yaw)
    pitch = math.atan2(-rotation[2, 0], cosine * rotation[0, 0] + sine * rotation[1, 0])
    roll = math.atan2(
        sine * rotation[0, 2] - cosine * rotation[1, 2], cosine * rotation[1, 1] - sine * rotation[0, 1]
    )
    return roll, pitch, yaw


@dataclass(frozen=True)
class Orientation:
    """One orientation in each of the forms; angles in degrees, the rotation vector in radians.

    Attributes
    ----------
    quaternion
        (w, x, y, z), w at least 0: q1 to q4 of ABB. ROS writes (x, y, z, w).
    roll_pitch_yaw
        About the fixed axes x, y, z in this order: W, P, R of FANUC, Rx, Ry, Rz of Yaskawa, roll, pitch and
        yaw of UFACTORY and of a URDF. A, B, C of KUKA are the same backwards: yaw, pitch, roll.
    rotation_vector
        The axis times the angle, at most pi long: rx, ry, rz of Universal Robots.
    xyz
        About x, then the new y, then the new z: Rx, Ry, Rz of Stäubli.
    """

    quaternion: tuple[float, float, float, float]
    roll_pitch_yaw: tuple[float, float, float]
    rotation_vector: tuple[float, float, float]
    xyz: tuple[float, float, float]

    @property
    def abc(self) -> tuple[float, float, float]:
        """A, B, C of KUKA, degrees."""
        roll, pitch, yaw = self.roll_pitch_yaw
        return yaw, pitch, roll


def orientation(rotation: Matrix) -> Orientation:
    """The forms of a rotation matrix (3, 3)."""
    w, *axis = _quaternion(rotation)
    sine = math.hypot(*axis)
    angle = 2 * math.atan2(sine, w)
    # R = Rx(a) Ry(b) Rz(c) is the transpose of Rz(-c) Ry(-b) Rx(-a).
    turned = [-value for value in angles_of(rotation.T)]
    return Orientation(
        (w, axis[0], axis[1], axis[2]),
        _degrees(angles_of(rotation)),
        _three([angle * value / sine for value in axis] if sine else [0.0, 0.0, 0.0]),
        _degrees(turned),
    )


def _quaternion(rotation: Matrix) -> tuple[float, float, float, float]:
    """(w, x, y, z) by the largest of the four (Shepperd), which divides by no small number."""
    r = rotation
    squares = [
        1 + r[0, 0] + r[1, 1] + r[2, 2],
        1 + r[0, 0] - r[1, 1] - r[2, 2],
        1 - r[0, 0] + r[1, 1] - r[2, 2],
        1 - r[0, 0] - r[1, 1] + r[2, 2],
    ]
    rows = [
        [squares[0], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
        [r[2, 1] - r[1, 2], squares[1], r[1, 0] + r[0, 1], r[0, 2] + r[2, 0]],
        [r[0, 2] - r[2, 0], r[1, 0] + r[0, 1], squares[2], r[2, 1] + r[1, 2]],
        [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[2, 1] + r[1, 2], squares[3]],
    ]
    best = np.array(rows[int(np.argmax(squares))], dtype=float)
    best /= np.linalg.norm(best)
    signs = [value for value in best.tolist() if abs(value) > 1e-12]
    w, x, y, z = (best if signs[0] > 0 else -best).tolist()
    return w, x, y, z


def _degrees(angles: tuple[float, ...] | list[float]) -> tuple[float, float, float]:
    return _three([math.degrees(value) for value in angles])


def _three(values: list[float]) -> tuple[float, float, float]:
    x, y, z = (value + 0.0 for value in values)
    return x, y, z
