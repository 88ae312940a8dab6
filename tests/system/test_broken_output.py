"""Output that nobody reads, or that finds no room, is no verdict, and ends no recording."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from cells import good_plan
from child import ZEROBEAM, child
from command_line import plan_file

from zerobeam.model.files.run import read_run

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pipes of POSIX")
full = pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")

NO_ROOM = "error: the output cannot be written: No space left on device\n"


@contextmanager
def closed_pipe() -> Iterator[int]:
    """The end to write to of a pipe that nobody reads: `zerobeam … | head -1` once `head` has its line."""
    reading, writing = os.pipe()
    os.close(reading)
    try:
        yield writing
    finally:
        os.close(writing)


def told(arguments: list[str], output: int, **streams: int) -> tuple[int, str]:
    """Status and standard error of a command that prints to `output`."""
    asked = {"stderr": subprocess.PIPE, **streams}
    with child([*ZEROBEAM, *arguments], stdout=output, **asked) as process:
        err = process.communicate(timeout=120)[1]
    return process.returncode, err


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    return plan_file(tmp_path / "plan.yaml", good_plan(2))


@pytest.mark.parametrize("command", ["--help", "schema plan", "check"])
def test_a_command_whose_output_nobody_reads(command: str, plan: Path) -> None:
    """As a shell has it: 128 and the number of SIGPIPE; not 1, a verdict."""
    with closed_pipe() as nowhere:
        arguments = [*command.split(), str(plan)] if command == "check" else command.split()
        assert told(arguments, nowhere) == (141, "")


@full
@pytest.mark.parametrize("command", ["--help", "schema plan"])
def test_a_command_whose_output_finds_no_room(command: str) -> None:
    with open("/dev/full", "wb") as nowhere:
        assert told(command.split(), nowhere.fileno()) == (3, NO_ROOM)


def test_messages_that_nobody_reads_change_no_status(plan: Path) -> None:
    plan.write_text("none")
    with closed_pipe() as nowhere:
        assert told(["check", str(plan)], subprocess.DEVNULL, stderr=nowhere)[0] == 2


@pytest.mark.parametrize("events", [["--json-lines"], pytest.param([], marks=pytest.mark.long)])
def test_a_run_whose_output_nobody_reads_is_recorded_to_its_end(events: list[str], plan: Path) -> None:
    file = plan.with_name("run.jsonl")
    with closed_pipe() as nowhere:
        status, err = told(["run", str(plan), "-o", str(file), "--no-camera", *events], nowhere)
    assert status == 141
    assert err == (f"note: the events are no longer read; the run goes on, into {file}\n" if events else "")
    assert len(read_run(file).shots) == 2


@full
@pytest.mark.long
def test_a_run_whose_output_finds_no_room_is_recorded_to_its_end(plan: Path) -> None:
    file = plan.with_name("run.jsonl")
    command = ["run", str(plan), "-o", str(file), "--no-camera", "--json-lines"]
    with open("/dev/full", "wb") as nowhere:
        status, err = told(command, nowhere.fileno())
    assert (status, err.splitlines()[-1] + "\n") == (3, NO_ROOM)
    assert len(read_run(file).shots) == 2


@pytest.mark.parametrize(("command", "status"), [("schema plan", 0), ("schema nothing", 2)])
def test_a_command_without_any_streams_has_its_status(command: str, status: int) -> None:
    shell = ["sh", "-c", 'exec "$@" >&- 2>&-', "sh"]
    with child([*shell, *ZEROBEAM, *command.split()]) as process:
        assert process.wait(timeout=120) == status
