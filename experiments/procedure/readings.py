"""Readings that can be trusted: PSD samples that arrived and are no ambient light, joints read alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...model.arrays import Matrix
from ..sensors.psd import Psd
from .rig import MeasurementRefused, RefusalReason, Rig

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
