"""A simulated PSD amplifier on a pseudo-terminal: to try a sensors file, or a program, without hardware.

POSIX only, as pseudo-terminals are.
"""

import os
import re
import select
import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from zerobeam.experiments.sensors.amplifier import (
    IDENTITY,
    LONGEST,
    MOST_SAMPLES,
    PsdSample,
    sample_line,
    with_checksum,
)
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.whole_file import Closing

_POLL_S = 0.02

_REQUEST = re.compile(rb"R (\d{1,5}) (\d{1,5})")


def parse_request(line: bytes) -> tuple[int, int] | None:
    """Request and number of samples that a line of the computer asks for; None for another line."""
    match = _REQUEST.fullmatch(line.rstrip(b"\r\n"))
    return None if match is None else (int(match[1]), int(match[2]))


@dataclass(frozen=True)
class LineFaults:
    """Faults of a line: shares of its lines, and `silent` for no line at all.

    A `lost` line is not sent, of a `torn` one the end is missing, a `wrong` one has a character changed under
    its checksum, and before some there is `garbage`.
    """

    lost: float = 0.0
    torn: float = 0.0
    wrong: float = 0.0
    garbage: float = 0.0
    silent: bool = False


class AmplifierStandIn(Closing):
    """A simulated amplifier `name` that sends `counts(samples)` (samples, 4); a row of NaN is not sent.

    `device` is the path of its serial port, which goes when it is closed; `faults` may be changed at any
    time.
    """

    def __init__(self, name: str, counts: Callable[[int], Matrix], faults: LineFaults = LineFaults()) -> None:
        import pty
        import tty

        self.name, self.faults, self._counts = name, faults, counts
        self._rng = np.random.default_rng(0)
        self._near, self._far = pty.openpty()
        tty.setraw(self._far)  # no echo, before the other side has set up anything
        os.set_blocking(self._near, False)
        self.device = os.ttyname(self._far)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="amplifier-stand-in", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """The port goes, as if the cable were pulled."""
        if not self._over.is_set():
            self._over.set()
            self._thread.join()
            os.close(self._near)
            os.close(self._far)

    def _serve(self) -> None:
        rest = b""
        while not self._over.is_set():
            if select.select([self._near], [], [], _POLL_S)[0]:
                *lines, rest = (rest + os.read(self._near, LONGEST)).split(b"\n")
                rest = rest[-LONGEST:]
                for line in lines:
                    self._answer(line)

    def _answer(self, line: bytes) -> None:
        request = parse_request(line)
        if line == IDENTITY.rstrip():
            self._say(f"I {self.name}")
        elif request is not None and 1 <= request[1] <= MOST_SAMPLES:
            for index, counts in enumerate(self._counts(request[1])):
                if np.isfinite(counts).all():
                    self._say(
                        sample_line(PsdSample(request[0], index, tuple(int(count) for count in counts)))
                    )

    def _say(self, body: str) -> None:
        line, faults = with_checksum(body), self.faults
        shares = (faults.lost, faults.torn, faults.wrong, faults.garbage)
        lost, torn, wrong, garbage = self._rng.random(4) < shares
        if garbage:
            self._send(self._rng.bytes(5))
        if wrong:
            at = len(body) // 2
            line = line[:at] + bytes([line[at] ^ 1]) + line[at + 1 :]  # a digit becomes another
        if torn:
            line = line[: len(line) // 2]
        if not (lost or faults.silent):
            self._send(line)

    def _send(self, line: bytes) -> None:
        """Wait for room, but not for a client that has gone."""
        while line and not self._over.is_set():
            if select.select([], [self._near], [], _POLL_S)[1]:
                line = line[os.write(self._near, line) :]
