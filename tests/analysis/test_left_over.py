"""The algebra of hypotheses: every way to y and G is that of the columns, and a fit with them agrees."""

import numpy as np
import pytest
from scipy import stats

from zerobeam.analysis.left_over import LeftOver
from zerobeam.model.arrays import Matrix

SHOTS, D, UNKNOWNS, K = 9, 2, 5, 3


def model(seed: int = 1) -> tuple[Matrix, Matrix, Matrix]:
    """Residuals (M,) before a fit, their Jacobian (M, f), and parts (N, d, k) of a hypothesis."""
    rng = np.random.default_rng(seed)
    rows = SHOTS * D
    return rng.normal(size=rows), rng.normal(size=(rows, UNKNOWNS)), rng.normal(size=(SHOTS, D, K))


def left_over(*, known: bool = True) -> tuple[LeftOver, Matrix]:
    before, jacobian, parts = model()
    return LeftOver.without_priors(before, jacobian, (SHOTS, D), SHOTS * D, known=known), parts


def columns_of(parts: Matrix, rows: list[int]) -> Matrix:
    chosen = np.zeros_like(parts)
    chosen[rows] = parts[rows]
    return chosen.reshape(-1, K)


def test_each_way_is_that_of_the_columns() -> None:
    left, parts = left_over()
    order = np.random.default_rng(2).permutation(SHOTS)
    every = [
        (left.after(parts, order, 2), [order[k:].tolist() for k in range(2, SHOTS - 1)]),
        (left.alone(parts), [[row] for row in range(SHOTS)]),
    ]
    for hypotheses, rows in every:
        assert len(hypotheses.y) == len(rows)
        for i, some in enumerate(rows):
            one = left.of(columns_of(parts, some))
            np.testing.assert_allclose(hypotheses.y[i], one.y[0], atol=1e-12)
            np.testing.assert_allclose(hypotheses.gram[i], one.gram[0], atol=1e-12)
    single = left.each(parts.reshape(-1, K))
    together = left.of(parts.reshape(-1, K))
    np.testing.assert_allclose(single.y[:, 0], together.y[0], atol=1e-12)
    np.testing.assert_allclose(single.gram[:, 0, 0], np.diag(together.gram[0]), atol=1e-12)


@pytest.mark.parametrize("known", [True, False])
def test_it_is_the_fit_with_the_columns_against_the_fit_without(known: bool) -> None:
    left, parts = left_over(known=known)
    before, jacobian, _ = model()
    columns = columns_of(parts, list(range(4, SHOTS)))
    whole = np.hstack([jacobian, columns])
    amount, square, *_ = np.linalg.lstsq(whole, -before, rcond=None)
    without = np.linalg.lstsq(jacobian, before, rcond=None)[1]
    explained = left.explained(left.of(columns), 1e-9)
    assert explained.drop[0] == pytest.approx(float(without[0] - square[0]))
    estimate, covariance = left.estimate(explained, 0)
    np.testing.assert_allclose(estimate, amount[UNKNOWNS:], atol=1e-10)
    dof = SHOTS * D - UNKNOWNS - K
    scale = 1.0 if known else float(square[0]) / dof
    np.testing.assert_allclose(covariance, scale * np.linalg.inv(whole.T @ whole)[UNKNOWNS:, UNKNOWNS:])
    ratio = float(explained.drop[0]) / K / (float(square[0]) / dof)
    p_value = stats.chi2.sf(explained.drop[0], K) if known else stats.f.sf(ratio, K, dof)
    assert left.p_value(explained, 0) == pytest.approx(p_value)


def test_what_hypotheses_reach_needs_no_squares() -> None:
    left, parts = left_over(known=False)
    columns = columns_of(parts, list(range(3, SHOTS)))
    doubled = np.hstack([columns, columns[:, :1]])  # one direction twice
    one, other = left.explained(left.reached(doubled), 0.5), left.explained(left.of(columns), 1e-4)
    assert int(one.rank[0]) == int(other.rank[0]) == K
    assert float(one.drop[0]) == pytest.approx(float(other.drop[0]))


def test_of_hypotheses_that_leave_only_rounding_the_one_with_fewer_amounts_explains_best() -> None:
    _, jacobian, parts = model()
    few, many = columns_of(parts, [4])[:, :1], columns_of(parts, [4])
    exact = few @ np.ones(1)
    left = LeftOver.without_priors(exact, jacobian, (SHOTS, D), SHOTS * D, known=False)
    scores = [float(left.explained(left.of(columns), 1e-9).score[0]) for columns in (few, many)]
    assert all(np.isfinite(scores))
    assert scores[0] == pytest.approx(scores[1] + 2 * (D - 1), abs=1e-6)  # of one measurement are D numbers
