import numpy as np
import pytest
from scipy.optimize import least_squares

from zerobeam.analysis.levenberg_marquardt import levenberg_marquardt


def rosenbrock(x):
    residual = np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])
    return residual, np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])


def powell_singular(x):
    """Powell's function: its Jacobian is singular at the minimum, the origin."""
    a, b, c, d = x
    s5, s10 = np.sqrt(5), np.sqrt(10)
    residual = np.array([a + 10 * b, s5 * (c - d), (b - 2 * c) ** 2, s10 * (a - d) ** 2])
    jacobian = np.array(
        [
            [1, 10, 0, 0],
            [0, 0, s5, -s5],
            [0, 2 * (b - 2 * c), -4 * (b - 2 * c), 0],
            [2 * s10 * (a - d), 0, 0, -2 * s10 * (a - d)],
        ]
    )
    return residual, jacobian


def exponentials(x):
    """A sum of two decays with noise: a minimum with residuals left."""
    t = np.linspace(0, 4, 25)
    y = 2 * np.exp(-0.7 * t) + 1.5 * np.exp(-3 * t) + 0.2 * np.sin(37 * t)
    first, second = np.exp(-x[1] * t), np.exp(-x[3] * t)
    jacobian = np.array([first, -x[0] * t * first, second, -x[2] * t * second]).T
    return x[0] * first + x[2] * second - y, jacobian


def test_rosenbrock_from_the_usual_start():
    found = levenberg_marquardt(rosenbrock, np.array([-1.2, 1.0]))
    assert found.converged
    np.testing.assert_allclose(found.x, [1, 1], atol=1e-9)
    assert found.cost < 1e-18
    assert 0 < found.iterations < 60


def test_powell_singular_function_nears_its_minimum():
    # Convergence is linear there (each step halves x): the cost falls 16-fold a step.
    found = levenberg_marquardt(powell_singular, np.array([3.0, -1.0, 0.0, 1.0]))
    assert found.cost < 1e-20
    np.testing.assert_allclose(found.x, 0, atol=1e-4)


def test_a_linear_problem_is_solved_as_by_lstsq():
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(20, 4)), rng.normal(size=20)
    found = levenberg_marquardt(lambda x: (a @ x - b, a), np.zeros(4))
    np.testing.assert_allclose(found.x, np.linalg.lstsq(a, b, rcond=None)[0], rtol=1e-9, atol=1e-10)
    assert found.converged
    assert found.gradient < 1e-6


def test_residuals_left_over_agree_with_scipy():
    start = np.array([1.0, 1.0, 1.0, 4.0])
    found = levenberg_marquardt(exponentials, start)
    second = least_squares(
        lambda x: exponentials(x)[0],
        start,
        jac=lambda x: exponentials(x)[1],
        method="lm",
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
    )
    assert found.converged
    assert second.cost > 1e-3
    np.testing.assert_allclose(found.x, second.x, rtol=1e-6)
    assert found.cost == pytest.approx(second.cost, rel=1e-12)


def test_at_the_minimum_it_stays():
    found = levenberg_marquardt(rosenbrock, np.array([1.0, 1.0]))
    assert found.converged
    assert found.iterations == 0
    np.testing.assert_array_equal(found.x, [1.0, 1.0])


def test_a_start_that_is_not_finite_is_a_value_and_no_exception():
    found = levenberg_marquardt(lambda x: (np.array([np.nan]), np.zeros((1, 1))), np.zeros(1))
    assert not found.converged
    assert "not finite" in found.reason


def test_a_trial_that_is_not_finite_is_stepped_back_from():
    def root(x):
        with np.errstate(invalid="ignore"):
            return np.array([np.sqrt(x[0]) - 0.1]), np.array([[0.5 / np.sqrt(abs(x[0]))]])

    # From 4 the full step goes to -3.6, where the root is nan.
    found = levenberg_marquardt(root, np.array([4.0]))
    assert found.converged
    assert found.x[0] == pytest.approx(0.01, rel=1e-6)


def test_too_few_iterations_are_told():
    found = levenberg_marquardt(rosenbrock, np.array([-1.2, 1.0]), max_iterations=3)
    assert not found.converged
    assert found.iterations == 3
    assert "3 iterations" in found.reason


def test_the_start_is_not_written_into():
    start = np.array([-1.2, 1.0])
    levenberg_marquardt(rosenbrock, start)
    np.testing.assert_array_equal(start, [-1.2, 1.0])


def test_units_do_not_matter():
    """With other units of the unknowns every step is the same: D is the diagonal of J'J, not I."""
    scale = np.array([1e-3, 1.0, 1e4, 10.0])

    def scaled(z):
        residual, jacobian = exponentials(z * scale)
        return residual, jacobian * scale

    start = np.array([1.0, 1.0, 1.0, 4.0])
    plain = levenberg_marquardt(exponentials, start)
    other = levenberg_marquardt(scaled, start / scale)
    assert other.iterations == plain.iterations
    np.testing.assert_allclose(other.x * scale, plain.x, rtol=1e-7)


def test_a_wrong_jacobian_finds_no_minimum():
    """Negative control: the tests above can fail."""

    def wrong(x):
        residual, jacobian = rosenbrock(x)
        return residual, jacobian * [[1, 1], [-1, 1]]

    found = levenberg_marquardt(wrong, np.array([-1.2, 1.0]))
    assert not np.allclose(found.x, [1, 1], atol=1e-3)


def test_a_column_of_zeros_does_no_harm():
    found = levenberg_marquardt(
        lambda x: (np.array([x[0] - 2.0, 0.5]), np.array([[1.0, 0.0], [0.0, 0.0]])), np.zeros(2)
    )
    assert found.converged
    np.testing.assert_allclose(found.x, [2, 0], atol=1e-9)
