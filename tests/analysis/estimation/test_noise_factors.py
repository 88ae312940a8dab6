import numpy as np
import pytest
from cells import (
    TABLE_2,
    good_plan,
    placed_plan,
    run_of,
    simulated,
)
from made_problem import many_runs
from scipy import optimize, stats

from zerobeam.analysis.analyse import analyse
from zerobeam.analysis.estimation.fit import _STEP, _quadratic, fit_likelihood, fit_rows, marginal_noise
from zerobeam.model.likelihood.density import Density
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.sentences import to_json

TRUE = np.log([1.5, 0.7])
WRIST = [0.0002] * 3 + [0.02] * 3  # deg: only the wrist errs, so that short beams are good ones
SPOT = 0.8
RUNS = 40


def two_lengths(joint_deg, spot_mm, **changes):
    """Forty shots, at a near and at a far target: beams of 0.4 to 5 m."""
    places = {"near": (900.0, 0.0, 0.0), "far": (4000.0, 0.0, 500.0)}
    return placed_plan(places, dict.fromkeys(places, 20), joint_deg=joint_deg, spot_mm=spot_mm, **changes)


@pytest.fixture(scope="module")
def runs():
    return fitted(RUNS)


@pytest.fixture(scope="module")
def one_run():
    return fitted(1)


def fitted(count):
    """Of each run: the fit, the common mode of noise and all else, and the mode of the noise where all else
    is known; what the factors really were is TRUE."""
    truly = two_lengths([1.5 * v for v in WRIST], 0.7 * SPOT)
    x, _, joints, spots = many_runs(truly, TABLE_2, count, seed=1)
    problem = Problem.from_plan(two_lengths(WRIST, SPOT, noise={"scale": "separate"}))
    fits, common, oracle = [], [], []
    for run in zip(joints, spots, strict=True):
        moved = problem.moved(*run)
        fits.append(fit_likelihood(moved, starts=0))
        density = Density(moved)
        common.append(fit_rows(density, fits[-1].x[None]).x[0, -2:])
        result = optimize.minimize(
            lambda noise, density=density: -density.log_posterior(np.append(x, noise)[None])[0],
            TRUE,
            method="Nelder-Mead",
            options={"xatol": 1e-4},
        )
        oracle.append(result.x)
    assert all(fit.converged for fit in fits)
    return problem.moved(joints[0], spots[0]), fits, np.array(common), np.array(oracle)


def told(fits):
    """(W, 2) logarithms of the factors and their stds."""
    return np.array([fit.x[-2:] for fit in fits]), np.array([fit.std[-2:] for fit in fits])


@pytest.mark.long
def test_the_factors_are_right_on_average(runs):
    """Against those of highest posterior where all else is known: the mode of few numbers' noise lies lower
    than the truth, and the prior pulls, by as much in both. The unknowns cost degrees of freedom: a log std
    of variance v = 1 / 2k has its mode v lower. The rest is chance: 3.5 standard errors of the mean of 60.
    """
    _, fits, common, oracle = runs
    value, std = told(fits)
    off = value - oracle
    error = off.std(axis=0, ddof=1) / np.sqrt(RUNS)
    fewer = (std**2).mean(axis=0) - oracle.var(axis=0, ddof=1)
    assert (np.abs(off.mean(axis=0)) < 3.5 * error + np.abs(fewer)).all()
    spread = value.std(axis=0, ddof=1) / np.sqrt(RUNS)
    assert (np.abs(value.mean(axis=0) - TRUE) < 3.5 * spread + 2 * (std**2).mean(axis=0)).all()
    # Negative control: at the common mode the noise is too small by about sqrt(1 - f / M).
    unknowns, numbers = len(fits[0].z) - 2, 80
    low = (common - oracle).mean(axis=0)
    assert low[0] < -(3.5 * error + np.abs(fewer))[0]
    assert low[0] == pytest.approx(np.log(1 - unknowns / numbers) / 2, abs=0.06)


@pytest.mark.long
def test_the_intervals_hold_the_truth(runs):
    """95 % of 40: at a chance of 1e-3 for each factor at least 33 hold it."""
    _, fits, _, _ = runs
    value, std = told(fits)
    held = (np.abs(value - TRUE) < stats.norm.ppf(0.975) * std).sum(axis=0)
    assert held.min() >= stats.binom.ppf(1e-3, RUNS, 0.95)
    # And the stds are those of the scatter, to 3.5 standard errors of a std from 40 runs.
    ratio = value.std(axis=0, ddof=1) / np.sqrt((std**2).mean(axis=0))
    assert (np.abs(np.log(ratio)) < 3.5 / np.sqrt(2 * RUNS)).all()


@pytest.mark.long
def test_the_offsets_stds_are_those_of_their_errors(runs):
    """Mahalanobis distances of five offsets: 200 degrees of freedom of chi-squared, a little more for the
    unknown noise."""
    problem, fits, _, _ = runs
    truth = np.radians([TABLE_2[f"delta{i}"] for i in range(2, 7)]) / problem.parameters.prior_std[1:6]
    total = 0.0
    for fit in fits:
        error = fit.z[:5] - truth
        total += error @ np.linalg.solve(fit.covariance[:5, :5], error)
    low, high = stats.chi2.ppf([5e-4, 1 - 5e-4], 5 * RUNS)
    assert low < total < 1.1 * high
    # Negative control: as the noise is stated, joints are 1.5 times better than they are.
    assert total * 1.5**2 > 1.1 * high


def test_it_is_the_mode_of_the_marginal(one_run):
    """Laplace's formula on a grid of the two factors in plain numpy: the rest by a fit at each of them."""
    problem, fits, _, _ = one_run
    fit = fits[0]
    x, covariance, settled = marginal_noise(problem, fit.x)
    assert settled
    np.testing.assert_allclose(
        (x - fit.x)[problem.parameters.free] / problem.parameters.prior_std[1:], 0, atol=1e-3
    )
    rest = np.flatnonzero(~problem.parameters.group("noise"))

    def marginal(noise):
        known, values = problem.with_noise_of(np.append(x[rest], noise))
        result = fit_rows(Density(known), values[None])
        full = np.append(result.x[0], noise)[None]
        # The curvature by Fisher's information, as the formula has it.
        information = Density(known).slopes(result.x).information[0]
        return Density(problem).log_posterior(full)[0] - np.linalg.slogdet(information)[1] / 2

    centre = marginal(x[-2:])
    std = np.sqrt(np.diag(covariance)[-2:])
    for way in ([1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, 1]):
        step = 0.5 * std * np.array(way)
        drop = centre - marginal(x[-2:] + step)
        precision = np.linalg.inv(covariance[-2:, -2:])
        # Quadratic near the top: half a std off, a third order term of a few percent.
        assert drop == pytest.approx(step @ precision @ step / 2, rel=0.35, abs=5e-3)
        assert drop > 0


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_quadratic_of_a_quadratic_is_itself(count):
    rng = np.random.default_rng(count)
    root = rng.normal(size=(count, count))
    curvature, slope = root @ root.T + np.eye(count), rng.normal(size=count)
    units = np.eye(count)
    pairs = [units[i] + units[j] for i in range(count) for j in range(i)]
    points = _STEP * np.array([np.zeros(count), *units, *-units, *pairs, *(-pair for pair in pairs)])
    values = 3.0 + points @ slope - np.einsum("pi,ij,pj->p", points, curvature, points) / 2
    result = _quadratic(values, count)
    np.testing.assert_allclose(result[0], slope, atol=1e-9)
    np.testing.assert_allclose(result[1], curvature, atol=1e-8)


def test_noise_is_not_blamed_for_offsets():
    """From far off (misses of millimetres) a joint noise of 2000 times the stated one explains everything,
    with the offsets anywhere. The fit must not end there, from the first start and with few shots."""
    plan = good_plan(10, noise={"scale": "separate"})
    for seed in range(5):
        truth, run = simulated(plan, TABLE_2, seed)
        fit = fit_likelihood(Problem.from_run(run), starts=0)
        assert fit.converged
        assert np.exp(fit.x[-2]) < 5
        assert np.degrees(np.abs(fit.x - truth.x)[1:6]).max() < 2


@pytest.mark.long
def test_links_that_explain_every_residual_leave_the_noise_its_size():
    """Seven measurements of a typical arm: at the common mode of factors and all else there is no noise."""
    plan = good_plan(7, geometry=None, noise={"scale": "separate"})
    for seed in range(3):
        _, run = simulated(plan, TABLE_2, seed)
        fit = fit_likelihood(Problem.from_run(run))
        assert fit.converged
        assert (np.abs(fit.x[-2:]) < 2).all()
        assert fit_rows(Density(fit.problem), fit.x[None]).x[0, -2:].max() < -5


def numbers_of(value, name):
    """All numbers of a JSON tree that stand with what is called `name`."""
    if isinstance(value, dict):
        if value.get("name") == name:
            return [value]
        return [result for each in value.values() for result in numbers_of(each, name)]
    if isinstance(value, list | tuple):
        return [result for each in value for result in numbers_of(each, name)]
    return []


@pytest.mark.long
def test_a_spot_noise_that_is_drowned_has_no_number():
    """A spot noise of a hundredth of what the joints do: nothing is claimed of it anywhere in the answer."""
    plan = good_plan(12, joint_deg=0.02, spot_mm=0.002, noise={"scale": "separate"})
    _, run = simulated(plan, TABLE_2, seed=3)
    results = analyse(run, ess=400, robust="huber")
    result, draws = results.result, results.draws
    rows = {row.name: row for row in result.parameters}
    spot, joint = rows["noise.spot"], rows["noise.joint"]
    assert spot.status == "unidentifiable"
    assert (spot.estimate, spot.std, spot.interval95, spot.midpoint) == (None,) * 4
    assert spot.cause is not None
    # Negative control: the joints' factor is told.
    assert joint.status in ("identified", "weak")
    assert joint.interval95[0] < 1.0 < joint.interval95[1]
    assert not [row for row in result.intervals if row.name == "noise.spot"]
    assert not [row for row in result.robust.parameters if row.name.startswith("noise")]
    posterior = {row.name: row for row in result.posterior.parameters}
    assert posterior["noise.spot"].source == "prior"
    assert posterior["noise.joint"].source == "data"
    assert "noise.spot" in [item.name for item in draws.prior_only]
    for results in numbers_of(to_json(result), "noise.spot"):
        if results.get("source") != "prior":
            for key in ("estimate", "std", "interval95"):
                assert results.get(key) is None


@pytest.mark.long
def test_a_plan_that_tells_both_tells_both():
    _, run = simulated(two_lengths(WRIST, SPOT, noise={"scale": "separate"}), TABLE_2, seed=3)
    result = analyse(run_of(run.header, run.shots), ess=400).result
    rows = {row.name: row for row in result.parameters}
    for name in ("noise.joint", "noise.spot"):
        assert rows[name].status in ("identified", "weak")
        assert rows[name].interval95[0] < 1.0 < rows[name].interval95[1]


def test_at_known_factors_the_rest_has_the_curvature_of_known_noise(one_run):
    """The covariance given the factors (Schur's complement) is that of a fit at that noise."""
    problem, fits, _, _ = one_run
    x, covariance, _ = marginal_noise(problem, fits[0].x)
    known, values = problem.with_noise_of(x)
    information = Density(known).slopes(values[None]).information[0]
    across = covariance[:-2, -2:]
    given = covariance[:-2, :-2] - across @ np.linalg.solve(covariance[-2:, -2:], across.T)
    expected = np.diag(np.linalg.inv(information))
    np.testing.assert_allclose(np.sqrt(np.diag(given)), np.sqrt(expected), rtol=0.02)
