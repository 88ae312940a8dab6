"""Sources of the lines of a run by hand: a person's input, or a file that something appends to."""

from __future__ import annotations

import os
import stat
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Protocol, TextIO

from ....interruption import obey
from ....model.errors import BadInput

_POLL_S = 0.2
_LONGEST = 100_000  # bytes of a line: more is no joint values


class Lines(Protocol):
    """Lines, one after another. `confirms`: whether who writes them can answer a question. `follows`: whether
    values may come in another order than asked for, so that they belong to the posture that they are near."""

    confirms: bool
    follows: bool

    def following(self) -> str | None:
        """The next line without its end, None where no more can come."""
        ...


class TypedLines:
    """The lines of a stream, such as standard input; `follows` where a program writes it."""

    confirms = True

    def __init__(self, stream: TextIO, *, follows: bool = False) -> None:
        self._stream = stream
        self.follows = follows

    def following(self) -> str | None:
        line = self._stream.readline()
        obey()
        return line.rstrip("\r\n") if line else None


class WatchedLines:
    """The complete lines of a file that a robot or a logger appends to.

    A line counts once its end is written. A file that is not there yet is waited for; one that was emptied,
    shortened or replaced is read from its beginning again: who hears the lines drops those heard before.
    `wait` lets time pass, and False ends the watch.
    """

    confirms = False
    follows = True

    def __init__(self, path: Path, wait: Callable[[float], bool] | None = None) -> None:
        self.path = path
        if path.exists() and not stat.S_ISREG(path.stat().st_mode):
            raise BadInput("this is no file to watch", file=path, allowed="a regular file, or one to come")
        self._wait = wait or _slept
        self._lines: deque[str] = deque()
        self._rest = b""
        self._read, self._file = 0, (0, 0)

    def following(self) -> str | None:
        while not self._lines:
            obey()
            self._grow()
            if not self._lines and not self._wait(_POLL_S):
                return None
        return self._lines.popleft()

    def _grow(self) -> None:
        try:
            with self.path.open("rb") as file:
                about = os.fstat(file.fileno())
                identity = (about.st_dev, about.st_ino)
                if identity != self._file or about.st_size < self._read:
                    self._file, self._read, self._rest = identity, 0, b""
                file.seek(self._read)
                content = file.read()
        except OSError:  # not there yet, or held by its writer: it is looked at again
            return
        self._read += len(content)
        *whole, self._rest = (self._rest + content).split(b"\n")
        self._rest = self._rest[-_LONGEST:]
        self._lines.extend(_text(line) for line in whole)


def _text(line: bytes) -> str:
    """UTF-8, or what can be read of it; a file that is preallocated has NUL bytes."""
    return line[-_LONGEST:].replace(b"\0", b"").decode("utf-8-sig", errors="replace").rstrip("\r")


def _slept(seconds: float) -> bool:
    time.sleep(seconds)
    return True
