"""How much of a bag may be unpacked: a few kilobytes can stand for gigabytes.

The library rosbags has no limit, and unpacks each chunk into memory whole. As long as a bag is open its
functions for that are replaced by bounded ones.
"""

from __future__ import annotations

import bz2
import sqlite3
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Protocol, cast

from ....model.errors import BadInput

RATIO = 200  # of all that is unpacked to the bag's own size; joint states of an arm at rest reach 60
ALWAYS = 64 * 10**6  # bytes that may be unpacked whatever the ratio
AT_ONCE = 256 * 10**6  # bytes in memory at once: a chunk, a message, chunks whose times overlap
_STEP = 2**20  # bytes
_LONGEST_DEFAULT = 1000  # characters, of a column in a .db3


class _Decompressor(Protocol):
    """What the decompressors of bz2, lz4 and zstd have in common."""

    eof: bool
    needs_input: bool
    unused_data: bytes | None

    def decompress(self, data: bytes, max_length: int = -1) -> bytes: ...


class Unpacking:
    """Counts what is unpacked of the bag at `path`; BadInput beyond the limits."""

    def __init__(self, path: Path) -> None:
        files = path.iterdir() if path.is_dir() else (path,)
        self.path, self.packed = path, sum(file.stat().st_size for file in files)
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
                file=self.path,
            )

    def require_at_once(self, size: int, what: str) -> None:
        """BadInput where `size` bytes are more than may be in memory at once."""
        if size > AT_ONCE:
            raise BadInput(
                f"the bag is not unpacked: {what} would take too much memory",
                found=f"more than {AT_ONCE // 10**6} MB",
                allowed=f"{AT_ONCE // 10**6} MB at once",
                remedy="record in smaller chunks, or keep the topic of the joint states alone",
                file=self.path,
            )

    def whole(self, data: bytes, decompressor: Callable[[], _Decompressor]) -> bytes:
        """A chunk or a message unpacked: one stream of data or several."""
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
    places: list[tuple[dict[str, Any], str, Any]] = [
        (cast(Any, ros1.decompressors), "bz2", by(bz2.BZ2Decompressor)),
        (cast(Any, ros1.decompressors), "lz4", of_lz4),
        (cast(Any, mcap.DECOMPRESSORS), "lz4", of_lz4),
        (cast(Any, mcap.DECOMPRESSORS), "zstd", of_zstd),
        (vars(ros2), "zstd", module),
    ]
    with ExitStack() as replaced:
        for place, name, bounded_one in places:
            replaced.callback(place.__setitem__, name, place[name])
            place[name] = bounded_one
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
                asked = "SELECT name, hidden, length(dflt_value) FROM pragma_table_xinfo(?)"
                for column, hidden, default in store.execute(asked, (table,)):
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
