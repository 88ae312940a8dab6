"""What changes little: evidence against a dense normal, columns against what they stand for."""

import numpy as np
import pytest
from cells import TABLE_2, good_plan, irb1600, simulated_problem

from zerobeam.analysis.diagnostics.hypotheses import changes, file_variants, other_arms
from zerobeam.analysis.diagnostics.screening import screened
from zerobeam.analysis.diagnostics.suspects import Linear, suspects
from zerobeam.analysis.solution import solve
from zerobeam.model.likelihood.geometry import NOMINAL


@pytest.fixture(scope="module")
def linear() -> Linear:
    """Of a run of an uncertain arm in which the zero of joint 3 jumps."""
    _, problem = simulated_problem(good_plan(14, geometry=None), TABLE_2, seed=2)
    joints = problem.joints.copy()
    joints[7:, 2] += np.radians(0.5)
    problem = problem.moved(joints)
    return Linear(problem, solve(problem, starts=0).fit.x)


def dense(linear: Linear, more: np.ndarray) -> float:
    """Log density of the residuals at the prior means, by their whole covariance."""
    covariance = np.eye(len(linear.residual)) + linear.free @ linear.free.T + more
    r0 = linear.at_prior_means
    return -(r0 @ np.linalg.solve(covariance, r0) + np.linalg.slogdet(covariance)[1]) / 2


def test_the_evidence_is_a_ratio_of_marginal_likelihoods(linear: Linear) -> None:
    tried = 0
    for suspect in suspects(linear):
        columns = suspect.columns(linear)
        if not columns.shape[1]:
            continue
        ratio = dense(linear, suspect.size**2 * columns @ columns.T) - dense(linear, 0 * np.eye(len(columns)))
        assert linear.of(columns).log_evidence(suspect.size)[0] == pytest.approx(ratio, abs=1e-3)
        assert suspect.evidence == pytest.approx(ratio - suspect.log_choices, abs=1e-3), suspect.cause
        tried += 1
    assert tried > 12


def test_more_noise_is_judged_by_its_marginal_likelihood(linear: Linear) -> None:
    (noise,) = (one for one in suspects(linear) if one.cause == "noise")
    identity = np.eye(len(linear.residual))
    ratio = dense(linear, (noise.fixed_amount**2 - 1) * identity) - dense(linear, 0 * identity)
    assert noise.evidence == pytest.approx(ratio - noise.log_choices, abs=1e-3)


def test_columns_are_what_the_correction_does_to_the_residuals(linear: Linear) -> None:
    causes = set()
    parameters = linear.problem.parameters
    before = linear.problem.whiten(linear.x)
    for suspect in suspects(linear):
        columns = suspect.columns(linear)
        if not columns.shape[1]:
            continue
        values = np.random.default_rng(1).normal(size=columns.shape[1]) * suspect.size * 1e-3
        corrected = suspect.corrected(linear, values)
        # Of a parameter the prior mean moves: its value has to move along.
        x = linear.x + corrected.parameters.prior_mean - parameters.prior_mean
        after = corrected.whiten(x, before.factor).residual
        np.testing.assert_allclose(
            after - before.residual, columns @ values, atol=0.02 * np.abs(columns @ values).max()
        )
        assert np.abs(columns @ values).max() > 0
        causes.add(suspect.cause)
    assert causes >= {
        "jump",
        "moved_target",
        "measurements",
        "gain",
        "lag",
        "backlash",
        "drift",
        "tool",
        "length",
    }


def test_the_jump_has_the_largest_evidence(linear: Linear) -> None:
    best = suspects(linear)[0]
    assert (best.cause, best.joints, best.measurements) == ("jump", (3,), (6, 7))


def test_screening_is_the_fit_with_nominal_geometry() -> None:
    _, problem = simulated_problem(good_plan(9, geometry="exact"), TABLE_2, seed=1)
    tried = [
        problem.joints,
        *(one.recorded for one in changes(problem, problem.nominal()) if one.cause == "sign"),
    ]
    joints, weights = np.array(tried), np.tile(problem.weights, (len(tried), 1))
    robots = [irb1600()] * len(tried)
    x, cost = screened(problem, robots, joints, weights)
    fit = solve(problem.with_geometry(NOMINAL), starts=0).fit
    assert cost[0] == pytest.approx(
        float(fit.whitened.residual @ fit.whitened.residual + fit.z @ fit.z), rel=1e-3
    )
    np.testing.assert_allclose(np.degrees(x[0][:6]), np.degrees(fit.x[:6]), atol=1e-3)
    assert cost[1:].min() > 1000 * cost[0]


def test_rows_read_by_the_other_convention_are_read_back() -> None:
    robot = irb1600()
    q = np.random.default_rng(0).uniform(-1, 1, (4, 6))
    right = [one for one in file_variants(robot) if one.cause == "convention"]
    assert [one.of for one in right][-1] == "modified"
    wrong = right[-1].robot  # the file of standard rows, stated as modified
    back = {one.of: one.robot for one in file_variants(wrong) if one.cause == "convention"}
    np.testing.assert_allclose(back["standard"].fk(q, "rad"), robot.fk(q, "rad"), atol=1e-9)
    assert np.abs(wrong.fk(q, "rad") - robot.fk(q, "rad")).max() > 100


def test_other_arms_are_those_with_as_many_joints_the_siblings_apart() -> None:
    siblings = {one.of for one in other_arms(irb1600(), siblings=True)}
    others = {one.of for one in other_arms(irb1600(), siblings=False)}
    assert {"irb120", "irb1200", "irb2600"} <= siblings
    assert {"kr6_r900", "ur5e"} <= others
    assert not siblings & others
    assert "irb1600" not in siblings | others
    assert "iiwa14" not in others  # seven joints
