"""The generalised extreme Studentised deviate test, against Rosner's own example and its level."""

import numpy as np

from zerobeam.analysis.diagnostics.outliers import FEWEST_VALUES, _critical, outlying_values

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
    assert outlying_values([1.0] * 40, 0.05) == []
    (own,) = outlying_values([*rng.normal(size=40), 30.0], 0.01)
    assert own.row == 40
    assert own.deviation > 20
