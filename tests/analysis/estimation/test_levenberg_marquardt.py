import numpy as np
import pytest
from scipy import optimize

from zerobeam.analysis.estimation.levenberg_marquardt import Quadratic, least_squares, levenberg_marquardt


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


def batched(function):
    """The model of a function of one x: (residual (M,), Jacobian (M, f))."""

    def residual(x, rows):
        result = [function(row) for row in x]
        return np.array([r for r, _ in result]), np.array([jacobian for _, jacobian in result])

    return least_squares(residual)


class Single:
    """The one row of Minima."""

    def __init__(self, found):
        self.x, self.cost, self.gradient = found.x[0], float(found.cost[0]), np.abs(found.slope[0]).max()
        self.curvature, self.iterations = found.curvature[0], int(found.iterations[0])
        self.converged, self.reason = bool(found.converged[0]), found.reason[0]


def minimum(function, start, **options):
    return Single(levenberg_marquardt(batched(function), start[None], **options))


def test_rosenbrock_from_the_usual_start():
    result = minimum(rosenbrock, np.array([-1.2, 1.0]))
    assert result.converged
    np.testing.assert_allclose(result.x, [1, 1], atol=1e-9)
    assert result.cost < 1e-18
    assert 0 < result.iterations < 60


def test_powell_singular_function_nears_its_minimum():
    # Convergence is linear there (each step halves x): the cost falls 16-fold a step.
    result = minimum(powell_singular, np.array([3.0, -1.0, 0.0, 1.0]))
    assert result.cost < 1e-20
    np.testing.assert_allclose(result.x, 0, atol=1e-4)


def test_a_linear_problem_is_solved_as_by_lstsq():
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(20, 4)), rng.normal(size=20)
    result = minimum(lambda x: (a @ x - b, a), np.zeros(4))
    np.testing.assert_allclose(result.x, np.linalg.lstsq(a, b, rcond=None)[0], rtol=1e-9, atol=1e-10)
    assert result.converged
    assert result.gradient < 1e-6


def test_residuals_left_over_agree_with_scipy():
    start = np.array([1.0, 1.0, 1.0, 4.0])
    result = minimum(exponentials, start)
    second = optimize.least_squares(
        lambda x: exponentials(x)[0],
        start,
        jac=lambda x: exponentials(x)[1],
        method="lm",
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
    )
    assert result.converged
    assert second.cost > 1e-3
    np.testing.assert_allclose(result.x, second.x, rtol=1e-6)
    assert result.cost == pytest.approx(second.cost, rel=1e-12)


def test_at_the_minimum_it_stays():
    result = minimum(rosenbrock, np.array([1.0, 1.0]))
    assert result.converged
    assert result.iterations == 0
    np.testing.assert_array_equal(result.x, [1.0, 1.0])


def test_a_trial_that_is_not_finite_is_stepped_back_from():
    def root(x):
        with np.errstate(invalid="ignore"):
            return np.array([np.sqrt(x[0]) - 0.1]), np.array([[0.5 / np.sqrt(abs(x[0]))]])

    # From 4 the full step goes to -3.6, where the root is nan.
    result = minimum(root, np.array([4.0]))
    assert result.converged
    assert result.x[0] == pytest.approx(0.01, rel=1e-6)


def test_the_start_is_not_written_into():
    start = np.array([-1.2, 1.0])
    minimum(rosenbrock, start)
    np.testing.assert_array_equal(start, [-1.2, 1.0])


def test_units_do_not_matter():
    """With other units of the unknowns every step is the same: D is the diagonal of J'J, not I."""
    scale = np.array([1e-3, 1.0, 1e4, 10.0])

    def scaled(z):
        residual, jacobian = exponentials(z * scale)
        return residual, jacobian * scale

    start = np.array([1.0, 1.0, 1.0, 4.0])
    plain = minimum(exponentials, start)
    other = minimum(scaled, start / scale)
    assert other.iterations == plain.iterations
    np.testing.assert_allclose(other.x * scale, plain.x, rtol=1e-7)


def test_a_column_of_zeros_does_no_harm():
    result = minimum(lambda x: (np.array([x[0] - 2.0, 0.5]), np.array([[1.0, 0.0], [0.0, 0.0]])), np.zeros(2))
    assert result.converged
    np.testing.assert_allclose(result.x, [2, 0], atol=1e-9)


STARTS = np.array([[-1.2, 1.0], [3.0, -4.0], [0.0, 0.0], [1.0, 1.0], [-5.0, 7.0], [30.0, -10.0], [2.0, 2.0]])


def assert_same_row(many, row, one):
    for name in ("x", "cost", "slope", "curvature", "iterations", "converged", "reason"):
        np.testing.assert_array_equal(getattr(many, name)[row], getattr(one, name)[0], err_msg=name)


def test_a_row_does_not_know_which_rows_are_beside_it():
    """To the last bit: alone, together, and in another order."""
    model = batched(rosenbrock)
    together = levenberg_marquardt(model, STARTS)
    assert together.converged.all()
    np.testing.assert_allclose(together.x, 1.0, atol=1e-7)
    assert len(set(together.iterations)) > 3  # they do not end together
    order = np.array([4, 0, 6, 2, 5, 1, 3])
    shuffled = levenberg_marquardt(model, STARTS[order])
    for row, start in enumerate(STARTS):
        alone = levenberg_marquardt(model, start[None])
        assert_same_row(together, row, alone)
        assert_same_row(shuffled, int(np.flatnonzero(order == row)[0]), alone)


def test_the_model_is_told_which_rows_it_is_asked_for():
    """Each row has a problem of its own: |x - a_row|; also when others have ended."""
    rng = np.random.default_rng(3)
    centre = rng.normal(size=(6, 3))
    requests = []

    def model(x, rows):
        requests.append(rows.copy())
        away = x - centre[rows]
        # A quartic: the further away the start, the more steps.
        square = (away**2).sum(axis=1)
        curvature = square[:, None, None] * np.eye(3) + 2 * away[:, :, None] * away[:, None, :]
        return Quadratic(square**2 / 4, square[:, None] * away, curvature + 1e-12 * np.eye(3))

    start = centre + np.geomspace(1e-2, 1e2, 6)[:, None] * np.array([1.0, -1, 0.5])
    result = levenberg_marquardt(model, start, absolute=1e-12)
    np.testing.assert_allclose(result.x, centre, atol=1e-2)
    np.testing.assert_array_equal(requests[0], np.arange(6))
    assert any(0 < len(rows) < 6 for rows in requests)
    assert all(len(np.unique(rows)) == len(rows) for rows in requests)


def test_a_row_that_starts_at_no_number_stays_and_hurts_no_other():
    model = batched(rosenbrock)
    starts = STARTS[:4].copy()
    starts[1] = np.nan
    result = levenberg_marquardt(model, starts)
    assert not result.converged[1]
    assert "not finite" in result.reason[1]
    assert result.iterations[1] == 0
    assert np.isnan(result.x[1]).all()
    for row in (0, 2, 3):
        assert_same_row(result, row, levenberg_marquardt(model, starts[row : row + 1]))
    # All of them, and none at all.
    assert not levenberg_marquardt(model, np.full((2, 2), np.nan)).converged.any()
    none = levenberg_marquardt(
        lambda x, rows: Quadratic(np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2, 2))), np.zeros((0, 2))
    )
    assert none.x.shape == (0, 2)


@pytest.mark.parametrize("damage", ["singular", "no number"])
def test_a_row_without_a_step_does_not_take_it_from_the_others(damage):
    """One curvature that cannot be solved for: LAPACK refuses the whole stack."""
    plain = batched(rosenbrock)

    def model(x, rows):
        cost, gradient, curvature = plain(x, rows)
        # Damping scales the diagonal: this stays singular, whatever mu.
        bad = np.full((2, 2), np.nan) if damage == "no number" else np.array([[1.0, 2.0], [0.0, 0.0]])
        curvature[rows == 1] = bad
        gradient[rows == 1] = [0.0, 1e-300] if damage == "singular" else 1.0
        return Quadratic(cost, gradient, curvature)

    result = levenberg_marquardt(model, STARTS[:4])
    np.testing.assert_array_equal(result.x[1], STARTS[1])
    for row in (0, 2, 3):
        assert_same_row(result, row, levenberg_marquardt(plain, STARTS[row : row + 1]))


def test_rows_that_are_not_finished_are_told_beside_those_that_are():
    result = levenberg_marquardt(batched(rosenbrock), STARTS[[0, 3]], max_iterations=3)
    np.testing.assert_array_equal(result.converged, [False, True])
    np.testing.assert_array_equal(result.iterations, [3, 0])
    assert "3 iterations" in result.reason[0]
    assert "at a minimum" in result.reason[1]


def test_the_smallest_gain_worth_a_step():
    """With `absolute`, a row ends where its step promises less."""
    rough = minimum(exponentials, np.array([1.0, 1.0, 1.0, 4.0]), absolute=1e-3)
    fine = minimum(exponentials, np.array([1.0, 1.0, 1.0, 4.0]))
    assert rough.converged
    assert rough.iterations < fine.iterations
    assert 0 < rough.cost - fine.cost < 1e-2


def test_no_step_is_longer_than_the_longest():
    """And the minimum is the same."""
    trials = []

    def watched(x):
        trials.append(x.copy())
        return rosenbrock(x)

    longest = np.array([0.05, 0.2])
    result = minimum(watched, np.array([-1.2, 1.0]), longest=longest)
    assert result.converged
    np.testing.assert_allclose(result.x, [1, 1], atol=1e-8)
    free = minimum(rosenbrock, np.array([-1.2, 1.0]))
    assert result.iterations > free.iterations
    # From what was accepted to the trial: no further than stated, and sometimes just that.
    at, cost, steps = trials[0], np.inf, []
    for trial in trials:
        steps.append(np.abs(trial - at) / longest)
        values = (rosenbrock(trial)[0] ** 2).sum()
        if values < cost:
            at, cost = trial, values
    assert np.max(steps) == pytest.approx(1.0, abs=1e-9)


def test_least_squares_is_gauss_and_newtons_model():
    """Cost, gradient and J'J; the gradient by differences."""
    x = np.array([[0.3, -0.7], [2.0, 1.0]])
    cost, gradient, curvature = batched(rosenbrock)(x, np.arange(2))
    for row in range(2):
        residual, jacobian = rosenbrock(x[row])
        assert cost[row] == pytest.approx(residual @ residual / 2)
        np.testing.assert_allclose(curvature[row], jacobian.T @ jacobian)
        for j, step in enumerate(1e-6 * np.eye(2)):
            up, down = rosenbrock(x[row] + step)[0], rosenbrock(x[row] - step)[0]
            slope = (up @ up - down @ down) / 2 / 2e-6
            assert gradient[row, j] == pytest.approx(slope, rel=1e-6)
