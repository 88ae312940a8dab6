"""The region over which the error of the TCP is judged, and its postures: the one owner of both.

Values to enter, the error before and after, conformity, maps and sensitivity are all of these postures. They
are those of the header (`workspace`): spread evenly over the central part of the joints' ranges, over the
whole ranges, over what of these has the nominal TCP in a box; or the user's own.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Literal

import numpy as np

from ..model.arrays import Matrix
from ..model.errors import BadInput
from ..model.files.stated_workspace import StatedWorkspace
from ..model.kinematics.robot import Robot
from ..model.kinematics.spread import spread_postures, within_limits
from ..model.likelihood.problem import Problem
from ..model.records import it, record, worded

CENTRAL = 0.7  # of each joint's range
_FRONT = float(np.radians(90.0))
_TRIED = 2**16  # postures, to find those whose TCP is in a box
_ENOUGH = 32  # of them in the box: fewer stand for no region

Corner = tuple[float, float, float]


@record
class TcpRegion:
    """Over which postures the error of the TCP is stated; `name` names it in every sentence."""

    joints: Annotated[
        Literal["central", "full"] | None,
        it("the part of the joints' ranges; null where the region is a file's postures"),
    ]
    box_mm: Annotated[
        tuple[Corner, Corner] | None, it("the lowest and the highest corner of the box of the TCP, or null")
    ] = None
    positions: Annotated[str | None, it("the name of the file of postures, or null")] = None
    postures: Annotated[int | None, it("how many postures that file has, or null")] = None
    name: Annotated[str | None, worded("the region in words")] = None


def region_of(workspace: StatedWorkspace) -> TcpRegion:
    """The region that a header states."""
    if workspace.positions is None:
        return TcpRegion(workspace.joints, workspace.box_mm)
    name = workspace.positions.replace("\\", "/").rpartition("/")[2]
    return TcpRegion(None, None, name, len(workspace.postures_deg or ()))


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
