"""How far the flange of an arm gets from the axis of joint 1."""

from __future__ import annotations

import numpy as np

from ..arrays import Matrix
from .pendant import beyond_limits
from .robot import Robot

_FIRST, _AGAIN = 2000, 150
_STEPS = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001, 0.0003)  # of each joint's range


def reach(robot: Robot) -> float:
    """mm: the farthest that the flange gets from the axis of joint 1 (from the base where that is prismatic)
    within the limits, found by a search with a fixed seed to about 0.2 mm.

    Data sheets mostly state the reach of the wrist's centre, which is less.
    """
    rng = np.random.default_rng(0)
    lower, upper = robot.lower, robot.upper
    joints = rng.uniform(lower, upper, (_FIRST, robot.n))
    best = joints[np.argmax(_far(robot, joints))]
    for step in _STEPS:
        near = rng.normal(best, step * (upper - lower), (_AGAIN, robot.n))
        near = np.vstack([best, np.clip(near, lower, upper)])
        best = near[np.argmax(_far(robot, near))]
    return float(_far(robot, best[None])[0])


def _far(robot: Robot, joints: Matrix) -> Matrix:
    return np.where(beyond_limits(robot, joints).any(axis=1), 0.0, _distance(robot, joints))


def _distance(robot: Robot, joints: Matrix) -> Matrix:
    first = robot.joints[0]
    between = robot.fk(joints, "rad")[:, :3, 3] - first.fixed[:3, 3]
    if first.kind == "prismatic":
        return np.asarray(np.linalg.norm(between, axis=1))
    axis = first.fixed[:3, :3] @ first.axis
    return np.asarray(np.linalg.norm(np.cross(between, axis), axis=1))
