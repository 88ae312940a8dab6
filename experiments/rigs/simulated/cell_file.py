"""The simulated cell in a file (YAML, `zerobeam/cell/1`): its parts, what goes wrong on purpose, and when.

Every key has a default, so that a plan needs no cell file. What is said here is the truth of the simulation;
the procedure knows of it what a person would: data sheets, and about which way a PSD faces.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal, Self, TypeVar, get_args

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from ....model.arrays import Matrix
from ....model.files.header import RobotRef
from ....model.files.robot_file import load_robot
from ....model.kinematics.robot import Robot
from ....model.parsing.reading import did_you_mean, shown
from ....model.parsing.validation import (
    Count,
    FileModel,
    Fraction,
    Name,
    NotNegative,
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
from ...sensors.detectors import face_normal


class _AtShot(FileModel):
    """A fault on purpose, and in which measurement."""

    shot: int = Field(ge=0, description="number of the measurement")


class _ForCalls(_AtShot):
    lasts: Count | None = Field(
        default=None,
        description="for how many readings or images from the measurement's first on; default: the whole"
        " measurement, "
        "every attempt at it",
    )


class PsdDropout(_ForCalls):
    """The wireless link is down."""

    kind: Literal["psd-dropout"] = Field(description="no sample of the PSD arrives")


class CameraBlack(_ForCalls):
    """The camera gives black images."""

    kind: Literal["camera-black"] = Field(description="images are black")


class LedOccluded(_ForCalls):
    """One LED is hidden."""

    kind: Literal["led-occluded"] = Field(description="a LED cannot be seen")
    led: Literal[1, 2] = Field(default=1, description="which")


class Reflection(_ForCalls):
    """A reflection of the beam that looks like the spot."""

    kind: Literal["reflection"] = Field(
        description="the beam, reflected, lights the PSD where it does not point, and shows in the images"
    )
    at_mm: NumberPair = Field(default=(4.0, -3.0), description="where on the face, millimetres")
    light: NotNegative = Field(default=0.8, description="its light, share of the laser's")


class EncoderGlitch(_ForCalls):
    """A joint is read wrong."""

    kind: Literal["encoder-glitch"] = Field(description="a joint reading is off")
    joint: Count = Field(description="which, from 1")
    deg: float = Field(description="by how much, degrees (mm)")


class RobotStop(_AtShot):
    """The robot stops by itself."""

    kind: Literal["robot-stop"] = Field(description="the controller stops the arm on its way")


class PsdBump(_AtShot):
    """Someone bumps the PSDs before this measurement: in it, and in all of higher numbers, they are
    elsewhere."""

    kind: Literal["psd-bump"] = Field(description="the PSDs are moved between two measurements")
    shift_mm: Vector = Field(description="by how much, base frame, millimetres")


class ProcessKilled(_AtShot):
    """The program is killed (SIGKILL)."""

    kind: Literal["process-killed"] = Field(description="the program is killed")
    call: Count = Field(description="at which use of the rig since the measurement began")


AnyFault = (
    PsdDropout | CameraBlack | LedOccluded | Reflection | EncoderGlitch | RobotStop | PsdBump | ProcessKilled
)
_FAULTS: dict[str, type[FileModel]] = {
    get_args(fault.model_fields["kind"].annotation)[0]: fault for fault in get_args(AnyFault)
}
FAULT_KINDS = tuple(_FAULTS)


def _of_a_kind(value: object) -> object:
    """Refuse unknown kinds and keys; the message names the keys of this kind alone."""
    if not isinstance(value, dict):
        return value
    kind = value.get("kind")
    if kind not in FAULT_KINDS:
        raise refusal(
            "unknown kind of fault",
            key=("kind",),
            found=shown(kind),
            allowed=", ".join(FAULT_KINDS),
            remedy=did_you_mean(str(kind), FAULT_KINDS),
        )
    for key in value:
        if key not in (keys := _FAULTS[kind].model_fields):
            raise refusal(
                f"unknown key {key!r} of a {kind}",
                key=(key,),
                found=f"{key}: {shown(value[key])}",
                allowed=", ".join(keys),
                remedy=did_you_mean(key, keys) or "remove it",
            )
    return value


Fault = Annotated[AnyFault, Field(discriminator="kind"), BeforeValidator(_of_a_kind)]

Kind = TypeVar("Kind", bound=AnyFault)

# On Windows any signal ends a process at once, and this one has no name there.
_KILL = signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL


class Faults:
    """The schedule of one run.

    One that is `resumed` does not meet again what stopped it, a stop of the robot or the end of the process:
    until a measurement has been recorded there are none. (The measurement that was stopped need not be the
    first: those that were refused before it are tried again.)
    """

    def __init__(self, schedule: Sequence[AnyFault], *, resumed: bool = False) -> None:
        self._schedule = tuple(schedule)
        self._resumed = resumed
        self._first: tuple[int | None] | None = None
        self._shot = -1
        self._on: tuple[AnyFault, ...] = ()
        self._calls = 0
        self._met: list[int] = []

    def begin(self, shot: int, last: int | None) -> None:
        """Faults of this measurement begin; `last` is the number of the measurement that was recorded last
        (None: none)."""
        self._first = self._first or (last,)
        stopped_before = self._resumed and self._first == (last,)
        self._shot, self._calls = shot, 0
        self._on = tuple(
            fault
            for fault in self._schedule
            if fault.shot == shot and not (stopped_before and isinstance(fault, RobotStop | ProcessKilled))
        )
        self._met = [0] * len(self._on)

    def called(self) -> None:
        """Count one use of the rig; the process may end here."""
        self._calls += 1
        if any(isinstance(fault, ProcessKilled) and fault.call == self._calls for fault in self._on):
            os.kill(os.getpid(), _KILL)

    def met(self, kind: type[Kind]) -> Kind | None:
        """The fault of that kind that is on now, once more met; None if there is none, or no longer."""
        for i, fault in enumerate(self._on):
            if isinstance(fault, kind):
                self._met[i] += 1
                lasts = getattr(fault, "lasts", None)
                if lasts is None or self._met[i] <= lasts:
                    return fault
        return None

    def bumped(self) -> Matrix:
        """(3,) mm by which the PSDs have been moved up to this measurement."""
        shifts = [f.shift_mm for f in self._schedule if isinstance(f, PsdBump) and f.shot <= self._shot]
        return np.asarray(np.reshape(shifts, (-1, 3)).sum(axis=0))


CELL_SCHEMA: Literal["zerobeam/cell/1"] = "zerobeam/cell/1"


def _each_joint(value: object) -> object:
    values = value if isinstance(value, list | tuple) else [value]
    for i, item in enumerate(values):
        if isinstance(item, bool) or not isinstance(item, int | float) or not item >= 0:
            raise refusal(
                "not a valid value for a joint",
                key=(i,) if isinstance(value, list | tuple) else (),
                found=shown(item),
                allowed="one number, 0 or more, or a list of them, one for each joint",
            )
    return as_tuple(value)


# One number for every joint, or a list with one each: degrees, and millimetres for a prismatic joint.
EachJoint = Annotated[NotNegative | tuple[NotNegative, ...], BeforeValidator(_each_joint)]


_MOST_BACKLASH = 10.0  # beyond it every move ends elsewhere, and no search finds anything


def _backlash(value: EachJoint) -> EachJoint:
    most = max(value) if isinstance(value, tuple) else value
    if most > _MOST_BACKLASH:
        raise refusal(
            "arm.backlash_deg is more than any arm has",
            found=f"{most:g}",
            allowed=f"up to {_MOST_BACKLASH:g}, degrees (mm)",
        )
    return value


class GeometryError(FileModel):
    """How far one link of the true arm deviates from nominal geometry."""

    joint: Count = Field(description="the joint behind that link, from 1")
    xyz_mm: Vector = Field(default=(0.0, 0.0, 0.0), description="shift, millimetres")
    rpy_deg: Vector = Field(default=(0.0, 0.0, 0.0), description="rotation about fixed x, y, z, degrees")


class ArmInCell(FileModel):
    """The true arm: its offsets, and how well it reaches where it is sent."""

    offsets_deg: dict[Name, float] | None = Field(
        default=None,
        description="true offsets by name (delta2), degrees (mm if prismatic), 0 where not named; without it "
        "they are random, from the seed",
    )
    drawn_deg: Positive = Field(default=1.0, description="standard deviation of random offsets, degrees (mm)")
    repeatability_deg: EachJoint | None = Field(
        default=None,
        description="standard deviation of the error of a joint, again after each move, degrees (mm); "
        "default: the plan's noise",
    )
    resolution_deg: EachJoint = Field(
        default=0.0002, description="step of the joints' encoders, degrees (mm)"
    )
    backlash_deg: Annotated[EachJoint, AfterValidator(_backlash)] = Field(
        default=0.0, description="backlash of the gears, at most 10 degrees (mm)"
    )
    geometry: Annotated[tuple[GeometryError, ...], BeforeValidator(as_tuple)] | None = Field(
        default=None,
        description="links that deviate from nominal geometry, and nothing else; without it links, gravity "
        "and harmonics are random, from the seed, within the tolerances of the header",
    )
    speed: Fraction = Field(default=0.25, description="share of the joints' top speeds")
    acceleration_deg_s2: Positive = Field(default=300.0, description="of every joint, degrees (mm) / s^2")
    latency_s: NotNegative = Field(default=0.1, description="from a command to the motion, seconds")

    @model_validator(mode="after")
    def _one_error_a_link(self) -> Self:
        joints = [error.joint for error in self.geometry or ()]
        for i, joint in enumerate(joints):
            if joint in joints[:i]:
                raise refusal(
                    f"the link before joint {joint} has two geometric errors",
                    key=("geometry", i),
                    allowed="one for each link",
                    remedy="make one of them",
                )
        return self


class LaserInCell(FileModel):
    """The true beam."""

    tilt_deg: NumberPair | None = Field(
        default=None,
        description="true tilt1, tilt2 from what the plan states, degrees; default: none for a calibrated "
        "tool without sigma, random with its sigma for another",
    )
    shift_mm: NumberPair | None = Field(
        default=None, description="true shift1, shift2, millimetres; likewise"
    )
    drift_deg_min: NumberPair = Field(default=(0.0, 0.0), description="drift of both tilts, degrees a minute")
    wander_mm: NotNegative | None = Field(
        default=None,
        description="standard deviation across the beam of its centre of light, again for each measurement"
        " (speckle, air), millimetres; default: the plan's spot noise",
    )
    light: NotNegative = Field(default=1.0, description="power as a share of what the PSD is set up for")
    radius_mm: Positive = Field(default=0.8, description="1/e^2 radius of the spot, millimetres")


class PlacedPsd(FileModel):
    """Pose of a PSD."""

    centre_mm: Vector | None = Field(
        default=None,
        description="its true centre, base frame, millimetres; default: near the plan's guess, from the seed",
    )
    normal: Annotated[Vector | Literal["beam"] | None, BeforeValidator(face_normal)] = Field(
        default=None,
        description="outward normal of its face as it would be stated, base frame; beam: it is turned "
        "towards each beam about its centre; default: as suits the plan's beams",
    )
    turn_deg: float = Field(default=0.0, description="rotation about that normal, degrees")
    misturned_deg: Vector = Field(
        default=(1.0, -1.0, 2.0),
        description="its true rotation from what is stated, about its x, y, z, degrees",
    )


class PsdInCell(FileModel):
    """The sensors, all of one kind."""

    kind: Literal["duo-lateral", "tetra-lateral"] = Field(default="duo-lateral", description="its layout")
    size_mm: Positive = Field(default=20.0, description="side of the active square, millimetres")
    surround_mm: Positive = Field(
        default=400.0,
        description="side of the square about it, its housing and its support, where the laser's spot "
        "can be seen, millimetres",
    )
    leds_mm: Positive = Field(default=70.0, description="distance of the two LEDs, along x, millimetres")
    noise_mm: Positive = Field(
        default=0.0005, description="standard deviation of a sample at full light, millimetres"
    )
    resolution_mm: Positive = Field(default=0.0001, description="step of a reading, millimetres")
    nonlinearity: Annotated[float, Field(ge=0, le=0.33)] = Field(
        default=0.003, description="error at the edge, share of the half size"
    )
    ambient: NotNegative = Field(default=0.05, description="ambient light, share of the laser's")
    saturation: Positive = Field(default=2.0, description="largest current, share of the laser's light")
    rate_hz: Positive = Field(default=200.0, description="samples a second")
    lost: Annotated[float, Field(ge=0, lt=1)] = Field(
        default=0.01, description="share of the samples that the wireless link loses"
    )
    placed: dict[TargetName, PlacedPsd] = Field(default={}, description="pose of each, by target")


class CameraInCell(FileModel):
    """The camera on the flange."""

    width_px: Count = Field(default=640, description="columns")
    height_px: Count = Field(default=480, description="rows")
    focal_px: Positive = Field(default=700.0, description="focal length, pixels")
    distortion: Annotated[tuple[float, float, float, float, float], tuple_of(5)] = Field(
        default=(-0.2, 0.05, 0.0005, -0.0005, 0.0), description="k1, k2, p1, p2, k3 (Brown-Conrady)"
    )
    beside_mm: NumberPair = Field(
        default=(60.0, 0.0), description="where it sits beside the beam, along b1 and b2, millimetres"
    )
    behind_mm: float = Field(default=0.0, description="how far behind the TCP, millimetres")
    misturned_deg: Vector = Field(
        default=(0.2, -0.2, 0.3), description="its true rotation from its mount, degrees"
    )
    exposure: Positive = Field(default=1.0, description="exposure, share of the usual")
    noise_grey: NotNegative = Field(
        default=1.5, description="standard deviation of the reading noise, grey values"
    )
    ambient_grey: NotNegative = Field(default=12.0, description="background, grey values")
    led_light: Positive = Field(default=4000.0, description="sum of grey values of a LED at 1 m")
    spot_light: Positive = Field(default=5000.0, description="the same of the laser's spot on the PSD")
    psf_px: Positive = Field(default=1.0, description="standard deviation of the image of a point, pixels")
    image_s: NotNegative = Field(default=0.2, description="time that an image takes, seconds")


class CellFile(SourcedModel):
    """The content of a cell file; one that was read from a file knows where its keys are."""

    schema_: Literal["zerobeam/cell/1"] = Field(
        default=CELL_SCHEMA, alias="schema", description="kind and version of the file"
    )
    robot: RobotRef | None = Field(
        default=None,
        description="the robot of the cell, as in a header: a plan of another one is refused",
    )
    arm: ArmInCell = Field(default=ArmInCell(), description="the true arm")
    laser: LaserInCell = Field(default=LaserInCell(), description="the true beam")
    psd: PsdInCell = Field(default=PsdInCell(), description="the sensors")
    camera: CameraInCell | None = Field(
        default=CameraInCell(), description="the camera on the flange; null: there is none"
    )
    faults: Annotated[tuple[Fault, ...], BeforeValidator(as_tuple)] = Field(
        default=(), description="what goes wrong on purpose"
    )

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if self.camera is None:
            for i, fault in enumerate(self.faults):
                if fault.kind in ("camera-black", "led-occluded"):
                    raise refusal(
                        f"a fault of the camera ({fault.kind}) in a cell without one",
                        key=("faults", i),
                        remedy="remove camera: null, or the fault",
                    )
        return self

    def placed(self, target: str) -> PlacedPsd:
        """Pose of the PSD that is this target."""
        return self.psd.placed.get(target, PlacedPsd())

    def named_robot(self) -> Robot | None:
        """The robot that the file names, a path taken relative to the file."""
        if self.robot is None:
            return None
        return load_robot(self.robot, self.folder, file=self.file, line=self.line(("robot",)))


def read_cell(path: Path | str) -> CellFile:
    """A cell file, every key of it checked."""
    return read_model(CellFile, path, CELL_SCHEMA)
