"""What an instrument reads, by lines of text: from a TCP server, a serial port or a file that grows.

The line is stated in the sensors file: `{}` is a number, `{*}` is any text, a blank is any blanks. Only a
line that begins after the asking counts, so that no reading is older than the posture.
"""

from __future__ import annotations

import os
import re
import socket
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from ...interruption import obey
from ...model.errors import BadInput, RigFault, missing_extra
from ...model.parsing.confinement import require_device, require_within
from ...model.parsing.reading import shown
from .sensors_file import LineSource

_POLL_S = 0.02
_LONGEST = 10_000  # bytes of a line
_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_MM = {"mm": 1.0, "m": 1000.0, "in": 25.4}
_CONNECT_S = 5.0


class ReadingRefused(Exception):
    """The instrument has no reading for this posture; the sentence says why."""


class Bytes(Protocol):
    """Where bytes of an instrument come from. OSError where it is lost."""

    def new(self) -> bytes:
        """What has come since the last call, after a short wait at most; b"" if nothing has."""
        ...

    def send(self, content: bytes) -> None: ...

    def close(self) -> None: ...


class TcpBytes:
    """A server that sends lines."""

    def __init__(self, address: str) -> None:
        host, _, port = address.rpartition(":")
        self._socket = socket.create_connection((host.strip("[]"), int(port)), timeout=_CONNECT_S)
        self._socket.settimeout(_POLL_S)

    def new(self) -> bytes:
        try:
            content = self._socket.recv(_LONGEST)
        except TimeoutError:
            return b""
        if not content:
            raise OSError("the server has ended the connection")
        return content

    def send(self, content: bytes) -> None:
        self._socket.sendall(content)

    def close(self) -> None:
        self._socket.close()


class SerialBytes:
    """An instrument at a serial port."""

    def __init__(self, device: str, baud: int) -> None:
        try:
            import serial
        except ImportError:
            raise missing_extra("an instrument at a serial port", "psd") from None
        require_device(device)
        self._port = serial.Serial(device, baud, timeout=_POLL_S, write_timeout=_CONNECT_S, exclusive=True)

    def new(self) -> bytes:
        return bytes(self._port.read(self._port.in_waiting or 1))

    def send(self, content: bytes) -> None:
        self._port.write(content)

    def close(self) -> None:
        self._port.close()


class FileBytes:
    """A file that another program appends to; one that is replaced is read from its beginning."""

    def __init__(self, path: Path) -> None:
        require_within(path)
        self._path, self._read, self._file = path, 0, (0, 0)

    def new(self) -> bytes:
        content = b""
        if self._path.is_file():
            with self._path.open("rb") as file:
                about = os.fstat(file.fileno())
                identity = (about.st_dev, about.st_ino)
                if identity != self._file or about.st_size < self._read:
                    self._file, self._read = identity, 0
                file.seek(self._read)
                content = file.read()
        self._read += len(content)
        if not content:
            time.sleep(_POLL_S)
        return content

    def send(self, content: bytes) -> None:
        raise OSError("a file cannot be asked")

    def close(self) -> None:
        """Nothing is held open."""


class InstrumentLines:
    """The instrument `name`, open; `lengths` says of each number of a reading whether it is a length.

    BadInput where the stated line has another count of numbers, RigFault where the source cannot be opened.
    """

    def __init__(self, name: str, source: LineSource, folder: Path, lengths: Sequence[bool]) -> None:
        self._name, self._source, self._lengths = name, source, tuple(lengths)
        self._pattern = line_pattern(source.line)
        if self._pattern.groups != len(self._lengths):
            raise BadInput(
                f"the line of {name} has another count of numbers than its readings",
                found=f"{source.line!r}: {self._pattern.groups}",
                allowed=f"{len(self._lengths)} times {{}}",
            )
        self._rest, self._whole = b"", True
        try:
            self._bytes = _opened(source, folder)
        except (OSError, ValueError) as error:
            raise RigFault(f"{name} cannot be opened: {error}") from None

    def read(self) -> str:
        """The numbers of one reading from now on, lengths in mm; ReadingRefused where none comes in time."""
        before, other = self._drop(), ""
        if self._source.ask is not None:
            self._tried_to_send(self._source.ask.encode())
        ends = time.monotonic() + self._source.wait_s
        while time.monotonic() < ends:
            obey()
            for line in self._lines():
                match = self._pattern.fullmatch(line)
                if match is not None:
                    return self._in_mm(match.groups())
                other = line or other
        if other:
            raise ReadingRefused(
                f"{self._name} sent {shown(other)}, which is not the line of the sensors file"
            )
        earlier = f"; {before} came before the joints were read, and are older" if before else ""
        raise ReadingRefused(f"{self._name} sent no line in {self._source.wait_s:g} s{earlier}")

    def close(self) -> None:
        self._bytes.close()

    def _drop(self) -> int:
        """How many whole lines had come until now; they are forgotten, and so is one that has begun.

        Two short reads in a row: neither this side nor the other has lines in a queue any more.
        """
        short = 0
        while short < 2:
            content = self._new()
            short = short + 1 if len(content) < _LONGEST else 0
            self._rest += content
        *lines, rest = self._rest.split(b"\n")
        self._whole, self._rest = not rest and (self._whole or bool(lines)), b""
        return len(lines)

    def _lines(self) -> list[str]:
        """The lines whose ends have come, without the rest of one that had begun earlier."""
        *lines, rest = (self._rest + self._new()).split(b"\n")
        self._rest = rest[-_LONGEST:]
        if lines and not self._whole:
            self._whole, lines = True, lines[1:]
        return [line.decode("utf-8", "replace").strip() for line in lines]

    def _new(self) -> bytes:
        try:
            return self._bytes.new()
        except OSError as error:
            raise RigFault(f"{self._name} is lost ({error}): go on with --resume") from None

    def _tried_to_send(self, content: bytes) -> None:
        try:
            self._bytes.send(content)
        except OSError as error:
            raise RigFault(f"{self._name} is lost ({error}): go on with --resume") from None

    def _in_mm(self, numbers: Sequence[str]) -> str:
        scale = _MM[self._source.unit]
        values = zip(map(float, numbers), self._lengths, strict=True)
        return " ".join(repr(value * scale if length else value) for value, length in values)


def line_pattern(line: str) -> re.Pattern[str]:
    """The expression of a stated line, a group for each number."""
    parts = re.split(r"(\{\}|\{\*\}|\s+)", line.strip())
    words = {"{}": _NUMBER, "{*}": ".*?"}
    return re.compile(
        "".join(words.get(part) or (r"\s+" if part.isspace() else re.escape(part)) for part in parts)
    )


def _opened(source: LineSource, folder: Path) -> Bytes:
    if source.tcp is not None:
        return TcpBytes(source.tcp)
    if source.serial is not None:
        return SerialBytes(source.serial.device, source.serial.baud)
    assert source.file is not None
    return FileBytes(folder / source.file)
