"""The amplifier of one PSD at a serial port: who it is, and its counts.

Lines are ASCII with LF at the end, those of the amplifier with a checksum:

    I                → I NAME*CRC4                      who is there
    R request n      → n lines, each once its sample is taken:
                       D request i x+ x- y+ y-*CRC4     i from 0; four whole numbers, counts of the ADC

A request ends the one before it; what it does not understand the amplifier does not answer. CRC4 is the
CRC-16/IBM-3740 of all before the asterisk, in four hexadecimal digits. The computer's own lines have none:
an answer states what it belongs to.
"""

from __future__ import annotations

import binascii
import os
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ...model.arrays import Matrix
from ...model.errors import RigFault, missing_extra
from ...model.parsing.confinement import require_device

LONGEST = 80  # bytes of a line with its end; what is longer is noise
REQUESTS = 65536  # numbers of requests: from 0, and from 0 again
MOST_SAMPLES = 10_000  # in one request

IDENTITY = b"I\n"
_DATA = re.compile(r"D (\d{1,5}) (\d{1,5})" + r" (-?\d{1,8})" * 4)


@dataclass(frozen=True)
class PsdSample:
    """Sample `index` of a request: counts in the order x+, x-, y+, y-."""

    request: int
    index: int
    counts: tuple[int, ...]


def with_checksum(body: str) -> bytes:
    """A line of the amplifier."""
    checksum = binascii.crc_hqx(body.encode("ascii"), 0xFFFF)
    return f"{body}*{checksum:04X}\n".encode("ascii")


def verified_body(line: bytes) -> str | None:
    """The body of a line of the amplifier, without its end (LF, or CR LF); None if it is torn or changed."""
    body, asterisk, digits = line.rstrip(b"\r\n").rpartition(b"*")
    if not asterisk or re.fullmatch(rb"[0-9A-Fa-f]{4}", digits) is None:
        return None
    if binascii.crc_hqx(body, 0xFFFF) != int(digits, 16):
        return None
    return body.decode("ascii") if body.isascii() else None


def parse_sample(body: str) -> PsdSample | None:
    """The sample of a line; None for another line, and for one with a number too many or too few."""
    data = _DATA.fullmatch(body)
    if data is None:
        return None
    request, index, *counts = (int(number) for number in data.groups())
    return PsdSample(request, index, tuple(counts))


def sample_line(sample: PsdSample) -> str:
    """The line of a sample, without its checksum."""
    return f"D {sample.request} {sample.index} {' '.join(str(count) for count in sample.counts)}"


def request_line(request: int, samples: int) -> bytes:
    """The computer's request for so many samples."""
    return f"R {request} {samples}\n".encode("ascii")


T = TypeVar("T")

# Opening the port restarts many small boards, which takes them a second or two.
_BOOT_S, _ASK_S = 5.0, 0.5
_GRACE_S = 0.5  # beyond the time that the samples take, until those that did not come are lost
_POLL_S = 0.02


class Amplifier:
    """An amplifier that answers, or RigFault; `name` is its own name, `whose` names it in messages."""

    def __init__(self, device: str, baud: int, whose: str) -> None:
        try:
            import serial
        except ImportError:
            raise missing_extra("a PSD amplifier", "psd") from None
        require_device(device)
        self._called = f"{whose} at {device}"
        try:
            self._port = serial.Serial(device, baud, timeout=_POLL_S, write_timeout=_ASK_S, exclusive=True)
        except (OSError, ValueError) as error:
            raise RigFault(
                f"{self._called} cannot be opened: {_why(error)}. Is it plugged in, is the port another "
                "program's, may this user open it?"
            ) from None
        self._request, self._rest = 0, b""
        try:
            self.name = self._identity(baud)
        except BaseException:
            self._port.close()
            raise

    def counts(self, samples: int, rate: float) -> Matrix:
        """(samples, 4) counts, taken from now on at `rate` Hz; NaN in the row of one that did not arrive."""
        self._request = (self._request + 1) % REQUESTS
        self._send(request_line(self._request, samples))
        rows = np.full((samples, 4), np.nan)
        for body in self._bodies(samples / rate + _GRACE_S):
            sample = parse_sample(body)
            # What an earlier request is still answered is older than the motion before this one.
            if sample is None or sample.request != self._request or sample.index >= samples:
                continue
            rows[sample.index] = sample.counts
            if sample.index == samples - 1:  # they come in their order: what is missing is lost
                break
        return rows

    def close(self) -> None:
        self._port.close()

    def _identity(self, baud: int) -> str:
        ends = time.monotonic() + _BOOT_S
        while time.monotonic() < ends:
            self._send(IDENTITY)
            for body in self._bodies(_ASK_S):
                if body.startswith("I "):
                    return body[2:]
        raise RigFault(
            f"{self._called} does not identify itself: is it on, is it set to {baud} baud, is it this port?"
        )

    def _send(self, line: bytes) -> None:
        self._tried(lambda: self._port.write(line))

    def _bodies(self, seconds: float) -> Iterator[str]:
        """Its lines in the time to come; torn or corrupted ones are ignored."""
        ends = time.monotonic() + seconds
        while time.monotonic() < ends:
            self._rest += self._tried(lambda: self._port.read(self._port.in_waiting or 1))
            *lines, self._rest = self._rest.split(b"\n")
            self._rest = self._rest[-LONGEST:]
            for line in lines:
                body = verified_body(line)
                if body is not None:
                    yield body

    def _tried(self, call: Callable[[], T]) -> T:
        try:
            return call()
        except OSError as error:  # pyserial's own is one
            raise RigFault(
                f"{self._called} is gone ({_why(error)}): look at its cable and its supply, then go on with "
                "--resume"
            ) from None


def _why(error: OSError | ValueError) -> str:
    """Why a call of the port failed, without pyserial's repetitions."""
    number = getattr(error, "errno", None)
    return os.strerror(number) if number else str(error)
