"""Readings that can be trusted: lost samples, ambient light, saturation, joints that are read wrong."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import stats

from zerobeam.experiments.procedure.rig import (
    MeasurementRefused,
    RefusalReason,
    read_dark,
    read_joints,
    read_spot,
)
from zerobeam.experiments.rigs.simulated.simulator import SimulatedPsd
from zerobeam.experiments.sensors.detectors import Psd

PSD = Psd(20.0, "duo-lateral", 200.0, 0.01, 2.0, np.zeros((2, 3)), None, 0.0)
AMBIENT = 0.3
TOLERANCE = np.array([0.001, 0.002])


class ScriptedRig:
    """A rig whose PSD and joints give what a test says; the laser is what makes the spot."""

    def __init__(self, hit: Any = (2.0, -3.0), light: float = 1.0, seed: int = 0) -> None:
        self.hit, self.light = np.array(hit), light
        self.on, self.waited = True, 0.0
        self.lost: Callable[[int], np.ndarray] = lambda samples: np.zeros(samples, dtype=bool)
        self.read = [np.zeros(2)] * 3
        self._rng = np.random.default_rng(seed)
        self._device = SimulatedPsd(PSD, 0.5, 0.0, AMBIENT, 0.0)

    def laser(self, on: bool) -> None:
        self.on = on

    def wait(self, seconds: float) -> None:
        self.waited += seconds

    def currents(self, samples: int) -> np.ndarray:
        currents = self._device.currents(self.hit if self.on else None, self.light, samples, self._rng)
        currents[self.lost(samples)] = np.nan
        return currents

    def joints(self) -> np.ndarray:
        return self.read.pop(0)


def spot_of(rig: Any, samples: int = 200) -> Any:
    dark = read_dark(rig, PSD, 20000)
    rig.laser(True)
    return read_spot(rig, PSD, dark, samples)


def test_the_ambient_light_is_taken_off() -> None:
    spot = spot_of(ScriptedRig())
    np.testing.assert_allclose(spot.position, [2.0, -3.0], atol=5 * 0.015 / np.sqrt(200))
    assert spot.light == pytest.approx(1.0, abs=1e-3)
    # The control: with it the spot is drawn to the centre, by its share of all light.
    drawn = read_spot(ScriptedRig(), PSD, np.zeros(4), 200)  # type: ignore[arg-type]
    np.testing.assert_allclose(drawn.position, np.array([2.0, -3.0]) / (1 + AMBIENT), atol=0.01)


@pytest.mark.parametrize("light", [1.0, 0.25])
def test_the_stated_std_is_that_of_the_readings(light: float) -> None:
    """At the centre, also in weak light: 400 readings of 2 numbers."""
    rig: Any = ScriptedRig((0.0, 0.0), light)
    dark = read_dark(rig, PSD, 200000)
    rig.laser(True)
    spots = [read_spot(rig, PSD, dark, 20) for _ in range(400)]
    low, high = stats.chi2.ppf([0.0005, 0.9995], 800)
    assert low < sum(((spot.position / spot.std) ** 2).sum() for spot in spots) < high
    # From half to half: as procedures take it, 2 stds.
    assert low < sum(((spot.drift / (2 * spot.std)) ** 2).sum() for spot in spots) < high


def test_a_spot_that_drifts_shows_it() -> None:
    rig: Any = ScriptedRig()
    still = rig.currents

    def drifting(samples: int) -> np.ndarray:
        ahead = still(samples)
        rig.hit = rig.hit + np.array([0.4, 0.0])
        return np.concatenate([ahead[: samples // 2], still(samples)[samples // 2 :]])

    dark = read_dark(rig, PSD, 2000)
    rig.laser(True)
    rig.currents = drifting
    np.testing.assert_allclose(read_spot(rig, PSD, dark, 200).drift, [0.4, 0.0], atol=0.01)


def test_lost_samples_are_left_out() -> None:
    rig = ScriptedRig()
    rig.lost = lambda samples: np.arange(samples) % 3 == 0
    np.testing.assert_allclose(spot_of(rig).position, [2.0, -3.0], atol=0.01)
    assert rig.waited == 0


def test_a_link_that_comes_back_is_waited_for() -> None:
    rig, calls = ScriptedRig(), iter(range(100))
    rig.lost = lambda samples: np.full(samples, next(calls) < 3)
    np.testing.assert_allclose(spot_of(rig).position, [2.0, -3.0], atol=0.01)
    assert 0 < rig.waited < 2


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_a_link_that_stays_down_is_a_reason(share: float) -> None:
    rig = ScriptedRig()
    rig.lost = lambda samples: np.arange(samples) < share * samples
    with pytest.raises(MeasurementRefused) as refused:
        spot_of(rig)
    assert refused.value.reason == RefusalReason.NO_SIGNAL
    assert rig.waited == pytest.approx(2.0)


def test_too_much_light_is_a_reason() -> None:
    """All of the light of a spot at the edge goes into one electrode, and that of the surroundings."""
    edge = (9.0, 0.0)
    assert spot_of(ScriptedRig(edge, 1.8)).light == pytest.approx(1.8, abs=0.01)
    assert abs(spot_of(ScriptedRig(light=0.0)).light) < 1e-3  # no light is no spot, and no error
    with pytest.raises(MeasurementRefused) as refused:
        spot_of(ScriptedRig(edge, 2.0))
    assert refused.value.reason == RefusalReason.SATURATED


def joints_read(*readings: Any) -> np.ndarray:
    rig: Any = ScriptedRig()
    rig.read = [np.array(each) for each in readings]
    return read_joints(rig, np.zeros(2), TOLERANCE)


def test_joints_are_the_middle_of_what_is_read() -> None:
    read = joints_read([0.0, 0.0], [0.0004, 0.0004], [-0.0002, -0.0002])
    np.testing.assert_array_equal(read, [0.0, 0.0])


OFF = (0.0, 0.003)
WRONG = "joint 2 does not read the position it was sent"


@pytest.mark.parametrize(
    ("off", "what"), [({0}, "joint 2"), ({1}, "joint 2"), ({2}, "joint 2"), ({0, 1, 2}, WRONG)]
)
def test_a_reading_that_is_off_is_a_reason(off: set[int], what: str) -> None:
    with pytest.raises(MeasurementRefused, match=what) as refused:
        joints_read(*(OFF if k in off else (0.0, 0.0) for k in range(3)))
    assert refused.value.reason == RefusalReason.READING
