"""What a tracker and a pose have in common: a frame of their own in the world, free or known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Literal, Self

import casadi as ca
import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from ..arrays import Matrix
from ..parsing.reading import shown
from ..parsing.validation import FileModel, Vector, refusal
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


class StatedKnownFrame(FileModel):
    """Where an instrument's frame is in the base frame."""

    xyz_mm: Vector = Field(description="origin of the instrument's frame in the base frame, millimetres")
    quat: Quaternion = Field(description="its orientation: a unit quaternion [w, x, y, z]")


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


def known_frame(frame: Literal["free"] | StatedKnownFrame) -> tuple[Matrix, Matrix] | None:
    """Rotation (3, 3) and origin (3,) mm of a frame in the base frame; None of a free one."""
    if isinstance(frame, StatedKnownFrame):
        return rotation_of_quaternion(unit_quaternion(frame.quat)), np.array(frame.xyz_mm, dtype=float)
    return None


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
    """It reads positions in its own frame, wherever the arm stands: `frame` is where that is, or None;
    `stand` (3,) mm about where the origin of a free one is, or None."""

    target = "target"
    target_is = "nothing"
    met = False

    frame: tuple[Matrix, Matrix] | None
    stand: Matrix | None

    @property
    def grounded(self) -> bool:
        return self.frame is not None

    @property
    def varies(self) -> bool:
        return True

    @property
    def frame_unknowns(self) -> tuple[Unknown, ...]:
        """Origin and rotation vector of a free frame, in the base frame."""
        if self.frame is not None:
            return ()
        lengths = (Unknown(axis, "mm", 0.0, _FRAME_MM, self.label, "frame") for axis in "xyz")
        angles = (Unknown(axis, "deg", 0.0, FREE_RAD, self.label, "frame") for axis in ("rx", "ry", "rz"))
        return (*lengths, *angles)

    @property
    def taken_as_known(self) -> tuple[Assumption, ...]:
        """Where its frame is: nobody states how well that is known."""
        if self.frame is None:
            return ()
        key = f"instruments.{self.label}.frame"
        return tuple(
            Assumption(self.label, self.label, self.name, "frame", None, unit, stated=False, key=key)
            for unit in ("deg", "mm")
        )

    def freed(self) -> tuple[Self, Mapping[str, float]]:
        """With a free frame, which is where it was known to be."""
        if self.frame is None:
            return self, {}
        rotation, origin = self.frame
        values = [*origin.tolist(), *rotation_vector(rotation).tolist()]
        free = replace(self, frame=None)
        names = (f"{unknown.of}.{unknown.axis}" for unknown in free.frame_unknowns)
        return free, dict(zip(names, values, strict=True))

    def frame_at(self, unknowns: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Rotation (3, 3) and origin (3, 1) mm of the instrument's frame in the base frame."""
        if self.frame is not None:
            return ca.SX(self.frame[0]), ca.SX(self.frame[1])
        last = unknowns[len(self.unknowns) - 6 :]
        return turned(last[3:]), last[:3]

    def sight(self, pose: Matrix, target: Matrix, unknowns: Matrix, reading: Matrix, variant: str) -> Matrix:
        """To where the instrument is."""
        origin = unknowns[-6:-3] if self.frame is None else self.frame[1]
        return np.array([self.on_flange(pose, unknowns, variant), origin])

    @property
    def stands_at(self) -> Matrix:
        """Upright, and turned as the base frame."""
        if self.frame is not None:
            return np.zeros(0)
        return np.array([*(_STANDS_MM if self.stand is None else self.stand), 0.0, 0.0, 0.0])

    def in_sight(self, target: Target) -> Matrix | None:
        return self.stand if self.frame is None else self.frame[1]

    def placed(self, rng: np.random.Generator) -> Matrix:
        """Turned anyhow about the vertical."""
        if self.frame is not None:
            return np.zeros(0)
        origin = self.stands_at[:3] + _PLACED_MM * rng.normal(size=3)
        upright = rotation(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]))
        turn = rotation(_LEVEL * rng.normal(size=3)) @ upright
        return np.concatenate([origin, rotation_vector(turn)])

    def mirrored_axes(self, *, free: bool) -> tuple[int, ...]:
        """Which axes (1, 2, 3) may have the wrong sign; (0,) where a `free` frame makes them one."""
        return (0,) if free and self.frame is None else (1, 2, 3)

    @property
    def frame_key(self) -> bytes:
        return b"free" if self.frame is None else self.frame[0].tobytes() + self.frame[1].tobytes()


def spread(count: int) -> Matrix:
    """Indices of at most 200 of the measurements, evenly spread: enough for a start."""
    return np.unique(np.linspace(0, count - 1, min(count, _MOST)).astype(int))
