"""The radius that holds 95 % of an error: closed forms, drawing, and eigenvalues against LAPACK's."""

import numpy as np
import pytest
from numpy.polynomial.chebyshev import chebval2d
from scipy import stats

from zerobeam.analysis.diagnostics import accuracy
from zerobeam.analysis.diagnostics.accuracy import LengthLaw, radius95

CHANCE = 1e-3  # of a test that is right to fail: two sides together


def by_chance(inside, of, share=0.95):
    """Whether so many of so many are what chance makes of that share."""
    return stats.binom.ppf(CHANCE / 2, of, share) <= inside <= stats.binom.isf(CHANCE / 2, of, share)


@pytest.mark.parametrize("dof", [None, 1, 4, 30])
def test_the_radius_of_a_line_a_disc_and_a_ball(dof):
    """Closed forms: chi of as many degrees of freedom as there are equal variances; with Student's t F."""
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    covariance = np.array([turn @ np.diag(3.0**2 * np.arange(3) >= 9 * k) @ turn.T for k in (2, 1, 0)]) * 4.0
    by_f = [np.sqrt(k * stats.f.ppf(0.95, k, dof or 1e12)) for k in (1, 2, 3)]
    np.testing.assert_allclose(radius95(covariance, dof), 2 * np.array(by_f), rtol=2e-4)


def test_no_error_has_no_radius():
    assert radius95(np.zeros((2, 3, 3))).tolist() == [0.0, 0.0]


@pytest.mark.parametrize("dof", [None, 5])
def test_the_radius_with_unequal_variances_by_drawing(dof):
    rng = np.random.default_rng(1)
    std = np.array([[1.0, 0.6, 0.3], [1.0, 0.9, 0.1], [1.0, 0.3, 0.05], [1.0, 0.05, 0.02]])
    radius = radius95(np.array([np.diag(s**2) for s in std]), dof)
    error = rng.normal(size=(4, 100_000, 3)) * std[:, None]
    if dof is not None:
        error /= np.sqrt(rng.chisquare(dof, (4, 100_000, 1)) / dof)
    inside = (np.linalg.norm(error, axis=2) < radius[:, None]).sum(axis=1)
    assert all(by_chance(count, 100_000) for count in inside)
    # Negative control: a ball of the same mean variance would do for none of them.
    ball = np.sqrt((std**2).sum(axis=1) / 3) * radius95(np.eye(3)[None], dof)
    wrong = (np.linalg.norm(error, axis=2) < ball[:, None]).sum(axis=1)
    assert not any(by_chance(count, 100_000) for count in wrong)


def test_the_length_that_95_percent_of_several_errors_stay_below_by_drawing():
    """Of each group of postures together, within the 3 % that the law is good to."""
    rng = np.random.default_rng(3)
    mean = rng.normal(size=(40, 3)) * np.array([2.0, 0.5, 0.1])
    root = rng.normal(size=(40, 3, 3))
    groups = np.repeat([0, 1, 3], [5, 15, 20])
    law = LengthLaw.about(mean, root @ root.transpose(0, 2, 1))
    found = law.pooled_quantile(groups)
    drawn = mean[:, None] + np.einsum("pij,pnj->pni", root, rng.normal(size=(40, 20_000, 3)))
    lengths = np.linalg.norm(drawn, axis=2)
    for group in (0, 1, 3):
        assert found[group] == pytest.approx(np.quantile(lengths[groups == group], 0.95), rel=0.03)
    assert np.isnan(found[2])
    # Negative control: the median of the single radii is another number.
    assert abs(np.median(law.quantile()[groups == 3]) / found[3] - 1) > 0.05
    # One posture alone is the radius of that posture.
    np.testing.assert_allclose(law.pooled_quantile(np.arange(40)), law.quantile(), rtol=3e-3)


def covariances(spectra):
    """Of these eigenvalues, each set turned at random in a hundred ways."""
    rng = np.random.default_rng(2)
    turns = np.linalg.qr(rng.normal(size=(100, 3, 3)))[0]
    result = np.array([q @ np.diag(item) @ q.T for item in spectra for q in turns])
    return (result + result.transpose(0, 2, 1)) / 2


DEGENERATE = [
    [1, 0, 0],
    [1, 1, 0],
    [1, 1, 1],
    [1, 1 - 1e-9, 1e-9],
    [1, 1e-9, 1e-9],
    [1, 2e-16, 1e-16],
    [1e-20, 1e-20, 0],
    [1e12, 1, 1e-12],
]


def test_the_eigenvalues_are_those_of_lapack():
    spectra = [*np.random.default_rng(3).exponential(size=(20, 3)), *DEGENERATE]
    matrices = covariances(spectra)
    exact, result = np.linalg.eigvalsh(matrices).T, accuracy._eigenvalues(matrices)
    assert (np.diff(result, axis=0) >= -1e-15 * result[2]).all()
    assert (np.abs(result - exact) <= 1e-7 * exact[2]).all()


@pytest.mark.parametrize("dof", [None, 5])
def test_the_radius_is_that_by_lapack(dof):
    """Where eigenvalues are equal or nothing, too: a ratio beyond 1 would be far off, as polynomials are."""
    matrices = covariances([*np.random.default_rng(4).exponential(size=(20, 3)), *DEGENERATE])
    std = np.sqrt(np.maximum(np.linalg.eigvalsh(matrices), 0.0)).T
    ratios = 2 * std[1] / std[2] - 1, 2 * std[0] / np.where(std[1] > 0, std[1], 1.0) - 1
    plain = std[2] * chebval2d(*ratios, accuracy._coefficients(dof))
    np.testing.assert_allclose(radius95(matrices, dof), plain, rtol=1e-5)
