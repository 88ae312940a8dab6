"""Joints of a pose: inverse kinematics by damped least squares, for any serial arm; and the eight postures of
one with a spherical wrist.

From many starts at once each climbs to the pose by itself (damping by the squared error, T. Sugihara,
"Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method", IEEE T-RO 27, 2011). The
starts are those of a fixed random sample whose poses are nearest to the one wanted.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import casadi as ca
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


# The eight postures by which a six-axis arm with a spherical wrist reaches a pose, as vendors name them.
#
# Three signs tell the postures apart, each changing at a singularity: whether the wrist's centre is in
# front of axis 1 or behind it, in front of the lower arm (the line from axis 2 through axis 3) or behind
# it, and the sign of joint 5.
#
# - ABB, confdata [cf1, cf4, cf6, cfx]: quadrants (n from 90 n to 90 (n + 1) degrees) of joints 1, 4 and 6;
#   cfx is 4 if behind axis 1, plus 2 if behind the lower arm, plus 1 if joint 5 is negative.
# - KUKA, S: 1 if behind axis 1 (overhead), plus 2 if in front of the lower arm (A3 from about 0 degrees),
#   plus 4 if A5 is negative; higher bits say other things. T: bit i - 1 if axis i is negative.
# - FANUC, CONFIG: F (flip) if J5 is positive, else N; U (up) in front of the lower arm, else D; T (toward)
#   in front of axis 1, else B; then the turns of joints 1, 4 and 6: 0 from -180 to 180 degrees.

_SLACK = 1e-3  # deg by which a joint may be beyond a quadrant, sign or turn that is stated for it
_SPHERICAL = 1e-3  # mm by which axes 4 to 6 may miss one point
_PARALLEL = 1e-6


class Branch(NamedTuple):
    """One of the eight postures."""

    behind: bool
    behind_arm: bool
    negative: bool


@dataclass(frozen=True)
class Branches:
    """The postures of an arm. Joints are degrees (n,).

    `up` is 1 where joint 1 turns counterclockwise as seen from above, as those of ABB and FANUC do, -1 where
    clockwise, as KUKA's, however the arm is mounted. The front is where the wrist's centre is at zero; with
    `by_joint2`, of an arm that stretches along axis 1 there, where joint 2 leads when it increases.
    """

    robot: Robot
    up: int
    by_joint2: bool = False

    @cached_property
    def exist(self) -> bool:
        """Whether it has six rotary joints, axes 2 and 3 parallel and across axis 1, a spherical wrist."""
        robot = self.robot
        if robot.n != 6 or any(joint.kind != "revolute" for joint in robot.joints):
            return False
        axes, points = self._lines(np.full(6, 20.0))
        if np.linalg.norm(np.cross(axes[1], axes[2])) > _PARALLEL or abs(axes[0] @ axes[1]) > _PARALLEL:
            return False
        centre = _meeting(points[3], axes[3], points[4], axes[4])
        apart = [_circular_distance(centre, points[i], axes[i]) for i in (3, 4, 5)]
        zero = self._signs(np.zeros(6))
        return max(apart) < _SPHERICAL and zero is not None

    def of(self, joints: Matrix) -> Branch:
        signs = self._signs(joints)
        assert signs is not None
        front, arm = signs
        return Branch(front < 0, arm < 0, bool(joints[4] < 0))

    def ahead(self, joints: Matrix) -> float:
        """How far, mm, the wrist's centre is from axis 1 in the direction in which joint 2 tilts a vertical
        arm."""
        axes, points = self._lines(joints)
        centre = _meeting(points[3], axes[3], points[4], axes[4])
        return float((centre - points[0]) @ np.cross(axes[1], axes[0]))

    def _signs(self, joints: Matrix) -> tuple[float, float] | None:
        """How far, mm, the wrist's centre is in front of axis 1, and (scaled) of the lower arm."""
        start_axes, start = self._at_zero
        axes, points = self._lines(joints)
        up = start_axes[0] * self.up
        front = np.cross(start_axes[1], up)
        centre = _meeting(start[3], start_axes[3], start[4], start_axes[4])
        ahead = float((centre - start[0]) @ front)
        if self.by_joint2 and abs(ahead) < 1.0:
            ahead = float((centre - start[1]) @ up)
        if not np.isfinite(ahead) or abs(ahead) < 1.0:
            return None
        # Axis 2 is carried by joint 1, and so is the front.
        sense = np.sign(ahead)
        across = sense * axes[1]  # up × front
        front = np.cross(across, up)
        across = np.cross(up, front)
        centre = _meeting(points[3], axes[3], points[4], axes[4])
        lower = points[2] - points[1]
        return float((centre - points[0]) @ front), float(across @ np.cross(lower, centre - points[2]))

    @cached_property
    def _at_zero(self) -> tuple[Matrix, Matrix]:
        return self._lines(np.zeros(6))

    def _lines(self, joints: Matrix) -> tuple[Matrix, Matrix]:
        """(n, 3) unit axes and (n, 3) points on them, mm, base frame."""
        axes, points = self._function(np.radians(joints))
        return axes.full().T, points.full().T[1:-1]

    @cached_property
    def _function(self) -> ca.Function:
        theta = ca.SX.sym("theta", self.robot.n)
        outputs = [ca.densify(self.robot.axes(theta)), ca.densify(self.robot.skeleton(theta))]
        return ca.Function("lines", [theta], outputs, ["theta"], ["axes", "points"])


def abb_configuration(branch: Branch, joints: Matrix) -> tuple[int, int, int, int]:
    """[cf1, cf4, cf6, cfx] of joints (6,), degrees."""
    cf1, cf4, cf6 = (int(np.floor(round(float(joints[i]), 6) / 90)) for i in (0, 3, 5))
    return cf1, cf4, cf6, 4 * branch.behind + 2 * branch.behind_arm + branch.negative


def is_abb_configuration(confdata: tuple[float, ...], branch: Branch, joints: Matrix) -> bool:
    """Whether joints (6,), degrees, have the stated confdata."""
    return confdata[3] == abb_configuration(branch, joints)[3] and all(
        90 * quadrant - _SLACK <= joints[i] <= 90 * (quadrant + 1) + _SLACK
        for quadrant, i in zip(confdata[:3], (0, 3, 5), strict=True)
    )


def kuka_status(branch: Branch) -> int:
    """Bits 0 to 2 of S."""
    return branch.behind + 2 * (not branch.behind_arm) + 4 * branch.negative


def kuka_turn(joints: Matrix) -> int:
    """T of joints (6,), degrees."""
    return sum(1 << i for i, value in enumerate(joints.tolist()) if round(value, 6) < 0)


def is_kuka_turn(turns: int, joints: Matrix) -> bool:
    """Whether joints (6,), degrees, have the stated T."""
    return all(
        value < _SLACK if turns >> i & 1 else value > -_SLACK for i, value in enumerate(joints.tolist())
    )


def fanuc_configuration(branch: Branch, joints: Matrix) -> tuple[str, tuple[int, int, int]]:
    """The letters, and the turns of joints 1, 4 and 6; joints (6,) are degrees."""
    letters = (
        "N" if branch.negative else "F",
        "D" if branch.behind_arm else "U",
        "B" if branch.behind else "T",
    )
    one, four, six = (int(np.floor((round(float(joints[i]), 6) + 180) / 360)) for i in (0, 3, 5))
    return " ".join(letters), (one, four, six)


def is_fanuc_configuration(letters: str, turns: tuple[int, ...], branch: Branch, joints: Matrix) -> bool:
    """Whether joints (6,), degrees, have the stated CONFIG."""
    return letters == fanuc_configuration(branch, joints)[0] and all(
        360 * turn - 180 - _SLACK <= joints[i] <= 360 * turn + 180 + _SLACK
        for turn, i in zip(turns, (0, 3, 5), strict=True)
    )


def _meeting(one: Matrix, along: Matrix, other: Matrix, across: Matrix) -> Matrix:
    """The point of the first line that is nearest to the second one."""
    cross = np.cross(along, across)
    if cross @ cross < _PARALLEL:
        return np.full(3, np.nan)
    return np.asarray(one + along * (np.cross(other - one, across) @ cross) / (cross @ cross))


def _circular_distance(point: Matrix, on: Matrix, along: Matrix) -> float:
    return float(np.linalg.norm(np.cross(point - on, along)))
