import io
from pathlib import Path

import pytest

from zerobeam.experiments.rigs.manual.line_sources import TypedLines, WatchedLines
from zerobeam.model.errors import BadInput


def watched(path: Path, *steps) -> list[str]:
    """All lines that are heard while a writer takes `steps`, one whenever the file has nothing new."""
    left = list(steps)

    def wait(seconds: float) -> bool:
        if not left:
            return False
        left.pop(0)()
        return True

    lines, heard = WatchedLines(path, wait), []
    while (line := lines.following()) is not None:
        heard.append(line)
    return heard


def appended(path: Path, content: bytes):
    def write() -> None:
        with path.open("ab") as file:
            file.write(content)

    return write


def test_a_file_that_grows_in_pieces(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    pieces = [b"1 2 3\n4 ", b"5", b"", b" 6\r\n", b"7 8 9\n\n10"]
    heard = watched(path, *(appended(path, piece) for piece in pieces))
    assert heard == ["1 2 3", "4 5 6", "7 8 9", ""]  # the last line has no end yet


def test_a_file_that_is_not_there_yet_and_has_lines_before_the_watch(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    assert watched(path, lambda: None, lambda: path.write_text("a\n")) == ["a"]
    assert watched(path, appended(path, b"b\n")) == ["a", "b"]


def test_a_file_that_is_emptied_or_replaced_is_read_again(tmp_path: Path) -> None:
    path, other = tmp_path / "log.txt", tmp_path / "other.txt"
    path.write_text("a\nb\nhalf")
    other.write_text("c\nd\ne and more than before\n")
    assert watched(path, lambda: path.write_text("a\n")) == ["a", "b", "a"]
    path.write_text("a\nb\n")
    assert watched(path, lambda: other.replace(path)) == ["a", "b", "c", "d", "e and more than before"]


def test_bytes_that_are_no_text_lose_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    path.write_bytes(b"1 2\n\xff\xfe\x80\n\0\0\0003 4\n" + b"9" * 300_000)
    heard = watched(path, appended(path, b"\n5 6\n"))
    assert heard[0] == "1 2"
    assert heard[2] == "3 4"
    assert heard[-1] == "5 6"


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="no file to watch"):
        WatchedLines(tmp_path)


def test_typed_lines_end_with_the_stream() -> None:
    lines = TypedLines(io.StringIO("one\r\n\ntwo"))
    assert [lines.following() for _ in range(4)] == ["one", "", "two", None]
