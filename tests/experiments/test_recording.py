"""A run that is killed at any instant loses no recorded shot, and goes on to the file of an unbroken one."""

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import PROBE, good_plan
from child import DEAF, ZEROBEAM, child
from command_line import plan_file
from run_events import as_json

from zerobeam.experiments import recording
from zerobeam.experiments.procedure.events import Listener, RunEvent
from zerobeam.experiments.recording import RunRequest
from zerobeam.model.errors import BadInput, RigFault
from zerobeam.model.files.plan import Plan, read_plan
from zerobeam.model.files.run import read_run

QUICK = RunRequest("simulated", seed=4, camera=False)

posix = pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGKILL and no fork")

# A process of its own that forks recorders and kills them: it has no threads, and imports once for all.
NURSERY = """
import os, random, signal, sys, time
from dataclasses import replace
from pathlib import Path
from zerobeam.experiments.recording import RunRequest, record
from zerobeam.model.files.plan import read_plan

plan, folder, kills = read_plan(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
request = RunRequest("simulated", seed=4, camera=False)
silent = lambda event: None
record(plan, folder / "warm.jsonl", request, silent)  # kernels are made
began = time.monotonic()
record(plan, folder / "unbroken.jsonl", request, silent)
lasted = time.monotonic() - began
draws, postures = random.Random(1), len(plan.postures)
for kill in range(kills):
    file = folder / f"{kill}.jsonl"
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        def told(event):
            if event.event == "recorded":
                os.write(writing, bytes([event.shot]))
        record(plan, file, request, told)
        os._exit(0)
    os.close(writing)
    shots = b"".join(os.read(reading, 1) for _ in range(kill % postures))
    time.sleep(lasted / postures / 3 * draws.random())
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    shots += os.read(reading, 1000)
    os.close(reading)
    there = file.exists()
    (folder / f"{kill}.killed").write_bytes(file.read_bytes() if there else b"")
    record(plan, file, replace(request, resume=there), silent)
    print(kill, int(os.WIFSIGNALED(status)), *shots)
"""


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    folder = tmp_path_factory.mktemp("plan")
    return read_plan(plan_file(folder / "plan.yaml", good_plan(7)))


@pytest.fixture(scope="module")
def quick(plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    """The answer and the recording of an unbroken run, which no test may change."""
    file = tmp_path_factory.mktemp("quick") / "run.jsonl"
    return record(plan, file, QUICK, silent), file


@pytest.fixture
def short_plan(tmp_path: Path) -> Plan:
    return read_plan(plan_file(tmp_path / "short.yaml", good_plan(5)))


def record(plan: Plan, file: Path, request: RunRequest, told: Listener) -> dict[str, Any]:
    """The answer as it is printed."""
    return as_json(recording.record(plan, file, request, told))


def silent(event: RunEvent) -> None:
    pass


@posix
@pytest.mark.parametrize("kills", [6, pytest.param(50, marks=pytest.mark.long)])
@pytest.mark.long
def test_killed_at_any_instant_no_shot_is_lost_and_the_run_ends_the_same(
    tmp_path: Path, short_plan: Plan, kills: int
) -> None:
    arguments = [sys.executable, "-c", NURSERY, str(short_plan.path), str(tmp_path), str(kills)]
    told = subprocess.run(arguments, capture_output=True, text=True, timeout=300, check=False)
    assert told.returncode == 0, told.stderr
    unbroken = (tmp_path / "unbroken.jsonl").read_bytes()
    assert len(read_run(tmp_path / "unbroken.jsonl").shots) == 5
    killed_with = []
    for line in told.stdout.splitlines():
        kill, killed, *reported = map(int, line.split())
        left = (tmp_path / f"{kill}.killed").read_bytes()
        whole = left[: left.rfind(b"\n") + 1].splitlines()
        on_disk = [json.loads(row)["shot"] for row in whole[1:]]
        assert set(reported) <= set(on_disk), "a shot that was told of is lost"
        assert unbroken.startswith(b"".join(row + b"\n" for row in whole))
        assert (tmp_path / f"{kill}.jsonl").read_bytes() == unbroken
        if killed:
            killed_with.append(len(on_disk) if left else -1)
    assert len(told.stdout.splitlines()) == kills
    # The kills fell everywhere: before the first shot, after it, and near the end.
    assert len(killed_with) > kills / 2
    assert len(set(killed_with)) >= 4


@pytest.mark.long
@posix
@pytest.mark.parametrize(
    ("before", "numbers"),
    [
        pytest.param([], (signal.SIGINT, signal.SIGTERM), id="heard"),
        pytest.param(DEAF, (signal.SIGTERM,), id="ignored"),
        pytest.param(DEAF, (signal.SIGINT, signal.SIGTERM), id="both ignored", marks=pytest.mark.long),
    ],
)
@pytest.mark.at_length(r"^heard$")
def test_a_request_to_end_stops_the_motion_and_says_how_to_go_on(
    tmp_path: Path,
    plan: Plan,
    quick: tuple[dict[str, Any], Path],
    before: list[str],
    numbers: tuple[signal.Signals, ...],
) -> None:
    """Ctrl-C and SIGTERM, as a person sees them: no traceback, the journal whole, the run resumed.

    It is the same where whoever started the run ignores both.
    """
    file = tmp_path / "run.jsonl"
    command = [*before, *ZEROBEAM, "run", str(plan.path), "-o", str(file), "--seed", "4", "--no-camera"]
    command.append("--json-lines")
    for number in numbers:
        own = [*command, "--resume"] if file.exists() else command
        with child(own, stderr=subprocess.PIPE) as process:
            events = []
            for line in process.stdout:
                events.append(json.loads(line))
                if events[-1]["event"] == "recorded":
                    process.send_signal(number)
                    break
            rest, err = process.communicate(timeout=60)
        events += [json.loads(line) for line in rest.splitlines()]
        assert process.returncode == 130, err
        assert "Traceback" not in err
        assert "--resume" in err
        assert events[-1] == {"event": "stopped", "why": "interrupted"}
    made = len(read_run(file).shots)
    assert len(numbers) <= made < 7
    record(plan, file, replace(QUICK, resume=True), silent)
    assert file.read_bytes() == quick[1].read_bytes()


@pytest.mark.parametrize("kept_rows", [(6, 8), pytest.param((1, 3), marks=pytest.mark.long)])
@pytest.mark.long
def test_a_run_with_pictures_is_resumed_to_the_same_bytes(
    tmp_path: Path, plan: Plan, kept_rows: tuple[int, ...]
) -> None:
    request = RunRequest("simulated", seed=2)
    record(plan, tmp_path / "unbroken.jsonl", request, silent)
    whole = (tmp_path / "unbroken.jsonl").read_bytes()
    rows = whole.splitlines(keepends=True)
    for kept in kept_rows:
        file = tmp_path / f"{kept}.jsonl"
        file.write_bytes(b"".join(rows[:kept]) + (rows[kept][:50] if kept < len(rows) else b""))
        answer = record(plan, file, RunRequest("simulated", seed=2, resume=True), silent)
        assert file.read_bytes() == whole
        assert any("torn" in note for note in answer["notes"]) == (kept < len(rows))


@pytest.mark.parametrize("step", [3, pytest.param(1, marks=pytest.mark.long)])
@pytest.mark.long
def test_an_adaptive_run_is_resumed_to_the_same_bytes(tmp_path: Path, plan: Plan, step: int) -> None:
    """After every row, or every third."""
    request = RunRequest("simulated", seed=2, camera=False, adaptive=True, tolerance=0.03)
    answer = record(plan, tmp_path / "unbroken.jsonl", request, silent)
    whole = (tmp_path / "unbroken.jsonl").read_bytes()
    rows = whole.splitlines(keepends=True)
    for kept in range(2 if step > 1 else 1, len(rows), step):
        file = tmp_path / f"{kept}.jsonl"
        file.write_bytes(b"".join(rows[:kept]))
        again = RunRequest("simulated", seed=2, camera=False, adaptive=True, tolerance=0.03, resume=True)
        assert record(plan, file, again, silent)["parameters"] == answer["parameters"]
        assert file.read_bytes() == whole


def test_the_answer_is_that_of_the_shots_and_names_no_offset_that_they_cannot_tell(
    tmp_path: Path, quick: tuple[dict[str, Any], Path]
) -> None:
    answer, file = quick
    assert answer["schema"] == "zerobeam/carried/1"
    weak = any(row["status"] == "weak" for row in answer["parameters"])
    assert answer["verdict"] == ("weak" if weak else "pass")
    assert [row["name"] for row in answer["parameters"]] == [f"delta{i}" for i in range(1, 7)]
    by_name = {row["name"]: row for row in answer["parameters"]}
    assert by_name["delta1"]["status"] == "held"
    assert by_name["delta1"]["std"] is None
    run = read_run(file)
    for i in range(2, 7):
        row = by_name[f"delta{i}"]
        truth = float(run.header.provenance[f"true delta{i} (deg)"])
        assert abs(row["estimate"] - truth) < 5 * row["std"] < 1.0
    few = read_plan(plan_file(tmp_path / "few.yaml", good_plan(2)))
    answer = record(few, tmp_path / "few.jsonl", QUICK, silent)
    assert answer["verdict"] == "degenerate"
    told = [row for row in answer["parameters"] if row["status"] != "held"]
    assert {row["status"] for row in told} == {"unidentifiable"}
    assert all(row["estimate"] is None and row["std"] is None for row in told)


def test_the_provenance_says_what_it_was_made_of(tmp_path: Path, plan: Plan) -> None:
    cell = tmp_path / "cell.yaml"
    cell.write_text("schema: zerobeam/cell/1\ncamera: null\narm: {offsets_deg: {delta3: 0.5}}\n")
    record(plan, tmp_path / "run.jsonl", RunRequest("simulated", seed=9, cell=cell), silent)
    provenance = read_run(tmp_path / "run.jsonl").header.provenance
    assert provenance["origin"] == "simulated"
    assert provenance["seed"] == 9
    assert provenance["plan sha256"] == plan.sha256
    assert provenance["true delta3 (deg)"] == 0.5
    assert provenance["true delta2 (deg)"] == 0.0
    assert len(str(provenance["cell sha256"])) == 64


def test_another_plan_seed_or_cell_cannot_go_on_with_a_run(
    tmp_path: Path, plan: Plan, quick: tuple[dict[str, Any], Path]
) -> None:
    file = tmp_path / "run.jsonl"
    before = quick[1].read_bytes()
    file.write_bytes(before)
    other = read_plan(plan_file(tmp_path / "other.yaml", good_plan(8)))
    cell = tmp_path / "cell.yaml"
    cell.write_text("schema: zerobeam/cell/1\n")
    for plan_given, changed in (
        (other, {}),
        (plan, {"seed": 5}),
        (plan, {"cell": cell}),
        (plan, {"camera": True}),
    ):
        request = RunRequest(**{**vars(QUICK), "resume": True, **changed})
        with pytest.raises(BadInput, match="begun with another header"):
            record(plan_given, file, request, silent)
    assert file.read_bytes() == before


def foreign(row: dict[str, Any], what: str) -> None:
    """Make a measurement one that the plan does not have."""
    if what == "number":
        row["shot"] = 14  # 0 to 6 are the plan's, 7 to 13 closing ones
    elif what == "target":
        row["target"] = "elsewhere"
    else:
        row["joints_deg"][1] += 6.0


@pytest.mark.parametrize(
    ("what", "told"), [("number", "measurement 14"), ("target", "elsewhere"), ("posture", "joint 2 is")]
)
def test_a_run_with_a_measurement_of_another_plan_cannot_be_resumed(
    tmp_path: Path, plan: Plan, quick: tuple[dict[str, Any], Path], what: str, told: str
) -> None:
    rows = quick[1].read_bytes().splitlines()[:4]
    row = json.loads(rows[3])
    foreign(row, what)
    rows[3] = json.dumps(row).encode()
    file = tmp_path / "run.jsonl"
    before = b"\n".join(rows) + b'\n{"torn'
    file.write_bytes(before)
    events: list[RunEvent] = []
    with pytest.raises(BadInput, match="not of this plan") as refused:
        record(plan, file, replace(QUICK, resume=True), events.append)
    assert (refused.value.line, file.read_bytes(), events) == (4, before, [])
    assert told in str(refused.value)


def test_a_probe_run_with_a_measurement_of_another_plan_cannot_be_resumed(tmp_path: Path) -> None:
    plan = read_plan(plan_file(tmp_path / "plan.yaml", good_plan(3, tool=PROBE)))
    file = tmp_path / "run.jsonl"
    record(plan, file, QUICK, silent)
    rows = file.read_bytes().splitlines()
    for what in ("number", "target"):
        row = json.loads(rows[3])
        foreign(row, what)
        file.write_bytes(b"\n".join([*rows[:3], json.dumps(row).encode(), b""]))
        with pytest.raises(BadInput, match="not of this plan"):
            record(plan, file, replace(QUICK, resume=True), silent)


def test_a_file_that_exists_is_refused_before_anything_moves(tmp_path: Path, plan: Plan) -> None:
    file = tmp_path / "run.jsonl"
    file.write_text("mine")
    events: list[RunEvent] = []
    with pytest.raises(BadInput, match="exists already") as refused:
        record(plan, file, QUICK, events.append)
    assert "--resume" in str(refused.value)
    assert (file.read_text(), events) == ("mine", [])
    with pytest.raises(BadInput, match="no recording to go on with"):
        record(plan, tmp_path / "none.jsonl", RunRequest("simulated", resume=True), silent)


def test_a_stop_of_the_robot_ends_the_run_and_it_can_be_gone_on_with(tmp_path: Path, plan: Plan) -> None:
    cell = tmp_path / "cell.yaml"
    cell.write_text("schema: zerobeam/cell/1\ncamera: null\nfaults: [{kind: robot-stop, shot: 3}]\n")
    request = RunRequest("simulated", seed=4, cell=cell)
    with pytest.raises(RigFault, match="stopped by itself"):
        record(plan, tmp_path / "run.jsonl", request, silent)
    assert [shot.shot for shot in read_run(tmp_path / "run.jsonl").shots] == [0, 1, 2]
    again = RunRequest("simulated", seed=4, cell=cell, resume=True)
    answer = record(plan, tmp_path / "run.jsonl", again, silent)
    assert answer["shots"] == list(range(7))


def test_a_probe_is_led_by_hand(tmp_path: Path) -> None:
    plan = read_plan(plan_file(tmp_path / "plan.yaml", good_plan(6, tool=PROBE)))
    answer = record(plan, tmp_path / "run.jsonl", QUICK, silent)
    assert answer["shots"] == list(range(6))
    rows = (tmp_path / "run.jsonl").read_bytes().splitlines(keepends=True)
    (tmp_path / "part.jsonl").write_bytes(b"".join(rows[:4]))
    record(plan, tmp_path / "part.jsonl", RunRequest("simulated", seed=4, camera=False, resume=True), silent)
    assert (tmp_path / "part.jsonl").read_bytes() == b"".join(rows)
    with pytest.raises(BadInput, match="--adaptive is for a laser"):
        record(plan, tmp_path / "other.jsonl", RunRequest("simulated", adaptive=True, tolerance=0.1), silent)
    with pytest.raises(BadInput, match="--closing is for a laser"):
        record(plan, tmp_path / "other.jsonl", RunRequest("simulated", closing=True), silent)
    assert not (tmp_path / "other.jsonl").exists()


def test_a_recorded_run_is_replayed_to_the_same_answer(
    tmp_path: Path, plan: Plan, quick: tuple[dict[str, Any], Path]
) -> None:
    told, recorded = quick
    replay = RunRequest("replay", recording=recorded)
    answer = record(plan, tmp_path / "again.jsonl", replay, silent)
    for row, other in zip(answer["parameters"], told["parameters"], strict=True):
        if row["estimate"] is not None:
            np.testing.assert_allclose(row["estimate"], other["estimate"], rtol=0, atol=1e-4)
    with pytest.raises(BadInput, match="needs a recording"):
        record(plan, tmp_path / "x.jsonl", RunRequest("replay"), silent)


@pytest.mark.long
def test_a_closing_shot_repeats_the_first_posture_and_is_replayed(tmp_path: Path, plan: Plan) -> None:
    closing = replace(QUICK, closing=True)
    answer = record(plan, tmp_path / "run.jsonl", closing, silent)
    assert answer["shots"] == [*range(7), 7]
    run = read_run(tmp_path / "run.jsonl")
    # The same posture but for the wrist, which is turned onto the target by what is known by then.
    np.testing.assert_allclose(run.joints[7, :3], run.joints[0, :3], rtol=0, atol=np.radians(1e-3))
    replayed = RunRequest("replay", recording=tmp_path / "run.jsonl", closing=True)
    assert record(plan, tmp_path / "again.jsonl", replayed, silent)["shots"] == answer["shots"]
    rows = (tmp_path / "run.jsonl").read_bytes().splitlines(keepends=True)
    (tmp_path / "part.jsonl").write_bytes(b"".join(rows[:-1]))
    record(plan, tmp_path / "part.jsonl", replace(closing, resume=True), silent)
    assert (tmp_path / "part.jsonl").read_bytes() == b"".join(rows)


@pytest.mark.parametrize("other", [{"closing": True}, {"adaptive": True, "tolerance": 0.1}])
def test_intermediate_postures_are_for_the_order_of_the_plan_alone(
    tmp_path: Path, plan: Plan, other: dict[str, Any], refused: Callable[..., BadInput]
) -> None:
    stated = replace(plan, via=(np.zeros((0, 6)),) * len(plan.postures))
    request = RunRequest("simulated", **other)
    error = refused(recording.record, stated, tmp_path / "run.jsonl", request, lambda event: None)
    assert "safe in its own order only" in error.what
    assert not (tmp_path / "run.jsonl").exists()
