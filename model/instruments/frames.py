"""What a tracker and a pose have in common: a frame of their own in the world, free or known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Literal, NamedTuple, Self

import casadi as ca
import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from ..arrays import Matrix
from ..parsing.reading import shown
from ..parsing.validation import FileModel, Positive, Vector, refusal
from .kind import Assumption, Station, Target, Unknown
from .rotations import (
    Quaternion,
    rotation,
    rotation_of_quaternion,
    rotation_vector,
    turned,
    unit_quaternion,
)

FREE_MM, FREE_RAD = 500.0, float(np.pi)  # prior stds of what the flange carries where nothing is stated
_FRAME_MM = 10_000.0
_MOST = 200  # measurements that a start is solved from
_STANDS_MM = (3000.0, 0.0, 500.0)  # where an instrument stands of which nobody says
_PLACED_MM, _LEVEL = 100.0, float(np.radians(0.5))  # stds of where one stands, and of its level, by chance
_UNITS: tuple[Literal["deg", "mm"], ...] = ("deg", "mm")


class StatedKnownFrame(FileModel):
    """Where an instrument's frame is in the base frame."""

    xyz_mm: Vector = Field(description="origin of the instrument's frame in the base frame, millimetres")
    quat: Quaternion = Field(description="its orientation: a unit quaternion [w, x, y, z]")
    sigma_mm: Positive | None = Field(
        default=None,
        description="standard deviation of each coordinate of its origin, millimetres; with sigma_deg;"
        " without both it is taken as exact",
    )
    sigma_deg: Positive | None = Field(
        default=None, description="standard deviation of its rotation about each axis, degrees"
    )

    @model_validator(mode="after")
    def _both_or_none(self) -> Self:
        if (self.sigma_mm is None) != (self.sigma_deg is None):
            absent = "sigma_mm" if self.sigma_mm is None else "sigma_deg"
            raise refusal(
                f"{absent} is missing: how well a frame is known is said of its origin and of its rotation",
                allowed="both, or neither of a frame that is taken as exact",
                remedy=f"add {absent}",
            )
        return self


def _frame(value: object) -> object:
    parts = value if isinstance(value, dict | list | tuple) else ()
    if "free" in parts and len(parts) > 1:
        raise refusal(
            "an instrument's frame is both free and known",
            found=shown(value),
            allowed="free, or the keys xyz_mm and quat",
            remedy="state frame: free to have it estimated, or where it is without the word free",
        )
    if value != "free" and not isinstance(value, dict | StatedKnownFrame):
        raise refusal(
            "this says nothing of the instrument's frame",
            found=shown(value),
            allowed="free, or the keys xyz_mm and quat",
            remedy="state frame: free where nobody has measured it",
        )
    return value


StatedFrame = Annotated[
    Annotated[
        Annotated[Literal["free"], Tag("<free>")] | Annotated[StatedKnownFrame, Tag("<known>")],
        Discriminator(lambda value: "<free>" if value == "free" else "<known>"),
    ],
    BeforeValidator(_frame),
]


class StationFrame(NamedTuple):
    """A frame in the base frame: `rotation` (3, 3) and `origin` (3,) mm, and the prior stds of both, mm and
    rad, which are `stated`; or nothing but a wide prior (`free`), or nothing at all (`exact`)."""

    rotation: Matrix
    origin: Matrix
    std_mm: float
    std_rad: float
    known: Literal["exact", "stated", "free"]

    @classmethod
    def of(cls, frame: Literal["free"] | StatedKnownFrame) -> StationFrame:
        if not isinstance(frame, StatedKnownFrame):
            return cls(np.eye(3), np.zeros(3), _FRAME_MM, FREE_RAD, "free")
        rotation = rotation_of_quaternion(unit_quaternion(frame.quat))
        origin = np.array(frame.xyz_mm, dtype=float)
        if frame.sigma_mm is None or frame.sigma_deg is None:
            return cls(rotation, origin, 0.0, 0.0, "exact")
        return cls(rotation, origin, frame.sigma_mm, float(np.radians(frame.sigma_deg)), "stated")

    @property
    def free(self) -> bool:
        return self.known == "free"

    @property
    def exact(self) -> bool:
        return self.known == "exact"


def vector_unknowns(of: str, mean: Matrix, std: float, *, tolerated: bool) -> tuple[Unknown, ...]:
    """x, y, z of what the flange carries, mm."""
    axes = zip("xyz", mean.tolist(), strict=True)
    return tuple(Unknown(axis, "mm", value, std, of, tolerated=tolerated) for axis, value in axes)


class StatedStand(FileModel):
    """Where an instrument with a frame of its own stands."""

    frame: StatedFrame = Field(default="free", description="free, or where its frame is in the base frame")
    guess_mm: Vector | None = Field(
        default=None,
        description="approximate position of an instrument with a free frame, base frame, millimetres: for"
        " plans, which keep the line of sight free",
    )

    @model_validator(mode="after")
    def _free_or_known(self) -> Self:
        if self.guess_mm is not None and self.frame != "free":
            raise refusal(
                "guess_mm is stated of an instrument whose frame is known",
                key=("guess_mm",),
                found=f"guess_mm: {shown(self.guess_mm)}",
                remedy="remove it, or state frame: free",
            )
        return self


@dataclass(frozen=True, eq=False)
class FramedStation(Station):
    """It reads positions in its own `frame`, wherever the arm stands; `stand` (3,) mm about where the origin
    of a free one is, or None."""

    target = "target"
    target_is = "nothing"
    met = False

    frame: StationFrame
    stand: Matrix | None

    @property
    def grounded(self) -> bool:
        return not self.frame.free

    @property
    def varies(self) -> bool:
        return True

    @property
    def frame_unknowns(self) -> tuple[Unknown, ...]:
        """Origin, and rotation vector from the orientation of `frame`, both in the base frame."""
        frame = self.frame
        if frame.exact:
            return ()
        tolerated = not frame.free
        lengths = (
            Unknown(axis, "mm", mean, frame.std_mm, self.label, "frame", tolerated=tolerated)
            for axis, mean in zip("xyz", frame.origin.tolist(), strict=True)
        )
        angles = (
            Unknown(axis, "deg", 0.0, frame.std_rad, self.label, "frame", tolerated=tolerated)
            for axis in ("rx", "ry", "rz")
        )
        return (*lengths, *angles)

    @property
    def taken_as_known(self) -> tuple[Assumption, ...]:
        """Where its frame is: of an exact one nobody states how well that is known."""
        frame = self.frame
        if frame.free:
            return ()
        stds = {"deg": float(np.degrees(frame.std_rad)), "mm": frame.std_mm}
        key = f"instruments.{self.label}.frame"
        return tuple(
            Assumption(
                label=self.label,
                of=self.label,
                kind=self.name,
                part="frame",
                std=None if frame.exact else stds[unit],
                unit=unit,
                stated=not frame.exact,
                key=f"{key}.sigma_{unit}",
            )
            for unit in _UNITS
        )

    def freed(self) -> tuple[Self, Mapping[str, float]]:
        """With a free frame in place of an exact one, which is where it was known to be."""
        if not self.frame.exact:
            return self, {}
        frame = self.frame._replace(std_mm=_FRAME_MM, std_rad=FREE_RAD, known="free")
        free = replace(self, frame=frame)
        return free, {f"{unknown.of}.{unknown.axis}": unknown.mean for unknown in free.frame_unknowns}

    def frame_at(self, unknowns: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Rotation (3, 3) and origin (3, 1) mm of the instrument's frame in the base frame."""
        rotation, origin = ca.SX(self.frame.rotation), ca.SX(self.frame.origin)
        if self.frame.exact:
            return rotation, origin
        last = unknowns[len(self.unknowns) - 6 :]
        return ca.mtimes(turned(last[3:]), rotation), last[:3]

    def sight(self, pose: Matrix, target: Matrix, unknowns: Matrix, reading: Matrix, variant: str) -> Matrix:
        """To where the instrument is."""
        origin = self.frame.origin if self.frame.exact else unknowns[-6:-3]
        return np.array([self.on_flange(pose, unknowns, variant), origin])

    @property
    def stands_at(self) -> Matrix:
        """Where its frame is stated to be; of a free one upright, and turned as the base frame."""
        if self.frame.exact:
            return np.zeros(0)
        stand = _STANDS_MM if self.stand is None else self.stand
        return np.array([*(stand if self.frame.free else self.frame.origin), 0.0, 0.0, 0.0])

    def in_sight(self, target: Target) -> Matrix | None:
        return self.stand if self.frame.free else self.frame.origin

    def placed(self, rng: np.random.Generator) -> Matrix:
        """Within what is stated; of a free one turned anyhow about the vertical."""
        frame = self.frame
        if frame.exact:
            return np.zeros(0)
        if not frame.free:
            return np.concatenate(
                [frame.origin + frame.std_mm * rng.normal(size=3), frame.std_rad * rng.normal(size=3)]
            )
        origin = self.stands_at[:3] + _PLACED_MM * rng.normal(size=3)
        upright = rotation(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]))
        turn = rotation(_LEVEL * rng.normal(size=3)) @ upright
        return np.concatenate([origin, rotation_vector(turn @ frame.rotation.T)])

    def mirrored_axes(self, *, free: bool) -> tuple[int, ...]:
        """Which axes (1, 2, 3) may have the wrong sign; (0,) where a `free` frame makes them one."""
        return (0,) if free and self.frame.free else (1, 2, 3)

    @property
    def frame_key(self) -> bytes:
        """Of an exact frame the origin is in the functions, too."""
        rotation = self.frame.rotation.tobytes()
        return rotation + self.frame.origin.tobytes() if self.frame.exact else b"free" + rotation


def spread(count: int) -> Matrix:
    """Indices of at most 200 of the measurements, evenly spread: enough for a start."""
    return np.unique(np.linspace(0, count - 1, min(count, _MOST)).astype(int))
