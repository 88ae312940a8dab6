"""Files of real sensors (YAML): `zerobeam/sensors/1`, the PSDs at serial ports and a camera or none, the
instruments that send lines, and `zerobeam/psd-calibration/1`, what an amplifier's counts mean.

Nothing that a reading depends on has a default.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from ...model.arrays import Matrix
from ...model.parsing.validation import (
    Count,
    FileModel,
    Name,
    NumberPair,
    Positive,
    SourcedModel,
    TargetName,
    Vector,
    as_tuple,
    read_model,
    refusal,
    tuple_of,
)
from .detectors import PAIR_LIGHT, PsdKind, face_normal

CALIBRATION_SCHEMA: Literal["zerobeam/psd-calibration/1"] = "zerobeam/psd-calibration/1"

_ELECTRODES = "in the order x+, x-, y+, y-"


class PsdCalibration(SourcedModel):
    """The content of a calibration file: of one amplifier with one PSD and one laser."""

    schema_: Literal["zerobeam/psd-calibration/1"] = Field(
        alias="schema", description="kind and version of the file"
    )
    amplifier: Name = Field(description="the name by which the amplifier calls itself")
    dark_counts: Annotated[tuple[float, float, float, float], tuple_of(4)] = Field(
        description=f"mean counts of each electrode with the face covered, {_ELECTRODES}"
    )
    gains: Annotated[tuple[Positive, Positive, Positive, Positive], tuple_of(4)] = Field(
        description="what the counts of each electrode above dark are multiplied by to be alike for the same "
        f"current, {_ELECTRODES}"
    )
    full_light_counts: Positive = Field(
        description="sum of the four, dark taken off and gains applied, with the laser's full light on the "
        "centre of the face, less the same with the laser off"
    )
    lowest_counts: int = Field(description="the ADC's lowest count; a reading there is cut off")
    saturation_counts: Annotated[tuple[int, int, int, int], tuple_of(4)] = Field(
        description="highest count that each electrode can measure, of the ADC or of the amplifier before"
        " it, "
        f"{_ELECTRODES}"
    )

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        for i, (dark, highest) in enumerate(zip(self.dark_counts, self.saturation_counts, strict=True)):
            if not self.lowest_counts < dark < highest:
                raise refusal(
                    f"the dark counts of electrode {i + 1} are not between its lowest and highest",
                    key=("dark_counts", i),
                    found=f"{dark:g}",
                    allowed=f"above {self.lowest_counts}, below {highest}",
                    remedy="raise the amplifier's zero, or correct lowest_counts and saturation_counts",
                )
        return self

    def currents(self, counts: Matrix, kind: PsdKind) -> Matrix:
        """(..., 4) shares of the laser's full light from counts (..., 4) as a `Psd` of this kind has them.

        Full light is a sum of `full_light_counts` here and of twice the `PAIR_LIGHT` there.
        """
        share = 2 * PAIR_LIGHT[kind] / self.full_light_counts
        return np.asarray((counts - self.dark_counts) * np.multiply(self.gains, share))

    def counts(self, currents: Matrix, kind: PsdKind) -> Matrix:
        """(..., 4) whole counts that the amplifier would send for currents (..., 4): `currents` backwards."""
        share = 2 * PAIR_LIGHT[kind] / self.full_light_counts
        counts = np.rint(currents / np.multiply(self.gains, share) + self.dark_counts)
        return np.clip(counts, self.lowest_counts, self.saturation_counts)

    def saturation(self, kind: PsdKind) -> float:
        """The largest current that every electrode can measure: a saturated one reads no less."""
        return float(self.currents(np.array(self.saturation_counts), kind).min())


def read_calibration(path: Path) -> PsdCalibration:
    """A calibration file, every key of it checked."""
    return read_model(PsdCalibration, path, CALIBRATION_SCHEMA)


SENSORS_SCHEMA: Literal["zerobeam/sensors/1"] = "zerobeam/sensors/1"

_SOURCES = ("device", "video", "folder")


class SerialPort(FileModel):
    """Where an amplifier is plugged in."""

    device: Name = Field(description="the port's path, as /dev/ttyUSB0, or its name, as COM3")
    baud: Count = Field(description="its speed, bits a second")


class PsdBeside(FileModel):
    """One PSD with its amplifier."""

    kind: Literal["duo-lateral", "tetra-lateral"] = Field(description="its layout")
    size_mm: Positive = Field(description="side of the active square, millimetres")
    rate_hz: Positive = Field(description="samples a second that the amplifier takes")
    noise_mm: Positive = Field(
        description="standard deviation of one sample at full light at the centre, as measured with the arm"
        " at rest, millimetres"
    )
    markers_mm: Annotated[tuple[Vector, Vector] | None, BeforeValidator(as_tuple)] = Field(
        default=None,
        description="the two LEDs in the PSD's frame, millimetres; a camera needs them, and nothing else",
    )
    normal: Annotated[Vector | Literal["beam"], BeforeValidator(face_normal)] = Field(
        description="outward normal of its face, base frame; beam: it is turned towards each beam"
    )
    turn_deg: float = Field(
        description="rotation of its x axis about that normal from the base's x axis made square to it (the "
        "y axis where the normal is within 20 degrees of x), degrees"
    )
    serial: SerialPort = Field(description="where its amplifier is plugged in")
    calibration: Name = Field(description="path of the calibration file, relative to this file")


class Mount(FileModel):
    """The pose of the camera's frame (z forward, x right, y down in the picture) in the flange frame."""

    xyz_mm: Vector = Field(description="its origin, millimetres")
    rpy_deg: Vector = Field(description="its rotation about fixed x, y, z of the flange, degrees")


class CameraBeside(FileModel):
    """The camera on the flange, and where its pictures come from."""

    device: Annotated[int, Field(ge=0)] | None = Field(
        default=None, description="number of a camera of this computer, from 0"
    )
    video: Name | None = Field(
        default=None,
        description="a stream's URL, or the path of a video or of numbered pictures (shot-%03d.png), "
        "relative to this file",
    )
    folder: Name | None = Field(
        default=None,
        description="a folder of pictures that are taken in the order of their names, relative to this file",
    )
    held_frames: Annotated[int, Field(ge=0)] = Field(
        description="how many frames that are given next may be older than the asking: those that camera and "
        "driver hold, and the one under way"
    )
    width_px: Count = Field(description="columns")
    height_px: Count = Field(description="rows")
    focal_px: NumberPair = Field(description="focal lengths along x and y, pixels")
    centre_px: NumberPair = Field(
        description="the optical axis in the picture, the first pixel's centre (0, 0)"
    )
    distortion: Annotated[tuple[float, float, float, float, float], tuple_of(5)] = Field(
        description="k1, k2, p1, p2, k3 (Brown-Conrady, in OpenCV's order)"
    )
    mount: Mount = Field(description="pose of its frame (z forward, x right, y down) on the flange")

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        sources = [source for source in _SOURCES if getattr(self, source) is not None]
        if len(sources) != 1:
            raise refusal(
                "where the camera's pictures come from is not clear",
                found=" and ".join(sources) or "none of them",
                allowed=f"one of {', '.join(_SOURCES)}",
            )
        for i, focal in enumerate(self.focal_px):
            if focal <= 0:
                raise refusal(
                    "this is not a focal length", key=("focal_px", i), found=f"{focal:g}", allowed="above 0"
                )
        return self


_LINES_FROM = ("tcp", "serial", "file")


class LineSource(FileModel):
    """The lines of an instrument, and where they come from."""

    tcp: Name | None = Field(default=None, description="HOST:PORT of a server that sends them")
    serial: SerialPort | None = Field(default=None, description="the port where the instrument is plugged in")
    file: Name | None = Field(default=None, description="a file that grows, relative to this file")
    line: Name = Field(
        description="the line of a reading: {} is a number, {*} is any text, a blank is any blanks"
    )
    unit: Literal["mm", "m", "in"] = Field(description="unit of its lengths")
    wait_s: Positive = Field(description="how long a reading is waited for, seconds")
    ask: Annotated[str, Field(min_length=1, max_length=80)] | None = Field(
        default=None, description="what is sent for each reading; without it the instrument sends by itself"
    )

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        sources = [source for source in _LINES_FROM if getattr(self, source) is not None]
        if len(sources) != 1:
            raise refusal(
                "where the lines of the instrument come from is not clear",
                found=" and ".join(sources) or "none of them",
                allowed=f"one of {', '.join(_LINES_FROM)}",
            )
        host, _, port = (self.tcp or "host:1").rpartition(":")
        if not host or not port.isdecimal() or not 0 < int(port) < 65536:
            raise refusal(
                "this is not the address of a server", key=("tcp",), found=self.tcp, allowed="HOST:PORT"
            )
        if self.ask is not None and self.file is not None:
            raise refusal("a file cannot be asked", key=("ask",), found=self.ask, remedy="leave ask out")
        return self


class SensorsFile(SourcedModel):
    """The content of a sensors file."""

    schema_: Literal["zerobeam/sensors/1"] = Field(alias="schema", description="kind and version of the file")
    psds: dict[TargetName, PsdBeside] = Field(
        default={}, description="by target: all targets of the plan, others may be there"
    )
    camera: CameraBeside | None = Field(
        default=None, description="the camera on the flange; null: there is none; required with psds"
    )
    instruments: dict[Name, LineSource] = Field(
        default={}, description="instruments of a run by hand that send lines, by their names in the plan"
    )

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if self.psds and "camera" not in self.model_fields_set:
            raise refusal(
                "whether there is a camera is not stated",
                key=("camera",),
                remedy="add camera: null, or the camera",
            )
        if not self.psds and not self.instruments:
            raise refusal("there are no sensors in this file", allowed="psds with camera, or instruments")
        devices: dict[str, str] = {}
        for target, psd in self.psds.items():
            if psd.serial.device in devices:
                raise refusal(
                    f"the PSDs of {devices[psd.serial.device]} and {target} are at the same port",
                    key=("psds", target, "serial", "device"),
                    found=psd.serial.device,
                    allowed="one amplifier, one PSD",
                )
            devices[psd.serial.device] = target
            if self.camera is not None and psd.markers_mm is None:
                raise refusal(
                    f"a camera looks for the LEDs of {target}, and where they are is not stated",
                    key=("psds", target),
                    remedy="add markers_mm, or state camera: null",
                )
        return self


def read_sensors_file(path: Path) -> SensorsFile:
    """A sensors file, every key of it checked; nothing is opened."""
    return read_model(SensorsFile, path, SENSORS_SCHEMA)
