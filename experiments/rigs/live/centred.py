"""A posture is confirmed by the PSD: the beam rests on its centre."""

from __future__ import annotations

import time

import numpy as np

from ....interruption import obey
from ....model.arrays import Matrix
from ...procedure.centring import ACCEPTED_MM
from ...procedure.events import MeasurementRecorded, RunEvent
from ...sensors.controller_sensors import Sensors
from ...sensors.psd import BRIGHTEST, WEAKEST

_SAMPLES = 50
_LEFT_MM = 1.0  # a spot that has been this far off has left the centre
_PAUSE_S = 0.5


class CentredLines:
    """An empty line whenever the spot is on the centre of the PSD `target`; it has to leave the centre after
    a measurement was recorded. `dark` (4,) are the currents with the laser off."""

    confirms, follows = False, True

    def __init__(self, sensors: Sensors, target: str, dark: Matrix) -> None:
        self._sensors, self._target, self._dark = sensors, target, dark
        self._left = True

    def hear(self, event: RunEvent) -> None:
        """Told of every event of the run."""
        if isinstance(event, MeasurementRecorded):
            self._left = False

    def following(self) -> str | None:
        while True:
            obey()
            off = self._off()
            if off > _LEFT_MM:
                self._left = True
            if self._left and off <= ACCEPTED_MM:
                time.sleep(_PAUSE_S)
                if self._off() <= ACCEPTED_MM:
                    return ""

    def _off(self) -> float:
        """mm from the centre; infinite where the light is not the beam's."""
        psd, samples = self._sensors.psds[self._target], currents_of(self._sensors, self._target)
        if samples is None or psd.saturated(samples).any():
            return np.inf
        mean = samples.mean(axis=0) - self._dark
        if not WEAKEST <= psd.light(mean) <= BRIGHTEST:
            return np.inf
        return float(np.linalg.norm(psd.position(mean)))


def currents_of(sensors: Sensors, target: str) -> Matrix | None:
    """(m, 4) the samples that arrived, if more than half of them did."""
    currents = sensors.currents(target, _SAMPLES)
    sound = currents[np.isfinite(currents).all(axis=1)]
    return sound if 2 * len(sound) > _SAMPLES else None
