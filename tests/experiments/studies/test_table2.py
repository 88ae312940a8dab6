"""The paper's Table 2 as a study: the noise that explains a scatter, and whether one explains all of it."""

import functools
import json
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from zerobeam.experiments.simulate import simulated_readings
from zerobeam.experiments.studies import table2
from zerobeam.experiments.studies.cases import Engine
from zerobeam.experiments.studies.cell import paper_plan
from zerobeam.experiments.studies.data_sets import DataSets, fitted, laser_header
from zerobeam.experiments.studies.table2 import (
    EXPERIMENTS,
    OFFSETS,
    PRINTED_MEAN,
    PRINTED_STD,
    Prediction,
    compared,
    explained,
    scatter,
    table2_study,
    unevenness,
)
from zerobeam.model.records import to_json

DOF = 2
TRUTH = dict(zip(OFFSETS, EXPERIMENTS.mean(axis=0).tolist(), strict=True))
OURS = Prediction(paper_plan(laser_header(0.01, 0.001)), TRUTH)


def triples(count: int, joint_deg: float, seed: int, prediction: Prediction = OURS) -> np.ndarray:
    """(count, 3, 5) deg, as the prediction has them."""
    normal = np.random.default_rng(seed).normal(size=(count, *EXPERIMENTS.shape))
    return np.asarray(normal @ np.linalg.cholesky(prediction.covariance(joint_deg)).T)


def test_what_is_printed_follows_from_the_experiments() -> None:
    np.testing.assert_allclose(EXPERIMENTS.mean(axis=0), PRINTED_MEAN, atol=0.5001e-4)
    np.testing.assert_allclose(EXPERIMENTS.std(axis=0, ddof=1), PRINTED_STD, atol=0.5e-4)
    assert [note for note in table2._on_the_paper() if "printed as" in note] == []


def test_a_misprint_would_be_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table2, "PRINTED_STD", (0.0804, 0.0408, 0.0224, 0.0695, 0.0035))
    misprints = [note for note in table2._on_the_paper() if "printed as" in note]
    assert len(misprints) == 1
    assert "J5 (δ5)" in misprints[0]


def test_the_predicted_covariance_is_that_of_fits() -> None:
    """200 simulated runs of the same plan, solved: their scatter by the prediction is a chi-squared."""
    joint_deg, runs = 0.002, 200
    problem = OURS._at(joint_deg)
    truths = np.tile(OURS._x, (runs, 1))
    readings = simulated_readings(problem, truths, np.random.default_rng(1))
    assert readings.met.all()
    fits = fitted(DataSets(problem, truths, readings.joints, readings.spots, 0))
    assert fits.converged.all()
    estimates = np.degrees(fits.x[:, 1:6])
    dof = (runs - 1) * len(OFFSETS)
    chi2 = np.trace(np.linalg.solve(OURS.covariance(joint_deg), scatter(estimates)))
    assert stats.chi2.ppf(0.001, dof) < chi2 < stats.chi2.ppf(0.999, dof)
    # And with a noise that is wrong by a tenth it is not.
    other = np.trace(np.linalg.solve(OURS.covariance(1.1 * joint_deg), scatter(estimates)))
    assert other < stats.chi2.ppf(0.001, dof)


def test_the_noise_is_found_in_closed_form_where_the_spot_says_nothing() -> None:
    """Then C = j^2 C1: j^2 = tr(C1^-1 A) / (p dof), and its interval is a chi-squared's."""
    unit = OURS.covariance(0.01)
    scattered = scatter(triples(1, 0.003, seed=2))[0]
    noise = explained(lambda joint_deg: (joint_deg / 0.01) ** 2 * unit, scattered, DOF)
    total, p = float(np.trace(np.linalg.solve(unit, scattered))), len(OFFSETS)
    assert noise.joint_deg == pytest.approx(0.01 * np.sqrt(total / (p * DOF)), rel=1e-4)
    assert noise.low == pytest.approx(0.01 * np.sqrt(total / stats.chi2.ppf(0.975, p * DOF)), rel=1e-6)
    assert noise.high == pytest.approx(0.01 * np.sqrt(total / stats.chi2.ppf(0.025, p * DOF)), rel=1e-6)


@pytest.mark.long
def test_the_interval_holds_the_noise_as_often_as_it_says() -> None:
    """With a spot noise that matters; 200 triples, the exact binomial's bounds at one in a thousand."""
    loud = Prediction(paper_plan(laser_header(0.01, 0.05)), TRUTH)

    @functools.cache
    def at(percent: int) -> np.ndarray:
        return loud.covariance(np.exp(percent / 100))

    def covariance(joint_deg: float) -> np.ndarray:
        return at(round(100 * np.log(joint_deg)))  # steps of a percent are fine enough, and quick

    held = 0
    for one in triples(200, 0.003, seed=3, prediction=loud):
        noise = explained(covariance, scatter(one), DOF)
        held += noise.low <= 0.003 <= noise.high
    low, high = stats.binom.ppf([0.0005, 0.9995], 200, 0.95)
    assert low <= held <= high


def test_a_scatter_below_that_of_the_spot_leaves_the_noise_open_downwards() -> None:
    loud = Prediction(paper_plan(laser_header(0.01, 0.05)), TRUTH)
    noise = explained(loud.covariance, 0.1 * scatter(triples(1, 1e-6, 4, loud))[0], DOF)
    assert noise.low == 0.0
    assert noise.high < 0.003
    assert table2._alone(loud, 0, 1e-3) == 0.0
    std = float(np.sqrt(loud.covariance(0.004)[0, 0]))
    assert table2._alone(loud, 0, std) == pytest.approx(0.004, rel=1e-6)


def test_one_noise_is_seen_where_it_is_and_not_where_it_is_not() -> None:
    """Along the axes the sums of squares over the predicted variances are chi-squared and independent: the
    ratio is Bartlett's, the same at any noise. Where one axis has a thirtieth of the noise it is larger."""
    covariance = OURS.covariance(0.002)
    even = unevenness(covariance, scatter(triples(4000, 0.002, seed=5)), DOF)
    independent = np.random.default_rng(6).chisquare(DOF, size=(4000, 5)) / DOF
    bartlett = DOF * (5 * np.log(independent.mean(axis=1)) - np.log(independent).sum(axis=1))
    assert stats.ks_2samp(even, bartlett).pvalue > 0.001
    louder = unevenness(OURS.covariance(0.02), 100 * scatter(triples(4000, 0.002, seed=5)), DOF)
    np.testing.assert_allclose(louder, even, rtol=0.01, atol=0.01)
    variance, axes = np.linalg.eigh(covariance)
    variance[-1] /= 30**2
    root = axes * np.sqrt(variance)
    other = np.random.default_rng(7).normal(size=(1000, 3, 5)) @ root.T
    uneven = unevenness(covariance, scatter(other), DOF)
    assert np.mean(uneven > np.quantile(even, 0.95)) > 0.5
    assert np.mean(even > np.quantile(even, 0.95)) == pytest.approx(0.05, abs=1e-3)


def test_the_study(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The real thing with fewer triples, without pictures and of our Y-Pattern alone: stopped after its first
    plan, and resumed."""
    monkeypatch.setattr(table2, "CellFile", functools.partial(table2.CellFile, camera=None))
    monkeypatch.setattr(table2, "optimal_plan", lambda header, seed: paper_plan(header))
    shares: list[float] = []
    store = tmp_path / "table2.cases.jsonl"

    def stopped(stage: str, share: float) -> None:
        shares.append(share)
        if stage == "run 2/6":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        table2_study(Engine(0, stopped, processes=1, store=store), triples=199)
    kept = store.read_bytes()
    assert kept.count(b"\n") == 3  # the heading and two runs
    stages: list[str] = []
    resumed = table2_study(
        Engine(0, lambda stage, _: stages.append(stage), processes=1, store=store), triples=199
    )
    answer = to_json(resumed)
    assert stages[1:3] == ["run 2/6", "run 3/6"]
    assert store.read_bytes().startswith(kept)
    # Both are the same plan with the same seeds: all but what depends on the random triples is the same.
    ours, other = answer["plans"]
    for key in ("joint_deg", "low", "high", "chi2", "dof", "chance", "axes"):
        assert ours[key] == other[key]
    assert ours["p_value"] != other["p_value"]
    assert json.loads(json.dumps(answer, allow_nan=False)) == answer
    assert shares == sorted(shares)
    assert answer["paper"]["std"] == pytest.approx(EXPERIMENTS.std(axis=0, ddof=1).tolist())
    assert ours["low"] < ours["joint_deg"] < ours["high"]
    assert ours["chance"] >= 0.005
    assert answer["agrees"]
    for k, row in enumerate(ours["parameters"]):
        assert row["paper_std"] == pytest.approx(EXPERIMENTS[:, k].std(ddof=1))
        # What three runs tell of a std: the square root of 2 over a quantile of chi-squared with 2.
        assert row["low"] == pytest.approx(0.5207 * row["paper_std"], rel=1e-3)
        assert row["high"] == pytest.approx(6.285 * row["paper_std"], rel=1e-3)
        # The median of the square root of chi-squared with 2 over 2, of 199: within 4 standard errors.
        assert row["simulated"]["median"] == pytest.approx(0.8326 * row["predicted_std"], rel=0.25)
        ratio = row["alone_deg"] / ours["joint_deg"]
        assert ratio == pytest.approx(row["paper_std"] / row["predicted_std"], rel=0.05)


def test_a_scatter_that_is_not_as_predicted_does_not_agree() -> None:
    noise = explained(OURS.covariance, scatter(EXPERIMENTS), DOF)
    normal = np.random.default_rng(8).normal(size=(199, 3, 5))
    good = triples(1, noise.joint_deg, seed=9)[0]
    assert compared("made", "made", 7, OURS, noise, good, normal).agrees
    for wrong in (good * 4, good / 10):
        assert not compared("made", "made", 7, OURS, noise, wrong, normal).agrees
    lost = compared("made", "made", 7, OURS, noise, good[:2], normal)
    assert not lost.agrees
    assert lost.parameters[0].simulated_std is None
