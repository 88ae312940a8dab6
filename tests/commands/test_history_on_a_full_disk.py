"""Histories on disks that are full or may not be written to: exit status 3, one message, nothing lost.

On file systems of their own (tmpfs), mounted for the test: whoever may not mount skips it.
"""

import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from command_line import Answer, zerobeam
from histories import a_result, write_result

from zerobeam.experiments.history.database import open_history
from zerobeam.experiments.history.store import results

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="tmpfs")


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Callable[[str], Path]]:
    """Mounts a file system of 1 MB, or mounts it again, with these options; its folder."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "none", folder], capture_output=True)
    if mounted.returncode:
        pytest.skip(f"no file system can be mounted: {mounted.stderr.decode().strip()}")

    def again(options: str) -> Path:
        subprocess.run(["mount", "-o", f"remount,{options}", folder], check=True)
        return folder

    yield again
    subprocess.run(["umount", "--lazy", folder], check=True)  # a connection may still be open


@pytest.fixture
def plant(tmp_path: Path, disk: Callable[[str], Path]) -> Path:
    """The disk with a history of one arm."""
    write_result(tmp_path / "in" / "result.json", a_result("A-1", "2025-01-31"))
    folder = disk("rw")
    assert zerobeam("history", "add", tmp_path / "in", "--db", folder / "history.sqlite").status == 0
    return folder


def fill(folder: Path) -> Path:
    """A file that leaves no room on its disk."""
    with (folder / "full").open("wb", buffering=0) as file:
        for size in (4096, 1):
            try:
                while True:
                    file.write(b"\0" * size)
            except OSError:
                pass
    return folder / "full"


def not_written(answer: Answer) -> str:
    assert (answer.status, answer.out, answer.err.count("error: ")) == (3, "", 1), answer
    assert "Traceback" not in answer.err
    assert "cannot be written" in answer.err
    return answer.err


def writing(plant: Path, more: Path) -> dict[str, Answer]:
    """The commands that write to a history or make one."""
    db = plant / "history.sqlite"
    event = ("--date", "2025-03-01", "--what", "motor", "--note", "x" * 10_000)
    return {
        "add": zerobeam("history", "add", more, "--db", db),
        "event": zerobeam("history", "event", "A-1", *event, "--db", db),
        "new": zerobeam("history", "add", more, "--db", plant / "new" / "history.sqlite"),
    }


def test_a_full_disk_is_no_bad_input(plant: Path, tmp_path: Path) -> None:
    db = plant / "history.sqlite"
    for number in range(40):
        write_result(
            tmp_path / "more" / f"{number}" / "result.json", a_result("A-1", f"20{26 + number}-01-31")
        )
    before = list(results(open_history(str(db))))
    full = fill(plant)
    for name, answer in writing(plant, tmp_path / "more").items():
        assert "full" in not_written(answer) or "No space" in answer.err, name
    full.unlink()
    assert list(results(open_history(str(db)))) == before
    assert not list(plant.glob(".zerobeam*"))


def test_a_disk_that_may_not_be_written_to_is_no_bad_input(
    plant: Path, tmp_path: Path, disk: Callable[[str], Path]
) -> None:
    db = plant / "history.sqlite"
    shutil.copyfile(db, plant / "copied.sqlite")
    write_result(tmp_path / "more" / "result.json", a_result("A-1", "2026-01-31"))
    disk("ro")
    for answer in writing(plant, tmp_path / "more").values():
        not_written(answer)
    for own in ("history.sqlite", "copied.sqlite"):
        listed = zerobeam("history", "list", "--db", plant / own)  # reading needs no writing
        assert (listed.status, "A-1" in listed.out) == (0, True), listed
    disk("rw")
    assert zerobeam("history", "list", "--db", db).status == 0
