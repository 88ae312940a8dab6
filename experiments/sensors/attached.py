"""The sensors that a sensors file names, opened: what the ABB rig asks for currents and pictures; and
instruments that send lines of text."""

from __future__ import annotations

import os
import re
import socket
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol

import numpy as np

from ...interruption import obey
from ...model.arrays import Matrix
from ...model.errors import BadInput, RigFault, missing_extra
from ...model.files.plan import Plan
from ...model.kinematics.robot import pose_of
from ...model.parsing.confinement import require_device, require_within
from ...model.parsing.reading import did_you_mean, shown
from .amplifier import MOST_SAMPLES, REQUESTS, Amplifier, PsdSample, sample_line, with_checksum
from .detectors import BRIGHTEST, PAIR_LIGHT, Camera, Image, Psd
from .markers import open_camera
from .sensors_file import (
    CameraBeside,
    LineSource,
    PsdBeside,
    PsdCalibration,
    SensorsFile,
    read_calibration,
    read_sensors_file,
)

# What an instrument reads, by lines of text: from a TCP server, a serial port or a file that grows.
#
# The line is stated in the sensors file: `{}` is a number, `{*}` is any text, a blank is any blanks. Only a
# line that begins after the asking counts, so that no reading is older than the posture.

_POLL_S = 0.02
_LONGEST = 10_000  # bytes of a line
_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_MM = {"mm": 1.0, "m": 1000.0, "in": 25.4}
_CONNECT_S = 5.0


class ReadingRefused(Exception):
    """The instrument has no reading for this posture; the sentence says why."""


class Bytes(Protocol):
    """Where bytes of an instrument come from. OSError where it is lost."""

    def new(self) -> bytes:
        """What has come since the last call, after a short wait at most; b"" if nothing has."""
        ...

    def send(self, content: bytes) -> None: ...

    def close(self) -> None: ...


class TcpBytes:
    """A server that sends lines."""

    def __init__(self, address: str) -> None:
        host, _, port = address.rpartition(":")
        self._socket = socket.create_connection((host.strip("[]"), int(port)), timeout=_CONNECT_S)
        self._socket.settimeout(_POLL_S)

    def new(self) -> bytes:
        try:
            content = self._socket.recv(_LONGEST)
        except TimeoutError:
            return b""
        if not content:
            raise OSError("the server has ended the connection")
        return content

    def send(self, content: bytes) -> None:
        self._socket.sendall(content)

    def close(self) -> None:
        self._socket.close()


class SerialBytes:
    """An instrument at a serial port."""

    def __init__(self, device: str, baud: int) -> None:
        try:
            import serial
        except ImportError:
            raise missing_extra("an instrument at a serial port", "psd") from None
        require_device(device)
        self._port = serial.Serial(device, baud, timeout=_POLL_S, write_timeout=_CONNECT_S, exclusive=True)

    def new(self) -> bytes:
        return bytes(self._port.read(self._port.in_waiting or 1))

    def send(self, content: bytes) -> None:
        self._port.write(content)

    def close(self) -> None:
        self._port.close()


class FileBytes:
    """A file that another program appends to; one that is replaced is read from its beginning."""

    def __init__(self, path: Path) -> None:
        require_within(path)
        self._path, self._read, self._file = path, 0, (0, 0)

    def new(self) -> bytes:
        content = b""
        if self._path.is_file():
            with self._path.open("rb") as file:
                about = os.fstat(file.fileno())
                identity = (about.st_dev, about.st_ino)
                if identity != self._file or about.st_size < self._read:
                    self._file, self._read = identity, 0
                file.seek(self._read)
                content = file.read()
        self._read += len(content)
        if not content:
            time.sleep(_POLL_S)
        return content

    def send(self, content: bytes) -> None:
        raise OSError("a file cannot be asked")

    def close(self) -> None:
        """Nothing is held open."""


class InstrumentLines:
    """The instrument `name`, open; `lengths` says of each number of a reading whether it is a length.

    BadInput where the stated line has another count of numbers, RigFault where the source cannot be opened.
    """

    def __init__(self, name: str, source: LineSource, folder: Path, lengths: Sequence[bool]) -> None:
        self._name, self._source, self._lengths = name, source, tuple(lengths)
        self._pattern = line_pattern(source.line)
        if self._pattern.groups != len(self._lengths):
            raise BadInput(
                f"the line of {name} has another count of numbers than its readings",
                found=f"{source.line!r}: {self._pattern.groups}",
                allowed=f"{len(self._lengths)} times {{}}",
            )
        self._rest, self._whole = b"", True
        try:
            self._bytes = _opened(source, folder)
        except (OSError, ValueError) as error:
            raise RigFault(f"{name} cannot be opened: {error}") from None

    def read(self) -> str:
        """The numbers of one reading from now on, lengths in mm; ReadingRefused where none comes in time."""
        before, other = self._drop(), ""
        if self._source.ask is not None:
            self._tried_to_send(self._source.ask.encode())
        ends = time.monotonic() + self._source.wait_s
        while time.monotonic() < ends:
            obey()
            for line in self._lines():
                match = self._pattern.fullmatch(line)
                if match is not None:
                    return self._in_mm(match.groups())
                other = line or other
        if other:
            raise ReadingRefused(
                f"{self._name} sent {shown(other)}, which is not the line of the sensors file"
            )
        earlier = f"; {before} came before the joints were read, and are older" if before else ""
        raise ReadingRefused(f"{self._name} sent no line in {self._source.wait_s:g} s{earlier}")

    def close(self) -> None:
        self._bytes.close()

    def _drop(self) -> int:
        """How many whole lines had come until now; they are forgotten, and so is one that has begun.

        Two short reads in a row: neither this side nor the other has lines in a queue any more.
        """
        short = 0
        while short < 2:
            content = self._new()
            short = short + 1 if len(content) < _LONGEST else 0
            self._rest += content
        *lines, rest = self._rest.split(b"\n")
        self._whole, self._rest = not rest and (self._whole or bool(lines)), b""
        return len(lines)

    def _lines(self) -> list[str]:
        """The lines whose ends have come, without the rest of one that had begun earlier."""
        *lines, rest = (self._rest + self._new()).split(b"\n")
        self._rest = rest[-_LONGEST:]
        if lines and not self._whole:
            self._whole, lines = True, lines[1:]
        return [line.decode("utf-8", "replace").strip() for line in lines]

    def _new(self) -> bytes:
        try:
            return self._bytes.new()
        except OSError as error:
            raise RigFault(f"{self._name} is lost ({error}): go on with --resume") from None

    def _tried_to_send(self, content: bytes) -> None:
        try:
            self._bytes.send(content)
        except OSError as error:
            raise RigFault(f"{self._name} is lost ({error}): go on with --resume") from None

    def _in_mm(self, numbers: Sequence[str]) -> str:
        scale = _MM[self._source.unit]
        values = zip(map(float, numbers), self._lengths, strict=True)
        return " ".join(repr(value * scale if length else value) for value, length in values)


def line_pattern(line: str) -> re.Pattern[str]:
    """The expression of a stated line, a group for each number."""
    parts = re.split(r"(\{\}|\{\*\}|\s+)", line.strip())
    words = {"{}": _NUMBER, "{*}": ".*?"}
    return re.compile(
        "".join(words.get(part) or (r"\s+" if part.isspace() else re.escape(part)) for part in parts)
    )


def _opened(source: LineSource, folder: Path) -> Bytes:
    if source.tcp is not None:
        return TcpBytes(source.tcp)
    if source.serial is not None:
        return SerialBytes(source.serial.device, source.serial.baud)
    assert source.file is not None
    return FileBytes(folder / source.file)


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
