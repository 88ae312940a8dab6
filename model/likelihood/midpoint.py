"""The paper's midpoints of beam pairs, as a symbolic function of two shots."""

from __future__ import annotations

import casadi as ca

from ..kinematics.robot import Robot
from .geometry import NOMINAL, Geometry
from .posture import Posture
from .tool import Tool


def midpoint_function(robot: Robot, tool: Tool, geometry: Geometry = NOMINAL) -> ca.Function:
    """(q1, q2, arm, tool) -> midpoint (3,), jacobian (3, a + k) by arm, tool, and (3, n) by q1 and by q2.

    The middle of the shortest segment between two beams (section 2.2 of the paper). It is not
    defined for parallel beams: callers leave those pairs out.
    """
    one = Posture(robot, geometry)
    other = Posture(robot, geometry, one.arm)
    q1, q2, arm = one.q, other.q, one.arm
    unknown = ca.SX.sym("tool", len(tool.free_axes))
    point, direction, _ = tool.beam(unknown)
    feet: list[tuple[ca.SX, ca.SX]] = []
    for posture in (one, other):
        rotation, translation = posture.pose
        feet.append((translation + rotation @ point, rotation @ direction))
    (o1, u1), (o2, u2) = feet
    between, cosine = o2 - o1, ca.dot(u1, u2)
    sine_squared = ca.sumsqr(ca.cross(u1, u2))
    along1 = (ca.dot(between, u1) - cosine * ca.dot(between, u2)) / sine_squared
    along2 = (cosine * ca.dot(between, u1) - ca.dot(between, u2)) / sine_squared
    middle = (o1 + along1 * u1 + o2 + along2 * u2) / 2
    return ca.Function(
        "midpoint",
        [q1, q2, arm, unknown],
        ca.cse([middle, *(ca.densify(ca.jacobian(middle, by)) for by in (ca.vertcat(arm, unknown), q1, q2))]),
        ["q1", "q2", "arm", "tool"],
        ["midpoint", "jacobian", "by_q1", "by_q2"],
    )
