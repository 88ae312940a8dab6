"""A rig: an arm with a laser, a PSD and perhaps a camera; how it is read; and why a measurement with it is
refused."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

import numpy as np

from ...model.arrays import Matrix
from ...model.files.shot import Shot
from ..sensors.detectors import Camera, Image, Psd


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


_PATIENCE = 8  # readings of which most is lost before the link counts as down
_BETWEEN = 0.25  # s, while waiting for it
_JOINT_READINGS = 3


@dataclass(frozen=True, eq=False)
class Spot:
    """Where the laser's light is on a PSD: `position` (2,) mm, `std` (2,) mm of that mean, `light` as a share
    of the laser's full light, `drift` (2,) mm from the first half of the samples to the second."""

    position: Matrix
    std: Matrix
    light: float
    drift: Matrix


def arrived(rig: Rig, psd: Psd, samples: int) -> Matrix:
    """(m, 4) those of `samples` currents that arrive, more than half.

    MeasurementRefused where the link stays down, or where they are saturated.
    """
    for _ in range(_PATIENCE):
        sound = most(rig.currents(samples), samples)
        if sound is not None:
            break
        rig.wait(_BETWEEN)
    else:
        raise MeasurementRefused(RefusalReason.NO_SIGNAL, "most samples of the PSD do not arrive")
    if psd.saturated(sound).any():
        raise MeasurementRefused(RefusalReason.SATURATED, "the PSD is saturated: shade it, or dim the laser")
    return sound


def most(currents: Matrix, samples: int) -> Matrix | None:
    """(m, 4) those of so many samples that arrived, if more than half of them did."""
    sound = currents[np.isfinite(currents).all(axis=1)]
    return np.asarray(sound) if 2 * len(sound) > samples else None


def read_dark(rig: Rig, psd: Psd, samples: int) -> Matrix:
    """(4,) currents with the laser off: the ambient light's, to be taken off every reading."""
    rig.laser(False)
    return np.asarray(arrived(rig, psd, samples).mean(axis=0))


def read_spot(rig: Rig, psd: Psd, dark: Matrix, samples: int) -> Spot:
    """The laser's spot, without the ambient light."""
    return spot_of(psd, arrived(rig, psd, samples) - dark)


def spot_of(psd: Psd, currents: Matrix) -> Spot:
    """By currents (m, 4) of the laser alone."""
    mean = currents.mean(axis=0)
    half = len(currents) // 2
    first, second = currents[:half].mean(axis=0), currents[half:].mean(axis=0)
    light = float(psd.light(mean))
    return Spot(
        position=psd.position(mean),
        # Noise of the currents does not change with the light; that of the position does.
        std=np.full(2, psd.noise / max(light, 1e-9) / np.sqrt(len(currents))),
        light=light,
        drift=psd.position(second) - psd.position(first),
    )


def read_joints(rig: Rig, sent: Matrix, tolerance: Matrix) -> Matrix:
    """(n,) the joints as read several times, alike, and where the arm was sent to; else MeasurementRefused.

    `tolerance` (n,) rad or mm is how far readings may be from each other and from `sent`.
    """
    readings = np.array([rig.joints() for _ in range(_JOINT_READINGS)])
    middle = np.median(readings, axis=0)
    apart = np.abs(readings - middle).max(axis=0)
    if (apart > tolerance).any():
        joint = int(np.argmax(apart / tolerance))
        raise MeasurementRefused(
            RefusalReason.READING, f"joint {joint + 1} was read differently while the arm was at rest"
        )
    off = np.abs(middle - sent)
    if (off > tolerance).any():
        joint = int(np.argmax(off / tolerance))
        raise MeasurementRefused(
            RefusalReason.READING, f"joint {joint + 1} does not read the position it was sent to"
        )
    return np.asarray(middle)
