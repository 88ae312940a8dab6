"""What each shot does to the answer: leave-one-out misses and Cook's distances, at the linearised fit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..model.problem import Problem
from ..model.robot import Matrix
from .fit import LikelihoodFit

_DETERMINES_ITSELF = 1.0 - 1e-4


class Influence(NamedTuple):
    """Per shot (N,): `whitened` miss in its own stds, `leave_one_out` miss in mm as the other shots
    predict it (nan where they cannot), `cooks` distance (nan likewise)."""

    whitened: Matrix
    leave_one_out: Matrix
    cooks: Matrix


def influence(problem: Problem, fit: LikelihoodFit) -> Influence:
    """From the hat matrix H_i = A_i C A_i' of each shot (Cook & Weisberg 1982, chapters 2 and 3)."""
    d, rows = problem.tool.miss_size, problem.shots * problem.tool.miss_size
    root = np.sqrt(fit.weight)
    blocks = fit.whitened.jacobian[:rows, problem.parameters.free].reshape(problem.shots, d, -1) * root
    residual = fit.whitened.residual[:rows].reshape(problem.shots, d) * root
    hat = blocks @ fit.covariance @ blocks.transpose(0, 2, 1)
    fixed = np.linalg.eigvalsh(hat).max(axis=1) > _DETERMINES_ITSELF
    open_part = np.eye(d) - np.where(fixed[:, None, None], 0.0, hat)
    predicted = np.linalg.solve(open_part, residual[:, :, None])
    cooks = (predicted.transpose(0, 2, 1) @ hat @ predicted)[:, 0, 0] / blocks.shape[2]
    length = np.linalg.norm((fit.whitened.factor @ predicted)[:, :, 0] / root, axis=1)
    return Influence(
        np.linalg.norm(residual, axis=1), np.where(fixed, np.nan, length), np.where(fixed, np.nan, cooks)
    )
