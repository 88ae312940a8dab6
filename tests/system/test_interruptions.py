"""Ctrl-C and a request to end stop every command: status 130, "stopped", nothing half written."""

import json
import os
import random
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from cells import good_plan
from child import ZEROBEAM, child
from command_line import plan_file
from exact_runs import demo_runs

from zerobeam.model.files.run import recorded

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="what a process hears is looked up in /proc")

GOOD = demo_runs()[0].path
STUDY = """
schema: zerobeam/study-file/1
study: two
title: Two noises?
base:
  robot: irb1600
  tool: {kind: laser, calibrated: true, point_mm: [0, 0, 65], direction: [1, 0, 0]}
  noise: {joint_deg: 0.01, spot_mm: 0.05}
  target: {xyz_mm: [900, 100, 0], sigma_mm: 30}
  plan: {kind: optimal, shots: 7, candidates: 100, criterion: A}
  runs: 50
axes:
  - {key: noise.joint_deg, label: joint noise, unit: deg, values: [0.003, 0.01, 0.03, 0.1]}
"""
EARLY_S = 1.0  # in which the imports fall, too; every command takes longer


@dataclass(frozen=True)
class Command:
    """A command whose results go to a `folder` of its own, and by which it is known to have ended: the files
    that it leaves there, and what is printed last."""

    arguments: Callable[[Path], list[str]]
    leaves: frozenset[str]
    last: str


COMMANDS = {
    "analyse": Command(lambda folder: [str(GOOD), "--json"], frozenset(), "\n}\n"),
    "report": Command(lambda folder: [str(GOOD), "-o", str(folder / "out")], frozenset({"out"}), "Report: "),
    "run": Command(
        lambda folder: [str(folder.parent / "plan.yaml"), "-o", str(folder / "run.jsonl"), "--json-lines"],
        frozenset({"run.jsonl"}),
        '{"event": "end"',
    ),
    "study": Command(
        lambda folder: ["file", str(folder.parent / "study.yaml"), "-o", str(folder / "out")],
        frozenset({"out"}),
        "Study: ",
    ),
}


@dataclass
class Alive:
    """A command that hears requests from now on: its imports are still to come. `out`, `err` are files."""

    pid: int
    out: Path
    err: Path
    wait: Callable[[], int]

    def has_ended(self, kind: str) -> bool:
        """Whether all of its output is there."""
        return COMMANDS[kind].last in self.out.read_text(encoding="utf-8")


@contextmanager
def alive(kind: str, folder: Path) -> Iterator[Alive]:
    folder.mkdir()
    out, err = folder.with_suffix(".out"), folder.with_suffix(".err")
    arguments = [*ZEROBEAM, kind, *COMMANDS[kind].arguments(folder)]
    with (
        out.open("w") as output,
        err.open("w") as errors,
        child(arguments, stdout=output, stderr=errors, start_new_session=True) as process,
    ):
        while process.poll() is None and not hears(process.pid):
            time.sleep(0.001)
        yield Alive(process.pid, out, err, lambda: process.wait(timeout=120))


def hears(pid: int) -> bool:
    """Whether a process has a handler for requests to end: Python by itself has none."""
    status = Path(f"/proc/{pid}/status").read_text()
    caught = re.findall(r"^SigCgt:\s*(\w+)$", status, re.MULTILINE)
    return bool(caught) and bool(int(caught[0], 16) & 1 << signal.SIGTERM - 1)


@pytest.fixture
def inputs(tmp_path: Path) -> Path:
    plan_file(tmp_path / "plan.yaml", good_plan(5))
    (tmp_path / "study.yaml").write_text(STUDY)
    return tmp_path


def test_stopped_while_it_begins(inputs: Path) -> None:
    interrupted(inputs, 6, dict.fromkeys(COMMANDS, EARLY_S))


@pytest.mark.long
def test_stopped_at_any_instant(inputs: Path) -> None:
    lasting = {}
    for kind in COMMANDS:
        for kernels in ("made", "there"):
            with alive(kind, inputs / f"{kind}-{kernels}") as process:
                began = time.monotonic()
                assert process.wait() in (0, 1)
                lasting[kind] = time.monotonic() - began
    interrupted(inputs, 100, lasting)


def interrupted(inputs: Path, count: int, lasting: dict[str, float]) -> None:
    """Send a signal at seeded random times within so many seconds, spread evenly: to the process, or as from
    a terminal to its group."""
    draws, wrong, stopped = random.Random(16), [], 0
    for number in range(count):
        kind = list(COMMANDS)[number % len(COMMANDS)]
        how, to_all = draws.choice([signal.SIGINT, signal.SIGTERM]), draws.random() < 0.5
        share = min(1.0, (number // len(COMMANDS) + draws.random()) / (count / len(COMMANDS)))
        with alive(kind, inputs / str(number)) as process:
            time.sleep(share * lasting[kind])
            ended = process.has_ended(kind)
            (os.killpg if to_all else os.kill)(process.pid, how)
            status, err = process.wait(), process.err.read_text()
            stays = [f"process group {process.pid}"] * any_left(process.pid)
        as_asked = status == 130 and err.splitlines()[-1:] == ["stopped"]
        by_itself = ended and status in (0, 1) and err == ""
        stays += half_written(kind, inputs / str(number), process.out.read_text(encoding="utf-8"))
        stopped += as_asked
        if not (as_asked or by_itself) or "Traceback" in err or stays:
            wrong.append((number, kind, how.name, to_all, round(share, 3), status, err[-500:], stays))
    assert wrong == []
    assert stopped > 0.8 * count


def any_left(group: int) -> bool:
    """Whether a process of the group is alive in a while: the last to go has nothing to do but notice."""
    until = time.monotonic() + 10
    while time.monotonic() < until:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return False
        time.sleep(0.02)
    return True


def half_written(kind: str, folder: Path, out: str) -> list[str]:
    """What is neither whole nor absent."""
    command, found = COMMANDS[kind], []
    names = {path.name for path in folder.iterdir()}
    kept = {"out.cases.jsonl"} if kind == "study" else set()
    found += sorted(names - command.leaves - kept)
    if kind == "analyse" and out:
        json.loads(out)
    if "run.jsonl" in names:
        content = (folder / "run.jsonl").read_bytes()
        assert recorded(content, folder / "run.jsonl")[1] is None  # not torn
        assert content.endswith(b"\n")
    if "out.cases.jsonl" in names and not (folder / "out.cases.jsonl").read_bytes().endswith(b"\n"):
        found.append("a line of a case")
    whole = {"report": {"report.html", "report.pdf", "result.json"}, "study": {"study.html", "study.json"}}
    if "out" in names and not whole[kind] <= {path.name for path in (folder / "out").iterdir()}:
        found.append("a folder")
    return found
