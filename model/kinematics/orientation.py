"""Orientations in the forms that pendants show, from and to rotation matrices (3, 3)."""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from functools import partial
from typing import Annotated

import numpy as np
import scipy

from ..arrays import Matrix
from ..errors import BadInput
from ..records import it, key, record
from .robot import euler, shift

_LARGEST = 1e6  # mm, deg
_HALF_TURN = np.pi - 1e-12
Three = tuple[float, float, float]


def angles_of(rotation: Matrix, axes: str = "xyz") -> Three:
    """Angles, rad, of a rotation (3, 3) about `axes` (see `euler`), by default roll, pitch and yaw. The third
    is 0 where the first and the third turn about one axis."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Gimbal lock", UserWarning)
        angles = scipy.spatial.transform.Rotation.from_matrix(rotation).as_euler(axes)
    return _three(np.where(angles < -_HALF_TURN, np.pi, angles))


@record
class Orientation:
    """One orientation in each of the forms; angles in degrees, the rotation vector in radians."""

    quaternion: Annotated[
        tuple[float, float, float, float],
        it("(w, x, y, z), w at least 0: q1 to q4 of ABB. ROS writes (x, y, z, w)"),
    ]
    roll_pitch_yaw: Annotated[
        Three,
        it(
            "about the fixed axes x, y, z in this order: W, P, R of FANUC, Rx, Ry, Rz of Yaskawa, roll, pitch"
            " and yaw of UFACTORY and of a URDF"
        ),
    ]
    rotation_vector: Annotated[
        Three, it("the axis times the angle, at most π long: rx, ry, rz of Universal Robots")
    ]
    xyz: Annotated[Three, it("about x, then the new y, then the new z: Rx, Ry, Rz of Stäubli")]
    zyz: Annotated[
        Three, it("about z, then the new y, then the new z: O, A, T of Kawasaki, A, B, C of Doosan")
    ]

    @property
    @key("A, B, C of KUKA: yaw, pitch, roll")
    def abc(self) -> Three:
        """A, B, C of KUKA, degrees."""
        roll, pitch, yaw = self.roll_pitch_yaw
        return yaw, pitch, roll


def orientation(rotation: Matrix) -> Orientation:
    """The forms of a rotation matrix (3, 3)."""
    turn = scipy.spatial.transform.Rotation.from_matrix(rotation)
    x, y, z, w = (turn.as_quat(canonical=True) + 0.0).tolist()
    roll_pitch_yaw, xyz, zyz = (
        _three(np.degrees(angles_of(rotation, axes))) for axes in ("xyz", "XYZ", "ZYZ")
    )
    return Orientation((w, x, y, z), roll_pitch_yaw, _three(turn.as_rotvec()), xyz, zyz)


def _three(values: Matrix) -> Three:
    x, y, z = (values + 0.0).tolist()  # no -0.0
    return x, y, z


def from_angles(axes: str, values: Sequence[float]) -> Matrix:
    """(4, 4) of x, y, z (mm) and three angles (degrees) about `axes` (see `euler`)."""
    return np.asarray(shift(*values[:3]) @ euler(axes, np.radians(values[3:])))


from_rpy = partial(from_angles, "xyz")  # FANUC's W, P, R
from_abc = partial(from_angles, "ZYX")  # KUKA's A, B, C
from_xyz = partial(from_angles, "XYZ")  # Stäubli's Rx, Ry, Rz
from_zyz = partial(from_angles, "ZYZ")  # Kawasaki's O, A, T


def from_quaternion(values: Sequence[float]) -> Matrix:
    """(4, 4) of x, y, z (mm) and (w, x, y, z), of any length but 0."""
    x, y, z, w, *vector = values
    return _placed((x, y, z), scipy.spatial.transform.Rotation.from_quat([*vector, w]))


def from_rotation_vector(values: Sequence[float]) -> Matrix:
    """(4, 4) of a URScript pose: metres, radians."""
    return _placed(1000 * np.array(values[:3]), scipy.spatial.transform.Rotation.from_rotvec(values[3:]))


def _placed(xyz_mm: Sequence[float] | Matrix, turn: scipy.spatial.transform.Rotation) -> Matrix:
    result = shift(*xyz_mm)
    result[:3, :3] = turn.as_matrix()
    return result


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
