"""The paper's two rows of initial postures: X-Pattern (back to front) and Y-Pattern (right to left)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...analysis.estimation.levenberg_marquardt import least_squares, levenberg_marquardt
from ...analysis.observability.clearance import Clearance
from ...model.arrays import Index, Matrix
from ...model.errors import BadInput
from ...model.files.header import Header
from ...model.instruments.registry import names_of
from ...model.kinematics.pendant import beyond_limits
from ...model.kinematics.robot import Robot
from ...model.likelihood.problem import Problem

Pattern = Literal["x", "y"]

# Where each line lies, as shares of the arm's reach: before the base, over the target, its length.
_LINES = {"x": (0.6, 0.45, 0.4), "y": (0.5, 0.45, 1.0)}
_SEEDS = 60
_HIT_MM = 1e-3
_KEEP_NEAR = 1e-4  # weight of staying near the seed: settles a free roll about the beam, moves nothing else
_ALONG = 1e-6  # sine of the angle between a beam and the line below which the roll has no direction
_BESIDE_MM = 100.0  # from the beam, of the point of the flange that a stated roll places


@dataclass(frozen=True)
class Line:
    """Where the beams of a pattern start; None: as the pattern has it.

    `distance` (mm) of the line's middle before the base's z axis, `height` (mm) over the target, `width` (mm)
    from the first start to the last. `roll` (rad) is the rotation of the flange about its beam: at zero the
    axis b1 across the beam points along the line as far as it can; None: whatever is nearest.
    """

    distance: float | None = None
    height: float | None = None
    width: float | None = None
    roll: float | None = None


USUAL = Line()


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
    line: Line = USUAL,
) -> Matrix:
    """(measurements, n) postures, rad or mm, whose beams start on a straight line and pass `target` (3,) mm.

    The line runs along the base's x axis (at y = 0) or y axis, as far before the base and over the target
    as `line` says, or else `_LINES`; `span` is its length as a share of the arm's reach, where `line` has
    none. Raises BadInput where a posture cannot be reached, or the arm blocks every beam from there.
    """
    if not header.instrument.beam:
        raise BadInput(
            "X- and Y-Pattern are made for a beam",
            found=f"tool.kind {header.instrument.name}",
            allowed=" or ".join(names_of(beam=True)),
        )
    forward, above, usual = _LINES[which]
    shares = (forward, above, usual if span is None else span)
    distance, height, width = (
        share * reach(robot) if length is None else length
        for length, share in zip((line.distance, line.height, line.width), shares, strict=True)
    )
    middle = np.array([distance, 0.0, target[2] + height])
    along = np.array([1.0, 0.0, 0.0]) if which == "x" else np.array([0.0, 1.0, 0.0])
    starts = middle + np.linspace(-width / 2, width / 2, shots)[:, None] * along
    problem = Problem.build(header, robot, np.zeros((1, robot.n)), [name])
    solver = _BeamAt(problem, target, along, line.roll)
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
    """Postures whose beam starts at a given point and passes the target, by damped least squares; with the
    `roll` (rad) about the beam from `along` (3,) if one is stated."""

    def __init__(self, problem: Problem, target: Matrix, along: Matrix, roll: float | None) -> None:
        self._problem = problem
        self._x = problem.parameters.prior_mean.copy()
        self._x[problem.parameters.group("target")] = target
        self._target, self._along, self._roll = target, along, roll
        self._beam = problem.functions.kernel("beam")
        self._placed = problem.functions.kernel("placed")
        self._clearance = Clearance(problem, None)

    def posture(self, start: Matrix, near: list[Matrix]) -> Matrix | None:
        robot = self._problem.robot
        rng = np.random.default_rng(7)
        middle = np.clip(0.0, robot.lower, robot.upper)
        width = np.minimum(robot.upper - robot.lower, np.pi)
        # With its roll a posture is one of a few, and those of a row do not jump from one to another.
        seeds = (
            near
            if near and self._roll is not None
            else [*near, middle]
            + [
                np.clip(middle + rng.uniform(-0.5, 0.5, robot.n) * width * share, robot.lower, robot.upper)
                for share in np.linspace(0.1, 1.0, _SEEDS)
            ]
        )
        for seed in seeds:
            q = self._solve(start, seed)
            if q is not None and not beyond_limits(robot, q, 0.0).any():
                return q
        return None

    def _solve(self, start: Matrix, seed: Matrix) -> Matrix | None:
        parts = self._problem.split(self._x)
        n, point = self._problem.robot.n, self._problem.tool.point
        places = [(point, start)]
        if self._roll is not None:
            _, _, across = self._problem.tool.nominal_beam()
            places.append((point + _BESIDE_MM * across[:, 0], start + _BESIDE_MM * self._across(start)))

        def residual(q: Matrix, _: Index) -> tuple[Matrix, Matrix]:
            residual_mm, jacobian = self._problem.linearise(self._x, q)
            values, jacobians = list[Matrix](), list[Matrix]()
            for on_flange, at_mm in places:
                point_mm, by = self._placed(q, parts.arm, on_flange)
                values.append(point_mm - at_mm)
                jacobians.append(by[:, :, self._problem.parameters.block("offset")])
            values += [residual_mm, _KEEP_NEAR * (q - seed)]
            jacobians += [self._problem.by_joints(jacobian), _KEEP_NEAR * np.eye(n)[None]]
            return np.concatenate(values, axis=1), np.concatenate(jacobians, axis=1)

        solution = levenberg_marquardt(least_squares(residual), seed[None], max_iterations=60)
        value, _ = residual(solution.x, np.zeros(1, dtype=np.int64))
        if np.abs(value[0, :-n]).max() > _HIT_MM:
            return None
        origin, direction = self._beam(solution.x, parts.arm, parts.tool)
        ahead = float(direction[0] @ (self._target - origin[0])) > 0
        in_the_way = self._clearance.in_the_way(solution.x, origin, self._target, beam=True)
        return solution.x[0] if ahead and not in_the_way.blocked[0] else None

    def _across(self, start: Matrix) -> Matrix:
        """(3,) where the axis b1 of a flange points whose beam starts there, at the stated roll."""
        assert self._roll is not None
        beam = (self._target - start) / np.linalg.norm(self._target - start)
        level = self._along - (self._along @ beam) * beam
        if np.linalg.norm(level) < _ALONG:
            raise BadInput(
                "a beam along the pattern's own line has no roll about it",
                found=f"a start at {_point(start)} mm, the target at {_point(self._target)} mm",
                remedy="put the line above the target, or state no roll",
            )
        level /= np.linalg.norm(level)
        return np.asarray(np.cos(self._roll) * level + np.sin(self._roll) * np.cross(beam, level))


def _point(point: Matrix) -> str:
    return "[" + ", ".join(f"{value:.0f}" for value in point) + "]"
