"""Joints of any arm that ROS 1 or 2 has, by rosbridge: JSON over a websocket, TCP port 9090.

Published in rosbridge's protocol (RobotWebTools/rosbridge_suite, ROSBRIDGE_PROTOCOL.md) and in
sensor_msgs/JointState: `name`, `position` in rad (m if prismatic) and the time in `header.stamp`. A
subscription lasts for one reading, so that no message waits in a queue between two. Joints are found by their
names: those of `joints=a,b,c`, else of the robot file. They are counted as a URDF counts them, joint 3 from
link 2.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
import struct
import time
from collections.abc import Mapping
from itertools import cycle

import numpy as np

from ....model.arrays import Matrix
from ....model.kinematics.pendant import Pendant
from .. import transport
from ..transport import LARGEST, LinkFault, Stream
from .joint_client import JointReading, LiveAddress, LiveJoints, OtherArm

_GUID = b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11"  # of the standard
_LONGEST = 125  # bytes of a ping
_GOES_ON, _TEXT, _CLOSE, _PING, _PONG = 0x0, 0x1, 0x8, 0x9, 0xA  # from 8 on: control


class WebSocket(Stream):
    """An open connection of frames."""

    def __init__(self, host: str, port: int) -> None:
        super().__init__(host, port)
        key = base64.b64encode(os.urandom(16))
        lines = [b"GET / HTTP/1.1", f"Host: {host}:{port}".encode("idna" if not host.isascii() else "ascii")]
        lines += [b"Upgrade: websocket", b"Connection: Upgrade", b"Sec-WebSocket-Version: 13"]
        with self.closed_on_failure():
            self.send(b"\r\n".join([*lines, b"Sec-WebSocket-Key: " + key, b"", b""]))
            self._opened(base64.b64encode(hashlib.sha1(key + _GUID).digest()))

    def send_json(self, content: Mapping[str, object]) -> None:
        self._frame(_TEXT, json.dumps(content).encode())

    def message(self) -> str:
        """The next text message."""
        content = bytearray()
        while True:
            last, kind, part = self._next()
            if kind not in (_TEXT, _GOES_ON):
                continue
            content += part
            if last:
                return content.decode("utf-8", "replace")

    def drain(self) -> None:
        """Drop all messages that were sent before the other side answers a ping."""
        mark = os.urandom(4)
        self._frame(_PING, mark)
        while True:
            _, kind, content = self._next()
            if (kind, content) == (_PONG, mark):
                return

    def _opened(self, expected: bytes) -> None:
        status = self.line()
        accepted = b""
        while line := self.line():
            name, _, value = line.partition(b":")
            if name.lower() == b"sec-websocket-accept":
                accepted = value.strip()
        if b" 101" not in status or accepted != expected:
            raise LinkFault("this is no websocket")

    def _frame(self, kind: int, content: bytes) -> None:
        """A whole frame, masked as a client has to."""
        size = len(content)
        length = bytes([0x80 | size]) if size < 126 else struct.pack(">BH", 0xFE, size)
        mask = os.urandom(4)
        masked = bytes(a ^ b for a, b in zip(content, cycle(mask), strict=False))
        self.send(bytes([0x80 | kind]) + length + mask + masked)

    def _next(self) -> tuple[bool, int, bytes]:
        """Whether a frame is the last of its message, its kind and content; pings are answered."""
        first, second = self.exactly(2)
        size = second & 0x7F
        if size >= 126:
            size = int.from_bytes(self.exactly(2 if size == 126 else 8), "big")
        kind = first & 0x0F
        if size > (_LONGEST if kind >= _CLOSE else LARGEST) or second & 0x80:
            raise LinkFault("a frame cannot be read")
        content = self.exactly(size)
        if kind == _CLOSE:
            raise LinkFault("the websocket was closed")
        if kind == _PING:
            self._frame(_PONG, content)
        return bool(first & 0x80), kind, content


_TOPIC = "/joint_states"
_M = 1000.0


class RosJoints(LiveJoints):
    """The connection to one bridge."""

    between_links, ticks = True, 1.0
    _stream: WebSocket

    def __init__(self, address: LiveAddress, pendant: Pendant) -> None:
        robot = pendant.robot
        names = address.options.get("joints")
        self._names = [joint.name for joint in robot.joints] if names is None else names.split(",")
        if len(self._names) != robot.n:
            raise OtherArm(f"joints= has {len(self._names)} names, and {robot.name} has {robot.n} joints")
        self._topic = address.options.get("topic", _TOPIC)
        self._display = np.array(
            [joint.display if joint.kind == "revolute" else _M for joint in robot.joints]
        )
        self._number = 0
        self._stream = WebSocket(address.host, address.port)

    def _reading(self) -> JointReading:
        self._number += 1
        subscription = {"id": f"zerobeam-{self._number}", "topic": self._topic}
        self._stream.send_json({"op": "subscribe", **subscription, "queue_length": 1})
        reading = self._published()
        self._stream.send_json({"op": "unsubscribe", **subscription})
        self._stream.drain()
        return reading

    def _published(self) -> JointReading:
        """The next message that has the joints: a gripper may publish its own ones between."""
        others: dict[str, None] = {}
        ends = time.monotonic() + transport.ANSWER_S
        while time.monotonic() < ends:
            try:
                content = json.loads(self._stream.message())
                if content["op"] == "status" and content.get("level") == "error":
                    raise LinkFault(f"the bridge refuses: {str(content.get('msg'))[:200]}")
                if content["op"] != "publish" or content["topic"] != self._topic:
                    continue
                message = content["msg"]
                names = [str(name) for name in message["name"]]
                stamp = _seconds(message["header"]["stamp"])
                positions = dict(zip(names, map(float, message["position"]), strict=True))
            except (ValueError, TypeError, KeyError, OverflowError, RecursionError):
                raise LinkFault("the bridge sent a message that cannot be read") from None
            if all(name in positions for name in self._names):
                return JointReading(self._displayed(positions), stamp)
            others |= dict.fromkeys(names)
        if others:
            raise OtherArm(
                f"{self._topic} has no joints {', '.join(n for n in self._names if n not in others)}: it has"
                f" {', '.join(others)[:300]}"
            )
        raise LinkFault(f"nothing is published at {self._topic}")

    def _displayed(self, positions: dict[str, float]) -> Matrix:
        return np.asarray(np.array([positions[name] for name in self._names]) * self._display)


def _seconds(stamp: dict[str, int]) -> float:
    """Of ROS 2 (sec, nanosec) or 1 (secs, nsecs)."""
    if "sec" in stamp:
        return stamp["sec"] + 1e-9 * stamp["nanosec"]
    return stamp["secs"] + 1e-9 * stamp["nsecs"]
