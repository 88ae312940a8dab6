"""How far the robot was off at the acceptance postures: as found in its calibration, and as left.

Both are residuals of the controller's model: nominal geometry, joints as the controller reads them, no
offsets. The tool is as the calibration has it. Targets and free frames are where these measurements fit best,
since they may have been moved in between; before and after have as many measurements for them. Errors are
lengths: what an instrument reads of an orientation is not in them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...model.arrays import Matrix
from ...model.likelihood.parameters import Group
from ...model.likelihood.problem import Problem
from ...model.records import record
from ..prediction import Predictor, length_rows, of_rows
from ..solution import Solution
from .acceptance import Anew

# What the calibration has of new measurements, by whether an instrument read what a place is found from.
_CARRIED: dict[bool, tuple[Group, ...]] = {False: ("tool",), True: ("tool", "target", "frame")}
_SAME_POSTURE = np.radians(5.0)  # a target that was moved turns the wrist by no more


@record
class PostureError:
    """One posture: the `measurement` of the new run, that of the calibration there (None where there is
    none), the residuals before and after, and `noise_mm`, their standard deviation by noise alone; mm."""

    measurement: int
    calibration_measurement: int | None
    target: str
    before_mm: float | None
    after_mm: float
    noise_mm: float


@record
class ErrorSize:
    """Of the residuals of several postures, mm."""

    rms_mm: float
    worst_mm: float


@record
class MeasuredError:
    """Residuals of the controller's model before and after; `before` is None unless the calibration has
    measured every posture."""

    postures: tuple[PostureError, ...]
    before: ErrorSize | None
    after: ErrorSize
    noise_mm: float


def measured_error(solution: Solution, recorded: Problem, entered: Mapping[str, float]) -> MeasuredError:
    """Before and after at new measurements, as the corrected robot reads its joints; `entered` are the values
    that were entered, deg (mm) by offset."""
    old, calibration = solution.problem, Predictor.of(solution)
    names = [recorded.targets[k] for k in recorded.target_index.tolist()]
    rows = _calibrated_rows(solution, recorded.joints, names, entered)
    after, noise = _errors(calibration, recorded)
    before: Matrix | None = None
    if all(row is not None for row in rows):
        before, _ = _errors(calibration, of_rows(old, [row for row in rows if row is not None]))
    postures = tuple(
        PostureError(
            recorded.shot_numbers[i],
            None if (row := rows[i]) is None else old.shot_numbers[row],
            names[i],
            None if before is None else float(before[i]),
            float(after[i]),
            float(noise[i]),
        )
        for i in range(len(names))
    )
    return MeasuredError(
        postures,
        None if before is None else _size(before),
        _size(after),
        float(np.sqrt((noise**2).mean())),
    )


def _size(lengths: Matrix) -> ErrorSize:
    return ErrorSize(float(np.sqrt((lengths**2).mean())), float(lengths.max()))


def _calibrated_rows(
    solution: Solution, joints: Matrix, targets: Sequence[str], entered: Mapping[str, float]
) -> list[int | None]:
    """The measurement of the calibration at each posture: the nearest one of the same target."""
    old = solution.problem
    offsets = old.parameters.items[old.parameters.block("offset")]
    applied = np.array([entered.get(item.name, 0.0) / item.display for item in offsets])
    rotates = np.array([joint.kind == "revolute" for joint in old.robot.joints])
    rows: list[int | None] = []
    for reading, target in zip(joints, targets, strict=True):
        apart = np.abs(old.joints + applied - reading)[:, rotates].max(axis=1, initial=0.0)
        apart[[old.targets[k] != target for k in old.target_index]] = np.inf
        nearest = int(apart.argmin())
        rows.append(nearest if apart[nearest] <= _SAME_POSTURE else None)
    return rows


def _errors(calibration: Predictor, recorded: Problem) -> tuple[Matrix, Matrix]:
    """(N,) the lengths of the residuals of nominal geometry without offsets, with targets and frames where
    they fit best, and their standard deviations by the noise; mm."""
    new = Anew.of(calibration, recorded)
    problem = new.problem
    groups = [problem.parameters.group(name) for name in _CARRIED[problem.recorded]]
    x = np.where(np.any(groups, axis=0), calibration.at_mode(problem), problem.nominal())
    whitened = problem.whiten(new.settled(x, length_rows(problem)))
    noise = np.sqrt(problem.length_squares((whitened.factor**2).sum(axis=2)) / calibration.weight)
    return problem.length_mm(whitened.residual_mm), noise
