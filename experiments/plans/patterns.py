"""The paper's two rows of initial postures: X-Pattern (back to front) and Y-Pattern (right to left)."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ...analysis.estimation.levenberg_marquardt import least_squares, levenberg_marquardt
from ...model.arrays import Index, Matrix
from ...model.errors import BadInput
from ...model.files.header import Header
from ...model.instruments.registry import names_of
from ...model.kinematics.pendant import beyond_limits
from ...model.kinematics.robot import Robot
from ...model.likelihood.problem import Problem
from .obstacles import Clearance

Pattern = Literal["x", "y"]

# Where each line lies, as shares of the arm's reach: before the base, over the target, its length.
_LINES = {"x": (0.6, 0.45, 0.4), "y": (0.5, 0.45, 1.0)}
_SEEDS = 60
_HIT_MM = 1e-3
_KEEP_NEAR = 1e-4  # weight of staying near the seed: settles the roll about the beam, moves nothing else


def reach(robot: Robot) -> float:
    """Length of the stretched arm, mm: the sum of what lies between its joints, without the base's column."""
    links = [np.linalg.norm(joint.fixed[:3, 3]) for joint in robot.joints[1:]]
    return float(sum(links) + np.linalg.norm(robot.flange[:3, 3]))


def pattern(
    header: Header,
    robot: Robot,
    target: Matrix,
    which: Pattern,
    shots: int = 7,
    *,
    name: str = "psd",
    span: float | None = None,
) -> Matrix:
    """(measurements, n) postures, rad or mm, whose beams start on a straight line and pass `target` (3,) mm.

    The line runs along the base's x axis (at y = 0) or y axis, as far before the base and over the target
    as `_LINES` says; `span` is its length as a share of the arm's reach. Raises BadInput where a posture
    cannot be reached, or the arm blocks every beam from there.
    """
    if not header.instrument.beam:
        raise BadInput(
            "X- and Y-Pattern are made for a beam",
            found=f"tool.kind {header.instrument.name}",
            allowed=" or ".join(names_of(beam=True)),
        )
    arm = reach(robot)
    forward, above, usual = _LINES[which]
    span = usual if span is None else span
    middle = np.array([forward * arm, 0.0, target[2] + above * arm])
    along = np.array([1.0, 0.0, 0.0]) if which == "x" else np.array([0.0, 1.0, 0.0])
    starts = middle + np.linspace(-span / 2, span / 2, shots)[:, None] * arm * along
    problem = Problem.build(header, robot, np.zeros((1, robot.n)), [name])
    solver = _BeamAt(problem, target)
    postures = np.empty((shots, robot.n))
    order = np.argsort(np.abs(np.arange(shots) - (shots - 1) / 2), kind="stable")
    done: list[int] = []
    for i in order:
        near = [postures[j] for j in done if abs(j - i) == 1]
        posture = solver.posture(starts[i], near)
        if posture is None:
            raise BadInput(
                f"the {which.upper()}-Pattern cannot be made: the arm cannot shoot from all of its line",
                found=f"no posture has the laser at {_point(starts[i])} mm and sees {_point(target)} mm"
                " past the arm itself",
                remedy="put the target nearer to the middle of the workspace",
            )
        postures[i] = posture
        done.append(i)
    return postures


class _BeamAt:
    """Postures whose beam starts at a given point and passes the target, by damped least squares."""

    def __init__(self, problem: Problem, target: Matrix) -> None:
        self._problem = problem
        self._x = problem.parameters.prior_mean.copy()
        self._x[problem.parameters.group("target")] = target
        self._target = target
        self._beam = problem.functions.kernel("beam")
        self._placed = problem.functions.kernel("placed")
        self._clearance = Clearance(problem, None)

    def posture(self, start: Matrix, near: list[Matrix]) -> Matrix | None:
        robot = self._problem.robot
        rng = np.random.default_rng(7)
        middle = np.clip(0.0, robot.lower, robot.upper)
        width = np.minimum(robot.upper - robot.lower, np.pi)
        seeds = [*near, middle] + [
            np.clip(middle + rng.uniform(-0.5, 0.5, robot.n) * width * share, robot.lower, robot.upper)
            for share in np.linspace(0.1, 1.0, _SEEDS)
        ]
        for seed in seeds:
            q = self._solve(start, seed)
            if q is not None and not beyond_limits(robot, q, 0.0).any():
                return q
        return None

    def _solve(self, start: Matrix, seed: Matrix) -> Matrix | None:
        parts = self._problem.split(self._x)
        n, point = self._problem.robot.n, self._problem.tool.point

        def residual(q: Matrix, _: Index) -> tuple[Matrix, Matrix]:
            origin, by = self._placed(q, parts.arm, point)
            residual_mm, jacobian = self._problem.linearise(self._x, q)
            value = np.concatenate([origin - start, residual_mm, _KEEP_NEAR * (q - seed)], axis=1)
            near = _KEEP_NEAR * np.eye(n)[None]
            by_joints = by[:, :, self._problem.parameters.block("offset")]
            return value, np.concatenate([by_joints, self._problem.by_joints(jacobian), near], axis=1)

        solution = levenberg_marquardt(least_squares(residual), seed[None], max_iterations=60)
        value, _ = residual(solution.x, np.zeros(1, dtype=np.int64))
        if np.abs(value[0, : 3 + self._problem.tool.residual_size]).max() > _HIT_MM:
            return None
        origin, direction = self._beam(solution.x, parts.arm, parts.tool)
        ahead = float(direction[0] @ (self._target - origin[0])) > 0
        free = (
            ahead and not self._clearance.in_the_way(solution.x, origin, self._target, beam=True).blocked[0]
        )
        return solution.x[0] if free else None


def _point(point: Matrix) -> str:
    return "[" + ", ".join(f"{value:.0f}" for value in point) + "]"
