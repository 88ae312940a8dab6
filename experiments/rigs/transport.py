"""Connections to what may send anything, by TCP or UDP: one deadline and one limit of bytes a reading."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Any

ANSWER_S = 2.0  # until a controller that does not answer counts as lost
_ANSWERS = 3  # of the longest silence: until a reading has ended
LARGEST = 1 << 22  # bytes of a reading
_CHUNK = 1 << 16  # at a time; no datagram is larger
_LONGEST = 1 << 20  # bytes of a line: more is no answer


class LinkFault(Exception):
    """The connection failed, or what came cannot be read; a new connection may do better."""


class BoundedSocket(socket.socket):
    """The connection of `connected`, which is used up.

    What is received from `begin` on ends in time and size, or `fault` is raised with a sentence about
    `called`; silence for `answer_s` is a TimeoutError.
    """

    def __init__(
        self, connected: socket.socket, called: str, fault: Callable[[str], Exception], answer_s: float
    ) -> None:
        super().__init__(connected.family, connected.type, connected.proto, fileno=connected.detach())
        self._called, self._fault = called, fault
        self.begin(answer_s)

    def begin(self, answer_s: float) -> None:
        """A reading begins; so long may the other side be silent."""
        self._answer_s, self._left = answer_s, LARGEST
        self._ends = monotonic() + _ANSWERS * answer_s

    def require_time(self) -> float:
        """Seconds that are left of the reading."""
        left = self._ends - monotonic()
        if left <= 0:
            longest = _ANSWERS * self._answer_s
            raise self._fault(f"{self._called} does not come to an end within {longest:.3g} s")
        return left

    def recv(self, size: int, flags: int = 0) -> bytes:
        with self._waiting():
            content = super().recv(size, flags)
        self._count(len(content))
        return content

    def recv_into(self, buffer: Any, nbytes: int = 0, flags: int = 0) -> int:
        with self._waiting():
            size = super().recv_into(buffer, nbytes, flags)
        self._count(size)
        return size

    def sendall(self, content: Any, flags: int = 0) -> None:
        self.settimeout(self._answer_s)
        super().sendall(content, flags)

    @contextmanager
    def _waiting(self) -> Iterator[None]:
        """Wait as long as a silence may be, and not beyond the end of the reading."""
        self.settimeout(min(self._answer_s, self.require_time()))
        try:
            yield
        except TimeoutError:
            self.require_time()  # where the reading's time ended, and not a silence
            raise

    def _count(self, size: int) -> None:
        self._left -= size
        if self._left < 0:
            raise self._fault(f"{self._called} sends more than {LARGEST >> 20} MB for one reading")


class Stream:
    """A connection by TCP, or of `datagrams` by UDP; LinkFault where it fails, or where what is sent from
    `begin` on does not come in time or has no end. The first reading begins with the connection."""

    def __init__(self, host: str, port: int, *, datagrams: bool = False) -> None:
        self._called = f"{host}, port {port}"
        try:
            if datagrams:
                family, kind, protocol, _, where = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
                connected = socket.socket(family, kind, protocol)
                connected.connect(where)
            else:
                connected = socket.create_connection((host, port), timeout=ANSWER_S)
        except OSError as error:
            raise LinkFault(f"no connection to {self._called}: {error.strerror or error}") from None
        self._socket = BoundedSocket(connected, self._called, LinkFault, ANSWER_S)
        self._rest = bytearray()

    def begin(self) -> None:
        """A reading begins: its time, and its bytes."""
        self._socket.begin(ANSWER_S)

    def send(self, content: bytes) -> None:
        try:
            self._socket.sendall(content)
        except OSError as error:
            raise LinkFault(f"{self._called} is lost: {error.strerror or error}") from None

    def exactly(self, count: int) -> bytes:
        """The next `count` bytes."""
        self._socket.require_time()
        while len(self._rest) < count:
            self._grow()
        content = bytes(self._rest[:count])
        del self._rest[:count]
        return content

    def line(self) -> bytes:
        """The next line, without its end (LF, or CR LF)."""
        self._socket.require_time()
        looked = 0
        while (end := self._rest.find(b"\n", looked)) < 0:
            looked = len(self._rest)
            if looked > _LONGEST:
                raise LinkFault(f"{self._called} sends a line without an end")
            self._grow()
        line = bytes(self._rest[:end])
        del self._rest[: end + 1]
        return line.rstrip(b"\r")

    def datagram(self) -> bytes:
        """The next datagram."""
        try:
            return self._socket.recv(_CHUNK)
        except TimeoutError:
            raise LinkFault(f"{self._called} does not answer") from None
        except OSError as error:
            raise LinkFault(f"{self._called} is lost: {error.strerror or error}") from None

    def close(self) -> None:
        self._socket.close()

    @contextmanager
    def closed_on_failure(self) -> Iterator[None]:
        try:
            yield
        except BaseException:
            self.close()
            raise

    def _grow(self) -> None:
        content = self.datagram()
        if not content:
            raise LinkFault(f"{self._called} has ended the connection")
        self._rest += content
