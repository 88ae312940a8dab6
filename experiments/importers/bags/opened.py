"""A bag opened by the library rosbags, and its messages: every fault of a bag is one BadInput."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ....model.errors import BadInput, missing_extra
from ....model.files.reading import require_regular
from .unpacked import Unpacking, bounded, require_few_at_once

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Connection

JOINT_STATE = "sensor_msgs/msg/JointState"
TEXT = "std_msgs/msg/String"
_READ = (JOINT_STATE, "std_msgs/msg/Header", "builtin_interfaces/msg/Time", TEXT)
_LARGEST_MESSAGE = 10**6  # bytes, of what is read: a JointState of six joints has 300
_MAGIC = {b"#ROSBAG": "a ROS 1 bag", b"\x89MCAP0": "an mcap file", b"SQLite format 3": "a .db3 of ROS 2"}


def is_bag(path: Path) -> str | None:
    """What kind of bag a file is by its first bytes, None if it is none."""
    require_regular(path)
    with path.open("rb") as file:
        head = file.read(16)
    return next((kind for magic, kind in _MAGIC.items() if head.startswith(magic)), None)


@dataclass(frozen=True)
class Bag:
    """An open bag."""

    path: Path
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
                file=self.path,
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
                file=self.path,
            )
        return self.reader.deserialize(raw, connection.msgtype)


@contextmanager
def opened(path: Path) -> Iterator[Bag]:
    """The bag at `path`; BadInput where it cannot be read, or would take too much memory (`unpacked`)."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise missing_extra("reading ROS bags", "ros", needed="the library rosbags") from None
    try:
        # Older ROS 2 bags hold no definitions; those of JointState and std_msgs are the same in all of them.
        ros2 = get_typestore(Stores.LATEST)
        with bounded(path) as unpacking, AnyReader([path], default_typestore=ros2) as reader:
            ros = ros2 if reader.is2 else get_typestore(Stores.ROS1_NOETIC)
            _require_definitions(reader.typestore, ros, path)
            require_few_at_once(unpacking, reader.readers)
            yield Bag(path, reader, unpacking)
    except BadInput:
        raise
    except Exception as error:  # noqa: BLE001 - the library lets through what its parsers meet in a torn file
        raise BadInput(
            "the bag cannot be read: it is incomplete, corrupted or not a bag",
            found=" ".join(str(error).split()) or type(error).__name__,
            allowed="a ROS 1 .bag, a ROS 2 bag folder, .mcap or .db3",
            remedy="repair it with the tools of ROS (rosbag reindex, ros2 bag reindex, mcap recover)",
            file=path,
        ) from None


def _require_definitions(in_bag: Any, in_ros: Any, path: Path) -> None:
    """BadInput where the bag defines a type that is decoded, and not as ROS does."""
    for name in _READ:
        fields = in_bag.fielddefs.get(name, in_ros.fielddefs[name])[1]
        if [tuple(field) for field in fields] != [tuple(field) for field in in_ros.fielddefs[name][1]]:
            raise BadInput(
                f"the bag defines {name} otherwise than ROS",
                found=", ".join(str(field[0]) for field in fields)[:100],
                allowed=", ".join(str(field[0]) for field in in_ros.fielddefs[name][1]),
                remedy="record the joint states as sensor_msgs/JointState",
                file=path,
            )
