"""Each finding of the catalogue is made, and everybody reads the same grade: page (HTML, PDF), terminal,
JSON, Python, app, history, certificate, exporters. What nothing is to be entered by is green nowhere."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from analysed_once import analysed_once
from cells import good_plan, pattern_plan, run_of
from certificates import a_key
from command_line import zerobeam
from exact_runs import demo_runs
from rich.console import Console

import zerobeam as zb
from zerobeam.analysis.answer.answer_message import May
from zerobeam.analysis.answer.findings import (
    FileWarning,
    HeldOutMisfit,
    NoPosterior,
    NotConverged,
    OtherBasins,
    Outlying,
    PoorCurvature,
    RobustNotConverged,
    RoundedAngles,
)
from zerobeam.analysis.answer.result import Result, parse_result
from zerobeam.analysis.diagnostics.diagnosis import Explanation
from zerobeam.analysis.diagnostics.hold_out import HoldOut, LeaveOneOut
from zerobeam.analysis.diagnostics.values_to_enter import Conformity
from zerobeam.analysis.misfit import (
    BeyondPrior,
    ExactDoubted,
    ImplausibleNoise,
    LackOfFit,
    Misfit,
    NominalContradicted,
    OffPrior,
    PlacementsDisagree,
    TightPrior,
)
from zerobeam.analysis.observability.causes import Held
from zerobeam.analysis.observability.changes import Displacement, RepeatsApart, RepeatsDiffer, RunChange
from zerobeam.analysis.observability.check import Check, OutsideLimits, TargetBehind, Unreachable, Violation
from zerobeam.analysis.observability.predictions import OverTarget
from zerobeam.analysis.recordings.steps import RecordingStep, RecordingSteps
from zerobeam.analysis.status import Status, Verdict
from zerobeam.app.server.answers.folder_runs import history
from zerobeam.app.server.answers.home import home
from zerobeam.app.server.index import Folder
from zerobeam.commands.judging import exit_status_of
from zerobeam.experiments.makers import calibration as exporters
from zerobeam.model.errors import BadInput
from zerobeam.model.files.header import Header
from zerobeam.model.files.run import read_run
from zerobeam.model.records import dumps
from zerobeam.reports.carried_out import BatchRun, _row
from zerobeam.reports.output.terminal import VERDICT_STYLE, print_blocks, print_page
from zerobeam.reports.plan.check_page import check_page
from zerobeam.reports.run.brief_page import brief_page, side_by_side
from zerobeam.reports.run.report import report_page
from zerobeam.words.case import RunCase
from zerobeam.words.catalogue import RUN, SaidToEnterNothing
from zerobeam.words.entries import FindingEntry, rows_of
from zerobeam.words.message import message, next_steps, read_message
from zerobeam.words.plan_catalogue import PLAN
from zerobeam.words.sentences import to_json

pytest.importorskip("sqlalchemy")
pytest.importorskip("cryptography")

READ_BACK = {"serial": "A-1", "when": "2026-01-31"}


@functools.cache
def analysed() -> zb.Analysed:
    """A pass of a robot that was measured."""
    run = read_run(demo_runs()[0].path)
    header = {"provenance": READ_BACK, "geometry": "exact"}
    whole = Header.model_validate(run.header.model_dump(exclude_unset=True, by_alias=True) | header)
    return zb.analyse(run_of(whole, run.shots), ess=100)


def passed(*findings: Any, **changes: Any) -> Result:
    return replace(analysed().result, findings=findings, **changes)


def of_offsets(verdict: Verdict, *findings: Any, **status: Status) -> Result:
    """The same with offsets of another status."""
    none: dict[str, Any] = dict.fromkeys(
        ("estimate", "std", "data_std", "interval95", "midpoint", "tolerance_share")
    )
    rows = [
        row
        if row.name not in status
        else replace(row, status="weak", cause=None)
        if status[row.name] == "weak"
        else replace(row, **none | {"status": "unidentifiable", "cause": None})
        if status[row.name] == "unidentifiable"
        else replace(row, **none | {"status": "held", "cause": Held("header"), "estimate": 0.0})
        for row in analysed().result.parameters
    ]
    gone: dict[str, Any] = dict.fromkeys(("without_prior", "scene", "entered", "outlook"))
    gone |= {"intervals": (), "budget": ()}
    posterior = replace(analysed().result.posterior, parameters=None)
    kind = type(analysed().result.parameters)
    return passed(*findings, verdict=verdict, parameters=kind(rows), posterior=posterior, **gone)


ALL = ("delta2", "delta3", "delta4", "delta5", "delta6")


def wrong(criterion: Any, *diagnosis: Explanation, held: str = "") -> Result:
    """A misfit by this criterion."""
    result = of_offsets("pass", **{held: "held"} if held else {})
    known = ("identified", "weak", "assumed")
    rows = [replace(row, status="unvalidated") if row.status in known else row for row in result.parameters]
    return replace(
        result,
        verdict="misfit",
        misfit=Misfit((criterion,)),
        findings=(criterion,),
        parameters=type(result.parameters)(rows),
        diagnosis=diagnosis,
    )


def elsewhere(vendor: str, **header: object) -> Result:
    inputs = analysed().result.inputs
    return passed(inputs=replace(inputs, vendor=vendor, header=inputs.header | header))


def stopped() -> Result:
    result = of_offsets("degenerate", NotConverged("no progress"), **dict.fromkeys(ALL, "unidentifiable"))
    likelihood = replace(result.likelihood, converged=False, reason="no progress")
    return replace(result, fits=replace(result.fits, likelihood=likelihood))


def too_small() -> Result:
    fits = analysed().result.fits
    small = replace(fits.likelihood, p_value=1 - 1e-5, p_small=None)
    return passed(fits=replace(fits, likelihood=small))


def without_dof() -> Result:
    fits = analysed().result.fits
    return passed(fits=replace(fits, likelihood=replace(fits.likelihood, dof=0, p_value=None)))


LACK = LackOfFit(90.0, 6, 1e-9, rms_mm=1.0)
MOVED = Displacement("psd", 3, 4, 1e-9, (1.0,), (0.1,), 1.0, 0.1, (), None, False, True)
SLIP = RecordingStep("psd", 3, 4, 2, (1.0,), 1.0, 1e-4, 0.5)
OFF = HoldOut(
    targets=("psd",),
    shots=2,
    shots_fitted=5,
    rms_mm=2.0,
    expected_mm=0.1,
    rms_before_mm=3.0,
    p_value=1e-9,
    placements=("psd",),
)
BY_CHANCE = Explanation("noise", (), (), (), 3.0, 1.0, 3.0, 0.0, 0.0, 0.0, 0.5, True)
MEETS, FAILS = (
    Conformity(1.0, 0.5, p, decision) for p, decision in ((0.99, "conforms"), (0.0, "does not conform"))
)

# By the finding of an entry: a result that has it.
OF_RUNS: dict[type | str, Callable[[], Result]] = {
    "held offsets": lambda: wrong(LACK, held="delta4"),
    RepeatsApart: lambda: wrong(RepeatsApart((7, 8), 5.0, 1e-9)),
    "a diagnosis": lambda: wrong(LACK, BY_CHANCE),
    NotConverged: stopped,
    NominalContradicted: lambda: wrong(NominalContradicted(3.0, 2, 8, 1e-6, 3.0, 1.0)),
    Displacement: lambda: wrong(MOVED),
    RecordingStep: lambda: wrong(SLIP),
    TightPrior: lambda: wrong(TightPrior("length", "mm", 3.0, 0.1, "link2.a", 0.5, 30.0, 6, 1e-6)),
    LackOfFit: lambda: wrong(LACK),
    ImplausibleNoise: lambda: wrong(ImplausibleNoise("all", 9.0, (5.0, 20.0), 3.0)),
    BeyondPrior: lambda: wrong(BeyondPrior((OffPrior("delta2", 5.0),))),
    PlacementsDisagree: lambda: wrong(PlacementsDisagree(3.0, 2, 8, 1e-6, ("a", "b"), "a")),
    RunChange: lambda: wrong(RunChange("jump", 2, None, 3, 4, 0.3, 0.01, "deg", 1e-6, ())),
    RoundedAngles: lambda: of_offsets("weak", RoundedAngles(("pitch of joint 'j1': 1.57 rad",))),
    OtherBasins: lambda: passed(OtherBasins(2)),
    ExactDoubted: lambda: passed(ExactDoubted(0.005, 0.4, 0.5, 0.05)),
    HeldOutMisfit: lambda: passed(HeldOutMisfit(("psd",), 0.4, 3.0, run="second.jsonl")),
    RepeatsDiffer: lambda: passed(
        RepeatsDiffer("jump", 4, None, 8, 9, 0.05, 0.01, "deg", 0.003, (9, 10), (0, 1))
    ),
    Outlying: lambda: passed(Outlying((3,), robust=False)),
    HoldOut: lambda: passed(
        placements=replace(analysed().result.placements, leave_one_out=LeaveOneOut((OFF,), 2.0, 0.1))
    ),
    "nothing is determined": lambda: of_offsets("degenerate", **dict.fromkeys(ALL, "unidentifiable")),
    "an unidentifiable offset": lambda: of_offsets("degenerate", delta2="unidentifiable"),
    "a weak offset": lambda: of_offsets("weak", delta2="weak"),
    "assumed offsets alone": lambda: of_offsets("weak", **dict.fromkeys(ALL[:-1], "held")),
    "no pass": lambda: of_offsets("weak", delta2="weak"),
    "no offset is estimated": lambda: of_offsets("pass", **dict.fromkeys(ALL, "held")),
    "no robot was measured": lambda: elsewhere("abb", provenance=READ_BACK | {"origin": "simulated"}),
    "no factory calibration": lambda: elsewhere("universal-robots", robot="ur5e"),
    "a controller that takes no offsets": lambda: elsewhere("doosan"),
    "measurements that were left out": lambda: elsewhere(
        "abb", provenance=READ_BACK | {"without measurements": "4", "made of": "run.jsonl (SHA-256 1a)"}
    ),
    "a requirement that may not be met": lambda: passed(conformity=FAILS),
    "the error to expect": lambda: passed(conformity=MEETS),
    "conditions of a pass": passed,
    "values to enter": passed,
    "assumed offsets": passed,
    NoPosterior: lambda: passed(NoPosterior(analysed().result.posterior)),
    PoorCurvature: lambda: passed(PoorCurvature(("delta2",), tested=True)),
    RobustNotConverged: lambda: passed(RobustNotConverged("no progress")),
    "slips within a recording": lambda: passed(
        placements=replace(analysed().result.placements, steps=RecordingSteps((SLIP,), 1, 1))
    ),
    "a fit that nothing checks": without_dof,
    "what a pass does not exclude": passed,
    "a requirement that cannot be judged": lambda: elsewhere("abb", required={"tcp_mm": 1.0}),
    "what the geometry does": passed,
    "residuals that are far too small": too_small,
    FileWarning: lambda: passed(FileWarning("line 9 is torn")),
}


def named(entry: FindingEntry[Any]) -> str:
    return entry.finding if isinstance(entry.finding, str) else entry.finding.__name__


def readers(folder: Path, result: Result) -> dict[str, str | None]:
    """The grade of a result as each reads it: of the answer itself, and of its result.json."""
    (folder / "job").mkdir()
    (folder / "job" / "result.json").write_text(dumps(to_json(result)))
    db = ("--db", folder / "history.sqlite")
    assert zerobeam("history", "add", folder / "job" / "result.json", *db).status == 0
    (calibration,) = home(Folder(folder)).calibrations
    (brief,) = history(Folder(folder)).results
    (shown,) = zerobeam("history", "show", "A-1", "--json", *db).json["results"]
    (listed,) = zerobeam("history", "list", "--json", *db).json["results"]
    return {
        "HTML and PDF": report_page(result).verdict.key,
        "terminal": brief_page(result).verdict.key,
        "Python": replace(analysed(), result=result)._page().verdict.key,
        "JSON": to_json(result)["message"]["grade"],
        "home": calibration.state.kind,
        "app's list": brief.grade,
        "history show": shown["grade"],
        "history list": listed["grade"],
    }


def certified(folder: Path) -> bool:
    db = ("--db", folder / "history.sqlite")
    signed = zerobeam("history", "certify", "A-1", "--key", a_key(folder), "-o", folder / "signed", *db)
    return signed.status == 0


def exported(result: Result, patch: pytest.MonkeyPatch) -> bool:
    """Whether the run is exported where these findings speak against its values."""
    patch.setattr(exporters, "without_a_result", lambda *_: RunCase.of_result(result).findings)
    try:
        exporters.calibration(analysed().run)
    except BadInput:
        return False
    return True


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    "entry", [entry for entry in RUN if entry.finding is not SaidToEnterNothing], ids=named
)
def test_each_finding_has_one_grade_everywhere(
    entry: FindingEntry[RunCase], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = OF_RUNS[entry.finding]()
    content = message(result)
    assert entry in [row.entry for row in rows_of(RunCase.of_result(result), RUN)]
    assert set(readers(tmp_path, result).values()) == {content.grade}
    assert content.may.enter <= (entry.grade == "note")
    assert content.may.certify <= (entry.grade != "stop")
    assert certified(tmp_path) == content.may.certify
    if result.verdict == "pass" and isinstance(entry.finding, type):
        assert exported(result, monkeypatch) == content.may.export
    assert bool(next_steps(result, content).enter) <= content.may.export
    assert content.grade != "pass" or not content.action.text.startswith("Enter nothing yet")


def test_no_entry_is_left_out() -> None:
    assert [named(entry) for entry in RUN if entry.finding not in {*OF_RUNS, SaidToEnterNothing}] == []
    assert [named(entry) for entry in PLAN if entry.finding not in OF_PLANS] == []


@functools.cache
def checked(name: str = "good") -> Check:
    plans = {"good": good_plan(10, geometry="exact"), "x": pattern_plan("x"), "few": good_plan(7)}
    if name == "held":
        return zb.check(good_plan(8, geometry="exact", held=["delta1", *ALL]))
    if name == "assumed":
        return zb.check(good_plan(8, geometry="exact", held=["delta1", *ALL[:-1]]))
    return zb.check(plans[name])


def broken(*postures: int) -> Check:
    violations = tuple(Violation(posture, "obstacles", "beam") for posture in postures)
    rows = tuple(
        replace(row, violations=tuple(one for one in violations if one.posture == row.posture))
        for row in checked().postures
    )
    return replace(checked(), verdict="violated", postures=rows)


def requiring(tcp_mm: float) -> Check:
    outlook = checked().outlook
    assert outlook is not None
    return replace(checked(), outlook=replace(outlook, required_mm=tcp_mm))


OF_PLANS: dict[type | str, Callable[[], Check]] = {
    "a broken constraint": lambda: broken(1),
    "more broken constraints": lambda: broken(1, 2),
    "an unidentifiable offset": lambda: checked("x"),
    "a weak offset": lambda: checked("few"),
    "assumed offsets alone": lambda: checked("assumed"),
    "no offset is estimated": lambda: checked("held"),
    "a requirement that is not met": lambda: requiring(1e-3),
    "conditions of a pass": checked,
    "a plan as it is": checked,
    Unreachable: lambda: replace(checked(), findings=(Unreachable((1,)),)),
    TargetBehind: lambda: replace(checked(), findings=(TargetBehind((1,), every=False),)),
    OutsideLimits: lambda: replace(checked(), findings=(OutsideLimits(1, 2, 190.0, "deg", (-180.0, 180.0)),)),
    "warnings of the file": lambda: replace(checked(), warnings=("line 3 is odd",)),
    "assumed offsets": checked,
    "the target elsewhere": lambda: replace(checked(), over_target=OverTarget(10, 0.9, {})),
    "what a run may not show": checked,
}


@pytest.mark.parametrize("entry", PLAN, ids=named)
def test_each_finding_of_a_plan_has_one_grade(entry: FindingEntry[Check]) -> None:
    check = OF_PLANS[entry.finding]()
    content = message(check)
    assert entry in [row.entry for row in rows_of(check, PLAN)]
    short = entry.finding == "a requirement that is not met"
    assert content.grade == ("misfit" if check.verdict == "violated" else "weak" if short else check.verdict)
    assert content.may == May()
    assert check_page(check).verdict.key == content.grade
    assert check._page().verdict.key == content.grade  # type: ignore[attr-defined]
    if entry.grade == "stop":
        assert content.grade == "misfit"


def begins(result: Result) -> str:
    """The grade of the colour in which a terminal begins."""
    text = StringIO()
    console = Console(file=text, force_terminal=True, color_system="standard", width=200)
    print_page(console, brief_page(result))
    colours = {
        grade: console.get_style(VERDICT_STYLE[grade]).render("Pass")[:-8] for grade in ("pass", "weak")
    }
    assert colours["pass"] != colours["weak"]
    return next((grade for grade, begin in colours.items() if text.getvalue().startswith(begin)), "?")


def page_of(folder: Path, serial: str | None, *db: object) -> str:
    """The page of an arm, or of all arms."""
    there = folder / ("fleet" if serial is None else "arm")
    arm = () if serial is None else (serial,)
    assert zerobeam("history", "report", *arm, "-o", there, *db).status == 0
    return (there / ("fleet.html" if serial is None else "arm.html")).read_text()


@pytest.mark.parametrize("grade", ["weak", "pass"])
def test_a_pass_by_which_nothing_is_to_be_entered_is_listed_as_such(grade: str, tmp_path: Path) -> None:
    result = passed(Outlying((3,), robust=False)) if grade == "weak" else passed()
    readers(tmp_path, result)
    db = ("--db", tmp_path / "history.sqlite")
    (calibration,) = home(Folder(tmp_path)).calibrations
    compared = StringIO()
    print_blocks(Console(file=compared, width=200), [side_by_side(["one"], [result])])
    lists = {
        "home": calibration.state.text,
        "list": zerobeam("history", "list", *db).out,
        "show": " ".join(zerobeam("history", "show", "A-1", *db).out.split()),
        "arm's page": page_of(tmp_path, "A-1", *db),
        "all arms": page_of(tmp_path, None, *db),
        "compared": compared.getvalue(),
    }
    assert begins(result) == grade
    for name, text in lists.items():
        words = {"enter", "nothing"} <= set(text.split()) if name == "show" else "enter nothing" in text
        assert words == (grade == "weak"), name
    batch = _row(BatchRun("one", "one.jsonl", read_run(demo_runs()[0].path)), result)
    assert (batch.outcome, batch.contradicted) == (grade, grade == "weak")
    assert exit_status_of(replace(analysed(), result=result)) == (grade == "weak")


@pytest.mark.parametrize("finding", [None, OtherBasins, HeldOutMisfit, Outlying])
def test_a_result_of_an_earlier_version_is_judged_by_what_it_says(finding: type | None) -> None:
    result = passed() if finding is None else OF_RUNS[finding]()
    answer = to_json(result)
    assert read_message(parse_result(json.dumps(answer))) == message(result)
    del answer["message"]["grade"], answer["message"]["may"]
    assert read_message(parse_result(json.dumps(answer))) == message(result)


@pytest.mark.parametrize(("number", "verdict"), [(0, "pass"), (1, "degenerate")])
@pytest.mark.one_in(2)
def test_values_are_offered_of_a_pass_alone(number: int, verdict: str) -> None:
    found = analysed_once(zb.read_run(demo_runs()[number].path), ess=100)
    assert found.verdict == verdict
    steps = next_steps(found.result, message(found.result))
    known = [row.name for row in found.offsets if row.status == "identified"]
    assert [own.name for own in steps.enter] == (known if verdict == "pass" else [])
    assert any(step.commands for step in steps.steps)
    stated = found.to_json()["next_steps"]
    assert [own["text"] for own in stated["steps"]] == [own.text for own in steps.steps]
    assert stated["enter"] == [vars(own) for own in steps.enter]


@pytest.mark.parametrize(("number", "said"), [(4, False), (9, True)])
def test_what_seems_to_have_slipped_by_a_wrong_measurement_is_not_said(number: int, said: bool) -> None:
    found = replace(BY_CHANCE, cause="measurements", measurements=(number,))
    slipped = SLIP, replace(MOVED, alone=4)
    for one in slipped:
        texts = " ".join(message(wrong(one, found)).cautions)
        assert ("seems to have" in texts) == said, texts


def test_advice_does_not_contradict_what_was_found() -> None:
    """More noise was to be stated where that explains nothing, and repeats sent elsewhere than the target."""
    small = replace(BY_CHANCE, agrees=False)
    for found, stating in ((BY_CHANCE, True), (small, False)):
        assert ("noise.scale" in message(wrong(LACK, found)).action.text) == stating
    apart = RepeatsApart((7, 8), 5.0, 1e-9)
    assert "before measurement 7," in message(wrong(apart)).action.text
    both = replace(wrong(apart), misfit=Misfit((apart, MOVED)), findings=(apart, MOVED))
    assert "between measurements 3 and 4," in message(both).action.text
