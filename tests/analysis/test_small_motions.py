"""Joints that vary by some degrees: single offsets are not determined, predictions are."""

import numpy as np
import pytest
from cells import good_plan, simulated_problem
from small_motions import halves

from zerobeam.analysis.analyse import analyse
from zerobeam.analysis.estimation import climb
from zerobeam.analysis.estimation.climb import Climb
from zerobeam.analysis.estimation.fit import fit_likelihood
from zerobeam.words.finding_words import predicted_run_message


@pytest.mark.parametrize(
    ("robot", "at_rest", "half_deg", "geometry"),
    [
        ("irb1600", (1,), 10.0, "exact"),
        pytest.param("irb1600", (1, 2), 10.0, "exact", marks=pytest.mark.long),
        *(
            pytest.param(*case, None, marks=pytest.mark.long)
            for case in [
                ("irb1600", (1,), 5.0),
                ("irb1600", (1, 2), 5.0),
                ("irb1600", (1, 6), 10.0),
                ("iiwa7", (1,), 5.0),
                ("iiwa7", (1, 3), 10.0),
            ]
        ),
    ],
)
def test_the_other_half_is_predicted(robot, at_rest, half_deg, geometry):
    count = 14 if geometry == "exact" else 40
    how = {"at_rest": at_rest, "half_deg": half_deg, "geometry": geometry, "count": count}
    fitted, held_out = halves(robot, **how, seed=1)
    analysis = analyse(fitted, held_out=held_out, sampling="never")
    assert analysis.converged
    assert analysis.verdict == "degenerate"
    assert all(row.estimate is None for row in analysis.offsets if row.status == "unidentifiable")
    predicted = analysis.result.hold_out
    assert predicted_run_message(predicted) is None
    # The mean of the squares of some 120 numbers: 4 standard errors of its root, and 5 % for the fit itself.
    assert predicted.rms_mm < predicted.expected_mm * (1 + 4 / np.sqrt(2 * 3 * predicted.shots) + 0.05)
    assert predicted.rms_mm < predicted.rms_before_mm


@pytest.mark.parametrize(("rough", "converged"), [(1.5e-4, True), (5e-3, False)])
def test_a_gradient_that_rounding_leaves_is_converged(monkeypatch, rough, converged):
    """Of a nearly lost direction the gradient has a rounding error that no step takes away. Beside the
    posterior's standard deviation it is nothing; a larger one is no rounding error."""
    _, problem = simulated_problem(good_plan())
    exact = fit_likelihood(problem, starts=0)
    assert exact.converged
    real = Climb._newton

    def left_by_rounding(self, minima, rows):
        v, covariance, value, size, iterations = real(self, minima, rows)
        return v, covariance, value, np.full_like(size, rough), iterations

    monkeypatch.setattr(Climb, "_newton", left_by_rounding)
    monkeypatch.setattr(climb, "compiled_climb", lambda *args, **kwargs: None)
    fit = fit_likelihood(problem, starts=0)
    assert fit.converged == converged
    np.testing.assert_allclose(fit.z, exact.z, atol=1e-3 * exact.std.min())


def test_steps_that_gain_nothing_but_rounding_are_not_repeated(monkeypatch):
    """Newton's steps end where they no longer halve a gradient that is as good as none."""
    _, problem = simulated_problem(good_plan())
    taken = []
    real = Climb._search

    def never_better(self, v, value, slope, of, active, root, step):
        taken.append(len(active))
        moved, at, values, _ = real(self, v, value, slope, of, active, root, step)
        size = np.linalg.norm(slope[active], axis=1, keepdims=True)
        return moved | True, at, values, slope[active] * np.where(size > 1e-4, 1e-4 / size, 0.9)

    monkeypatch.setattr(Climb, "_search", never_better)
    monkeypatch.setattr(climb, "compiled_climb", lambda *args, **kwargs: None)
    assert fit_likelihood(problem, starts=0).converged
    assert 0 < len(taken) < 5
