"""The posture nearest to a given one in which the flange is at a given pose, within the joint limits.

Damped Gauss-Newton steps on the joints that are free; a joint that would leave its range stays at its end
while the step leads outwards (an active set, which is exact for a box).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..model.arrays import Matrix
from ..model.instruments.rotations import rotation_vector
from ..model.kinematics.robot import Robot

_STEPS = 40
_POSITION_MM, _ANGLE_RAD = 1e-6, 1e-9  # reached
_LEVER_MM = 300.0  # what a radian of orientation counts for beside positions
_DAMPING = 1e-6  # of the largest eigenvalue, at first
_AT_LIMIT = 1e-9  # rad, mm


@dataclass(frozen=True, eq=False)
class ReachedPosture:
    """`joints` (n,) rad or mm; `off_mm` and `off_rad` are how far the flange is from what was asked for,
    `at_limit` the joints (from 1) that are at an end of their range."""

    joints: Matrix
    off_mm: float
    off_rad: float
    at_limit: tuple[int, ...]


def nearest_posture(
    robot: Robot, joints: Matrix, position: Matrix, rotation: Matrix | None = None
) -> ReachedPosture:
    """From `joints` (n,) rad or mm to where the flange is at `position` (3,) mm, with `rotation` (3, 3) if
    one is asked for."""
    lower, upper = robot.lower, robot.upper
    q = np.clip(joints, lower, upper)
    residual, jacobian = _off_goal(robot, q, position, rotation)
    damping = _DAMPING
    for _ in range(_STEPS):
        if _reached(residual):
            break
        free = np.ones(len(q), dtype=bool)
        gradient = jacobian.T @ residual
        free[(q <= lower + _AT_LIMIT) & (gradient > 0)] = False
        free[(q >= upper - _AT_LIMIT) & (gradient < 0)] = False
        if not free.any():
            break
        columns = jacobian[:, free]
        normal = columns.T @ columns
        damped = normal + damping * max(float(np.trace(normal)), 1e-12) * np.eye(int(free.sum()))
        step = np.zeros(len(q))
        step[free] = -np.linalg.solve(damped, gradient[free])
        tried = np.clip(q + step, lower, upper)
        new, new_jacobian = _off_goal(robot, tried, position, rotation)
        if float(new @ new) < float(residual @ residual):
            q, residual, jacobian = tried, new, new_jacobian
            damping = max(damping / 10, 1e-12)
        elif damping > 1e3:
            break
        else:
            damping *= 10
    off_rad = 0.0 if rotation is None else float(np.linalg.norm(residual[3:])) / _LEVER_MM
    ends = (q <= lower + _AT_LIMIT) | (q >= upper - _AT_LIMIT)
    at_limit = tuple(int(i) + 1 for i in np.flatnonzero(ends))
    return ReachedPosture(q, float(np.linalg.norm(residual[:3])), off_rad, at_limit)


def _reached(residual: Matrix) -> bool:
    angle = residual[3:]
    near = not len(angle) or float(np.linalg.norm(angle)) < _ANGLE_RAD * _LEVER_MM
    return near and float(np.linalg.norm(residual[:3])) < _POSITION_MM


def _off_goal(robot: Robot, q: Matrix, position: Matrix, rotation: Matrix | None) -> tuple[Matrix, Matrix]:
    """(3,) or (6,) mm from the goal, and its Jacobian by the joints."""
    pose, by_joints = robot.pose_and_jacobian(q)
    residual, jacobian = pose[:3, 3] - position, by_joints[:3]
    if rotation is None:
        return residual, jacobian
    turn = _LEVER_MM * rotation_vector(pose[:3, :3] @ rotation.T)
    return np.concatenate([residual, turn]), np.vstack([jacobian, _LEVER_MM * by_joints[3:]])
