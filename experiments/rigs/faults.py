"""What goes wrong on purpose in the simulated cell, and when."""

from __future__ import annotations

import os
import signal
from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from ...model.robot import Matrix
from .cell_file import Fault, ProcessKilled, PsdBump, RobotStop

Kind = TypeVar("Kind", bound=Fault)


class Faults:
    """The schedule of one run. One that is `resumed` does not meet again in its first shot what had stopped
    it: a stop of the robot, the end of the process."""

    def __init__(self, schedule: Sequence[Fault], *, resumed: bool = False) -> None:
        self._schedule = tuple(schedule)
        self._resumed = resumed
        self._shot = -1
        self._calls = 0
        self._met: dict[int, int] = {}

    def begin(self, shot: int) -> None:
        """Faults of this shot begin."""
        if self._resumed:
            self._resumed = False
            self._schedule = tuple(
                fault
                for fault in self._schedule
                if not (isinstance(fault, RobotStop | ProcessKilled) and fault.shot == shot)
            )
        self._shot, self._calls = shot, 0
        self._met.clear()

    def called(self) -> None:
        """Count one use of the rig; the process may end here."""
        self._calls += 1
        for fault in self._schedule:
            if isinstance(fault, ProcessKilled) and (fault.shot, fault.call) == (self._shot, self._calls):
                os.kill(os.getpid(), signal.SIGKILL)

    def met(self, kind: type[Kind]) -> Kind | None:
        """The fault of that kind that is on now, once more met; None if there is none, or no longer."""
        for i, fault in enumerate(self._schedule):
            if not isinstance(fault, kind) or fault.shot != self._shot:
                continue
            self._met[i] = self._met.get(i, 0) + 1
            lasts = getattr(fault, "lasts", None)
            if lasts is None or self._met[i] <= lasts:
                return fault
        return None

    def bumped(self) -> Matrix:
        """(3,) mm by which the PSD has been moved up to this shot."""
        shifts = [f.shift_mm for f in self._schedule if isinstance(f, PsdBump) and f.shot <= self._shot]
        return np.sum([np.zeros(3), *map(np.array, shifts)], axis=0)
