"""Bytes from a controller by TCP, each awaited for a limited time."""

from __future__ import annotations

import socket
import time

from . import interface
from .interface import LinkFault

_CHUNK = 4096
_LONGEST = 1 << 20  # bytes of a line: more is no answer


class Stream:
    """A connection; LinkFault where it fails or an answer does not come in time."""

    def __init__(self, host: str, port: int) -> None:
        self._called = f"{host}, port {port}"
        try:
            self._socket = socket.create_connection((host, port), timeout=interface.ANSWER_S)
        except OSError as error:
            raise LinkFault(f"no connection to {self._called}: {error.strerror or error}") from None
        self._rest = b""

    def send(self, content: bytes) -> None:
        try:
            self._socket.settimeout(interface.ANSWER_S)
            self._socket.sendall(content)
        except OSError as error:
            raise LinkFault(f"{self._called} is lost: {error.strerror or error}") from None

    def exactly(self, count: int) -> bytes:
        """The next `count` bytes."""
        ends = time.monotonic() + interface.ANSWER_S
        while len(self._rest) < count:
            self._grow(ends)
        content, self._rest = self._rest[:count], self._rest[count:]
        return content

    def line(self) -> bytes:
        """The next line, without its end (LF, or CR LF)."""
        ends = time.monotonic() + interface.ANSWER_S
        while b"\n" not in self._rest:
            if len(self._rest) > _LONGEST:
                raise LinkFault(f"{self._called} sends a line without an end")
            self._grow(ends)
        line, _, self._rest = self._rest.partition(b"\n")
        return line.rstrip(b"\r")

    def close(self) -> None:
        self._socket.close()

    def _grow(self, ends: float) -> None:
        try:
            self._socket.settimeout(max(ends - time.monotonic(), 1e-3))
            content = self._socket.recv(_CHUNK)
        except TimeoutError:
            raise LinkFault(f"{self._called} does not answer") from None
        except OSError as error:
            raise LinkFault(f"{self._called} is lost: {error.strerror or error}") from None
        if not content:
            raise LinkFault(f"{self._called} has ended the connection")
        self._rest += content
