"""Bags of ROS, opened within bounds: a few kilobytes can stand for gigabytes.

The library rosbags has no limit, and unpacks each chunk into memory whole. As long as a bag is open its
functions for that are replaced by bounded ones.
"""

from __future__ import annotations

import bz2
import sqlite3
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

from ruamel.yaml import YAML, AliasToken
from ruamel.yaml.error import YAMLError

from ....model.errors import BadInput, missing_extra
from ....model.parsing.reading import read_text, require_regular

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Connection


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
