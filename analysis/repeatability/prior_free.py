"""The offsets of a run from its measurements, without any prior.

A prior pulls every estimate of a weakly observable offset to the same place, and so makes runs agree that do
not. Here it is taken out again.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...model.arrays import Matrix
from ...model.likelihood.density import Density
from ..covariance import OffsetsWithoutPrior
from ..estimation.fit import LikelihoodFit
from ..observability.gauges import ROUNDING, information_root
from ..solution import Solution


class WithoutPrior(NamedTuple):
    """Parameters without any prior, internal units: `value` (m,), `covariance` (m, m) by the noise alone at
    noise scale 1, and `by_geometry` (m, g) what each geometry parameter adds, if it is one tolerance off."""

    value: Matrix
    covariance: Matrix
    by_geometry: Matrix


def without_prior(fit: LikelihoodFit, columns: Sequence[int]) -> WithoutPrior:
    """The parameters `columns` by measurements, distances and tolerances of the geometry, without any prior.
    They must be identifiable (or weakly so).

    At the mode the gradient of the log-likelihood is the negative of the log-prior's, which is z: one Newton
    step of the likelihood alone takes the prior out (exact for a linear problem). All other unknowns are
    eliminated (Schur complement), so that they may be unidentifiable. The rows of the least squares are those
    of the noise, then those of the tolerances: so are the columns of its pseudo-inverse.
    """
    problem, parameters = fit.problem, fit.problem.parameters
    _, root, _ = information_root(problem, fit.x, fit.weight)
    selected = parameters.among_free[list(columns)]
    rest = np.setdiff1d(np.arange(root.shape[1]), selected)
    length = np.linalg.norm(root[:, rest], axis=0)
    length[length == 0] = 1.0
    by_rest = np.linalg.lstsq(root[:, rest] / length, root[:, selected], rcond=ROUNDING)[0] / length[:, None]
    left = root[:, selected] - root[:, rest] @ by_rest
    covariance = np.linalg.inv(left.T @ left)
    by_row = covariance @ left.T
    by_noise, by_geometry = np.split(by_row, [len(left) - len(problem.tolerated)], axis=1)
    # A tolerance of the geometry is knowledge, which stays.
    pulled = np.where(parameters.tolerated[parameters.free], 0.0, fit.z)
    at_mode = float(Density(problem).noise_weight(fit.x[None])[0])
    step = covariance @ (pulled[selected] - by_rest.T @ pulled[rest]) * fit.weight / at_mode
    scale = parameters.prior_std[list(columns)]
    noise = fit.weight * np.asarray(by_noise @ by_noise.T)
    return WithoutPrior(
        fit.x[list(columns)] + step * scale, noise * np.outer(scale, scale), by_geometry * scale[:, None]
    )


def offsets_without_prior(solution: Solution) -> OffsetsWithoutPrior | None:
    """The offsets that the measurements determine, without any prior; None where there is none."""
    problem, parameters = solution.problem, solution.problem.parameters
    indices = range(*parameters.block("offset").indices(len(parameters)))
    columns = [column for column in indices if column in solution.known]
    if not columns:
        return None
    free_of_prior, display = without_prior(solution.fit, columns), parameters.display[columns]
    covariance = free_of_prior.covariance * np.outer(display, display) * solution.noise_scale**2
    return OffsetsWithoutPrior(
        names=tuple(parameters.names[column] for column in columns),
        units=tuple(parameters.items[column].unit for column in columns),
        status=tuple(solution.status[column] for column in columns),
        values=tuple((free_of_prior.value * display).tolist()),
        covariance=tuple(map(tuple, covariance.tolist())),
        geometry=tuple(parameters.names[column] for column in problem.tolerated),
        by_geometry=tuple(map(tuple, (free_of_prior.by_geometry * display[:, None]).tolist())),
        dof=None if problem.noise.known else max(solution.dof, 1),
    )
