"""How far the robot was off at the acceptance postures: as found in its calibration, and as left.

Both are residuals of the controller's model: nominal geometry, joints as the controller reads them, no
offsets. The tool is as the calibration has it. The targets are where these measurements fit best, since they
may have been moved in between; before and after have as many measurements for them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...model.arrays import Matrix
from ...model.files.header import Header
from ...model.likelihood.problem import Problem
from ..solution import Solution

_STEPS = 5  # Gauss and Newton's, for the targets
_SAME_POSTURE = np.radians(5.0)  # a target that was moved turns the wrist by no more


@dataclass(frozen=True)
class PostureError:
    """One posture: the `measurement` of the new run, that of the calibration there (None where there is
    none), the residuals before and after, and `noise_mm`, their standard deviation by noise alone; mm."""

    measurement: int
    calibration_measurement: int | None
    target: str
    before_mm: float | None
    after_mm: float
    noise_mm: float


@dataclass(frozen=True)
class ErrorSize:
    """Of the residuals of several postures, mm."""

    rms_mm: float
    worst_mm: float


@dataclass(frozen=True)
class MeasuredError:
    """Residuals of the controller's model before and after; `before` is None unless the calibration has
    measured every posture."""

    postures: tuple[PostureError, ...]
    before: ErrorSize | None
    after: ErrorSize
    noise_mm: float


def measured_error(
    solution: Solution,
    header: Header,
    joints: Matrix,
    targets: Sequence[str],
    spots: Matrix | None,
    entered: Mapping[str, float],
) -> MeasuredError:
    """Before and after at new measurements: `joints` (N, n) rad or mm as the corrected robot reads them, the
    `targets` of each, `spots` (N, 2) mm; `header` is that of the calibration with these targets, `entered`
    are the values that were entered, deg (mm) by offset."""
    old = solution.problem
    rows = _calibrated_rows(solution, joints, targets, entered)
    after, noise = _residuals(solution, header, joints, targets, spots)
    before: Matrix | None = None
    if all(row is not None for row in rows):
        at = [row for row in rows if row is not None]
        before, _ = _residuals(
            solution, header, old.joints[at], targets, None if spots is None else old.spots[at]
        )
    lengths = np.linalg.norm(after, axis=1)
    lengths_before = None if before is None else np.linalg.norm(before, axis=1)
    postures = tuple(
        PostureError(
            i,
            rows[i],
            targets[i],
            None if lengths_before is None else float(lengths_before[i]),
            float(lengths[i]),
            float(noise[i]),
        )
        for i in range(len(joints))
    )
    return MeasuredError(
        postures,
        None if before is None else _size(before),
        _size(after),
        float(np.sqrt((noise**2).mean())),
    )


def _size(residual: Matrix) -> ErrorSize:
    return ErrorSize(
        float(np.sqrt((residual**2).sum(axis=1).mean())), float(np.linalg.norm(residual, axis=1).max())
    )


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


def _residuals(
    solution: Solution, header: Header, joints: Matrix, targets: Sequence[str], spots: Matrix | None
) -> tuple[Matrix, Matrix]:
    """Residuals (N, d) of nominal geometry without offsets, the targets where they fit best, and the standard
    deviation (N,) of their lengths by the noise; mm."""
    old, problem = solution.problem, Problem.build(header, solution.problem.robot, joints, targets, spots)
    x = problem.nominal()
    for item in old.parameters.items:
        if item.group in ("tool", "noise"):
            x[problem.parameters.index(item.name)] = solution.fit.x[old.parameters.index(item.name)]
    problem, x = problem.with_noise_of(x)
    target = problem.parameters.block("target")
    x[target] = problem.nearest_targets(x[None])[0]
    for _ in range(_STEPS):
        whitened = problem.whiten(x)
        by = whitened.jacobian[: whitened.residual_mm.size, target].reshape(*whitened.residual_mm.shape, -1)
        by_mm = (whitened.factor @ by).reshape(whitened.residual_mm.size, -1)
        step = np.linalg.lstsq(by_mm, whitened.residual_mm.ravel(), rcond=None)[0]
        x[target] -= step * problem.parameters.prior_std[target]
    whitened = problem.whiten(x)
    noise = np.linalg.norm(whitened.factor, axis=(1, 2)) / np.sqrt(solution.fit.weight)
    return whitened.residual_mm, noise
