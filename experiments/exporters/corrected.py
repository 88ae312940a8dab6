"""The arm as a run's answer describes it: its geometry parameters, and the robot that has them.

A robot holds links; a controller's correction holds offsets alone; the deflection under gravity and the
harmonics depend on the posture and are in neither. What a file cannot hold is said in it, with what that
leaves of the run's residuals.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from ...analysis.solution import ParameterResult, Solution
from ...analysis.status import Status, known
from ...model.arrays import Matrix
from ...model.kinematics.robot import Robot
from ...model.likelihood.problem import Problem, rms_length
from ...words.observability import reason

# What a kind of file has room for: the offsets, these and the links, or every parameter.
Holds = Literal["offsets", "links", "all"]


# What a file says of a parameter with an estimate.
STATUS_WORDS: dict[Status, str] = {
    "identified": "identified",
    "weak": "WEAK: weakly observable",
    "unvalidated": "UNVALIDATED: the model does not describe the measurements",
}


@dataclass(frozen=True, kw_only=True)
class Correction:
    """One parameter of an export: its `row` of the answer, without a number where nothing is known.

    `applied` is what the exported file adds to the recorded position or to the nominal value: the estimate,
    or 0 where it is held, not determined by the data, `left_out`, or unvalidated and not `wanted` all the
    same.
    """

    row: ParameterResult
    left_out: bool
    wanted: bool

    @property
    def name(self) -> str:
        return self.row.name

    @property
    def status(self) -> Status:
        return self.row.status

    @property
    def exported(self) -> bool:
        validated = self.status != "unvalidated" or self.wanted
        return known(self.status) and validated and not self.left_out

    @property
    def applied(self) -> float:
        return (self.row.estimate or 0.0) if self.exported else 0.0


class GeometryValue(Correction):
    """One geometry parameter."""

    @property
    def of_link(self) -> bool:
        """Whether it is a link's, which a robot can hold."""
        return self.name.startswith("link")

    @property
    def internal(self) -> float:
        """`applied` in rad or mm."""
        return float(np.radians(self.applied)) if self.row.unit == "deg" else self.applied

    @property
    def sentence(self) -> str:
        """The line about it in a file."""
        row = self.row
        if row.estimate is None or row.std is None:
            why = "" if row.cause is None else f": {reason(row.cause)}"
            kind = "HELD" if self.status == "held" else "UNIDENTIFIABLE"
            return f"{self.name}: {kind}, nominal{why}"
        said = STATUS_WORDS[self.status]
        said += ", EXCLUDED on request" if self.left_out else "" if self.exported else ", not applied"
        return f"{self.name}: {row.estimate:+.6f} {row.unit}, std {row.std:.2g} {row.unit}, {said}"


class _Applied(Protocol):
    """An offset or a geometry parameter, rad or mm."""

    @property
    def internal(self) -> float: ...


def corrected_robot(
    problem: Problem, offsets: Sequence[_Applied], geometry: Sequence[GeometryValue]
) -> Robot:
    """The robot with its links as estimated, and the offsets in the transforms before its joints: at recorded
    positions it is where the arm was, but for what depends on the posture."""
    values = np.array([value.internal for value in geometry])
    moved = problem.geometry.applied(problem.robot, values)
    return moved.with_offsets(np.array([offset.internal for offset in offsets]))


def left_out_of(geometry: Sequence[GeometryValue], holds: Holds) -> tuple[GeometryValue, ...]:
    """The parameters that are not in a file of that kind, whether it has no room for them or they are not to
    be exported; held ones have no value to lose."""
    return tuple(
        value
        for value in geometry
        if value.status != "held"
        and holds != "all"
        and (holds == "offsets" or not value.of_link or not value.exported)
    )


def rms_without(solution: Solution, names: Collection[str]) -> float:
    """Root mean square, mm, of the residuals with these parameters at their prior means.

    Each target is where it then fits best (one linear step).
    """
    problem, x = solution.problem, solution.fit.x.copy()
    parameters = problem.parameters
    gone = np.array([name in names for name in parameters.names])
    x[gone] = parameters.prior_mean[gone]
    residual, jacobian = problem.linearise(x)
    by_target = jacobian[:, :, parameters.in_shot("target")]
    return rms_length(_refitted(problem, residual, by_target) if gone.any() else residual)


def _refitted(problem: Problem, residual: Matrix, by_target: Matrix) -> Matrix:
    """Residuals (N, d) once each target has moved to suit its own."""
    result = residual.copy()
    for k in range(len(problem.targets)):
        own = np.flatnonzero(problem.target_index == k)
        columns = by_target[own].reshape(-1, 3)
        step = np.linalg.lstsq(columns, residual[own].ravel(), rcond=1e-9)[0]
        result[own] -= (columns @ step).reshape(residual[own].shape)
    return result
