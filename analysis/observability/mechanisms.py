"""Why the data do not determine a combination of parameters: each mechanism is tested, not guessed.

A mechanism is a set of parameters that can move together without changing the residuals. It explains a
null-space direction if a direction within that set alone is null (or as nearly null) too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ...model.likelihood.problem import Problem
from .causes import (
    BaseFrame,
    Cause,
    CommonMotion,
    NoiseSplit,
    OnAxis,
    OnePosition,
    ParallelAxes,
    TargetUnseen,
    TooFewMeasurements,
    ToolAgainstTarget,
    ToolRotation,
    Unexplained,
)

_CONSTANT = 1e-9  # degrees or mm
_NEARLY_CONSTANT_DEG = 10.0
_NEARLY_CONSTANT_MM = 50.0
_PARALLEL = 1e-9  # of the cosine


@dataclass(frozen=True, eq=False)
class Mechanism:
    """`support` (p,) marks the parameters that move together."""

    support: NDArray[np.bool_]
    cause: Cause


_NO_SUPPORT = np.zeros(0, dtype=bool)


def mechanisms(problem: Problem) -> Iterator[Mechanism]:
    """The known mechanisms for these measurements, the most special first."""
    n, parameters, free = problem.robot.n, problem.parameters, problem.parameters.free
    targets, tool = parameters.group("target"), parameters.group("tool")

    def offset(i: int) -> NDArray[np.bool_]:
        return np.equal(np.arange(len(parameters)), i)

    for which, name in enumerate(problem.targets):
        only = np.zeros(len(parameters), dtype=bool)
        only[parameters.block("target", which)] = True
        yield Mechanism(only, TargetUnseen(name, int((problem.target_index == which).sum())))
    # Without its own offset among the unknowns a mechanism would explain what others do.
    if free[0]:
        yield Mechanism(offset(0) | targets, BaseFrame())
    if problem.noise.separate:
        yield Mechanism(parameters.group("noise"), NoiseSplit())
    yield Mechanism(offset(n - 1), OnAxis(problem.tool.kind, n))
    if tool.any() and free[n - 1]:
        yield Mechanism(offset(n - 1) | tool, ToolRotation(problem.tool.kind, n))
    spread = np.ptp(problem.joints, axis=0) * problem.robot.display
    for k in range(1, n):
        if free[k]:
            yield Mechanism(offset(k) | targets, _common_motion(problem, spread, k))
    # Of too few measurements almost any pair of axes looks inseparable: that is no property of the axes.
    enough = too_few_measurements(problem, int(free.sum())) is None
    parallel = _parallel_axes(problem)
    for i, j in combinations(np.flatnonzero(free[:n]), 2):
        if enough and parallel[i, j]:
            yield Mechanism(offset(int(i)) | offset(int(j)) | targets, ParallelAxes(int(i) + 1, int(j) + 1))
    if tool.any():
        yield Mechanism(tool | targets, ToolAgainstTarget())


def _common_motion(problem: Problem, spread: NDArray[np.float64], k: int) -> CommonMotion:
    """The motion of everything after joint k (1 … k do not change, or hardly).

    `spread` (n,) is the range of each joint over the measurements, degrees or mm.
    """
    revolute = np.array([joint.kind == "revolute" for joint in problem.robot.joints])
    before, turning = spread[:k], revolute[:k]

    def largest(chosen: NDArray[np.bool_]) -> float | None:
        return float(before[chosen].max()) if chosen.any() else None

    return CommonMotion(
        joint=k + 1,
        revolute=tuple(bool(own) for own in revolute[: k + 1]),
        range_deg=largest(turning),
        range_mm=largest(~turning),
        constant=bool(before.max() <= _CONSTANT),
        nearly_constant=bool((before <= np.where(turning, _NEARLY_CONSTANT_DEG, _NEARLY_CONSTANT_MM)).all()),
    )


def _parallel_axes(problem: Problem) -> NDArray[np.bool_]:
    """(n, n) True where two joint axes are parallel in every shot."""
    (axes,) = problem.functions.kernel("axes")(
        problem.joints, problem.split(problem.parameters.prior_mean).arm
    )
    axes = axes.reshape(-1, 3, problem.robot.n)  # the kernel gives one column without its axis
    cosine = np.abs(axes.transpose(0, 2, 1) @ axes).min(axis=0)
    return np.asarray(cosine > 1 - _PARALLEL)


def unexplained(problem: Problem, size: int) -> Mechanism:
    """What explains a direction that no single mechanism explains."""
    few = too_few_measurements(problem, size)
    if few is not None:
        return few
    one_position = problem.tool.kind == "probe" and len(problem.targets) == 1
    return Mechanism(_NO_SUPPORT, OnePosition() if one_position else Unexplained())


def too_few_measurements(problem: Problem, size: int) -> Mechanism | None:
    """The mechanism of having fewer numbers than unknowns, or None where there are enough."""
    if problem.data_size >= size:
        return None
    needed = -(-size // problem.tool.residual_size)
    return Mechanism(
        np.ones(len(problem.parameters), dtype=bool),
        TooFewMeasurements(problem.shots, problem.data_size, size, needed),
    )
