"""A websocket client for text messages (RFC 6455): the opening handshake, frames, pings.

As much of it as a subscription at a rosbridge needs, without another dependency.
"""

from __future__ import annotations

import base64
import hashlib
import os
import struct
from itertools import cycle

from ..bounded import LARGEST
from .joint_client import LinkFault
from .stream import Stream

_GUID = b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11"  # of the standard
_LONGEST = 125  # bytes of a ping
_GOES_ON, _TEXT, _CLOSE, _PING, _PONG = 0x0, 0x1, 0x8, 0x9, 0xA  # from 8 on: control


class WebSocket:
    """An open connection; LinkFault where it fails."""

    def __init__(self, host: str, port: int) -> None:
        self._stream = Stream(host, port)
        key = base64.b64encode(os.urandom(16))
        lines = [b"GET / HTTP/1.1", f"Host: {host}:{port}".encode("idna" if not host.isascii() else "ascii")]
        lines += [b"Upgrade: websocket", b"Connection: Upgrade", b"Sec-WebSocket-Version: 13"]
        try:
            self._stream.send(b"\r\n".join([*lines, b"Sec-WebSocket-Key: " + key, b"", b""]))
            self._opened(base64.b64encode(hashlib.sha1(key + _GUID).digest()))
        except BaseException:
            self.close()
            raise

    def begin(self) -> None:
        """A reading begins: its time, and its bytes."""
        self._stream.begin()

    def send(self, text: str) -> None:
        self._frame(_TEXT, text.encode())

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

    def close(self) -> None:
        self._stream.close()

    def _opened(self, expected: bytes) -> None:
        status = self._stream.line()
        accepted = b""
        while line := self._stream.line():
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
        self._stream.send(bytes([0x80 | kind]) + length + mask + masked)

    def _next(self) -> tuple[bool, int, bytes]:
        """Whether a frame is the last of its message, its kind and content; pings are answered."""
        first, second = self._stream.exactly(2)
        size = second & 0x7F
        if size >= 126:
            size = int.from_bytes(self._stream.exactly(2 if size == 126 else 8), "big")
        kind = first & 0x0F
        if size > (_LONGEST if kind >= _CLOSE else LARGEST) or second & 0x80:
            raise LinkFault("a frame cannot be read")
        content = self._stream.exactly(size)
        if kind == _CLOSE:
            raise LinkFault("the websocket was closed")
        if kind == _PING:
            self._frame(_PONG, content)
        return bool(first & 0x80), kind, content
