"""One measurement that contradicts the others; the extreme Studentised deviate test, by Rosner's example."""

import numpy as np
import pytest
from cells import TABLE_2, good_plan, simulated_problem
from scipy import stats

from zerobeam.analysis.diagnostics.outliers import FEWEST_VALUES, _critical, outlying_values, single_outlier
from zerobeam.analysis.estimation.fit import fit_likelihood

# Rosner 1983, as in the NIST/SEMATECH e-Handbook, section 1.3.5.17.3: three outliers at 0.05.
ROSNER = [
    *(-0.25, 0.68, 0.94, 1.15, 1.20, 1.26, 1.26, 1.34, 1.38, 1.43, 1.49, 1.49, 1.55, 1.56, 1.58, 1.65, 1.69),
    *(1.70, 1.76, 1.77, 1.81, 1.91, 1.94, 1.96, 1.99, 2.06, 2.09, 2.10, 2.14, 2.15, 2.23, 2.24, 2.26, 2.35),
    *(2.37, 2.40, 2.47, 2.54, 2.62, 2.64, 2.90, 2.92, 2.92, 2.93, 3.21, 3.26, 3.30, 3.59, 3.68, 4.30, 4.64),
    *(5.34, 5.42, 6.01),
]


def test_the_critical_values_and_outliers_are_those_of_the_handbook():
    assert [round(_critical(54, k, 0.05), 3) for k in (1, 2, 3)] == [3.159, 3.151, 3.144]
    assert [ROSNER[own.row] for own in outlying_values(ROSNER, 0.05)] == [6.01, 5.42, 5.34]
    # The first alone is hidden by the others: a test one by one would stop there.
    values = np.array(ROSNER)
    assert (values.max() - values.mean()) / values.std(ddof=1) < _critical(54, 1, 0.05)


def test_the_level_holds_and_few_values_are_not_tested():
    rng = np.random.default_rng(3)
    alarms = sum(bool(outlying_values(rng.normal(size=30), 0.05)) for _ in range(1000))
    assert 25 <= alarms <= 80  # the binomial's 99.9 % about 50
    assert outlying_values([0.0] * (FEWEST_VALUES - 2) + [9.0], 0.05) == []
    assert outlying_values([*np.linspace(-1, 1, FEWEST_VALUES - 1), 90.0], 0.05)[0].row == FEWEST_VALUES - 1
    assert outlying_values([1.0] * 40, 0.05) == []
    (own,) = outlying_values([*rng.normal(size=40), 30.0], 0.01)
    assert own.row == 40
    assert own.deviation > 20


@pytest.mark.parametrize("scale", ["known", "estimated"])
def test_the_measurement_that_contradicts_the_others_is_named(scale):
    """By its p-value with Bonferroni's correction; only a stated noise can be contradicted."""
    _, problem = simulated_problem(good_plan(8, noise={"scale": scale}), TABLE_2, seed=1)
    assert single_outlier(fit_likelihood(problem, starts=0), 8) is None
    joints = problem.joints.copy()
    joints[5, 4] += np.radians(0.5)
    moved = problem.moved(joints)
    fit = fit_likelihood(moved, starts=0)
    found = single_outlier(fit, 8)
    if scale == "estimated":
        assert found is None
        return
    rest = fit_likelihood(moved.select(np.delete(np.arange(8), 5)), starts=0)
    drop = (
        (fit.whitened.residual**2).sum() + fit.z @ fit.z - (rest.whitened.residual**2).sum() - rest.z @ rest.z
    )
    assert found.shot == 5
    assert found.p_value == pytest.approx(8 * stats.chi2.sf(drop, 2))
    assert found.residual_mm == pytest.approx(np.linalg.norm(moved.linearise(rest.x)[0][5]))
    assert found.residual_mm > 1
    assert single_outlier(fit, 2) is None  # the others leave no degrees of freedom
