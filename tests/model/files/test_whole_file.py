"""Files that are written whole or not at all, from text in pieces."""

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from child import child

from zerobeam.interruption import stoppable
from zerobeam.model.files.whole_file import is_part, write_whole


def test_pieces_are_written_as_they_come(tmp_path: Path) -> None:
    file = tmp_path / "a.txt"

    def pieces() -> Iterator[str]:
        yield "δ"
        (part,) = tmp_path.iterdir()
        assert part.name.startswith(".a.txt.")
        yield "2"

    write_whole(file, pieces())
    assert file.read_text(encoding="utf-8") == "δ2"
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("how", ["an error", "a request"])
def test_what_comes_between_two_pieces_leaves_no_file(tmp_path: Path, how: str) -> None:
    def pieces() -> Iterator[str]:
        yield "one"
        if how == "an error":
            raise ValueError("no more")
        os.kill(os.getpid(), signal.SIGINT)
        yield "two"
        raise AssertionError("the request came through")

    with stoppable(), pytest.raises(ValueError if how == "an error" else KeyboardInterrupt):
        write_whole(tmp_path / "a.txt", pieces())
    assert not list(tmp_path.iterdir())


WRITER = """
import sys, time
from pathlib import Path
from zerobeam.model.files.whole_file import write_whole

def pieces():
    yield "half"
    print("writing", flush=True)
    time.sleep(600)

write_whole(Path(sys.argv[1]), pieces())
"""


@pytest.mark.skipif(sys.platform == "win32", reason="whether another process lives is not asked there")
def test_what_a_killed_process_left_is_removed_and_what_another_one_writes_is_not(tmp_path: Path) -> None:
    command = [sys.executable, "-c", WRITER, str(tmp_path / "a.txt")]
    with child(command) as killed, child(command) as alive:
        for process in (killed, alive):
            assert process.stdout is not None
            assert process.stdout.readline() == "writing\n"
        killed.kill()
        killed.wait()
        write_whole(tmp_path / "b.txt", "two")  # of another name
        assert len(list(tmp_path.iterdir())) == 3
        write_whole(tmp_path / "a.txt", "one")
        (left,) = {path.name for path in tmp_path.iterdir()} - {"a.txt", "b.txt"}
        assert is_part(left)
        assert f"-{alive.pid}-" in left
