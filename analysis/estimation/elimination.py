"""The targets eliminated from the fit: for given offsets and tool the best targets are in closed form.

A residual is linear in its target. With the weights S^-1 kept, the targets that go with given offsets and
tool are the solution of a linear least-squares problem, and only offsets and tool are left to be searched
(variable projection: Golub & Pereyra 1973, with Kaufman's Jacobian). The weights are refreshed until they
settle. It is exact while the weights are kept: a stated distance between two targets is not linear in them.
"""

from __future__ import annotations

import numpy as np

from ...model.arrays import Index, Mask, Matrix
from ...model.likelihood.density import Density
from ...model.likelihood.problem import Problem, Whitened
from .levenberg_marquardt import least_squares, levenberg_marquardt

_REFRESHES = 30
_SETTLED = 1e-6  # prior stds


def eliminated(problem: Problem, start: Matrix) -> Matrix:
    """x (p,) from `start` (p,): offsets and tool by Levenberg-Marquardt, the targets with them.

    Raises ValueError where the elimination is not exact: stated distances, or noise that is a parameter.
    """
    if problem.distances or problem.noise.separate:
        raise ValueError("targets are not eliminated from stated distances or noise factors")
    parameters = problem.parameters
    targets = parameters.group("target") & parameters.free
    rest = parameters.free & ~targets
    x = start.copy()
    for _ in range(_REFRESHES):
        found = _projected(problem, x, targets, rest)
        moved = np.abs((found - x) / parameters.prior_std)[rest].max(initial=0.0)
        x = found
        if moved < _SETTLED:
            break
    return x


def _projected(problem: Problem, x: Matrix, targets: Mask, rest: Mask) -> Matrix:
    """x (p,) where the weights of `x` are kept."""
    parameters = problem.parameters
    scale, mean = parameters.prior_std, parameters.prior_mean
    factor = problem.whiten(x).factor
    root = float(np.sqrt(Density(problem).noise_weight(x[None])[0]))
    count = int(targets.sum())

    def at(own: Matrix) -> tuple[Whitened, Matrix, Matrix]:
        """At x = own (p,): residuals and the targets' columns, both with the targets' priors below."""
        whitened = problem.whiten(own, factor)
        residuals = np.append(whitened.residual * root, (own - mean)[targets] / scale[targets])
        return whitened, residuals, np.vstack([whitened.jacobian[:, targets] * root, np.eye(count)])

    def with_targets(z: Matrix) -> Matrix:
        """x with offsets and tool at z, and the targets that are best for them."""
        own = x.copy()
        own[rest] = mean[rest] + z * scale[rest]
        _, residuals, columns = at(own)
        own[targets] -= np.linalg.lstsq(columns, residuals, rcond=None)[0] * scale[targets]
        return own

    def residual(z: Matrix, _: Index) -> tuple[Matrix, Matrix]:
        whitened, residuals, columns = at(with_targets(z[0]))
        by_rest = np.vstack([whitened.jacobian[:, rest] * root, np.zeros((count, z.shape[1]))])
        basis, _ = np.linalg.qr(columns)
        by_rest -= basis @ (basis.T @ by_rest)  # what the targets do not take up
        return np.append(residuals, z[0])[None], np.vstack([by_rest, np.eye(z.shape[1])])[None]

    z = (x - mean)[rest] / scale[rest]
    return with_targets(levenberg_marquardt(least_squares(residual), z[None], tolerance=1e-12).x[0])
