"""Stand-ins for controllers whose joints are read: an arm that moves and rests, published bytes, faults."""

from __future__ import annotations

import base64
import hashlib
import json
import socket
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from zerobeam.model.arrays import Matrix
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.robot import Robot

FAULTS = ("drop", "half", "silent", "stale", "malformed")
STALE_S = 0.4  # longer than the pause between two readings


class LiveArm:
    """Joints in degrees (mm) as its controller counts them; `share` of its answers have one of `faults`."""

    def __init__(
        self, joints: Sequence[float], share: float = 0.0, faults: Sequence[str] = FAULTS, seed: int = 1
    ) -> None:
        self._from = self._to = np.array(joints, dtype=float)
        self._began, self._lasts = time.monotonic(), 0.0
        self._rng = np.random.default_rng(seed)
        self.share, self.faults = share, tuple(faults)
        self.clock = True  # whether its answers have a time
        self.happened: list[str] = []
        self._last: tuple[float, Matrix] | None = None
        self._frozen_until = 0.0
        self._damage: tuple[np.random.Generator, int] | None = None
        self._lock = threading.Lock()

    def go(self, joints: Sequence[float], seconds: float) -> None:
        """A motion from where it is, at constant speed."""
        self._from, self._to = self.joints(), np.array(joints, dtype=float)
        self._began, self._lasts = time.monotonic(), seconds

    def joints(self) -> Matrix:
        passed = time.monotonic() - self._began
        share = 1.0 if passed >= self._lasts else passed / self._lasts
        return self._from + share * (self._to - self._from)

    @property
    def moves(self) -> bool:
        return time.monotonic() - self._began < self._lasts

    def damage(self, seed: int, after: int) -> None:
        """One answer is damaged: the next, or one `after` some."""
        self._damage = np.random.default_rng(seed), after

    def fault(self) -> str | None:
        """What goes wrong with the next answer; `stale`: for a while all answers repeat the last one."""
        with self._lock:
            if self._damage is not None:
                rng, after = self._damage
                self._damage = (rng, after - 1) if after else None
                if not after:
                    self._rng = rng
                    self.happened.append("damaged")
                    return "damaged"
            if time.monotonic() < self._frozen_until or self._rng.random() >= self.share:
                return None
            name = str(self._rng.choice(self.faults))
            if name == "stale" and self.clock:
                if self._last is None:
                    return None
                self._frozen_until = time.monotonic() + STALE_S
            self.happened.append(name)
            return None if name == "stale" and self.clock else name

    def reading(self) -> tuple[float, Matrix]:
        """Seconds of the controller's clock, and the joints."""
        if time.monotonic() < self._frozen_until and self._last is not None:
            return self._last
        self._last = time.monotonic() + 100.0, self.joints()
        return self._last

    def damaged(self, content: bytes) -> bytes:
        """Bytes changed, lost, doubled or cut off; digits changed for others."""
        rng, letters = self._rng, bytearray(content)
        start, end = sorted(rng.integers(0, len(content) + 1, 2))
        match rng.integers(5):
            case 0:
                for at in rng.integers(0, len(content), rng.integers(1, 4)):
                    letters[at] = rng.integers(256)
            case 1:
                digits = [i for i, letter in enumerate(content) if letter in b"0123456789"]
                for at in rng.choice(digits or [len(content) - 1], 2):
                    letters[at] = rng.choice(list(b"0123456789-.eE"))
            case 2:
                del letters[start : min(end, start + 12)]
            case 3:
                letters[start:start] = letters[start : min(end, start + 12)]
            case _:
                del letters[start:]
        return bytes(letters)


class Closed(Exception):
    """The client has gone, or the stand-in drops it."""


class TcpStandIn:
    """A server on the loopback; `serve` is called with each connection, in a thread of its own."""

    def __init__(self, serve: Callable[[socket.socket], None]) -> None:
        self._serve, self._over = serve, threading.Event()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(0.05)
        self.port: int = self._listener.getsockname()[1]
        self._threads = [threading.Thread(target=self._accept, daemon=True)]
        self._threads[0].start()

    def __enter__(self) -> TcpStandIn:
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        for thread in self._threads:
            thread.join()
        self._listener.close()

    def _accept(self) -> None:
        while not self._over.is_set():
            with suppress(TimeoutError):
                connection, _ = self._listener.accept()
                thread = threading.Thread(target=self._talk, args=(connection,), daemon=True)
                self._threads.append(thread)
                thread.start()

    def _talk(self, connection: socket.socket) -> None:
        with connection, suppress(Closed, OSError):
            self._serve(connection)

    def received(self, connection: socket.socket, size: int) -> bytes:
        """Exactly so many bytes of the client."""
        content = b""
        connection.settimeout(0.05)
        while len(content) < size:
            try:
                part = connection.recv(size - len(content))
            except TimeoutError:
                if self._over.is_set():
                    raise Closed from None
                continue
            if not part:
                raise Closed
            content += part
        return content

    def received_line(self, connection: socket.socket) -> bytes:
        line = b""
        while not line.endswith(b"\n"):
            line += self.received(connection, 1)
        return line.strip()


def sent(connection: socket.socket, content: bytes, fault: str | None, arm: LiveArm) -> None:
    """An answer, or what a fault makes of it."""
    if fault == "damaged":
        content = arm.damaged(content)
    if fault == "drop":
        raise Closed
    if fault == "half":
        connection.sendall(content[: len(content) // 2])
        raise Closed
    if fault != "silent":
        connection.sendall(content)


class UrStandIn(TcpStandIn):
    """RTDE of Universal Robots, and the dashboard server (`dashboard` is its port)."""

    robot, scheme, resolution = "ur5e", "ur", 0.0

    def __init__(self, arm: LiveArm, serial: str = "20215500123", version: int = 2) -> None:
        self.arm, self.serial, self._version = arm, serial, version
        self.dashboard = TcpStandIn(self._greet)
        super().__init__(self._rtde)

    def __exit__(self, *_: object) -> None:
        self.dashboard.__exit__()
        super().__exit__()

    @property
    def url(self) -> str:
        return f"ur://127.0.0.1:{self.port}"

    def _greet(self, connection: socket.socket) -> None:
        connection.sendall(b"Connected: Universal Robots Dashboard Server\n")
        while True:
            line = self.dashboard.received_line(connection)
            answer = self.serial if line == b"get serial number" else "could not understand"
            connection.sendall(answer.encode() + b"\n")

    def _rtde(self, connection: socket.socket) -> None:
        flowing = False
        while True:
            if flowing:
                self._data(connection)
                connection.settimeout(0.004)
                with suppress(TimeoutError):
                    if not connection.recv(1, socket.MSG_PEEK):
                        raise Closed
                    flowing = self._control(connection)
            else:
                flowing = self._control(connection)

    def _control(self, connection: socket.socket) -> bool:
        """Answer one package; whether data flow from now on."""
        size = int.from_bytes(self.received(connection, 2), "big")
        kind = self.received(connection, 1)
        content = self.received(connection, size - 3)
        if kind == b"V":
            answer = bytes([int.from_bytes(content, "big") == self._version])
        elif kind == b"O":
            names = content[8:].decode().split(",")
            types = {"timestamp": "DOUBLE", "actual_q": "VECTOR6D"}
            answer = b"\x01" + ",".join(types.get(name, "NOT_FOUND") for name in names).encode()
            text = b"hello"
            connection.sendall((3 + len(text)).to_bytes(2, "big") + b"M" + text)
        else:
            answer = b"\x01"
        connection.sendall((3 + len(answer)).to_bytes(2, "big") + kind + answer)
        return kind == b"S"

    def _data(self, connection: socket.socket) -> None:
        fault = self.arm.fault()
        stamp, joints = self.arm.reading()
        values = np.array([stamp, *np.radians(joints)], dtype=">f8")
        content = (b"\x07" if fault == "malformed" else b"\x01") + values.tobytes()
        sent(connection, (3 + len(content)).to_bytes(2, "big") + b"U" + content, fault, self.arm)


class KukaStandIn(TcpStandIn):
    """A variable proxy on the controller."""

    robot, scheme, resolution = "kr6_r900", "kuka", 0.0

    def __init__(self, arm: LiveArm, serial: str = "871234") -> None:
        self.arm, self.serial = arm, serial
        super().__init__(self._proxy)

    @property
    def url(self) -> str:
        return f"kuka://127.0.0.1:{self.port}"

    def _proxy(self, connection: socket.socket) -> None:
        stamp = 0.0
        while True:
            number, length = (int.from_bytes(self.received(connection, 2), "big") for _ in range(2))
            body = self.received(connection, length)
            assert body[0] == 0
            name = body[3:].decode()
            fault = None
            if name == "$AXIS_ACT":
                fault = self.arm.fault()
                stamp, joints = self.arm.reading()
                axes = ", ".join(f"A{i} {value:.8f}" for i, value in enumerate(joints, start=1))
                value = f"{{E6AXIS: {axes}, E1 0.0, E2 0.0, E3 0.0, E4 0.0, E5 0.0, E6 0.0}}"
            else:
                value = {"$ROB_TIMER": str(int(stamp * 1000)), "$KR_SERIALNO": self.serial}.get(name, "")
            if fault == "malformed":
                value = value[: len(value) // 3]
            status = b"\0\1\1" if value else b"\0\1\0"
            body = b"\0" + len(value).to_bytes(2, "big") + value.encode() + status
            sent(connection, number.to_bytes(2, "big") + len(body).to_bytes(2, "big") + body, fault, self.arm)


class FanucStandIn(TcpStandIn):
    """RMI: the port for a hand-shake, and that of the sessions."""

    robot, scheme, resolution = "lrmate_200id", "fanuc", 0.0

    def __init__(self, arm: LiveArm) -> None:
        self.arm = arm
        self.sessions = TcpStandIn(self._session)
        super().__init__(self._hand_shake)

    def __exit__(self, *_: object) -> None:
        self.sessions.__exit__()
        super().__exit__()

    @property
    def url(self) -> str:
        return f"fanuc://127.0.0.1:{self.port}"

    def _hand_shake(self, connection: socket.socket) -> None:
        assert json.loads(self.received_line(connection)) == {"Communication": "FRC_Connect"}
        answer = {"Communication": "FRC_Connect", "ErrorID": 0, "PortNumber": self.sessions.port}
        connection.sendall(json.dumps(answer).encode() + b"\r\n")

    def _session(self, connection: socket.socket) -> None:
        connection.sendall(b'{"Communication": "FRC_SystemFault", "SequenceID": 0}\r\n')
        while True:
            packet = json.loads(self.sessions.received_line(connection))
            if packet == {"Communication": "FRC_Disconnect"}:
                return
            assert packet == {"Command": "FRC_ReadJointAngles", "Group": 1}, packet
            fault = self.arm.fault()
            stamp, joints = self.arm.reading()
            angles = {f"J{i}": 0.0 for i in range(1, 10)}
            angles |= {f"J{i}": value for i, value in enumerate(joints.tolist(), start=1)}
            answer = {"Command": "FRC_ReadJointAngles", "ErrorID": 0, "TimeTag": int(stamp * 500)}
            line = json.dumps({**answer, "JointAngle": angles, "Group": 1}).encode()
            sent(connection, (line[:-9] if fault == "malformed" else line) + b"\r\n", fault, self.arm)


class RosStandIn(TcpStandIn):
    """A rosbridge that publishes the arm's joint states and those of a gripper, at 100 Hz each."""

    robot, scheme, resolution = "panda", "ros", 0.0

    def __init__(self, arm: LiveArm, version: int = 2) -> None:
        self.arm, self._version = arm, version
        super().__init__(self._bridge)

    @property
    def url(self) -> str:
        return f"ros://127.0.0.1:{self.port}"

    def _bridge(self, connection: socket.socket) -> None:
        key = b""
        while line := self.received_line(connection):
            if line.lower().startswith(b"sec-websocket-key:"):
                key = line.split(b":")[1].strip()
        accept = base64.b64encode(hashlib.sha1(key + b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11").digest())
        answer = b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        connection.sendall(answer + b"Sec-WebSocket-Accept: " + accept + b"\r\n\r\n")
        topic = None
        while True:
            if topic is not None:
                self._publish(connection, topic)
            connection.settimeout(0.005)
            with suppress(TimeoutError):
                if not connection.recv(1, socket.MSG_PEEK):
                    raise Closed
                topic = self._frame(connection, topic)
            if self._over.is_set():
                raise Closed

    def _frame(self, connection: socket.socket, topic: str | None) -> str | None:
        first, second = self.received(connection, 2)
        size = second & 127
        if size == 126:
            size = int.from_bytes(self.received(connection, 2), "big")
        assert second & 128  # a client masks
        mask = self.received(connection, 4)
        content = bytes(byte ^ mask[i % 4] for i, byte in enumerate(self.received(connection, size)))
        if first & 15 == 9:
            connection.sendall(bytes([0x8A, len(content)]) + content)
            return topic
        if first & 15 != 1:  # the answer to a ping, which a damaged frame may be
            return topic
        message = json.loads(content)
        return message["topic"] if message["op"] == "subscribe" else None

    def _publish(self, connection: socket.socket, topic: str) -> None:
        fault = self.arm.fault()
        stamp, joints = self.arm.reading()
        seconds, rest = int(stamp), int((stamp % 1) * 1e9)
        words = ("sec", "nanosec") if self._version == 2 else ("secs", "nsecs")
        names = [f"joint{i}" for i in range(1, len(joints) + 1)]
        for own, values in ((["finger"], [0.04]), (names[::-1], np.radians(joints)[::-1].tolist())):
            header = {"stamp": dict(zip(words, (seconds, rest), strict=True)), "frame_id": ""}
            state = {"header": header, "name": own, "position": values, "velocity": [], "effort": []}
            text = json.dumps({"op": "publish", "topic": topic, "msg": state}).encode()
            if fault == "malformed":
                text = text.replace(b"position", b"positional")
            half = len(text) // 2
            frames = b"".join(  # in two frames: a message may be fragmented
                bytes([first, 126]) + len(part).to_bytes(2, "big") + part
                for first, part in ((0x01, text[:half]), (0x80, text[half:]))
            )
            sent(connection, frames, fault, self.arm)


PULSES = (1435.3, 1435.3, 1209.6, 982.6, 979.4, 454.7)


class YaskawaStandIn:
    """The High-Speed Ethernet Server for robot 1: its position in pulses, and its model."""

    robot, scheme, resolution = "gp7", "yaskawa", 1 / min(PULSES)

    def __init__(self, arm: LiveArm, model: str = "1-06VXH7-A00") -> None:
        self.arm, self.model = arm, model
        arm.clock = False
        self._over = threading.Event()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.05)
        self.port: int = self._socket.getsockname()[1]
        self._late: bytes | None = None
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def __enter__(self) -> YaskawaStandIn:
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self._socket.close()

    @property
    def url(self) -> str:
        return f"yaskawa://127.0.0.1:{self.port}"

    def _serve(self) -> None:
        while not self._over.is_set():
            with suppress(TimeoutError):
                packet, client = self._socket.recvfrom(2000)
                for answer in self._answers(packet):
                    self._socket.sendto(answer, client)

    def _answers(self, packet: bytes) -> list[bytes]:
        assert packet[:11] == b"YERC\x20\x00\x00\x00\x03\x01\x00"
        assert packet[12:24] == b"\0\0\0\0" + b"9" * 8
        command = int.from_bytes(packet[24:26], "little"), int.from_bytes(packet[26:28], "little")
        assert packet[28:] == b"\x00\x01\x00\x00"
        if command == (0x89, 11):
            return [
                self._answer(
                    packet[11], b"YAS4.12.01A".ljust(24) + self.model.encode().ljust(16) + b"12345678"
                )
            ]
        assert command == (0x75, 1), command
        fault = self.arm.fault()
        _, joints = self.arm.reading()
        pulses = np.zeros(8, dtype="<i4")
        scale = np.array([*PULSES, 1000.0, 1000.0])[: len(joints)]
        pulses[: len(joints)] = np.rint(joints * scale)
        answer = self._answer(packet[11], bytes(20) + pulses.tobytes())
        earlier, self._late = self._late, answer
        if fault == "damaged":
            return [self.arm.damaged(answer)]
        if fault == "half":
            return [answer[: len(answer) // 2]]
        if fault == "malformed":
            return [answer[:32] + b"\x10" + answer[33:]]  # Cartesian
        if fault == "stale":  # what an earlier request is answered comes now, and this one's answer never
            return [earlier] if earlier is not None else []
        return [] if fault in ("drop", "silent") else [answer]

    def _answer(self, number: int, content: bytes) -> bytes:
        head = b"YERC\x20\x00" + len(content).to_bytes(2, "little") + bytes([3, 1, 1, number])
        return head + b"\0\0\0\x80" + b"9" * 8 + b"\x81" + bytes(7) + content


STAND_INS: dict[str, Any] = {
    kind.scheme: kind for kind in (UrStandIn, KukaStandIn, FanucStandIn, YaskawaStandIn, RosStandIn)
}


def robot_of(scheme: str) -> Robot:
    """The arm of a stand-in."""
    robot = load_robot(STAND_INS[scheme].robot, Path("."))
    if scheme != "yaskawa":
        return robot
    return replace(robot, conventions=replace(robot.conventions, pulses_per_deg=PULSES))
