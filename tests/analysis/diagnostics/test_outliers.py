"""One measurement that contradicts the others; the extreme Studentised deviate test, by Rosner's example."""

import numpy as np
import pytest
from cells import LASER, OPEN_LASER, PROBE, TABLE_2, good_plan, plan_of, simulated_problem
from measured_arms import CELLS, recorded
from scipy import stats

from zerobeam.analysis.diagnostics import outliers as module
from zerobeam.analysis.diagnostics.outliers import (
    FEWEST_VALUES,
    _critical,
    influence,
    leverages,
    outlying_values,
    single_outlier,
)
from zerobeam.analysis.estimation.fit import fit_likelihood
from zerobeam.model.likelihood.problem import Problem

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


def without(plan, problem, i):
    keep = [k for k in range(problem.shots) if k != i]
    spots = problem.spots[keep] if problem.tool.name == "laser" else None
    return Problem.build(plan.header, plan.robot, problem.joints[keep], ["psd"] * len(keep), spots)


def by_step(problem, fit):
    """As for more than 300 measurements."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_REFITTED", 0)
        return influence(problem, fit)


BOTH = pytest.mark.parametrize("way", [influence, by_step])


@pytest.mark.parametrize("tool", ["laser", "probe"])
def test_leave_one_out_against_refits(tool):
    """Against a fit of a problem without the measurement: to 1e-3 of the residual or of its std."""
    plan = good_plan(10) if tool == "laser" else good_plan(12, 5, PROBE)
    _, problem = simulated_problem(plan, TABLE_2 if tool == "laser" else {"delta4": 0.5}, seed=4)
    fit = fit_likelihood(problem, starts=0)
    effect, worst = influence(problem, fit), 0.0
    for i in range(problem.shots):
        other = fit_likelihood(without(plan, problem, i), starts=0)
        miss, own = problem.linearise(other.x)
        std = np.sqrt(np.trace(problem.factors(other.x, own)[i] @ problem.factors(other.x, own)[i].T))
        length = np.linalg.norm(miss[i])
        assert effect.leave_one_out[i] == pytest.approx(length, abs=1e-3 * max(std, length))
        assert effect.leave_one_out[i] >= np.linalg.norm(fit.whitened.residual_mm[i]) * 0.99
        worst = max(worst, length / np.linalg.norm(fit.whitened.residual_mm[i]))
    assert worst > 1.5  # control: the misses of the fit itself are others


def test_cooks_distance_against_refits():
    """How far the whole answer moves without the shot, in its covariance, over the number of unknowns."""
    plan = good_plan(10)
    _, problem = simulated_problem(plan, TABLE_2, seed=3)
    fit = fit_likelihood(problem, starts=0)
    effect = influence(problem, fit)
    for i in range(problem.shots):
        move = fit_likelihood(without(plan, problem, i), starts=0).z - fit.z
        exact = move @ np.linalg.solve(fit.covariance, move) / 8
        assert effect.cooks[i] == pytest.approx(exact, rel=1e-2, abs=1e-3)


def test_the_leverages_sum_to_what_the_shots_determine():
    """The trace of the hat matrix: the unknowns less what their priors tell, near 8 here. It is Fisher's
    information in the hat, and the exact curvature in the covariance: 5 %."""
    _, problem = simulated_problem(good_plan(10), TABLE_2, seed=4)
    fit = fit_likelihood(problem, starts=0)
    blocks = fit.whitened.jacobian[:, problem.parameters.free].reshape(10, 2, 8)
    open_part, decides = leverages(blocks, fit.covariance)
    assert not decides.any()
    determined = 20 - np.trace(open_part, axis1=1, axis2=2).sum()
    assert determined == pytest.approx(8, rel=0.05)
    # Ten times the covariance: every shot would tell more than all of them.
    assert leverages(blocks, 10 * fit.covariance)[1].any()


@pytest.mark.parametrize("scale", ["known", "estimated", "separate"])
@pytest.mark.parametrize("tool", [LASER, OPEN_LASER, PROBE])
@pytest.mark.at_length(r"^tool1|separate|^tool2-known")
def test_one_step_is_as_good_as_a_fit(tool, scale, monkeypatch):
    """With 60 measurements of different weights: to 5e-3 of a residual's std, where leaving one out moves the
    largest by a quarter of it at least. With separate factors a fit goes from their marginal mode to the
    common one, whichever measurement is left out, which is a tenth in Cook's distance."""
    plan = good_plan(60, tool=tool, noise={"scale": scale})
    truth, seed = ({"delta4": 0.5}, 4) if tool is PROBE else (TABLE_2, 3)
    _, problem = simulated_problem(plan, truth, seed=seed)
    problem = problem.weighted(np.linspace(0.5, 1.0, 60))
    fit = fit_likelihood(problem, starts=0)
    fits = influence(problem, fit)
    monkeypatch.setattr(module, "_REFITTED", 59)
    steps = influence(problem, fit)
    residual = np.linalg.norm(fit.whitened.residual_mm, axis=1)
    std = np.sqrt((residual**2).mean())
    assert np.abs(fits.leave_one_out - residual).max() > 0.25 * std
    np.testing.assert_allclose(steps.leave_one_out, fits.leave_one_out, atol=5e-3 * std)
    np.testing.assert_allclose(steps.cooks, fits.cooks, atol=0.15 if scale == "separate" else 1e-3)
    np.testing.assert_array_equal(steps.whitened, fits.whitened)


def test_one_step_does_not_depend_on_the_blocks(monkeypatch):
    _, problem = simulated_problem(good_plan(12), TABLE_2, seed=3)
    fit = fit_likelihood(problem, starts=0)
    monkeypatch.setattr(module, "_REFITTED", 11)
    whole = influence(problem, fit)
    monkeypatch.setattr(module, "_ROWS", 5)
    np.testing.assert_allclose(influence(problem, fit).cooks, whole.cooks, rtol=1e-9)


@BOTH
def test_whitened_misses_are_in_stds(way):
    _, problem = simulated_problem(good_plan(10), TABLE_2, seed=4)
    fit = fit_likelihood(problem, starts=0)
    effect = way(problem, fit)
    for i in range(10):
        factor = fit.whitened.factor[i]
        miss = fit.whitened.residual_mm[i]
        assert effect.whitened[i] == pytest.approx(np.sqrt(miss @ np.linalg.inv(factor @ factor.T) @ miss))


@BOTH
def test_an_outlier_stands_out(way):
    plan = good_plan(12)
    _, problem = simulated_problem(plan, TABLE_2, seed=5)
    joints = problem.joints.copy()
    joints[7, 4] += np.radians(1.0)
    problem = problem.moved(joints)
    effect = way(problem, fit_likelihood(problem, starts=0))
    assert effect.leave_one_out.argmax() == effect.cooks.argmax() == effect.whitened.argmax() == 7
    assert effect.cooks[7] > 1.0


@BOTH
def test_a_shot_that_determines_itself_has_no_prediction(way):
    """Nothing tells where a target stands that no other shot has seen."""
    own = good_plan(10)
    header = own.header.model_copy(update={"targets": {}})
    plan = plan_of(header, own.postures, ["a"] * 9 + ["b"])
    joints = simulated_problem(own, TABLE_2, seed=6)[1].joints
    problem = Problem.build(header, plan.robot, joints, plan.targets)
    effect = way(problem, fit_likelihood(problem, starts=0))
    assert np.isnan(effect.leave_one_out[9])
    assert np.isnan(effect.cooks[9])
    assert np.isfinite(effect.leave_one_out[:9]).all()
    assert effect.whitened[9] == pytest.approx(0, abs=1e-3)


@BOTH
def test_an_estimated_scale_is_in_the_stds(way):
    plan = good_plan(12, noise={"scale": "estimated"})
    known = good_plan(12)
    _, problem = simulated_problem(known, TABLE_2, seed=8)
    scaled = Problem.build(plan.header, plan.robot, problem.joints, ["psd"] * 12, problem.spots)
    fit = fit_likelihood(scaled, starts=0)
    one = way(problem, fit_likelihood(problem, starts=0))
    other = way(scaled, fit)
    np.testing.assert_allclose(other.whitened / one.whitened, np.sqrt(fit.weight), rtol=0.1)
    # In mm the predictions do not depend on the scale.
    np.testing.assert_allclose(other.leave_one_out, one.leave_one_out, rtol=0.1, atol=0.05)


@pytest.mark.long
def test_one_step_is_as_good_as_a_fit_for_what_a_tracker_read():
    """To 5e-3 of the largest change by leaving one out."""
    cell = CELLS["tracker"]
    arm = recorded(cell, 40, np.random.default_rng(3), exact=True, joint_deg=0.005)
    header, robot = cell.header(geometry="exact", joint_deg=0.005), good_plan(2).robot
    problem = Problem.of_measured(header, robot, arm.joints, arm.measured)
    fit = fit_likelihood(problem, starts=0)
    exact, step = influence(problem, fit), by_step(problem, fit)
    change = np.abs(exact.leave_one_out - np.linalg.norm(fit.whitened.residual_mm, axis=1)).max()
    np.testing.assert_allclose(step.leave_one_out, exact.leave_one_out, atol=5e-3 * change)
    np.testing.assert_allclose(step.cooks, exact.cooks, atol=5e-3 * exact.cooks.max())


@pytest.mark.parametrize("loss", ["huber", "student"])
@pytest.mark.parametrize("size", [0.4, 1.2, 3.0, 9.0])
def test_the_slope_of_a_pull_is_its_derivative(loss, size):
    """The pull of a residual m is w(|m|) m: by central differences, inside and outside the tuning."""
    m, step, d, tuning = size * np.array([0.6, -0.8]), 1e-6, np.array([2.0]), 2.5

    def pull(m):
        return module._weights(np.array([np.linalg.norm(m)]), d, loss, tuning)[0] * m

    expected = [(pull(m + step * e) - pull(m - step * e)) / (2 * step) for e in np.eye(2)]
    length = np.array([size])
    slope = module._weight_slope(length, d, loss, tuning)[0] * np.outer(m, m)
    slope += module._weights(length, d, loss, tuning)[0] * np.eye(2)
    np.testing.assert_allclose(slope, expected, atol=1e-8)
