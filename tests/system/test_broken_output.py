"""Output that nobody reads, or that finds no room, is no verdict, and ends no recording."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from cells import exact_copy, good_plan
from child import ZEROBEAM, child
from command_line import plan_file
from exact_runs import demo_runs

from zerobeam.model.files.header import write_header
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


@pytest.mark.parametrize("command", ["--help", "robot irb1600 --json", "check"])
@pytest.mark.at_length(r"^(check|--help)")
def test_a_command_whose_output_nobody_reads(command: str, plan: Path) -> None:
    """As a shell has it: 128 and the number of SIGPIPE; not 1, a verdict."""
    with closed_pipe() as nowhere:
        arguments = [*command.split(), str(plan)] if command == "check" else command.split()
        assert told(arguments, nowhere) == (141, "")


@full
@pytest.mark.parametrize("command", ["--help", "robot irb1600 --json"])
@pytest.mark.at_length(r"^robot")
def test_a_command_whose_output_finds_no_room(command: str) -> None:
    with open("/dev/full", "wb") as nowhere:
        assert told(command.split(), nowhere.fileno()) == (3, NO_ROOM)


@pytest.mark.long
def test_messages_that_nobody_reads_change_no_status(plan: Path) -> None:
    plan.write_text("none")
    with closed_pipe() as nowhere:
        assert told(["check", str(plan)], subprocess.DEVNULL, stderr=nowhere)[0] == 2


@pytest.mark.parametrize("events", [["--json-lines"], pytest.param([], marks=pytest.mark.long)])
@pytest.mark.long
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


@pytest.mark.parametrize(("command", "status"), [("robot irb1600", 0), ("robot nothing", 2)])
@pytest.mark.at_length(r"^robot irb")
def test_a_command_without_any_streams_has_its_status(command: str, status: int) -> None:
    shell = ["sh", "-c", 'exec "$@" >&- 2>&-', "sh"]
    with child([*shell, *ZEROBEAM, *command.split()]) as process:
        assert process.wait(timeout=120) == status


@pytest.fixture
def full_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system without any room."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(disk)]
    if shutil.which("mount") is None or subprocess.run(mounted, capture_output=True).returncode:
        pytest.skip("only root may mount a file system, and not in every container")
    try:
        with suppress(OSError), (disk / "filling").open("wb", buffering=0) as file:
            while True:
                file.write(bytes(4096))
        yield disk
    finally:
        subprocess.run(["umount", str(disk)], check=True)


GOOD = next(run.path for run in demo_runs() if run.name == "good")
WRITING = {
    "report": ["report", "{here}/good.jsonl", "--ess", "100", "-o", "{disk}/out"],
    "batch": ["batch", "{here}/good.jsonl", "--no-posterior", "-o", "{disk}/out"],
    "export": ["export", "csv", str(GOOD), "-o", "{disk}/offsets.csv"],
    "plan": ["plan", "x", "--header", "{here}/header.yaml", "--target", "900,0,0", "-o", "{disk}/new.yaml"],
    "picture": ["check", "{here}/plan.yaml", "--picture", "{disk}/plan.html"],
    "compare": ["compare", str(GOOD), "{here}/again.jsonl", "-o", "{disk}/out"],
    "run": ["run", "{here}/plan.yaml", "--no-camera", "-o", "{disk}/run.jsonl"],
    "study": ["study", "noise", "--runs", "2", "-o", "{disk}/out"],
    "import": [
        *("import", "csv", "{here}/points.csv", "--units", "deg", "--target", "psd"),
        *("--header", "{here}/header.yaml", "-o", "{disk}/points.jsonl"),
    ],
}
# HDF5 has an end of its own where there is no room; the others write as one of these does.
QUICK = {("report", "a full disk"), ("report", "a limit"), ("batch", "a full disk"), ("plan", "a limit")}


def _inputs(folder: Path) -> None:
    plan_file(folder / "plan.yaml", good_plan(2))
    run = read_run(exact_copy(GOOD, folder / "good.jsonl"))
    write_header(folder / "header.yaml", run.header)
    head, *shots = GOOD.read_text().splitlines()
    (folder / "again.jsonl").write_text("\n".join([head, *shots[::-1]]) + "\n")
    rows = (",".join(map(str, shot.joints_deg)) for shot in run.shots)
    (folder / "points.csv").write_text("\n".join(rows) + "\n")


@pytest.mark.skipif(sys.platform != "linux", reason="mount and limits of Linux")
@pytest.mark.parametrize(
    ("what", "how"),
    [
        pytest.param(what, how, marks=() if (what, how) in QUICK else pytest.mark.long)
        for what in WRITING
        for how in ("a full disk", "a limit")
    ],
)
@pytest.mark.long
def test_a_file_that_finds_no_room_is_a_fault_and_one_message(
    what: str, how: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    """Exit status 3: the input is not what is wrong; and no crash, of HDF5 say."""
    disk = tmp_path
    if how == "a full disk":
        disk = request.getfixturevalue("full_disk")
    _inputs(tmp_path)
    before = set(tmp_path.rglob("*"))
    words = [word.format(here=tmp_path, disk=disk) for word in WRITING[what]]
    limited = ["prlimit", "--fsize=20"] if how == "a limit" else []
    if limited and shutil.which("prlimit") is None:
        pytest.skip("there is no prlimit")
    with child([*limited, *ZEROBEAM, *words], stderr=subprocess.PIPE) as process:
        err = process.communicate(timeout=200)[1]
    assert process.returncode == 3, err
    assert err.count("error: ") == 1
    assert "No space left on device" in err or "File too large" in err
    assert "Traceback" not in err
    assert "fault of zerobeam" not in err
    left = set(tmp_path.rglob("*")) - before
    kept = ("out", "out/finished.jsonl", "out.cases.jsonl")  # what a batch or a study goes on with
    assert left <= {disk / name for name in kept}
