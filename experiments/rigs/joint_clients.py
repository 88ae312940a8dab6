"""The joints of a real controller, read only: the contract of a client, why joints are not taken, and a
client each for RMI (FANUC), KUKAVARPROXY, RTDE (Universal Robots), the High-Speed Ethernet Server
(Yaskawa) and rosbridge."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import re
import struct
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from contextlib import closing, suppress
from dataclasses import dataclass
from itertools import cycle
from typing import Literal

import numpy as np

from ...model.arrays import Matrix
from ...model.errors import BadInput
from ...model.kinematics.pendant import Pendant
from . import transport
from .transport import LARGEST, LinkFault, Stream


@dataclass(frozen=True)
class LiveAddress:
    """Where a controller is; `options` are those of its scheme."""

    scheme: str
    host: str
    port: int
    options: Mapping[str, str]

    def number(self, option: str, usual: int, most: int) -> int:
        """A whole number from 1 to `most`; BadInput for anything else."""
        text = self.options.get(option, str(usual))
        if not (re.fullmatch(r"[0-9]{1,6}", text) and 1 <= int(text) <= most):
            raise BadInput(f"{option}= is not understood", found=text[:100], allowed=f"1 to {most}")
        return int(text)


@dataclass(frozen=True, eq=False)
class JointReading:
    """`joints` (n,) deg (mm if prismatic), joint 1 first, as the controller counts them; `stamp` is when they
    were measured, by a clock that only advances."""

    joints: Matrix
    stamp: float


class LiveJoints(ABC):
    """A connection to the controller at `address`; a method may raise LinkFault.

    `identity` is what the controller says of itself, empty where it was not asked; `resolution` deg (mm), a
    number or (n,), is one count of its joints; `between_links` says that joint 3 is counted from link 2
    whatever the pendant does; `ticks` of the stamp are a second, None where that is not published.
    """

    identity: str = ""
    resolution: float | Matrix = 0.0
    between_links: bool = False
    ticks: float | None = None
    _stream: Stream

    @abstractmethod
    def __init__(self, address: LiveAddress, pendant: Pendant) -> None: ...

    def read(self) -> JointReading:
        """The joints, measured after the call, within one deadline."""
        self._stream.begin()
        return self._reading()

    @abstractmethod
    def _reading(self) -> JointReading:
        """What the controller answers."""

    def close(self) -> None:
        """End the connection; safe more than once."""
        self._stream.close()


class OtherArm(Exception):
    """The controller is that of another arm than the plan's."""


class JointsRefused(Exception):
    """The joints are not taken now; `why` is a sentence for the person."""

    def __init__(self, kind: Literal["connection", "stale", "moving"], why: str) -> None:
        self.kind, self.why = kind, why
        super().__init__(why)


# Joints of FANUC's controllers by the Remote Motion Interface (RMI, option R912), TCP port 16001.
#
# Published in FANUC's operator's manual B-84184EN: a JSON object a line. `FRC_Connect` at port 16001
# answers the port of the session; there `FRC_ReadJointAngles` answers `JointAngle`, J1 to J9 of a group in
# degrees as the pendant counts them (joint 3 from the ground), and `TimeTag`, by a clock whose unit is not
# relied on here. `FRC_Initialize` is never sent: without it RMI moves nothing. The interface tells no
# serial number.

_RMI_JOINTS, _GROUPS = 9, 8


class FanucJoints(LiveJoints):
    """A session of the interface."""

    def __init__(self, address: LiveAddress, pendant: Pendant) -> None:
        self._n, self._group = pendant.robot.n, address.number("group", 1, _GROUPS)
        with closing(Stream(address.host, address.port)) as first:
            port = _answered(first, "Communication", "FRC_Connect").get("PortNumber")
        if not isinstance(port, int) or not 0 < port < 65536:
            raise LinkFault("the controller names no port for the session")
        self._stream = Stream(address.host, port)

    def _reading(self) -> JointReading:
        answer = _answered(self._stream, "Command", "FRC_ReadJointAngles", Group=self._group)
        # Some versions call them JointAngles.
        angles, stamp = answer.get("JointAngle", answer.get("JointAngles")), answer.get("TimeTag")
        if not isinstance(angles, dict):
            raise LinkFault("the controller sent no joints")
        try:
            values = np.array([float(angles.get(f"J{i}", 0.0)) for i in range(1, _RMI_JOINTS + 1)])
            complete = all(f"J{i}" in angles for i in range(1, self._n + 1))
            time_tag = float(stamp)  # type: ignore[arg-type]
        except (TypeError, ValueError, OverflowError):
            raise LinkFault("the controller sent what are no joints, or no time") from None
        if not complete or values[self._n :].any():
            raise OtherArm(f"the controller's joints are not the {self._n} of the plan's arm")
        return JointReading(values[: self._n], time_tag)

    def close(self) -> None:
        with suppress(LinkFault):
            self._stream.begin()
            self._stream.send(_packet("Communication", "FRC_Disconnect"))
        super().close()


def _packet(kind: str, name: str, **content: int) -> bytes:
    return json.dumps({kind: name, **content}).encode("ascii") + b"\r\n"


def _answered(stream: Stream, kind: str, name: str, **content: int) -> dict[str, object]:
    """The answer to a packet; what the controller says of itself in between is passed over."""
    stream.send(_packet(kind, name, **content))
    while True:
        try:
            answer = json.loads(stream.line())
        except (ValueError, RecursionError):
            raise LinkFault("the controller sent a line that cannot be read") from None
        if not isinstance(answer, dict):
            raise LinkFault("the controller sent a line that is no packet")
        if answer.get("Communication") == "FRC_Terminate":
            raise LinkFault("the controller has ended the session")
        if answer.get(kind) == name:
            if answer.get("ErrorID") != 0:
                raise LinkFault(f"the controller refuses {name}: ErrorID {answer.get('ErrorID')}")
            return answer


# Joints of KUKA's controllers by a variable proxy on them: KUKAVARPROXY or C3 Bridge, TCP port 7000.
#
# Their protocol, by their public sources (ImtsSrl/KUKAVARPROXY; C3 Bridge Interface Server): a number and a
# length (uint16, big-endian), 0 for reading, the length of a variable's name (uint16) and the name; the
# answer repeats the number, and behind the value come three bytes, of which the last is 1 where the
# variable was read.
#
# Read are `$AXIS_ACT`, the axes as a KRL program records them (degrees, mm; the setpoint of the control),
# and `$ROB_TIMER`, milliseconds of the controller's clock (KUKA, "System Variables", KSS 8). `arm=` is
# compared with `$KR_SERIALNO`, the serial number of the robot.

_PROXY_HEADER, _LENGTH = struct.Struct(">HHB"), struct.Struct(">H")
_READ, _STATUS = 0, 3  # function; bytes behind a value
_AXIS = re.compile(r"\bA(\d)\s+([-+]?[\d.]+(?:[eE][-+]?\d+)?)")


class KukaJoints(LiveJoints):
    """The connection to one proxy."""

    ticks = 1000.0

    def __init__(self, address: LiveAddress, pendant: Pendant) -> None:
        self._number = 0
        self._stream = Stream(address.host, address.port)
        if "arm" in address.options:
            with self._stream.closed_on_failure():
                self.identity = self._variable("$KR_SERIALNO")

    def _reading(self) -> JointReading:
        text = self._variable("$AXIS_ACT").strip()
        timer = self._variable("$ROB_TIMER")
        try:
            axes = {int(axis): float(value) for axis, value in _AXIS.findall(text)}
            stamp = float(timer)
        except ValueError:
            raise LinkFault("the proxy sent what are no axes, or no time") from None
        if not text.endswith("}") or not axes or set(axes) != set(range(1, len(axes) + 1)):
            raise LinkFault("the proxy sent what are no axes")
        return JointReading(np.array([axes[i] for i in sorted(axes)]), stamp)

    def _variable(self, name: str) -> str:
        self._number = (self._number + 1) % 65536
        body = _LENGTH.pack(len(name)) + name.encode("ascii")
        self._stream.send(_PROXY_HEADER.pack(self._number, len(body) + 1, _READ) + body)
        number, length, function = _PROXY_HEADER.unpack(self._stream.exactly(_PROXY_HEADER.size))
        content = self._stream.exactly(max(length - 1, 0))
        value = content[_LENGTH.size : -_STATUS]
        if (
            (number, function) != (self._number, _READ)
            or len(content) < _LENGTH.size + _STATUS
            or _LENGTH.unpack(content[: _LENGTH.size])[0] != len(value)
        ):
            raise LinkFault("the proxy sent an answer that cannot be read")
        if content[-1] != 1:
            raise LinkFault(f"the proxy cannot read {name}")
        return value.decode("ascii", "replace")


# Joints of Universal Robots by RTDE, the Real-Time Data Exchange, TCP port 30004.
#
# Published in Universal Robots' guide
# (docs.universal-robots.com/tutorials/communication-protocol-tutorials/ rtde-guide.html): packages of a
# size (uint16, with the header), a type (a letter) and content, all big-endian. Version 2 of the protocol
# is asked for (V), two outputs are set up (O): `timestamp`, seconds since the controller started, and
# `actual_q`, six angles in rad. Data (U) flow from a start (S) to a pause (P), so that none waits in a
# buffer between two readings; text messages (M) may come at any time. The clients on PyPI are a C++ library
# that can move the arm, and unmaintained copies of the maker's example: neither is worth it here.
#
# The serial number is asked for where `arm=` states it: `get serial number` of the dashboard server, port
# 29999 (PolyScope 3.12, 5.6; PolyScope X has none).

_VERSION, _SETUP, _START, _PAUSE, _DATA = b"V", b"O", b"S", b"P", b"U"
_RTDE_HEADER = struct.Struct(">HB")
_SETTINGS, _READING = struct.Struct(">d"), struct.Struct(">B7d")
_RATE_HZ = 125.0
_OUTPUTS, _TYPES = b"timestamp,actual_q", b"DOUBLE,VECTOR6D"
_RTDE_JOINTS = 6
_DASHBOARD = 29999


class UrJoints(LiveJoints):
    """The connection to one controller, paused between readings."""

    ticks = 1.0

    def __init__(self, address: LiveAddress, pendant: Pendant) -> None:
        if pendant.robot.n != _RTDE_JOINTS:
            raise OtherArm(
                f"an arm of Universal Robots has 6 joints, and {pendant.robot.name} has {pendant.robot.n}"
            )
        self.identity = _serial(address) if "arm" in address.options else ""
        self._stream = Stream(address.host, address.port)
        with self._stream.closed_on_failure():
            if self._answered(_VERSION, struct.pack(">H", 2)) != b"\x01":
                raise LinkFault("the controller has no version 2 of RTDE")
            self._recipe, types = self._set_up()
            if types != _TYPES:
                raise LinkFault(f"the controller does not send {_OUTPUTS.decode()}: {types!r}")

    def _reading(self) -> JointReading:
        if self._answered(_START) != b"\x01":
            raise LinkFault("the controller does not start its data")
        content = self._next(_DATA)
        if len(content) != _READING.size:
            raise LinkFault("the controller sent data of another length")
        recipe, stamp, *joints = _READING.unpack(content)
        if recipe != self._recipe:
            raise LinkFault("the controller sent data that were not set up")
        self._answered(_PAUSE)
        return JointReading(np.degrees(joints), stamp)

    def _set_up(self) -> tuple[int, bytes]:
        content = self._answered(_SETUP, _SETTINGS.pack(_RATE_HZ) + _OUTPUTS)
        if not content:
            raise LinkFault("the controller sent an empty answer")
        return content[0], content[1:]

    def _answered(self, kind: bytes, content: bytes = b"") -> bytes:
        self._stream.send(_RTDE_HEADER.pack(_RTDE_HEADER.size + len(content), kind[0]) + content)
        return self._next(kind)

    def _next(self, kind: bytes) -> bytes:
        """The content of the next package of a kind; others are passed over."""
        while True:
            size, letter = _RTDE_HEADER.unpack(self._stream.exactly(_RTDE_HEADER.size))
            if size < _RTDE_HEADER.size:
                raise LinkFault("the controller sent a package that is too short")
            content = self._stream.exactly(size - _RTDE_HEADER.size)
            if letter == kind[0]:
                return content


def _serial(address: LiveAddress) -> str:
    with closing(Stream(address.host, address.number("dashboard", _DASHBOARD, 65535))) as dashboard:
        dashboard.line()  # its greeting
        dashboard.send(b"get serial number\n")
        return dashboard.line().decode("ascii", "replace").strip()


# Joints of Yaskawa's controllers (FS100, DX200, YRC1000) by the High-Speed Ethernet Server, UDP port 10040.
#
# Published in Yaskawa's "Options Instructions for High-Speed Ethernet Server Function" (160766-1CD for the
# FS100, 178942-1CD for the YRC1000). A request has 32 bytes, little-endian; the answer repeats its number,
# so that an answer to an earlier request is not taken for it. Command 0x75, instance 1 is the position of
# robot 1 in pulses: five words about the pose, the first of them 0, and eight axes. Answers have no time:
# the stamp is when the request was sent, and an answer cannot be older than that.
#
# Pulses become degrees by `pulses_per_deg` of the robot file, in the order of the pendant. `arm=` is
# compared with the model of robot 1, of which command 0x89 (instance 11) tells; the server tells no serial
# number.

_SERVER_HEADER = struct.Struct("<4sHHBBBBI8s")
_REQUEST, _ANSWER = struct.Struct("<HHBBH"), struct.Struct("<BBBBHH")
_POSITION, _SYSTEM = (0x75, 1), (0x89, 11)  # command, instance
_READ_ALL = 0x01
_WORDS = struct.Struct("<13i")
_AXES = 5  # words before them
_MODEL = slice(24, 40)  # letters, behind 24 of the software's version


class YaskawaJoints(LiveJoints):
    """The connection to one controller."""

    ticks = 1.0

    def __init__(self, address: LiveAddress, pendant: Pendant) -> None:
        self._pulses = pendant.per_degree("pulse")
        self._order, self._number = pendant.order, 0
        self.resolution = 1.0 / np.abs(self._pulses)
        self._stream = Stream(address.host, address.port, datagrams=True)
        if "arm" in address.options:
            with self._stream.closed_on_failure():
                self.identity = self._model()

    def _reading(self) -> JointReading:
        stamp = time.monotonic()
        content = self._answered(*_POSITION)
        if len(content) != _WORDS.size:
            raise LinkFault("the controller sent a position of another length")
        kind, *words = _WORDS.unpack(content)
        if kind != 0:
            raise LinkFault("the controller sent a position that is not in pulses")
        axes = np.array(words[_AXES - 1 :], dtype=float)
        n = len(self._order)
        if axes[n:].any():
            raise OtherArm(f"the controller moves {int(np.flatnonzero(axes)[-1]) + 1} joints, and not {n}")
        joints = np.empty(n)
        joints[self._order] = axes[:n]
        return JointReading(joints / self._pulses, stamp)

    def _model(self) -> str:
        return self._answered(*_SYSTEM)[_MODEL].split(b"\0")[0].decode("ascii", "replace").strip()

    def _answered(self, command: int, instance: int) -> bytes:
        """The content of the answer to a request without content."""
        self._number = (self._number + 1) % 256
        header = _SERVER_HEADER.pack(b"YERC", 32, 0, 3, 1, 0, self._number, 0, b"99999999")
        self._stream.send(header + _REQUEST.pack(command, instance, 0, _READ_ALL, 0))
        while (content := self._answer(self._stream.datagram())) is None:
            pass  # of an earlier request
        return content

    def _answer(self, packet: bytes) -> bytes | None:
        """The content of a packet; None if it answers another request."""
        if len(packet) < 32:
            raise LinkFault("the controller sent a packet that is too short")
        word, size, length, _, _, answers, number, _, _ = _SERVER_HEADER.unpack(packet[:24])
        service, status, _, _, added, _ = _ANSWER.unpack(packet[24:32])
        if (word, size, answers) != (b"YERC", 32, 1) or length != len(packet) - 32:
            raise LinkFault("the controller sent a packet that cannot be read")
        if number != self._number:
            return None
        if service != _READ_ALL + 0x80 or status != 0:
            raise LinkFault(f"the controller refuses the request: status {status:#x}, {added:#x}")
        return packet[32:]


# Joints of any arm that ROS 1 or 2 has, by rosbridge: JSON over a websocket, TCP port 9090.
#
# Published in rosbridge's protocol (RobotWebTools/rosbridge_suite, ROSBRIDGE_PROTOCOL.md) and in
# sensor_msgs/JointState: `name`, `position` in rad (m if prismatic) and the time in `header.stamp`. A
# subscription lasts for one reading, so that no message waits in a queue between two. Joints are found by
# their names: those of `joints=a,b,c`, else of the robot file. They are counted as a URDF counts them,
# joint 3 from link 2.

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
