"""A connection by TCP to what may send anything: one deadline and one limit of bytes for each reading."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Any

_ANSWERS = 3  # of the longest silence: until a reading has ended
LARGEST = 1 << 22  # bytes of a reading


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
