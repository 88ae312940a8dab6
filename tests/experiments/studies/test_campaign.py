"""Many runs in simulated cells: the same for any number of processes, each with an arm of its own."""

import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cells import good_plan
from child import DEAF, child

from zerobeam.experiments.rigs.simulated.cell_file import ArmInCell, CellFile, PlacedPsd, PsdInCell, RobotStop
from zerobeam.experiments.rigs.simulated.simulator import SimulatedRig
from zerobeam.experiments.studies.cases import Engine
from zerobeam.experiments.studies.cell import CellRun, Repeated, carried, seeds_of
from zerobeam.model.records import read, to_json

PLAN = good_plan(5)
BLIND = CellFile(camera=None)
WORK = Repeated(PLAN, BLIND)


def without_time(run: CellRun) -> CellRun:
    """All of a run but the time that it took the computer."""
    assert run.estimates is not None
    return replace(run, computing=0.0)


@pytest.mark.long
def test_the_answer_is_the_same_for_any_number_of_processes() -> None:
    seeds, shares = seeds_of(1, 4), list[float]()
    pieces = [(Repeated(good_plan(6), BLIND, tolerance=0.05), seed) for seed in seeds]
    one, two = (
        Engine(0, lambda _, share: shares.append(share), processes=processes).each(
            "own", CellRun, carried, pieces
        )
        for processes in (1, 2)
    )
    assert [without_time(run) for run in one] == [without_time(run) for run in two]
    assert [run.seed for run in two] == list(seeds)
    np.testing.assert_allclose(shares, [*np.arange(5) / 4] * 2)


@pytest.mark.long
def test_each_run_has_an_arm_a_place_and_noise_of_its_own() -> None:
    first, again, other = (carried((WORK, seed)) for seed in (3, 3, 4))
    assert without_time(first) == without_time(again)
    assert first.truth["delta2"] != other.truth["delta2"]
    # With the same offsets stated, the noise is still another.
    same = Repeated(PLAN, BLIND.model_copy(update={"arm": ArmInCell(offsets_deg={"delta2": 0.5})}))
    third, fourth = carried((same, 3)), carried((same, 4))
    assert third.truth == fourth.truth
    assert third.estimates != fourth.estimates


def test_the_truth_is_that_of_the_rig() -> None:
    provenance = SimulatedRig(PLAN, BLIND, 3).provenance()
    truth = {f"delta{i}": provenance[f"true delta{i} (deg)"] for i in range(1, 7)}
    assert carried((WORK, 3)).truth == truth


def test_the_first_seeds_of_many_are_those_of_fewer() -> None:
    assert seeds_of(0, 50)[:5] == seeds_of(0, 5)
    assert len(set(seeds_of(0, 200)) | set(seeds_of(1, 200))) == 400


def test_what_a_run_came_to_and_what_is_kept_of_it() -> None:
    run = carried((replace(WORK, halved=True), 5))
    assert (run.failure, run.used, run.refused) == (None, 5, 0)
    assert list(run.seconds) == ["move", "search", "servo", "settle"]
    assert run.estimates is not None
    assert run.halved is not None
    assert list(run.estimates.offsets) == [f"delta{i}" for i in range(2, 7)]
    for name, (estimate, std) in run.estimates.offsets.items():
        assert abs(estimate - run.truth[name]) < 5 * std
        assert run.halved.offsets[name][1] == pytest.approx(std / 2, rel=0.2)
    assert read(CellRun, to_json(run)) == run


def test_a_run_that_fails_says_why_and_ends_no_other() -> None:
    """The arm stops at shot 2; and a PSD out of view is refused before anything moves."""
    stops = BLIND.model_copy(update={"faults": (RobotStop(kind="robot-stop", shot=2),)})
    away = PsdInCell(placed={"psd": PlacedPsd(centre_mm=(-3000.0, 0.0, 5000.0))})
    works = [Repeated(PLAN, stops), Repeated(PLAN, BLIND.model_copy(update={"psd": away})), WORK]
    stopped, refused, good = (carried((work, 1)) for work in works)
    assert stopped.estimates is None
    assert "stop" in stopped.failure
    assert stopped.used == 2
    assert stopped.truth["delta2"] != 0
    assert "out of view" in refused.failure
    assert (refused.used, refused.estimates) == (0, None)
    assert good.estimates is not None


SCRIPT = """
from cells import good_plan
from zerobeam.interruption import stoppable
from zerobeam.experiments.studies.cell import CellRun, Repeated, carried, seeds_of
from zerobeam.experiments.studies.cases import Engine
from zerobeam.experiments.rigs.simulated.cell_file import CellFile

if __name__ == "__main__":
    try:
        with stoppable():
            work = Repeated(good_plan(5), CellFile(camera=None))
            pieces = [(work, seed) for seed in seeds_of(0, 10_000)]
            tell = lambda name, share: print(share, flush=True) if share else None
            Engine(0, tell, processes=2).each("own", CellRun, carried, pieces)
    except KeyboardInterrupt:
        print("interrupted", flush=True)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="processes are looked for in /proc")
@pytest.mark.parametrize(
    ("how", "before", "starting"),
    [
        pytest.param(signal.SIGINT, [], True, id="Ctrl-C at the start"),
        pytest.param(signal.SIGINT, DEAF, False, id="Ctrl-C", marks=pytest.mark.long),
        pytest.param(signal.SIGTERM, DEAF, False, id="a request to end", marks=pytest.mark.long),
        pytest.param(signal.SIGKILL, [], False, id="a kill", marks=pytest.mark.long),
    ],
)
@pytest.mark.at_length(r"^Ctrl-C at the start$")
def test_no_worker_is_left(how: signal.Signals, before: list[str], starting: bool, tmp_path: Path) -> None:
    """Ctrl-C reaches all processes of a terminal, workers that are still `starting` too; a kill only one."""
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    path = os.pathsep.join(
        [str(Path(__file__).parents[2] / "support"), *filter(None, [os.environ.get("PYTHONPATH")])]
    )
    with child(
        [*before, sys.executable, str(script)],
        env={**os.environ, "PYTHONPATH": path},
        stderr=subprocess.PIPE,
        start_new_session=True,
    ) as process:
        if starting:
            while not any(at_its_imports(pid) for pid in children(process.pid)):
                time.sleep(0.01)
        else:
            process.stdout.readline()
            assert len(children(process.pid)) >= 2
        workers = children(process.pid)
        if how == signal.SIGKILL:
            process.send_signal(how)
        else:
            os.killpg(process.pid, how)
            out, err = process.communicate()
            assert (out.splitlines()[-1], err) == ("interrupted", "")
    until = time.monotonic() + 30
    while (left := {pid for pid in workers if alive(pid)}) and time.monotonic() < until:
        time.sleep(0.05)
    assert not left


def children(parent: int) -> set[int]:
    return {int(pid) for pid in Path(f"/proc/{parent}/task/{parent}/children").read_text().split()}


def at_its_imports(pid: int) -> bool:
    """A worker: Python has its handler of SIGINT already, and the worker has not yet said to ignore it."""
    if b"spawn_main" not in Path(f"/proc/{pid}/cmdline").read_bytes():
        return False
    (caught,) = re.findall(r"^SigCgt:\s*(\w+)$", Path(f"/proc/{pid}/status").read_text(), re.MULTILINE)
    return bool(int(caught, 16) & 1 << signal.SIGINT - 1)


def alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"
