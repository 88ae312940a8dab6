"""Which one measurement contradicts the rest: the one without which the others agree best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from ...model.arrays import Matrix
from ..estimation.fit import LikelihoodFit, fit_likelihood

SIGNIFICANT = 1e-3  # after Bonferroni's correction for the number of measurements


@dataclass(frozen=True)
class Suspect:
    """A measurement without which chi-squared falls by more than noise explains; its residual at the fit of
    the others is `residual_mm` long. `p_value` is corrected for the number of measurements."""

    shot: int
    p_value: float
    residual_mm: float


def suspect(fit: LikelihoodFit, dof: int) -> Suspect | None:
    """The measurement that contradicts the others most, None where none does significantly.

    Only by a stated noise, and where the others leave numbers over (`dof` with it) to contradict it.
    """
    problem, size = fit.problem, fit.problem.tool.residual_size
    if not problem.noise.known or dof <= size:
        return None
    numbers = np.arange(problem.shots)
    best: tuple[float, int, float] | None = None
    for i in numbers:
        others = fit_likelihood(problem.select(np.delete(numbers, i)), starts=0)
        fall = _cost(fit.whitened.residual, fit.z) - _cost(others.whitened.residual, others.z)
        if best is None or fall > best[0]:
            at = problem.select(numbers[[i]]).whiten(others.x)
            best = fall, int(i), float(np.linalg.norm(at.residual_mm[0]))
    assert best is not None
    p_value = min(1.0, problem.shots * float(scipy.special.chdtrc(size, max(best[0], 0.0))))
    if p_value >= SIGNIFICANT:
        return None
    return Suspect(problem.shot_numbers[best[1]], p_value, best[2])


def _cost(residual: Matrix, z: Matrix) -> float:
    return float(residual @ residual + z @ z)
