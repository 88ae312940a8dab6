"""Factors of the tolerances: the marginal likelihood a second time, as a normal's density of all numbers."""

from pathlib import Path

import numpy as np
import pytest
from geometry_runs import geometry_run

from zerobeam.analysis.estimation.fit import LikelihoodFit, fit_likelihood
from zerobeam.analysis.estimation.tolerance_factors import _OF_ARM, _OF_GROUP, _kinds, _Linear, _prior_root
from zerobeam.model.arrays import Matrix
from zerobeam.model.likelihood.problem import Problem


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> LikelihoodFit:
    folder: Path = tmp_path_factory.mktemp("factors")
    return fit_likelihood(Problem.from_run(geometry_run(folder)), starts=0)


def marginal(fit: LikelihoodFit, at: Matrix) -> float:
    """Log density of the linearised data, normal about what the priors predict, with the factors' prior."""
    columns = fit.whitened.jacobian[:, fit.problem.parameters.free]
    data = fit.whitened.residual - columns @ fit.z
    kinds = _kinds(fit.problem)
    logarithms = _prior_root(kinds) @ at
    spread = np.exp(2 * (kinds @ logarithms))
    covariance = np.eye(len(data)) + (columns * spread) @ columns.T
    there = logarithms[kinds.any(axis=0)]
    prior = there @ np.linalg.solve(_OF_ARM**2 + _OF_GROUP**2 * np.eye(len(there)), there)
    square = data @ np.linalg.solve(covariance, data)
    return -(square + np.linalg.slogdet(covariance)[1] + prior) / 2


def test_the_evidence_is_the_density_of_the_data(fit: LikelihoodFit) -> None:
    linear, points = _Linear(fit, np.zeros(2)), np.array([[0.0, 0.0], [0.7, 0.0], [0.0, -0.7], [-1.0, 1.0]])
    told = np.array([linear.log_evidence(at) for at in points])
    plain = np.array([marginal(fit, at) for at in points])
    np.testing.assert_allclose(told - told[0], plain - plain[0], rtol=1e-3, atol=1e-3)
    assert np.ptp(told) > 1


def test_the_curvature_is_of_the_evidence(fit: LikelihoodFit) -> None:
    linear, at = _Linear(fit, np.zeros(2)), np.array([-0.5, 0.5])
    curvature = linear.curvature(at)
    assert (np.linalg.eigvalsh(curvature) > 1.5).all()  # the data tell: no bound is met
    for way in ([1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, -1.0]):
        step = 0.05 * np.array(way)
        values = [linear.log_evidence(at + k * step) for k in (-1, 0, 1)]
        assert 2 * values[1] - values[0] - values[2] == pytest.approx(step @ curvature @ step, rel=0.05)


def test_what_the_factors_leave_open_is_the_total_variance(fit: LikelihoodFit) -> None:
    """Over draws of the factors, each with the mode and the variance that it brings."""
    linear, at = _Linear(fit, np.zeros(2)), np.array([-0.5, 0.5])
    root = np.linalg.cholesky(np.linalg.inv(linear.curvature(at)))
    draws = at + np.random.default_rng(0).normal(size=(3000, 2)) @ root.T
    steps, _, information, _ = zip(*(linear._step(draw) for draw in draws), strict=True)
    total = np.mean([np.linalg.inv(each) for each in information], axis=0) + np.cov(np.array(steps).T)
    here = np.linalg.inv(linear._step(at)[2])
    np.testing.assert_allclose(np.diag(here + linear.open_covariance(at)), np.diag(total), rtol=0.05)
    assert (np.diag(total) > 1.02 * np.diag(here)).any()  # else nothing is tested
