"""The sensors that a sensors file names, opened: what the ABB rig asks for currents and pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from ...model.arrays import Matrix
from ...model.errors import RigFault
from ...model.files.plan import Plan
from ...model.kinematics.transforms import pose_of
from ...model.parsing.reading import did_you_mean
from .amplifier import MOST_SAMPLES, REQUESTS, Amplifier, PsdSample, sample_line, with_checksum
from .camera import Camera, Image
from .opencv_pictures import open_camera
from .psd import BRIGHTEST, PAIR_LIGHT, Psd
from .sensors_file import (
    CameraBeside,
    PsdBeside,
    PsdCalibration,
    SensorsFile,
    read_calibration,
    read_sensors_file,
)
from .text_lines import InstrumentLines

_BITS_A_BYTE = 10  # 8N1


class RealSensors:
    """PSDs by target and the camera, all there and answering; `close` gives their ports back."""

    def __init__(self, file: SensorsFile, targets: Sequence[str]) -> None:
        self._file = file
        folder = file.folder
        self._calibrations = {name: _calibration(file, name) for name in targets}
        self.psds: Mapping[str, Psd] = {
            name: _sheet(file.psds[name], calibration) for name, calibration in self._calibrations.items()
        }
        self.camera = None if file.camera is None else _camera(file.camera)
        self._amplifiers: dict[str, Amplifier] = {}
        with ExitStack() as opened:
            for name in targets:
                port = file.psds[name].serial
                amplifier = Amplifier(port.device, port.baud, f"the PSD amplifier of {name}")
                opened.callback(amplifier.close)
                self._require_own(name, amplifier.name)
                self._amplifiers[name] = amplifier
            self._pictures = None
            if file.camera is not None and self.camera is not None:
                self._pictures = open_camera(file.camera, self.camera, folder)
                opened.callback(self._pictures.close)
            self._opened = opened.pop_all()

    def provenance(self) -> dict[str, str]:
        """For the run's header: the SHA-256 of each file that the readings depend on."""
        files = {f"calibration of {name} sha256": each.sha256 for name, each in self._calibrations.items()}
        files["sensors sha256"] = self._file.sha256
        return {name: sha256 for name, sha256 in files.items() if sha256 is not None}

    def currents(self, target: str, samples: int) -> Matrix:
        """(samples, 4) of that target's PSD; a sample that did not arrive, or is cut off, is a row of NaN."""
        calibration, psd = self._calibrations[target], self.psds[target]
        counts = self._amplifiers[target].counts(samples, psd.rate)
        counts[(counts <= calibration.lowest_counts).any(axis=1)] = np.nan
        return calibration.currents(counts, psd.kind)

    def image(self, target: str) -> Image:
        """(height, width) grey values, begun after the asking, with that target's PSD in view or not."""
        if self._pictures is None:
            raise RigFault(f"there is no camera to look at {target}")
        return self._pictures.picture()

    def close(self) -> None:
        self._opened.close()

    def _require_own(self, target: str, name: str) -> None:
        expected = self._calibrations[target].amplifier
        if name != expected:
            raise self._file.refuse(
                ("psds", target, "calibration"),
                f"the calibration of {target} is of another amplifier",
                found=f"the amplifier calls itself {name}",
                allowed=f"{expected}, as in the calibration file",
                remedy="name the calibration of this amplifier, or the port of that one",
            )


def read_sensors(path: Path, plan: Plan) -> RealSensors:
    """The sensors of a file that the plan's targets need, opened; BadInput where a target has no PSD."""
    file = read_sensors_file(path)
    absent = [target for target in plan.target_names if target not in file.psds]
    if absent:
        raise file.refuse(
            ("psds",),
            "a target of the plan has no PSD",
            found=", ".join(absent),
            allowed=", ".join(file.psds) or "none is stated",
            remedy=did_you_mean(absent[0], file.psds) or "state its PSD",
        )
    return RealSensors(file, plan.target_names)


def _calibration(file: SensorsFile, target: str) -> PsdCalibration:
    """The calibration of a target's amplifier; BadInput where it allows no reading."""
    psd = file.psds[target]
    calibration = read_calibration(file.folder / psd.calibration)
    # At the centre each electrode has a quarter of what all four have.
    needed = BRIGHTEST * PAIR_LIGHT[psd.kind] / 2
    if calibration.saturation(psd.kind) <= needed:
        raise file.refuse(
            ("psds", target, "calibration"),
            f"the laser's full light saturates the amplifier of {target}",
            found=f"an electrode measures {calibration.saturation(psd.kind):.2f} of it at most",
            allowed=f"above {needed:.2f}",
            remedy="dim the laser or lower the gain and calibrate again, or correct the calibration",
        )
    counts = [*calibration.saturation_counts, calibration.lowest_counts]
    widest = max(counts, key=lambda count: len(str(count)))
    line = len(with_checksum(sample_line(PsdSample(REQUESTS - 1, MOST_SAMPLES - 1, (widest,) * 4))))
    if line * _BITS_A_BYTE * psd.rate_hz > psd.serial.baud:
        raise file.refuse(
            ("psds", target, "serial", "baud"),
            f"the line is too slow for the samples of {target}",
            found=f"{psd.serial.baud} baud",
            allowed=f"{line * _BITS_A_BYTE * psd.rate_hz:.0f} or more for {psd.rate_hz:g} samples a second",
            remedy="set both ends to a higher rate, or take fewer samples a second",
        )
    return calibration


def _sheet(settings: PsdBeside, calibration: PsdCalibration) -> Psd:
    normal = None if settings.normal == "beam" else np.array(settings.normal, dtype=float)
    markers = np.full((2, 3), np.nan) if settings.markers_mm is None else np.array(settings.markers_mm)
    return Psd(
        size=settings.size_mm,
        kind=settings.kind,
        rate=settings.rate_hz,
        noise=settings.noise_mm,
        saturation=calibration.saturation(settings.kind),
        markers=markers,
        normal=None if normal is None else normal / np.linalg.norm(normal),
        turn=float(np.radians(settings.turn_deg)),
    )


def _camera(settings: CameraBeside) -> Camera:
    return Camera(
        width=settings.width_px,
        height=settings.height_px,
        focal=settings.focal_px,
        centre=settings.centre_px,
        distortion=settings.distortion,
        mount=pose_of(settings.mount.xyz_mm, settings.mount.rpy_deg),
    )


def open_instrument(path: Path, plan: Plan) -> tuple[InstrumentLines, dict[str, str]]:
    """The instrument of a plan, whose lines a sensors file states, and the file's SHA-256 for the header.

    BadInput where the plan has several, its instrument reads nothing, or the file does not have it.
    """
    file = read_sensors_file(path)
    name, kind = next(iter(plan.header.kinds.items()))
    if kind.met or len(plan.header.kinds) > 1:
        raise file.refuse(
            ("instruments",),
            "lines are read of a plan's only instrument, which reads something",
            found=", ".join(f"a {each.name}" for each in plan.header.kinds.values()),
            remedy="leave --sensors out",
        )
    if name not in file.instruments:
        raise file.refuse(
            ("instruments",),
            "the plan's instrument is not in the sensors file",
            found=name,
            allowed=", ".join(file.instruments) or "none is stated",
            remedy=did_you_mean(name, file.instruments) or "state its lines",
        )
    lengths = [key.endswith("_mm") for key, size in kind.columns.items() for _ in range(size)]
    instrument = InstrumentLines(name, file.instruments[name], file.folder, lengths)
    return instrument, {"sensors sha256": str(file.sha256)}
