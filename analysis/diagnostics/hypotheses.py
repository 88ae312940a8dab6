"""What is often wrong with a recording or a robot file, as changes of the recorded joint positions.

Columns exchanged, signs, zeros, units and coupled joints are changes of what was recorded: data sets of one
problem, which one batch of fits tries. A twist of the robot file with the wrong sign becomes one too, for a
robot with one more joint in every twisted link, about the common normal of the two axes: it is at 0 where the
file is right, and at minus twice the twist where its sign is wrong.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np

from ...model.arrays import Index, Matrix
from ...model.kinematics.robot import Joint, Robot
from ...model.likelihood.constraint import ShotFunctions
from ...model.likelihood.geometry import NOMINAL
from ...model.likelihood.parameters import Parameter, Parameters
from ...model.likelihood.problem import Problem

Cause = Literal[
    "swapped_joints",
    "sign",
    "zero",
    "units",
    "coupling",
    "twist",
    "placement",
    "measurements",
    "moved_target",
    "geometry",
]

_PARALLEL = 1e-6  # sine of a twist below which it has no sign
_TWO_TURNS = 4 * np.pi  # rad: further no arm goes, and no angle is recorded
_QUARTERS = (90.0, -90.0, 180.0)
_Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Change:
    """One thing that may be wrong, and the positions (N, n) that would have been recorded without it.

    `joints` are numbered from 1: those concerned; of a twist the joints before and behind the link, or the
    last one for the link that ends in the flange. `amount` is what is added to a zero (deg), the factor of
    units, or how many times joint 2 is added to joint 3. `freed` counts what was chosen to suit the data, and
    `volume` is the logarithm of the factor by which positions shrink.
    """

    cause: Cause
    joints: tuple[int, ...]
    recorded: Matrix
    amount: float = 0.0
    freed: int = 0
    volume: float = 0.0


def changes(problem: Problem, x: Matrix) -> Iterator[Change]:
    """All changes of the recorded positions worth trying; `x` (p,) is where the fit as recorded ended."""
    robot, recorded = problem.robot, problem.joints
    kinds = [joint.kind for joint in robot.joints]
    revolute = [i for i, kind in enumerate(kinds) if kind == "revolute"]
    for i, j in combinations(range(robot.n), 2):
        if kinds[i] == kinds[j]:
            swapped = recorded.copy()
            swapped[:, [i, j]] = recorded[:, [j, i]]
            yield Change("swapped_joints", (i + 1, j + 1), swapped)
    for i in range(robot.n):
        reversed_ = recorded.copy()
        reversed_[:, i] *= -1
        yield Change("sign", (i + 1,), reversed_)
    for i in revolute:
        for degrees in _QUARTERS:
            yield Change("zero", (i + 1,), _added(recorded, i, np.radians(degrees)), degrees)
    yield from _far_zeros(problem, x, revolute)
    yield from _units(recorded, revolute)
    if robot.n > 2 and kinds[1:3] == ["revolute"] * 2:
        for times in (1.0, -1.0):
            yield Change("coupling", (2, 3), _added(recorded, 2, times * recorded[:, 1]), times)


def _added(recorded: Matrix, joint: int, what: Matrix | float) -> Matrix:
    result = recorded.copy()
    result[:, joint] += what
    return result


def _far_zeros(problem: Problem, x: Matrix, revolute: list[int]) -> Iterator[Change]:
    """Zeros as far off as the fit as recorded has them, where that is beyond the prior and no quarter."""
    parameters = problem.parameters
    block = parameters.block("offset")
    off, std = x[block], parameters.prior_std[block]
    for i in revolute:
        quarter = np.pi / 2 * np.round(off[i] / (np.pi / 2))
        near = quarter != 0 and abs(off[i] - quarter) <= 4 * std[i]
        if parameters.free[block][i] and abs(off[i]) > 4 * std[i] and not near:
            degrees = float(np.degrees(off[i]))
            yield Change("zero", (i + 1,), _added(problem.joints, i, float(off[i])), degrees, freed=1)


def _units(recorded: Matrix, revolute: list[int]) -> Iterator[Change]:
    """Radians that were taken for degrees, or degrees that were converted to degrees once more."""
    largest = float(np.abs(recorded[:, revolute]).max(initial=0.0))
    everywhere = tuple(i + 1 for i in revolute)
    for factor in (np.degrees(1.0), np.radians(1.0)):
        if revolute and (largest * factor <= _TWO_TURNS if factor > 1 else largest > _TWO_TURNS):
            scaled = recorded.copy()
            scaled[:, revolute] *= factor
            yield Change("units", everywhere, scaled, float(factor), volume=-float(np.log(factor)))


# Twists


@dataclass(frozen=True, eq=False)
class Widened:
    """A problem whose robot has one more joint, held, for each twist.

    `own` (n,) are the places of its own joints, `twists` the link (by the number of its first joint), the
    place and the twist (rad) of the others.
    """

    problem: Problem
    own: Index
    twists: tuple[tuple[int, int, float], ...]

    def of(self, recorded: Matrix) -> Matrix:
        """(N, m) positions of all joints from the recorded ones (N, n), each twist as in the file."""
        result = np.zeros((len(recorded), self.problem.robot.n))
        result[:, self.own] = recorded
        return result

    def changes(self, recorded: Matrix) -> Iterator[Change]:
        """Each twist with its sign reversed."""
        n = len(self.own)
        for link, place, twist in self.twists:
            positions = self.of(recorded)
            positions[:, place] = -2 * twist
            yield Change("twist", (link, link + 1) if link < n else (link,), positions)


def widened(problem: Problem) -> Widened | None:
    """The problem with its twists as joints; None where the robot has none, or its geometry is no chain of
    revolute and prismatic joints with a sign to reverse. Links are nominal there."""
    robot = problem.robot
    if problem.geometry:
        problem = problem.with_geometry(NOMINAL)
    joints: list[Joint] = []
    own: list[int] = []
    twists: list[tuple[int, int, float]] = []
    ends = [*((joint.fixed, joint.axis) for joint in robot.joints[1:]), (robot.flange, _Z)]
    pending = robot.joints[0].fixed
    for link, (joint, (fixed, axis)) in enumerate(zip(robot.joints, ends, strict=True), start=1):
        own.append(len(joints))
        joints.append(replace(joint, fixed=pending))
        pending = fixed
        split = _at_twist(joint.axis, fixed, axis)
        if split is not None:
            before, twist = split
            twists.append((link, len(joints), twist))
            joints.append(
                Joint(f"twist{link}", "revolute", before, np.array([1.0, 0.0, 0.0]), -2 * np.pi, 2 * np.pi)
            )
            pending = np.linalg.inv(before) @ fixed
    if not twists:
        return None
    wide = Robot(robot.name, tuple(joints), pending)
    noise = np.zeros(len(joints))
    noise[own] = problem.noise.joint
    every = np.zeros((problem.shots, len(joints)))
    every[:, own] = problem.joints
    return Widened(
        replace(
            problem,
            robot=wide,
            noise=replace(problem.noise, joint=noise),
            parameters=_with_held(problem.parameters, [place for _, place, _ in twists]),
            functions=ShotFunctions(wide, problem.tool),
            joints=every,
        ),
        np.array(own),
        tuple(twists),
    )


def _at_twist(axis: Matrix, fixed: Matrix, next_axis: Matrix) -> tuple[Matrix, float] | None:
    """A frame (4, 4) on the next axis whose x is the common normal of both axes, and the twist (rad) about
    it; None where the axes are parallel. `fixed` leads from the frame of one joint to that of the next."""
    along = fixed[:3, :3] @ next_axis
    normal = np.cross(axis, along)
    sine, cosine = float(np.linalg.norm(normal)), float(axis @ along)
    if sine < _PARALLEL:
        return None
    normal = normal / sine
    # The point of the next axis that is nearest to the axis: p + s along, with (p + s along) across both.
    point = fixed[:3, 3]
    foot = point - along * float(np.cross(axis, normal) @ point) / float(np.cross(axis, normal) @ along)
    frame = np.eye(4)
    frame[:3, :3] = np.column_stack([normal, np.cross(along, normal), along])
    frame[:3, 3] = foot
    return frame, float(np.arctan2(sine, cosine))


def _with_held(parameters: Parameters, places: list[int]) -> Parameters:
    """The parameters with a held offset more at each of these places among the joints, in rising order."""
    items = list(parameters.items)
    for place in places:
        name = f"twist{place}"
        items.insert(place, Parameter(name, "offset", name, "offset", "deg", 0.0, 1.0, 1.0, True, "header"))
    return Parameters(tuple(items))
