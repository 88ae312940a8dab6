"""Studies over a grid: what is predicted, what the runs come to, and that a stopped one is gone on with."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import plan_of
from example_sweeps import shots_sweep
from pydantic import TypeAdapter
from scipy import stats

from zerobeam.analysis.observability.check import check
from zerobeam.analysis.status import Verdict
from zerobeam.experiments.plans.candidates import View, candidates
from zerobeam.experiments.plans.optimal import Planner
from zerobeam.experiments.plans.patterns import pattern
from zerobeam.experiments.studies.cases import Engine
from zerobeam.experiments.studies.data_sets import DataSets, drawn, fitted
from zerobeam.experiments.studies.sweeps import sweep as module
from zerobeam.experiments.studies.sweeps.grid_answer import (
    CaseParameter,
    GridAxis,
    GridCase,
    LikelihoodErrors,
    RunErrors,
    findings,
    headline,
)
from zerobeam.experiments.studies.sweeps.study_file import SettingsStudy, read_study
from zerobeam.experiments.studies.sweeps.sweep import FALSE_ALARM, judged, refitted, studied_case, sweep
from zerobeam.model.errors import BadInput, UnsoundResult
from zerobeam.model.likelihood.problem import Problem
from zerobeam.model.records import to_json

RUNS = 24
CASE = TypeAdapter(GridCase)  # as finished cases are kept
Json = dict[str, Any]

STUDY = """\
schema: zerobeam/study-file/1
study: own
title: A study of one's own
base:
  robot: irb1600
  tool: {kind: laser, point_mm: [0, 0, 65], direction: [1, 0, 0]}
  noise: {joint_deg: 0.01, spot_mm: 0.05}
  geometry: exact
  target: {xyz_mm: [900, 0, 0]}
  plan: {shots: 5}
axes:
  - key: plan
    values:
      - {name: X-Pattern, set: {plan.kind: x}}
      - {name: Y-Pattern, set: {plan.kind: y}}
  - {key: noise.joint_deg, label: joint noise, unit: deg, values: [0.002, 0.01]}
"""


def stored_case(case: GridCase) -> Json:
    return dict(CASE.dump_python(case, mode="json"))


def silent(stage: str, share: float) -> None:
    pass


def study_of_text(folder: Path, text: str = STUDY, runs: int | None = RUNS) -> SettingsStudy:
    path = folder / "own.yaml"
    path.write_text(text, encoding="utf-8")
    return read_study(path, runs)


def swept(study: SettingsStudy, store: Path | None = None, seed: int = 3) -> Json:
    return to_json(sweep(study, Engine(seed, silent, store=store, processes=1)))


def timeless(answer: Json) -> str:
    return json.dumps({**answer, "seconds": None})


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> SettingsStudy:
    return study_of_text(tmp_path_factory.mktemp("sweep"))


@pytest.fixture(scope="module")
def answer(study: SettingsStudy) -> Json:
    return swept(study)


def test_the_structure(answer: Json) -> None:
    assert json.loads(json.dumps(answer, allow_nan=False)) == answer
    assert (answer["schema"], answer["study"], answer["agrees"]) == ("zerobeam/study/1", "own", True)
    settings = answer["settings"]
    assert [settings[key] for key in ("runs", "seed", "level", "chance")] == [RUNS, 3, 0.95, 0.01]
    assert settings["plan"]["candidates"] == 1000  # a default, told with the others
    assert [axis["values"] for axis in answer["axes"]] == [["X-Pattern", "Y-Pattern"], [0.002, 0.01]]
    assert answer["axes"][0]["set"][1] == {"plan.kind": "y"}
    assert [case["at"] for case in answer["cases"]] == [[0, 0], [0, 1], [1, 0], [1, 1]]
    for case in answer["cases"]:
        assert (case["reason"], case["shots"], case["failed"]) == (None, 5, 0)
        assert [row["name"] for row in case["parameters"]] == [f"delta{i}" for i in range(2, 7)]


def test_what_cannot_be_told_has_no_number(answer: Json) -> None:
    rows = [(case, row) for case in answer["cases"] for row in case["parameters"]]
    untold = [(case, row) for case, row in rows if row["status"] == "unidentifiable"]
    assert untold
    for case, row in untold:
        assert (row["std"], row["likelihood"], row["midpoint"]) == (None, None, None)
        assert (case["verdict"], case["worst_std"]) == ("degenerate", None)
    for case in answer["cases"]:
        if case["verdict"] != "degenerate":
            assert case["worst_std"] == max(row["std"] for row in case["parameters"])
    assert {case["verdict"] for case in answer["cases"]} >= {"degenerate"}
    determined = [row for _, row in rows if row["status"] != "unidentifiable"]
    assert all(row["likelihood"]["runs"] == RUNS and row["midpoint"] is None for row in determined)
    assert {"weak", "identified"} <= {row["status"] for row in determined}


def test_what_is_predicted_is_what_check_says(study: SettingsStudy, answer: Json) -> None:
    for case, answered in zip(study.cases, answer["cases"], strict=True):
        kind = case.settings.plan.kind
        assert kind != "optimal"
        postures = pattern(case.header, case.robot, np.array([900.0, 0.0, 0.0]), kind, 5)
        checked = check(plan_of(case.header, postures))
        assert answered["verdict"] == checked.verdict
        rows = {row.name: row for row in checked.parameters}
        for row in answered["parameters"]:
            checked_row = rows[row["name"]]
            assert row["status"] == checked_row.status
            assert row["std"] == (
                None if checked_row.std is None else pytest.approx(checked_row.std, rel=1e-9)
            )


def one_case(text: str, axis: str) -> str:
    """The study with its axes replaced by one of one value."""
    return text[: text.index("axes:")] + f"axes:\n  - {{{axis}}}\n"


@pytest.mark.long
def test_an_optimal_plan_is_that_of_the_planner(tmp_path: Path) -> None:
    text = STUDY.replace("{shots: 5}", "{shots: 5, candidates: 100, margin_deg: 9, facing: [0, 1, 1]}")
    study = study_of_text(tmp_path, one_case(text, "key: plan.criterion, values: [D]"), 0)
    (case,) = swept(study)["cases"]
    planned_case, target = study.cases[0], np.array([900.0, 0.0, 0.0])
    view = View(facing=(0, 1, 1), margin=float(np.radians(9)))
    random_postures = candidates(planned_case.header, planned_case.robot, target, 100, view=view, seed=3)
    proposal = Planner(planned_case.header, planned_case.robot, {"psd": target}, [random_postures]).optimal(
        5, "D", seed=3
    )
    rows = {row["name"]: row["std"] for row in case["parameters"]}
    assert rows == pytest.approx(proposal.std, rel=1e-6)
    assert case["worst_std"] == pytest.approx(proposal.worst, rel=1e-6)


def test_an_open_tool_is_told_but_is_no_offset(tmp_path: Path) -> None:
    text = STUDY.replace("[1, 0, 0]}", "[1, 0, 0], calibrated: false}").replace("shots: 5", "shots: 21")
    text = text.replace("[900, 0, 0]", "[900, 300, 0]").replace("joint_deg: 0.01", "joint_deg: 0.001")
    (case,) = swept(study_of_text(tmp_path, one_case(text, "key: plan.kind, values: [y]"), 0))["cases"]
    names = [row["name"] for row in case["parameters"]]
    assert names == [f"delta{i}" for i in range(2, 6)] + [  # joint 6 is held (section 3.1)
        f"tool.{name}" for name in ("tilt1", "tilt2", "shift1", "shift2")
    ]
    stds = {row["name"]: row["std"] for row in case["parameters"]}
    assert case["worst_std"] == max(std for name, std in stds.items() if name.startswith("delta"))
    assert case["worst_std"] < max(std for std in stds.values() if std is not None)


@pytest.mark.long
def test_arms_may_deviate_from_nominal_geometry(tmp_path: Path) -> None:
    text = STUDY.replace("{shots: 5}", "{kind: y, shots: 12}")
    text = text.replace("geometry: exact", "geometry: {gravity: false, harmonics: false}")
    axis = "key: geometry.tolerance.length_mm, unit: mm, values: [0.1, 0.3]"
    study = study_of_text(tmp_path, one_case(text, axis), 4)
    swept_answer = swept(study)
    assert all(row["likelihood"]["runs"] == 4 for case in swept_answer["cases"] for row in case["parameters"])
    assert any("links of every simulated arm" in note for note in swept_answer["notes"])
    for case, case_settings in zip(swept_answer["cases"], study.cases, strict=True):
        postures = pattern(case_settings.header, case_settings.robot, np.array([900.0, 0.0, 0.0]), "y", 12)
        rows = {row.name: row for row in check(plan_of(case_settings.header, postures)).parameters}
        names = [row["name"] for row in case["parameters"]]
        assert names == [name for name, row in rows.items() if row.group == "offset" and not row.held]
        for row in case["parameters"]:
            std = rows[row["name"]].std
            assert row["std"] == (None if std is None else pytest.approx(std, rel=1e-9))
    close, wide = (case["parameters"] for case in swept_answer["cases"])
    assert all(w["std"] > c["std"] for c, w in zip(close, wide, strict=True) if c["std"] and w["std"])


@pytest.mark.long
def test_the_cost_of_the_paper_stands_beside_the_likelihood(tmp_path: Path) -> None:
    fits = "key: fit, values: [{name: both, set: {costs: [likelihood, midpoint]}}]"
    swept_answer = swept(study_of_text(tmp_path, one_case(STUDY.replace("shots: 5", "kind: y"), fits), 12))
    for row in swept_answer["cases"][0]["parameters"]:
        one, other = row["likelihood"], row["midpoint"]
        assert one["runs"] == 12
        assert 2 <= other["runs"] <= 12
        assert other["rmse"] > 0.9 * one["rmse"]
    worst = swept_answer["cases"][0]["parameters"][0]
    assert worst["midpoint"]["rmse"] > 1.2 * worst["likelihood"]["rmse"]  # it has no noise model
    assert any(note.startswith("The RMSE of the midpoint fit is") for note in swept_answer["notes"])


def test_without_runs_there_is_prediction_alone(tmp_path: Path) -> None:
    swept_answer = swept(study_of_text(tmp_path, runs=0))
    assert swept_answer["agrees"] is True
    rows = [row for case in swept_answer["cases"] for row in case["parameters"]]
    assert all(row["likelihood"] is None and row["midpoint"] is None for row in rows)
    assert any(row["std"] is not None for row in rows)
    assert "runs" not in swept_answer["headline"]


def test_a_case_that_has_no_plan_says_why(tmp_path: Path) -> None:
    probe = STUDY.replace(
        "{kind: laser, point_mm: [0, 0, 65], direction: [1, 0, 0]}", "{kind: probe, point_mm: [9, 0, 65]}"
    )
    swept_answer = swept(study_of_text(tmp_path, probe, 0))
    for case in swept_answer["cases"]:
        assert case["reason"] == "X- and Y-Pattern are made for a beam: tool.kind probe"
        assert [case[key] for key in ("shots", "verdict", "worst_std", "parameters")] == [
            None,
            None,
            None,
            [],
        ]
    headline = "In no case are all offsets identifiable. 4 of 4 cases are without a plan."
    assert swept_answer["headline"] == headline
    assert swept_answer["agrees"] is True


GEOMETRY = """\
schema: zerobeam/study-file/1
study: own
title: Which Y-Pattern?
base:
  robot: irb1600
  tool: {kind: laser, point_mm: [0, 0, 65], direction: [1, 0, 0]}
  noise: {joint_deg: 0.01, spot_mm: 0.05}
  geometry: exact
  target: {xyz_mm: [900, 100, 800], sigma_mm: 300}
  plan: {kind: y, distance_mm: 500, height_mm: 500, candidates: 300}
axes:
  - {key: plan.width_mm, unit: mm, values: [0, 400, 1200]}
  - {key: plan.roll_deg, unit: deg, values: [45]}
beside:
  - {name: X-Pattern, set: {plan.kind: x, plan.width_mm: 400}}
  - {name: optimal, set: {plan.kind: optimal}}
  - {name: near a limit, set: {plan.width_mm: 1200, plan.roll_deg: 0, plan.margin_deg: 60}}
"""


@pytest.mark.long
def test_y_patterns_by_where_their_line_lies(tmp_path: Path) -> None:
    """A wide one is better; without width, and of an X-Pattern, δ2 has no number; an optimal plan is best."""
    answer = sweep(study_of_text(tmp_path, GEOMETRY, 0), Engine(0, silent, processes=1))

    def stds(case: GridCase) -> dict[str, float | None]:
        return {one.name: one.std for one in case.parameters}

    none, narrow, wide = map(stds, answer.cases)
    assert set(none.values()) == {None}
    assert wide["delta2"] is not None
    assert wide["delta2"] < 0.13
    assert narrow["delta2"] is None or narrow["delta2"] > 3 * wide["delta2"]
    x_pattern, optimal, _ = map(stds, answer.beside)
    assert x_pattern["delta2"] is None
    assert x_pattern["delta3"] is not None
    assert max(std or 9 for std in optimal.values()) < 0.03
    assert [case.words for case in answer.beside] == ["X-Pattern", "optimal", "near a limit"]
    reason = answer.beside[2].reason
    assert reason is not None
    assert reason.startswith("postures of the pattern come too near to a joint limit: ")
    (row,) = [row for row in answer.over_cases() if row.name == "delta2"]
    assert (row.cases, row.least, row.without) == (3, wide["delta2"], 2 if narrow["delta2"] is None else 1)
    json.dumps(to_json(answer), allow_nan=False)


def test_what_no_case_determines_is_larger_than_any_number() -> None:
    def over(*stds: float | None) -> Any:
        cases = tuple(
            GridCase(
                (i,),
                "it",
                verdict="weak" if std else "degenerate",
                parameters=(
                    CaseParameter("delta2", "deg", "weak" if std else "unidentifiable", "offset", std),
                ),
            )
            for i, std in enumerate(stds)
        )
        (row,) = replace(shots_sweep(), cases=cases).over_cases()
        return row.least, row.median, row.largest, row.without, row.cases

    assert over(0.3, 0.1, None) == (0.1, 0.3, 0.3, 1, 3)
    assert over(0.3, None) == (0.3, None, 0.3, 1, 2)
    assert over(0.3, None, None) == (0.3, None, 0.3, 2, 3)
    assert over(None) == (None, None, None, 1, 1)


def test_a_case_is_the_same_in_whatever_study_it_stands(tmp_path: Path, answer: Json) -> None:
    text = STUDY.replace("[0.002, 0.01]", "[0.05, 0.002]").replace(
        "      - {name: X-Pattern, set: {plan.kind: x}}\n", ""
    )
    other = stored_case(studied_case(study_of_text(tmp_path, text).cases[1], 3))
    same = answer["cases"][2]
    assert other["words"] == same["words"]

    def alone(case: Json) -> list[Json]:
        """The rows without what the whole study says of them."""
        rows = [row for row in case["parameters"] if row["std"]]
        return [
            {**row, "likelihood": {**row["likelihood"], "agrees": None, "as_stated": None}} for row in rows
        ]

    assert alone(other) == alone(same)
    # Another seed is another set of arms.
    another = stored_case(studied_case(study_of_text(tmp_path, text).cases[1], 4))
    assert another["parameters"] != other["parameters"]


def test_a_pattern_is_searched_once_for_all_cases_that_have_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two levels of noise, two patterns: two searches. Another target is another pattern."""
    searched, real = [], module.pattern

    def counted(*arguments: Any, **named: Any) -> Any:
        searched.append(arguments[3])
        return real(*arguments, **named)

    monkeypatch.setattr(module, "pattern", counted)
    monkeypatch.setattr(module, "_patterns", {})
    cases = [case for case in study_of_text(tmp_path, STUDY).cases if case.settings.plan.kind != "optimal"]
    for case in cases:
        postures = module._patterned(case)
        plan, target = case.settings.plan, np.array(case.settings.target.xyz_mm)
        searched_again = real(case.header, case.robot, target, plan.kind, plan.shots)
        np.testing.assert_array_equal(postures, searched_again)
    assert len(cases) > len(searched) == len({case.settings.plan.kind for case in cases})
    target_elsewhere = cases[0].settings.target.model_copy(update={"xyz_mm": (880.0, 50.0, 0.0)})
    moved = replace(cases[0], settings=cases[0].settings.model_copy(update={"target": target_elsewhere}))
    assert not np.array_equal(module._patterned(moved), module._patterned(cases[0]))


def test_a_stopped_study_is_gone_on_with_to_the_same_answer(
    tmp_path: Path, study: SettingsStudy, answer: Json, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = tmp_path / "own.cases.jsonl"

    def until(last: float) -> Callable[[str, float], None]:
        def progress(stage: str, share: float) -> None:
            if share >= last:
                raise KeyboardInterrupt

        return progress

    with pytest.raises(KeyboardInterrupt):
        sweep(study, Engine(3, until(0.5), store=store, processes=1))
    assert len(store.read_text(encoding="utf-8").splitlines()) == 3  # the heading and two cases, all whole
    computed, real = [], module.studied_case

    def counted(case: Any, seed: int) -> GridCase:
        computed.append(case.at)
        return real(case, seed)

    monkeypatch.setattr(module, "studied_case", counted)
    assert timeless(swept(study, store)) == timeless(answer)
    assert computed == [(1, 0), (1, 1)]
    assert timeless(swept(study, store)) == timeless(answer)
    assert len(computed) == 2
    before = store.read_bytes()
    with pytest.raises(BadInput, match="seed differs"):
        swept(study, store, seed=4)
    with pytest.raises(BadInput, match="settings differs"):
        swept(study_of_text(tmp_path, runs=RUNS + 1), store)
    assert store.read_bytes() == before


@pytest.mark.long
def test_the_number_of_processes_makes_no_difference(study: SettingsStudy, answer: Json) -> None:
    assert timeless(to_json(sweep(study, Engine(3, silent, processes=2)))) == timeless(answer)


def test_runs_of_more_noise_than_stated_are_seen_to_contradict(
    study: SettingsStudy, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = module.drawn

    def louder(problem: Problem, count: int, rng: np.random.Generator) -> DataSets:
        noise = problem.noise.times(1.7)
        return replace(real(replace(problem, noise=noise), count, rng), problem=problem)

    monkeypatch.setattr(module, "drawn", louder)
    swept_answer = swept(replace(study, cases=study.cases[-1:]))
    assert swept_answer["agrees"] is False
    assert (
        "contradict the prediction in 1 of 1 cases: Y-Pattern, joint noise 0.01°" in swept_answer["headline"]
    )


def made(
    off: float, held: float, verdict: Verdict = "pass", runs: int = 400, rmse: float | None = None
) -> GridCase:
    """A case of one parameter whose runs scatter `off` times as predicted."""
    likelihood = LikelihoodErrors(runs, rmse or 0.02 * off, 0.0, 0.001, held, held, held, off)
    row = CaseParameter("delta2", "deg", "identified", "offset", 0.02, likelihood)
    return GridCase((0,), "it", shots=7, verdict=verdict, parameters=(row,))


def agreeing(*cases: GridCase) -> bool:
    return all(case.agrees for case in judged(cases))


@pytest.mark.parametrize(
    ("off", "held", "verdict", "agrees"),
    [
        (1.0, 0.95, "pass", True),
        (1.05, 0.94, "pass", True),
        (1.3, 0.94, "pass", False),
        (0.75, 0.96, "pass", False),
        (1.3, 0.94, "weak", False),
        (1.0, 0.85, "weak", False),
    ],
)
def test_what_agrees(off: float, held: float, verdict: str, agrees: bool) -> None:
    assert agreeing(made(off, held, verdict)) is agrees
    # The study agrees without it where an offset is unidentifiable, but the row says what it is.
    assert agreeing(made(off, held, "degenerate")) is agrees


def test_a_degenerate_case_is_no_promise(study: SettingsStudy, monkeypatch: pytest.MonkeyPatch) -> None:
    for verdict, agrees in (("pass", False), ("weak", False), ("degenerate", True)):
        case = replace(made(1.3, 0.94), verdict=verdict, at=study.cases[0].at)
        monkeypatch.setattr(module, "studied_case", lambda _, seed, case=case: case)
        swept_answer = sweep(replace(study, cases=study.cases[:1]), Engine(3, silent, processes=1))
        assert (swept_answer.agrees, swept_answer.cases[0].agrees) == (agrees, False)


def test_a_weak_plan_is_judged_by_what_its_own_fits_say() -> None:
    assert agreeing(made(1.0, 0.95, "weak", rmse=0.04)) is True
    (case,) = judged([made(1.0, 0.95, "pass", rmse=0.04)])
    assert (case.agrees, case.as_stated) == (False, True)
    # Errors as the fits state, but not as predicted for the nominal arm: it is said to be that.
    assert "prediction in 1 of 1 cases: it. There the errors are as the fits" in headline([], [case])
    (case,) = judged([made(1.3, 0.8, "pass")])
    assert (case.agrees, case.as_stated) == (False, False)
    assert "There the errors" not in headline([], [case])


def test_the_alarm_is_for_the_whole_study() -> None:
    # As far off as one study in a thousand: seen alone, and not where there are five hundred such rows.
    off = float(np.sqrt(stats.chi2.isf(FALSE_ALARM / 20, 400) / 400))
    assert agreeing(made(off, 0.95)) is False
    assert agreeing(made(off, 0.95), *(made(1.0, 0.95) for _ in range(499))) is True


def test_a_fit_in_the_wrong_basin_is_found_and_fitted_anew(study: SettingsStudy) -> None:
    case = study.cases[-1]
    problem = module._planned(case, 3)
    data = drawn(problem, 4, np.random.default_rng(0))
    fits = fitted(data)
    lost = fits.x.copy()
    lost[1, 1] += np.radians(3.0)
    again = refitted(data, replace(fits, x=lost))
    assert again.converged.all()
    np.testing.assert_allclose(again.x, fits.x, atol=1e-6, rtol=0)
    # A run that contradicts its noise from any start has failed.
    spots = data.spots.copy()
    spots[2] += np.linspace(-5, 5, spots[2].size).reshape(spots[2].shape)
    assert refitted(replace(data, spots=spots), fits).converged.tolist() == [True, True, False, True]


def test_the_headline_follows_from_the_numbers() -> None:
    axes = [
        GridAxis("plan", "plan", "", ("X", "Y"), ({}, {})),
        GridAxis("s", "measurements", "", (3, 30), ({}, {})),
        GridAxis("n", "noise", "mm", (0.1, 0.2), ({}, {})),
    ]

    def case(at: tuple[int, ...], worst: float | None, words: str, agrees: bool, failed: int) -> GridCase:
        likelihood = LikelihoodErrors(9, 0.1, 0.0, 0.03, 0.9, 0.8, 1.0, 1.0, agrees)
        row = CaseParameter(
            "delta2", "deg", "identified", "offset", 0.1, likelihood, RunErrors(9, 0.16, 0.0, 0.05)
        )
        verdict: Verdict = "degenerate" if worst is None else "pass"
        return GridCase(
            at, words, shots=7, verdict=verdict, worst_std=worst, failed=failed, parameters=(row,)
        )

    def cases(contradicting: str) -> list[GridCase]:
        stds = [None, None, None, None, 0.4, 0.8, 0.1, 0.15]
        return [
            case(
                (i, j, k),
                std,
                f"case {i}{j}{k}",
                contradicting != f"{i}{j}{k}",
                2 if std is None and not k + j + i else 0,
            )
            for (i, j, k), std in zip(np.ndindex(2, 2, 2), stds, strict=True)
        ]

    assert headline(axes, cases("111")) == (
        "The standard uncertainty of the least certain offset is smallest at 0.10° (case 110) and largest"
        " at 0.80° (case 101). 4 of 8 cases (including all with X) are degenerate: not all offsets are"
        " identifiable. The simulated runs contradict the prediction in 1 of 4 cases: case 111. Failed"
        " fits: 2."
    )
    least_certain = "the standard uncertainty of the least certain offset"
    assert findings(axes, cases("111")) == [
        "Standard uncertainty of the least certain offset by plan: X never all offsets identifiable; Y 0.10"
        " to 0.80°",
        f"With measurements from 3 to 30 {least_certain} changes by a factor of 0.22 (median; 0.19 to 0.25"
        " over the other settings)",
        f"With noise from 0.1 to 0.2\u00a0mm {least_certain} changes by a factor of 1.8 (median; 1.5 to 2.0"
        " over the other settings)",
        "The RMSE of the midpoint fit is that of the likelihood fit times 1.6",
    ]
    assert headline(axes, cases("001")).endswith(
        "agree with the prediction in all 4 cases that are not degenerate. The simulated runs contradict the"
        " prediction in 1 of 4 degenerate cases: case 001. Failed fits: 2."
    )


FORBIDDEN = 1.23456789
ERRORS = RunErrors(9, FORBIDDEN, FORBIDDEN, FORBIDDEN)
NUMBERS: dict[str, Any] = {
    "std": FORBIDDEN,
    "likelihood": LikelihoodErrors(9, *[FORBIDDEN] * 7),
    "midpoint": ERRORS,
}


@pytest.mark.parametrize("status", ["unidentifiable", "held"])
@pytest.mark.parametrize("key", NUMBERS)
def test_a_parameter_that_is_not_identified_cannot_have_a_number(status: Any, key: str) -> None:
    row = CaseParameter("delta2", "deg", status, "offset")
    with pytest.raises(UnsoundResult, match=f"'delta2' is {status}"):
        replace(row, **{key: NUMBERS[key]})
    # Nor can one come from a file of finished cases.
    stored = stored_case(GridCase((0,), "it", shots=7, verdict="degenerate", parameters=(row,)))
    assert CASE.validate_json(json.dumps(stored)).parameters == (row,)
    (bad,) = stored_case(made(1.0, 0.95))["parameters"]
    number = {"std": FORBIDDEN, "likelihood": bad["likelihood"], "midpoint": bad["likelihood"]}[key]
    stored["parameters"][0][key] = number
    with pytest.raises(UnsoundResult, match=f"'delta2' is {status}"):
        CASE.validate_json(json.dumps(stored))


def test_a_case_that_does_not_identify_all_offsets_has_no_worst_one() -> None:
    for case in (GridCase((0,), "it", reason="far"), GridCase((0,), "it", shots=7, verdict="degenerate")):
        with pytest.raises(UnsoundResult, match="does not identify all offsets"):
            replace(case, worst_std=FORBIDDEN)
