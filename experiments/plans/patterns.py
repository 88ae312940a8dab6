"""The paper's two rows of initial postures: X-Pattern (back to front) and Y-Pattern (right to left)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Literal

import numpy as np

from ...analysis.estimation.levenberg_marquardt import least_squares, levenberg_marquardt
from ...analysis.observability.clearance import Clearance
from ...model.arrays import Index, Mask, Matrix
from ...model.errors import BadInput
from ...model.files.header import Header
from ...model.instruments.registry import names_of
from ...model.kinematics.pendant import beyond_limits
from ...model.kinematics.robot import Robot
from ...model.likelihood.problem import Problem

Pattern = Literal["x", "y"]

# Where each line lies, as shares of the arm's reach: before the base, over the target, its length.
_LINES = {"x": (0.6, 0.45, 0.4), "y": (0.5, 0.45, 1.0)}
_SEEDS, _FEW_SEEDS = 60, 16
# Of a line that cannot be shot from: factors on its distance, height and width, and how many are tried.
_OTHER = (
    (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 1.1, 1.2),
    (1.0, 0.85, 0.7, 0.5, 1.2, 1.4),
    (1.0, 0.8, 0.6, 0.4),
)
_TRIED = 80
_OPTIONS = ("--distance", "--height", "--width")
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
    lengths_in_mm = (line.distance, line.height, line.width)
    lengths = [
        share * reach(robot) if length is None else length
        for length, share in zip(lengths_in_mm, shares, strict=True)
    ]
    problem = Problem.build(header, robot, np.zeros((1, robot.n)), [name])
    along = np.array([1.0, 0.0, 0.0]) if which == "x" else np.array([0.0, 1.0, 0.0])
    solver = _BeamAt(problem, target, along, line.roll)
    starts = solver.starts(lengths, shots)
    postures, unreached = solver.row(starts)
    if unreached is None:
        return postures
    raise BadInput(
        f"the {which.upper()}-Pattern cannot be made: the arm cannot shoot from all of its line",
        found=f"no posture has the laser at {_point(starts[unreached])} mm and sees {_point(target)} mm"
        " past the arm itself",
        remedy=_other_line(solver, lengths, [length is None for length in lengths_in_mm], shots),
    )


def _other_line(solver: _BeamAt, lengths: Sequence[float], free: Sequence[bool], shots: int) -> str:
    """What to do where a line cannot be shot from: the nearest of other distances, heights and widths (those
    that are `free`) from which all postures were found."""
    shares = [scales if each else (1.0,) for scales, each in zip(_OTHER, free, strict=True)]

    def order(scales: tuple[float, ...]) -> tuple[int, float]:
        """A change of one alone first, then the smallest."""
        return sum(scale != 1 for scale in scales), sum(abs(np.log(scale)) for scale in scales)

    candidates = sorted(product(*shares), key=order)
    for scales in candidates[1:_TRIED]:
        other = [
            length if scale == 1 else max(round(scale * length, -1), 10.0)
            for scale, length in zip(scales, lengths, strict=True)
        ]
        starts = solver.starts(other, shots)
        if solver.may_reach(starts[[0, shots // 2, -1]]) and solver.row(starts)[1] is None:
            options = [
                f"{name} {length:.0f}"
                for name, length, scale in zip(_OPTIONS, other, scales, strict=True)
                if scale != 1
            ]
            return f"another line serves: {' '.join(options)}"
    return (
        "no line near this one serves: put the target elsewhere, or let `plan optimal` choose the postures"
        f" ({', '.join(_OPTIONS)} move the line)"
    )


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

    def starts(self, lengths: Sequence[float], shots: int) -> Matrix:
        """(shots, 3) where the beams of a line of that distance, height and width start, mm."""
        distance, height, width = lengths
        middle = np.array([distance, 0.0, self._target[2] + height])
        return np.asarray(middle + np.linspace(-width / 2, width / 2, shots)[:, None] * self._along)

    def row(self, starts: Matrix) -> tuple[Matrix, int | None]:
        """Postures (shots, n) whose beams start there, from the middle on, and the first start from which
        there is none."""
        shots = len(starts)
        postures = np.empty((shots, self._problem.robot.n))
        order = np.argsort(np.abs(np.arange(shots) - (shots - 1) / 2), kind="stable").tolist()
        done: list[int] = []
        for i in order:
            posture = self._posture(starts[i], [postures[j] for j in done if abs(j - i) == 1])
            if posture is None:
                return postures, i
            postures[i] = posture
            done.append(i)
        return postures, None

    def may_reach(self, starts: Matrix) -> bool:
        """Whether a few seeds lead to a posture at every start."""
        seeds = np.array(self._seeds[:_FEW_SEEDS])
        _, good = self._solved(np.repeat(starts, len(seeds), axis=0), np.tile(seeds, (len(starts), 1)))
        return bool(good.reshape(len(starts), -1).any(axis=1).all())

    def _posture(self, start: Matrix, near: list[Matrix]) -> Matrix | None:
        # With its roll a posture is one of a few, and those of a row do not jump from one to another.
        first, *more = (
            [near] if near and self._roll is not None else [[*near, *self._seeds[:1]], self._seeds[1:]]
        )
        for seeds in (first, *more):
            postures, good = self._solved(np.repeat(start[None], len(seeds), axis=0), np.array(seeds))
            if good.any():
                return np.asarray(postures[np.flatnonzero(good)[0]])
        return None

    @cached_property
    def _seeds(self) -> list[Matrix]:
        """The middle of the ranges, and random postures about it, the nearest first."""
        robot, rng = self._problem.robot, np.random.default_rng(7)
        middle = np.clip(0.0, robot.lower, robot.upper)
        width = np.minimum(robot.upper - robot.lower, np.pi)
        return [middle] + [
            np.clip(middle + rng.uniform(-0.5, 0.5, robot.n) * width * share, robot.lower, robot.upper)
            for share in np.linspace(0.1, 1.0, _SEEDS)
        ]

    def _solved(self, starts: Matrix, seeds: Matrix) -> tuple[Matrix, Mask]:
        """(N, n) postures from N seeds, and which have the beam start there and pass the target, within the
        limits and past the arm itself."""
        parts = self._problem.split(self._x)
        robot, point = self._problem.robot, self._problem.tool.point
        places = [(point, starts)]
        if self._roll is not None:
            _, _, across = self._problem.tool.nominal_beam()
            beside = np.array([start + _BESIDE_MM * self._across(start) for start in starts])
            places.append((point + _BESIDE_MM * across[:, 0], beside))

        def residual(q: Matrix, rows: Index) -> tuple[Matrix, Matrix]:
            residual_mm, jacobian = self._problem.linearise(self._x, q, np.zeros(len(q), np.int64))
            values, jacobians = list[Matrix](), list[Matrix]()
            for on_flange, at_mm in places:
                point_mm, by = self._placed(q, parts.arm, on_flange)
                values.append(point_mm - at_mm[rows])
                jacobians.append(by[:, :, self._problem.parameters.block("offset")])
            values += [residual_mm, _KEEP_NEAR * (q - seeds[rows])]
            jacobians += [
                self._problem.by_joints(jacobian),
                np.repeat(_KEEP_NEAR * np.eye(robot.n)[None], len(q), axis=0),
            ]
            return np.concatenate(values, axis=1), np.concatenate(jacobians, axis=1)

        solution = levenberg_marquardt(least_squares(residual), seeds, max_iterations=60)
        value, _ = residual(solution.x, np.arange(len(seeds)))
        good = np.abs(value[:, : -robot.n]).max(axis=1) <= _HIT_MM
        good &= ~beyond_limits(robot, solution.x, 0.0).any(axis=1)
        if good.any():
            origin, direction = self._beam(solution.x, parts.arm, parts.tool)
            good &= ((self._target - origin) * direction).sum(axis=1) > 0
            good &= ~self._clearance.in_the_way(solution.x, origin, self._target, beam=True).blocked
        return solution.x, good

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
