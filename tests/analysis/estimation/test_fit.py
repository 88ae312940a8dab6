"""tests/analysis/estimation/test_fit.py."""

import numpy as np
import pytest
from cells import (
    PROBE,
    TABLE_2,
    good_plan,
    header,
    pattern_plan,
    plan_of,
    random_robot,
    simulated_problem,
    varied_postures,
)
from made_problem import many_runs
from plain_posterior import PlainPosterior
from scipy import optimize, stats

from zerobeam.analysis.estimation import fit as module
from zerobeam.analysis.estimation.fit import (
    CONTRADICTED,
    effective_dof,
    fit_likelihood,
    fit_rows,
    gains,
    modes,
    noise_dof,
    start_at,
    unbiased_weight,
)
from zerobeam.analysis.observability.aim import aim, servo_joints
from zerobeam.experiments.studies.coverage import drawn
from zerobeam.model.likelihood.density import Density
from zerobeam.model.likelihood.problem import Problem

GUESS = (900.0, 0.0, 0.0)
TIGHT = {"method": "lm", "xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15}  # of scipy's least squares


def plain(problem, joint_deg=0.01, spot_mm=0.05):
    return PlainPosterior(problem.joints, problem.spots, GUESS, joint_deg, spot_mm)


def truth_in_z(truth):
    parameters = truth.problem.parameters
    return ((truth.x - parameters.prior_mean) / parameters.prior_std)[parameters.free]


@pytest.fixture(scope="module")
def good():
    truth, problem = simulated_problem(good_plan(), TABLE_2, seed=2)
    return truth, problem, fit_likelihood(problem)


def test_the_plain_model_is_the_same_posterior(good):
    """Two independent programs of section 1: the value and the gradient at random places."""
    _, problem, fit = good
    parameters = problem.parameters
    second = plain(problem)
    rng = np.random.default_rng(3)
    shift = []
    for _ in range(4):
        z = fit.z + rng.normal(size=8) * np.array([0.02] * 5 + [1e-3] * 3)
        x = parameters.prior_mean.copy()
        x[parameters.free] += z * parameters.prior_std[parameters.free]
        value, gradient, _ = Density(problem).slopes(x[None])
        assert Density(problem).log_posterior(x[None])[0] == pytest.approx(value[0], rel=1e-12)
        shift.append(value[0] + second.value(z).real)
        np.testing.assert_allclose(gradient[0], -second.gradient(z), rtol=1e-7, atol=1e-5)
    np.testing.assert_allclose(shift, shift[0], rtol=1e-9, atol=1e-7)


def test_the_mode_by_scipy_minimize(good):
    """-log posterior in plain numpy, minimised by trust-exact from the truth: 1e-6 of a std."""
    truth, problem, fit = good
    second, root = plain(problem), np.linalg.cholesky(fit.covariance)
    centre = truth_in_z(truth)
    result = optimize.minimize(
        lambda w: second.value(centre + root @ w).real,
        np.zeros(8),
        jac=lambda w: root.T @ second.gradient(centre + root @ w),
        hess=lambda w: root.T @ second.hessian(centre + root @ w, 1e-3 * fit.std) @ root,
        method="trust-exact",
        options={"gtol": 1e-8},
    )
    assert np.linalg.norm(result.jac) < 1e-6
    assert fit.converged
    np.testing.assert_allclose((centre + root @ result.x - fit.z) / fit.std, 0, atol=1e-6)


def test_the_mode_by_scipy_least_squares(good):
    """The same misses in the stds that move with the parameters, priors as residuals: 1e-6 of a std."""
    truth, problem, fit = good
    second = plain(problem)
    result = optimize.least_squares(
        lambda z: second.residuals(z).real,
        truth_in_z(truth),
        jac=second.residual_jacobian,
        x_scale=fit.std,
        **TIGHT,
    )
    assert result.cost > 1
    np.testing.assert_allclose((result.x - fit.z) / fit.std, 0, atol=1e-6)


def test_with_spot_noise_alone_it_is_plain_least_squares():
    """S is constant there: ordinary least squares of the misses in plain numpy."""
    plan = good_plan(joint_deg=1e-9, spot_mm=0.2)
    _, problem = simulated_problem(plan, TABLE_2, seed=5)
    fit = fit_likelihood(problem, starts=0)
    second = plain(problem, 1e-9, 0.2)
    result = optimize.least_squares(
        lambda z: second.residuals(z).real,
        np.zeros(8),
        jac=second.residual_jacobian,
        x_scale=fit.std,
        **TIGHT,
    )
    np.testing.assert_allclose((result.x - fit.z) / fit.std, 0, atol=1e-6)


def test_the_covariance_is_that_of_the_plain_posterior(good):
    _, problem, fit = good
    hessian = plain(problem).hessian(fit.z, 1e-3 * fit.std)
    covariance = np.linalg.inv(hessian)
    scale = np.outer(fit.std, fit.std)
    np.testing.assert_allclose(fit.covariance / scale, covariance / scale, atol=1e-4)
    assert fit.weight == 1.0


def test_the_gradient_vanishes(good):
    _, problem, fit = good
    gradient = Density(problem).slopes(fit.x[None]).gradient[0]
    assert np.abs(gradient * fit.std).max() < 1e-6
    assert fit.gradient < 1e-6
    assert fit.other_basins == 0
    assert "gradient" in fit.reason


def test_the_truth_lies_where_it_is_said():
    """40 runs: the offsets' Mahalanobis distances sum to a chi-squared of 40 x 5."""
    plan = good_plan()
    distances = []
    for seed in range(40):
        truth, problem = simulated_problem(plan, TABLE_2, seed=100 + seed)
        fit = fit_likelihood(problem, starts=0)
        assert fit.converged
        residual = (fit.z - truth_in_z(truth))[:5]
        distances.append(residual @ np.linalg.solve(fit.covariance[:5, :5], residual))
    low, high = stats.chi2.ppf([0.0005, 0.9995], 5 * 40)
    assert low < sum(distances) < high
    # Negative control: stds too small by a fifth would be caught.
    assert not low < sum(distances) / 0.8**2 < high


def test_chi_squared_is_that_of_the_stated_noise():
    plan = good_plan()
    chi2 = []
    for seed in range(40):
        _, problem = simulated_problem(plan, TABLE_2, seed=300 + seed)
        residual = fit_likelihood(problem, starts=0).whitened.residual
        chi2.append(residual @ residual)
    low, high = stats.chi2.ppf([0.0005, 0.9995], 40 * (2 * 10 - 8))
    assert low < sum(chi2) < high


def misstated(factor, seed, scale):
    """A run whose real noise is `factor` times what its header says."""
    plan = good_plan(20, joint_deg=0.01 * factor, spot_mm=0.05 * factor)
    truth, problem = simulated_problem(plan, TABLE_2, seed)
    message = header(noise={"scale": scale})
    return truth, Problem.build(message, plan.robot, problem.joints, ["psd"] * 20, problem.spots)


def test_understated_noise_is_found():
    """dof of scale^2: 2 N - 8 = 32 a run, over 12 runs."""
    scales = []
    for seed in range(12):
        _, problem = misstated(2.0, 500 + seed, "estimated")
        fit = fit_likelihood(problem, starts=0)
        assert fit.converged
        scales.append(1 / fit.weight)
    low, high = 4 * stats.chi2.ppf([0.0005, 0.9995], 12 * 32) / (12 * 32)
    assert low < np.mean(scales) < high
    assert not low < 1.0 < high


def test_estimated_noise_widens_the_stds():
    _, known = misstated(2.0, 600, "known")
    _, open_scale = misstated(2.0, 600, "estimated")
    narrow, wide = fit_likelihood(known, starts=0), fit_likelihood(open_scale, starts=0)
    # Not exactly equal: the curvature is that of a t and the prior has a small say.
    np.testing.assert_allclose(wide.std / narrow.std, 1 / np.sqrt(wide.weight), rtol=0.1)
    np.testing.assert_array_equal(unbiased_weight(Density(known), narrow.x[None]), [1.0])
    chi2 = narrow.whitened.residual @ narrow.whitened.residual
    assert 1 / wide.weight == pytest.approx(chi2 / 32, rel=0.02)
    np.testing.assert_allclose((wide.z - narrow.z) / wide.std, 0, atol=0.05)


@pytest.mark.long
def test_the_truth_under_an_estimated_scale():
    """Mahalanobis distances over 5 are F(5, 32) each: the mean of 30 by the central limit theorem."""
    distances = []
    for seed in range(30):
        truth, problem = misstated(2.0, 700 + seed, "estimated")
        fit = fit_likelihood(problem, starts=0)
        residual = (fit.z - truth_in_z(truth))[:5]
        distances.append(residual @ np.linalg.solve(fit.covariance[:5, :5], residual) / 5)
    mean, variance = stats.f.stats(5, 32, moments="mv")
    assert abs(np.mean(distances) - mean) < 3.5 * np.sqrt(variance / 30)


def test_starts_put_targets_nearest_to_their_beams(good):
    truth, problem, _ = good
    z = np.array([np.append(truth_in_z(truth)[:5], [0.0, 0.0, 0.0]), np.zeros(8)])
    near, far = start_at(problem, z)
    assert np.linalg.norm(near[6:9] - truth.x[6:9]) < 5.0
    assert np.linalg.norm(far[6:9] - truth.x[6:9]) > 5.0
    np.testing.assert_array_equal(near[:6], truth.x[:6])
    # With recordings of their own, each is near to its own beams.
    moved = problem.joints + np.array([0.0, 0.02])[:, None, None]
    values = start_at(problem, z[[0, 0]], moved)
    np.testing.assert_allclose(values[0], near, rtol=1e-12)
    np.testing.assert_allclose(values[1], start_at(problem.moved(moved[1]), z[:1])[0], rtol=1e-12)
    assert np.linalg.norm(values[1, 6:9] - values[0, 6:9]) > 5.0


def test_a_target_of_which_a_coordinate_is_held_starts_there():
    plan = good_plan(held=["delta1", "psd.z"])
    x = start_at(Problem.from_plan(plan), np.full((2, 7), 0.2))
    np.testing.assert_array_equal(x[:, 8], 0.0)
    assert np.abs(x[:, 6] - 900).min() > 1.0


def test_without_data_the_prior_stands():
    """One direction of the X-Pattern without noise in the joints: delta2 keeps its prior std."""
    _, problem = simulated_problem(pattern_plan("x"), {}, seed=1)
    fit = fit_likelihood(problem, starts=2)
    assert fit.converged
    assert fit.std[0] == pytest.approx(1.0, abs=0.05)
    assert (fit.std[1:5] < 0.2).all()


def test_another_basin_is_found_and_told():
    """A wide prior and the fewest shots: polynomial equations, with several solutions."""
    plan = good_plan(4, prior={"offset_deg": 40.0})
    _, problem = simulated_problem(plan, {}, seed=1)
    fit = fit_likelihood(problem, seed=1)
    assert fit.converged
    assert fit.other_basins >= 1
    assert fit_likelihood(problem, starts=0).other_basins == 0


def test_the_best_of_all_starts_wins():
    plan = good_plan(4, prior={"offset_deg": 40.0})
    _, problem = simulated_problem(plan, {"delta2": 30.0, "delta3": -40.0, "delta5": 50.0}, seed=1)
    single = fit_likelihood(problem, starts=0)
    several = fit_likelihood(problem, starts=8)
    assert several.log_posterior >= single.log_posterior - 1e-9
    # The starts are rows: the best of them by hand.
    density, rng = Density(problem), np.random.default_rng(0)
    z = np.vstack([np.zeros(8), rng.normal(size=(8, 8))])
    result = fit_rows(density, start_at(problem, z), np.zeros(9, dtype=np.int64))
    best = result.log_posterior[result.converged].max()
    assert several.log_posterior == pytest.approx(best, abs=1e-6)
    assert np.ptp(result.log_posterior) > 1  # they do not all end in one place


@pytest.mark.parametrize("scale", ["known", "estimated", "separate"])
@pytest.mark.one_in(3)
def test_fifty_runs_at_once_are_fifty_fits(scale):
    """Row by row the fit of a problem with those recordings alone: 1e-9 of a posterior std."""
    x, problem, joints, spots = many_runs(good_plan(12, noise={"scale": scale}), TABLE_2, 50, seed=21)
    density = Density(problem, joints, spots)
    away = np.random.default_rng(2).normal(scale=0.2, size=(50, density.size))
    start = start_at(problem, away, joints)
    many = fit_rows(density, start)
    assert many.converged.all()
    for row in range(50):
        alone = Density(problem.moved(joints[row], spots[row]))
        one = fit_rows(alone, start[row : row + 1])
        std = one.std[0]
        np.testing.assert_allclose((many.z[row] - one.z[0]) / std, 0, atol=1e-9)
        np.testing.assert_allclose(
            many.covariance[row] / np.outer(std, std), one.covariance[0] / np.outer(std, std), atol=1e-9
        )
        assert many.weight[row] == pytest.approx(one.weight[0], rel=1e-9)
        assert many.log_posterior[row] == pytest.approx(one.log_posterior[0], abs=1e-9)
        assert (many.iterations[row], many.converged[row]) == (one.iterations[0], one.converged[0])
    # Control: the runs are not one.
    assert (np.ptp(many.z, axis=0) > many.std.mean(axis=0))[:8].all()
    if scale == "known":
        residual = (many.z - density.scaled(x[None]))[:, :5]
        inverse = np.linalg.inv(many.covariance[:, :5, :5])
        low, high = stats.chi2.ppf([0.0005, 0.9995], 50 * 5)
        assert low < (residual[:, None, :] @ inverse @ residual[:, :, None]).sum() < high


def test_several_starts_of_several_runs():
    """`of` names the run of each start; where they meet, it is in one place."""
    _, problem, joints, spots = many_runs(good_plan(12), TABLE_2, 3, seed=22)
    density, of = Density(problem, joints, spots), np.array([2, 0, 1, 0, 2, 1])
    z = np.random.default_rng(1).normal(scale=0.3, size=(6, density.size))
    result = fit_rows(density, start_at(problem, z, joints[of]), of)
    assert result.converged.all()
    for run in range(3):
        first, second = np.flatnonzero(of == run)
        np.testing.assert_allclose((result.z[first] - result.z[second]) / result.std[first], 0, atol=1e-3)
        alone = fit_likelihood(problem.moved(joints[run], spots[run]), starts=0)
        np.testing.assert_allclose((result.z[first] - alone.z) / alone.std, 0, atol=1e-3)
    assert np.abs((result.z[0] - result.z[1]) / result.std[0]).max() > 0.1


def test_the_modes_alone_are_near_the_polished_ones():
    _, problem, joints, spots = many_runs(good_plan(12), TABLE_2, 20, seed=23)
    density = Density(problem, joints, spots)
    start = start_at(problem, np.zeros((20, density.size)), joints)
    rough, fine = modes(density, start), fit_rows(density, start)
    assert rough.converged.all()
    # A step that would gain no more than 1e-7 of the log-posterior is shorter than sqrt(2e-7) stds; and what
    # Fisher's curvature differs from the exact one makes it less than twice that.
    away = (density.scaled(rough.x) - fine.z)[:, None, :]
    distance = (away @ np.linalg.solve(fine.covariance, away.transpose(0, 2, 1)))[:, 0, 0]
    assert np.sqrt(distance).max() < 2 * np.sqrt(2e-7)
    np.testing.assert_allclose(-rough.cost, fine.log_posterior, atol=1e-6)


def test_a_start_that_is_no_number_hurts_no_other():
    _, problem, joints, spots = many_runs(good_plan(12), TABLE_2, 3, seed=24)
    density = Density(problem, joints, spots)
    start = start_at(problem, np.zeros((3, density.size)), joints)
    sound = fit_rows(density, start)
    start[1] = np.nan
    result = fit_rows(density, start)
    np.testing.assert_array_equal(result.converged, [True, False, True])
    assert "not finite" in result.reason[1]
    np.testing.assert_array_equal(result.z[[0, 2]], sound.z[[0, 2]])
    np.testing.assert_array_equal(result.covariance[[0, 2]], sound.covariance[[0, 2]])


def test_shots_of_no_weight_are_not_fitted():
    """Leave-one-out side by side, against fits of problems without the shot."""
    _, problem = simulated_problem(good_plan(12), TABLE_2, seed=25)
    weights = np.ones((12, 12))
    weights[np.arange(12), np.arange(12)] = 0
    start = np.tile(fit_likelihood(problem, starts=0).x, (12, 1))
    result = fit_rows(Density(problem).weighted(weights), start)
    for i in range(12):
        fewer = problem.select(np.delete(np.arange(12), i))
        one = fit_rows(Density(fewer), start[:1])
        np.testing.assert_allclose((result.z[i] - one.z[0]) / one.std[0], 0, atol=1e-4)
        np.testing.assert_allclose(result.std[i] / one.std[0], 1, atol=1e-4)
    assert np.abs((result.z - result.z[0]) / result.std).max() > 0.1


def test_the_mode_with_free_noise_factors_by_scipy():
    """The common mode of all parameters, as `fit_rows` finds it: scipy's BFGS on the values."""
    _, problem, joints, spots = many_runs(good_plan(12, noise={"scale": "separate"}), TABLE_2, 1, seed=26)
    density = Density(problem, joints, spots)
    fit = fit_rows(density, start_at(problem, np.zeros((1, density.size)), joints))
    root, free = np.linalg.cholesky(fit.covariance[0]), problem.parameters.free
    mean, scale = problem.parameters.prior_mean, problem.parameters.prior_std[free]

    def cost(w):
        x = mean.copy()
        x[free] += (fit.z[0] + 0.5 * root.sum(axis=1) + root @ w) * scale
        return fit.log_posterior[0] - density.log_posterior(x[None])[0]

    result = optimize.minimize(cost, np.zeros(len(root)), method="BFGS", options={"gtol": 1e-6})
    np.testing.assert_allclose(result.x, -0.5, atol=1e-3)
    assert cost(result.x) >= -1e-9
    assert cost(np.zeros(len(root))) > 0.5


@pytest.mark.long
def test_a_probe_on_an_arm_with_a_slide():
    robot = random_robot("rprrrr", 6)
    made_header = header(PROBE, target=(300.0, 200.0, 100.0), noise={"joint_mm": 0.02})
    # The tip's place in a middle posture: near it there are many ways to stand.
    problem = Problem.build(made_header, robot, np.zeros((1, 6)), ["psd"])
    position = problem.beams(problem.parameters.prior_mean)[0][0]
    made_header = header(PROBE, target=position, noise={"joint_mm": 0.02})
    postures = varied_postures(made_header, robot, position, 20, 2)
    true = {"delta2": 2.0, "delta3": 0.8, "delta4": -0.5}
    truth, problem = simulated_problem(plan_of(made_header, postures, robot=robot), true, seed=4)
    fit = fit_likelihood(problem, starts=2)
    assert fit.converged
    residual = fit.z - truth_in_z(truth)
    distance = residual @ np.linalg.solve(fit.covariance, residual)
    assert distance < stats.chi2.ppf(0.9995, len(residual))


def test_a_fit_in_a_wrong_basin_contradicts_noise_and_priors_and_is_tried_again():
    """Four shots leave no number to spare: chi-squared cannot warn, misses and priors together can."""
    plan = Problem.from_plan(pattern_plan("y", shots=4))
    problem = aim(plan, plan.nominal(), servo_joints(plan)).problem
    data = drawn(problem, 12, np.random.default_rng(1))
    lost = wrong = 0
    for joints, spots, truth in zip(data.joints, data.spots, data.truths, strict=True):
        moved = problem.moved(joints, spots)
        best = Density(moved).log_posterior(truth[None])[0] - 5
        first, result = fit_likelihood(moved, starts=0), fit_likelihood(moved)
        lost += first.log_posterior < best
        wrong += result.log_posterior < best
        # Whoever is lost is told so.
        assert first.log_posterior >= best or first.p_value < CONTRADICTED
        assert result.log_posterior >= best or result.p_value < CONTRADICTED
    assert lost >= 2
    assert wrong <= 1


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
