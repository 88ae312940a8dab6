"""The files of sensors: all of them read, nothing guessed; what counts mean, and what is opened."""

import hashlib
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from amplifier_stand_in import AmplifierStandIn
from beside import CAMERA, MOUNT, calibrated, calibration, psd, sensors, write
from cells import good_plan, header, plan_of

from zerobeam.experiments.rigs.simulated.simulator import SimulatedPsd
from zerobeam.experiments.sensors.amplifier import parse_sample, verified_body
from zerobeam.experiments.sensors.attached import read_sensors
from zerobeam.experiments.sensors.detectors import Psd, PsdKind
from zerobeam.experiments.sensors.sensors_file import (
    CameraBeside,
    PsdBeside,
    PsdCalibration,
    read_calibration,
    read_sensors_file,
)
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput, RigFault

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
    assert read.sha256 == digest(file)


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
def test_a_calibration_that_cannot_be_is_refused(
    tmp_path: Path, refused: Any, changed: dict[str, Any], told: str
) -> None:
    file = write(tmp_path / "a.yaml", calibration(**changed))
    error = refused(read_calibration, file)
    assert told in str(error)
    assert error.line is not None


PAGE = Path(__file__).resolve().parents[3] / "docs" / "sensors.md"
DEVICE = {**CAMERA, "device": 0}

Refused = Callable[..., BadInput]


@pytest.fixture(autouse=True)
def _extras() -> None:
    pytest.importorskip("serial")
    pytest.importorskip("pty")


def digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def silent(samples: int) -> Matrix:
    return np.full((samples, 4), np.nan)


def test_a_file_is_read(tmp_path: Path) -> None:
    stated = read_sensors_file(sensors(tmp_path, camera=DEVICE))
    assert stated.psds == {"psd": PsdBeside.model_validate(psd("/dev/ttyNONE"))}
    assert stated.camera == CameraBeside.model_validate(DEVICE)
    assert stated.folder == tmp_path


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"schema": "zerobeam/cell/1"}, "not a sensors file"),
        ({"psds": {"psd": psd("/dev/a", kind="quadrant")}}, "kind"),
        ({"psds": {"psd": psd("/dev/a", normal=[0, 0, 0])}}, "not a normal"),
        ({"psds": {"psd": psd("/dev/a", noise_mm=0)}}, "noise_mm"),
        ({"psds": {"psd": psd("/dev/a", gain=1)}}, "unknown key 'gain'"),
        ({"psds": {"psd": psd("/dev/a"), "other": psd("/dev/a")}}, "at the same port"),
        ({"psds": {"psd": psd("/dev/a", markers_mm=None)}, "camera": DEVICE}, "looks for the LEDs"),
        ({"camera": CAMERA}, "one of device, video, folder"),
        ({"camera": {**DEVICE, "folder": "x"}}, "device and folder"),
        ({"camera": {**DEVICE, "focal_px": [700, 0]}}, "not a focal length"),
        ({"camera": {**DEVICE, "distortion": [0, 0, 0, 0]}}, "5 values"),
        ({"camera": {**DEVICE, "mount": {"xyz_mm": [0, 0, 0]}}}, "rpy_deg"),
    ],
)
def test_what_cannot_be_is_refused(
    tmp_path: Path, refused: Refused, changed: dict[str, Any], told: str
) -> None:
    error = refused(read_sensors_file, sensors(tmp_path, **changed))
    assert told in str(error)
    assert error.file == str(tmp_path / "sensors.yaml")
    assert error.line is not None


GUESSED = [
    *(("calibration", key) for key in sorted(set(PsdCalibration.model_fields) - {"schema_"})),
    *(("psd", key) for key in sorted(set(psd("")) - {"markers_mm"})),
    *(("camera", key) for key in sorted(CAMERA)),
]


@pytest.mark.parametrize(("part", "key"), GUESSED)
@pytest.mark.one_in(2)
def test_nothing_is_guessed(tmp_path: Path, refused: Refused, part: str, key: str) -> None:
    parts = {"calibration": calibration(), "psd": psd("/dev/a"), "camera": dict(DEVICE)}
    del parts[part][key]
    file = sensors(tmp_path, psds={"psd": parts["psd"]}, camera=parts["camera"])
    if part == "calibration":
        error = refused(read_calibration, write(tmp_path / "a.yaml", parts[part]))
    else:
        error = refused(read_sensors_file, file)
    assert f"{key!r} is missing" in str(error)


def test_the_sheets_are_what_the_file_says(tmp_path: Path) -> None:
    pytest.importorskip("cv2")
    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures" / "0.png").write_bytes(b"-")
    with AmplifierStandIn("PSD-A 0017", silent) as there:
        found = read_sensors(
            sensors(tmp_path, there.device, camera={**CAMERA, "folder": "pictures"}), good_plan(2)
        )
        sheet, camera = found.psds["psd"], found.camera
        found.close()
    assert (sheet.size, sheet.kind, sheet.rate, sheet.noise) == (20.0, "duo-lateral", 20_000.0, 0.0005)
    assert sheet.turn == pytest.approx(np.radians(30.0))
    np.testing.assert_array_equal(sheet.normal, [0.0, 0.0, 1.0])
    np.testing.assert_array_equal(sheet.markers, [[35.0, 0.0, 0.0], [-35.0, 0.0, 0.0]])
    assert sheet.saturation == pytest.approx((8000000 - 4900) * 0.9 * 2 / 4e6)
    assert (camera.width, camera.height, camera.focal) == (64, 48, (70.0, 71.0))
    # Turned by 90 degrees about y it looks along the flange's x.
    np.testing.assert_allclose(camera.mount[:3, 2], [1.0, 0.0, 0.0], atol=1e-15)
    np.testing.assert_array_equal(camera.mount[:3, 3], MOUNT["xyz_mm"])
    assert found.provenance() == {
        "sensors sha256": digest(tmp_path / "sensors.yaml"),
        "calibration of psd sha256": digest(tmp_path / "psd-a.yaml"),
    }


def test_without_a_camera_nothing_is_said_of_the_markers(tmp_path: Path) -> None:
    own = psd("", normal="beam")
    del own["markers_mm"]
    with AmplifierStandIn("PSD-A 0017", silent) as there:
        own["serial"]["device"] = there.device
        found = read_sensors(sensors(tmp_path, psds={"psd": own}), good_plan(2))
        found.close()
    assert found.psds["psd"].normal is None
    assert np.isnan(found.psds["psd"].markers).all()
    assert found.camera is None
    with pytest.raises(RigFault, match="no camera"):
        found.image("psd")


def test_a_target_without_a_psd_is_one_error_before_anything_is_opened(
    tmp_path: Path, refused: Refused
) -> None:
    plan = plan_of(header(), good_plan(3).postures, ("psd", "psd2", "pds3"))
    error = refused(read_sensors, sensors(tmp_path), plan)
    assert error.found == "psd2, pds3"
    assert error.allowed == "psd"
    # Ports of PSDs that the plan does not need are not opened.
    with AmplifierStandIn("PSD-A 0017", silent) as there:
        path = sensors(tmp_path, psds={"psd": psd(there.device), "other": psd("/dev/ttyNONE")})
        read_sensors(path, good_plan(2)).close()


def test_the_calibration_of_another_amplifier_is_refused_and_the_port_closed(
    tmp_path: Path, refused: Refused
) -> None:
    with AmplifierStandIn("PSD-B 0003", silent) as there:
        path = sensors(tmp_path, there.device)
        error = refused(read_sensors, path, good_plan(2))
        assert "PSD-B 0003" in str(error.found)
        assert "PSD-A 0017" in str(error.allowed)
        write(tmp_path / "psd-a.yaml", calibration(amplifier="PSD-B 0003"))
        read_sensors(path, good_plan(2)).close()


def test_a_port_that_fails_closes_those_before_it(tmp_path: Path) -> None:
    plan = plan_of(header(), good_plan(2).postures, ("psd", "other"))
    with AmplifierStandIn("PSD-A 0017", silent) as there:
        path = sensors(tmp_path, psds={"psd": psd(there.device), "other": psd("/dev/ttyNONE")})
        with pytest.raises(RigFault, match="amplifier of other at /dev/ttyNONE"):
            read_sensors(path, plan)
        read_sensors(path, good_plan(2)).close()


def test_full_light_that_saturates_is_refused(tmp_path: Path, refused: Refused) -> None:
    path = sensors(tmp_path)
    write(tmp_path / "psd-a.yaml", calibration(full_light_counts=3.1e7))
    assert "saturates" in str(refused(read_sensors, path, good_plan(2)))


def test_a_line_that_cannot_carry_the_samples_is_refused(tmp_path: Path, refused: Refused) -> None:
    """50 characters of 10 bits: D 65535 9999, four of 7 digits, the checksum, LF."""
    slow = psd("/dev/ttyNONE", rate_hz=200.0, serial={"device": "/dev/ttyNONE", "baud": 99_999})
    error = refused(read_sensors, sensors(tmp_path, psds={"psd": slow}), good_plan(2))
    assert "100000 or more" in str(error.allowed)
    slow["serial"]["baud"] = 100_000
    with pytest.raises(RigFault, match="cannot be opened"):
        read_sensors(sensors(tmp_path, psds={"psd": slow}), good_plan(2))


def test_the_files_and_lines_of_the_page_are_what_is_read(tmp_path: Path) -> None:
    text = PAGE.read_text(encoding="utf-8")
    files = re.findall(r"^```yaml\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)
    names = ["sensors.yaml", "psd-a.yaml"]
    for name, content in zip(names, files, strict=True):
        (tmp_path / name).write_text(content, encoding="utf-8")
    stated = read_sensors_file(tmp_path / "sensors.yaml")
    assert stated.psds["psd"].calibration == "psd-a.yaml"
    read_calibration(tmp_path / "psd-a.yaml")
    with pytest.raises(RigFault, match="/dev/ttyUSB0 cannot be opened"):  # all else is in order
        read_sensors(tmp_path / "sensors.yaml", good_plan(2))
    lines = re.findall(r"^→ (.*)$", text, flags=re.MULTILINE)
    bodies = [verified_body(line.encode()) for line in lines]
    assert None not in bodies
    assert len(bodies) >= 3
    assert [parse_sample(body or "") is not None for body in bodies] == [False] + [True] * (len(bodies) - 1)
