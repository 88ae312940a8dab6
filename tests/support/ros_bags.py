"""ROS bags, written by the library rosbags as ROS would write them."""

from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

NAMES = [f"joint{i}" for i in range(1, 7)]
START_NS = 1_700_000_000_000_000_000
JOINT_STATE, STRING, EMPTY = (
    "sensor_msgs/msg/JointState",
    "std_msgs/msg/String",
    "std_msgs/msg/Empty",
)


class Bag:
    """Messages to write: (time s, topic, type, content)."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
        self.messages: list[tuple[float, str, str, object]] = []

    def states(self, times, joints_deg, names=NAMES, topic="/joint_states"):
        types = self.store.types
        for i, (time, row) in enumerate(zip(times, np.radians(joints_deg), strict=True)):
            stamp = types["builtin_interfaces/msg/Time"](sec=int(time), nanosec=int(time % 1 * 1e9))
            extra = {"seq": i} if self.kind == "ros1" else {}
            head = types["std_msgs/msg/Header"](stamp=stamp, frame_id="", **extra)
            none = np.zeros(0)
            content = types[JOINT_STATE](
                header=head, name=list(names), position=np.array(row), velocity=none, effort=none
            )
            self.messages.append((time, topic, JOINT_STATE, content))
        return self

    def marker(self, time, text=None, topic="/shot"):
        if text is None:
            self.messages.append((time, topic, EMPTY, self.store.types[EMPTY](**self._empty())))
        else:
            self.messages.append((time, topic, STRING, self.store.types[STRING](data=text)))
        return self

    def _empty(self):
        fields = self.store.types[EMPTY].__dataclass_fields__
        return (
            {"structure_needs_at_least_one_member": 0}
            if "structure_needs_at_least_one_member" in fields
            else {}
        )

    def write(self, folder: Path, packed: str | None = None) -> Path:
        """Write the bag; `packed` is bz2 or lz4 for ROS 1, else storage, message or file (all zstd)."""
        path = folder / ("log.bag" if self.kind == "ros1" else "log")
        if self.kind == "ros1":
            writer, encode = Writer1(path), self.store.serialize_ros1
        else:
            plugin = StoragePlugin.MCAP if self.kind == "mcap" else StoragePlugin.SQLITE3
            writer, encode = Writer2(path, version=9, storage_plugin=plugin), self.store.serialize_cdr
        if packed is not None and self.kind == "ros1":
            writer.set_compression(Writer1.CompressionFormat[packed.upper()])
        elif packed is not None:
            writer.set_compression(CompressionMode[packed.upper()], CompressionFormat.ZSTD)
        with writer:
            open_ones = {}
            for time, topic, kind, content in sorted(self.messages, key=lambda message: message[0]):
                if topic not in open_ones:
                    open_ones[topic] = writer.add_connection(topic, kind, typestore=self.store)
                writer.write(open_ones[topic], START_NS + round(time * 1e9), encode(content, kind))
        return path


def file_of(path: Path) -> Path:
    """The file that holds the messages of a bag."""
    return path if path.is_file() else next(file for file in path.iterdir() if file.suffix != ".yaml")
