"""What goes wrong on purpose in the simulated cell, and when."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from ....model.robot import Matrix
from .cell_file import AnyFault, ProcessKilled, PsdBump, RobotStop

Kind = TypeVar("Kind", bound=AnyFault)

# On Windows any signal ends a process at once, and this one has no name there.
_KILL = signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL


class Faults:
    """The schedule of one run.

    One that is `resumed` does not meet again what stopped it, a stop of the robot or the end of the process:
    until a shot has been recorded there are none. (The shot that was stopped need not be the first: those
    that were refused before it are tried again.)
    """

    def __init__(self, schedule: Sequence[AnyFault], *, resumed: bool = False) -> None:
        self._schedule = tuple(schedule)
        self._resumed = resumed
        self._first: tuple[int | None] | None = None
        self._shot = -1
        self._on: tuple[AnyFault, ...] = ()
        self._calls = 0
        self._met: list[int] = []

    def begin(self, shot: int, last: int | None) -> None:
        """Faults of this shot begin; `last` is the number of the shot that was recorded last (None: none)."""
        self._first = self._first or (last,)
        stopped_before = self._resumed and self._first == (last,)
        self._shot, self._calls = shot, 0
        self._on = tuple(
            fault
            for fault in self._schedule
            if fault.shot == shot and not (stopped_before and isinstance(fault, RobotStop | ProcessKilled))
        )
        self._met = [0] * len(self._on)

    def called(self) -> None:
        """Count one use of the rig; the process may end here."""
        self._calls += 1
        if any(isinstance(fault, ProcessKilled) and fault.call == self._calls for fault in self._on):
            os.kill(os.getpid(), _KILL)

    def met(self, kind: type[Kind]) -> Kind | None:
        """The fault of that kind that is on now, once more met; None if there is none, or no longer."""
        for i, fault in enumerate(self._on):
            if isinstance(fault, kind):
                self._met[i] += 1
                lasts = getattr(fault, "lasts", None)
                if lasts is None or self._met[i] <= lasts:
                    return fault
        return None

    def bumped(self) -> Matrix:
        """(3,) mm by which the PSDs have been moved up to this shot."""
        shifts = [f.shift_mm for f in self._schedule if isinstance(f, PsdBump) and f.shot <= self._shot]
        return np.asarray(np.reshape(shifts, (-1, 3)).sum(axis=0))
