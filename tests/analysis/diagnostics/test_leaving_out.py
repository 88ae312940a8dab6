"""What leaving measurements out costs, and which of many are tried."""

import numpy as np
import pytest
from cells import PROBE, TABLE_2, good_plan, placed_plan, simulated_problem

from zerobeam.analysis.diagnostics.hypotheses import _left_without, _thinned, fits_from
from zerobeam.analysis.solution import solve
from zerobeam.model.likelihood.density import Density
from zerobeam.model.likelihood.problem import Problem


@pytest.mark.parametrize("gone", [[3], [0, 5]])
def test_the_price_of_leaving_measurements_out(gone: list[int]) -> None:
    """Of numbers that are all taken for normal with their own root mean square s, ln p falls by
    Σ ln(s/σ) + n/2 against an exact fit of them."""
    _, problem = simulated_problem(good_plan(12), TABLE_2, seed=2)
    joints = problem.joints.copy()
    joints[gone] += np.radians(0.5)
    problem = problem.moved(joints)
    x = solve(problem, starts=0).fit.x
    _, (left,) = fits_from(Density(problem), x[None])
    found = _left_without(problem, x, left, np.array(gone))
    whitened = problem.whiten(x)
    off = whitened.residual_mm[gone].ravel()
    sigma = np.concatenate([np.diagonal(whitened.factor[i]) for i in gone])
    rms = np.sqrt(np.mean(off**2))
    assert rms > 1.0  # half a degree at most of a metre: not the least size
    assert found.occam == pytest.approx(np.log(rms / sigma).sum() + len(off) / 2, rel=1e-9)
    assert found.freed == 2 * len(gone)
    assert found.measurements == tuple(gone)


def test_measurements_are_thinned_only_where_they_are_too_many() -> None:
    places = {"near": (900.0, 0.0, 0.0), "far": (900.0, 300.0, 200.0)}
    problem = Problem.from_plan(placed_plan(places, {"near": 11, "far": 3}, tool=PROBE))
    np.testing.assert_array_equal(_thinned(problem, 14), np.arange(14))
    np.testing.assert_array_equal(_thinned(problem, 20), np.arange(14))
    some = _thinned(problem, 13)
    assert len(some) == 6 + 3  # half of 13 of each target, as far as it has them
    for k, ends in ((0, 11), (1, 3)):
        rows = np.flatnonzero(problem.target_index == k)
        assert len(rows) == ends
        assert {rows[0], rows[-1]} <= set(some.tolist())
