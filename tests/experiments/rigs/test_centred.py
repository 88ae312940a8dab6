"""A posture is confirmed by the PSD: once for each time that the beam comes to rest on its centre."""

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from amplifier_stand_in import AmplifierStandIn
from beside import calibrated, psd, sensors
from command_line import zerobeam
from live_controllers import LiveArm, UrStandIn

from zerobeam.experiments.procedure.events import MeasurementRecorded, Withdrawn
from zerobeam.experiments.rigs import at_rest
from zerobeam.experiments.rigs.at_rest import CentredLines
from zerobeam.experiments.sensors.detectors import Camera, Image, Psd
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.run import read_run

SHEET = Psd(20.0, "duo-lateral", 1000.0, 0.0005, 4.0, np.zeros((2, 3)), None, 0.0)
AMBIENT = np.array([0.3, 0.0, 0.0, 0.0])


class Spot:
    """A PSD on which the spot goes through positions in mm and light: one after another as they are read."""

    psds: Mapping[str, Psd] = {"psd": SHEET}
    camera: Camera | None = None

    def __init__(self, *states: tuple[float, float]) -> None:
        self._states = list(states)
        self.read = 0

    def currents(self, target: str, samples: int) -> Matrix:
        x, light = self._states[min(self.read, len(self._states) - 1)]
        self.read += 1
        share = x / (SHEET.size / 2)
        row = light * np.array([1 + share, 1 - share, 1.0, 1.0]) / 2 + AMBIENT
        return np.tile(row, (samples, 1))

    def image(self, target: str) -> Image:
        raise AssertionError


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(at_rest, "_PAUSE_S", 0.0)


RECORDED = MeasurementRecorded(0, "psd", None, 0.0, 1, {}, None, None, True)


def test_a_spot_that_comes_to_rest_on_the_centre_confirms() -> None:
    """Off the face, near it, passing the centre, too weak, with a second light, then at rest."""
    states = [
        (0.0, 0.0),
        (5.0, 1.0),
        (0.0, 1.0),
        (3.0, 1.0),
        (0.0, 0.4),
        (0.0, 1.2),
        (0.04, 1.0),
        (0.04, 1.0),
    ]
    spot = Spot(*states)
    lines = CentredLines(spot, "psd", AMBIENT)
    assert lines.following() == ""
    assert spot.read == len(states)


def test_it_has_to_leave_after_a_measurement_and_not_after_a_refusal() -> None:
    spot = Spot(
        (0.0, 1.0),
        (0.0, 1.0),
        (0.0, 1.0),
        (0.0, 1.0),
        (0.0, 1.0),
        (0.5, 1.0),
        (0.0, 1.0),
        (1.5, 1.0),
        (0.0, 1.0),
    )
    lines = CentredLines(spot, "psd", AMBIENT)
    lines.following()
    lines.hear(Withdrawn(0))
    lines.following()
    assert spot.read == 4
    lines.hear(RECORDED)
    lines.following()
    assert spot.read == 10  # 0.5 mm is not away, 1.5 mm is


def test_ambient_light_that_was_not_measured_would_shift_the_centre() -> None:
    """The control: with it in the reading the spot on the centre seems to be off."""
    lines = CentredLines(Spot((0.0, 1.0)), "psd", np.zeros(4))
    assert lines._off() > 1.0


POSTURES = [[20.0, -80.0, 70.0, -40.0, 60.0, 10.0], [-10.0, -60.0, 50.0, -20.0, 40.0, 30.0]]


def test_a_live_run_that_the_psd_confirms(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Dark, on the centre twice, away while the arm goes on, and on the centre again."""
    (tmp_path / "plan.yaml").write_text(
        "schema: zerobeam/plan/1\nrobot: ur5e\ngeometry: exact\n"
        "tool: {kind: laser, point_mm: [0, 0, 65], direction: [0, 0, 1]}\n"
        "noise: {joint_deg: 0.01, spot_mm: 0.05}\ntargets: {psd: {guess_mm: [600, 0, 0], sigma_mm: 500}}\n"
        f"postures_deg: {POSTURES}\n"
    )
    arm, readings = LiveArm(POSTURES[0]), 0

    def counts(samples: int) -> Matrix:
        nonlocal readings
        readings += 1
        x, light = {1: (0.0, 0.0), 4: (5.0, 1.0)}.get(readings, (0.0, 1.0))
        if readings == 4:
            arm.go(POSTURES[1], 0.01)
        share = x / (SHEET.size / 2)
        row = light * np.array([1 + share, 1 - share, 1.0, 1.0]) / 2 + 0.1 * AMBIENT
        return np.tile(calibrated().counts(row, "duo-lateral"), (samples, 1))

    monkeypatch.setattr("sys.stdin", io.StringIO("\n"))
    with AmplifierStandIn("PSD-A 0017", counts) as amplifier, UrStandIn(arm) as server:
        file = sensors(tmp_path, psds={"psd": psd(amplifier.device, normal="beam")})
        how = ["--rig", server.url, "--sensors", file, "-o", tmp_path / "run.jsonl"]
        answer = zerobeam("run", tmp_path / "plan.yaml", *how)
    assert "Switch the laser off" in answer.err
    run = read_run(tmp_path / "run.jsonl")
    assert [shot.shot for shot in run.shots] == [0, 1], answer.err
    for shot, posture in zip(run.shots, POSTURES, strict=True):
        np.testing.assert_allclose(shot.joints_deg, posture, atol=1e-9)
    assert {"sensors sha256", "controller"} <= set(run.header.provenance)
