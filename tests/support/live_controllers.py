"""Stand-ins for controllers whose joints are read: an arm that moves and rests, published bytes, faults."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from zerobeam.model.arrays import Matrix

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
        self.happened: list[str] = []
        self._last: tuple[float, Matrix] | None = None
        self._frozen_until = 0.0
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

    def fault(self) -> str | None:
        """What goes wrong with the next answer; `stale`: for a while all answers repeat the last one."""
        with self._lock:
            if time.monotonic() < self._frozen_until or self._rng.random() >= self.share:
                return None
            name = str(self._rng.choice(self.faults))
            if name == "stale":
                if self._last is None:
                    return None
                self._frozen_until = time.monotonic() + STALE_S
            self.happened.append(name)
            return None if name == "stale" else name

    def reading(self) -> tuple[float, Matrix]:
        """Seconds of the controller's clock, and the joints."""
        if time.monotonic() < self._frozen_until and self._last is not None:
            return self._last
        self._last = time.monotonic() + 100.0, self.joints()
        return self._last


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


def sent(connection: socket.socket, content: bytes, fault: str | None) -> None:
    """An answer, or what a fault makes of it."""
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
        sent(connection, (3 + len(content)).to_bytes(2, "big") + b"U" + content, fault)


STAND_INS: dict[str, Any] = {"ur": UrStandIn}
