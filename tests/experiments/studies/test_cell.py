"""The study of the whole chain: what counts, what agrees, and that its controls are seen to be wrong."""

import functools
import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from plain_json import plain
from scipy import stats

from zerobeam.experiments.studies import cell as module
from zerobeam.experiments.studies.answer import accuracy, held_share, share_interval
from zerobeam.experiments.studies.cases import Engine
from zerobeam.experiments.studies.cell import (
    CellRun,
    Repeated,
    RunEstimates,
    carried,
    cell_study,
    seeds_of,
    studied_plans,
)
from zerobeam.model.records import to_json

RUNS = 2


@functools.cache
def plans() -> dict[str, Repeated]:
    return {plan.name: plan for plan in studied_plans(0, camera=False)}


@pytest.fixture(scope="module")
def study() -> tuple[dict[str, Any], list[tuple[str, float]]]:
    """Few runs of the real thing, without pictures, for the plans that it is quick with."""
    stages: list[tuple[str, float]] = []
    with pytest.MonkeyPatch.context() as patch:
        some = [plans()["optimal"], plans()["adaptive"]]
        patch.setattr(module, "studied_plans", lambda seed, camera: some)
        answer = to_json(
            cell_study(RUNS, Engine(0, lambda *now: stages.append(now), processes=1), camera=False)
        )
    return answer, stages


@pytest.fixture(scope="module")
def run() -> CellRun:
    return carried((plans()["optimal"], seeds_of(0, 1)[0]))


def made(run: CellRun, count: int, wider: float = 1.0, without: Sequence[str] = ()) -> list[CellRun]:
    """What `count` runs would say whose errors are `wider` than their stds, without some offsets."""
    rng, runs = np.random.default_rng(0), []
    assert run.estimates is not None
    for _ in range(count):
        offsets = {
            name: (run.truth[name] + wider * std * float(rng.normal()), std)
            for name, (_, std) in run.estimates.offsets.items()
        }
        kept = {name: pair for name, pair in offsets.items() if name not in without}
        runs.append(replace(run, estimates=RunEstimates(kept, False)))
    return runs


def judged(plan: Repeated, runs: Sequence[CellRun]) -> dict[str, Any]:
    return plain(module.judged(plan, runs))


def test_the_structure(study: tuple[dict[str, Any], list[tuple[str, float]]]) -> None:
    answer, stages = study
    assert json.loads(json.dumps(answer, allow_nan=False)) == answer
    assert (answer["schema"], answer["study"]) == ("zerobeam/study/1", "cell")
    settings = answer["settings"]
    assert (settings["runs"], settings["seed"], settings["camera"]) == (RUNS, 0, False)
    assert [plan["name"] for plan in answer["plans"]] == ["optimal", "adaptive", "noise understated by 2"]
    for plan in answer["plans"]:
        assert (plan["runs"], plan["failed"]) == (RUNS, 0)
        assert [row["name"] for row in plan["parameters"]] == [f"delta{i}" for i in range(2, 7)]
        phases = plan["seconds"]
        assert list(phases) == ["move", "search", "servo", "settle", "total"]
        total = sum(phases[phase]["mean"] for phase in list(phases)[:-1])
        assert phases["total"]["mean"] == pytest.approx(total)
        assert plan["within_limit"] is (phases["total"]["max"] <= 360)
    shares = [share for _, share in stages]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_the_adaptive_run_saves_shots_and_reaches_its_tolerance(
    study: tuple[dict[str, Any], list[tuple[str, float]]],
) -> None:
    answer, _ = study
    optimal, adaptive, _ = answer["plans"]
    assert optimal["saved"] is None
    # Without pictures a posture may be refused, as its beam does not find the face.
    assert RUNS * optimal["shots_used"]["mean"] + optimal["refused"] == RUNS * 7
    used = adaptive["shots_used"]
    assert adaptive["saved"] == adaptive["shots"] - used["mean"] - adaptive["refused"] / RUNS > 0
    worst = max(row["predicted_std"] for row in adaptive["parameters"])
    assert worst <= answer["settings"]["tolerance_deg"] * (1 + 1e-9)


def test_the_control_judges_the_same_runs_by_half_the_noise(
    study: tuple[dict[str, Any], list[tuple[str, float]]],
) -> None:
    """The stds are half, the errors the same to what the priors and curvature make of it."""
    answer, _ = study
    optimal, _, half = answer["plans"]
    assert half["control"]
    for row, other in zip(optimal["parameters"], half["parameters"], strict=True):
        assert other["predicted_std"] == pytest.approx(row["predicted_std"] / 2, rel=1e-3)
        assert other["bias"] == pytest.approx(row["bias"], abs=1e-2 * row["predicted_std"])


def test_right_stds_agree_and_stds_too_small_do_not(run: CellRun) -> None:
    """By 2: 1.96 stds are 0.98, which hold two thirds; of 200 that is 20 standard errors off."""
    plan = plans()["optimal"]
    right, wrong = judged(plan, made(run, 200)), judged(plan, made(run, 200, wider=2.0))
    assert right["agrees"]
    assert right["sentence"].endswith("as stated")
    assert not wrong["agrees"]
    assert wrong["sentence"].endswith("not as stated")
    for row in wrong["parameters"]:
        share = row["coverage"]["share"]
        assert share == pytest.approx(2 * stats.norm.cdf(0.98) - 1, abs=4 * np.sqrt(0.67 * 0.33 / 200))
        assert row["rmse"] == pytest.approx(2 * row["predicted_std"], rel=4 / np.sqrt(2 * 200))
    control = judged(replace(plan, control=True), made(run, 200, wider=2.0))
    assert "detected as wrong" in control["sentence"]


def test_a_run_counts_where_it_tells_the_offset_itself(run: CellRun) -> None:
    runs = [*made(run, 10, without=["delta3"]), *made(run, 20)]
    plan_answer = judged(plans()["optimal"], runs)
    of = {row["name"]: row["coverage"]["of"] for row in plan_answer["parameters"]}
    assert of == {"delta2": 30, "delta3": 20, "delta4": 30, "delta5": 30, "delta6": 30}
    assert "Unidentifiable, so without an interval: J3 (δ3) in 10 runs" in plan_answer["sentence"]


def test_an_offset_that_no_run_tells_has_no_numbers(run: CellRun) -> None:
    plan_answer = judged(plans()["optimal"], made(run, 3, without=[f"delta{i}" for i in range(1, 7)]))
    assert not plan_answer["agrees"]
    assert all(
        row[key] is None
        for row in plan_answer["parameters"]
        for key in ("bias", "bias_mcse", "rmse", "predicted_std", "coverage")
    )


def test_runs_without_a_result_are_counted_and_have_no_interval(run: CellRun) -> None:
    failed = replace(run, estimates=None, failure="the motors are off")
    plan_answer = judged(plans()["optimal"], [failed, *made(run, 3)])
    assert (plan_answer["failed"], plan_answer["failures"]) == (1, ["the motors are off"])
    assert all(row["coverage"]["of"] == 3 for row in plan_answer["parameters"])
    nothing = judged(plans()["optimal"], [failed])
    assert (nothing["within_limit"], nothing["shots_used"]["mean"], nothing["agrees"]) == (None, None, False)
    assert nothing["seconds"]["total"] == {"mean": None, "max": None}


def test_shares_and_errors_in_closed_form() -> None:
    errors = accuracy(np.array([1.0, 3.0]), np.array([3.0, 4.0]))
    assert errors._asdict() == {
        "bias": 2.0,
        "bias_mcse": pytest.approx(1.0),
        "rmse": pytest.approx(np.sqrt(5)),
        "predicted_std": pytest.approx(np.sqrt(12.5)),
    }
    assert set(accuracy(np.array([1.0]), np.array([1.0]))) == {None}
    # All of n held: the lower end is (alpha / 2)^(1 / n), the chance of it level^n.
    share = held_share(20, 20, 0.5, alarm=0.01)
    assert share.low == pytest.approx(0.025 ** (1 / 20))
    assert not share.agrees
    assert held_share(20, 20, 0.95, alarm=0.01).agrees


@pytest.mark.parametrize(("held", "of"), [(0, 1), (1, 1), (0, 20), (3, 20), (20, 20), (947, 1000)])
def test_the_interval_of_a_share_against_scipy(held: int, of: int) -> None:
    """By beta quantiles; SciPy looks for the roots of the binomial distribution."""
    expected = stats.binomtest(held, of).proportion_ci(0.95)
    assert share_interval(held, of) == pytest.approx((expected.low, expected.high), abs=1e-10)


@pytest.mark.long
def test_the_whole_chain_holds_what_it_promises() -> None:
    """Without pictures, whose share of the error is nothing; a chance of 1 % a plan, with this seed."""
    answer = to_json(cell_study(100, Engine(0), camera=False))
    assert answer["agrees"], answer["headline"]
    rows = {plan["name"]: plan for plan in answer["plans"]}
    # The gears' play is taken up from one side: it is in every offset, and no run can know.
    for row in rows["backlash"]["parameters"]:
        assert row["coverage"]["share"] < 0.2
    assert all(plan["within_limit"] for plan in answer["plans"])
    assert sum(plan["failed"] for plan in answer["plans"]) == 0
