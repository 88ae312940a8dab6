"""Sensors files and calibrations for the tests, and amplifiers that stand in for real ones."""

from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from zerobeam.experiments.sensors.sensors_file import PsdCalibration

RATE = 20_000.0  # Hz: readings take no time
MOUNT = {"xyz_mm": [60.0, 0.0, 65.0], "rpy_deg": [0.0, 90.0, 0.0]}
CAMERA: dict[str, Any] = {
    "held_frames": 0,
    "width_px": 64,
    "height_px": 48,
    "focal_px": [70.0, 71.0],
    "centre_px": [31.5, 23.5],
    "distortion": [-0.2, 0.05, 0.0005, -0.0005, 0.001],
    "mount": MOUNT,
}


def calibration(**changed: Any) -> dict[str, Any]:
    """Of a 24-bit ADC whose four channels are all different."""
    return {
        "schema": "zerobeam/psd-calibration/1",
        "amplifier": "PSD-A 0017",
        "dark_counts": [5000.0, 5100.0, 4900.0, 5050.5],
        "gains": [1.0, 1.1, 0.9, 1.05],
        "full_light_counts": 4e6,
        "lowest_counts": 0,
        "saturation_counts": [8388607, 8388607, 8000000, 8388607],
        **changed,
    }


def calibrated(**changed: Any) -> PsdCalibration:
    return PsdCalibration.model_validate(calibration(**changed))


def psd(device: str, **changed: Any) -> dict[str, Any]:
    return {
        "kind": "duo-lateral",
        "size_mm": 20.0,
        "rate_hz": RATE,
        "noise_mm": 0.0005,
        "markers_mm": [[35.0, 0.0, 0.0], [-35.0, 0.0, 0.0]],
        "normal": [0.0, 0.0, 2.0],
        "turn_deg": 30.0,
        "serial": {"device": device, "baud": 16_000_000},
        "calibration": "psd-a.yaml",
        **changed,
    }


def sensors(folder: Path, device: str = "/dev/ttyNONE", **changed: Any) -> Path:
    """A sensors file with one PSD `psd` and no camera, and its calibration beside it."""
    content = {"schema": "zerobeam/sensors/1", "psds": {"psd": psd(device)}, "camera": None, **changed}
    write(folder / "psd-a.yaml", calibration())
    return write(folder / "sensors.yaml", content)


def write(file: Path, content: dict[str, Any]) -> Path:
    YAML(typ="safe").dump(content, file)
    return file
