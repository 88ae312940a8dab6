"""Where a point of the flange is, by the arm's parameters: what accuracy and values to enter come from."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..model.arrays import Matrix
from ..model.kinematics.pendant import beyond_limits
from ..model.kinematics.robot import Robot
from ..model.likelihood.problem import Problem
from .draws import drawn_by_covariance
from .status import Status

TcpSource = Literal["stated point", "tool", "last axis"]
NO_EFFECT = 1e-3  # mm: an offset that moves the TCP by less in one prior std does not enter
_ON_AXIS = 1e-6  # mm
_POSTURES, _ARMS = 256, 200
FITTED = 128  # of them, by which values are fitted: the first are spread as evenly as all
_FRONT = float(np.radians(90.0))
_BESIDE = 100.0  # mm: the points beside the TCP
_SAME = 1e-10  # of the largest: a direction of offsets that moves no point stays as estimated


def tool_point(problem: Problem, x: Matrix, point: Matrix, joints: Matrix) -> tuple[Matrix, Matrix]:
    """(P, 3) mm where the `point` (3,) of the flange is at recorded `joints` (P, n) with the offsets and the
    geometry of x (p,), in the base frame as joint 1's encoder defines it; and (P, 3, a) by these, 0 by the
    first offset."""
    arm = problem.parameters.arm
    x = x.copy()
    x[arm.start] = 0.0
    position, jacobian = problem.functions.kernel("placed")(joints, x[arm], point)
    # Postures next to each other in memory: what follows is done for all of them, number by number.
    by_arm = np.ascontiguousarray(jacobian[:, :, arm].transpose(1, 2, 0))
    by_arm[:, 0] = 0.0
    return np.asfortranarray(position), by_arm.transpose(2, 0, 1)


def arm_covariance(problem: Problem, covariance: Matrix) -> Matrix:
    """(a, a) of offsets and geometry, rad or mm, from that of the scaled free parameters (f, f); 0 of what is
    held."""
    parameters = problem.parameters
    estimated = np.flatnonzero(parameters.free & (np.arange(len(parameters)) < parameters.arm.stop))
    at, std = parameters.among_free[estimated], parameters.prior_std[estimated]
    result = np.zeros((parameters.arm.stop, parameters.arm.stop))
    result[np.ix_(estimated, estimated)] = covariance[np.ix_(at, at)] * np.outer(std, std)
    return result


def arms_at_random(covariance: Matrix, dof: float | None = None) -> Matrix:
    """(D, a) rad or mm, deviations of arms from the mean arm, by the covariance (a, a) of offsets and
    geometry; of Student's distribution where the noise is estimated with `dof`."""
    rng = np.random.default_rng(2014)
    drawn = drawn_by_covariance(covariance, _ARMS, rng)
    return drawn if dof is None else drawn * np.sqrt(dof / rng.chisquare(dof, size=(_ARMS, 1)))


def moving_offsets(problem: Problem, jacobian: Matrix) -> NDArray[np.bool_]:
    """(n,) whether each offset moves the point somewhere, of (P, 3, a) of `tool_point`."""
    offsets = problem.parameters.block("offset")
    effect = np.sqrt((jacobian[:, :, offsets] ** 2).sum(axis=1).max(axis=0))
    return np.asarray(effect * problem.parameters.prior_std[offsets] > NO_EFFECT)


def moving_by_nominal(problem: Problem, point: Matrix, joints: Matrix) -> NDArray[np.bool_]:
    """(n,) the same of the `point` (3,) of the flange at `joints` (P, n) of the nominal arm: a point of its
    last axis is a fraction of a millimetre off that of an arm that deviates, which does not matter."""
    return moving_offsets(problem, tool_point(problem, problem.parameters.prior_mean, point, joints)[1])


def undetermined_offsets(problem: Problem, status: Sequence[Status]) -> NDArray[np.bool_]:
    """(n,) the offsets that the data alone do not determine; that of joint 1 is a choice of frame and not
    one."""
    undetermined = np.isin(status[problem.parameters.block("offset")], ["unidentifiable", "held", "assumed"])
    undetermined[0] = False
    return undetermined


def within_limits(robot: Robot, joints: Matrix) -> Matrix:
    """Those of joints (N, n) that the arm can take: where joint 3 is counted from the ground its range
    depends on joint 2."""
    return joints if robot.conventions.range3 is None else joints[~beyond_limits(robot, joints).any(axis=1)]


def front_postures(problem: Problem) -> Matrix:
    """(P, n) postures within the limits, joint 1 within 90 degrees of the middle of its range."""
    robot = problem.robot
    lower, upper = robot.lower.copy(), robot.upper.copy()
    if robot.joints[0].kind == "revolute":
        middle = (lower[0] + upper[0]) / 2
        lower[0], upper[0] = max(lower[0], middle - _FRONT), min(upper[0], middle + _FRONT)
    return within_limits(robot, spread_postures(lower, upper, _POSTURES))


def fitted_points(tcp: Matrix, joints: Matrix) -> tuple[Matrix, Matrix]:
    """(6 P, 3) mm points of the flange by which values to enter are fitted at joints (P, n): its origin, the
    `tcp` (3,) and four beside it; and (6 P, n) the joints of each."""
    beside = [tcp + _BESIDE * np.array(axis) for axis in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))]
    points = np.repeat([np.zeros(3), tcp, *beside], len(joints), axis=0)
    return points, np.tile(joints, (2 + len(beside), 1))


def normal_inverse(columns: Matrix) -> Matrix:
    """(k, k) of columns (M, k): the inverse of C'C, 0 along what moves no point."""
    return np.asarray(np.linalg.pinv(columns.T @ columns, rcond=_SAME, hermitian=True), dtype=float)


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


def default_point(problem: Problem, open_last: bool) -> tuple[Matrix, TcpSource]:
    """The tool's stated point, or the nearest of the last axis if its offset is not determined."""
    point = problem.tool.point
    last = problem.robot.joints[-1]
    if not open_last or last.kind != "revolute":
        return point, "tool"
    to_flange = problem.robot.flange[:3, :3].T
    axis, origin = to_flange @ last.axis, -to_flange @ problem.robot.flange[:3, 3]
    foot = origin + axis * (axis @ (point - origin))
    if np.linalg.norm(foot - point) <= _ON_AXIS:
        return point, "tool"
    return foot, "last axis"
