"""Instruments that measure a length: a dial gauge, whose plunger touches a flat face, and a ball bar or draw
wire between two sockets."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, Self

import casadi as ca
import numpy as np
from pydantic import BeforeValidator, Field

from ..arrays import Mask, Matrix
from ..parsing.reading import shown
from ..parsing.validation import FileModel, Vector, refusal, with_length
from .frames import FREE_MM
from .kind import (
    TARGET_OUT,
    TIP,
    Flange,
    Misread,
    Point,
    ProposedHeader,
    Target,
    TargetEntry,
    Unknown,
    Words,
    faces_at,
    target_at,
    whole_point,
)
from .tips import (
    StatedRange,
    StatedTip,
    TipStation,
    directions,
    distance,
    fitted_plane,
    patch,
    plane_at,
    plane_coordinates,
    plane_normal,
    points_on,
    sphere_through,
    tip_std,
    unit_normal,
)

_LEAST_SLOPE = 1e-9  # of the direction against the plane
_RANGE = (0.0, 10.0)  # mm
_OBLIQUE = float(np.radians(30.0))  # between the plunger and the face's normal, in a plan


class StatedDial(StatedTip, StatedRange):
    """A dial gauge on the flange."""

    kind: Literal["dial"] = Field(description="this kind of instrument")
    direction: Annotated[Vector, with_length("the direction")] = Field(
        description="in which its reading grows, in the flange frame, any length: towards the face"
    )


@dataclass(frozen=True, eq=False)
class Dial(TipStation):
    """Its residual is the travel s at which its tip p, moved along its direction u, meets the plane
    (n · (p + s u) = d), less what was read.

    `direction` (3,) unit, in the flange frame. A reading is the measured travel, mm, and the stated unit
    normal of the plane (3,).
    """

    name = "dial"
    also_called = ("dial gauge", "dial indicator", "gauge", "indicator", "clock", "plunger")
    columns: ClassVar[dict[str, int]] = {"measured_mm": 1}
    entered: ClassVar[dict[str, str]] = {"measured_mm": "reading (mm)"}
    headed: ClassVar[dict[str, tuple[str, ...]]] = {"measured_mm": ("reading (mm)",)}
    target = "plane"
    target_is = "plane"
    met = False
    reading_size = 4
    Stated: ClassVar[type[FileModel]] = StatedDial
    title = "Dial gauge on flat faces"
    mark = "dial"
    words = Words(
        is_="a gauge that measures the travel to a flat face",
        part="tip of the gauge",
        motion="shift of the tip of the gauge",
        unit="mm",
        reading="travel",
        method="a dial gauge on the flange and flat faces in the cell",
        posture="the gauge at the face",
        to_do="Move slowly towards the face until the gauge reads within its range. Write down its reading"
        " and the joints.",
        fields=(),
        traced=(
            ("Dial gauge, maker and serial number", ("dial gauge", "dial gauge serial")),
            ("Dial gauge, calibration certificate", ("dial gauge certificate",)),
        ),
        act="move slowly until the gauge reads within its range",
    )

    direction: Matrix
    range: tuple[float, float]

    @classmethod
    def proposed(cls, reach: float, target: Point) -> ProposedHeader:
        gauge = {"kind": "dial", "tip_mm": list(TIP), "direction": [0.0, 0.0, 1.0], "sigma_mm": 0.01}
        faces = {name: row | {"radius_mm": 100.0} for name, row in faces_at(target, ("top", "back")).items()}
        return ProposedHeader({"instruments": {"gauge": gauge}, "targets": faces}, 1, turns=True)

    @classmethod
    def of(cls, label: str, header: StatedDial, *, exact: bool) -> Self:
        direction = np.array(header.direction, dtype=float)
        return cls(
            label=label,
            tip=np.array(header.tip_mm, dtype=float),
            tip_std=tip_std(header, exact=exact),
            sigma=header.sigma_mm,
            tip_stated=header.tip_sigma_mm is not None,
            direction=direction / np.linalg.norm(direction),
            range=header.range_mm or _RANGE,
        )

    @property
    def key(self) -> bytes:
        return super().key + self.direction.tobytes()

    def coordinates(self, target: TargetEntry | None) -> tuple[Unknown, Unknown, Unknown]:
        return plane_coordinates(target)

    def reading(
        self, measured: Mapping[str, Sequence[float]], sigma: float | None, target: TargetEntry | None
    ) -> Matrix:
        return np.array([*measured.get("measured_mm", (0.0,)), *unit_normal(target)])

    def recorded(self, reading: Matrix, shift: Matrix) -> dict[str, tuple[float, ...]]:
        return {"measured_mm": tuple((reading[:1] + shift).tolist())}

    def _travel(self, flange: Flange, target: ca.SX, unknowns: ca.SX, normal: ca.SX) -> ca.SX:
        n, d = plane_at(target, normal)
        slope = ca.dot(n, flange.rotation @ ca.SX(self.direction))
        # Along the plane there is no travel; a large one says so, and stays finite where nothing is read.
        slope = ca.if_else(ca.fabs(slope) < _LEAST_SLOPE, _LEAST_SLOPE, slope)
        return (d - ca.dot(n, flange.in_base(self.tip_at(unknowns)))) / slope

    def misread(self, readings: Matrix) -> Iterator[Misread]:
        yield Misread(self.label, "metres", readings * [1000, 1, 1, 1])

    def residual(self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str) -> ca.SX:
        return self._travel(flange, target, unknowns, reading[1:]) - reading[0]

    def predicted(
        self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str
    ) -> ca.SX:
        return ca.vertcat(self._travel(flange, target, unknowns, reading[1:]), reading[1:])

    def goals(self, rng: np.random.Generator, count: int, target: Target) -> Matrix:
        """The tip before the face by a travel within the range."""
        travel = rng.uniform(*self.range, size=(count, 1))
        return points_on(target, rng, count) + travel * plane_normal(target)

    def prevented(self, poses: Matrix, target: Target, variant: str) -> dict[str, Mask]:
        normal = plane_normal(target)
        slope = -(poses[:, :3, :3] @ self.direction @ normal)
        above = self.tips(poses) @ normal - target.numbers[0]
        travel = above / np.maximum(slope, _LEAST_SLOPE)
        outside = (travel < self.range[0]) | (travel > self.range[1])
        return {
            "the plunger is too oblique to the face": slope < np.cos(_OBLIQUE),
            "the travel is out of the range of the gauge": outside,
        }

    def sight(self, pose: Matrix, target: Matrix, unknowns: Matrix, reading: Matrix, variant: str) -> Matrix:
        tip = self.on_flange(pose, unknowns, variant)
        return np.array([tip, tip + reading[0] * (pose[:3, :3] @ self.direction)])

    def outlines(self, target: Matrix, reading: Matrix, touched: Matrix) -> tuple[Matrix, ...]:
        return (patch(target, reading[1:], touched),)

    def start_target(self, poses: Matrix, readings: Matrix, unknowns: Matrix) -> Matrix:
        touched = self.tips(poses, unknowns) + readings[:, :1] * (poses[:, :3, :3] @ self.direction)
        return fitted_plane(touched, np.asarray(readings[0, 1:]), 0.0)


_SOCKETS = ((0.55, 0.2), (0.45, -0.3))  # of the reach: where the sockets of a new calibration are
_BAR = (0.15, 0.5)  # of the reach: its shortest and longest length


def _bias(value: object) -> object:
    if value != "free" and (isinstance(value, bool) or not isinstance(value, int | float)):
        raise refusal(
            "this is no zero of a length",
            found=shown(value),
            allowed="free, or what the bar reads at no length, millimetres",
        )
    return value


class StatedBallbar(StatedTip, StatedRange):
    """A bar or wire whose one end is a socket on the flange."""

    kind: Literal["ballbar"] = Field(description="this kind of instrument")
    bias: Annotated[Literal["free"] | float, BeforeValidator(_bias)] = Field(
        default=0.0, description="what it reads at no length, millimetres; free where nobody knows"
    )


@dataclass(frozen=True, eq=False)
class Ballbar(TipStation):
    """Its residual is the distance of its two sockets, and what it reads at no length, less what was read.

    `bias` mm, or None where it is free. A reading is the measured length, mm (1,).
    """

    name = "ballbar"
    also_called = ("ball bar", "bar", "draw wire", "drawwire", "wire", "string pot", "telescope")
    columns: ClassVar[dict[str, int]] = {"measured_mm": 1}
    entered: ClassVar[dict[str, str]] = {"measured_mm": "length (mm)"}
    headed: ClassVar[dict[str, tuple[str, ...]]] = {"measured_mm": ("length (mm)",)}
    target = "socket"
    target_is = "point"
    met = False
    reading_size = 1
    Stated: ClassVar[type[FileModel]] = StatedBallbar
    title = "Ball bar"
    mark = "ballbar"
    words = Words(
        is_="a bar or wire that measures the length to a fixed socket",
        part="socket on the flange",
        motion="shift of the socket",
        unit="mm",
        reading="length",
        method="a ball bar between the flange and fixed sockets in the cell",
        posture="the bar to its socket",
        to_do="Go to the posture slowly; stay within the range of the bar. Write down its length and the"
        " joints.",
        fields=(),
        traced=(
            ("Ball bar, maker and serial number", ("ball bar", "ball bar serial", "ball bar serial number")),
            ("Ball bar, calibration certificate", ("ball bar certificate",)),
        ),
    )

    bias: float | None
    range: tuple[float, float] | None

    @classmethod
    def proposed(cls, reach: float, target: Point) -> ProposedHeader:
        lengths = [round(share * reach, -1) for share in _BAR]
        bar = {"kind": "ballbar", "tip_mm": list(TIP), "sigma_mm": 0.005, "range_mm": lengths}
        sockets = {
            f"s{number}": target_at(
                np.add(target, whole_point(((out - TARGET_OUT) * reach, side * reach, 0.0)))
            )
            for number, (out, side) in enumerate(_SOCKETS, start=1)
        }
        return ProposedHeader({"instruments": {"bar": bar}, "targets": sockets}, 1, turns=True)

    @classmethod
    def of(cls, label: str, header: StatedBallbar, *, exact: bool) -> Self:
        bias = None if header.bias == "free" else float(header.bias)
        return cls(
            label=label,
            tip=np.array(header.tip_mm, dtype=float),
            tip_std=tip_std(header, exact=exact),
            sigma=header.sigma_mm,
            tip_stated=header.tip_sigma_mm is not None,
            bias=bias,
            range=header.range_mm,
        )

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        zero = (Unknown("bias", "mm", 0.0, FREE_MM, self.label),) if self.bias is None else ()
        return (*super().unknowns, *zero)

    @property
    def key(self) -> bytes:
        return super().key + f" {self.bias}".encode()

    def reading(
        self, measured: Mapping[str, Sequence[float]], sigma: float | None, target: TargetEntry | None
    ) -> Matrix:
        return np.array(measured.get("measured_mm", (0.0,)), dtype=float)

    def recorded(self, reading: Matrix, shift: Matrix) -> dict[str, tuple[float, ...]]:
        return {"measured_mm": tuple((reading + shift).tolist())}

    def misread(self, readings: Matrix) -> Iterator[Misread]:
        yield Misread(self.label, "metres", readings * 1000)

    def residual(self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str) -> ca.SX:
        return self.predicted(flange, target, unknowns, reading, variant) - reading

    def predicted(
        self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str
    ) -> ca.SX:
        zero = unknowns[len(self.unknowns) - 1] if self.bias is None else self.bias
        return distance(flange.in_base(self.tip_at(unknowns)), target) + zero

    def goals(self, rng: np.random.Generator, count: int, target: Target) -> Matrix | None:
        if self.range is None:
            return None
        lengths = rng.uniform(*self.range, size=(count, 1)) - (self.bias or 0.0)
        return np.asarray(target.numbers + lengths * directions(rng, count))

    def prevented(self, poses: Matrix, target: Target, variant: str) -> dict[str, Mask]:
        if self.range is None:
            return {}
        length = np.linalg.norm(self.tips(poses) - target.numbers, axis=1) + (self.bias or 0.0)
        return {
            "the length is out of the range of the bar": (length < self.range[0]) | (length > self.range[1])
        }

    def in_sight(self, target: Target) -> Matrix:
        return target.numbers

    def sight(self, pose: Matrix, target: Matrix, unknowns: Matrix, reading: Matrix, variant: str) -> Matrix:
        return np.array([self.on_flange(pose, unknowns, variant), target])

    def start_target(self, poses: Matrix, readings: Matrix, unknowns: Matrix) -> Matrix:
        """With a free zero, from five measurements on that is solved for as well."""
        free = self.bias is None and len(poses) > 4
        zero = float(unknowns[-1]) if self.bias is None else self.bias
        return sphere_through(self.tips(poses, unknowns), readings[:, 0] - zero, zero_free=free)
