"""Postures spread evenly over ranges of the joints."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ..arrays import Matrix
from .pendant import beyond_limits
from .robot import Robot


def within_limits(robot: Robot, joints: Matrix) -> Matrix:
    """Those of joints (N, n) that the arm can take: where joint 3 is counted from the ground its range
    depends on joint 2."""
    return joints if robot.conventions.range3 is None else joints[~beyond_limits(robot, joints).any(axis=1)]


def spread_postures(lower: Matrix, upper: Matrix, count: int) -> Matrix:
    """(count, n) evenly between `lower` and `upper` (n,): Kronecker's sequence with the powers of the root of
    x^(n + 1) = x + 1 (Roberts 2018), which has no seed."""
    return np.asarray(lower + _shares(len(lower), count) * (upper - lower))


@lru_cache(maxsize=16)
def _shares(n: int, count: int) -> Matrix:
    """(count, n) from 0 to 1 of `spread_postures`."""
    root = 2.0
    for _ in range(60):
        root = (1 + root) ** (1 / (n + 1))
    steps = root ** -np.arange(1.0, n + 1)
    return np.asarray((0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0)
