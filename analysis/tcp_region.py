"""The region over which the error of the TCP is judged, and its postures: the one owner of both.

Values to enter, the error before and after, conformity, maps and sensitivity are all of these postures. They
are those of the header (`workspace`): spread evenly over the central part of the joints' ranges, over the
whole ranges, over what of these has the nominal TCP in a box; or the user's own. Where a point of the flange
is there, by the arm's parameters, is what accuracy and values to enter come from.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from ..model.arrays import Matrix
from ..model.errors import BadInput
from ..model.files.stated_workspace import CENTRAL_RANGES, StatedWorkspace
from ..model.kinematics.pendant import spread_postures, within_limits
from ..model.kinematics.robot import Robot
from ..model.likelihood.problem import Problem
from ..model.records import it, record, worded
from .covariance import drawn_by_covariance
from .status import Status

CENTRAL = 0.7  # of each joint's range
_FRONT = float(np.radians(90.0))
_TRIED = 2**16  # postures, to find those whose TCP is in a box
_ENOUGH = 32  # of them in the box: fewer stand for no region

Corner = tuple[float, float, float]


@record
class TcpRegion:
    """Over which postures the error of the TCP is stated, and of which point; `name` says both in every
    sentence."""

    joints: Annotated[
        Literal["central", "full"] | None,
        it("the part of the joints' ranges; null where the region is a file's postures"),
    ]
    box_mm: Annotated[
        tuple[Corner, Corner] | None, it("the lowest and the highest corner of the box of the TCP, or null")
    ] = None
    positions: Annotated[str | None, it("the name of the file of postures, or null")] = None
    postures: Annotated[int | None, it("how many postures that file has, or null")] = None
    on_axis: Annotated[
        int | None,
        it(
            "the last joint, where its offset is not determined and moves the TCP: errors are of the point"
            " of its axis nearest to the TCP; else null"
        ),
    ] = None
    name: Annotated[str | None, worded("the region in words")] = None


def region_of(workspace: StatedWorkspace, on_axis: int | None = None) -> TcpRegion:
    """The region that a header states; `on_axis` as by `judged_axis`."""
    if workspace.positions is None:
        return TcpRegion(workspace.joints, workspace.box_mm, on_axis=on_axis)
    name = workspace.positions.replace("\\", "/").rpartition("/")[2]
    return TcpRegion(None, None, name, len(workspace.postures_deg or ()), on_axis)


def region_postures(problem: Problem, count: int) -> Matrix:
    """(P, n) rad or mm: `count` postures of the region, or those of its file, all of them. The first of many
    are as evenly spread as all.

    BadInput where the arm has hardly any posture whose TCP is in the box.
    """
    workspace, robot = problem.workspace, problem.robot
    if workspace.postures_deg is not None:
        return np.array(workspace.postures_deg, dtype=float) / robot.display
    lower, upper = _ranges(robot, workspace.joints)
    if workspace.box_mm is None:
        return within_limits(robot, spread_postures(lower, upper, count))
    return _in_box(robot, workspace, tuple(problem.tool.point.tolist()))[:count]


@lru_cache(maxsize=8)
def _in_box(robot: Robot, workspace: StatedWorkspace, point: Corner) -> Matrix:
    """(P, n) postures of the ranges with the `point` of the nominal arm's flange, the TCP, in the box."""
    assert workspace.box_mm is not None
    joints = within_limits(robot, spread_postures(*_ranges(robot, workspace.joints), _TRIED))
    pose, _ = robot.pose_and_jacobian(joints)
    tcp = pose[:, :3, :3] @ np.array(point) + pose[:, :3, 3]
    low, high = np.array(workspace.box_mm)
    inside = ((tcp >= low) & (tcp <= high)).all(axis=1)
    if inside.sum() < _ENOUGH:
        raise BadInput(
            "the arm has hardly any posture whose TCP is in workspace.box_mm",
            found=f"{inside.sum()} of {len(joints)} postures in the {workspace.joints} ranges of the joints",
            allowed="a box that the TCP reaches: " + ", ".join(map(_extent, "xyz", tcp.T)),
            remedy="enlarge the box, state joints: full, or state the postures themselves (positions: FILE)",
        )
    return np.asarray(joints[inside])


def _extent(axis: str, values: Matrix) -> str:
    return f"{axis} {values.min():.0f} to {values.max():.0f} mm"


def _ranges(robot: Robot, joints: Literal["central", "full"]) -> tuple[Matrix, Matrix]:
    """(n,) lower and upper ends of that part of the joints' ranges, rad or mm."""
    lower, upper = robot.lower, robot.upper
    if joints == "full":
        return lower, upper
    middle, half = (lower + upper) / 2, CENTRAL * (upper - lower) / 2
    if robot.joints[0].kind == "revolute":
        half[0] = min(half[0], _FRONT)
    return middle - half, middle + half


TcpSource = Literal["stated point", "tool", "last axis"]
NO_EFFECT = 1e-3  # mm: an offset that moves the TCP by less in one prior std does not enter
_ON_AXIS = 1e-6  # mm
_ARMS = 200
FITTED = 128  # postures by which values are fitted; of a file all
_BACKGROUND = 0.1  # weight of the central ranges beside a region that is no range itself
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


def beside_first_axis(robot: Robot, points: Matrix) -> Matrix:
    """(P, 2) mm of points (P, 3): the distance from axis 1 (of a prismatic joint: from the base's z axis),
    and the height along it."""
    first = robot.joints[0]
    axis, origin = np.array([0.0, 0.0, 1.0]), np.zeros(3)
    if first.kind == "revolute":
        axis, origin = first.fixed[:3, :3] @ first.axis, first.fixed[:3, 3]
    return np.stack([np.linalg.norm(np.cross(points - origin, axis), axis=1), points @ axis]).T


def arm_covariance(problem: Problem, covariance: Matrix) -> Matrix:
    """(a, a) of offsets and geometry, rad or mm, from that of the scaled free parameters (f, f); of the last
    link, where a free tool takes it up, its tolerances; 0 of what else is held."""
    parameters = problem.parameters
    estimated = np.flatnonzero(parameters.free & (np.arange(len(parameters)) < parameters.arm.stop))
    at, std = parameters.among_free[estimated], parameters.prior_std[estimated]
    result = np.diag(unmeasured_link(problem) ** 2)
    result[np.ix_(estimated, estimated)] = covariance[np.ix_(at, at)] * np.outer(std, std)
    return result


def unmeasured_link(problem: Problem) -> Matrix:
    """(a,) the tolerances, rad or mm, of what of the last link no measurement can tell from a free tool; 0 of
    all else. It moves the TCP as every link does, and the controller has it as nominal."""
    parameters = problem.parameters
    taken_up = [item.held_by == "free tool" for item in parameters.items[parameters.arm]]
    return np.where(taken_up, parameters.prior_std[parameters.arm], 0.0)


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


def fitted_points(problem: Problem, tcp: Matrix, count: int = FITTED) -> tuple[Matrix, Matrix, Matrix]:
    """(M, 3) mm points of the flange by which values to enter are fitted, its origin, the `tcp` (3,) and four
    beside it at each of `count` postures of the region; (M, n) the joints there; (M,) roots of the weights.

    A box, and postures of a file, do not determine every value: the central ranges take part.
    """
    joints = region_postures(problem, count)
    weights = np.ones(len(joints))
    if not problem.workspace.is_range:
        around = region_postures(replace(problem, workspace=CENTRAL_RANGES), count // 2)
        weights = np.append(weights, np.full(len(around), _BACKGROUND * len(joints) / len(around)))
        joints = np.concatenate([joints, around])
    beside = [tcp + _BESIDE * np.array(axis) for axis in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))]
    points = np.repeat([np.zeros(3), tcp, *beside], len(joints), axis=0)
    each = 2 + len(beside)
    return points, np.tile(joints, (each, 1)), np.tile(np.sqrt(weights), each)


def normal_inverse(columns: Matrix) -> Matrix:
    """(k, k) of columns (M, k): the inverse of C'C, 0 along what moves no point."""
    return np.asarray(np.linalg.pinv(columns.T @ columns, rcond=_SAME, hermitian=True), dtype=float)


def default_point(problem: Problem, status: Sequence[Status]) -> tuple[Matrix, TcpSource]:
    """The tool's stated point, or the nearest of the last axis if its offset is not determined, by the
    `status` (p,) of the parameters."""
    point = problem.tool.point
    last = problem.robot.joints[-1]
    if not undetermined_offsets(problem, status)[-1] or last.kind != "revolute":
        return point, "tool"
    to_flange = problem.robot.flange[:3, :3].T
    axis, origin = to_flange @ last.axis, -to_flange @ problem.robot.flange[:3, 3]
    foot = origin + axis * (axis @ (point - origin))
    if np.linalg.norm(foot - point) <= _ON_AXIS:
        return point, "tool"
    return foot, "last axis"


def judged_axis(problem: Problem, status: Sequence[Status]) -> int | None:
    """The last joint, where `default_point` is on its axis in place of the TCP."""
    return problem.robot.n if default_point(problem, status)[1] == "last axis" else None
