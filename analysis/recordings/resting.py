"""Joints that do not move between measurements: their errors are common to these, and shift all residuals.

The noise of a joint is stated for each reading. Of a joint that rests over some postures the error stays what
it is: as large as stated, but one for all of them. A slip of the target or the instrument looks much like it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...model.arrays import Index, Matrix
from ...model.likelihood.problem import Problem
from ..estimation.fit import LikelihoodFit

_RESTS = 0.5  # of its noise: a joint that is read within so little has not moved
_LARGEST = 4.0  # standard deviations of an error: a larger one is none of the stated noise
_MOST = 200  # joints' rests
_FEWEST = 3  # measurements of a rest


def rests(problem: Problem) -> Iterator[tuple[int, Index]]:
    """Each joint with the rows of measurements, one after the other, over which it rests; not where it rests
    over all: its error is then a part of its offset."""
    joints, count = problem.joints, problem.shots
    for joint in range(problem.robot.n):
        still = _RESTS * problem.noise.joint[joint]
        first = 0
        for row in range(1, count + 1):
            if row < count and np.ptp(joints[first : row + 1, joint]) <= still:
                continue
            if _FEWEST <= row - first < count:
                yield joint, np.arange(first, row)
            first = row


def resting_columns(fit: LikelihoodFit) -> Matrix | None:
    """(M, g) what a common error of one standard deviation of each resting joint does to the whitened
    residuals at the mode, of those whose error the stated noise allows. None without any."""
    problem, d = fit.problem, fit.problem.tool.residual_size
    every = sorted(rests(problem), key=lambda one: -len(one[1]))[:_MOST]
    if not every:
        return None
    whitened, parameters = fit.whitened, problem.parameters
    columns = np.zeros((len(whitened.residual), len(every)))
    for k, (joint, rows) in enumerate(every):
        at = (rows[:, None] * d + np.arange(d)).ravel()
        std = problem.noise.joint[joint] / parameters.prior_std[joint]
        columns[at, k] = whitened.jacobian[at, joint] * std
    free = whitened.jacobian[:, parameters.free]
    for _ in range(3):
        both = np.hstack([free, columns])
        rows = np.vstack([both, np.eye(both.shape[1])])
        left = np.append(whitened.residual, np.append(fit.z, np.zeros(columns.shape[1])))
        errors = -np.linalg.lstsq(rows, left, rcond=None)[0][free.shape[1] :]
        allowed = np.abs(errors) <= _LARGEST
        if allowed.all():
            break
        columns = columns[:, allowed]
    return columns if columns.shape[1] else None
