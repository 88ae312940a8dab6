import dataclasses
import functools
import math

import numpy as np
import pytest
from cells import (
    LASER,
    OPEN_LASER,
    OPEN_PROBE,
    TABLE_2,
    good_plan,
    header,
    irb1600,
    pattern_plan,
    plan_of,
    simulated,
    simulated_problem,
    varied_postures,
)
from made_problem import many_runs
from scipy import stats

from zerobeam.analysis.analyse import analyse
from zerobeam.analysis.diagnostics.budget import budget, check_linear
from zerobeam.analysis.estimation.fit import fit_likelihood, fit_rows
from zerobeam.analysis.posterior.convergence import Ends, tail_effective
from zerobeam.analysis.posterior.posterior import UNSAMPLED, PosteriorParameter
from zerobeam.analysis.posterior.sampler import DECIDING_EACH, IndependenceProposal, sample_density
from zerobeam.analysis.solution import judge
from zerobeam.model.kinematics.robot import Joint, Robot
from zerobeam.model.likelihood.density import Density
from zerobeam.model.likelihood.parameters import Parameters
from zerobeam.model.likelihood.problem import Problem


def budgets_of(fit, posterior=UNSAMPLED):
    return {own.name: own for own in budget(judge(fit), posterior)}


def row_of(own, kind, *of):
    (found,) = (row for row in own.rows if (row.kind, row.of) == (kind, of))
    return found


@functools.cache
def fitted(scale="known", tool="laser"):
    """A run in which every kind of source counts: two targets, one well known, and their distance."""
    tools = {"laser": LASER, "open laser": OPEN_LASER, "open probe": OPEN_PROBE}
    near, far = (900.0, 0.0, 0.0), (880.0, 60.0, 30.0)
    if tool == "open probe":
        near, far = (900.0, 100.0, 500.0), (880.0, 160.0, 530.0)
    alone = header(tools[tool])
    own = header(
        tools[tool],
        target=None,
        noise={"scale": scale},
        held=["delta1"] if tool == "laser" else ["delta1", "delta6"],
        targets={"psd": {"guess_mm": near, "sigma_mm": 0.1}, "b": {"guess_mm": far, "sigma_mm": 20}},
        distances=[{"between": ["psd", "b"], "mm": math.dist(near, far), "sigma_mm": 0.2}],
        prior={"offset_deg": 0.5},
    )
    postures = [varied_postures(alone, irb1600(), place, 5, 5 + i) for i, place in enumerate((near, far))]
    plan = plan_of(own, np.vstack(postures), ["psd"] * 5 + ["b"] * 5)
    _, problem = simulated_problem(plan, {"delta2": 0.3, "delta4": -0.2}, seed=4)
    return fit_likelihood(problem, starts=0)


def slider(scale="known"):
    """A slide along x under a probe at a place that is known: the offset is an average of 4 readings."""
    slides = [Joint(f"joint{i + 1}", "prismatic", np.eye(4), np.eye(3)[i], -500.0, 500.0) for i in range(2)]
    own = header(
        {"kind": "probe", "calibrated": True, "point_mm": [0, 0, 0]},
        target=(0, 0, 0),
        noise={"joint_mm": 0.4, "scale": scale},
        spot_mm=0.3,
        held=["delta2", "psd.x", "psd.y", "psd.z"],
        prior={"offset_mm": 0.3},
    )
    readings = np.random.default_rng(8).normal(size=(4, 2)) * [0.5, 0.0]
    return Problem.build(own, Robot("slider", tuple(slides), np.eye(4)), readings, ["psd"] * 4)


def test_a_hand_calculation():
    """The offset is the mean of N readings, drawn towards 0 by its prior: gain g = s0^2 / (s0^2 + s^2/N)."""
    fit = fit_likelihood(slider(), starts=0)
    own = budgets_of(fit)["delta1"]
    gain = 0.09 / (0.09 + 0.25 / 4)
    assert fit.x[0] == pytest.approx(-gain * fit.problem.joints[:, 0].mean(), rel=1e-6)
    joint, spot, prior = row_of(own, "joint", "1"), row_of(own, "spot"), row_of(own, "prior", "delta1")
    assert (joint.std, spot.std, prior.std) == pytest.approx((0.4, 0.3, 0.3))
    assert joint.contribution == pytest.approx(gain * 0.4 / 2)
    assert joint.sensitivity == pytest.approx(gain / 2)
    assert spot.contribution == pytest.approx(gain * 0.3 / 2)
    assert prior.contribution == pytest.approx((1 - gain) * 0.3)
    assert own.std == pytest.approx(math.sqrt((gain * 0.25) ** 2 + ((1 - gain) * 0.3) ** 2))
    assert own.expanded == pytest.approx(1.959964 * own.std)
    assert (joint.type, prior.type, joint.dof, own.dof) == ("B", "B", None, None)


def test_effective_degrees_of_freedom_by_hand():
    """12 numbers, one unknown: 11 for the noise, infinite for the prior."""
    own = budgets_of(fit_likelihood(slider("estimated"), starts=0))["delta1"]
    noise = [row_of(own, "joint", "1"), row_of(own, "spot"), row_of(own, "curvature")]
    assert [row.type for row in noise] == ["A", "A", None]
    assert noise[0].dof == noise[1].dof == pytest.approx(11, rel=1e-3)  # a little is the prior's
    prior = row_of(own, "prior", "delta1")
    assert prior.share > 0.03
    assert own.dof == pytest.approx(noise[0].dof / (1 - prior.share) ** 2)
    assert own.coverage_factor == pytest.approx(stats.t.ppf(0.975, own.dof))
    # The result's interval takes the prior's part to be as uncertain as the noise's: a little wider.
    assert 0.95 < own.coverage_factor / stats.t.ppf(0.975, 11) < 1


@pytest.mark.parametrize(
    ("scale", "tool"),
    [
        ("known", "laser"),
        ("known", "open probe"),
        ("estimated", "laser"),
        ("estimated", "open laser"),
        ("separate", "laser"),
    ],
)
def test_it_adds_up_to_the_variance_of_the_result(scale, tool):
    fit = fitted(scale, tool)
    assert fit.converged
    parameters = fit.problem.parameters
    std = parameters.unscaled(fit.std) * parameters.display
    found = budgets_of(fit)
    assert {"delta3", "delta4"} < set(found)
    for name, own in found.items():
        squares = [math.copysign(row.contribution**2, row.contribution) for row in own.rows]
        assert own.std == pytest.approx(std[parameters.index(name)], rel=1e-12)
        assert sum(squares) == pytest.approx(own.std**2, rel=1e-9)
        for row in own.rows:
            assert math.copysign(row.contribution**2, row.contribution) == pytest.approx(
                row.share * own.std**2
            )
            if row.std is not None:
                assert row.contribution == pytest.approx(row.sensitivity * row.std)


def test_without_curvature_it_is_fishers_information():
    fit = fitted()
    covariance = np.linalg.inv(Density(fit.problem).slopes(fit.x[None]).information[0])
    parameters = fit.problem.parameters
    std = parameters.unscaled(np.sqrt(np.diag(covariance))) * parameters.display
    for name, own in budgets_of(fit).items():
        rest = sum(row.contribution**2 for row in own.rows if row.kind != "curvature")
        assert rest == pytest.approx(std[parameters.index(name)] ** 2, rel=1e-8)
        assert abs(row_of(own, "curvature").share) < 0.01


def moved(fit, **changes):
    """x of the fit to the same shots where something else was stated."""
    problem = dataclasses.replace(fit.problem, **changes)
    return fit_rows(Density(problem), fit.x[None]).x[0]


@pytest.mark.parametrize("tool", ["laser", "open laser"])
@pytest.mark.one_in(2)
def test_what_was_stated_moves_the_estimate_by_its_sensitivity(tool):
    """Central differences of the fit itself, by each stated number."""
    fit = fitted(tool=tool)
    parameters, problem = fit.problem.parameters, fit.problem
    found = budgets_of(fit)
    by: dict[tuple[str, ...], list[np.ndarray]] = {}
    for i, item in enumerate(parameters.items):
        if item.held:
            continue
        step, ends = 0.05 * min(item.prior_std, 5 * item.tolerance), []
        for side in (step, -step):
            items = list(parameters.items)
            items[i] = dataclasses.replace(item, prior_mean=item.prior_mean + side)
            ends.append(moved(fit, parameters=Parameters(tuple(items))))
        slope = parameters.display * (ends[0] - ends[1]) / (2 * step * item.display)
        key = ("target", item.name[:-2]) if item.group == "target" else ("prior", item.name)
        by.setdefault(key, []).append(slope)
    stated = problem.distances[0]
    ends = [moved(fit, ties=(dataclasses.replace(stated, mm=stated.mm + s),)) for s in (0.05, -0.05)]
    by["distance", "psd", "b"] = [parameters.display * (ends[0] - ends[1]) / 0.1]
    told, measured = [], []
    for name, own in found.items():
        for (kind, *of), slopes in by.items():
            row = row_of(own, kind, *of)
            if row.share > 1e-6:
                told.append(row.sensitivity)
                measured.append(np.sqrt(sum(slope[parameters.index(name)] ** 2 for slope in slopes)))
    assert len(told) > 8
    np.testing.assert_allclose(told, measured, rtol=0.05)
    assert not np.allclose(told, np.roll(measured, 1), rtol=0.05)


def scatter(draws):
    """For each joint and the spot: the std of each offset over fits to runs in which it alone is noisy, and
    its contribution."""
    plan = good_plan(8)
    truth, problem, joints, spots = many_runs(plan, TABLE_2, 1, seed=3)
    n = problem.robot.n
    # The shots as they would be without any noise: the recorded ones, their spots at the miss.
    miss, _ = problem.moved(joints[0], np.zeros_like(spots[0])).linearise(truth)
    still = problem.moved(joints[0], miss)
    fit = fit_likelihood(still, starts=0)
    found = budgets_of(fit)
    rng = np.random.default_rng(11)
    size = (n + 1) * draws
    noisy_joints = np.tile(still.joints, (size, 1, 1))
    noisy_spots = np.tile(still.spots, (size, 1, 1))
    for k in range(n):
        own = slice(k * draws, (k + 1) * draws)
        noisy_joints[own, :, k] += rng.normal(size=(draws, still.shots)) * problem.noise.joint[k]
    noisy_spots[n * draws :] += rng.normal(size=noisy_spots[n * draws :].shape) * problem.noise.spot
    density = Density(still, noisy_joints, noisy_spots)
    fits = fit_rows(density, np.tile(fit.x, (size, 1)))
    assert fits.converged.all()
    measured, told = [], []
    for k in range(n + 1):
        x = fits.x[k * draws : (k + 1) * draws]
        source = ("spot",) if k == n else ("joint", str(k + 1))
        measured.append([math.degrees(x[:, int(name[5:]) - 1].std(ddof=1)) for name in found])
        told.append([row_of(own, *source).contribution for own in found.values()])
    return np.array(measured), np.array(told)


@pytest.mark.parametrize("draws", [100, pytest.param(3000, marks=pytest.mark.long)])
def test_one_source_alone_scatters_the_estimate_by_its_contribution(draws):
    measured, told = scatter(draws)
    assert told.shape == (7, 5)
    low, high = np.sqrt(stats.chi2.ppf([1e-5, 1 - 1e-5], draws - 1) / (draws - 1))
    ratio = measured / told
    assert (low < ratio).all()
    assert (ratio < high).all()
    # The contributions of the joint beside it do not pass.
    wrong = measured[:6] / np.roll(told[:6], 1, axis=0)
    assert not ((low < wrong) & (wrong < high)).all()


@pytest.mark.parametrize("scale", ["known", "estimated", "separate"])
@pytest.mark.one_in(3)
def test_the_expanded_uncertainty_is_the_interval_of_the_result(scale):
    _, run = simulated(good_plan(8, noise={"scale": scale}), TABLE_2, seed=6)
    result = analyse(run, ess=100).result
    fit = fit_likelihood(Problem.from_run(run))
    known = {row.name: row for row in result.parameters}
    for own in budget(judge(fit), result.posterior):
        half = (known[own.name].interval95[1] - known[own.name].interval95[0]) / 2
        assert own.std == pytest.approx(known[own.name].std, rel=1e-6)
        assert own.expanded == pytest.approx(half, rel=1e-6)
        assert own.coverage_factor > (1.9 if scale == "known" else 2.1)
        assert own.check is not None


def test_independent_noise_factors_have_the_classical_formula():
    """G.2b with the joints' and the spot's noise, once the covariance of their factors is struck out."""
    fit = fitted("separate")
    noise = fit.problem.parameters.group("noise")[fit.problem.parameters.free]
    covariance = fit.covariance.copy()
    covariance[np.ix_(noise, noise)] = np.diag(np.diag(covariance[np.ix_(noise, noise)]))
    for own in budgets_of(dataclasses.replace(fit, covariance=covariance)).values():
        joint = math.sqrt(sum(row.contribution**2 for row in own.rows if row.kind == "joint"))
        spot = row_of(own, "spot")
        by_hand = own.std**4 / (joint**4 / row_of(own, "joint", "2").dof + spot.contribution**4 / spot.dof)
        assert own.dof == pytest.approx(by_hand)
    kept = [own.dof for own in budgets_of(fit).values()]
    struck = [own.dof for own in budgets_of(dataclasses.replace(fit, covariance=covariance)).values()]
    assert kept != pytest.approx(struck)


def test_what_the_data_do_not_tell_has_no_budget():
    _, problem = simulated_problem(pattern_plan("x"), TABLE_2, seed=2)
    fit = fit_likelihood(problem)
    identified = judge(fit).identified
    status = dict(zip(problem.parameters.names, identified.status, strict=True))
    assert status["delta2"] == "unidentifiable"
    assert set(budgets_of(fit)) == {f"delta{i}" for i in (3, 4, 5, 6)}
    assert budget(judge(dataclasses.replace(fit, converged=False)), UNSAMPLED) == ()


def posterior_row(low, high, ess=1e7, std=0.0203):
    return PosteriorParameter("delta2", "deg", "data", 0.5, std, low, 0.5, high, ess, ess, 1.0, 1e-6)


def test_validation_of_the_linear_interval():
    """u = 0.0203: two digits are 0.020, so half a unit in the last is 0.0005; one is 0.02 and 0.005."""
    half = 0.04

    def check(off, ess=1e7):
        return check_linear(0.5, 0.0203, half, posterior_row(0.5 - half, 0.5 + half + off, ess).ends)

    near = check(0.0003)
    assert (near.validated, near.digits) == (True, 2)
    assert (near.tolerance, near.d_low, near.d_high) == pytest.approx((0.0005, 0.0, 0.0003))
    assert (check(0.0007).validated, check(0.0007).digits) == (False, 2)
    assert check(-0.0007).validated is False
    # Few draws: the standard error of an end is 2.67 u / sqrt(ESS), here 0.0012.
    few = check(0.0003, ess=2000)
    assert few.ends_std == pytest.approx(2.671 * 0.0203 / math.sqrt(2000), rel=1e-3)
    assert (few.validated, few.digits, few.tolerance) == (True, 1, pytest.approx(0.005))
    assert check(0.0003, ess=50).validated is None
    # Twice the standard error is 0.0153, and the ends leave 0.0047 to the tolerance.
    assert check(0.0003, ess=50).too_large == pytest.approx(3.26, abs=0.01)
    assert (check(0.03, ess=2000).validated, check(0.03, ess=2000).digits) == (False, 1)
    # 0.0031 is 2.6 standard errors, but the draws do not decide by two digits, whatever they are.
    assert (check(0.0031, ess=2000).validated, check(0.0031, ess=2000).digits) == (None, 1)
    assert (check(0.0020, ess=2000).validated, check(0.0020, ess=2000).digits) == (True, 1)


def decided(skew, seed=1):
    """The check of 0 ± 1.96 · 0.09 against draws of 0.09 (z + skew (z² - 1)), z a unit normal, and how many
    draws there were."""

    def shown(z):
        return 0.09 * (z + skew * (z**2 - 1))

    def check(judged):
        chains = judged.reshape(-1, judged.shape[2])
        low, high = np.quantile(chains, [0.025, 0.975])
        ends = Ends(chains.std(), low, high, tail_effective(chains))
        return check_linear(0.0, 0.09, 1.959964 * 0.09, ends)

    sampled = sample_density(
        lambda z: -(z[:, 0] ** 2) / 2,
        IndependenceProposal(np.zeros(1), np.eye(1), 6.0),
        seed=seed,
        ess=400,
        judged=shown,
        short_by=lambda judged, _: check(judged).too_large ** 2,
    )
    return check(shown(sampled.values)), sampled.values.size


def test_the_draws_that_a_check_needs_are_taken():
    """u = 0.09 leaves 0.005 as tolerance, which the draws for an ESS of 400 do not decide."""
    few = sample_density(
        lambda z: -(z[:, 0] ** 2) / 2, IndependenceProposal(np.zeros(1), np.eye(1), 6.0), seed=1, ess=400
    ).values.size
    normal, draws = decided(0.0)
    assert (normal.validated, normal.digits) == (True, 1)
    most = 400 * DECIDING_EACH
    assert few < draws < most
    # An end is off by 2.84 times the skew: 0.28 u.
    skewed, draws = decided(0.1)
    assert (skewed.validated, skewed.d_high) == (False, pytest.approx(0.0256, abs=5 * skewed.ends_std))
    assert draws < most
    # Exactly at the tolerance nothing decides.
    close, draws = decided(0.005 / 0.09 / 2.84)
    assert close.validated is None
    assert close.too_large > 1
    assert 0.95 * most < draws <= most


@pytest.mark.parametrize(("std", "tolerance"), [(0.0996, 0.005), (0.094, 0.0005), (9.96, 0.5), (130.0, 5.0)])
def test_the_tolerance_follows_the_rounded_uncertainty(std, tolerance):
    found = check_linear(0.0, std, 2 * std, posterior_row(-2 * std, 2 * std, std=std, ess=1e12).ends)
    assert found.tolerance == pytest.approx(tolerance)


def test_the_standard_error_of_an_end():
    draws = np.random.default_rng(1).normal(size=(2000, 1000))
    ends = np.quantile(draws, 0.975, axis=1)
    row = posterior_row(-1.96, 1.96, ess=1000.0, std=1.0)
    assert check_linear(0.0, 1.0, 1.96, row.ends).ends_std == pytest.approx(ends.std(), rel=0.1)


def test_the_posterior_of_the_prior_is_not_compared():
    fit = fitted()
    prior = dataclasses.replace(posterior_row(-1.0, 1.0), source="prior")
    posterior = dataclasses.replace(UNSAMPLED, converged=True, parameters=(prior,))
    assert budgets_of(fit, posterior)["delta2"].check is None
    posterior = dataclasses.replace(posterior, parameters=(posterior_row(-1.0, 1.0),))
    assert budgets_of(fit, posterior)["delta2"].check.validated is False
    assert budgets_of(fit)["delta2"].check is None
