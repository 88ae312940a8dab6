"""Bags that stand for far more than their size: refused before it is in memory, and honest ones are read."""

from __future__ import annotations

import contextlib
import re
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from child import ZEROBEAM, child
from import_files import import_ros
from recorded_logs import HEADER, moves

from zerobeam.experiments.makers.generic.layouts import Stillness
from zerobeam.experiments.makers.generic.ros import topics_of
from zerobeam.experiments.makers.import_jobs import Imported
from zerobeam.model.errors import BadInput

pytest.importorskip("rosbags")

from ros_bags import Bag, file_of

from zerobeam.experiments.makers.generic import bags as unpacked

Read = Callable[[Path], Imported]
Refused = Callable[..., BadInput]
PACKED = [("ros1", "bz2"), ("ros1", "lz4"), ("mcap", "storage"), ("sqlite3", "message"), ("sqlite3", "file")]
MB = 10**6


@pytest.fixture
def read(tmp_path: Path, header: Path) -> Read:
    how: dict[str, Any] = {"still": Stillness(0.02, 0.5), "marker_topic": "/shot"}
    return lambda bag: import_ros([bag], [], header, tmp_path / "run.jsonl", **how)


@pytest.fixture
def packed_bag(tmp_path: Path, kind: str, packed: str) -> Callable[[str], Path]:
    """Makes a packed bag of an arm that moves, with a marker of that text."""
    return lambda text: Bag(kind).states(*moves()).marker(1.1, text).write(tmp_path, packed)


@pytest.mark.parametrize(("kind", "packed"), PACKED)
@pytest.mark.one_in(4)
def test_a_packed_bag_of_an_arm_that_rests_is_read(packed_bag: Callable[[str], Path], read: Read) -> None:
    bag = packed_bag("a")
    assert [shot.target for shot in read(bag).shots] == ["a"]
    assert [topic.name for topic in topics_of(bag)] == ["/joint_states", "/shot"]


@pytest.mark.parametrize(("kind", "packed"), PACKED)
@pytest.mark.long
def test_a_bag_that_stands_for_far_more_than_its_size_is_refused(
    packed_bag: Callable[[str], Path], read: Read, refused: Refused, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unpacked, "ALWAYS", 2 * MB)
    monkeypatch.setattr(unpacked, "RATIO", 20)
    bag = packed_bag("a" * 40 * MB)
    error = refused(read, bag)
    assert "too large for its size" in error.what
    assert error.allowed == "20 times the size of the bag, or 2 MB where that is more"
    assert error.file == str(bag)
    told = re.match(r"more than (\d+) MB", str(error.found))
    assert int(told[1]) <= 20 * unpacked.Unpacking(bag).packed / MB + 3  # type: ignore[index]


@pytest.mark.parametrize(("kind", "packed"), [("ros1", "bz2"), ("mcap", "storage"), ("sqlite3", "message")])
def test_what_is_in_memory_at_once_has_a_limit(
    packed_bag: Callable[[str], Path], read: Read, refused: Refused, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unpacked, "AT_ONCE", 2 * MB)
    error = refused(read, packed_bag("a" * 4 * MB))
    assert "take too much memory" in error.what
    assert error.allowed == "2 MB at once"


def test_chunks_whose_times_overlap_are_in_memory_together(
    tmp_path: Path, read: Read, refused: Refused, monkeypatch: pytest.MonkeyPatch
) -> None:
    times, joints = moves()
    bag = Bag("mcap").states(times, joints).marker(1.1, "a").write(tmp_path, "storage")
    (chunk,) = (part for part in _chunks(bag) if part.message_end_time > part.message_start_time)
    monkeypatch.setattr(unpacked, "AT_ONCE", chunk.uncompressed_size)
    unpacked.require_few_at_once(unpacked.Unpacking(bag), [_Reader([chunk])])
    error = refused(unpacked.require_few_at_once, unpacked.Unpacking(bag), [_Reader([chunk, chunk])])
    assert "chunks whose times overlap" in error.what


class _Reader:
    """Of the library: a reader with the storage of one file."""

    def __init__(self, chunks: list[object]) -> None:
        self.storage = self
        self.chunks = chunks


def _chunks(bag: Path) -> list[object]:
    from rosbags.rosbag2 import Reader

    with Reader(file_of(bag)) as reader:
        return list(reader.storage.chunks)


COMPUTED = {
    "view message_definitions": """
        ALTER TABLE message_definitions RENAME TO before;
        CREATE VIEW message_definitions AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)
        SELECT i AS id, 't' || i AS topic_type, 'ros2msg' AS encoding, hex(zeroblob(500000))
        AS encoded_message_definition, '' AS type_description_hash FROM n;""",
    "column messages.data": """
        CREATE TABLE other(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,
        data BLOB GENERATED ALWAYS AS (zeroblob(900000000)) VIRTUAL);
        INSERT INTO other(id, topic_id, timestamp) SELECT id, topic_id, timestamp FROM messages;
        DROP TABLE messages; ALTER TABLE other RENAME TO messages;""",
}


@pytest.mark.parametrize("packed", [None, "file"])
@pytest.mark.parametrize("computed", COMPUTED)
def test_a_database_that_computes_what_is_read_is_refused(
    tmp_path: Path, read: Read, refused: Refused, computed: str, packed: str | None
) -> None:
    bag = Bag("sqlite3").states(*moves()).marker(1.1, "a").write(tmp_path)
    with contextlib.closing(sqlite3.connect(file_of(bag))) as store:
        store.executescript(COMPUTED[computed])
    if packed == "file":
        _pack(bag)
    error = refused(read, bag)
    assert "computed when it is read" in error.what
    assert error.found == computed


def _pack(bag: Path) -> None:
    """The database as a packed file, as ROS 2 records it where it is asked to."""
    from rosbags.rosbag2 import reader

    store = file_of(bag)
    (bag / f"{store.name}.zstd").write_bytes(reader.zstd.compress(store.read_bytes()))
    store.unlink()
    about = bag / "metadata.yaml"
    text = about.read_text().replace(store.name, f"{store.name}.zstd")
    text = text.replace("compression_format: ''", "compression_format: zstd")
    about.write_text(text.replace("compression_mode: ''", "compression_mode: FILE"))


def test_a_bag_that_defines_joint_states_otherwise_is_refused(
    tmp_path: Path, read: Read, refused: Refused
) -> None:
    """A list of messages without fields is as long as its length says, from no bytes at all."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    kind = "sensor_msgs/msg/JointState"
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg("", "std_msgs/msg/Empty"))
    store.register(get_types_from_msg("string[] name\nstd_msgs/Empty[] position", kind))
    path = tmp_path / "log.bag"
    with Writer(path) as writer:
        connection = writer.add_connection("/joint_states", kind, typestore=store)
        writer.write(connection, 0, b"\0\0\0\0\xff\xff\xff\x0f")
    error = refused(read, path)
    assert error.what == f"the bag defines {kind} otherwise than ROS"
    assert (error.found, error.allowed) == ("name, position", "header, name, position, velocity, effort")


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="ulimit of POSIX")
@pytest.mark.parametrize(("kind", "packed"), PACKED)
def test_the_program_refuses_a_small_bag_in_less_memory_than_it_stands_for(
    tmp_path: Path, kind: str, packed: str
) -> None:
    folder = tmp_path / "made"
    folder.mkdir()
    script = (
        "import sys; from pathlib import Path; from ros_bags import Bag; from recorded_logs import moves\n"
        f"Bag({kind!r}).states(*moves()).marker(1.1, 'a' * 4 * 10**8).write(Path(sys.argv[1]), {packed!r})"
    )
    here = Path(__file__).parents[3] / "support"
    subprocess.run([sys.executable, "-c", script, folder], cwd=here, check=True)
    bag = next(path for path in folder.iterdir())
    (tmp_path / "header.yaml").write_text(HEADER)
    words = [
        "import",
        "ros",
        "--header",
        str(tmp_path / "header.yaml"),
        "--marker-topic",
        "/shot",
        "--still-deg=0.02",
    ]
    command = [*ZEROBEAM, *words, "--still-s=0.5", "-o", str(tmp_path / "run.jsonl"), str(bag)]
    measured = "import resource, subprocess, sys; ended = subprocess.run(sys.argv[1:]).returncode\n"
    measured += (
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss, file=sys.stderr); sys.exit(ended)"
    )
    with child([sys.executable, "-c", measured, *command], stderr=subprocess.PIPE) as process:
        err = process.communicate(timeout=250)[1]
    assert process.returncode == 2, err
    assert "too large for its size" in err or "too much memory" in err
    assert int(err.splitlines()[-1]) * 1024 < 400 * MB
