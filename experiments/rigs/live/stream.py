"""Bytes from a controller by TCP, each awaited for a limited time."""

from __future__ import annotations

import socket

from ..bounded import BoundedSocket
from . import joint_client
from .joint_client import LinkFault

_CHUNK = 1 << 16
_LONGEST = 1 << 20  # bytes of a line: more is no answer


class Stream:
    """A connection; LinkFault where it fails, or where what is sent from `begin` on does not come in time or
    has no end. The first reading begins with the connection."""

    def __init__(self, host: str, port: int) -> None:
        self._called = f"{host}, port {port}"
        try:
            connected = socket.create_connection((host, port), timeout=joint_client.ANSWER_S)
        except OSError as error:
            raise LinkFault(f"no connection to {self._called}: {error.strerror or error}") from None
        self._socket = BoundedSocket(connected, self._called, LinkFault, joint_client.ANSWER_S)
        self._rest = bytearray()

    def begin(self) -> None:
        """A reading begins: its time, and its bytes."""
        self._socket.begin(joint_client.ANSWER_S)

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

    def close(self) -> None:
        self._socket.close()

    def _grow(self) -> None:
        try:
            content = self._socket.recv(_CHUNK)
        except TimeoutError:
            raise LinkFault(f"{self._called} does not answer") from None
        except OSError as error:
            raise LinkFault(f"{self._called} is lost: {error.strerror or error}") from None
        if not content:
            raise LinkFault(f"{self._called} has ended the connection")
        self._rest += content
