"""Rotations as rotation vectors (axis times angle, rad), matrices and quaternions (w, x, y, z): as symbols
with exact derivatives below 180°, and as numbers where a fit starts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import casadi as ca
import numpy as np
from pydantic import AfterValidator

from ..arrays import Matrix
from ..errors import BadInput
from ..parsing.reading import shown
from ..parsing.validation import refusal, tuple_of

# Below these squares a power series takes the place of a quotient that is 0/0 at zero. Its first term left
# out is below 1e-16.
_SMALL_ANGLE = 1e-2
_SMALL_SINE = 1e-3
_LENGTH = 0.01  # how far the length of a quaternion may be from 1: its digits are few
_ALLOWED = "[w, x, y, z] of length 1, such as [1, 0, 0, 0]"


def _of_length_1(value: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    if not abs(np.linalg.norm(value) - 1) <= _LENGTH:
        raise refusal(
            "a quaternion is not of length 1",
            found=f"{shown(value)}, of length {np.linalg.norm(value):.4g}",
            allowed=_ALLOWED,
            remedy="correct the quaternion; w comes first",
        )
    return value


Quaternion = Annotated[
    tuple[float, float, float, float], AfterValidator(_of_length_1), tuple_of(4, "[w, x, y, z]")
]


def unit_quaternion(quaternion: Sequence[float]) -> Matrix:
    """(4,) of length 1; BadInput for what is far from that."""
    result = np.array(quaternion, dtype=float)
    length = float(np.linalg.norm(result))
    if result.shape != (4,) or not abs(length - 1) <= _LENGTH:
        raise BadInput(
            "a quaternion is not of length 1",
            found=f"{shown(list(quaternion))}, of length {length:.4g}",
            allowed=_ALLOWED,
            remedy="correct the quaternion; w comes first",
        )
    return np.asarray(result / length)


# Symbols


def turned(vector: ca.SX) -> ca.SX:
    """(3, 3) of a rotation vector (3, 1) (Rodrigues)."""
    square = ca.sumsqr(vector)
    small = square < _SMALL_ANGLE
    # The branch not taken must not divide by zero either: its derivative is multiplied by 0, and is NaN else.
    angle = ca.sqrt(ca.if_else(small, 1.0, square))
    sine = 1 - square / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72)))
    cosine = (1 - square / 12 * (1 - square / 30 * (1 - square / 56 * (1 - square / 90)))) / 2
    a = ca.if_else(small, sine, ca.sin(angle) / angle)
    b = ca.if_else(small, cosine, 2 * (ca.sin(angle / 2) / angle) ** 2)
    cross = ca.skew(vector)
    return ca.SX.eye(3) + a * cross + b * (cross @ cross)


def matrix_of(q: ca.SX) -> ca.SX:
    """(3, 3) of a unit quaternion (4, 1)."""
    w, vector = q[0], q[1:]
    cross = ca.skew(vector)
    return ca.SX.eye(3) + 2 * w * cross + 2 * (cross @ cross)


def quaternion_of(m: ca.SX) -> ca.SX:
    """(4, 1) of a rotation matrix (3, 3), w ≥ 0: from its largest component (Shepperd), so never 0/0."""
    columns = [
        ca.vertcat(1 + m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]),
        ca.vertcat(m[2, 1] - m[1, 2], 1 + m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]),
        ca.vertcat(m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], 1 - m[0, 0] + m[1, 1] - m[2, 2], m[1, 2] + m[2, 1]),
        ca.vertcat(m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], 1 - m[0, 0] - m[1, 1] + m[2, 2]),
    ]
    result, largest = columns[0], columns[0][0]
    for i in (1, 2, 3):
        larger = columns[i][i] > largest
        result = ca.if_else(larger, columns[i], result)
        largest = ca.fmax(largest, columns[i][i])
    return result / ca.sqrt(ca.sumsqr(result)) * ca.if_else(result[0] < 0, -1, 1)


def vector_of(m: ca.SX) -> ca.SX:
    """(3, 1) rotation vector of a rotation matrix (3, 3), up to 180°."""
    q = quaternion_of(m)
    square = ca.sumsqr(q[1:])
    small = square < _SMALL_SINE
    sine = ca.sqrt(ca.if_else(small, 1.0, square))
    series = 2 * (1 + square * (1 / 6 + square * (3 / 40 + square * (15 / 336 + square * 105 / 3456))))
    return ca.if_else(small, series, 2 * ca.atan2(sine, q[0]) / sine) * q[1:]


def across(n: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Unit b1, b2 (3, 1) across a unit vector (3, 1), the three right-handed (Duff et al. 2017)."""
    sign = ca.if_else(n[2] < 0, -1, 1)
    a = -1 / (sign + n[2])
    b = n[0] * n[1] * a
    b1 = ca.vertcat(1 + sign * n[0] ** 2 * a, sign * b, -sign * n[0])
    return b1, ca.vertcat(b, sign + n[1] ** 2 * a, -n[1])


# Numbers


def _function(of: object, rows: int, columns: int = 1) -> ca.Function:
    symbol = ca.SX.sym("x", rows, columns)
    result = of(symbol)  # type: ignore[operator]
    return ca.Function("f", [symbol], list(result) if isinstance(result, tuple) else [result])


_TURNED = _function(turned, 3)
_MATRIX = _function(matrix_of, 4)
_QUATERNION = _function(quaternion_of, 3, 3)
_VECTOR = _function(vector_of, 3, 3)
_ACROSS = _function(across, 3)


def rotation(vector: Matrix) -> Matrix:
    """(3, 3) of a rotation vector (3,)."""
    return np.asarray(_TURNED(vector).full())


def rotation_vector(turn: Matrix) -> Matrix:
    """(3,) of a rotation matrix (3, 3)."""
    return np.asarray(_VECTOR(turn).full()[:, 0])


def rotation_of_quaternion(q: Sequence[float] | Matrix) -> Matrix:
    """(3, 3) of a unit quaternion (4,)."""
    return np.asarray(_MATRIX(np.asarray(q, dtype=float)).full())


def quaternion(turn: Matrix) -> Matrix:
    """(4,) of a rotation matrix (3, 3), w ≥ 0."""
    return np.asarray(_QUATERNION(turn).full()[:, 0])


def basis_across(n: Matrix) -> tuple[Matrix, Matrix]:
    """`across`, of numbers: (3,) each."""
    b1, b2 = _ACROSS(n)
    return np.asarray(b1.full()[:, 0]), np.asarray(b2.full()[:, 0])


def nearest_rotation(matrix: Matrix) -> Matrix:
    """(3, 3) the rotation nearest to any matrix, by its singular vectors."""
    u, _, v = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v)


def aligned(points: Matrix, others: Matrix) -> tuple[Matrix, Matrix]:
    """R (3, 3) and t (3,) that bring `others` (N, 3) nearest to `points` (N, 3): R o + t = p (Kabsch)."""
    mean, other_mean = points.mean(axis=0), others.mean(axis=0)
    turn = nearest_rotation((points - mean).T @ (others - other_mean))
    return turn, mean - turn @ other_mean
