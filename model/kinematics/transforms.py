"""Homogeneous transforms (4, 4): mm, rad."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

import numpy as np

from ..arrays import Matrix


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
