"""ROS: sensor_msgs/JointState in bags, whose unpacking is bounded, and in text, as `ros2 topic echo` prints
them.

In text each message is a measurement: documents of YAML with lists of `name` and `position`; other keys are
not looked at, since a driver may well print an effort of .nan. By definition of JointState positions are
radians, metres where the joint slides.
"""

from __future__ import annotations

import bz2
import math
import re
import sqlite3
from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Any, cast

import numpy as np
from ruamel.yaml import YAML, AliasToken
from ruamel.yaml.error import YAMLError

from ....model.arrays import Matrix
from ....model.errors import BadInput, located, missing_extra
from ....model.files.joint_values import JointColumns
from ....model.files.text_tables import number
from ....model.kinematics.robot import Robot
from ....model.parsing.reading import did_you_mean, read_text, require_regular, unknown_name
from ....model.records import it, record
from ..import_jobs import FileMeasurements, Imported, ImportJob
from .joint_logs import JointLog, Mark
from .layouts import Stillness

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Connection

# Bags of ROS, opened within bounds: a few kilobytes can stand for gigabytes.
#
# The library rosbags has no limit, and unpacks each chunk into memory whole. As long as a bag is open its
# functions for that are replaced by bounded ones.

RATIO = 200  # of all that is unpacked to the bag's own size; joint states of an arm at rest reach 60
ALWAYS = 64 * 10**6  # bytes that may be unpacked whatever the ratio
AT_ONCE = 256 * 10**6  # bytes in memory at once: a chunk, a message, chunks whose times overlap
_STEP = 2**20  # bytes
_LONGEST_DEFAULT = 1000  # characters, of a column in a .db3


class Unpacking:
    """Counts what is unpacked of the bag at `path`; BadInput beyond the limits."""

    def __init__(self, path: Path) -> None:
        files = path.iterdir() if path.is_dir() else (path,)
        self.packed = sum(file.stat().st_size for file in files)
        self.total = 0

    def count(self, size: int) -> None:
        """So many bytes more are unpacked."""
        self.total += size
        if self.total > max(ALWAYS, RATIO * self.packed):
            raise BadInput(
                "the bag is not unpacked: what it stands for is too large for its size",
                found=f"more than {self.total // 10**6} MB, of {self.packed:,} bytes",
                allowed=f"{RATIO} times the size of the bag, or {ALWAYS // 10**6} MB where that is more",
                remedy="keep the topic of the joint states alone (rosbag filter, ros2 bag convert)",
            )

    def require_at_once(self, size: int, what: str) -> None:
        """BadInput where `size` bytes are more than may be in memory at once."""
        if size > AT_ONCE:
            raise BadInput(
                f"the bag is not unpacked: {what} would take too much memory",
                found=f"more than {AT_ONCE // 10**6} MB",
                allowed=f"{AT_ONCE // 10**6} MB at once",
                remedy="record in smaller chunks, or keep the topic of the joint states alone",
            )

    def whole(self, data: bytes, decompressor: Callable[[], Any]) -> bytes:
        """A chunk or a message unpacked by bz2, lz4 or zstd: one stream of data or several."""
        parts: list[bytes] = []
        size = 0
        while data:
            stream = decompressor()
            while not stream.eof:
                part = stream.decompress(data, _STEP)
                data = b""
                if not part and not stream.eof and stream.needs_input:
                    raise EOFError("compressed data end before their end mark")
                size += len(part)
                self.count(len(part))
                self.require_at_once(size, "a chunk")
                parts.append(part)
            data = stream.unused_data or b""
        return b"".join(parts)


@contextmanager
def bounded(path: Path) -> Iterator[Unpacking]:
    """Within, the library unpacks no more of the bag at `path` than the limits allow."""
    import lz4.frame
    from rosbags.rosbag1 import reader as ros1
    from rosbags.rosbag2 import reader as ros2
    from rosbags.rosbag2 import storage_mcap as mcap
    from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

    unpacking = Unpacking(path)
    zstd: Any = vars(ros2)["zstd"]
    open_database = Sqlite3Reader.open

    def by(decompressor: Callable[[], Any]) -> Callable[..., bytes]:
        return lambda data, *_: unpacking.whole(data, decompressor)

    def open_plain_tables(reader: Any) -> None:
        require_plain_tables(Path(reader.path))
        open_database(reader)

    of_lz4, of_zstd = by(lz4.frame.LZ4FrameDecompressor), by(zstd.ZstdDecompressor)
    module = SimpleNamespace(decompress=of_zstd, open=partial(_counted_file, unpacking, zstd.open))
    replacements: list[tuple[dict[str, Any], str, Any]] = [
        (cast(Any, ros1.decompressors), "bz2", by(bz2.BZ2Decompressor)),
        (cast(Any, ros1.decompressors), "lz4", of_lz4),
        (cast(Any, mcap.DECOMPRESSORS), "lz4", of_lz4),
        (cast(Any, mcap.DECOMPRESSORS), "zstd", of_zstd),
        (vars(ros2), "zstd", module),
    ]
    with ExitStack() as replaced:
        for owner, name, bounded_one in replacements:
            replaced.callback(owner.__setitem__, name, owner[name])
            owner[name] = bounded_one
        replaced.callback(setattr, Sqlite3Reader, "open", open_database)
        setattr(Sqlite3Reader, "open", open_plain_tables)  # noqa: B010
        yield unpacking


def _counted_file(unpacking: Unpacking, opened: Callable[..., Any], file: Any, mode: str) -> Any:
    """A packed file to read from, of which everything that is read counts."""
    unpacked = opened(file, mode)
    read = unpacked.read

    def counted(size: int = -1) -> bytes:
        part: bytes = read(size)
        unpacking.count(len(part))
        return part

    unpacked.read = counted
    return unpacked


def require_few_at_once(unpacking: Unpacking, readers: Iterable[Any]) -> None:
    """BadInput where chunks of an mcap file whose times overlap, which are in memory together, are too large.

    The library merges the messages of several chunks by their times.
    """
    for reader in readers:
        storage = getattr(reader, "storage", None)
        for part in getattr(storage, "storages", [storage]):
            chunks = getattr(part, "chunks", [])
            starts = [(chunk.message_start_time, 0, chunk.uncompressed_size) for chunk in chunks]
            ends = [(chunk.message_end_time, 1, -chunk.uncompressed_size) for chunk in chunks]
            held = 0
            for _, _, size in sorted(starts + ends):
                held += size
                unpacking.require_at_once(held, "chunks whose times overlap")


def require_plain_tables(path: Path) -> None:
    """BadInput for a .db3 that holds more than stored values: what is computed at reading has no end."""
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?immutable=1", uri=True)) as store:
        parts = store.execute("SELECT type, name, sql FROM sqlite_master").fetchall()
        computed = [
            f"{kind} {name}"
            for kind, name, sql in parts
            if kind == "view" or str(sql).lstrip().upper().startswith("CREATE VIRTUAL")
        ]
        for kind, table, _ in parts:
            if kind == "table" and not computed:
                query = "SELECT name, hidden, length(dflt_value) FROM pragma_table_xinfo(?)"
                for column, hidden, default in store.execute(query, (table,)):
                    if hidden or (default or 0) > _LONGEST_DEFAULT:
                        computed.append(f"column {table}.{column}")
    if computed:
        raise BadInput(
            "the bag has values that are computed when it is read; no recorder writes them",
            found=computed[0][:100],
            allowed="tables of stored values",
            remedy="convert the bag with the tools of ROS (ros2 bag convert), or record again",
            file=path,
        )


JOINT_STATE = "sensor_msgs/msg/JointState"
TEXT = "std_msgs/msg/String"
_READ = (JOINT_STATE, "std_msgs/msg/Header", "builtin_interfaces/msg/Time", TEXT)
_LARGEST_METADATA = 10**6  # bytes
_LARGEST_MESSAGE = 10**6  # bytes, of what is read: a JointState of six joints has 300
_MAGIC = {b"#ROSBAG": "a ROS 1 bag", b"\x89MCAP0": "an mcap file", b"SQLite format 3": "a .db3 of ROS 2"}


def is_bag(path: Path) -> str | None:
    """The kind of bag that a file is by its first bytes, None if it is none."""
    require_regular(path)
    with path.open("rb") as file:
        head = file.read(16)
    return next((kind for magic, kind in _MAGIC.items() if head.startswith(magic)), None)


@dataclass(frozen=True)
class Bag:
    """An open bag."""

    reader: AnyReader
    unpacking: Unpacking

    def messages(self, connections: list[Connection]) -> Iterator[tuple[int, Any]]:
        """(ns, message) in the order of recording; BadInput if there are fewer than the bag says.

        A message is decoded where it is a JointState or a String; None else.
        """
        self.unpacking.total = 0  # of each pass
        count = 0
        for connection, stamp, raw in self.reader.messages(connections=connections):
            count += 1
            yield stamp, self._decoded(connection, raw)
        promised = sum(connection.msgcount for connection in connections)
        if count != promised:
            raise BadInput(
                "the bag is incomplete",
                found=f"{count} messages on {connections[0].topic}",
                allowed=f"{promised}, as the bag itself says",
                remedy="repair it with the tools of ROS, or record again",
            )

    def first(self, topic: str) -> Any:
        """The first message on a topic, None where there is none."""
        connections = [c for c in self.reader.connections if c.topic == topic]
        for connection, _, raw in self.reader.messages(connections=connections):
            return self._decoded(connection, raw)
        return None

    def _decoded(self, connection: Connection, raw: bytes) -> Any:
        if connection.msgtype not in (JOINT_STATE, TEXT):
            return None
        if len(raw) > _LARGEST_MESSAGE:
            raise BadInput(
                f"a message on {connection.topic} is too large",
                found=f"{len(raw) / 10**6:.1f} MB",
                allowed=f"{_LARGEST_MESSAGE // 10**6} MB",
            )
        return self.reader.deserialize(raw, connection.msgtype)


@contextmanager
def opened(path: Path) -> Iterator[Bag]:
    """The bag at `path`; BadInput where it cannot be read, or would take too much memory (`unpacked`).

    A BadInput that is raised within names the bag."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise missing_extra("reading ROS bags", "ros", needed="the library rosbags") from None
    _require_plain_metadata(path)
    try:
        # Older ROS 2 bags hold no definitions; those of JointState and std_msgs are the same in all of them.
        ros2 = get_typestore(Stores.LATEST)
        with bounded(path) as unpacking, AnyReader([path], default_typestore=ros2) as reader:
            ros = ros2 if reader.is2 else get_typestore(Stores.ROS1_NOETIC)
            _require_definitions(reader.typestore, ros)
            require_few_at_once(unpacking, reader.readers)
            yield Bag(reader, unpacking)
    except BadInput as error:
        raise error.at(path, None) from None
    except Exception as error:  # noqa: BLE001 - the library lets through what its parsers meet in a torn file
        raise BadInput(
            "the bag cannot be read: it is incomplete, corrupted or not a bag",
            found=" ".join(str(error).split()) or type(error).__name__,
            allowed="a ROS 1 .bag, a ROS 2 bag folder, .mcap or .db3",
            remedy="repair it with the tools of ROS (rosbag reindex, ros2 bag reindex, mcap recover)",
            file=path,
        ) from None


def _require_plain_metadata(path: Path) -> None:
    """BadInput where the description of a bag's folder is too large, or refers to parts of itself: a few
    lines of that grow without bound when they are read."""
    file = path / "metadata.yaml"
    if not path.is_dir() or not file.exists():
        return
    text, _ = read_text(file, _LARGEST_METADATA)
    try:
        for token in YAML(typ="safe", pure=True).scan(text):
            if isinstance(token, AliasToken):
                raise BadInput(
                    "the description of the bag refers to parts of itself; no recorder writes that",
                    found=f"*{token.value}",
                    remedy="take the metadata.yaml that was recorded, or make one: ros2 bag reindex",
                    file=file,
                    line=token.start_mark.line + 1,
                )
    except YAMLError as error:
        raise BadInput("the description of the bag is no YAML", found=str(error)[:100], file=file) from None


def _require_definitions(in_bag: Any, in_ros: Any) -> None:
    """BadInput where the bag defines a type that is decoded, and not as ROS does."""
    for name in _READ:
        fields = in_bag.fielddefs.get(name, in_ros.fielddefs[name])[1]
        if [tuple(field) for field in fields] != [tuple(field) for field in in_ros.fielddefs[name][1]]:
            raise BadInput(
                f"the bag defines {name} otherwise than ROS",
                found=", ".join(str(field[0]) for field in fields)[:100],
                allowed=", ".join(str(field[0]) for field in in_ros.fielddefs[name][1]),
                remedy="record the joint states as sensor_msgs/JointState",
            )


_NO_TOPIC = "there is no topic of this name"
_KEY = re.compile(r"(?P<key>[A-Za-z_]\w*)\s*:\s*(?P<inline>\[.*\])?\s*$")
_ITEM = re.compile(r"\s*-\s+(?P<value>.+?)\s*$")
_QUOTED = re.compile(r"^(['\"])(.*)\1$")


def import_joint_states(job: ImportJob, *, columns: Sequence[str] | None = None) -> Imported:
    """Measurements from texts of joint states, one for each message, in their order.

    `columns` are the names of joint 1, 2, … in the messages, by default the robot's own. BadInput, with file
    and line, for a message without one of the joints, or with a position that is no number.
    """
    joints = _joints_by_name(job.robot, columns)

    def read(path: Path, target: str | None) -> FileMeasurements:
        rows, lines = _rows(path, joints)
        return FileMeasurements(path, "message", joints.joints(rows), {"target": [target] * len(rows)}, lines)

    note = "joint states as ros2 topic echo prints them, each message a measurement, in radians by definition"
    return job.measured(read, [note, _by_name(joints)])


def _joints_by_name(robot: Robot, columns: Sequence[str] | None) -> JointColumns:
    """The names of joint 1, 2, … in messages, whose positions are radians or metres."""
    names = columns or [joint.name for joint in robot.joints]
    return JointColumns.of_options(robot, names, "rad", lengths="m", j3="link", noun="name")


def _by_name(joints: JointColumns) -> str:
    return f"joints by name, joint 1 first: {', '.join(joints.names or ())}"


def _rows(path: Path, joints: JointColumns) -> tuple[Matrix, list[int]]:
    """(N, n) positions of each message, and the line where it begins."""
    rows, lines = [], []
    for line, message in messages(read_text(path)[0]):
        with located(path, line):
            if not {"name", "position"} <= message.keys():
                raise BadInput(
                    "a message has no names or no positions",
                    found=", ".join(message) or "none of the keys of a JointState",
                    allowed="name and position, as ros2 topic echo /joint_states prints them",
                )
            rows.append(_positions("the message has", joints, message["name"], message["position"]))
        lines.append(line)
    if not rows:
        raise BadInput("no measurements found: the file has no joint states")
    return np.array(rows), lines


def _positions(
    where: str, joints: JointColumns, names: Sequence[str], positions: Sequence[str | float]
) -> list[float]:
    """Positions of a message in the order of the joints."""
    position = dict(zip(names, positions, strict=False))
    values = []
    for name in joints.names or ():
        if name not in position:
            raise _no_joints(where, joints, list(position))
        text = position[name]
        value = number(text) if isinstance(text, str) else float(text)
        if value is None or not math.isfinite(value):
            raise BadInput(
                f"the position of joint {name!r} is not a finite number",
                found=f"{name} {text}",
                allowed="a finite number for each joint",
            )
        values.append(value)
    return values


def _no_joints(where: str, joints: JointColumns, there: Sequence[str]) -> BadInput:
    names = joints.names or ()
    missing = next(name for name in names if name not in there)
    return BadInput(
        f"{where} no joint {missing!r}",
        found=", ".join(there) or "no joints",
        allowed=", ".join(names),
        remedy=did_you_mean(missing, there) or "state the names of joint 1, 2, … (--columns)",
    )


def messages(text: str) -> list[tuple[int, dict[str, list[str]]]]:
    """The lists at the top of each document, and the line where the document begins."""
    documents: list[tuple[int, dict[str, list[str]]]] = []
    document: dict[str, list[str]] = {}
    first_line, items = 0, None
    for line, content in enumerate([*text.split("\n"), "---"], start=1):
        if content.startswith("---"):
            if first_line:
                documents.append((first_line, document))
            document, first_line, items = {}, 0, None
            continue
        if not content.strip() or content.lstrip().startswith("#"):
            continue
        first_line = first_line or line
        key, item = _KEY.fullmatch(content), _ITEM.fullmatch(content)
        if key is not None:
            items = document.setdefault(key["key"], [])
            inline = (key["inline"] or "[]")[1:-1]
            items += [_bare(part) for part in inline.split(",") if part.strip()]
        elif item is not None and items is not None:
            items.append(_bare(item["value"]))
        else:
            items = None
    return documents


def _bare(text: str) -> str:
    quoted = _QUOTED.fullmatch(text.strip())
    return text.strip() if quoted is None else quoted[2]


def import_ros(
    job: ImportJob,
    *,
    still: Stillness,
    columns: Sequence[str] | None = None,
    topic: str | None = None,
    marker_topic: str | None = None,
) -> Imported:
    """Measurements from bags: at each dwell, or at those that a message on `marker_topic` marks.

    `columns` are the names of joint 1, 2, … in the messages, by default the robot's own. `topic` is
    required if several have joint states. A marker of text (std_msgs/String) names the target,
    unless the job names one for each file. Times are those at which the messages were recorded.
    """
    joints = _joints_by_name(job.robot, columns)
    slides = any(joint.kind == "prismatic" for joint in job.robot.joints)

    def read(path: Path, target: str | None) -> FileMeasurements:
        log, chosen = _read(path, joints, topic, marker_topic)
        how = f"  joint states on {chosen}, in radians by definition of JointState"
        how += "; prismatic joints in metres" if slides else ""
        return log.measurements(job.robot, still, target, [how])

    by = "every dwell is a measurement"
    if marker_topic is not None:
        by = f"measurements at markers on {marker_topic}"
    named = bool(job.names) or marker_topic is None or job.plan is not None
    return job.measured(read, [_by_name(joints), by], named=named)


@record
class Topic:
    """A topic of a bag, its number of messages, and the joints in the first of its joint states (empty for
    other messages)."""

    name: str
    type: str
    messages: int
    joints: Annotated[tuple[str, ...], it("in the first of its joint states")]


def topics_of(path: Path) -> tuple[Topic, ...]:
    """The topics of a bag, by name."""
    with opened(path) as bag:
        topics = []
        for name in sorted(bag.reader.topics):
            topic = bag.reader.topics[name]
            first = bag.first(name) if topic.msgtype == JOINT_STATE else None
            joints = () if first is None else tuple(first.name)
            topics.append(Topic(name, str(topic.msgtype), topic.msgcount, joints))
        return tuple(topics)


def _read(
    path: Path, joints: JointColumns, topic: str | None, marker_topic: str | None
) -> tuple[JointLog, str]:
    """The log of a bag, and the topic that it was read from."""
    if not path.exists():
        raise BadInput("there is no such file", file=path, remedy="name a .bag, .mcap, .db3 or folder")
    for file in path.iterdir() if path.is_dir() else (path,):
        require_regular(file)
    with opened(path) as bag:
        reader = bag.reader
        states = [c for c in reader.connections if c.msgtype == JOINT_STATE]
        chosen = _topic(states, topic, reader)
        where = f"the messages on {chosen} have"
        names = set(joints.names or ())
        stamps, positions = array("q"), array("d")  # not lists of lists: recordings are long
        joint_names_read: dict[str, None] = {}
        for stamp, message in bag.messages([c for c in states if c.topic == chosen]):
            joint_names_read.update(dict.fromkeys(message.name))
            if names & set(message.name):  # else it is of other joints (a gripper's, say)
                stamps.append(stamp)
                positions.extend(_positions(where, joints, message.name, message.position))
        if not stamps:
            raise _no_joints(where, joints, list(joint_names_read))
        marks = None
        if marker_topic is not None:
            markers = [c for c in reader.connections if c.topic == marker_topic]
            if not markers:
                raise unknown_name(_NO_TOPIC, marker_topic, sorted(reader.topics))
            marks = [
                Mark((stamp - stamps[0]) * 1e-9, None if message is None else str(message.data))
                for stamp, message in bag.messages(markers)
            ]
    times = (np.array(stamps) - stamps[0]) * 1e-9
    rows = joints.joints(np.array(positions).reshape(len(stamps), -1))
    return JointLog(path, times, rows, marks=marks), chosen


def _topic(states: Sequence[Connection], topic: str | None, reader: AnyReader) -> str:
    there = sorted({connection.topic for connection in states})
    if topic is not None:
        if topic not in there:
            if topic in reader.topics:
                raise BadInput(
                    "the topic has no joint states",
                    found=f"{topic} of type {reader.topics[topic].msgtype}",
                    allowed=", ".join(there) or JOINT_STATE,
                )
            raise unknown_name(_NO_TOPIC, topic, sorted(reader.topics))
        return topic
    if not there:
        raise BadInput(
            "the bag has no joint states",
            found=", ".join(sorted(reader.topics)) or "no topics",
            allowed=f"a topic of type {JOINT_STATE}",
        )
    if len(there) > 1:
        raise BadInput(
            "the bag has several topics of joint states",
            found=", ".join(there),
            remedy="state which one is of the arm (--topic)",
        )
    return there[0]
