"""The benchmarks' own parts: peers are given the same run, cost and coordinates. No time is asserted."""

import numpy as np
import pytest
from exact_runs import demo_runs
from scripts import BENCHMARKS, load_script

fit_time = load_script(BENCHMARKS, "fit_time")
fit_peers = load_script(BENCHMARKS, "fit_peers")
TRACKED = (float(np.radians(0.002)), 0.05)  # noise of a tracker set, rad and mm


@pytest.fixture(scope="module")
def fitted():
    problem = fit_time.the_run()
    return problem, fit_time.ours(problem)


@pytest.fixture(scope="module")
def cost(fitted):
    return fit_peers.Cost(fit_time.cost_data(*fitted, *fit_time.noisy_runs(fitted[0], 2)))


def points(problem, fit, count=5):
    """(count, 8) rad and mm about the mode, a hundred posterior stds around."""
    std = fit.std * problem.parameters.prior_std[problem.parameters.free]
    return fit.x[problem.parameters.free] + 100 * std * np.random.default_rng(1).normal(
        size=(count, len(std))
    )


def test_the_run_is_the_one_of_the_issue(fitted):
    problem, fit = fitted
    assert problem.shots == 9  # seven postures, the first two again
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
    whitened_at_the_mode(case)


def test_a_trackers_coordinates_are_whitened(posterior_time):
    case = posterior_time.TrackerCase(40)
    assert case.size == 27
    assert len(case.arm_of_peer["links"]) == 15
    whitened_at_the_mode(case)


def whitened_at_the_mode(case):
    w = 0.1 * np.random.default_rng(2).normal(size=(20, case.size))
    fall = case.log_density(np.zeros((1, case.size))) - case.log_density(w)
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


@pytest.fixture(scope="module")
def tracker_table():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(BENCHMARKS)
        yield load_script(BENCHMARKS, "tracker_table")


@pytest.fixture(scope="module")
def tracker_peers(tracker_table):
    return tracker_table.tracker_peers


@pytest.mark.long
def test_data_without_noise_give_the_parameters_back(tracker_table, tracker_peers):
    """Rows of Denavit and Hartenberg, as pybotics has them, to 1e-9 rad and mm."""
    truth = tracker_peers.simulated(np.random.default_rng(3), 40, (0.0, 0.0), held=1, beta=False)
    off = tracker_table.departures(truth, truth.measured)
    assert {"delta2", "delta5", "link3.d", "link2.beta", "link5.alpha", "leica.R1.z"} <= off.keys()
    assert max(map(abs, off.values())) < 1e-9
    # Negative control: one coordinate of one measurement is off by a micrometre.
    wrong = truth.measured.copy()
    wrong[7, 1] += 1e-3
    assert max(map(abs, tracker_table.departures(truth, wrong).values())) > 1e-6


def test_the_peers_tracker_jacobian_is_that_of_differences(tracker_peers):
    truth = tracker_peers.simulated(np.random.default_rng(4), 5, TRACKED, held=1)
    x = truth.x + np.append(np.zeros(24), [0.1, -0.2, 0.3, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0])
    exact = truth.model.jacobian(truth.joints, x)
    for k, step in enumerate(1e-6 * np.eye(33)):
        by = truth.model.positions(truth.joints, x + step) - truth.model.positions(truth.joints, x - step)
        np.testing.assert_allclose(exact[:, :, k], by / 2e-6, atol=1e-4)


def test_the_peers_start_is_the_best_frame_of_nominal_links(tracker_peers):
    truth = tracker_peers.simulated(np.random.default_rng(5), 60, TRACKED, held=1)
    noise = np.array(TRACKED)
    data = tracker_peers.started(
        tracker_peers.IRB1600, truth.joints, truth.measured, truth.held_joints, noise
    )
    left = (data.model.positions(data.joints, data.start) - data.measured).ravel()
    by = data.model.jacobian(data.joints, data.start)[:, :, 24:].reshape(-1, 9)
    cosines = np.abs(by.T @ left) / np.linalg.norm(by, axis=0) / np.linalg.norm(left)
    assert cosines.max() < 1e-6
    assert data.sigma > noise[1]


@pytest.mark.long
def test_a_simulated_tracker_set_is_solved_within_its_uncertainty(tracker_table, tracker_peers):
    """And joints that never move are unidentifiable."""
    rng, robot = np.random.default_rng(6), tracker_table.load_robot("irb1600", BENCHMARKS)
    header = tracker_table.header()
    for still in ((), tracker_table.STILL):
        truth = tracker_peers.simulated(rng, 60, tracker_table.NOISE, held=20, still=still)
        problem = tracker_table.problem_of(header, robot, truth.joints, truth.measured)
        answer = tracker_table.ours(problem, header, truth.held_joints)
        if still:
            assert answer.says.startswith("degenerate")
            assert np.isnan(answer.std[2:5]).all()
            continue
        z = ((answer.offsets - truth.x[3:24:4]) / answer.std)[tracker_table.COMPARED]
        assert np.abs(z).max() < 4
        assert tracker_table.rms(answer.positions - truth.held) < 0.1
