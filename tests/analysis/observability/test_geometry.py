"""Consider analysis and tolerances against plain linear algebra; what is cached of a run is not changed."""

import numpy as np
from cells import PROBE, TABLE_2, good_plan, simulated_problem

from zerobeam.analysis.observability.gauges import information_root
from zerobeam.analysis.observability.geometry import (
    considered,
    link_columns,
    tolerance_share,
    with_links,
    with_tolerances,
)
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
