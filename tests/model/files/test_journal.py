"""A journal loses at most the shot under way wherever it is stopped, and goes on as if it never had been."""

import errno
import json
import os
import random
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from zerobeam.model.errors import BadInput, RigFault
from zerobeam.model.files import journal, run
from zerobeam.model.files.header import Header
from zerobeam.model.files.journal import RunJournal
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import read_run
from zerobeam.model.files.shot import Shot

Refused = Callable[..., BadInput]

CONTENT: dict[str, Any] = {
    "robot": "irb1600",
    "tool": {"kind": "laser", "point_mm": [0, 0, 65], "direction": [1, 0, 0]},
    "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
    "provenance": {"place": "Größe 1", "seed": 1},
}
HEADER = Header.model_validate(CONTENT)
JOINTS = (10.0, 20.0, -30.0, 40.0, 50.0, -60.0)

posix = pytest.mark.skipif(sys.platform == "win32", reason="there are no such limits or signals")


def made_shot(number: int) -> Shot:
    joints = tuple(value + number % 30 / 7 for value in JOINTS)
    return Shot(shot=number, target="größer", joints_deg=joints, spot_mm=(0.5, -0.25 * number))


SHOTS = [made_shot(number) for number in range(3)]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.jsonl"


@pytest.fixture
def whole(tmp_path: Path) -> bytes:
    """An unbroken run file of a header and three shots."""
    return recording(tmp_path / "unbroken.jsonl", SHOTS)


def recording(path: Path, shots: list[Shot]) -> bytes:
    with RunJournal(path, HEADER) as journal:
        for shot in shots:
            journal.append(shot)
    return path.read_bytes()


@pytest.fixture
def robot_at_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """The robot's file, which is not at issue, is read once: that takes longest."""
    robot = load_robot("irb1600", Path())
    for module in (run, journal):
        monkeypatch.setattr(module, "load_robot", lambda *_, **__: robot)


def test_every_shot_is_on_the_disk_before_the_next(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[int] = []
    really = os.fsync

    def fsync(handle: int) -> None:
        synced.append(os.fstat(handle).st_size)
        really(handle)

    monkeypatch.setattr(os, "fsync", fsync)
    with RunJournal(path, HEADER) as journal:
        assert path.stat().st_size in synced
        for i, shot in enumerate(SHOTS, start=1):
            synced.clear()
            journal.append(shot)
            assert synced == [path.stat().st_size]
            assert read_run(path).shots == journal.shots == tuple(SHOTS[:i])
    read_run(path).require_analysable()


@pytest.fixture
def at_every_call() -> Iterator[Callable[[Callable[[], None]], None]]:
    """Have a function called before and after each call of a function, be it Python's or C's."""
    before = sys.getprofile()

    def watch(look: Callable[[], None]) -> None:
        def at_call(frame: FrameType, event: str, argument: object) -> None:
            look()

        sys.setprofile(at_call)

    yield watch
    sys.setprofile(before)


@pytest.mark.usefixtures("robot_at_hand")
def test_a_new_journal_never_has_its_name_without_its_whole_header(
    path: Path, at_every_call: Callable[[Callable[[], None]], None]
) -> None:
    observed: list[bytes | None] = []

    def look() -> None:
        content = path.read_bytes() if path.exists() else None
        if not observed or observed[-1] != content:
            observed.append(content)

    at_every_call(look)
    journal = RunJournal(path, HEADER)
    sys.setprofile(None)
    journal.close()
    assert observed == [None, path.read_bytes()]
    # The control: a file that is opened under its name, then written.
    observed.clear()
    path.unlink()
    at_every_call(look)
    with open(path, "xb") as file:
        file.write(b"{}")
        file.flush()
    sys.setprofile(None)
    assert observed == [None, b"", b"{}"]


def test_nothing_is_overwritten_and_nothing_unsound_is_begun(
    tmp_path: Path, path: Path, refused: Refused
) -> None:
    path.write_text("mine")
    error = refused(RunJournal, path, HEADER)
    assert "exists already" in error.what
    assert "--resume" in str(error.remedy)
    assert path.read_text() == "mine"
    assert "folder" in refused(RunJournal, tmp_path, HEADER).what
    other = tmp_path / "other.jsonl"
    nobody = HEADER.model_copy(update={"robot": "nobody"})
    assert "no robot" in refused(RunJournal, other, nobody).what
    assert "does not exist" in refused(RunJournal, tmp_path / "no" / "r.jsonl", HEADER).what
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.jsonl"]


def test_a_journal_takes_only_what_can_be_read_again(path: Path, refused: Refused) -> None:
    with RunJournal(path, HEADER) as journal:
        journal.append(SHOTS[0])
        assert "recorded already" in refused(journal.append, SHOTS[0]).what
        short = SHOTS[1].model_copy(update={"joints_deg": (1.0,)})
        assert "wrong number" in refused(journal.append, short).what
        journal.append(SHOTS[2])
    assert [each.shot for each in read_run(path).shots] == [0, 2]
    with pytest.raises(RigFault, match="closed"):
        journal.append(SHOTS[1])


@pytest.mark.parametrize(
    ("failure", "message"),
    [(OSError(errno.ENOSPC, "No space left on device"), RigFault), (KeyboardInterrupt(), KeyboardInterrupt)],
)
def test_a_shot_that_does_not_reach_the_disk_is_taken_back(
    path: Path, monkeypatch: pytest.MonkeyPatch, failure: BaseException, message: type[BaseException]
) -> None:
    def failing(_: int) -> None:
        raise failure

    with RunJournal(path, HEADER) as journal:
        journal.append(SHOTS[0])
        before = path.read_bytes()
        with monkeypatch.context() as patch:
            patch.setattr(os, "fsync", failing)
            with pytest.raises(message):
                journal.append(SHOTS[1])
        assert journal.shots == (SHOTS[0],)
        assert path.read_bytes() == before
        with pytest.raises(RigFault, match="closed"):
            journal.append(SHOTS[1])
    with RunJournal.resumed(path, HEADER) as journal:
        assert journal.torn is None
        journal.append(SHOTS[1])
    assert read_run(path).shots == tuple(SHOTS[:2])


@posix
def test_a_line_that_does_not_fit_on_the_disk_leaves_nothing_behind(path: Path) -> None:
    """The system itself breaks the line off, after any number of its bytes."""
    import resource

    before = recording(path, SHOTS[:2])
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    for room in range(0, 100, 9):
        with RunJournal.resumed(path, HEADER) as journal:
            resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + room, hard))
            try:
                with pytest.raises(RigFault, match="cannot be recorded"):
                    journal.append(SHOTS[2])
            finally:
                resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        assert path.read_bytes() == before


@pytest.mark.usefixtures("robot_at_hand")
@pytest.mark.parametrize("every", [7, pytest.param(1, marks=pytest.mark.long)])
def test_wherever_the_file_is_cut_off_the_whole_shots_are_there_and_it_goes_on(
    path: Path, whole: bytes, refused: Refused, monkeypatch: pytest.MonkeyPatch, every: int
) -> None:
    """For every number of bytes that may be left of a header and three shots: all near the ends of lines."""
    monkeypatch.setattr(os, "fsync", lambda handle: None)  # slow, and it changes no byte
    ends = [i for i, byte in enumerate(whole) if byte == ord("\n")]  # a line needs what is before these
    near = {size for end in ends for size in range(end - 2, end + 3) if size <= len(whole)}
    for size in sorted(near | set(range(0, len(whole) + 1, every))):
        left = whole[:size]
        path.write_bytes(left)
        if size < ends[0]:
            refused(read_run, path)
            refused(RunJournal.resumed, path, HEADER)
            assert path.read_bytes() == left
            continue
        count = sum(size >= end for end in ends) - 1
        torn = size not in (*ends, *(end + 1 for end in ends))
        if count:
            assert read_run(path).shots == tuple(SHOTS[:count])
        else:
            assert "no measurements" in refused(read_run, path).what
        with RunJournal.resumed(path, HEADER) as journal:
            assert journal.shots == tuple(SHOTS[:count]), left
            assert (journal.torn is not None) is torn, left
            assert path.read_bytes() == whole[: ends[count] + 1]
            for shot in SHOTS[count:]:
                journal.append(shot)
            assert journal.shots == tuple(SHOTS)
        assert path.read_bytes() == whole


@pytest.mark.parametrize(
    "tail", [b"\0" * 300, b'{"shot":3,\0\0\0', b"\xff\xfe", b'{"shot":3,"tar\n', b'\n\n{"shot":3,\n\r\n \n']
)
def test_a_tail_of_no_meaning_is_taken_out(path: Path, whole: bytes, tail: bytes) -> None:
    path.write_bytes(whole + tail)
    with RunJournal.resumed(path, HEADER) as journal:
        assert journal.shots == tuple(SHOTS)
        line = 7 if tail.startswith(b"\n") else 5
        assert str(journal.torn).startswith(f"line {line}, the last, was torn")
        journal.append(made_shot(3))
    assert read_run(path).shots == (*SHOTS, made_shot(3))
    assert read_run(path).warnings == ()


def test_a_recording_that_was_not_on_the_disk_is_brought_there_when_it_is_resumed(
    path: Path, whole: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    path.write_bytes(whole[:-1])
    synced: list[int] = []
    monkeypatch.setattr(os, "fsync", lambda handle: synced.append(os.fstat(handle).st_ino))
    RunJournal.resumed(path, HEADER).close()
    assert path.read_bytes() == whole
    assert synced == [path.stat().st_ino, path.parent.stat().st_ino]


@pytest.mark.parametrize(
    ("changes", "key", "result", "allowed"),
    [
        ({"robot": "irb1601"}, "robot", '"irb1600"', '"irb1601"'),
        ({"noise": {"joint_deg": 0.02, "spot_mm": 0.05}}, "noise.joint_deg", "0.01", "0.02"),
        ({"noise": {**CONTENT["noise"], "scale": "estimated"}}, "noise.scale", "not stated", '"estimated"'),
        ({"prior": {"offset_deg": 5.0}}, "prior", "not stated", '{"offset_deg": 5.0}'),
        ({"provenance": {"place": "Größe 1", "seed": 2}}, "provenance.seed", "1", "2"),
        ({"provenance": {"place": "Größe 1", "seed": True}}, "provenance.seed", "1", "true"),
        ({"provenance": {"place": "Größe 1"}}, "provenance.seed", "1", "not stated"),
    ],
)
def test_another_header_is_refused_by_its_first_key_that_differs(
    path: Path, whole: bytes, refused: Refused, changes: dict[str, Any], key: str, result: str, allowed: str
) -> None:
    torn = whole[:-9]  # which would be taken out
    path.write_bytes(torn)
    error = refused(RunJournal.resumed, path, Header.model_validate({**CONTENT, **changes}))
    assert error.what == f"the recording was begun with another header: {key} differs"
    assert (error.found, error.allowed, error.line) == (result, allowed, 1)
    assert "--resume" in str(error.remedy)
    assert path.read_bytes() == torn


def test_the_same_header_may_be_written_otherwise(path: Path, whole: bytes) -> None:
    """Other blanks, another order of the keys, whole numbers: what counts is what it says."""
    header, shots = whole.split(b"\n", 1)
    content = {"schema": "zerobeam/run/1", **dict(reversed(CONTENT.items()))}
    path.write_bytes(json.dumps(content).encode() + b"\r\n" + shots)
    assert path.read_bytes().split(b"\r\n")[0] != header
    with RunJournal.resumed(path, HEADER) as journal:
        assert journal.shots == tuple(SHOTS)


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"", "empty"),
        (b" \n\n", "empty"),
        (b"mine\n", "not JSON"),
        (b'{"schema":"zerobeam/plan/1"}\n', "not a run file"),
        (b'HEADER{"shot":0,\nSHOT', "not JSON"),
        (b'HEADERSHOT{"shot":1}\n', "'joints_deg' is missing"),
        (b"HEADERSHOTSHOT", "duplicate"),
        (b"HEADERHEADER", "second header"),
    ],
)
def test_what_cannot_be_read_is_not_gone_on_with(
    path: Path, whole: bytes, refused: Refused, content: bytes, what: str
) -> None:
    header, shot = whole.splitlines(keepends=True)[:2]
    content = content.replace(b"HEADER", header).replace(b"SHOT", shot)
    path.write_bytes(content)
    assert what in refused(RunJournal.resumed, path, HEADER).what
    assert path.read_bytes() == content


def test_there_must_be_a_file_to_go_on_with(tmp_path: Path, path: Path, refused: Refused) -> None:
    for position, result in ((path, "no file of this name"), (tmp_path, "not a file")):
        error = refused(RunJournal.resumed, position, HEADER)
        assert error.found == result
        assert "without --resume" in str(error.remedy)
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_is_recorded_to_is_refused_until_it_is_closed(path: Path, refused: Refused) -> None:
    with RunJournal(path, HEADER) as journal:
        journal.append(SHOTS[0])
        error = refused(RunJournal.resumed, path, HEADER)
        assert error.what == "another process is recording to this file"
        journal.append(SHOTS[1])
    with RunJournal.resumed(path, HEADER) as journal:
        assert journal.shots == tuple(SHOTS[:2])
        refused(RunJournal.resumed, path, HEADER)


def test_a_file_that_was_refused_is_not_kept_from_others(path: Path, whole: bytes, refused: Refused) -> None:
    path.write_bytes(whole)
    refused(RunJournal.resumed, path, Header.model_validate({**CONTENT, "limits": "warn"}))
    RunJournal.resumed(path, HEADER).close()


RECORDING = f"""
import json, os, sys, time
from zerobeam.model.files.header import Header
from zerobeam.model.files.journal import RunJournal
from zerobeam.model.files.shot import Shot

HEADER = Header.model_validate(json.loads({json.dumps(json.dumps(CONTENT))}))

def made_shot(number):
    joints = tuple(value + number % 30 for value in {JOINTS})
    return Shot(shot=number, target="psd", joints_deg=joints, spot_mm=(0.5, -0.25 * number))

class Careless(RunJournal):
    "Keeps the shots in memory until the end."
    def append(self, shot):
        self._shots[shot.shot] = shot
"""

KILLED = """
import signal, warnings
warnings.simplefilter("ignore", DeprecationWarning)  # of a fork beside sleeping threads of numpy
kind = {"careful": RunJournal, "careless": Careless}[sys.argv[1]]
for path, begun, delay in json.loads(sys.argv[2]):
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        os.close(reader)
        with kind(path, HEADER) as journal:
            for number in range(10**9):
                journal.append(made_shot(number))
                os.write(writer, b".")
    os.close(writer)
    reported = len(os.read(reader, 1)) if begun else 0
    time.sleep(delay)
    os.kill(child, signal.SIGKILL)
    assert os.WIFSIGNALED(os.waitpid(child, 0)[1])
    with os.fdopen(reader, "rb") as pipe:
        print(reported + len(pipe.read()))
"""


def lost(path: Path, reported: int) -> int:
    """How many of the shots that were reported as recorded are not there when the file is resumed.

    The last one may be there without a report, as the process was killed between the two: -1.
    """
    if not path.exists():  # not begun
        return reported
    with RunJournal.resumed(path, HEADER) as journal:
        numbers = [shot.shot for shot in journal.shots]
        assert numbers == list(range(len(numbers)))
        assert len(numbers) <= reported + 1
        journal.append(made_shot(len(numbers)))
    assert len(read_run(path).shots) == len(numbers) + 1
    return reported - len(numbers)


def killed(folder: Path, kind: str, moments: list[tuple[bool, float]]) -> list[tuple[Path, int]]:
    """The files of processes that were killed while they recorded, with the shots that each had reported.

    A moment is a delay in seconds, from the first report on (True) or from the start of the process.
    """
    paths = [folder / f"{kind}{i}.jsonl" for i in range(len(moments))]
    jobs = json.dumps([(str(path), *moment) for path, moment in zip(paths, moments, strict=True)])
    command = [sys.executable, "-c", RECORDING + KILLED, kind, jobs]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return list(zip(paths, map(int, done.stdout.split()), strict=True))


@posix
@pytest.mark.usefixtures("robot_at_hand")
@pytest.mark.parametrize("kills", [8, pytest.param(40, marks=pytest.mark.long)])
def test_no_recorded_shot_is_lost_whenever_the_process_is_killed(tmp_path: Path, kills: int) -> None:
    rng = random.Random(20)
    moments = [(i % 2 == 0, rng.uniform(0, 0.04)) for i in range(kills)]
    files = killed(tmp_path, "careful", moments)
    assert sum(reported > 0 for _, reported in files) >= kills / 2
    for path, reported in files:
        assert lost(path, reported) in (0, -1), path
    # The control: what is kept in memory is missed.
    [(path, reported)] = killed(tmp_path, "careless", [(True, 0.0)])
    assert lost(path, reported) == reported > 0


def test_the_lock_goes_with_the_process_that_is_killed(path: Path, refused: Refused) -> None:
    lines = "journal = RunJournal(sys.argv[1], HEADER)\njournal.append(made_shot(0))\nprint(flush=True)\n"
    child = subprocess.Popen(
        [sys.executable, "-c", RECORDING + lines + "time.sleep(100)", str(path)], stdout=subprocess.PIPE
    )
    with child:
        try:
            assert child.stdout is not None
            assert child.stdout.readline() == b"\n"
            assert "another process" in refused(RunJournal.resumed, path, HEADER).what
        finally:
            child.kill()
    with RunJournal.resumed(path, HEADER) as journal:
        assert [shot.shot for shot in journal.shots] == [0]


def test_a_measurement_that_is_taken_out_leaves_all_others(path: Path) -> None:
    """Also from a file that was resumed; its number may be recorded anew."""
    with RunJournal(path, HEADER) as journal:
        for number in range(4):
            journal.append(made_shot(number))
        journal.withdraw(1)
        journal.append(made_shot(7))
    assert [shot.shot for shot in read_run(path).shots] == [0, 2, 3, 7]
    with RunJournal.resumed(path, HEADER) as journal:
        journal.withdraw(2)
        journal.append(made_shot(1))
        journal.withdraw(1)
        journal.append(made_shot(2))
        assert [shot.shot for shot in journal.shots] == [0, 3, 7, 2]
    assert list(read_run(path).shots) == [made_shot(number) for number in (0, 3, 7, 2)]
