"""The misses, as symbolic functions of one shot, and the paper's midpoints of beam pairs.

One shot has the inputs

    q      (n,)   recorded joint positions, rad or mm
    spot   (d,)   recorded position of the target across the beam, mm (zero for a probe)
    delta  (n,)   joint offsets
    target (3,)   target in the base frame, mm
    tool   (k,)   what is open of the tool (k = 0 if it is calibrated)

and the miss m (d,), kept in the flange frame: there the turn of base and target about joint 1
cancels exactly, whatever the residual. Since q and delta enter only as q + delta, the Jacobian
by delta is the Jacobian by q as well.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca

from .kernel import Kernel
from .robot import Robot
from .tool import Tool


@dataclass(frozen=True, eq=False)
class ShotFunctions:
    """Named CasADi functions of one shot; every first derivative is exact.

    linear    (q, spot, delta, target, tool) -> m (d,), jacobian (d, n + 3 + k) by delta, target, tool
    terms     the same and variances (n + 1,) -> quad, logdet: m' S^-1 m and log det S
    score     the same and weight (1,) -> gradient (n + 3 + k,) of -(weight quad + logdet) / 2
    seen      (q, delta, target) -> y (3,), the target seen from the flange
    place     (q, delta, y) -> target (3,): the way back
    placed    the same -> target (3,), jacobian (3, n + 3) by delta, y
    beam      (q, delta, tool) -> origin (3,), direction (3,): the beam in the base frame (eq. 7);
              for a probe the direction is zero and the origin is its tip
    skeleton  (q, delta) -> points (3, n + 2): base, joint origins and flange in the base frame
    axes      (q, delta) -> axes (3, n): unit joint axes in the base frame
    """

    linear: ca.Function
    terms: ca.Function
    score: ca.Function
    seen: ca.Function
    place: ca.Function
    placed: ca.Function
    beam: ca.Function
    skeleton: ca.Function
    axes: ca.Function
    _kernels: dict[tuple[str, bool], Kernel] = field(default_factory=dict, repr=False)

    def kernel(self, name: str, *, compile: bool = False) -> Kernel:
        """The function of that name as a fast callable, made once."""
        if (name, compile) not in self._kernels:
            self._kernels[name, compile] = Kernel(getattr(self, name), compile=compile)
        return self._kernels[name, compile]


def shot_functions(robot: Robot, tool: Tool) -> ShotFunctions:
    """Build the functions of one shot for this robot and tool (section 1 of the conventions)."""
    n, d = robot.n, tool.miss_size
    q, delta = ca.SX.sym("q", n), ca.SX.sym("delta", n)
    spot, target = ca.SX.sym("spot", d), ca.SX.sym("target", 3)
    unknown = ca.SX.sym("tool", len(tool.parameter_names))
    variances, weight = ca.SX.sym("variances", n + 1), ca.SX.sym("weight")

    rotation, translation = robot.flange_pose(q + delta)
    seen = rotation.T @ (target - translation)
    if tool.kind == "laser":
        point, direction, across = tool.beam(unknown)
        miss = across.T @ (seen - point) - spot
    else:
        point, direction = tool.tip(unknown), ca.SX.zeros(3)
        miss = seen - point - spot

    free = ca.vertcat(delta, target, unknown)
    jacobian = ca.jacobian(miss, free)
    by_joints = jacobian[:, :n]
    covariance = by_joints @ ca.diag(variances[:n]) @ by_joints.T + variances[n] * ca.SX.eye(d)
    quad, logdet = _gaussian_terms(miss, covariance)
    score = ca.gradient(-(weight * quad + logdet) / 2, free)

    y = ca.SX.sym("y", 3)
    placed = translation + rotation @ y

    shot = [q, spot, delta, target, unknown]
    names = ["q", "spot", "delta", "target", "tool"]
    return ShotFunctions(
        linear=ca.Function("linear", shot, [miss, ca.densify(jacobian)], names, ["m", "jacobian"]),
        terms=ca.Function(
            "terms", [*shot, variances], [quad, logdet], [*names, "variances"], ["quad", "logdet"]
        ),
        score=ca.Function(
            "score",
            [*shot, variances, weight],
            [ca.densify(score)],
            [*names, "variances", "weight"],
            ["gradient"],
        ),
        seen=ca.Function("seen", [q, delta, target], [seen], ["q", "delta", "target"], ["y"]),
        place=ca.Function("place", [q, delta, y], [placed], ["q", "delta", "y"], ["target"]),
        placed=ca.Function(
            "placed",
            [q, delta, y],
            [placed, ca.densify(ca.jacobian(placed, ca.vertcat(delta, y)))],
            ["q", "delta", "y"],
            ["target", "jacobian"],
        ),
        beam=ca.Function(
            "beam",
            [q, delta, unknown],
            [translation + rotation @ point, ca.densify(rotation @ direction)],
            ["q", "delta", "tool"],
            ["origin", "direction"],
        ),
        skeleton=ca.Function(
            "skeleton", [q, delta], [ca.densify(robot.skeleton(q + delta))], ["q", "delta"], ["points"]
        ),
        axes=ca.Function("axes", [q, delta], [ca.densify(robot.axes(q + delta))], ["q", "delta"], ["axes"]),
    )


def midpoint_function(robot: Robot, tool: Tool) -> ca.Function:
    """(q1, q2, delta, tool) -> midpoint (3,), jacobian (3, n + k) by delta, tool.

    The middle of the shortest segment between two beams (section 2.2 of the paper). It is not
    defined for parallel beams: callers leave those pairs out.
    """
    n = robot.n
    q1, q2 = ca.SX.sym("q1", n), ca.SX.sym("q2", n)
    delta = ca.SX.sym("delta", n)
    unknown = ca.SX.sym("tool", len(tool.parameter_names))
    point, direction, _ = tool.beam(unknown)
    feet: list[tuple[ca.SX, ca.SX]] = []
    for q in (q1, q2):
        rotation, translation = robot.flange_pose(q + delta)
        feet.append((translation + rotation @ point, rotation @ direction))
    (o1, u1), (o2, u2) = feet
    between, cosine = o2 - o1, ca.dot(u1, u2)
    sine_squared = ca.sumsqr(ca.cross(u1, u2))
    along1 = (ca.dot(between, u1) - cosine * ca.dot(between, u2)) / sine_squared
    along2 = (cosine * ca.dot(between, u1) - ca.dot(between, u2)) / sine_squared
    middle = (o1 + along1 * u1 + o2 + along2 * u2) / 2
    return ca.Function(
        "midpoint",
        [q1, q2, delta, unknown],
        [middle, ca.densify(ca.jacobian(middle, ca.vertcat(delta, unknown)))],
        ["q1", "q2", "delta", "tool"],
        ["midpoint", "jacobian"],
    )


def _gaussian_terms(miss: ca.SX, covariance: ca.SX) -> tuple[ca.SX, ca.SX]:
    """m' S^-1 m and log det S by a Cholesky factor written out (d is 2 or 3)."""
    d = miss.size1()
    factor = [[ca.SX(0)] * d for _ in range(d)]
    whitened: list[ca.SX] = []
    for i in range(d):
        for j in range(i + 1):
            value = covariance[i, j] - sum((factor[i][k] * factor[j][k] for k in range(j)), ca.SX(0))
            factor[i][j] = ca.sqrt(value) if i == j else value / factor[j][j]
        inner = sum((factor[i][k] * whitened[k] for k in range(i)), ca.SX(0))
        whitened.append((miss[i] - inner) / factor[i][i])
    quad = sum((w**2 for w in whitened), ca.SX(0))
    logdet = 2 * sum((ca.log(factor[i][i]) for i in range(d)), ca.SX(0))
    return quad, logdet
