"""Bags are written by the library itself, as ROS would write them."""

from __future__ import annotations

import builtins
import contextlib
import re
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from child import ZEROBEAM, child
from import_files import import_joint_states, import_ros
from recorded_logs import HEADER, POSTURES, moves
from ros_bags import Bag, file_of

from zerobeam.experiments.makers.generic import ros as unpacked
from zerobeam.experiments.makers.generic.layouts import Stillness
from zerobeam.experiments.makers.generic.ros import topics_of
from zerobeam.experiments.makers.import_jobs import Imported
from zerobeam.model.errors import BadInput
from zerobeam.model.files.run import read_run, write_run

pytest.importorskip("rosbags")


KINDS = ["ros1", "sqlite3", "mcap"]
STILL = Stillness(0.02, 0.5)


def read(bag, header, tmp_path, targets=("a",), **options):
    return import_ros([bag], list(targets), header, tmp_path / "run.jsonl", still=STILL, **options)


@pytest.mark.parametrize("kind", KINDS)
def test_stands_of_a_real_bag_become_shots(tmp_path, header, kind):
    bag = Bag(kind).states(*moves()).write(tmp_path)
    found = read(bag, header, tmp_path)
    np.testing.assert_allclose([shot.joints_deg for shot in found.shots], POSTURES, atol=1e-9)
    assert [shot.target for shot in found.shots] == ["a"] * 4
    times = [shot.time_s for shot in found.shots]
    np.testing.assert_allclose(np.diff(times), 1.6, atol=0.02)
    told = "\n".join(found.understood)
    assert "joint states on /joint_states, in radians by definition of JointState" in told
    assert "joints by name, joint 1 first: joint1, joint2, joint3, joint4, joint5, joint6" in told
    assert "dwell 1: 0.5" in told
    assert "every dwell is a measurement" in told
    write_run(tmp_path / "run.jsonl", found.header, found.shots)
    assert len(read_run(tmp_path / "run.jsonl").shots) == 4


@pytest.mark.parametrize("kind", ["sqlite3", "mcap"])
def test_the_file_of_a_bag_without_its_folder(tmp_path, header, kind):
    bag = file_of(Bag(kind).states(*moves()).write(tmp_path))
    assert bag.suffix == {"sqlite3": ".db3", "mcap": ".mcap"}[kind]
    assert len(read(bag, header, tmp_path).shots) == 4


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.one_in(3)
def test_joints_are_taken_by_name_in_the_stated_order(tmp_path, header, kind, refused):
    order = [3, 0, 5, 1, 4, 2]
    times, joints = moves()
    names = [f"arm_{i}" for i in order]
    bag = Bag(kind).states(times, joints[:, order], names)
    bag.states(times[::7] + 1e-4, np.zeros((len(times[::7]), 1)), ["gripper"])
    path = bag.write(tmp_path)
    columns = [f"arm_{i}" for i in range(6)]
    found = read(path, header, tmp_path, columns=columns)
    np.testing.assert_allclose([shot.joints_deg for shot in found.shots], POSTURES, atol=1e-9)
    error = refused(read, path, header, tmp_path)
    assert "have no joint 'joint1'" in error.what
    assert "arm_3" in error.found
    error = refused(read, path, header, tmp_path, columns=[*columns[:5], "arm_55"])
    assert "did you mean 'arm_5'?" in error.remedy
    assert "one name is required" in refused(read, path, header, tmp_path, columns=columns[:5]).what


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.one_in(3)
def test_markers_choose_the_stands_and_name_the_targets(tmp_path, header, kind, refused):
    times, joints = moves()
    bag = Bag(kind).states(times, joints).marker(1.1, "left").marker(4.3, "right").marker(4.4, "right")
    found = read(bag.write(tmp_path), header, tmp_path, targets=(), marker_topic="/shot")
    assert [shot.target for shot in found.shots] == ["left", "right"]
    np.testing.assert_allclose([s.joints_deg for s in found.shots], POSTURES[[0, 2]], atol=1e-9)
    told = "\n".join(found.understood)
    assert "dwells without a marker, not imported: 2" in told
    assert "second and later markers in a dwell: 1; each dwell is one measurement" in told
    assert "measurements at markers on /shot" in told
    again = tmp_path / "again"
    again.mkdir()
    bag.marker(4.5, "left")
    error = refused(read, bag.write(again), header, tmp_path, targets=(), marker_topic="/shot")
    assert "different targets" in error.what


def test_markers_without_text_want_a_target(tmp_path, header, refused):
    bag = Bag("mcap").states(*moves()).marker(1.1).write(tmp_path)
    assert [shot.target for shot in read(bag, header, tmp_path, marker_topic="/shot").shots] == ["a"]
    error = refused(read, bag, header, tmp_path, targets=(), marker_topic="/shot")
    assert "do not name a target" in error.what
    assert "one target name" in refused(read, bag, header, tmp_path, targets=()).what
    error = refused(read, bag, header, tmp_path, marker_topic="/shots")
    assert error.remedy == "did you mean '/shot'?"


def test_a_marker_while_the_arm_moves(tmp_path, header, refused):
    bag = Bag("ros1").states(*moves(stand_s=1.0, move_s=2.0)).marker(4.0, "a").write(tmp_path)
    error = refused(read, bag, header, tmp_path, targets=(), marker_topic="/shot")
    assert "did not dwell at a marker" in error.what
    assert "marker at 4.000 s; nearest dwell" in error.found


def test_topics_must_be_plain(tmp_path, header, refused):
    times, joints = moves()
    bag = Bag("mcap").states(times, joints).states(times, joints, topic="/other/joint_states").marker(1.0)
    path = bag.write(tmp_path)
    error = refused(read, path, header, tmp_path)
    assert "several topics" in error.what
    assert error.found == "/joint_states, /other/joint_states"
    assert len(read(path, header, tmp_path, topic="/joint_states").shots) == 4
    assert "no joint states" in refused(read, path, header, tmp_path, topic="/shot").what
    error = refused(read, path, header, tmp_path, topic="/joint_state")
    assert error.remedy == "did you mean '/joint_states'?"
    none = tmp_path / "none"
    none.mkdir()
    bare = Bag("mcap").marker(1.0).write(none)
    assert "no joint states" in refused(read, bare, header, tmp_path).what
    assert "no such file" in refused(read, tmp_path / "x.bag", header, tmp_path).what


def test_positions_that_are_no_numbers_and_values_beyond_the_limits(tmp_path, header, refused):
    times, joints = moves()
    joints[50, 2] = np.nan
    error = refused(read, Bag("ros1").states(times, joints).write(tmp_path), header, tmp_path)
    assert "position of joint 'joint3' is not a finite number" in error.what
    assert "joint3 nan" in error.found
    (tmp_path / "log.bag").unlink()
    times, joints = moves(np.degrees(POSTURES))  # a driver that publishes degrees
    error = refused(read, Bag("ros1").states(times, joints).write(tmp_path), header, tmp_path)
    assert "outside its limits" in error.what
    assert "radians?" in error.remedy


@pytest.mark.parametrize("kind", KINDS)
def test_a_torn_or_corrupted_bag_gives_one_message(tmp_path, header, kind, refused):
    path = file_of(Bag(kind).states(*moves(rate=50)).write(tmp_path))
    whole = path.read_bytes()
    assert len(read(path, header, tmp_path).shots) == 4
    for share in (0.02, 0.3, 0.6, 0.9, 0.999):
        path.write_bytes(whole[: int(len(whole) * share)])
        error = refused(read, path, header, tmp_path)
        assert "cannot be read" in error.what or "incomplete" in error.what, error
        assert error.file == str(path)
    path.write_bytes(np.random.default_rng(0).bytes(5000))
    assert "cannot be read" in refused(read, path, header, tmp_path).what
    path.write_bytes(b"")
    assert "cannot be read" in refused(read, path, header, tmp_path).what


def test_a_bag_with_fewer_messages_than_it_says(tmp_path, header, refused):
    path = Bag("sqlite3").states(*moves()).write(tmp_path)
    with contextlib.closing(sqlite3.connect(file_of(path))) as store:
        (count,) = store.execute("SELECT COUNT(*) FROM messages").fetchone()
        store.execute("DELETE FROM messages WHERE id % 50 = 0")
        store.commit()
    error = refused(read, path, header, tmp_path)
    assert "incomplete" in error.what
    assert error.allowed == f"{count}, as the bag itself says"


def test_without_the_library_one_message_says_what_to_install(tmp_path, header, refused, monkeypatch):
    bag = Bag("mcap").states(*moves()).write(tmp_path)
    real = builtins.__import__

    def missing(name, *args, **kwargs):
        if name.startswith("rosbags"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", missing)
    assert refused(read, bag, header, tmp_path).remedy == 'pip install "zerobeam[ros]"'


pytest.importorskip("rosbags")


Read = Callable[[Path], Imported]
Refused = Callable[..., BadInput]
PACKED = [("ros1", "bz2"), ("ros1", "lz4"), ("mcap", "storage"), ("sqlite3", "message"), ("sqlite3", "file")]
MB = 10**6


@pytest.fixture
def read_bag(tmp_path: Path, header: Path) -> Read:
    how: dict[str, Any] = {"still": Stillness(0.02, 0.5), "marker_topic": "/shot"}
    return lambda bag: import_ros([bag], [], header, tmp_path / "run.jsonl", **how)


@pytest.fixture
def packed_bag(tmp_path: Path, kind: str, packed: str) -> Callable[[str], Path]:
    """Makes a packed bag of an arm that moves, with a marker of that text."""
    return lambda text: Bag(kind).states(*moves()).marker(1.1, text).write(tmp_path, packed)


@pytest.mark.parametrize(("kind", "packed"), PACKED)
@pytest.mark.one_in(4)
def test_a_packed_bag_of_an_arm_that_rests_is_read(packed_bag: Callable[[str], Path], read_bag: Read) -> None:
    bag = packed_bag("a")
    assert [shot.target for shot in read_bag(bag).shots] == ["a"]
    assert [topic.name for topic in topics_of(bag)] == ["/joint_states", "/shot"]


@pytest.mark.parametrize(("kind", "packed"), PACKED)
@pytest.mark.long
def test_a_bag_that_stands_for_far_more_than_its_size_is_refused(
    packed_bag: Callable[[str], Path], read_bag: Read, refused: Refused, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unpacked, "ALWAYS", 2 * MB)
    monkeypatch.setattr(unpacked, "RATIO", 20)
    bag = packed_bag("a" * 40 * MB)
    error = refused(read_bag, bag)
    assert "too large for its size" in error.what
    assert error.allowed == "20 times the size of the bag, or 2 MB where that is more"
    assert error.file == str(bag)
    told = re.match(r"more than (\d+) MB", str(error.found))
    assert int(told[1]) <= 20 * unpacked.Unpacking(bag).packed / MB + 3  # type: ignore[index]


@pytest.mark.parametrize(("kind", "packed"), [("ros1", "bz2"), ("mcap", "storage"), ("sqlite3", "message")])
def test_what_is_in_memory_at_once_has_a_limit(
    packed_bag: Callable[[str], Path], read_bag: Read, refused: Refused, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unpacked, "AT_ONCE", 2 * MB)
    error = refused(read_bag, packed_bag("a" * 4 * MB))
    assert "take too much memory" in error.what
    assert error.allowed == "2 MB at once"


def test_chunks_whose_times_overlap_are_in_memory_together(
    tmp_path: Path, read_bag: Read, refused: Refused, monkeypatch: pytest.MonkeyPatch
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
    tmp_path: Path, read_bag: Read, refused: Refused, computed: str, packed: str | None
) -> None:
    bag = Bag("sqlite3").states(*moves()).marker(1.1, "a").write(tmp_path)
    with contextlib.closing(sqlite3.connect(file_of(bag))) as store:
        store.executescript(COMPUTED[computed])
    if packed == "file":
        _pack(bag)
    error = refused(read_bag, bag)
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
    tmp_path: Path, read_bag: Read, refused: Refused
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
    error = refused(read_bag, path)
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


NAMES = ["joint6", "joint1", "joint2", "joint3", "joint4", "joint5", "gripper"]


def message(row, names=NAMES, inline=False):
    values = np.radians([row[5], *row[:5], 0.0])
    if inline:
        joints = f"name: [{', '.join(names)}]\nposition: [{', '.join(map(repr, values.tolist()))}]\n"
    else:
        joints = "name:\n" + "".join(f"- '{name}'\n" for name in names)
        joints += "position:\n" + "".join(f"  - {value!r}\n" for value in values.tolist())
    return f"header:\n  stamp:\n    sec: 1\n  frame_id: ''\n{joints}velocity: []\neffort:\n- .nan\n---\n"


@pytest.fixture
def read_states(tmp_path, header):
    def call(text, columns=None):
        file = tmp_path / "recorded.yaml"
        file.write_text(text)
        return import_joint_states([file], ["a"], header, tmp_path / "run.jsonl", columns=columns)

    return call


@pytest.mark.parametrize("inline", [False, True])
def test_each_message_is_a_measurement(read_states, inline):
    found = read_states("".join(message(row, inline=inline) for row in POSTURES))
    np.testing.assert_allclose([shot.joints_deg for shot in found.shots], POSTURES, atol=1e-9)
    own = [f"arm_{name}" for name in NAMES]
    columns = [f"arm_joint{i}=joint{i}" for i in (2, 1, 3, 4, 5, 6)]
    found = read_states("".join(message(row, own, inline) for row in POSTURES).removesuffix("---\n"), columns)
    np.testing.assert_allclose([shot.joints_deg for shot in found.shots], POSTURES, atol=1e-9)


def test_texts_that_are_refused(read_states, refused):
    good = message(POSTURES[0])
    assert refused(read_states, "---\n").what == "no measurements found: the file has no joint states"
    error = refused(read_states, good + good.replace("'joint3'", "'elbow'"))
    assert error.what == "the message has no joint 'joint3'"
    assert error.line == 25
    value = repr(float(np.radians(POSTURES[0][0])))
    assert "'joint1' is not a finite number" in refused(read_states, good.replace(value, ".nan")).what
    assert refused(read_states, good.replace("position:", "positions:")).what == (
        "a message has no names or no positions"
    )
    none = good.split("position:\n")[0] + "position: []\n"
    assert refused(read_states, none).what == "the message has no joint 'joint1'"
