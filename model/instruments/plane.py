"""A probe on the flange that touches flat faces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import Field

from ..arrays import Mask, Matrix
from ..parsing.validation import FileModel
from .kind import TIP, Flange, Point, ProposedHeader, Target, TargetEntry, Unknown, Words, faces_at
from .tips import (
    BallTipStation,
    StatedBallTip,
    fitted_plane,
    patch,
    plane_at,
    plane_coordinates,
    plane_normal,
    points_on,
    unit_normal,
)


class StatedPlaneProbe(StatedBallTip):
    """A probe on the flange that touches planes."""

    kind: Literal["plane"] = Field(description="this kind of instrument")


@dataclass(frozen=True, eq=False)
class PlaneProbe(BallTipStation):
    """Its residual is how far the ball of `radius` mm is above the plane, along the normal.

    A reading is the stated unit normal of the plane (3,), out of the body.
    """

    name = "plane"
    also_called = ("face", "flat", "datum", "cube", "datum cube")
    target = "plane"
    target_is = "plane"
    reading_size = 3
    Stated: ClassVar[type[FileModel]] = StatedPlaneProbe
    title = "Touches of flat faces"
    mark = "plane"
    words = Words(
        is_="a tip that touches flat faces",
        part="probe tip",
        motion="shift of the probe tip",
        unit="mm",
        reading="touch",
        method="a probe on the flange and flat faces in the cell",
        posture="the probe at the face",
        to_do="Move slowly towards the face until the probe touches it, and write down the joints.",
        fields=(),
        traced=(
            ("Probe, maker and serial number", ("probe", "probe serial", "probe serial number")),
            ("Probe, calibration certificate", ("probe certificate",)),
        ),
        act="move slowly until the probe touches the face",
    )

    @classmethod
    def proposed(cls, reach: float, target: Point) -> ProposedHeader:
        stylus = {"kind": "plane", "tip_mm": list(TIP), "tip_diameter_mm": 6.0, "sigma_mm": 0.02}
        faces = faces_at(target, ("top", "back", "side"))
        return ProposedHeader({"instruments": {"stylus": stylus}, "targets": faces}, 1, turns=True)

    def coordinates(self, target: TargetEntry | None) -> tuple[Unknown, Unknown, Unknown]:
        return plane_coordinates(target)

    def reading(
        self, measured: Mapping[str, Sequence[float]], sigma: float | None, target: TargetEntry | None
    ) -> Matrix:
        return unit_normal(target)

    def residual(self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str) -> ca.SX:
        normal, d = plane_at(target, reading[:3])
        return ca.dot(normal, flange.in_base(self.tip_at(unknowns))) - self.radius - d

    def goals(self, rng: np.random.Generator, count: int, target: Target) -> Matrix:
        return points_on(target, rng, count) + self.radius * plane_normal(target)

    def prevented(self, poses: Matrix, target: Target, variant: str) -> dict[str, Mask]:
        return {"the probe comes from the inside of the face": self.through(poses, plane_normal(target))}

    def outlines(self, target: Matrix, reading: Matrix, touched: Matrix) -> tuple[Matrix, ...]:
        return (patch(target, reading[:3], touched),)

    def start_target(self, poses: Matrix, readings: Matrix, unknowns: Matrix) -> Matrix:
        return fitted_plane(self.tips(poses, unknowns), np.asarray(readings[0, :3]), self.radius)
