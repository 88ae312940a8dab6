"""The benchmarks' own parts: peers are given the same run, cost and coordinates. No time is asserted."""

from __future__ import annotations

import numpy as np
import pytest
from scripts import BENCHMARKS, load_script

from zerobeam.experiments.demos import demo_runs

fit_time = load_script(BENCHMARKS, "fit_time")
fit_peers = load_script(BENCHMARKS, "fit_peers")


@pytest.fixture(scope="module")
def fitted():
    problem = fit_time.the_run()
    return problem, fit_time.ours(problem)


@pytest.fixture(scope="module")
def cost(fitted):
    return fit_peers.Cost(fit_time.cost_data(*fitted))


def points(problem, fit, count=5):
    """(count, 8) rad and mm about the mode, a hundred posterior stds around."""
    std = fit.std * problem.parameters.prior_std[problem.parameters.free]
    return fit.x[problem.parameters.free] + 100 * std * np.random.default_rng(1).normal(
        size=(count, len(std))
    )


def test_the_run_is_the_one_of_the_issue(fitted):
    problem, fit = fitted
    assert problem.shots == 7
    names = np.array(problem.parameters.names)[problem.parameters.free]
    assert names.tolist() == [f"delta{k}" for k in range(2, 7)] + ["psd.x", "psd.y", "psd.z"]
    assert fit.converged


def test_the_peers_cost_is_that_of_our_weights(fitted, cost):
    problem, fit = fitted
    parameters, free = problem.parameters, problem.parameters.free
    for point in points(problem, fit):
        x = parameters.prior_mean.copy()
        x[free] = point
        data = problem.whiten(x, fit.whitened.factor)
        z = ((x - parameters.prior_mean) / parameters.prior_std)[free]
        np.testing.assert_allclose(cost.residual(point), np.append(data.residual, z), rtol=1e-9, atol=1e-8)
        by_x = np.vstack([data.jacobian[:, free], np.eye(len(z))]) / parameters.prior_std[free]
        np.testing.assert_allclose(cost.jacobian(point), by_x, rtol=1e-8, atol=1e-7)
        size = np.abs(by_x).max(axis=0)
        np.testing.assert_allclose(cost.differences(point) / size, by_x / size, atol=1e-5)


def test_the_shared_optimum_is_one_and_a_peer_finds_it(fitted, cost):
    problem, fit = fitted
    std = fit.std * problem.parameters.prior_std[problem.parameters.free]
    optimum = fit_time.shared_optimum(problem, fit)

    def slope(x):
        return np.abs(std * (cost.jacobian(x).T @ cost.residual(x))).max()

    assert slope(optimum) < 1e-6
    assert slope(cost.mode) > 1e-4  # the mode itself has moving weights: it is near, and not it
    found = fit_peers.scipy_fit(cost, cost.jacobian)()
    assert np.abs((found - optimum) / std).max() < fit_time.REACHED
    assert np.abs((cost.start - optimum) / std).max() > 1.0  # where the peers start there was work to do


def test_the_batch_fits_every_run_as_a_fit_of_its_own(fitted):
    problem, _ = fitted
    joints, spots = fit_time.noisy_runs(problem, 3)
    batch = fit_time.ours_batch(problem, joints, spots)
    assert batch.converged.all()
    for k in range(3):
        single = fit_time.ours(problem.moved(joints[k], spots[k]))
        np.testing.assert_allclose((batch.z[k] - single.z) / single.std, 0.0, atol=1e-4)
    assert np.abs((batch.z[0] - batch.z[1]) / batch.std[0]).max() > 0.1


@pytest.fixture(scope="module")
def posterior_time():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(BENCHMARKS)  # a script of the folder imports another
        yield load_script(BENCHMARKS, "posterior_time")


@pytest.mark.parametrize(("name", "size"), [("good", 8), ("uncalibrated", 11)])
def test_the_sampled_coordinates_are_whitened(posterior_time, name, size):
    case = posterior_time.Case(name, next(run.path for run in demo_runs() if run.name == name))
    assert case.size == size
    w = 0.1 * np.random.default_rng(2).normal(size=(20, size))
    fall = case.log_density(np.zeros((1, size))) - case.log_density(w)
    np.testing.assert_allclose(fall, (w**2).sum(axis=1) / 2, rtol=0.02)
    with pytest.raises(AssertionError):
        np.testing.assert_allclose(fall, ((1.1 * w) ** 2).sum(axis=1) / 2, rtol=0.02)


def test_found_draws_are_told_with_their_errors(posterior_time):
    """Independent normals: ESS as many as draws, errors sqrt(1 / n) of means, sqrt(2 / n) of variances."""
    draws = np.random.default_rng(3).normal(size=(4, 5000, 2))
    found = posterior_time.Found(draws, 1.0)
    assert found.count == 20_000
    assert found.ess() == pytest.approx(20_000, rel=0.1)
    moments = found.moments()
    np.testing.assert_allclose(moments["means"][1], np.sqrt(1 / 20_000), rtol=0.1)
    np.testing.assert_allclose(moments["variances"][1], np.sqrt(2 / 20_000), rtol=0.1)
    np.testing.assert_allclose(moments["variances"][0], 1.0, atol=5 * np.sqrt(2 / 20_000))
    # Each draw twice: half as many effective ones.
    assert posterior_time.Found(np.repeat(draws, 2, axis=1), 1.0).ess() == pytest.approx(20_000, rel=0.1)
