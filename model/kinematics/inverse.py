"""Joints of a pose: inverse kinematics by damped least squares, for any serial arm.

From many starts at once each climbs to the pose by itself (damping by the squared error, T. Sugihara,
"Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method", IEEE T-RO 27, 2011). The
starts are those of a fixed random sample whose poses are nearest to the one wanted.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import scipy

from ..arrays import Matrix
from .pendant import beyond_limits
from .robot import Robot

_LENGTH = 1000.0  # mm that count as one radian
_EXACT = 1e-9  # rad, and mm over _LENGTH
_STEPS = 30
_SAMPLE, _FEW, _MANY = 4000, 32, 400
_SINGULAR = 5e-3
_SAME = 1e-4  # rad (mm): two solutions that differ by less are one
_AT_LIMIT = 1e-9


def reach(robot: Robot, pose: Matrix, starts: Matrix) -> tuple[Matrix, Matrix]:
    """From joints (N, n), rad or mm, to a pose (4, 4) of the flange, or to one (N, 4, 4) each: the joints
    arrived at, and (N,) whether they are those of the pose. Limits do not count."""
    poses = np.broadcast_to(pose, (len(starts), 4, 4))
    joints = np.array(starts, dtype=float)
    arrived = np.zeros(len(joints), dtype=bool)
    for _ in range(_STEPS):
        going = ~arrived
        error, jacobian = _errors(robot, poses[going], joints[going])
        arrived[going] = np.abs(error).max(axis=1) < _EXACT
        damping = 0.5 * (error**2).sum(axis=1) + 1e-14
        normal = np.einsum("nij,nik->njk", jacobian, jacobian) + damping[:, None, None] * np.eye(robot.n)
        step = np.linalg.solve(normal, np.einsum("nij,ni->nj", jacobian, error)[:, :, None])[:, :, 0]
        joints[going] += np.where(arrived[going][:, None], 0.0, step)
        if arrived.all():
            break
    return joints, arrived


def is_singular(robot: Robot, joints: Matrix) -> bool:
    """Whether an arm of six joints (n,), rad or mm, is at a singularity, or within about a degree of one."""
    jacobian = robot.pose_and_jacobian(joints)[1]
    jacobian[:3] /= _LENGTH
    return bool(np.linalg.svd(jacobian, compute_uv=False)[-1] < _SINGULAR)


def _errors(robot: Robot, poses: Matrix, joints: Matrix) -> tuple[Matrix, Matrix]:
    """(N, 6) shift and rotation left to poses (N, 4, 4), and (N, 6, n) what the joints do to them."""
    now, jacobian = robot.pose_and_jacobian(joints)
    turned = poses[:, :3, :3] @ now[:, :3, :3].transpose(0, 2, 1)
    turn = scipy.spatial.transform.Rotation.from_matrix(turned).as_rotvec()
    shift = (poses[:, :3, 3] - now[:, :3, 3]) / _LENGTH
    scaled = jacobian.copy()
    scaled[:, :3] /= _LENGTH
    return np.hstack([shift, turn]), scaled


@lru_cache(maxsize=8)
def _sample(robot: Robot) -> tuple[Matrix, Matrix]:
    """Joints within the limits, and the poses there."""
    full = np.array([np.pi if joint.kind == "revolute" else np.inf for joint in robot.joints])
    lower, upper = np.maximum(robot.lower, -full), np.minimum(robot.upper, full)
    joints = np.random.default_rng(0).uniform(lower, upper, (_SAMPLE, robot.n))
    return joints, robot.pose_and_jacobian(joints)[0]


@dataclass(frozen=True)
class Solver:
    """All the joints by which a robot reaches a pose, within its limits."""

    robot: Robot

    def solutions(self, pose: Matrix, *, thorough: bool = False) -> Matrix:
        """(M, n) rad or mm, one of each that differ by whole turns only (`with_turns` has all of these).

        Nearly surely all where they are isolated; near a singularity, or with more than six joints, some of
        the many. `thorough` starts from more places.
        """
        sample, poses = _sample(self.robot)
        shift = np.linalg.norm(poses[:, :3, 3] - pose[:3, 3], axis=1) / _LENGTH
        turn = np.linalg.norm(poses[:, :3, :3] - pose[:3, :3], axis=(1, 2))
        near = np.argsort(shift + turn)[: _MANY if thorough else _FEW]
        joints, arrived = reach(self.robot, pose, sample[near])
        solutions: list[Matrix] = []
        for row in joints[arrived]:
            whole = self.with_turns(row)
            if len(whole) and not any(self.same(row, other) for other in solutions):
                solutions.append(whole[0])
        return np.array(solutions).reshape(-1, self.robot.n)

    def same(self, one: Matrix, other: Matrix) -> bool:
        """Whether two sets of joints (n,) are the same but for whole turns."""
        apart = np.where(
            self._turn < np.inf, np.remainder(one - other + np.pi, 2 * np.pi) - np.pi, one - other
        )
        return bool(np.abs(apart).max() < _SAME)

    @cached_property
    def _turn(self) -> Matrix:
        return np.array([2 * np.pi if joint.kind == "revolute" else np.inf for joint in self.robot.joints])

    def with_turns(self, row: Matrix) -> Matrix:
        """(M, n): the joints (n,) with whole turns more or less, as far as the limits allow."""
        robot, choices = self.robot, []
        for joint, value, turn in zip(robot.joints, row.tolist(), self._turn.tolist(), strict=True):
            lower, upper = joint.lower - _AT_LIMIT, joint.upper + _AT_LIMIT
            first = np.ceil((lower - value) / turn) if np.isfinite(turn) else 0.0
            values = [value + k * turn if k else value for k in first + np.arange(4)]
            choices.append([each for each in values if lower <= each <= upper])
        rows = np.array(list(itertools.product(*choices))).reshape(-1, robot.n)
        return rows[~beyond_limits(robot, rows, _AT_LIMIT).any(axis=1)]

    def nearest_turns(self, row: Matrix, near: Matrix) -> Matrix:
        """(n,): of the same joints but for whole turns those nearest to `near`, whatever the limits."""
        turns = np.where(self._turn < np.inf, np.round((near - row) / np.minimum(self._turn, 1e9)), 0.0)
        return np.asarray(row + turns * np.where(self._turn < np.inf, self._turn, 0.0))


_FIRST, _AGAIN = 2000, 150
_SHARES = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001, 0.0003)  # of each joint's range


def longest_reach(robot: Robot) -> float:
    """mm: the farthest that the flange gets from the axis of joint 1 (from the base where that is prismatic)
    within the limits, found by a search with a fixed seed to about 0.2 mm.

    Data sheets mostly state the reach of the wrist's centre, which is less.
    """
    rng = np.random.default_rng(0)
    lower, upper = robot.lower, robot.upper
    joints = rng.uniform(lower, upper, (_FIRST, robot.n))
    best = joints[np.argmax(_far(robot, joints))]
    for step in _SHARES:
        near = rng.normal(best, step * (upper - lower), (_AGAIN, robot.n))
        near = np.vstack([best, np.clip(near, lower, upper)])
        best = near[np.argmax(_far(robot, near))]
    return float(_far(robot, best[None])[0])


def _far(robot: Robot, joints: Matrix) -> Matrix:
    return np.where(beyond_limits(robot, joints).any(axis=1), 0.0, _distance(robot, joints))


def _distance(robot: Robot, joints: Matrix) -> Matrix:
    first = robot.joints[0]
    between = robot.pose_and_jacobian(joints)[0][:, :3, 3] - first.fixed[:3, 3]
    if first.kind == "prismatic":
        return np.asarray(np.linalg.norm(between, axis=1))
    axis = first.fixed[:3, :3] @ first.axis
    return np.asarray(np.linalg.norm(np.cross(between, axis), axis=1))


# The posture nearest to another one, within the limits: a joint that would leave its range stays at its end
# while the step leads outwards (an active set, which is exact for a box).
_MOST_STEPS = 40
_POSITION_MM, _ANGLE_RAD = 1e-6, 1e-9  # reached
_LEVER_MM = 300.0  # what a radian of orientation counts for beside positions
_DAMPING = 1e-6  # of the largest eigenvalue, at first


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
    for _ in range(_MOST_STEPS):
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
    near = float(np.linalg.norm(residual[3:])) < _ANGLE_RAD * _LEVER_MM
    return near and float(np.linalg.norm(residual[:3])) < _POSITION_MM


def _off_goal(robot: Robot, q: Matrix, position: Matrix, rotation: Matrix | None) -> tuple[Matrix, Matrix]:
    """(3,) or (6,) mm from the goal, and its Jacobian by the joints."""
    goal = np.eye(4)
    goal[:3, :3] = np.eye(3) if rotation is None else rotation
    goal[:3, 3] = position
    error, jacobian = _errors(robot, goal[None], q[None])
    rows = slice(0, 3 if rotation is None else 6)
    scale = np.repeat([_LENGTH, _LEVER_MM], 3)[rows]
    return -error[0, rows] * scale, jacobian[0, rows] * scale[:, None]
