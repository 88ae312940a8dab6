"""Whether a calibration by a plan leaves an acceptance test, before any measurement.

The covariance that the plan will leave is that of its information; the test repeats its postures, as many as
a test has at most. More measurements are predicted by repeating the plan's: another plan of so many is at
least about as good.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...model.arrays import Matrix
from ...model.likelihood.problem import Problem
from ..observability.outlook import predicted_covariance
from .acceptance_test import AIM, MOST, POWER, AcceptancePrediction
from .new_measurements import of_rows

_FARTHEST = 8  # times the plan's measurements: what these do not reach, no number does


@dataclass(frozen=True)
class LackingTest:
    """An acceptance test that cannot pass: with `power` at most it would notice that the offset `name` is off
    by the `tolerance` (`unit`). With `needed` measurements it could; None where no number is enough."""

    measurements: int
    name: str
    power: float
    tolerance: float
    unit: str
    needed: int | None


@dataclass(frozen=True, eq=False)
class _PlannedMode:
    x: Matrix
    covariance: Matrix
    weight: float = 1.0


@dataclass(frozen=True, eq=False)
class _PlannedCalibration:
    problem: Problem
    fit: _PlannedMode
    dof: int


def lacking_test(problem: Problem, x: Matrix, tolerance: Mapping[str, float]) -> LackingTest | None:
    """What the test of a calibration by these aimed measurements lacks, at x (p,); None where it can pass.
    `tolerance` by unit: deg, mm."""
    powers = _powers(problem, x, problem.shots, tolerance)
    name = min(powers, key=powers.__getitem__)
    if powers[name] >= POWER:
        return None
    item = problem.parameters.items[problem.parameters.index(name)]
    needed = _needed(problem, x, tolerance)
    return LackingTest(problem.shots, name, powers[name], tolerance[item.unit], item.unit, needed)


def _needed(problem: Problem, x: Matrix, tolerance: Mapping[str, float]) -> int | None:
    """The fewest measurements with which the test has the power that a plan aims at."""

    def enough(count: int) -> bool:
        return min(_powers(problem, x, count, tolerance).values()) >= AIM

    low, high = problem.shots + 1, _FARTHEST * problem.shots
    if not enough(high):
        return None
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle + 1, high)
    return high


def _powers(problem: Problem, x: Matrix, count: int, tolerance: Mapping[str, float]) -> dict[str, float]:
    """The power against an error of the tolerance, by offset that is estimated, after `count` measurements:
    the plan's, again and again."""
    measured = problem.select(np.arange(count) % problem.shots)
    parameters = measured.parameters
    offsets = [item for item in parameters.items if item.group == "offset" and not item.held]
    if not measured.noise_estimable:  # such a run has no answer at all
        return dict.fromkeys((item.name for item in offsets), 0.0)
    mode = _PlannedMode(x, predicted_covariance(measured, x))
    dof = max(measured.measured_size - parameters.without_tolerance, 0)
    rows = np.unique(np.linspace(0, count - 1, MOST).round().astype(int))
    entered = {item.name: 0.0 for item in offsets}
    calibration = _PlannedCalibration(measured, mode, dof)
    prediction = AcceptancePrediction(calibration, of_rows(measured, rows), entered, planned=True)
    predicted = prediction.shifted({})
    return {
        item.name: prediction.power_against(predicted, item.name, tolerance[item.unit]) for item in offsets
    }
