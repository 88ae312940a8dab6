"""Consider analysis and tolerances against plain linear algebra; what is cached of a run is not changed."""

from dataclasses import replace

import numpy as np
import pytest
from cells import LASER, OPEN_LASER, PROBE, TABLE_2, good_plan, header, plan_of, run_of, simulated_problem
from scipy import stats

from zerobeam.analysis.estimation.fit import fit_likelihood
from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.observability.gauges import information_root
from zerobeam.analysis.observability.geometry_result import (
    considered,
    link_columns,
    tolerance_share,
    with_links,
    with_tolerances,
)
from zerobeam.analysis.observability.identifiability import identify
from zerobeam.experiments.simulate import Truth, simulated_shots
from zerobeam.model.files.plan import Plan
from zerobeam.model.likelihood.problem import Problem


def probe_run() -> Problem:
    return simulated_problem(good_plan(tool=PROBE), TABLE_2, seed=1)[1]


def test_the_columns_of_the_links_are_those_at_the_values_asked_for() -> None:
    problem = probe_run()
    x = problem.nominal()
    first = link_columns(problem, x)
    before = first.copy()
    std = considered(problem, x, weight=4.0)
    assert (considered(problem, x, weight=1.0) != std).any()
    np.testing.assert_array_equal(link_columns(problem, x), before)
    np.testing.assert_array_equal(first, before)
    x[1] += 0.1  # the same array, other values
    moved = link_columns(problem, x)
    assert (moved != before).any()
    other = probe_run()
    np.testing.assert_array_equal(link_columns(other, x), moved)
    twice = problem.weighted(np.full(problem.shots, 4.0))
    np.testing.assert_allclose(link_columns(twice, x), 2 * moved, rtol=1e-12)


def test_the_information_is_that_at_the_values_asked_for() -> None:
    problem = probe_run()
    x = problem.nominal()
    _, before, _ = information_root(problem, x, 1.0)
    _, heavier, _ = information_root(problem, x, 4.0)
    assert (heavier != before).any()
    np.testing.assert_array_equal(information_root(problem, x, 1.0)[1], before)
    x[1] += 0.1
    moved = information_root(problem, x, 1.0)[1]
    assert (moved != before).any()
    np.testing.assert_array_equal(information_root(probe_run(), x, 1.0)[1], moved)


def test_other_tolerances_are_other_priors() -> None:
    problem, x = with_links(probe_run(), probe_run().nominal())
    jacobian = problem.whiten(x).jacobian[:, problem.parameters.free]
    data, links = jacobian.T @ jacobian, problem.parameters.among_free[problem.tolerated]
    covariance = np.linalg.inv(data + np.eye(len(data)))
    for factor in (0.5, 1.0, 2.0):
        prior = np.eye(len(data))
        prior[links, links] = 1 / factor**2
        expected = np.sqrt(np.diag(np.linalg.inv(data + prior)))
        np.testing.assert_allclose(with_tolerances(problem, covariance, factor), expected, rtol=1e-6)
    # The share of the variance that the tolerances set: less one part of their information.
    share, step = tolerance_share(problem, covariance), 1e-5
    without = np.eye(len(data))
    without[links, links] += step
    slope = (np.diag(covariance) - np.diag(np.linalg.inv(data + without))) / step / np.diag(covariance)
    np.testing.assert_allclose(share, slope, rtol=1e-3, atol=1e-6)
    assert 0 < share.max() <= 1


def test_nominal_geometry_is_as_uncertain_as_links_make_it() -> None:
    """P + G C_g G', G by the fits to residuals that one link parameter moves by its tolerance."""
    problem = probe_run()
    x, free = problem.nominal(), problem.parameters.free
    for weight in (1.0, 4.0):
        jacobian = np.sqrt(weight) * problem.whiten(x).jacobian[:, free]
        columns = np.sqrt(weight) * link_columns(problem, x)
        covariance = np.linalg.inv(jacobian.T @ jacobian + np.eye(jacobian.shape[1]))
        moved = np.array([covariance @ jacobian.T @ column for column in columns.T]).T
        std = np.sqrt(np.diag(covariance + moved @ moved.T)) * problem.parameters.prior_std[free]
        np.testing.assert_allclose(considered(problem, x, weight)[free], std, rtol=1e-9)
        assert (std > 1.5 * np.sqrt(np.diag(covariance)) * problem.parameters.prior_std[free])[:5].any()


SIGMA = {"tilt_deg": 0.05, "shift_mm": 0.1}


def roughly_known_laser(sigma: dict[str, float] | None, count: int = 12) -> Plan:
    """An exact arm with an uncalibrated laser, of which the last offset is to be estimated."""
    tool = OPEN_LASER if sigma is None else {**OPEN_LASER, "sigma": sigma}
    return plan_of(header(tool, held=["delta1"]), good_plan(count).postures)


def test_a_tool_that_is_known_to_an_angle_leaves_the_last_offset_that_uncertain() -> None:
    """As a calibrated one of that sigma does. Negative control: without a sigma it is unidentifiable."""
    problem = Problem.from_plan(roughly_known_laser(SIGMA))
    told = identify(problem, problem.nominal())
    assert told.status[5] == "identified"
    assert np.degrees(told.data_std[5]) == pytest.approx(0.05, rel=0.05)
    calibrated = plan_of(header({**LASER, "sigma": SIGMA}), good_plan(12).postures)
    other = Problem.from_plan(calibrated)
    np.testing.assert_allclose(told.data_std[1:6], identify(other, other.nominal()).data_std[1:6])
    unknown = Problem.from_plan(roughly_known_laser(None))
    assert identify(unknown, unknown.nominal()).status[5] == "unidentifiable"


def test_the_last_offset_of_such_tools_is_as_far_off_as_stated() -> None:
    """40 arms with tools off by their sigma: the mean square of z by chi-squared, at 99.9 %."""
    plan = roughly_known_laser(SIGMA, 8)
    z = []
    for seed in range(100, 140):
        rng = np.random.default_rng(seed)
        truth = Truth.drawn(plan, rng)
        fitted = fit_likelihood(Problem.from_run(run_of(plan.header, simulated_shots(truth, rng))), starts=0)
        std = fitted.problem.parameters.unscaled(fitted.std)
        z.append((fitted.x[5] - truth.x[5]) / std[5])
    low, high = stats.chi2.ppf([0.0005, 0.9995], len(z)) / len(z)
    assert low < np.mean(np.square(z)) < high


@pytest.mark.parametrize("arms", [4, pytest.param(40, marks=pytest.mark.long)])
@pytest.mark.long
def test_gravity_counts_with_one_target(arms: int) -> None:
    """Each joint deflects by 0.05° where its torque is largest, the prior's standard deviation, and one PSD
    was used: no rung is dropped, so that no arm of four is a misfit (two of forty at most), and z is within 4
    of u. Negative control: with exact geometry z is not."""
    plan = plan_of(header(geometry=None), good_plan(12).postures)
    misfits, largest, exact = 0, 0.0, header()
    for seed in range(arms):
        rng = np.random.default_rng(1000 + seed)
        truth = Truth.drawn(plan, rng)
        parameters, x = truth.problem.parameters, truth.x.copy()
        x[parameters.tolerated] = 0.0
        bent = np.array([item.axis == "gravity" for item in parameters.items])
        x[bent] = np.radians(0.05) * rng.choice([-1, 1], bent.sum())
        run = run_of(plan.header, simulated_shots(replace(truth, x=x), rng))
        solution = solve_run(Problem.from_run(run), plan.header)
        misfits += solution.verdict == "misfit"
        z = (solution.fit.x - x)[1:6] / parameters.unscaled(solution.fit.std)[1:6]
        assert np.abs(z).max() < 4
        of_exact = solve_run(Problem.from_run(replace(run, header=exact)), exact)
        std = of_exact.fit.problem.parameters.unscaled(of_exact.fit.std)
        largest = max(largest, np.abs((of_exact.fit.x[:6] - x[:6]) / std[:6])[1:].max())
    assert misfits <= (2 if arms > 4 else 0)
    assert largest > 4
