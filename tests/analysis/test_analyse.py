import dataclasses
import json

import numpy as np
import pytest
from cells import TABLE_2, good_plan, header, pattern_plan, plan_of, run_of, simulated
from scipy import stats

from zerobeam.analysis.analyse import analyse
from zerobeam.analysis.estimation.fit import fit_likelihood
from zerobeam.analysis.observability.causes import Held
from zerobeam.analysis.observability.check import check
from zerobeam.analysis.observability.identifiability import identify
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.finding_words import likelihood_message, notes
from zerobeam.words.message import headline
from zerobeam.words.sentences import to_json


def rows(result):
    return {row.name: row for row in result.parameters}


@pytest.fixture(scope="module")
def good():
    plan = good_plan()
    truth, run = simulated(plan, TABLE_2, seed=2)
    found = analyse(run, ess=400)
    return plan, truth, run, found.result, found.draws


def test_a_good_run_passes(good):
    *_, result, draws = good
    assert result.verdict == "pass"
    assert headline(result).startswith("delta2, delta3, delta4 and delta5 are identified, U ≤ ")
    assert "; delta6 assumed." in headline(result)
    assert result.findings == ()
    assert result.likelihood.converged
    assert result.likelihood.other_basins == 0
    assert result.midpoint.converged
    assert result.posterior.converged
    assert draws is not None
    assert draws.converged


def test_the_true_offsets_lie_in_their_99_percent_intervals(good):
    _, truth, _, result, _ = good
    names = truth.problem.parameters.names
    for row in result.parameters:
        if not row.held:
            true = truth.x[names.index(row.name)] * truth.problem.parameters.display[names.index(row.name)]
            assert abs(row.estimate - true) < stats.norm.ppf(0.995) * row.std
            assert row.data_std == pytest.approx(row.std, rel=0.1)


def test_rows_of_the_answer(good):
    *_, result, _ = good
    held = rows(result)["delta1"]
    assert (held.status, held.held, held.estimate, held.std) == ("held", True, 0.0, None)
    assert (held.data_std, held.interval95, held.midpoint) == (None, None, None)
    assert held.cause == Held("base frame")
    row = rows(result)["delta4"]
    half = stats.norm.ppf(0.975) * row.std
    assert row.interval95 == pytest.approx((row.estimate - half, row.estimate + half))
    assert (row.unit, row.group, row.prior_std, row.cause) == ("deg", "offset", pytest.approx(5.0), None)
    assert row.midpoint == pytest.approx(row.estimate, abs=4 * row.std)
    target = rows(result)["psd.y"]
    assert (target.unit, target.group, target.prior_std) == ("mm", "target", 10_000.0)


def test_fit_quality(good):
    _, _, run, result, _ = good
    problem = Problem.from_run(run)
    fit = fit_likelihood(problem)
    told = result.likelihood
    assert told.chi2 == pytest.approx(fit.whitened.residual @ fit.whitened.residual)
    assert told.dof == 20 - 8
    assert told.p_value == pytest.approx(stats.chi2.sf(told.chi2, 12))
    assert told.cost == pytest.approx(told.chi2 / 2)
    length = np.linalg.norm(fit.whitened.residual_mm, axis=1)
    assert told.rms_mm == pytest.approx(np.sqrt((length**2).mean()))
    assert told.rms_before_mm > 5 * told.rms_mm
    assert told.noise_scale is None
    np.testing.assert_allclose([np.hypot(*shot.miss_mm) for shot in result.shots], length)
    assert [shot.shot for shot in result.shots] == list(range(10))


def test_what_it_was_made_from(good):
    _, _, run, result, _ = good
    inputs = result.inputs
    assert (inputs.run, inputs.robot, inputs.shots, inputs.seed) == ("run.jsonl", "irb1600", 10, 0)
    assert inputs.targets == ("psd",)
    assert inputs.sha256 == run.sha256
    assert {"zerobeam", "numpy", "casadi", "python"} <= set(inputs.versions)
    assert inputs.header["noise"]["spot_mm"] == 0.05


def test_progress_is_told_in_order(good):
    _, _, run, *_ = good
    told = []
    analyse(run, ess=400, progress=lambda stage, share: told.append((stage, share)))
    stages = ["fit", "identifiability", "posterior", "diagnostics"]
    assert list(dict.fromkeys(stage for stage, _ in told)) == stages
    for stage in stages:
        shares = [share for own, share in told if own == stage]
        assert shares == sorted(shares)
        assert (shares[0], shares[-1]) == (0.0, 1.0)


def test_the_order_of_shots_and_the_target_s_name_do_not_matter(good):
    plan, _, run, result, _ = good
    order = np.random.default_rng(1).permutation(10)
    guess = list(plan.header.targets["psd"].guess_mm)
    own = header(targets={"z": {"guess_mm": guess}})
    shots = [run.shots[i].model_copy(update={"target": "z"}) for i in order]
    other = analyse(run_of(own, shots), sampling="never").result
    assert other.verdict == result.verdict
    for row, same in zip(result.parameters, other.parameters, strict=True):
        assert same.status == row.status
        assert same.name == row.name.replace("psd", "z")
        if not row.held:
            assert same.estimate == pytest.approx(row.estimate, abs=1e-5 * row.std)
            assert same.std == pytest.approx(row.std, rel=1e-3)
            assert same.data_std == pytest.approx(row.data_std, rel=1e-6)
    cooks = {shot.shot: shot.cooks for shot in other.shots}
    for shot in result.shots:
        assert cooks[shot.shot] == pytest.approx(shot.cooks, rel=1e-3)


def test_the_x_pattern_claims_nothing_of_delta2():
    """(That no output of it does, nor of a freed gauge or of too few measurements: `test_decisive`.)"""
    plan = pattern_plan("x", joint_deg=0.01)
    found = analyse(simulated(plan, TABLE_2, seed=3)[1], ess=400)
    assert found.result.verdict == "degenerate"
    answer = to_json(found.result)
    assert "delta2 is unidentifiable; " in answer["headline"]
    assert "Joint 1 varies by only" in answer["headline"]
    (null,) = [d for d in answer["identifiability"]["null_space"] if d["combination"].get("delta2") == 1.0]
    assert null["remedy"].startswith("measure again and vary joint 1 by 90°")
    assert "delta2" not in found.draws.names
    assert "delta2" in [prior.name for prior in found.draws.prior_only]


def test_nothing_is_sampled_where_no_parameter_is_identifiable(monkeypatch):
    """Two measurements of the 7, 4 numbers for 8 unknowns: they spent the sampler's whole budget."""
    own = good_plan()
    _, run = simulated(own, TABLE_2)

    def sampled(*_, **__):
        raise AssertionError

    monkeypatch.setattr("zerobeam.analysis.analyse.sample_posterior", sampled)
    found = analyse(run_of(own.header, run.shots[:2], own.robot))
    assert {row.status for row in found.result.parameters} == {"held", "unidentifiable"}
    assert found.draws is None
    answer = to_json(found.result)
    assert answer["posterior"]["message"] == "not sampled: no parameter is identifiable"
    assert answer["posterior"]["parameters"] is None
    assert not any("posterior" in note for note in answer["notes"])
    with pytest.raises(AssertionError):
        analyse(run)


def test_understated_noise_is_a_lack_of_fit():
    plan = good_plan(joint_deg=0.05)
    _, run = simulated(plan, TABLE_2, seed=2)
    result = analyse(run_of(header(joint_deg=0.01), run.shots), sampling="never").result
    assert result.likelihood.p_value < 1e-3
    assert notes(result)[0].startswith("Lack of fit")
    assert "times the stated noise" in notes(result)[0]


def test_an_estimated_scale_uses_student_t():
    plan = good_plan(noise={"scale": "estimated"})
    result = analyse(simulated(plan, TABLE_2, seed=2)[1], sampling="never").result
    fit = result.likelihood
    assert fit.p_value is None
    assert 0.3 < fit.noise_scale < 2.5
    assert "estimated from these residuals" in likelihood_message(fit)
    row = rows(result)["delta3"]
    half = stats.t.ppf(0.975, fit.dof) * row.std
    assert row.interval95 == pytest.approx((row.estimate - half, row.estimate + half))
    assert fit.dof == 12


def test_an_outlying_shot_is_named():
    plan = good_plan(16)
    _, run = simulated(plan, TABLE_2, seed=5)
    shots = list(run.shots)
    moved = list(shots[11].joints_deg)
    moved[4] += 0.15
    shots[11] = shots[11].model_copy(update={"joints_deg": tuple(moved)})
    result = analyse(run_of(plan.header, shots), sampling="never").result
    (note,) = [note for note in notes(result) if note.startswith("Outlying")]
    assert "11" in note
    assert max(result.shots, key=lambda shot: shot.cooks).shot == 11


def test_as_many_unknowns_as_numbers():
    plan = good_plan()
    four = plan_of(plan.header, plan.postures[:4])
    result = analyse(simulated(four, TABLE_2, seed=1)[1], sampling="never").result
    assert result.likelihood.dof == 0
    assert result.likelihood.p_value is None
    assert "cannot be checked against the noise" in likelihood_message(result.likelihood)


def test_a_fit_that_does_not_converge_reports_nothing(good, monkeypatch):
    _, _, run, *_ = good
    real = fit_likelihood

    def failing(problem, **kwargs):
        return dataclasses.replace(real(problem, **kwargs), converged=False, reason="made to fail")

    monkeypatch.setattr("zerobeam.analysis.ladder.fit_likelihood", failing)
    found = analyse(run, ess=400, robust="huber")
    result, draws = found.result, found.draws
    assert draws is None
    assert (result.intervals, result.robust) == ((), None)
    assert result.verdict != "pass"
    assert not result.posterior.converged
    assert notes(result)[0].startswith("The fit did not converge: made to fail")
    assert "made to fail" in headline(result)
    for row in result.parameters:
        assert row.std is None
        assert row.interval95 is None
        assert row.held or row.estimate is None
    json.dumps(to_json(result), allow_nan=False)


def test_distances_beside_what_the_fit_makes_of_them():
    plan = good_plan(16)
    targets = {"a": {"guess_mm": [900, 0, 0]}, "b": {"guess_mm": [900, 50, 0]}}
    stated = {"between": ["a", "b"], "mm": 50.0, "sigma_mm": 0.1}
    own = header(targets=targets, distances=[stated])
    result = analyse(
        simulated(plan_of(own, plan.postures, ["a", "b"] * 8), TABLE_2, seed=1)[1], ess=400
    ).result
    (row,) = result.distances
    assert (row.between, row.mm, row.sigma_mm) == (("a", "b"), 50.0, 0.1)
    assert 0 < row.std < 0.1
    assert row.estimate == pytest.approx(50.0, abs=4 * row.std)


def test_one_shot_and_a_target_seen_once_are_refused(refused):
    plan = good_plan()
    _, run = simulated(plan, TABLE_2)
    assert "one measurement" in str(refused(analyse, run_of(plan.header, run.shots[:1])))
    shots = [*run.shots[:9], run.shots[9].model_copy(update={"target": "b"})]
    error = refused(analyse, run_of(header(target=None), shots))
    assert "measured only once" in str(error)
    assert error.line == 11


def test_a_scale_cannot_be_estimated_from_as_many_numbers_as_unknowns(refused):
    plan = good_plan(noise={"scale": "estimated"})
    _, run = simulated(plan, TABLE_2)
    error = refused(analyse, run_of(plan.header, run.shots[:4]))
    assert "noise scale cannot be estimated" in str(error)
    assert "8 numbers from 4 measurements for 8 unknowns" in str(error)
    assert error.remedy


def test_a_check_and_an_analysis_agree_on_the_statuses():
    for plan in (good_plan(), pattern_plan("y")):
        problem = Problem.from_run(simulated(plan, TABLE_2, seed=3)[1])
        after = identify(problem, fit_likelihood(problem, starts=0).x).status
        before = tuple(row.status for row in check(plan).parameters)
        assert sum(a != b for a, b in zip(before, after, strict=True)) <= 1


@pytest.mark.long
def test_the_effective_number_is_that_by_which_the_measurements_count():
    """Where neighbouring measurements err alike, it says by how much their information was divided."""
    _, run = simulated(good_plan(40, spot_mm=0.3, joint_deg=0.001), TABLE_2, seed=3)
    rng, error, drifting = np.random.default_rng(3), np.zeros(2), []
    for shot in run.shots:
        error = 0.8 * error + 0.6 * rng.normal(scale=0.3, size=2)
        drifting.append(shot.model_copy(update={"spot_mm": tuple(error.tolist())}))
    alike = analyse(run_of(run.header, drifting), sampling="never")
    own = alike.result.placements.effective
    assert 2 < own.divisor < own.kappa
    np.testing.assert_array_equal(alike.problem.weights, 1 / own.divisor)
    # Control: measurements that are apart count in full.
    apart = analyse(run, sampling="never")
    assert apart.result.placements.effective.divisor == 1
    np.testing.assert_array_equal(apart.problem.weights, 1)
