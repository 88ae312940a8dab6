"""Orientations in the forms that pendants show, from and to rotation matrices (3, 3)."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Matrix
from ..errors import BadInput
from .robot import rotation_about, shift


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
    zyz
        About z, then the new y, then the new z: O, A, T of Kawasaki, A, B, C of Doosan.
    """

    quaternion: tuple[float, float, float, float]
    roll_pitch_yaw: tuple[float, float, float]
    rotation_vector: tuple[float, float, float]
    xyz: tuple[float, float, float]
    zyz: tuple[float, float, float]

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
        _degrees(_zyz(rotation)),
    )


def _zyz(rotation: Matrix) -> tuple[float, float, float]:
    """a, b and c, rad, of R = Rz(a) Ry(b) Rz(c), b at least 0; a is 0 where both turn about one axis."""
    across = math.hypot(rotation[0, 2], rotation[1, 2])
    a = math.atan2(rotation[1, 2], rotation[0, 2]) if across > 1e-9 else 0.0
    cosine, sine = math.cos(a), math.sin(a)
    b = math.atan2(cosine * rotation[0, 2] + sine * rotation[1, 2], rotation[2, 2])
    c = math.atan2(
        cosine * rotation[1, 0] - sine * rotation[0, 0], cosine * rotation[1, 1] - sine * rotation[0, 1]
    )
    return a, b, c


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


_LARGEST = 1e6  # mm, deg


def from_quaternion(values: Sequence[float]) -> Matrix:
    """(4, 4) of x, y, z (mm) and (w, x, y, z)."""
    x, y, z, *turn = values
    result = shift(x, y, z)
    w, i, j, k = np.array(turn) / math.hypot(*turn)
    result[:3, :3] = [
        [1 - 2 * (j * j + k * k), 2 * (i * j - k * w), 2 * (i * k + j * w)],
        [2 * (i * j + k * w), 1 - 2 * (i * i + k * k), 2 * (j * k - i * w)],
        [2 * (i * k - j * w), 2 * (j * k + i * w), 1 - 2 * (i * i + j * j)],
    ]
    return result


def from_rpy(values: Sequence[float]) -> Matrix:
    """(4, 4) of x, y, z (mm) and rotations about fixed x, y, z (degrees): FANUC's W, P, R."""
    x, y, z, *turns = values
    return np.asarray(shift(x, y, z) @ roll_pitch_yaw(*np.radians(turns)))


def from_abc(values: Sequence[float]) -> Matrix:
    """(4, 4) of KUKA's X, Y, Z, A, B, C."""
    x, y, z, a, b, c = values
    return from_rpy((x, y, z, c, b, a))


def from_xyz(values: Sequence[float]) -> Matrix:
    """(4, 4) of x, y, z (mm) and rotations about x, the new y and the new z (degrees), as Stäubli's."""
    x, y, z, *turns = values
    one, two, three = np.radians(turns)
    turned = rotation_about("x", one) @ rotation_about("y", two) @ rotation_about("z", three)
    return np.asarray(shift(x, y, z) @ turned)


def from_zyz(values: Sequence[float]) -> Matrix:
    """(4, 4) of x, y, z (mm) and rotations about z, the new y and the new z (degrees): Kawasaki's O, A, T."""
    x, y, z, *turns = values
    one, two, three = np.radians(turns)
    turned = rotation_about("z", one) @ rotation_about("y", two) @ rotation_about("z", three)
    return np.asarray(shift(x, y, z) @ turned)


def from_rotation_vector(values: Sequence[float]) -> Matrix:
    """(4, 4) of a URScript pose: metres, radians."""
    x, y, z, *vector = values
    angle = math.hypot(*vector)
    half = math.sin(angle / 2) / angle if angle else 0.5
    return from_quaternion(
        (1000 * x, 1000 * y, 1000 * z, math.cos(angle / 2), *(half * value for value in vector))
    )


def stated_numbers(text: str, count: int, option: str, form: str) -> list[float]:
    """The numbers of an option that takes `count` of them, with or without brackets; `form` shows them."""
    try:
        values = [float(part) for part in re.sub(r"[\[\]()p{}]", " ", text).split(",")]
    except ValueError:
        values = []
    usable = all(abs(value) <= _LARGEST for value in values)
    if len(values) != count or not usable or (count == 7 and not any(values[3:])):
        raise BadInput(f"{option} is not understood", found=text, allowed=f"{form}: numbers up to 1 000 000")
    return values
