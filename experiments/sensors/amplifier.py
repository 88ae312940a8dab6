"""The amplifier of one PSD at a serial port: who it is, and its counts."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from typing import TypeVar

import numpy as np

from ...model.arrays import Matrix
from ...model.errors import RigFault, missing_extra
from ...model.files.confinement import require_device
from .line import IDENTITY, LONGEST, REQUESTS, asking, heard, sample_of

T = TypeVar("T")

# Opening the port restarts many small boards, which takes them a second or two.
_BOOT_S, _ASK_S = 5.0, 0.5
_GRACE_S = 0.5  # beyond the time that the samples take, until those that did not come are lost
_POLL_S = 0.02


class Amplifier:
    """It answers, or RigFault; `name` is what it calls itself, `whose` calls it in messages."""

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
        self._send(asking(self._request, samples))
        rows = np.full((samples, 4), np.nan)
        for body in self._bodies(samples / rate + _GRACE_S):
            sample = sample_of(body)
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
                body = heard(line)
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
