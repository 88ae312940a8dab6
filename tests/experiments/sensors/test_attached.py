"""Shots of the procedure by a PSD at a pseudo-terminal: light of the simulated cell, through real counts."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from amplifier_stand_in import AmplifierStandIn, LineFaults
from beside import RATE, calibrated, psd, sensors
from cells import good_plan

from zerobeam.experiments.procedure.beam_ports import BeamPorts
from zerobeam.experiments.procedure.rig import RefusalReason, read_dark, read_spot
from zerobeam.experiments.procedure.session import InTurn, Session, SessionResult
from zerobeam.experiments.procedure.steering import LIT
from zerobeam.experiments.rigs.simulated.cell_file import CellFile
from zerobeam.experiments.rigs.simulated.simulator import SimulatedRig
from zerobeam.experiments.sensors import amplifier
from zerobeam.experiments.sensors.attached import read_sensors
from zerobeam.experiments.studies.cell import MemoryJournal
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.plan import Plan

pytest.importorskip("serial")
pytest.importorskip("pty")

SEED = 3
SOUND = LineFaults()
OWN = calibrated()


@pytest.fixture(autouse=True)
def _patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A busy computer is no fault."""
    monkeypatch.setattr(amplifier, "_GRACE_S", 10.0)


def cell_rig(plan: Plan, **cell: Any) -> SimulatedRig:
    """No camera, and a link that loses nothing but what is asked for."""
    stated = {"camera": None, "psd": {"lost": 0.0}, **cell}
    return SimulatedRig(plan, CellFile.model_validate(stated), SEED)


def carried(plan: Plan, rig: SimulatedRig) -> SessionResult:
    ports = BeamPorts(plan, rig, lambda event: None)
    return Session(ports, MemoryJournal(), InTurn(len(plan.postures))).carry_out()


def through_counts(
    folder: Path,
    plan: Plan,
    faults: LineFaults = SOUND,
    spoilt: Callable[[Matrix], Matrix] = lambda counts: counts,
    **cell: Any,
) -> SessionResult:
    """The same, with the currents as counts over a pseudo-terminal, by a sensors file."""
    rig = cell_rig(plan, **cell)
    seen = rig.currents
    normal = rig.psds["psd"].normal

    def counts(samples: int) -> Matrix:
        return spoilt(OWN.counts(seen(samples), "duo-lateral"))

    with AmplifierStandIn("PSD-A 0017", counts) as there:
        own = psd(there.device, turn_deg=0.0, normal="beam" if normal is None else normal.tolist())
        beside = read_sensors(sensors(folder, psds={"psd": own}), plan)
        there.faults = faults
        rig.psds = beside.psds
        rig.currents = lambda samples: beside.currents("psd", samples)  # type: ignore[method-assign]
        try:
            return carried(plan, rig)
        finally:
            beside.close()


def test_shots_are_those_of_the_same_light_without_a_line_between(tmp_path: Path) -> None:
    """A count of 4 million is 5 nm at the centre; the joints are those of the very same steps."""
    plan = good_plan(2)
    rig = cell_rig(plan)
    direct, through = carried(plan, rig), through_counts(tmp_path, plan)
    assert [shot.joints_deg for shot in through.shots] == [shot.joints_deg for shot in direct.shots]
    assert len(through.shots) == 2
    for one, other in zip(through.shots, direct.shots, strict=True):
        np.testing.assert_allclose(one.spot_mm or (), other.spot_mm or (), atol=1e-5)


def test_lines_that_are_lost_cost_samples_and_no_truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Within what the joints' noise makes of the beam: 0.01 deg at some 2 m, five times."""
    monkeypatch.setattr(amplifier, "_GRACE_S", 0.3)
    plan = good_plan(1)
    (direct,) = carried(plan, cell_rig(plan)).shots
    (through,) = through_counts(
        tmp_path, plan, LineFaults(lost=0.02, torn=0.02, wrong=0.02, garbage=0.02)
    ).shots
    np.testing.assert_allclose(through.joints_deg, direct.joints_deg, atol=0.1)
    assert np.abs(through.spot_mm or np.inf).max() < 0.05


def dead(counts: Matrix) -> Matrix:
    """The electrode x+ has come off."""
    return np.where([True, False, False, False], 5000.0, counts)


def cut_off(counts: Matrix) -> Matrix:
    """The amplifier's zero has fallen below the ADC's lowest count."""
    return np.maximum(counts - 2e6, 0.0)


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"faults": LineFaults(silent=True)}, RefusalReason.NO_SIGNAL),
        ({"faults": LineFaults(wrong=0.7)}, RefusalReason.NO_SIGNAL),
        ({"spoilt": cut_off}, RefusalReason.NO_SIGNAL),
        ({"spoilt": dead}, RefusalReason.OFF_FACE),
        ({"laser": {"light": 0.4}}, RefusalReason.TOO_WEAK),
        ({"laser": {"light": 1.3}}, RefusalReason.TOO_BRIGHT),
        ({"psd": {"lost": 0.0, "ambient": 8.0, "saturation": 9.0}}, RefusalReason.SATURATED),
    ],
)
@pytest.mark.one_in(3)
def test_what_the_counts_cannot_tell_is_a_refused_shot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changed: dict[str, Any], reason: RefusalReason
) -> None:
    monkeypatch.setattr(BeamPorts, "attempts", 1)
    if "faults" in changed:
        monkeypatch.setattr(amplifier, "_GRACE_S", 0.02)
    done = through_counts(tmp_path, good_plan(1), **changed)
    assert [refused.reason for refused in done.refused] == [reason]
    assert done.shots == ()


def test_a_face_without_the_laser_is_not_lit() -> None:
    """Counts of ambient light and noise alone, far below the share by which a beam on the face is known."""
    rig = cell_rig(good_plan(1))
    rig.begin(0, "psd", None)
    light = rig.currents
    rig.currents = lambda samples: OWN.currents(  # type: ignore[method-assign]
        OWN.counts(light(samples), "duo-lateral"), "duo-lateral"
    )
    sheet = rig.psds["psd"]
    dark = read_dark(rig, sheet, 100)
    assert abs(read_spot(rig, sheet, dark, 8).light) < LIT / 10
    assert read_spot(rig, sheet, np.zeros(4), 8).light > LIT  # control: the ambient light not taken off
    assert sheet.rate < RATE
