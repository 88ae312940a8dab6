"""Many recordings and robots at once, each fitted with nominal geometry: which of them are worth a whole fit.

One symbolic function serves all robots with joints of the same kinds: their transforms are its inputs, so
that nothing is built anew for another arm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ...model.arrays import Index, Matrix
from ...model.instruments.kind import Instrument
from ...model.kinematics.dh import along_z
from ...model.kinematics.robot import Joint, JointKind, Robot
from ...model.likelihood.constraint import residual
from ...model.likelihood.geometry import NOMINAL
from ...model.likelihood.problem import Problem
from ..estimation.levenberg_marquardt import least_squares, levenberg_marquardt

_STEPS = 12
_TOLERANCE = 1e-4  # of the cost: a ranking needs no more
_LARGEST = 1e150


def screened(
    problem: Problem, robots: Sequence[Robot], joints: Matrix, weights: Matrix
) -> tuple[Matrix, Matrix]:
    """The parameters (V, p) of the problem with nominal geometry, and the squares (V,) of residuals and of
    scaled parameters there, of V robots with the recorded `joints` (V, N, n) and the `weights` (V, N)
    of the measurements."""
    problem = problem.with_geometry(NOMINAL)
    screen = _Screen(problem, robots, joints, weights)
    minima = levenberg_marquardt(
        least_squares(screen.residuals),
        np.zeros((len(robots), screen.size)),
        max_iterations=_STEPS,
        tolerance=_TOLERANCE,
    )
    cost = np.where(np.isfinite(minima.cost), 2 * minima.cost, _LARGEST)
    return screen.parameters(minima.x), cost


class _Screen:
    def __init__(self, problem: Problem, robots: Sequence[Robot], joints: Matrix, weights: Matrix) -> None:
        self.problem, self.joints, self.weights = problem, joints, weights
        by_identity = {id(robot): _transforms(robot) for robot in robots}
        self.transforms = np.array([by_identity[id(robot)] for robot in robots])
        self.free = problem.parameters.free
        self.size = int(self.free.sum())
        kinds = tuple(joint.kind for joint in problem.robot.joints)
        self.function = _function(kinds, _ToolKey(problem.tool.key, problem.tool))

    def parameters(self, z: Matrix) -> Matrix:
        """(W, p) from scaled free ones (W, f)."""
        parameters = self.problem.parameters
        x = np.tile(parameters.prior_mean, (len(z), 1))
        x[:, self.free] += z * parameters.prior_std[self.free]
        return x

    def residuals(self, z: Matrix, rows: Index) -> tuple[Matrix, Matrix]:
        """(W, M + f) whitened residuals, distances and scaled parameters, and their Jacobian by these."""
        problem, parameters = self.problem, self.problem.parameters
        x, shots, d = self.parameters(z), problem.shots, problem.tool.residual_size
        parts = problem.split(x)
        joints, targets = self.joints[rows], parts.targets[:, problem.target_index]
        if problem.tool.target_is == "nothing":
            targets = targets[..., :0]
        of_shots = [
            np.repeat(self.transforms[rows], shots, axis=0),
            joints.reshape(-1, joints.shape[-1]),
            np.tile(problem.data, (len(z), 1)),
            np.repeat(parts.arm, shots, axis=0),
            targets.reshape(len(z) * shots, -1) if targets.size else np.zeros((len(z) * shots, 0)),
            np.repeat(parts.tool, shots, axis=0),
        ]
        mapped = self.function.map(len(z) * shots)(*(values.T for values in of_shots))
        residual = mapped[0].full().T.reshape(len(z), shots, d)
        jacobian = mapped[1].full().reshape(d, len(z), shots, -1).transpose(1, 2, 0, 3)
        by_joints = jacobian[..., problem.parameters.in_shot("offset")]
        covariance = np.stack([problem.covariances(each, problem.noise.variances) for each in by_joints])
        scaled = jacobian * parameters.prior_std[problem.columns][:, None, :]
        stacked = np.concatenate([residual[..., None], scaled], axis=-1)
        with np.errstate(all="ignore"):
            stacked = np.linalg.solve(np.linalg.cholesky(covariance), stacked)
        stacked *= np.sqrt(self.weights[rows])[:, :, None, None]
        whole = np.zeros((len(z), shots * d, len(parameters)))
        where = np.broadcast_to(
            np.repeat(problem.columns, d, axis=0), (len(z), shots * d, stacked.shape[-1] - 1)
        )
        np.put_along_axis(whole, where, stacked[..., 1:].reshape(where.shape), axis=2)
        distance, by_distance = problem.tie_rows(x)
        by_distance = by_distance * parameters.prior_std
        every = np.concatenate([whole, by_distance], axis=1)[:, :, self.free]
        values = np.concatenate([stacked[..., 0].reshape(len(z), -1), distance, z], axis=1)
        identity = np.broadcast_to(np.eye(self.size), (len(z), self.size, self.size))
        return values, np.concatenate([every, identity], axis=1)


def _transforms(robot: Robot) -> Matrix:
    """(12 (n + 1),) the upper three rows of each transform, column by column."""
    robot = along_z(robot)
    fixed = [*(joint.fixed for joint in robot.joints), robot.flange]
    return np.concatenate([at[:3].ravel(order="F") for at in fixed])


@dataclass(frozen=True)
class _ToolKey:
    """A tool, equal to all whose functions are the same."""

    key: bytes
    tool: Instrument = field(compare=False)


@lru_cache(maxsize=8)
def _function(kinds: tuple[JointKind, ...], key: _ToolKey) -> ca.Function:
    """(transforms, q, data, delta, target, tool) -> residual (d,), its Jacobian by the last three."""
    tool, n = key.tool, len(kinds)
    transforms = ca.SX.sym("transforms", 12 * (n + 1))
    # Transforms that are symbols, as those of `Geometry.moved`.
    fixed: list[Any] = [
        ca.vertcat(ca.reshape(transforms[12 * i : 12 * i + 12], 3, 4), ca.SX([[0, 0, 0, 1]]))
        for i in range(n + 1)
    ]
    along = np.array([0.0, 0.0, 1.0])
    joints = tuple(Joint("", kind, at, along, 0.0, 0.0) for kind, at in zip(kinds, fixed, strict=False))
    robot = Robot("", joints, fixed[-1])
    q, delta = ca.SX.sym("q", n), ca.SX.sym("delta", n)
    target = ca.SX.sym("target", 0 if tool.target_is == "nothing" else 3)
    d = tool.residual_size
    data, unknown = ca.SX.sym("data", d + tool.reading_size), ca.SX.sym("tool", len(tool.unknowns))
    turns = robot.turns(q + delta)
    left, by_joints, by_target = residual(robot, turns, tool, target, unknown, data[d:])
    left -= data[:d]
    jacobian = ca.horzcat(by_joints, by_target, ca.jacobian(left, unknown))
    inputs = [transforms, q, data, delta, target, unknown]
    return ca.Function("screen", inputs, ca.cse([ca.densify(left), ca.densify(jacobian)]))
