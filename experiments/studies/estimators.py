"""The estimators of the coverage study, and controls whose intervals must not hold the truth."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...analysis.estimation.fit import Fits
from ...analysis.estimation.midpoint import fit_midpoints
from ...model.arrays import Index, Matrix
from ...model.likelihood.geometry import NOMINAL
from ...model.likelihood.parameters import Parameters
from .data_sets import DataSets, fitted

_PINV = 1e-12  # of J'J: directions below 1e-6 of the largest singular value are dropped, as is customary


@dataclass(frozen=True, eq=False)
class Estimates:
    """Of m offsets: estimates and standard uncertainties (W, m), internal units; `kept` (W,) says which data
    sets converged. A `control` is wrong on purpose."""

    name: str
    words: str
    control: bool
    value: Matrix
    std: Matrix
    kept: NDArray[np.bool_]


def likelihood(data: DataSets, fits: Fits, which: Index) -> Estimates:
    """The intervals from the curvature at the modes, of the parameters `which` (m,)."""
    words = "likelihood fit, intervals from the curvature"
    return _of_fits("likelihood", words, False, data.problem.parameters, fits, which)


def understated(data: DataSets, which: Index) -> Estimates:
    """Control: the likelihood fit with half of the true noise."""
    noise = data.problem.noise
    half = replace(data.problem, noise=replace(noise, joint=noise.joint / 2, spot=noise.spot / 2))
    fits = fitted(replace(data, problem=half))
    words = "control: the noise stated as half of what it is"
    return _of_fits("noise understated by 2", words, True, half.parameters, fits, which)


def midpoint(data: DataSets, which: Index) -> Estimates:
    """The paper's cost (eq. 8) with the sandwich covariance; its geometry is nominal, as in the paper."""
    problem = data.problem.with_geometry(NOMINAL)  # the offsets stay where they are: they come first
    fits = fit_midpoints(problem, data.joints)
    at = (np.cumsum(fits.free) - 1)[which]  # the targets are no part of this fit
    variance = np.diagonal(fits.covariance, axis1=1, axis2=2)[:, at]
    std = np.sqrt(variance) * problem.parameters.prior_std[which]
    words = "midpoint fit of the paper (eq. 8), intervals from its sandwich covariance"
    return Estimates("midpoint", words, False, fits.x[:, which], std, fits.converged)


def pseudo_inverse(data: DataSets, fits: Fits, which: Index) -> Estimates:
    """Control: the same estimates with the covariance pinv(J'J), as truncating solvers give it."""
    problem, free = data.problem, data.problem.parameters.free
    at = problem.parameters.among_free[which]
    scale = problem.parameters.prior_std
    std = np.empty((len(fits.x), len(which)))
    for row, (x, joints, spots) in enumerate(zip(fits.x, data.joints, data.spots, strict=True)):
        jacobian = problem.moved(joints, spots).whiten(x).jacobian[:, free]
        std[row] = np.sqrt(np.diag(np.linalg.pinv(jacobian.T @ jacobian, rcond=_PINV, hermitian=True))[at])
    words = "control: the same fit with a pseudo-inverse for a covariance"
    return Estimates(
        "pseudo-inverse covariance", words, True, fits.x[:, which], std * scale[which], fits.converged
    )


def _of_fits(
    name: str, words: str, control: bool, parameters: Parameters, fits: Fits, which: Index
) -> Estimates:
    at = parameters.among_free[which]
    std = fits.std[:, at] * parameters.prior_std[which]
    return Estimates(name, words, control, fits.x[:, which], std, fits.converged)
