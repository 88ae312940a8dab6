"""The offsets of a run from its measurements, without any prior.

A prior pulls every estimate of a weakly observable offset to the same place, and so makes runs agree that do
not. Here it is taken out again.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...model.density import Density
from ...model.robot import Matrix
from ..estimation.fit import LikelihoodFit
from ..observability.identifiability import information_root

_ROUNDING = 1e-11  # as in `identifiability`


def without_prior(fit: LikelihoodFit, columns: Sequence[int]) -> tuple[Matrix, Matrix]:
    """Values (m,) and covariance (m, m) at noise scale 1 of the parameters `columns`, internal units, by
    measurements and distances without any prior. They must be identifiable (or weakly so).

    At the mode the gradient of the log-likelihood is the negative of the log-prior's, which is z: one Newton
    step of the likelihood alone takes the prior out (exact for a linear problem). All other unknowns are
    eliminated (Schur complement), so that they may be unidentifiable.
    """
    problem, parameters = fit.problem, fit.problem.parameters
    _, root, _ = information_root(problem, fit.x, 1.0)
    own = parameters.among_free[list(columns)]
    rest = np.setdiff1d(np.arange(root.shape[1]), own)
    length = np.linalg.norm(root[:, rest], axis=0)
    length[length == 0] = 1.0
    by_rest = np.linalg.lstsq(root[:, rest] / length, root[:, own], rcond=_ROUNDING)[0] / length[:, None]
    left = root[:, own] - root[:, rest] @ by_rest
    covariance = np.linalg.inv(left.T @ left)
    weight = float(Density(problem).noise_weight(fit.x[None])[0])
    # A tolerance of the geometry is knowledge, which stays.
    pulled = np.where(parameters.group("geometry")[parameters.free], 0.0, fit.z)
    step = covariance @ (pulled[own] - by_rest.T @ pulled[rest]) / weight
    scale = parameters.prior_std[list(columns)]
    value = fit.x[list(columns)] + step * scale
    return value, np.asarray(covariance * np.outer(scale, scale))
