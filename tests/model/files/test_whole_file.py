"""Files that are written whole or not at all, from text in pieces."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from zerobeam.interruption import stoppable
from zerobeam.model.files.whole_file import write_whole


def test_pieces_are_written_as_they_come(tmp_path: Path) -> None:
    file = tmp_path / "a.txt"

    def pieces() -> Iterator[str]:
        yield "δ"
        (aside,) = tmp_path.iterdir()
        assert aside.name.startswith(".a.txt.")
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
