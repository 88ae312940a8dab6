"""What is remembered of a run is that of the values asked for, and nobody changes it."""

import numpy as np
from cells import PROBE, TABLE_2, good_plan, simulated_problem

from zerobeam.analysis.observability.gauges import information_root
from zerobeam.analysis.observability.geometry import considered, link_columns
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
