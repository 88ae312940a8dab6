"""A rig: an arm with a laser, a PSD and perhaps a camera; and why a measurement with it is refused."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from ...model.arrays import Matrix
from ...model.files.shot import Shot
from ..sensors.camera import Camera, Image
from ..sensors.psd import Psd


class RefusalReason(StrEnum):
    """Reasons why a measurement is not recorded."""

    OUT_OF_VIEW = "marker out of view"
    CAMERA = "camera"
    OFF_FACE = "beam off the face"
    NO_SIGNAL = "no signal"
    SATURATED = "saturated"
    TOO_WEAK = "too weak"
    TOO_BRIGHT = "too bright"
    NOT_FOLLOWING = "light does not follow the arm"
    LIMIT = "joint limit"
    NOT_CONVERGING = "not converging"
    UNSTEADY = "unsteady"
    READING = "joint reading"
    SKIPPED = "skipped"


class MeasurementRefused(Exception):
    """A measurement cannot be made from here; the next attempt, or the next posture, may do better."""

    def __init__(self, reason: RefusalReason, why: str) -> None:
        self.reason = reason
        self.why = why
        super().__init__(f"{reason}: {why}")


@dataclass(frozen=True)
class RefusedPosture:
    """A posture from which no measurement was recorded, and why."""

    shot: int
    reason: RefusalReason
    found: str


class Rig(Protocol):
    """The interface of a rig: its motions and its sensors.

    `psds` are the PSDs by the name of the target that each one is, `camera` is None where there is none,
    `steerable` is False where the arm cannot be led (a recorded run). Joint positions are (n,) rad or mm as
    the controller counts them. Every method may raise RigFault, which ends the run.
    """

    psds: Mapping[str, Psd]
    camera: Camera | None
    steerable: bool

    def now(self) -> float:
        """Seconds since the start of the run."""
        ...

    def wait(self, seconds: float) -> None:
        """Let so much time pass."""
        ...

    def begin(self, shot: int, target: str, last: Shot | None) -> None:
        """Say which measurement is coming, at which target, and which was recorded last (None: none yet)."""
        ...

    def move(self, joints: Matrix) -> None:
        """Drive all joints there at the cell's speed; returns when the arm is at rest."""
        ...

    def joints(self) -> Matrix:
        """(n,) joint positions as read."""
        ...

    def currents(self, samples: int) -> Matrix:
        """(samples, 4) of the PSD, one after another; a sample that did not arrive is a row of NaN."""
        ...

    def image(self) -> Image:
        """(height, width) grey values of the camera, 0 to 255."""
        ...

    def laser(self, on: bool) -> None:
        """Switch the laser."""
        ...

    def stop(self) -> None:
        """Stop the motion and switch the laser off; safe at any moment, more than once."""
        ...
