"""Effective degrees of freedom: closed forms of Welch and Satterthwaite."""

import numpy as np
import pytest
from cells import TABLE_2, good_plan, simulated_problem

from zerobeam.analysis.estimation import effective_dof as module
from zerobeam.analysis.estimation.effective_dof import effective_dof, gains, noise_dof
from zerobeam.analysis.estimation.fit import fit_likelihood


def fitted(**noise):
    _, problem = simulated_problem(good_plan(12, noise=noise), TABLE_2, seed=4)
    return fit_likelihood(problem, starts=0)


def test_of_an_estimated_noise_and_exact_geometry_they_are_numbers_less_unknowns():
    fit = fitted(scale="estimated")
    numbers, unknowns = 2 * fit.problem.shots, int(fit.problem.parameters.free.sum())
    assert noise_dof(fit) == pytest.approx(numbers - unknowns, rel=0.01)
    np.testing.assert_allclose(effective_dof(fit), numbers - unknowns, rtol=0.05)


def test_of_a_known_noise_they_are_infinite():
    assert np.isinf(effective_dof(fitted(scale="known"))).all()


def test_of_two_parts_they_are_those_of_welch_and_satterthwaite(monkeypatch):
    """u² = a + b of scales that are known by ν_a and ν_b degrees of freedom: u⁴ / (a²/ν_a + b²/ν_b)."""
    fit = fitted(scale="separate")
    dof_a, dof_b = 7.0, 11.0
    monkeypatch.setattr(module, "log_scales", lambda fit: np.diag([1 / (2 * dof_a), 1 / (2 * dof_b)]))
    each, of_noise = gains(fit), fit.problem.variances(fit.x)
    n = fit.problem.robot.n
    for k, u2 in enumerate(np.diag(fit.covariance)):
        a = sum(each.by_joint[i, k, j] ** 2 * of_noise[j] for i in range(fit.problem.shots) for j in range(n))
        b = sum(each.by_spot[i, k, j] ** 2 * of_noise[n] for i in range(fit.problem.shots) for j in range(2))
        expected = u2**2 / (a**2 / dof_a + b**2 / dof_b) if a + b else np.inf
        assert effective_dof(fit)[k] == pytest.approx(expected, rel=1e-9)
