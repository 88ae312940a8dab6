"""Repeated runs: their scatter against the prediction, drift, the odd one, and what may not be compared."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import LASER, TABLE_2, good_plan, pattern_plan, run_of, simulated
from repeated_runs import COVARIANCE, drawn, repeat, repeats, run_files, table_file
from scipy import stats
from small_results import small_result

from zerobeam.analysis.estimation.fit import fit_likelihood
from zerobeam.analysis.left_over import holm
from zerobeam.analysis.repeatability.compare import Comparison, sample_of
from zerobeam.analysis.repeatability.compare import compare as compare_runs
from zerobeam.analysis.repeatability.consistency import (
    RunSample,
    against_others,
    consistency,
    drift,
    mean_of,
    without_prior,
)
from zerobeam.analysis.repeatability.repeats import Kind, Repeat, fitted, problem_of, unfitted
from zerobeam.analysis.solution import solve
from zerobeam.experiments.simulate import Truth, simulated_readings
from zerobeam.experiments.studies.table2 import EXPERIMENTS, OFFSETS, PRINTED_MEAN, PRINTED_STD
from zerobeam.model.errors import BadInput
from zerobeam.model.files.plan import Plan
from zerobeam.model.files.run import Run
from zerobeam.model.files.shot import Shot
from zerobeam.model.likelihood.problem import Problem
from zerobeam.model.parsing.validation import LARGEST
from zerobeam.words.sentences import to_json

ROOT = Path(__file__).resolve().parents[3]
Json = dict[str, Any]


def compare(paths: Sequence[Path | str]) -> Json:
    """The answer as `compare --json` prints it."""
    return to_json(compare_runs(paths))


def compared(kind: Kind, repeats: Sequence[Repeat], seed: int) -> Json:
    return to_json(Comparison.of_repeats(kind, repeats, seed))


def sample(values: np.ndarray, covariances: np.ndarray | None = None, **changes: Any) -> RunSample:
    """Of runs that all predict COVARIANCE, unless stated otherwise."""
    covariances = np.tile(COVARIANCE, (len(values), 1, 1)) if covariances is None else covariances
    stated = {
        "joint": True,
        "noise_dof": None,
        "at": np.arange(1.0, len(values) + 1),
        "by_geometry": np.zeros((*values.shape, 0)),
    }
    return RunSample(values, covariances, **{**stated, **changes})


def unpredicted(values: np.ndarray, at: np.ndarray) -> RunSample:
    return RunSample(values, None, False, None, at, np.zeros((*values.shape, 0)))


def test_table_2_gives_the_means_and_stds_of_the_paper_to_its_digits(tmp_path: Path) -> None:
    answer = compare([table_file(tmp_path)])
    assert [row["name"] for row in answer["offsets"]] == list(OFFSETS)
    np.testing.assert_allclose([row["mean"] for row in answer["offsets"]], PRINTED_MEAN, atol=0.5001e-4)
    np.testing.assert_allclose([row["std"] for row in answer["offsets"]], PRINTED_STD, atol=0.5e-4)
    assert [run["name"] for run in answer["runs"]] == ["experiment 1", "experiment 2", "experiment 3"]
    assert json.loads(json.dumps(answer, allow_nan=False)) == answer


def test_table_2_implies_little_and_says_so(tmp_path: Path) -> None:
    """Nothing is predicted, so nothing is called consistent; a std of three is known to a factor of 12."""
    answer = compare([table_file(tmp_path)])
    assert (answer["verdict"], answer["consistency"]) == ("not tested", None)
    for row, values in zip(answer["offsets"], EXPERIMENTS.T, strict=True):
        assert row["predicted_std"] is row["ratio"] is row["p_value"] is None
        low, high = row["std_interval95"]
        assert low / row["std"] == pytest.approx(0.5207, rel=1e-3)
        assert high / row["std"] == pytest.approx(6.285, rel=1e-3)
        half = stats.t.ppf(0.975, 2) * values.std(ddof=1) / np.sqrt(3)
        assert row["mean_interval95"] == pytest.approx([values.mean() - half, values.mean() + half])
    told = " ".join(answer["notes"])
    assert "0.52 and 6.3 times" in told
    assert "zerobeam study table2" in told
    # delta2 falls in a line, which one of five offsets does by chance once in 38.
    assert "A possible drift, not significant: delta2" in told
    assert answer["drifting"] == []
    assert answer["odd_run"] is None


def test_an_offset_that_a_table_does_not_state_has_no_number_there(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("run,delta2_deg,delta3_deg,d4_mm\na,1,2,\nb,1.5,,\nc,1.2,2.5,7\n")
    answer = compare([path])
    assert [row["runs"] for row in answer["offsets"]] == [3, 2, 0]
    assert answer["offsets"][2]["mean"] is answer["offsets"][2]["std"] is None
    assert [run["offsets"][1]["estimate"] for run in answer["runs"]] == [2.0, None, 2.5]
    assert any("Not compared: d4" in note for note in answer["notes"])
    largest = LARGEST["deg"]
    path.write_text(f"run,delta2_deg\na,{largest!r}\nb,{-largest!r}\n")
    assert [row["offsets"][0]["estimate"] for row in compare([path])["runs"]] == [largest, -largest]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("run,delta2\na,1\nb,2\n", "no unit"),
        ("name,delta2_deg\na,1\nb,2\n", "header row"),
        ("run,delta2_deg,delta2_deg\na,1,1\nb,2,2\n", "header row"),
        ("run,delta2_deg\na,1\n", "one run"),
        ("run,delta2_deg\na,1\na,2\n", "cannot be used"),
        ("run,delta2_deg\na,1\nb,2,3\n", "cannot be used"),
        ("run,delta2_deg\na,1\nb,nan\n", "not an offset"),
        ("run,delta2_deg\na,1\nb,1_0\n", "not an offset"),
        ("run,delta2_deg\na,1\nb,x\n", "not an offset"),
    ],
)
def test_a_table_that_is_not_one_is_refused(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(BadInput, match=said):
        compare([path])


def test_the_common_mean_is_that_of_stacked_least_squares() -> None:
    rng = np.random.default_rng(1)
    covariances = np.array([COVARIANCE * rng.uniform(0.3, 3) for _ in range(4)])
    values = drawn(4, seed=2)
    roots = [np.linalg.inv(np.linalg.cholesky(own)) for own in covariances]
    design = np.vstack(roots)
    mean, chi2, *_ = np.linalg.lstsq(
        design, np.concatenate([r @ v for r, v in zip(roots, values, strict=True)])
    )
    common = sample(values, covariances).common
    np.testing.assert_allclose(common.mean, mean)
    np.testing.assert_allclose(common.covariance, np.linalg.inv(design.T @ design))
    assert common.chi2 == pytest.approx(chi2[0])
    assert common.dof == 9


@pytest.mark.parametrize("noise_dof", [None, 6])
def test_the_interval_of_the_ratio_is_that_of_a_variance(noise_dof: int | None) -> None:
    """A scatter s^2 of d degrees of freedom over the predicted: s^2 / F(d, noise) holds the true ratio."""
    own = sample(drawn(4, seed=2), noise_dof=noise_dof)
    found = consistency(own)
    law = stats.chi2(9, scale=1 / 9) if noise_dof is None else stats.f(9, noise_dof)
    assert found.ratio == pytest.approx(np.sqrt(own.common.chi2 / 9))
    assert found.ratio_interval95 == pytest.approx(found.ratio / np.sqrt(law.ppf([0.975, 0.025])))


def test_what_an_arm_adds_to_all_runs_is_a_covariance_between_them() -> None:
    """Generalised least squares by the covariance of all numbers of all runs."""
    rng = np.random.default_rng(5)
    values, by_geometry = drawn(4, seed=2), rng.normal(size=(4, 3, 2)) * 0.05
    stacked = by_geometry.reshape(12, 2)
    precision = np.linalg.inv(np.kron(np.eye(4), COVARIANCE) + stacked @ stacked.T)
    design = np.tile(np.eye(3), (4, 1))
    covariance = np.linalg.inv(design.T @ precision @ design)
    mean = covariance @ design.T @ precision @ values.ravel()
    off = values.ravel() - design @ mean
    common = sample(values, by_geometry=by_geometry).common
    np.testing.assert_allclose(common.mean, mean)
    np.testing.assert_allclose(common.covariance, covariance)
    assert common.chi2 == pytest.approx(off @ precision @ off)
    assert common.dof == 9


def test_the_mean_by_the_scatter_has_what_the_arm_adds_to_all_runs() -> None:
    """Student's t of the scatter, and a normal deviation common to all runs: more runs do not lower it."""
    values, by_geometry = drawn(5, seed=6), np.tile([[0.1, 0.0], [0.05, 0.05], [0.0, 0.02]], (5, 1, 1))
    found = mean_of(sample(values, by_geometry=by_geometry), 1, False)
    scatter = stats.t.ppf(0.975, 4) * values[:, 1].std(ddof=1) / np.sqrt(5)
    half = np.hypot(scatter, 1.959964 * np.hypot(0.05, 0.05))
    assert found.interval95 == pytest.approx((values[:, 1].mean() - half, values[:, 1].mean() + half))
    predicted = mean_of(sample(values, by_geometry=by_geometry), 1, True)
    assert predicted.by == "prediction"
    common = sample(values, by_geometry=by_geometry).common
    half = 1.959964 * np.sqrt(common.covariance[1, 1])
    assert predicted.interval95 == pytest.approx((common.mean[1] - half, common.mean[1] + half))


def test_a_run_against_the_others_is_its_distance_from_their_mean() -> None:
    values = drawn(4, seed=3)
    own = sample(values)
    others = own.without(1).common
    off = values[1] - others.mean
    told = against_others(own, 1)
    assert told.chi2 == pytest.approx(off @ np.linalg.solve(COVARIANCE + others.covariance, off))
    assert told.dof == 3
    # Without a prediction: Student's t against the scatter of the others, offset by offset.
    alone = against_others(unpredicted(values[:, :1], own.at), 1)
    rest = np.delete(values[:, 0], 1)
    t = abs(values[1, 0] - rest.mean()) / (rest.std(ddof=1) * np.sqrt(1 + 1 / 3))
    assert alone.p_value == pytest.approx(2 * stats.t.sf(t, 2))
    # Two others have a scatter too.
    three = against_others(unpredicted(values[:3, :1], own.at[:3]), 1)
    assert three is not None
    t = abs(values[1, 0] - values[[0, 2], 0].mean()) / (values[[0, 2], 0].std(ddof=1) * np.sqrt(1.5))
    assert three.p_value == pytest.approx(2 * stats.t.sf(t, 1))


def test_drift_is_that_of_a_regression() -> None:
    at, values = np.array([0.0, 1.0, 5.0, 7.0]), np.array([0.1, 0.3, 0.2, 0.6])
    told = drift(unpredicted(values[:, None], at))
    line = stats.linregress(at, values)
    assert told.slope == pytest.approx(line.slope)
    assert told.p_value == pytest.approx(line.pvalue)
    half = stats.t.ppf(0.975, 2) * line.stderr
    assert told.interval95 == pytest.approx([line.slope - half, line.slope + half])
    # Numbers that were rounded onto a line tell nothing of the scatter about it.
    assert drift(unpredicted(np.array([[0.1], [0.2], [0.3]]), np.arange(3.0))) is None


def test_holm_raises_the_least_most() -> None:
    assert holm([0.04, 0.01, 0.03]) == pytest.approx([0.06, 0.03, 0.06])


@pytest.mark.long
def test_p_values_are_uniform_with_known_and_with_estimated_noise() -> None:
    """Simulated answers: 400 triples; the noise of each run estimated from 6 numbers."""
    rng, count = np.random.default_rng(4), 400
    known, estimated, wrong = [], [], []
    for k in range(count):
        values = drawn(3, seed=1000 + k)
        scales = np.sqrt(rng.chisquare(6, size=3) / 6)
        own = consistency(sample(values))
        known.append(own.p_value)
        told = [repeat(value, noise_scale=s, noise_dof=6) for value, s in zip(values, scales, strict=True)]
        whole = consistency(sample_of(told, np.arange(3.0), 3))
        assert whole.noise_dof == 18
        estimated.append(whole.p_value)
        wrong.append(stats.chi2.sf(whole.chi2, whole.dof))
    assert stats.kstest(known, "uniform").pvalue > 0.001
    assert stats.kstest(estimated, "uniform").pvalue > 0.001
    # As if the estimated noise were known, agreement would be denied too often.
    assert np.sum(np.array(wrong) < 0.01) > stats.binom.ppf(0.999, count, 0.01)


def chi2_of(plan: Plan, sets: int, told: Callable[..., Any]) -> tuple[float, int]:
    """The sum of chi-squared over `sets` comparisons of three simulated runs, and its degrees of freedom."""
    truth = Truth.with_values(plan, TABLE_2)
    of, display = 3, truth.problem.robot.display
    read = simulated_readings(truth.problem, np.tile(truth.x, (sets * of, 1)), np.random.default_rng(0))
    chi2, dof = 0.0, 0
    runs = []
    for joints, spots in zip(read.joints, read.spots, strict=True):
        shots = [
            Shot(shot=i, target="psd", joints_deg=tuple(q * display), spot_mm=tuple(spot))
            for i, (q, spot) in enumerate(zip(joints, spots, strict=True))
        ]
        runs.append(run_of(plan.header, shots))
    for first in range(0, len(runs), of):
        own = [told(run) for run in runs[first : first + of]]
        whole = compared("runs", own, 0)["consistency"]
        chi2, dof = chi2 + whole["chi2"], dof + whole["dof"]
    return chi2, dof


def without_its_prior(run: Run) -> Repeat:
    problem = problem_of(run)
    return fitted(unfitted(run, problem, "run"), problem, run.header, 0)


def by_chance(chi2: float, dof: int) -> bool:
    return bool(stats.chi2.ppf(0.001, dof) < chi2 < stats.chi2.ppf(0.999, dof))


def test_runs_scatter_as_predicted_and_not_as_two_thirds_of_it() -> None:
    chi2, dof = chi2_of(good_plan(10), 3, without_its_prior)
    assert by_chance(chi2, dof)
    # As if the headers stated two thirds of the noise.
    assert not by_chance(chi2 * 1.5**2, dof)


@pytest.mark.long
@pytest.mark.parametrize("changes", [{}, {"joint_deg": 0.1}, {"prior": {"offset_deg": 0.16}}])
def test_runs_scatter_as_predicted_whatever_the_prior(changes: Json) -> None:
    """Identified, weak, and nearly known before: the prior has no part in what is compared."""
    assert by_chance(*chi2_of(good_plan(7, **changes), 40, without_its_prior))


def by_the_mode(run: Run) -> Repeat:
    """With the prior left in its estimates."""
    return replace(without_its_prior(run), value=np.degrees(fit_likelihood(Problem.from_run(run)).x[1:6]))


@pytest.mark.long
def test_estimates_with_the_prior_in_them_would_agree_falsely() -> None:
    chi2, dof = chi2_of(good_plan(7, prior={"offset_deg": 0.16}), 120, by_the_mode)
    assert chi2 < stats.chi2.ppf(0.001, dof)


def test_the_prior_is_taken_out_of_values_and_covariance() -> None:
    """With a prior as wide as what the shots tell: the same numbers as without any prior to speak of."""
    columns = [1, 2, 3, 4, 5]
    found = []
    for prior in (0.16, 50.0):
        plan = good_plan(7, prior={"offset_deg": prior}, joint_deg=0.01)
        truth = Truth.with_values(plan, {})
        read = simulated_readings(truth.problem, truth.x[None], np.random.default_rng(3))
        fit = fit_likelihood(truth.problem.moved(read.joints[0], read.spots[0]))
        found.append((fit.x[columns], *without_prior(fit, columns)[:2]))
    (pulled, value, covariance), (wide, same, like) = found
    std = np.sqrt(np.diag(like))
    np.testing.assert_allclose((value - wide) / std, 0, atol=0.02)
    np.testing.assert_allclose((same - wide) / std, 0, atol=0.02)
    np.testing.assert_allclose(covariance, like, rtol=0.02)
    assert np.abs((pulled - wide) / std).max() > 0.1


@pytest.mark.parametrize("scale", ["known", "estimated"])
def test_noise_and_tolerances_are_told_apart(scale: str) -> None:
    """Their parts add up to the covariance of the fit, where no prior has a part in it."""
    stated = {"gravity": False, "harmonics": False}
    plan = good_plan(12, geometry=stated, noise={"scale": scale})
    solution = solve(Problem.from_run(simulated(plan, TABLE_2, 1)[1]), starts=0)
    columns = [1, 2, 3, 4, 5]
    found = without_prior(solution.fit, columns)
    stds = np.sqrt(solution.noise_scale**2 * np.diag(found.covariance) + (found.by_geometry**2).sum(axis=1))
    shares = (found.by_geometry**2).sum(axis=1) / stds**2
    for name, std, share in zip([f"delta{i}" for i in range(2, 7)], stds, shares, strict=True):
        row = solution[name]
        assert row.std is not None
        assert np.degrees(std) == pytest.approx(row.std, rel=0.03)
        assert share == pytest.approx(row.tolerance_share, rel=0.03)
        assert 0.1 < share < 1


def test_the_odd_run_is_found_and_where_there_is_none_none(tmp_path: Path) -> None:
    plan = good_plan(10)
    paths = run_files(tmp_path, plan, [{}, {}, {"delta4": TABLE_2["delta4"] + 0.2}, {}])
    answer = compare(paths)
    assert (answer["verdict"], answer["odd_run"]) == ("does not agree", "run3.jsonl")
    assert answer["differing"] == ["delta4"]
    assert "run3.jsonl is the outlier" in answer["headline"]
    assert {row["mean_by"] for row in answer["offsets"]} == {"scatter"}
    rest = compare([path for path in paths if path.name != "run3.jsonl"])
    assert (rest["verdict"], rest["odd_run"]) == ("agrees", None)
    assert {row["mean_by"] for row in rest["offsets"]} == {"prediction"}
    for row in rest["offsets"]:
        low, high = row["mean_interval95"]
        assert low < TABLE_2[row["name"]] < high
    two = compare([paths[0], paths[2]])
    assert (two["verdict"], two["odd_run"]) == ("does not agree", None)
    assert all(row["drift"] is None for row in two["offsets"])
    assert any("With two runs neither a drift nor an outlier can be tested" in note for note in two["notes"])


def test_where_the_others_disagree_as_well_no_one_run_is_odd() -> None:
    values = drawn(4, seed=5) + np.array([[0.0], [0.3], [0.6], [1.2]])
    answer = compared("runs", repeats(values), 0)
    assert answer["verdict"] == "does not agree"
    assert answer["odd_run"] is None


def test_a_scatter_below_the_prediction_is_told() -> None:
    answer = compared("runs", repeats(1 + 0.1 * (drawn(5, seed=6) - 1)), 0)
    assert answer["verdict"] == "agrees"
    assert answer["consistency"]["ratio_interval95"][1] < 1
    assert any("scatter less than predicted" in note for note in answer["notes"])


@pytest.mark.parametrize("slope", [0.0, 0.03])
def test_a_drift_is_found_over_the_order_and_over_the_time(slope: float) -> None:
    values = drawn(8, seed=7)
    hours = np.array([0, 1, 2, 3, 4, 20, 21, 22])
    values[:, 2] += slope * np.arange(8)
    answer = compared("runs", repeats(values), 0)
    assert answer["drifting"] == (["delta4"] if slope else [])
    assert (answer["verdict"] == "does not agree") == bool(slope)
    timed = [
        replace(own, provenance={"when": f"2014-08-0{1 + h // 20}T{h % 20:02d}:00:00Z"})
        for own, h in zip(repeats(values), hours, strict=True)
    ]
    shuffled = compared("runs", timed[::-1], 0)
    assert shuffled["settings"]["order"] == "time"
    assert [run["name"] for run in shuffled["runs"]] == [run["name"] for run in answer["runs"]]
    assert [run["at"] for run in shuffled["runs"]][:3] == [0.0, 1.0, 2.0]
    mixed = [replace(timed[0], provenance={"When": "2014-08-01T00:00:00"}), *timed[1:]]
    assert compared("runs", mixed, 0)["settings"]["order"] == "given"


def test_an_offset_that_the_runs_do_not_determine_has_no_number(tmp_path: Path) -> None:
    # Seed 0 has a drift by chance, as one of 60 such triples does.
    answer = compare(run_files(tmp_path, pattern_plan("x"), [{}, {}, {}], seed=3))
    (second,) = [row for row in answer["offsets"] if row["name"] == "delta2"]
    assert second["runs"] == 0
    numbers = {
        key: value for key, value in second.items() if key not in ("name", "unit", "runs", "unvalidated")
    }
    assert set(numbers.values()) == {None}
    assert second["unvalidated"] is False
    for run in answer["runs"]:
        own = run["offsets"][0]
        assert (own["name"], own["status"]) == ("delta2", "unidentifiable")
        assert own["estimate"] is own["std"] is None
    # Nor is the prediction for the others relied on: it depends on where the lost one is.
    assert (answer["verdict"], answer["consistency"]) == ("not tested", None)
    told = " ".join(answer["notes"])
    assert "Not compared: delta2" in told
    assert "delta2 of run1.jsonl is unidentifiable" in told


def test_a_run_without_a_fit_has_no_part() -> None:
    lost = repeat([np.nan] * 3, name="lost", status=("unidentifiable",) * 3, failure="did not converge")
    values = drawn(3, seed=8)
    answer = compared("runs", [lost, *repeats(values)], 0)
    assert answer["failed"] == ["lost"]
    assert answer["consistency"] == compared("runs", repeats(values), 0)["consistency"]
    alone = compared("runs", [lost, repeat(values[0])], 0)
    assert alone["verdict"] == "not tested"
    assert "nothing is compared" in alone["headline"]


def result_file(folder: Path, name: str, values: np.ndarray, **changes: Any) -> Path:
    """As much of a result.json as `compare` reads; `changes` are of its first offset."""
    rows: list[Json] = [{"name": "delta1", "held": True, "status": "held", "estimate": 0.0}]
    for k, value in enumerate(values):
        row = {"name": f"delta{k + 2}", "status": "identified", "estimate": float(value)}
        std = float(np.sqrt(COVARIANCE[k, k]))
        rows.append({**row, "std": std, "data_std": std})
    rows[1] |= changes
    answer = small_result(rows, sha256=name)
    path = folder / f"{name}.json"
    path.write_text(json.dumps(answer))
    return path


def test_results_are_tested_offset_by_offset(tmp_path: Path) -> None:
    values = drawn(3, seed=9)
    answer = compare([result_file(tmp_path, f"r{k}", value) for k, value in enumerate(values)])
    assert (answer["kind"], answer["verdict"], answer["consistency"]) == ("results", "agrees", None)
    for k, row in enumerate(answer["offsets"]):
        chi2 = ((values[:, k] - values[:, k].mean()) ** 2).sum() / COVARIANCE[k, k]
        assert row["p_value"] == pytest.approx(stats.chi2.sf(chi2, 2))
    assert any("no covariance" in note for note in answer["notes"])
    values[1, 0] += 1.0
    odd = compare([result_file(tmp_path, f"o{k}", value) for k, value in enumerate(values)])
    assert (odd["verdict"], odd["odd_run"]) == ("does not agree", "o1.json")


def test_of_results_with_geometry_it_is_said_what_is_taken_as_shared(tmp_path: Path) -> None:
    values = drawn(3, seed=9)
    paths = [result_file(tmp_path, f"r{k}", value, tolerance_share=0.5) for k, value in enumerate(values)]
    told = " ".join(compare(paths)["notes"])
    assert "taken as the same in all results, as with the same postures" in told
    assert told.count("the geometry is estimated") == told.count("All runs: the geometry is estimated") == 1
    nominal = [result_file(tmp_path, f"n{k}", value) for k, value in enumerate(values)]
    assert "run with geometry" not in " ".join(compare(nominal)["notes"])


def test_of_a_result_only_what_owes_nothing_to_a_prior_is_compared(tmp_path: Path) -> None:
    values = drawn(3, seed=10)
    paths = [result_file(tmp_path, f"r{k}", value, data_std=0.07) for k, value in enumerate(values)]
    answer = compare(paths)
    assert answer["offsets"][0]["mean"] is None
    assert answer["runs"][0]["offsets"][0] == {
        "name": "delta2",
        "unit": "deg",
        "status": "prior",
        "estimate": None,
        "std": None,
    }
    assert any("the prior has a part" in note for note in answer["notes"])
    assert answer["offsets"][1]["p_value"] is not None


@pytest.mark.parametrize("change", [{"std": None}, {"std": 0.0}, {"status": None, "group": []}])
def test_a_result_that_is_not_whole_is_refused(change: Json, tmp_path: Path) -> None:
    values = drawn(2, seed=11)
    good = result_file(tmp_path, "good", values[0])
    bad = result_file(tmp_path, "bad", values[1], **change)
    if change == {"status": None, "group": []}:
        bad.write_text('{"schema": "zerobeam/result/1"}')
    with pytest.raises(BadInput, match=r"bad\.json: this is not a whole result"):
        compare([good, bad])


def test_runs_that_are_not_repeats_are_refused(tmp_path: Path) -> None:
    one, other = run_files(tmp_path, good_plan(10), [{}, {}])
    lines = other.read_text().splitlines()
    head = json.loads(lines[0])
    arm = (ROOT / "model" / "robots" / "irb1600.yaml").read_text()
    assert "a_mm: 700" in arm
    (tmp_path / "same.yaml").write_text(arm)
    (tmp_path / "longer.yaml").write_text(arm.replace("a_mm: 700", "a_mm: 701"))
    (tmp_path / "other.yaml").write_text(arm.replace("name: irb1600", "name: irb1601"))
    changed = tmp_path / "changed.jsonl"

    def with_header(**changes: Any) -> list[Path]:
        changed.write_text("\n".join([json.dumps({**head, **changes}), *lines[1:]]))
        return [one, changed]

    def refused(paths: list[Path], *said: str) -> None:
        with pytest.raises(BadInput) as caught:
            compare(paths)
        assert all(words in str(caught.value) for words in said), caught.value

    assert compare(with_header(robot="same.yaml"))["verdict"] == "agrees"
    refused(with_header(robot="longer.yaml"), "different robots", "their geometry differ")
    refused(with_header(robot="other.yaml"), "different robots", "irb1600 in", "irb1601 in")
    serials = [tmp_path / "a.jsonl", tmp_path / "b.jsonl"]
    for path, own in zip(serials, ({"serial": "A"}, {"Serial number": "B"}), strict=True):
        source = other if path.stem == "b" else one
        path.write_text(
            "\n".join([json.dumps(head | {"provenance": own}), *source.read_text().splitlines()[1:]])
        )
    refused(serials, "different arms", "A in a.jsonl, B in b.jsonl")
    between = with_header(provenance={"note": "no serial number"})[1]
    refused([serials[0], between, serials[1]], "different arms", "A in a.jsonl, B in b.jsonl")
    open_tool = with_header(tool={**LASER, "calibrated": False})
    refused(open_tool, "do not hold the same offsets", "delta1, delta6 in changed.jsonl")
    estimated = {**head["noise"], "scale": "estimated"}
    refused(with_header(noise=estimated), "noise is known in one run and estimated in another")
    copy = tmp_path / "copy.jsonl"
    copy.write_bytes(one.read_bytes())
    refused([one, other, copy], "given twice", "copy.jsonl")
    refused([one, other, one], "given twice")
    refused([one], "one run cannot be compared")
    refused([], "one run cannot be compared")
    refused([one, table_file(tmp_path)], "a table is compared alone")
    refused([one, tmp_path / "none.jsonl"], "no such file")
