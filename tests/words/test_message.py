"""The one message: what it names first, what it does not say, and that every place shows it as it is."""

import dataclasses
import functools
import json
import shlex
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import scipy
from analysed_once import analysed_once
from cells import LASER, TABLE_2, good_plan, pattern_plan, run_of, simulated
from exact_runs import demo_runs
from messages_so_far import message_so_far
from rich.console import Console

import zerobeam as zb
from zerobeam.analysis.answer.answer_message import Message
from zerobeam.analysis.answer.findings import FileWarning, HeldOutMisfit, OtherBasins, Outlying
from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.observability.causes import Held
from zerobeam.analysis.observability.changes import Displacement
from zerobeam.analysis.observability.geometry_result import bases
from zerobeam.analysis.recordings.steps import RecordingStep
from zerobeam.analysis.solution import Solution, solve
from zerobeam.experiments.makers.calibration import calibration
from zerobeam.experiments.simulate import Truth, simulated_shots
from zerobeam.experiments.validated_solution import NotValidated
from zerobeam.model.files.header import Header
from zerobeam.model.files.run import Run, header_of_run, read_run
from zerobeam.model.likelihood.problem import Problem
from zerobeam.reports.output.html import html
from zerobeam.reports.output.terminal import print_page
from zerobeam.reports.run.brief_page import brief_page
from zerobeam.reports.run.report import report_page
from zerobeam.words import numbers
from zerobeam.words.case import RunCase
from zerobeam.words.message import basis_lines, message, message_of_run, next_steps, verdict_words
from zerobeam.words.sentences import to_json

GOOD, X_PATTERN = (case.path for case in demo_runs()[:2])


@functools.cache
def analysed(name: str) -> zb.Analysed:
    return analysed_once(
        {
            "good": lambda: read_run(GOOD),
            "measured": measured,
            "x": lambda: read_run(X_PATTERN),
            "swapped": swapped,
        }[name](),
        ess=100,
    )


def swapped() -> Run:
    """The good run with the columns of joints 4 and 6 exchanged, of no stated origin."""
    run = read_run(GOOD)
    shots = [
        shot.model_copy(update={"joints_deg": tuple(np.array(shot.joints_deg)[[0, 1, 2, 5, 4, 3]].tolist())})
        for shot in run.shots
    ]
    return run_of(run.header.model_copy(update={"provenance": {}}), shots)


def measured(**header: object) -> Run:
    """The good run, of no stated origin."""
    run = read_run(GOOD)
    stated = run.header.model_dump(exclude_unset=True, by_alias=True) | {"provenance": {}, **header}
    return run_of(Header.model_validate(stated), run.shots)


def displaced(mm: float, seed: int = 0) -> Run:
    """Thirty measurements of an uncertain arm, the target elsewhere from the seventeenth on."""
    plan, rng = good_plan(30), np.random.default_rng(seed)
    truth = Truth.drawn(plan, rng)
    x = truth.x.copy()
    x[truth.problem.parameters.block("target", 0)] += np.array([0.6, -0.5, 0.62]) * mm
    before, after = (list(simulated_shots(one, rng)) for one in (truth, dataclasses.replace(truth, x=x)))
    return run_of(plan.header, before[:16] + after[16:])


def test_a_pass_says_how_well_and_what_writes_the_file() -> None:
    result = analysed("measured").result
    said = message(result)
    worst = max(
        (row for row in result.parameters if row.group == "offset" and row.std), key=lambda row: row.std or 0
    )
    assert said.verdict.startswith("Pass. J2 to J5 are identified, offset U ≤ ")  # not of the values
    assert said.cause == "Holds for this geometry and backlash, if nothing changed and readings are right."
    assert said.cautions[0].startswith("To determine J6: measure the laser's mounting and state tool.sigma")
    assert any("Repeat the first postures: " in text for text in said.cautions[1:4])
    assert said.grade == "pass"
    assert said.verdict.count("k\u00a0=\u00a02") == 1
    assert said.worst is not None
    assert (said.worst.name, said.worst.value) == (worst.name, 2 * (worst.std or 0.0))
    assert said.action.command == "zerobeam export rapid run.jsonl -o offsets.mod"


@pytest.mark.parametrize(
    ("geometry", "by_header", "assumed"),
    [
        ({"gravity": False}, None, "typical links 0.3 mm, 0.1°"),
        ({"tolerance": {"length_mm": 0.5}}, "links 0.5 mm", "typical links 0.1°"),
        ({"harmonics_deg": 0.02}, "harmonics 0.02°", "typical links 0.3 mm, 0.1°"),
        (
            {"tolerance": {"length_mm": 0.3, "angle_deg": 0.1}, "harmonics": False},
            "links 0.3 mm, 0.1°",
            "typical gravity 0.05°",
        ),
    ],
)
def test_each_tolerance_of_the_arm_is_stated_or_assumed_by_itself(geometry, by_header, assumed) -> None:
    run = measured(geometry=geometry)
    solution = solve(Problem.from_run(run))
    known = bases(solution.problem, solution.fit.covariance, solution.status, run.header)
    header = run.header.model_dump(mode="json", by_alias=True)
    lines = [line.replace("\u00a0", " ") for line in basis_lines(known, header, 2.0, str, effects=False)]
    stated = "Stated: noise of joints 0.01°; of spot 0.05 mm"
    assert lines[0] == (f"{stated}." if by_header is None else f"{stated}; {by_header}.")
    assert lines[1].startswith("Assumed: the laser's mounting 0.05°, 0.1 mm; ")
    assert lines[1].endswith(f"; {assumed}.")


@pytest.mark.long
def test_a_pass_of_no_robot_has_nothing_to_enter() -> None:
    result = analysed("good").result
    said = message(result)
    assert said.verdict.startswith("Simulated: pass. J2 to J5 are identified")
    assert (said.grade, said.may.enter) == ("pass", False)
    assert said.action.text.startswith("Enter nothing: no robot was measured")
    assert (said.action.command or "").startswith("zerobeam plan optimal --header good.jsonl --target=")


@pytest.mark.parametrize(
    ("tcp_mm", "met", "colour"), [(0.5, "does not meet", "weak"), (50.0, "meets", "pass")]
)
@pytest.mark.one_in(2)
def test_whether_the_robot_meets_what_it_must_is_said_with_the_verdict(tcp_mm, met, colour) -> None:
    result = zb.analyse(measured(required={"tcp_mm": tcp_mm}), ess=100).result
    said = message(result)
    assert said.verdict.startswith(f"Pass; {met} the required {tcp_mm:g}\u00a0mm. J2 to J5 are")
    assert said.grade == colour
    listed_as = "pass" if met == "meets" else "pass, requirement not shown to be met"
    assert verdict_words("pass", said, simulated=False) == listed_as
    assert ("do not release" in said.action.text) == (met == "does not meet")
    assert result.entered is not None
    assert result.entered.tcp_after is not None
    shown = numbers.significant(result.entered.tcp_after.p95_mm, 2, "mm")
    assert (said.cause or "").startswith(f"With the values entered the TCP is off by less than {shown} in 95")


def test_a_tcp_that_rotates_with_an_undetermined_joint_is_not_judged() -> None:
    """A laser beside axis 6, of which its mounting alone tells: 8.5 mm off, and it was said to meet 3 mm."""
    tool = {**LASER, "point_mm": [300.0, 0, 65]}
    run = simulated(good_plan(10, tool=tool, required={"tcp_mm": 3.0}), TABLE_2, 2)[1]
    result = zb.analyse(run, ess=100).result
    assert (result.verdict, result.parameters.named("delta6").status) == ("pass", "assumed")
    assert (result.conformity, result.region and result.region.on_axis) == (None, 6)
    said = message(result)
    assert "ass; whether it meets the required 3\u00a0mm cannot be said. J2 to J5 are" in said.verdict
    assert said.grade == "weak"
    assert "do not release" in said.action.text
    assert any("rotates with J6, which is not determined" in text for text in said.cautions)
    assert to_json(result)["region"]["name"].endswith(", on axis 6 (J6 not determined)")
    # Negative control: a tool on the axis is where it is, however J6 stands.
    on_axis = zb.analyse(measured(required={"tcp_mm": 3.0}), ess=100).result
    assert on_axis.conformity is not None
    assert on_axis.region is not None
    assert on_axis.region.on_axis is None


def test_a_degenerate_run_names_the_mechanism_and_plans_with_its_own_header() -> None:
    said = message(analysed("x").result)
    assert said.verdict.startswith("Simulated: degenerate. J2 is unidentifiable")
    assert said.cause is not None
    assert said.cause.startswith("Joint 1 varies by only")
    assert said.worst is not None
    assert (said.worst.name, said.worst.value) == ("delta2", None)
    words = shlex.split(said.action.command or "")
    assert words[:5] == ["zerobeam", "plan", "optimal", "--header", "x-pattern.jsonl"]
    steps = next_steps(analysed("x").result, said).steps
    assert [word for step in steps for word in step.commands if " export " in word] == []
    header = header_of_run(X_PATTERN)
    assert header.robot == "irb1600"
    assert not header.provenance


@pytest.mark.long
def test_a_misfit_names_its_cause_and_nothing_follows_from_the_wrong_model() -> None:
    result = analysed("swapped").result
    said = message(result)
    assert said.verdict.startswith("Misfit. The model does not describe the measurements.")
    assert (said.cause or "").startswith("Most likely: joint columns exchanged. With J4 and J6 exchanged")
    assert said.action.text.startswith("Enter nothing. Exchange the columns of J4 and J6")
    assert said.worst is None
    assert result.posterior.draws == 0
    assert analysed("swapped").draws is None
    titles = {section.title for section in report_page(result).sections}
    assert not titles & {
        "Accuracy of the TCP",
        "Uncertainty budget",
        "Posterior",
        "What cannot be determined",
    }
    assert "What could be wrong" in titles
    text = printed(analysed("swapped"))
    for word in ("osterior", "k = ", "identified", "U (", "Record more", "to do:"):
        assert word not in text, word
    # Control: of a pass they are there.
    assert "osterior" in printed(analysed("good"))


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.at_length(r"^1")
def test_a_target_that_moved_is_a_misfit_with_its_place_and_its_remedy(seed: int) -> None:
    run = displaced(3.0, seed)
    found = zb.analyse(run, ess=100)
    assert found.verdict == "misfit"
    assert found.misfit is not None
    assert any(isinstance(one, Displacement | RecordingStep) for one in found.misfit.criteria)
    said = message(found.result)
    assert "psd" in (said.cause or "")
    assert any(str(number) in said.action.text for number in (15, 16, 17))
    assert not next_steps(found.result, said).enter
    with pytest.raises(NotValidated):
        calibration(run)
    again = calibration(run, unvalidated=True)
    assert again.misfit


def test_a_pass_with_a_doubt_names_it_before_the_values_are_written() -> None:
    good = analysed("good").result
    for doubt, word in (
        (Outlying((3,), robust=False), "Outlying: measurement 3"),
        (HeldOutMisfit(("left",), 0.4, 3.0), "At the held-out targets (left)"),
        (OtherBasins(1), "Other local optima"),
    ):
        said = message(replace(good, findings=(doubt,)))
        assert (said.cause or "").startswith(word)
        assert "export" not in (said.action.command or "")
    assert not next_steps(replace(good, findings=(OtherBasins(1),)), said).enter


def test_warnings_of_the_file_are_the_last_cautions() -> None:
    said = message(replace(analysed("good").result, findings=(FileWarning("line 9 is torn\x1b"),)))
    assert said.cautions[-1] == "Line 9 is torn\\x1b." or said.cautions[-1] == "line 9 is torn\\x1b."


def test_every_place_shows_it_as_it_is() -> None:
    for name in ("good", "x", "swapped"):
        found = analysed(name)
        said = message(found.result)
        assert to_json(found.result)["message"] == json.loads(json.dumps(dataclasses.asdict(said)))
        page = html(report_page(found.result), {}, "report")
        for text in (said.verdict, said.cause, said.action.text, *said.cautions):
            if text is not None:
                assert flat(text) in flat(printed(found))
                assert flat(text) in flat(
                    page.replace("&#39;", "'").replace("&gt;", ">").replace("&lt;", "<")
                )
        lines = repr(found).splitlines()
        assert flat(said.verdict).startswith(flat(lines[1])[:60])


def test_a_run_under_way_has_a_message_too() -> None:
    plan, rng = good_plan(8), np.random.default_rng(1)
    run = run_of(plan.header, list(simulated_shots(Truth.drawn(plan, rng), rng)))
    solution: Solution = solve(Problem.from_run(run))
    said = message_so_far(solution, "run.jsonl", run.header)
    assert not said.verdict.startswith("Simulated")
    assert said.action.command is not None
    stated = run.header.model_copy(update={"provenance": {"origin": "simulated"}})
    assert (
        message_so_far(solution, "run.jsonl", stated).verdict
        == f"Simulated: {said.verdict[0].lower()}{said.verdict[1:]}"
    )


def test_k_is_two_unless_few_degrees_of_freedom_estimate_the_noise() -> None:
    for count, k in ((7, 2.0), (12, 2.0)):
        solution = solve(Problem.from_run(simulated(good_plan(count), TABLE_2, 1)[1]))
        assert solution.coverage_factor == k
    few = simulated(good_plan(8, geometry="exact", noise={"scale": "estimated"}), TABLE_2, 1)[1]
    solution = solve(Problem.from_run(few))
    assert solution.coverage_factor == pytest.approx(scipy.special.stdtrit(solution.dof, 0.975), rel=1e-3)
    assert solution.coverage_factor > 2.0


def flat(text: str) -> str:
    return " ".join(text.split())


def printed(found: zb.Analysed) -> str:
    console = Console(width=400, file=StringIO())
    print_page(console, brief_page(found.result))
    return cast(StringIO, console.file).getvalue()


@pytest.mark.parametrize(
    ("header", "command"),
    [
        (
            {"tool": {}, "targets": {"psd": {"guess_mm": [900, 0, 0]}}},
            "--header run.jsonl --target=900,0,0 -o",
        ),
        ({"instruments": {"leica": {}}}, "--header run.jsonl -o"),
        ({"instruments": {"bar": {}}, "targets": {"s1": {"guess_mm": [1, 2, 3]}}}, "--header run.jsonl -o"),
        ({"instruments": {"bar": {}}, "targets": {"s1": {"guess_mm": None}}}, None),
        ({"instruments": {"leica": {}}, "tool": {}, "targets": {"psd": {"guess_mm": [900, 0, 0]}}}, None),
        ({"instruments": {"leica": {}, "bar": {}}}, None),
    ],
)
def test_a_plan_is_suggested_by_a_command_that_is_taken(header: dict, command: str | None) -> None:
    """Of several instruments nobody has said how many measurements each makes."""
    case = RunCase(
        verdict="pass",
        stopped=None,
        parameters=(),
        null_space=(),
        misfit=None,
        k=2.0,
        findings=(),
        power=(),
        run="run.jsonl",
        header=header,
    )
    suggested = case.plan
    assert suggested is None if command is None else f"zerobeam plan optimal {command} plan.yaml" == suggested


@pytest.mark.parametrize(
    ("held", "calibrated", "named"), [(4, True, True), (6, True, True), (6, False, False)]
)
def test_a_misfit_names_held_offsets_but_the_last_of_a_free_tool(
    held: int, calibrated: bool, named: bool
) -> None:
    """The tool takes that one up, so that holding it spoils nothing."""
    case = RunCase.of_result(analysed("swapped").result)
    by_header: dict[str, Any] = {"status": "held", "cause": Held("header"), "estimate": 0.0}
    by_header |= dict.fromkeys(("std", "data_std", "interval95", "midpoint", "tolerance_share"))
    rows = [replace(row, **by_header) if row.name == f"delta{held}" else row for row in case.parameters]
    tool = {**cast("dict[str, object]", case.header["tool"]), "calibrated": calibrated}
    shown = message_of_run(replace(case, parameters=rows, header={**case.header, "tool": tool}))
    assert (f"J{held} (δ{held}) is held, not estimated" in (shown.cause or "")) == named
    assert (f"Estimate J{held} (δ{held}) too" in shown.action.text) == named


def y_pattern(seed: int, geometry: object) -> Message:
    """What is said of the paper's seven postures of an arm with such a geometry, taken as exact."""
    truth = Truth.drawn(pattern_plan("y", geometry=geometry), np.random.default_rng(seed))
    shots = simulated_shots(truth, np.random.default_rng(seed))
    run = run_of(pattern_plan("y", geometry="exact").header, shots)
    solution = solve_run(Problem.from_run(run), run.header)
    assert solution.misfit is None
    return message_so_far(solution, "run.jsonl", run.header)


def test_exact_is_the_first_suspect_of_a_weak_result_too() -> None:
    """Residuals of an ordinary arm that an exact one explains with a p between 0.001 and 0.01."""
    said = y_pattern(11, {})
    assert "geometry: exact is the most likely cause" in (said.cause or "")
    assert said.action.text.startswith("Enter nothing yet. Remove geometry: exact from the header")
    assert said.grade == "weak"


@pytest.mark.parametrize("seed", range(3))
def test_an_arm_that_is_exact_is_not_suspected(seed: int) -> None:
    assert "suspect" not in (y_pattern(seed, "exact").cause or "")


def test_a_plan_is_aimed_at_the_target_as_it_was_found() -> None:
    """Of a run whose header says nothing of its target, as one that was imported."""
    for plan, aimed in ((good_plan(8), True), (pattern_plan("x"), False)):
        run = simulated(plan, TABLE_2, 1)[1]
        run = replace(run, header=run.header.model_copy(update={"targets": {}}))
        planned = RunCase.of_result(zb.analyse(run, ess=100).result).planned
        assert (planned is not None) is aimed
        if planned is not None:
            place = [float(value) for value in planned.rpartition("=")[2].split(",")]
            assert np.linalg.norm(np.array(place) - [900, 0, 0]) < 3


def test_too_few_measurements_are_not_called_a_failure_of_the_fit(tmp_path: Path) -> None:
    """Two points of a tracker: 13 unknowns by 6 numbers are no wrong reading."""
    leica = {
        "kind": "tracker",
        "frame": "free",
        "sigma_mm": 0.03,
        "reflectors": {"R1": {"guess_mm": [60, 0, 80]}},
    }
    head = {"schema": "zerobeam/run/1", "robot": "kr6_r900_2", "instruments": {"leica": leica}}
    shots = [
        {
            "joints_deg": [-29.970122, -109.810468, 40.023245, 86.437113, 71.502193, -158.581236],
            "measured_mm": [-2884.417718, 574.15904, 518.986718],
        },
        {
            "joints_deg": [-9.756252, -43.6123, 54.044602, -93.174832, -49.353561, -177.650576],
            "measured_mm": [-2186.572667, 348.048265, -155.314876],
        },
    ]
    rows = [head | {"noise": {"joint_deg": 0.005}}, *({"shot": k, **shot} for k, shot in enumerate(shots))]
    (tmp_path / "two.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")
    run = read_run(tmp_path / "two.jsonl")
    solution = solve_run(Problem.from_run(run), run.header)
    assert not solution.converged
    content = message_so_far(solution, "two.jsonl", run.header)
    assert "2 measurements give 6 numbers" in content.verdict
    assert "converge" not in content.verdict
    assert content.action.text.startswith("Enter nothing: record at least 5 measurements")
    assert content.action.command == "zerobeam plan optimal --header two.jsonl -o plan.yaml"
    assert not content.may.enter
