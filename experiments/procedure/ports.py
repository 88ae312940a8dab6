"""The four ports of a session: *move to*, *confirm*, *joints* and *reading*; what ends a measurement early.

    BeamPorts (any rig)   drives and servoes   at rest, alike, steady   read             the spot
    HandPorts, typed      asks a person        a line, a growing file   in that line     typed, or sent
    HandPorts, live       asks a person        Enter, or the PSD        read at rest     typed, or sent
    Rehearsal (no beam)   nothing moves        at once                  simulated        simulated

The session decides which measurement is next, how often it is tried, what is recorded, given up, taken back
and repeated, and when the run ends. Ports keep nothing from one measurement to the next but their clock.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType

from ...model.arrays import Matrix
from ...model.files.plan import Plan
from ...model.files.shot import Shot
from ...model.likelihood.problem import Problem
from .events import Listener
from .rig import MeasurementRefused, RefusalReason

# What a measurement records beside its joints, by key of the run file.
Reading = Mapping[str, float | tuple[float, ...] | str | None]


class Skipped(MeasurementRefused):
    """A person gives measurement `number` up; before the posture is confirmed, all that are made there."""

    def __init__(self, number: int, why: str) -> None:
        super().__init__(RefusalReason.SKIPPED, why)
        self.number = number


class TakenBack(Exception):
    """A person wants the recorded measurement `number` repeated, with all that were made at its posture."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


class Paused(Exception):
    """No more lines come, or the person wants to go on later."""


class Ports(ABC):
    """What carries out the measurements of `plan`; `listener` is called with what happens, as events.

    A measurement is given up after so many `attempts` that were refused. Where `repeats`, who measures hears
    which measurement contradicts the others. What is known so far is found out after every so many (`every`).
    `seconds` of this session are by phase, empty where nobody measures them; `problem` is the plan's. Every
    method may raise RigFault, which ends the run. What is not overridden has nothing to do; each set of ports
    has to say how it stops.
    """

    plan: Plan
    problem: Problem
    listener: Listener
    attempts = 1
    repeats = False
    every = 1
    seconds: Mapping[str, float] = MappingProxyType({})

    def together(self, number: int) -> tuple[int, ...]:
        """The measurements that are made at the posture of `number`, in their order."""
        return (number,)

    def begin(self, number: int, recorded: Sequence[Shot], refused: Collection[int]) -> None:  # noqa: B027
        """Measurement `number` is coming: what is recorded and refused so far is all that it depends on."""

    def move_to(self, number: int, attempt: int) -> None:  # noqa: B027
        """Bring the arm to the posture, or ask for that; MeasurementRefused where that cannot be."""

    def confirm(self, number: int) -> int:
        """Return once the arm is where the measurement is to be made: its number, or that of another one in
        whose posture the arm is. MeasurementRefused, Skipped, TakenBack or Paused where it is not."""
        return number

    @abstractmethod
    def joints(self) -> Matrix:
        """(n,) deg (mm) the joints that were confirmed."""

    @abstractmethod
    def reading(self, number: int) -> Reading:
        """What is read there; as `confirm` where it is not."""

    def moved(self, number: int) -> bool:
        """Whether the arm has moved since it was confirmed, which is said: then it is asked for again."""
        return False

    def now(self) -> float | None:
        """Seconds since the start of the run; None where no clock runs."""
        return None

    @abstractmethod
    def stop(self) -> None:
        """Stop the motion, switch the laser off; safe at any moment, more than once."""
