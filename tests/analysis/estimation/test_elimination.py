import numpy as np
import pytest
from cells import (
    OPEN_LASER,
    OPEN_PROBE,
    PROBE,
    TABLE_2,
    good_plan,
    header,
    pattern_plan,
    plan_of,
    simulated_problem,
)
from scipy import optimize

from zerobeam.analysis.estimation.fit import eliminated, fit_likelihood, start_at
from zerobeam.model.likelihood.density import Density


def two_targets():
    made_header = header(targets={"a": {"guess_mm": [900, 0, 0]}, "b": {"guess_mm": [900, 0, 0]}})
    return plan_of(made_header, good_plan(12).postures, ["a", "b"] * 6)


PLANS = {
    "good": (good_plan, TABLE_2),
    "weak": (lambda: pattern_plan("y", 150.0), TABLE_2),
    "open laser": (lambda: good_plan(12, tool=OPEN_LASER), TABLE_2),
    "probe": (lambda: good_plan(12, 5, PROBE), {"delta2": 0.5, "delta4": -0.8}),
    "open probe": (lambda: good_plan(12, 5, OPEN_PROBE), {"delta2": 0.5, "delta4": -0.8}),
    "estimated": (lambda: good_plan(12, noise={"scale": "estimated"}), TABLE_2),
    "two targets": (two_targets, TABLE_2),
}


@pytest.fixture(scope="module", params=PLANS)
def run(request):
    plan, values = PLANS[request.param]
    _, problem = simulated_problem(plan(), values, seed=3)
    start = start_at(problem, np.zeros((1, Density(problem).size)))[0]
    return problem, start, fit_likelihood(problem, starts=0)


def in_stds(problem, fit, one, other):
    free = problem.parameters.free
    return np.abs((one - other)[free] / problem.parameters.prior_std[free] / fit.std).max()


def by_scipy(problem, start, moving):
    """Ordinary least squares of misses and priors over the parameters `moving`, weights refreshed till they
    settle."""
    parameters, x = problem.parameters, start.copy()
    for _ in range(30):
        factor = problem.whiten(x).factor
        root = np.sqrt(Density(problem).noise_weight(x[None])[0])

        def rows(z, x=x, factor=factor, root=root):
            point = x.copy()
            point[moving] = parameters.prior_mean[moving] + z * parameters.prior_std[moving]
            white = problem.whiten(point, factor)
            return np.append(white.residual * root, z), np.vstack(
                [white.jacobian[:, moving] * root, np.eye(len(z))]
            )

        z = ((x - parameters.prior_mean) / parameters.prior_std)[moving]
        result = optimize.least_squares(
            lambda z: rows(z)[0],
            z,
            jac=lambda z: rows(z)[1],
            x_scale="jac",
            **{"method": "lm", "xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15},
        )
        x = x.copy()
        x[moving] = parameters.prior_mean[moving] + result.x * parameters.prior_std[moving]
    return x


@pytest.mark.one_in(3)
def test_it_is_the_least_squares_of_all_parameters_at_once(run):
    """By scipy over offsets, tool and targets together: to 1e-3 stds (weights settle to 1e-6 prior stds, and
    the smallest std is some 1e-3 of its prior's)."""
    problem, start, fit = run
    result = eliminated(problem, start)
    free = problem.parameters.free
    assert in_stds(problem, fit, result, by_scipy(problem, start, free)) < 1e-3
    # Negative control: targets that are kept at the start and not eliminated give another answer.
    frozen = by_scipy(problem, start, free & ~problem.parameters.group("target"))
    assert in_stds(problem, fit, result, frozen) > 0.1
    held = ~free
    np.testing.assert_array_equal(result[held], start[held])


def test_the_fit_with_it_is_the_fit_without(run):
    problem, _, fit = run
    with_it = fit_likelihood(problem, starts=0, eliminate_targets=True)
    assert with_it.converged
    assert in_stds(problem, fit, with_it.x, fit.x) < 1e-4
    assert with_it.log_posterior == pytest.approx(fit.log_posterior, abs=1e-6)
    np.testing.assert_allclose(with_it.std, fit.std, rtol=1e-3)


def test_the_targets_are_the_best_for_these_offsets(run):
    """The gradient of the misses by the targets vanishes with the weights of the end: a nudge is worse."""
    problem, start, _ = run
    x = eliminated(problem, start)
    targets = problem.parameters.group("target")
    factor = problem.whiten(x).factor
    scale, mean = problem.parameters.prior_std, problem.parameters.prior_mean

    def cost(own):
        residual = problem.whiten(own, factor).residual * root
        return (residual @ residual + (((own - mean) / scale)[targets] ** 2).sum()) / 2

    root = np.sqrt(Density(problem).noise_weight(x[None])[0])
    rng = np.random.default_rng(1)
    for _ in range(5):
        nudge = np.where(targets, rng.normal(size=len(x)), 0.0)
        assert cost(x + 1e-2 * nudge) > cost(x)
        assert cost(x - 1e-2 * nudge) > cost(x)


def test_distances_and_separate_noise_are_refused():
    made_header = header(
        targets={"a": {"guess_mm": [900, 0, 0]}, "b": {"guess_mm": [900, 0, 0]}},
        distances=[{"between": ["a", "b"], "mm": 50, "sigma_mm": 0.1}],
    )
    postures = good_plan(12).postures
    tied = plan_of(made_header, postures, ["a", "b"] * 6)
    separate = plan_of(header(noise={"scale": "separate"}), postures)
    for plan in (tied, separate):
        _, problem = simulated_problem(plan, TABLE_2, seed=3)
        start = start_at(problem, np.zeros((1, Density(problem).size)))[0]
        with pytest.raises(ValueError, match="not eliminated"):
            eliminated(problem, start)
        with pytest.raises(ValueError, match="not eliminated"):
            fit_likelihood(problem, starts=0, eliminate_targets=True)
