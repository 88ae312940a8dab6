"""Links in a circle, pipes, folders that refer to themselves and media that cannot be written: refused in one
clear error, or read."""

import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from command_line import zerobeam
from histories import a_result, write_result
from recorded_logs import HEADER

IMPORTS = {
    "csv": ("--units", "deg", "--target", "a"),
    "points": ("--joint-columns", "1,2,3,4,5,6", "--joint-units", "deg"),
    "ros": ("--still-deg", "0.02", "--still-s", "0.5", "--target", "a"),
    "log ur": ("--still-deg", "0.02", "--still-s", "0.5", "--target", "a"),
    "rapid": ("--target", "a"),
    "krl": ("--target", "a"),
    "fanuc": ("--target", "a"),
    "val3": ("--target", "a"),
    "inform": ("--target", "a"),
}


@pytest.fixture
def asked(tmp_path: Path) -> list[object]:
    (tmp_path / "header.yaml").write_text(HEADER)
    return ["--header", tmp_path / "header.yaml", "-o", tmp_path / "run.jsonl"]


@pytest.mark.parametrize(("name", "words"), IMPORTS.items(), ids=IMPORTS)
def test_links_in_a_circle(name: str, words: tuple[str, ...], tmp_path: Path, asked: list[object]) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    first.symlink_to(second)
    second.symlink_to(first)
    told = zerobeam("import", *name.split(), first, *words, *asked).refused()
    assert str(first) in told
    told = zerobeam("import", *name.split(), first, second, *words, *asked, "--target", "b").refused()
    assert not (tmp_path / "run.jsonl").exists()


def test_links_in_a_circle_elsewhere(tmp_path: Path) -> None:
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    for words in (
        ("analyse", loop),
        ("report", loop, "-o", tmp_path / "out"),
        ("batch", loop, "-o", tmp_path / "out"),
        ("history", "add", loop, "--db", tmp_path / "history.sqlite"),
        ("history", "list", "--db", loop),
        ("history", "add", loop, "--db", loop),
        ("robot", loop),
    ):
        answer = zerobeam(*words)
        assert answer.status in (2, 3), words
        assert "fault of zerobeam" not in answer.err
        assert "Traceback" not in answer.err
        assert "error: " in answer.err


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes on this system")
def test_a_pipe_as_a_history_is_not_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    result = write_result(tmp_path / "result.json", a_result())
    for words in (("list",), ("show", "A-1"), ("drift",), ("add", result)):
        zerobeam("history", *words, "--db", pipe).refused()
    assert not (tmp_path / "b.sqlite").exists()


MERGED = "".join(
    [
        "x0: &x0 {a: 1}\n",
        *(f"x{i}: &x{i} {{<<: [{', '.join([f'*x{i - 1}'] * 20)}], k{i}: 1}}\n" for i in range(1, 7)),
    ]
)


def test_a_bag_that_refers_to_itself(tmp_path: Path, asked: list[object]) -> None:
    """Seven lines that merge each other twenty times stand for 64 million entries."""
    pytest.importorskip("rosbags")
    import numpy as np
    from ros_bags import Bag

    states = Bag("mcap").states(np.arange(4) / 10, np.zeros((4, 6)))
    bag = states.write(tmp_path)
    described = bag / "metadata.yaml"
    plain = described.read_text()
    words = ("--still-deg", "0.02", "--still-s", "0.2", "--target", "a")
    described.write_text(MERGED + plain)
    told = zerobeam("import", "ros", bag, *words, *asked).refused()
    for named in ("refers to parts of itself", "*x0", "metadata.yaml", "line 2"):
        assert named in told
    described.write_text(plain + "# " + "x" * 10**6)
    assert "metadata.yaml" in zerobeam("import", "ros", bag, *words, *asked).refused()
    described.write_text(plain)
    told = zerobeam("import", "ros", bag, *words, *asked)
    assert "refers to parts" not in told.err


@contextmanager
def as_nobody() -> Iterator[None]:
    """As a user who may not write everywhere."""
    if sys.platform == "win32" or os.geteuid() != 0:
        yield
        return
    import pwd

    user = pwd.getpwnam("nobody")
    os.setegid(user.pw_gid)
    os.seteuid(user.pw_uid)
    try:
        yield
    finally:
        os.seteuid(0)
        os.setegid(0)


def test_a_history_that_cannot_be_written_can_be_read(tmp_path: Path) -> None:
    result = write_result(tmp_path / "result.json", a_result("A-1", "2026-01-31"))
    other = write_result(tmp_path / "other" / "result.json", a_result("B-2", "2026-01-31"))
    with tempfile.TemporaryDirectory(prefix="zerobeam-read-only-") as name:
        folder = Path(name)
        db = folder / "history.sqlite"
        assert zerobeam("history", "add", result, "--db", db).status == 0
        texts = folder / "result.json"
        shutil.copy(other, texts)
        texts.chmod(0o444)
        db.chmod(0o444)
        folder.chmod(0o555)
        try:
            with as_nobody():
                if os.access(folder, os.W_OK, effective_ids=os.access in os.supports_effective_ids):
                    pytest.skip("this user may write everywhere")
                listed = zerobeam("history", "list", "--db", db)
                shown = zerobeam("history", "show", "A-1", "--db", db)
                added = zerobeam("history", "add", texts, "--db", db)
        finally:
            folder.chmod(0o755)
        assert (listed.status, listed.err) == (0, "")
        assert "A-1" in listed.out
        assert (shown.status, shown.err) == (0, "")
        assert "2026-01-31" in shown.out
        assert added.status != 0
        assert "cannot be written" in added.err
        assert "B-2" not in zerobeam("history", "list", "--db", db).out
