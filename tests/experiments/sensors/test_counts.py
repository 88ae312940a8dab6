"""From counts to currents, and what the sums of real counts lead to."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from beside import calibrated, calibration, write

from zerobeam.experiments.rigs.simulated.sensing import SimulatedPsd
from zerobeam.experiments.sensors.psd import Psd, PsdKind
from zerobeam.experiments.sensors.sensors_file import PsdCalibration, read_calibration

KINDS: tuple[PsdKind, PsdKind] = ("duo-lateral", "tetra-lateral")
PLAIN: dict[str, Any] = {"dark_counts": [100.0] * 4, "gains": [1.0] * 4, "full_light_counts": 4000.0}


def test_a_known_answer() -> None:
    """A spot in the middle between centre and edge of a duo-lateral PSD, at full light; counts by hand."""
    own = calibrated(
        dark_counts=[100.0, 0.5, 10.0, 10.0], gains=[1.0, 2.0, 1.0, 1.0], full_light_counts=4000.0
    )
    counts = np.array([1600.0, 250.5, 1010.0, 1010.0])
    np.testing.assert_allclose(own.currents(counts, "duo-lateral"), [0.75, 0.25, 0.5, 0.5])
    sheet = Psd(20.0, "duo-lateral", 200.0, 0.01, 2.0, np.zeros((2, 3)), None, 0.0)
    np.testing.assert_allclose(sheet.position(own.currents(counts, "duo-lateral")), [5.0, 0.0])
    assert sheet.light(own.currents(counts, "duo-lateral")) == pytest.approx(1.0)
    # Controls: without the dark counts, and without the gain, the spot is elsewhere.
    for changed in ({"dark_counts": [1e-9] * 4}, {"gains": [1.0] * 4}):
        wrong = own.model_copy(update={key: tuple(value) for key, value in changed.items()})
        assert abs(sheet.position(wrong.currents(counts, "duo-lateral"))[0] - 5.0) > 0.2


@pytest.mark.parametrize("kind", KINDS)
def test_full_light_is_full_light_for_both_kinds(kind: PsdKind) -> None:
    own = calibrated(**PLAIN)
    sheet = Psd(20.0, kind, 200.0, 0.01, own.saturation(kind), np.zeros((2, 3)), None, 0.0)
    assert sheet.light(own.currents(np.full(4, 1100.0), kind)) == pytest.approx(1.0)
    # What the physics of that kind sends at full light is read as full light.
    device = SimulatedPsd(sheet, 0.5, 0.0, 0.0, 0.0)
    counts = own.counts(device.currents(np.zeros(2), 1.0, 4000, np.random.default_rng(0)), kind)
    assert sheet.light(own.currents(counts, kind).mean(axis=0)) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_counts_and_currents_go_both_ways(kind: PsdKind) -> None:
    own = calibrated()
    currents = np.random.default_rng(1).uniform(0.0, 1.0, (50, 4))
    np.testing.assert_allclose(own.currents(own.counts(currents, kind), kind), currents, atol=1e-6)


@pytest.mark.parametrize("electrode", range(4))
def test_whichever_electrode_is_saturated_it_is_noticed(electrode: int) -> None:
    own = calibrated()
    sheet = Psd(20.0, "duo-lateral", 200.0, 0.01, own.saturation("duo-lateral"), np.zeros((2, 3)), None, 0.0)
    counts = np.full((1, 4), 1e6)
    assert not sheet.saturated(own.currents(counts, "duo-lateral"))
    counts[0, electrode] = own.saturation_counts[electrode]
    assert sheet.saturated(own.currents(counts, "duo-lateral"))


def test_a_calibration_file_is_read(tmp_path: Path) -> None:
    file = write(tmp_path / "a.yaml", calibration())
    read = read_calibration(file)
    assert read.model_dump() == calibrated().model_dump()
    assert read.sha256 == hashlib.sha256(file.read_bytes()).hexdigest()


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"dark_counts": [0.0, 5.0, 5.0, 5.0]}, "electrode 1"),
        ({"dark_counts": [5.0, 5.0, 8e6, 5.0]}, "electrode 3"),
        ({"gains": [1.0, 1.0, 0.0, 1.0]}, "item 3 of gains"),
        ({"gains": [1.0, 1.0]}, "4 values"),
        ({"full_light_counts": -1.0}, "full_light_counts"),
        ({"saturation_counts": [1.5, 2, 3, 4]}, "whole number"),
        ({"grid": []}, "unknown key 'grid'"),
        ({"schema": "zerobeam/sensors/1"}, "not a psd-calibration file"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path: Path, refused: Any, changed: dict[str, Any], told: str) -> None:
    file = write(tmp_path / "a.yaml", calibration(**changed))
    error = refused(read_calibration, file)
    assert told in str(error)
    assert error.line is not None


@pytest.mark.parametrize("key", sorted(set(PsdCalibration.model_fields) - {"schema_"}))
def test_nothing_is_guessed(tmp_path: Path, refused: Any, key: str) -> None:
    content = calibration()
    del content[key]
    assert f"{key!r} is missing" in str(refused(read_calibration, write(tmp_path / "a.yaml", content)))
