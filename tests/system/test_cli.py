"""The command line: its exit statuses, what it prints where, its help, and every kind of bad input."""

import copy
import dataclasses
import importlib
import json
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import typer
from cells import PROBE, exact_copy, good_plan, header, pattern_plan, plan_of
from command_line import Answer, plan_file, zerobeam
from exact_runs import demo_runs
from example_studies import agreeing, disagreeing, typed
from golden_files import assert_golden

import zerobeam as package
from zerobeam.analysis.estimation.fit import LikelihoodFit, fit_likelihood
from zerobeam.commands import program
from zerobeam.experiments.schema import SCHEMA_NAMES
from zerobeam.experiments.studies.cases import Engine
from zerobeam.model.errors import UnsoundResult
from zerobeam.model.files.header import RUN_SCHEMA
from zerobeam.model.files.run import read_run
from zerobeam.model.likelihood.problem import Problem

GOOD, X_PATTERN, UNCALIBRATED = (case.path for case in demo_runs())
TYPICAL, *SHOTS = (json.loads(line) for line in GOOD.read_text(encoding="utf-8").splitlines())
HEADER = {**TYPICAL, "geometry": "exact"}  # of seven measurements a typical arm leaves hardly any residuals
FEW = ("--ess", 100)  # draws, where nothing is asked of them
COMMAND = Path(sys.executable).with_name("zerobeam")
WHOLE_REPORT = {"report.html", "report.pdf", "result.json", "posterior.nc", "figures"}


def process(*arguments: object) -> Answer:
    """The installed console script as a process of its own."""
    done = subprocess.run(
        [str(COMMAND), *map(str, arguments)], capture_output=True, encoding="utf-8", check=False, timeout=120
    )
    return Answer(done.returncode, done.stdout, done.stderr)


def changed(**changes: Any) -> dict[str, Any]:
    return {**copy.deepcopy(HEADER), **changes}


def run_text(top: dict[str, Any] | None = None, shots: list[dict[str, Any]] | None = None) -> str:
    rows = [HEADER if top is None else top, *(SHOTS if shots is None else shots)]
    return "".join(json.dumps(row) + "\n" for row in rows)


def one_changed(i: int, **changes: Any) -> list[dict[str, Any]]:
    """The good run's shots with one of them changed."""
    shots = copy.deepcopy(SHOTS)
    shots[i].update(changes)
    return shots


def contents(folder: Path) -> dict[str, bytes | None]:
    """Everything in a folder, to see that a command left it as it was."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


@pytest.fixture(scope="module")
def plans(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("plans")
    return {
        "good": plan_file(folder / "good.yaml", good_plan(8)),
        "x": plan_file(folder / "x.yaml", pattern_plan("x")),
        "away": plan_file(
            folder / "away.yaml", plan_of(header(PROBE, target=(5000.0, 0.0, 0.0)), good_plan(4).postures)
        ),
    }


# --- what is asked for is answered --------------------------------------------------------------------


@pytest.mark.long
def test_the_installed_command_answers(tmp_path: Path) -> None:
    told = process("--version")
    assert told == Answer(0, f"zerobeam {package.__version__}\n", "")
    told = process("analyse", exact_copy(GOOD, tmp_path / "run.jsonl"), "--json", *FEW)
    assert (told.status, told.err) == (0, "")
    assert told.json["schema"] == "zerobeam/result/1"
    told = process("check", GOOD.with_name("none.yaml"), "--json")
    assert "there is no such file" in told.refused()


@pytest.mark.one_in(2)
@pytest.mark.parametrize(("file", "status", "verdict"), [(GOOD, 0, "pass"), (X_PATTERN, 1, "degenerate")])
def test_analyse_ends_with_its_verdict(file: Path, status: int, verdict: str) -> None:
    told = zerobeam("analyse", file, "--json", "--seed", "5", *FEW)
    assert (told.status, told.err) == (status, "")
    assert told.json["verdict"] == verdict
    assert told.json["inputs"]["seed"] == 5


def test_a_weak_verdict_is_no_pass(tmp_path: Path) -> None:
    strict = tmp_path / "run.jsonl"
    strict.write_text(run_text(changed(tolerance={"offset_deg": 0.005})), encoding="utf-8")
    told = zerobeam("analyse", strict, "--json", *FEW)
    assert (told.status, told.json["verdict"]) == (1, "weak")


@pytest.mark.long
def test_analyse_prints_for_people_without_json() -> None:
    told = zerobeam("analyse", GOOD, *FEW)
    assert (told.status, told.err) == (0, "")
    assert told.out.startswith("Simulated: pass. ")
    assert "●" in told.out
    assert "\x1b" not in told.out


@pytest.mark.long
def test_the_same_seed_gives_the_same_answer_and_another_seed_does_not(tmp_path: Path) -> None:
    """A process each: within one, arrays that lie otherwise in memory are added up to another last bit."""
    (run := tmp_path / "run.jsonl").write_text(run_text(), encoding="utf-8")
    command = [sys.executable, "-c", "from zerobeam.cli import main; main()", "analyse", str(run), "--json"]
    first, again, other = (
        json.loads(
            subprocess.run([*command, "--seed", seed, *map(str, FEW)], capture_output=True, text=True).stdout
        )
        for seed in ("1", "1", "2")
    )
    for answer in (first, again, other):
        answer["posterior"].pop("seconds")
    assert first == again
    assert first["posterior"]["parameters"] != other["posterior"]["parameters"]


@pytest.mark.parametrize("loss", ["huber", "student"])
@pytest.mark.long
def test_a_robust_fit_is_there_on_request_and_names_the_shot_that_is_off(tmp_path: Path, loss: str) -> None:
    pushed = tmp_path / "pushed.jsonl"
    pushed.write_text(run_text(None, one_changed(2, spot_mm=[1.5, -1.0])), encoding="utf-8")
    told = zerobeam("analyse", pushed, "--robust", loss, "--json", *FEW)
    assert told.err == ""
    assert told.json["robust"]["loss"] == loss
    assert told.json["robust"]["outliers"] == [2]
    assert min(told.json["robust"]["weights"]) == told.json["robust"]["weights"][2]
    people = zerobeam("analyse", pushed, "--robust", loss, *FEW).out
    assert "Outlier: 2 (weight" in " ".join(people.split())
    good = exact_copy(GOOD, tmp_path / "good.jsonl")
    calm = zerobeam("analyse", good, "--json", "--robust", loss, *FEW).json
    assert calm["robust"]["outliers"] == []
    assert zerobeam("analyse", good, "--json", *FEW).json["robust"] is None


@pytest.mark.long
def test_targets_are_held_out_by_name_or_pattern(tmp_path: Path) -> None:
    two = tmp_path / "two.jsonl"
    shots = [{**shot, "target": "near"} for shot in SHOTS]
    again = [{**shot, "shot": len(SHOTS) + i, "target": "far"} for i, shot in enumerate(SHOTS)]
    two.write_text(run_text(None, [*shots, *again]), encoding="utf-8")
    told = zerobeam("report", two, "-o", tmp_path / "out", "--hold-out", "f?r", "--json", *FEW)
    assert told.err == ""
    found = told.json["hold_out"]
    assert (found["targets"], found["shots"], found["shots_fitted"]) == (["far"], len(SHOTS), len(SHOTS))
    assert "Held-out targets" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    # The same shots again: there is nothing that could be off.
    assert found["p_value"] > 0.01
    printed = zerobeam("analyse", two, "--hold-out", "far", *FEW).out
    assert "Targets: 1: far\nMeasurements there: 7\n" in printed
    assert zerobeam("analyse", two, "--json", *FEW).json["hold_out"] is None
    message = zerobeam("analyse", two, "--hold-out", "near", "--hold-out", "far").refused()
    assert "all targets are held out" in message
    assert "no target of that name" in zerobeam("analyse", two, "--hold-out", "fa").refused()


@pytest.mark.long
def test_another_run_is_predicted(tmp_path: Path) -> None:
    good, other = exact_copy(GOOD, tmp_path / "good.jsonl"), tmp_path / "other.jsonl"
    lines = good.read_text(encoding="utf-8").splitlines()
    other.write_text("\n".join(lines[:-1]) + "\n", encoding="utf-8")
    answer = zerobeam("report", good, "-o", tmp_path / "out", "--hold-out", other, "--json", *FEW).json[
        "hold_out"
    ]
    assert (answer["run"], answer["shots"], answer["message"]) == ("other.jsonl", len(SHOTS) - 1, None)
    assert answer["rms_mm"] < answer["rms_before_mm"] / 5
    assert answer["median_mm"] <= answer["max_mm"] == max(row["error_mm"] for row in answer["measurements"])
    assert (tmp_path / "out" / "figures" / "held_out_run.svg").is_file()
    assert "Held-out run" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    printed = " ".join(zerobeam("analyse", good, "--hold-out", other, *FEW).out.split())
    assert "other.jsonl is predicted" in printed
    assert "is the run itself" in zerobeam("analyse", good, "--hold-out", good, *FEW).refused()
    both = zerobeam("analyse", good, "--hold-out", other, "--hold-out", "psd", *FEW).refused()
    assert "a run can be held out alone only" in both


def study_of(seen: list[tuple[int, int]], agrees: bool) -> Callable[..., Any]:
    def made(data_sets: int, engine: Engine) -> Any:
        assert engine.store is not None
        assert engine.store.name == "study.cases.jsonl"
        engine.progress("good", 0.5)
        seen.append((data_sets, engine.seed))
        answer = agreeing() if agrees else disagreeing()
        return typed({**answer, "plans": answer["plans"][1:2]})

    return made


@pytest.mark.parametrize(("agrees", "status"), [(True, 0), pytest.param(False, 1, marks=pytest.mark.long)])
@pytest.mark.long
def test_a_study_is_written_told_and_judged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, agrees: bool, status: int
) -> None:
    seen: list[tuple[int, int]] = []
    monkeypatch.setattr("zerobeam.experiments.studies.coverage.coverage_study", study_of(seen, agrees))
    told = zerobeam("study", "coverage", "-o", tmp_path / "study", "--data-sets", "250", "--seed", "4")
    assert (told.status, told.err) == (status, "")
    assert seen == [(250, 4)]
    assert told.out.startswith("Agrees. " if agrees else "Does not agree. ")
    assert f"Study: {tmp_path / 'study' / 'study.html'}" in told.out
    assert (tmp_path / "study" / "coverage.csv").is_file()


@pytest.mark.long
def test_a_study_for_a_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[int, int]] = []
    monkeypatch.setattr("zerobeam.experiments.studies.coverage.coverage_study", study_of(seen, True))
    told = zerobeam("study", "coverage", "-o", tmp_path / "study", "--json")
    assert (told.status, told.err) == (0, "")
    assert seen == [(1000, 0)]
    assert told.json == json.loads((tmp_path / "study" / "study.json").read_text(encoding="utf-8"))


def test_a_study_is_refused_before_the_work_where_it_may_not_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[int, int]] = []
    monkeypatch.setattr("zerobeam.experiments.studies.coverage.coverage_study", study_of(seen, True))
    (tmp_path / "thesis.tex").write_text("mine")
    assert "holds other things" in zerobeam("study", "coverage", "-o", tmp_path).refused()
    assert seen == []
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.long
def test_a_small_study_from_beginning_to_end(tmp_path: Path) -> None:
    told = zerobeam("study", "coverage", "-o", tmp_path / "study", "--data-sets", "100", "--json")
    assert told.err == ""
    assert told.status == (0 if told.json["agrees"] else 1)
    assert told.json["settings"]["data_sets"] == 100
    assert len(told.json["plans"]) >= 3


@pytest.mark.one_in(2)
@pytest.mark.parametrize(("name", "status", "verdict"), [("good", 0, "pass"), ("x", 1, "degenerate")])
def test_check_ends_with_its_verdict(plans: dict[str, Path], name: str, status: int, verdict: str) -> None:
    told = zerobeam("check", plans[name], "--json")
    assert (told.status, told.err) == (status, "")
    assert told.json["schema"] == "zerobeam/check/1"
    assert told.json["verdict"] == verdict
    told = zerobeam("check", plans[name])
    assert (told.status, told.err) == (status, "")
    assert "trusted" in told.out
    assert "Standard uncertainties u" not in told.out
    full = zerobeam("check", plans[name], "--full").out
    assert "Standard uncertainties u that these measurements will give" in full


@pytest.fixture(scope="module")
def reported(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Answer]:
    """The report of the good run, its folder and the one above made anew, and what was printed."""
    folder = tmp_path_factory.mktemp("reported") / "made" / "here"
    return folder, zerobeam("report", GOOD, "-o", folder, *FEW)


def test_report_writes_the_folder_and_says_where(reported: tuple[Path, Answer]) -> None:
    folder, told = reported
    assert (told.status, told.err) == (0, "")
    assert f"Report: {folder / 'report.html'}" in told.out
    assert {path.name for path in folder.iterdir()} == WHOLE_REPORT
    assert [path.name for path in folder.parents[1].iterdir()] == ["made"]
    assert [path.name for path in folder.parent.iterdir()] == ["here"]


@pytest.mark.long
def test_report_prints_the_json_that_it_wrote(tmp_path: Path) -> None:
    run = exact_copy(X_PATTERN, tmp_path / "run.jsonl")
    told = zerobeam("report", run, "-o", tmp_path / "out", "--json", *FEW)
    assert (told.status, told.err) == (1, "")
    assert told.json == json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))


@pytest.mark.long
def test_run_records_a_plan_that_can_be_analysed(tmp_path: Path, plans: dict[str, Path]) -> None:
    file = tmp_path / "run.jsonl"
    told = zerobeam("run", plans["good"], "-o", file, "--seed", "3")
    assert (told.status, told.err) == (0, "")
    assert told.out.startswith("Simulated: pass.")
    assert "8 measurements recorded, none refused" in " ".join(told.out.split())
    assert told.out.endswith(f"Run: {file}\n")
    assert zerobeam("analyse", file, "--json", *FEW).status == 0


@pytest.mark.long
def test_run_prints_one_answer_or_every_event(tmp_path: Path, plans: dict[str, Path]) -> None:
    asked = ("run", plans["good"], "--seed", "3", "--no-camera")
    answer = zerobeam(*asked, "-o", tmp_path / "a.jsonl", "--json")
    assert (answer.status, answer.err) == (0, "")
    lines = zerobeam(*asked, "-o", tmp_path / "b.jsonl", "--json-lines")
    events = [json.loads(line) for line in lines.out.replace("b.jsonl", "a.jsonl").splitlines()]
    assert [event["event"] for event in events if event["event"] in ("begin", "recorded", "end")] == [
        "begin",
        *["recorded"] * 8,
        "end",
    ]
    assert events[-1] == answer.json
    assert (tmp_path / "a.jsonl").read_bytes() == (tmp_path / "b.jsonl").read_bytes()


def test_run_ends_with_the_status_of_its_verdict(tmp_path: Path, plans: dict[str, Path]) -> None:
    told = zerobeam("run", plans["x"], "-o", tmp_path / "run.jsonl", "--no-camera", "--json")
    assert told.status == 1
    assert told.json["verdict"] == "degenerate"
    untold = {row["name"] for row in told.json["parameters"] if row["estimate"] is None}
    assert "delta2" in untold


@pytest.mark.long
def test_run_adapts_within_a_tolerance_and_says_what_that_saved(
    tmp_path: Path, plans: dict[str, Path]
) -> None:
    file = tmp_path / "run.jsonl"
    told = zerobeam("run", plans["good"], "-o", file, "--no-camera", "--adaptive", "--tolerance", "2")
    assert told.status in (0, 1)
    assert "within 2" in " ".join(told.out.split())
    closing = zerobeam("run", plans["good"], "-o", tmp_path / "c.jsonl", "--no-camera", "--closing", "--json")
    assert closing.json["shots"] == [*range(8), 8]
    refused = zerobeam("run", plans["good"], "-o", tmp_path / "d.jsonl", "--tolerance", "1").refused()
    assert "--tolerance is for an adaptive run" in refused


def test_import_csv_tells_what_it_understood(tmp_path: Path) -> None:
    rows = tmp_path / "a.csv"
    rows.write_text("1,2,3,4,5,6\n11,12,13,14,15,16\n", encoding="utf-8")
    (tmp_path / "header.yaml").write_text(
        "robot: irb1600\ntool: {kind: probe, point_mm: [0, 0, 100]}\nnoise: {joint_deg: 0.01, spot_mm: 0.5}\n"
    )
    file = tmp_path / "run.jsonl"
    asked = ["--header", tmp_path / "header.yaml", "--target", "ball", "-o", file]
    told = zerobeam("import", "csv", rows, "--units", "deg", *asked)
    assert (told.status, told.err) == (0, "")
    assert "angles in degrees" in told.out
    assert told.out.endswith(f"2 measurements written to {file}\n")
    assert read_run(file).header.schema_ == RUN_SCHEMA


def test_schema_prints_json() -> None:
    names = zerobeam("schema")
    assert names.out.split() == list(SCHEMA_NAMES)
    for name in SCHEMA_NAMES:
        told = zerobeam("schema", name)
        assert (told.status, told.err) == (0, "")
        assert "properties" in told.json or "$defs" in told.json
    assert "there is no schema of that name" in zerobeam("schema", "shot").refused()


# --- faults -------------------------------------------------------------------------------------------


def test_a_target_out_of_reach_is_a_fault_of_the_rig(tmp_path: Path, plans: dict[str, Path]) -> None:
    told = zerobeam("run", plans["away"], "-o", tmp_path / "run.jsonl")
    assert told.status == 3
    assert told.out == ""
    assert told.err.startswith("error: posture 0: ")
    assert "cannot bring the probe onto the target" in told.err
    assert "Traceback" not in told.err


def unconverged(problem: Problem, **asked: Any) -> LikelihoodFit:
    return dataclasses.replace(fit_likelihood(problem, **asked), converged=False, reason="it wandered")


def test_a_failed_fit_has_its_own_status_and_no_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.import_module("zerobeam.analysis.ladder"), "fit_likelihood", unconverged)
    (exact := tmp_path / "run.jsonl").write_text(run_text(), encoding="utf-8")
    told = zerobeam("report", exact, "-o", tmp_path / "out", "--json")
    assert (told.status, told.err) == (3, "")
    assert "did not converge" in told.json["headline"]
    assert {row["status"] for row in told.json["parameters"]} == {"held", "unidentifiable"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == WHOLE_REPORT - {"posterior.nc"}
    assert zerobeam("analyse", exact).status == 3


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (UnsoundResult("the result is unsound"), "error: the result is unsound\n"),
        (ZeroDivisionError("a bug"), "a fault of zerobeam itself"),
    ],
)
def test_a_fault_of_the_program_is_never_taken_for_a_verdict(
    monkeypatch: pytest.MonkeyPatch, fault: Exception, message: str
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise fault

    monkeypatch.setattr(importlib.import_module("zerobeam.analysis.analyse"), "analyse", fail)
    told = zerobeam("analyse", GOOD, "--json")
    assert (told.status, told.out) == (3, "")
    assert message in told.err


def ask_no_further(*_: object, **__: object) -> None:
    raise typer.Abort  # what typer makes of Ctrl-C at a question


@pytest.mark.parametrize(
    "interrupt",
    [
        pytest.param(lambda *_, **__: signal.raise_signal(signal.SIGINT), id="Ctrl-C"),
        pytest.param(lambda *_, **__: signal.raise_signal(signal.SIGTERM), id="a request to end"),
        pytest.param(ask_no_further, id="Ctrl-C at a question"),
    ],
)
@pytest.mark.parametrize("inherited", [signal.SIG_DFL, signal.SIG_IGN])
def test_an_interruption_is_no_verdict_either(
    monkeypatch: pytest.MonkeyPatch, interrupt: Callable[..., None], inherited: signal.Handlers
) -> None:
    monkeypatch.setattr(importlib.import_module("zerobeam.analysis.analyse"), "analyse", interrupt)
    both = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, inherited) for number in both]
    try:
        told = zerobeam("analyse", GOOD, *FEW)
        after = [signal.getsignal(number) for number in both]
    finally:
        for number, handler in zip(both, before, strict=True):
            signal.signal(number, handler)
    assert (told.status, told.out, told.err) == (130, "", "stopped\n")
    assert after == [inherited] * 2


# --- bad input: one message, exit 2, nothing written --------------------------------------------------

PANDA_LIKE = """<robot name="arm"><link name="a"/><link name="b"/>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 1"/><axis xyz="0 0 1"/>
<limit lower="1.0" upper="2.5" effort="1" velocity="1"/></joint></robot>"""


URDF_ROBOT = {"urdf": "arm.urdf", "base": "a", "tip": "b"}
BAD_RUNS: dict[str, tuple[str | bytes, list[str]]] = {
    # name: (content, what the message must say); what else is refused: model/files/test_run.py
    "unknown key of the header": (
        run_text(changed(tolerence={})),
        ["run.jsonl, line 1:", "unknown key 'tolerence'", "did you mean 'tolerance'?", "allowed:"],
    ),
    "outside the limits": (
        run_text(None, one_changed(4, joints_deg=[1, 2, 3, 4, 116, 6])),
        ["line 6:", "joint 5 is outside its limits", "found: 116 deg", "-115 to 115", "limits: warn"],
    ),
    "radians, where they fall outside the limits": (
        run_text(
            changed(robot=URDF_ROBOT), [{"shot": i, "target": "t", "joints_deg": [0.8]} for i in (0, 1)]
        ),
        ["outside its limits", "allowed: 57.2958 to", "correct the value"],
    ),
    "radians within the limits of degrees": (
        run_text(
            changed(robot=URDF_ROBOT), [{"shot": i, "target": "t", "joints_deg": [1.2]} for i in (0, 1)]
        ),
        ["outside its limits", "radians?"],
    ),
    "unknown link": (
        run_text(changed(robot={**URDF_ROBOT, "tip": "c"})),
        ["arm.urdf", "tip link is not in the file", "found: c", "allowed: a, b"],
    ),
    "one shot and a torn line": (
        run_text(None, SHOTS[:1]) + '{"shot":1,"tar',
        ["line 2:", "one measurement can neither determine nor test"],
    ),
    "torn line amid the shots": (
        run_text(None, SHOTS[:2]) + '{"shot":7,"tar\n' + json.dumps(SHOTS[2]) + "\n",
        ["run.jsonl, line 4:", "not JSON", "recording broke off"],
    ),
    "unknown held name": (
        run_text(changed(held=["delta1", "delta7"])),
        ["run.jsonl, line 1:", "held names a parameter that is not there", "found: delta7", "delta6"],
    ),
    "everything held": (
        run_text(changed(held=[f"delta{i}" for i in range(1, 7)] + ["psd.x", "psd.y", "psd.z"])),
        ["run.jsonl, line 1:", "nothing to estimate"],
    ),
    "noise 0": (
        run_text(changed(noise={"joint_deg": 0, "spot_mm": 0.05})),
        ["run.jsonl, line 1:", "joint reading cannot be used", "found: 0", "above 0"],
    ),
    "noise below 0": (
        run_text(changed(noise={"joint_deg": 0.01, "spot_mm": -0.05})),
        ["run.jsonl, line 1:", "noise.spot_mm is out of range", "found: -0.05", ">= 0"],
    ),
}


@pytest.mark.parametrize("name", BAD_RUNS)
def test_a_bad_run_is_one_clear_message_and_nothing_is_written(name: str, tmp_path: Path) -> None:
    content, expected = BAD_RUNS[name]
    (tmp_path / "arm.urdf").write_text(PANDA_LIKE)
    file = tmp_path / "run.jsonl"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    before = contents(tmp_path)
    message = zerobeam("report", file, "-o", tmp_path / "out").refused()
    for part in expected:
        assert part in message, (part, message)
    assert zerobeam("analyse", file, "--json").refused() == message
    assert contents(tmp_path) == before


@pytest.mark.parametrize("command", ["analyse", "check"])
def test_a_file_that_is_a_folder_or_not_there(command: str, tmp_path: Path) -> None:
    assert "this is a folder" in zerobeam(command, tmp_path).refused()
    assert "there is no such file" in zerobeam(command, tmp_path / "none").refused()
    (tmp_path / "good.jsonl").touch()
    assert "did you mean 'good.jsonl'?" in zerobeam(command, tmp_path / "god.jsonl").refused()


@pytest.mark.long
def test_a_torn_last_line_is_told_and_the_rest_used(tmp_path: Path) -> None:
    file = tmp_path / "run.jsonl"
    file.write_text(run_text() + '{"shot":7,"target":"ps', encoding="utf-8")
    told = zerobeam("analyse", file, "--json", *FEW)
    assert (told.status, told.err) == (0, "")
    assert len(told.json["shots"]) == 7
    assert any("line 9, the last, is torn" in note for note in told.json["notes"])
    (tmp_path / "whole.jsonl").write_text(run_text(), encoding="utf-8")
    whole = zerobeam("analyse", tmp_path / "whole.jsonl", "--json", *FEW).json
    for with_it, without in zip(told.json["parameters"], whole["parameters"], strict=True):
        assert with_it["status"] == without["status"]
        assert with_it["estimate"] == pytest.approx(without["estimate"], rel=1e-9)
    assert "is torn" in zerobeam("analyse", file, "--full", *FEW).out


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("robot: irb1600", "robot: irb1601", ["plan.yaml, line", "no robot of this name"]),
        ("postures_deg", "postures", ["unknown key 'postures'", "did you mean 'postures_deg'?"]),
        ("joint_deg: 0.01", "joint_deg: .nan", ["plan.yaml, line", "not finite"]),
        ("noise:", "held: [delta9]\nnoise:", ["plan.yaml", "held names a parameter", "found: delta9"]),
        ("robot:", "robot: [", ["plan.yaml, line"]),
    ],
)
def test_a_bad_plan(tmp_path: Path, plans: dict[str, Path], old: str, new: str, expected: list[str]) -> None:
    text = plans["good"].read_text(encoding="utf-8")
    assert old in text
    file = tmp_path / "plan.yaml"
    file.write_text(text.replace(old, new, 1), encoding="utf-8")
    message = zerobeam("check", file, "--json").refused()
    for part in expected:
        assert part in message, (part, message)
    assert zerobeam("run", file, "-o", tmp_path / "run.jsonl").refused() == message
    assert [path.name for path in tmp_path.iterdir()] == ["plan.yaml"]


def test_a_folder_that_is_not_ours_is_refused_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("analysed before it was known that the answer can be written")

    monkeypatch.setattr(importlib.import_module("zerobeam.analysis.analyse"), "analyse", never)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.tex").write_text("mine")
    (tmp_path / "file").write_text("mine")
    before = contents(tmp_path)
    assert "holds other things" in zerobeam("report", GOOD, "-o", tmp_path / "out").refused()
    assert "is a file" in zerobeam("report", GOOD, "-o", tmp_path / "file").refused()
    (tmp_path / "demo" / "good").mkdir(parents=True)
    (tmp_path / "demo" / "good" / "thesis.tex").write_text("mine")
    assert "holds other things" in zerobeam("demo", "-o", tmp_path / "demo").refused()
    (tmp_path / "demo" / "good" / "thesis.tex").unlink()
    (tmp_path / "demo" / "good").rmdir()
    (tmp_path / "demo").rmdir()
    assert contents(tmp_path) == before


def test_a_run_that_exists_is_never_written_over(tmp_path: Path, plans: dict[str, Path]) -> None:
    file = tmp_path / "run.jsonl"
    file.write_text("mine")
    assert "exists already" in zerobeam("run", plans["good"], "-o", file).refused()
    rows = tmp_path / "a.csv"
    rows.write_text("1,2,3,4,5,6\n11,12,13,14,15,16\n")
    top = tmp_path / "header.yaml"
    top.write_text("robot: irb1600\ntool: {kind: probe, point_mm: [0, 0, 9]}\n" + NOISE)
    asked = [rows, "--header", top, "--units", "deg", "--target", "a", "-o", file]
    told = zerobeam("import", "csv", *asked)
    assert told.status == 2
    assert "exists already" in told.err
    assert file.read_text() == "mine"
    assert "does not exist" in zerobeam("run", plans["good"], "-o", tmp_path / "no" / "run.jsonl").refused()


NOISE = "noise: {joint_deg: 0.01, spot_mm: 0.5}\n"


@pytest.mark.parametrize(
    ("rows", "top", "units", "expected"),
    [
        ("1,2,3,4,5\n", NOISE, "deg", ["a.csv, line 1:", "wrong number of values"]),
        ("1,2,3,4,5,nan\n", NOISE, "deg", ["a.csv, line 1:", "not a finite number"]),
        ("100,20,30,40,50,60\n", NOISE, "rad", ["outside its limits", "radians?"]),
        ("1,2,3,4,5,6\n", NOISE + "limts: warn\n", "deg", ["header.yaml, line 4:", "unknown key 'limts'"]),
    ],
)
def test_bad_recordings(tmp_path: Path, rows: str, top: str, units: str, expected: list[str]) -> None:
    (tmp_path / "a.csv").write_text(rows)
    (tmp_path / "header.yaml").write_text(
        "robot: irb1600\ntool: {kind: probe, point_mm: [0, 0, 9]}\n" + top, encoding="utf-8"
    )
    before = contents(tmp_path)
    asked = ["--header", tmp_path / "header.yaml", "--target", "a", "-o", tmp_path / "run.jsonl"]
    message = zerobeam("import", "csv", tmp_path / "a.csv", "--units", units, *asked).refused()
    for part in expected:
        assert part in message, (part, message)
    assert contents(tmp_path) == before


@pytest.mark.parametrize(
    "arguments",
    [
        ["analyze", GOOD],
        ["analyse"],
        ["analyse", GOOD, "--ess", "1"],
        ["analyse", GOOD, "--seed", "-1"],
        ["analyse", GOOD, "--fast"],
        ["analyse", GOOD, "--robust", "cauchy"],
        ["study", "coverage"],
        ["study", "coverage", "-o", "x", "--data-sets", "99"],
        ["report", GOOD],
        ["run", GOOD, "-o", "x", "--rig", "mine"],
        ["import", "csv", GOOD, "--header", GOOD, "--target", "a", "-o", "x"],
        ["import", "csv", GOOD, "--header", GOOD, "--target", "a", "-o", "x", "--units", "grad"],
    ],
)
def test_bad_usage_is_told_with_the_usage(
    arguments: list[object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    told = zerobeam(*arguments)
    assert (told.status, told.out) == (2, "")
    assert told.err.startswith("Usage: zerobeam")
    assert "Error" in told.err
    assert "Traceback" not in told.err
    assert contents(tmp_path) == {}


# --- whole or not at all ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fault", "status", "message"),
    [
        (OSError(28, "No space left on device"), 3, "error: the report cannot be written to"),
        pytest.param(
            *(RuntimeError("unknown variable"), 3, "RuntimeError: unknown variable"), marks=pytest.mark.long
        ),
    ],
)
@pytest.mark.long
def test_when_the_pdf_fails_the_old_report_stays_and_nothing_is_left_about(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    reported: tuple[Path, Answer],
    fault: Exception,
    status: int,
    message: str,
) -> None:
    shutil.copytree(reported[0], tmp_path / "out")
    run = exact_copy(GOOD, tmp_path / "run.jsonl")
    before = contents(tmp_path)

    def fail(*_: object) -> bytes:
        raise fault

    monkeypatch.setattr(importlib.import_module("zerobeam.reports.output.pdf"), "pdf", fail)
    for folder in ("out", "new/deeper"):
        told = zerobeam("report", run, "-o", tmp_path / folder, *FEW)
        assert told.status == status
        assert told.out == ""
        assert message in told.err
        assert contents(tmp_path) == before


# --- help ---------------------------------------------------------------------------------------------


def commands() -> dict[str, Any]:
    """Every command by its full name."""
    root = typer.main.get_command(program.app)

    def within(command: Any, name: str) -> dict[str, Any]:
        found = {name: command}
        for child, inner in getattr(command, "commands", {}).items():
            found |= within(inner, f"{name} {child}")
        return found

    return within(root, "zerobeam")


def options(command: Any) -> list[Any]:
    return [item for item in command.params if item.opts[0].startswith("-") and item.name != "help"]


def described() -> str:
    """Commands, options and their help, set by ourselves: typer's own setting changes with its versions."""
    lines = []
    for name, command in commands().items():
        lines += [name, f"  {' '.join(command.help.split())}"]
        for item in command.params:
            if item.name == "help":
                continue
            facts = ["/".join(item.opts) if item in options(command) else item.name.upper()]
            facts.append(
                "required" if item.required else f"default {getattr(item.default, 'value', item.default)}"
            )
            if item.multiple or item.nargs != 1:
                facts.append("repeated")
            lines.append(f"  - {', '.join(facts)}: {item.help}")
        lines.append("")
    return "\n".join(lines)


def test_commands_and_options_change_on_purpose() -> None:
    assert_golden("help.txt", described())


@pytest.mark.parametrize("name", commands())
@pytest.mark.one_in(3)
def test_every_command_has_help_that_names_its_options(name: str) -> None:
    told = zerobeam(*name.split()[1:], "--help")
    assert (told.status, told.err) == (0, "")
    command = commands()[name]
    text = " ".join(re.sub(r"[│╭╰╮╯─]", " ", told.out).split())
    assert " ".join(command.help.split()) in text
    for item in options(command):
        assert any(name in text for name in item.opts if name.startswith("--"))
        assert item.help
    for child, own in getattr(command, "commands", {}).items():
        assert child in text or own.hidden


def test_no_command_is_bad_usage_with_help() -> None:
    told = zerobeam()
    assert told.status == 2
    assert "Usage: zerobeam" in told.out + told.err


@pytest.mark.long
def test_two_swapped_columns_of_the_demo_are_a_misfit(tmp_path: Path) -> None:
    """Joints 4 and 6 the wrong way round: no pass, no offset identified, nothing for a controller."""
    bad = tmp_path / "swapped.jsonl"
    with bad.open("w", encoding="utf-8") as file:
        for number, line in enumerate(GOOD.read_text(encoding="utf-8").splitlines()):
            content = json.loads(line)
            if number:
                q = content["joints_deg"]
                q[3], q[5] = q[5], q[3]
            file.write(json.dumps(content) + "\n")
    told = zerobeam("analyse", bad, "--json", "--ess", "100")
    assert told.status == 1
    answer = json.loads(told.out)
    assert answer["verdict"] == "misfit"
    assert not {row["status"] for row in answer["parameters"]} & {"identified", "weak"}
    assert answer["misfit"]["criteria"][0]["kind"] == "chi2"
    assert answer["misfit"]["criteria"][0]["factor"] > 10
    assert answer["misfit"]["criteria"][0]["sentence"] == answer["notes"][0]
    for name in ("rapid", "json", "csv"):
        told = zerobeam("export", name, bad, "-o", tmp_path / name)
        assert told.status == 1
        assert (tmp_path / name).exists() == (name != "rapid")
    assert "--unvalidated" in zerobeam("export", "rapid", bad, "-o", tmp_path / "rapid").err
    told = zerobeam("export", "rapid", bad, "-o", tmp_path / "rapid", "--unvalidated")
    assert (told.status, "UNVALIDATED" in told.out) == (1, True)
    data = json.loads((tmp_path / "json").read_text(encoding="utf-8"))
    assert {own["status"] for own in data["offsets"]} <= {"unvalidated", "held", "unidentifiable"}
    assert all(own["applied"] == 0 for own in data["offsets"])
