"""Poses as vendors write them, as matrices (4, 4), mm."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np

from ..arrays import Matrix
from ..errors import BadInput
from .orientation import roll_pitch_yaw
from .robot import shift

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
