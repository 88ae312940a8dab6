"""A probe on the flange that touches flat faces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, Self

import casadi as ca
import numpy as np
from pydantic import Field

from ..arrays import Matrix
from ..parsing.validation import FileModel, NotNegative
from .kind import Flange, TargetEntry, Unknown, Words
from .tips import StatedTip, TipStation, fitted_plane, plane_at, plane_coordinates, tip_std, unit_normal


class StatedPlaneProbe(StatedTip):
    """A probe on the flange that touches planes."""

    kind: Literal["plane"] = Field(description="this kind of instrument")
    tip_diameter_mm: NotNegative = Field(
        default=0.0, description="diameter of the ball whose centre the tip is, millimetres; 0 for a point"
    )


@dataclass(frozen=True, eq=False)
class PlaneProbe(TipStation):
    """Its residual is how far the ball of `radius` mm is above the plane, along the normal.

    A reading is the stated unit normal of the plane (3,), out of the body.
    """

    name = "plane"
    also_called = ("face", "flat", "datum", "cube", "datum cube")
    columns: ClassVar[dict[str, int]] = {}
    target = "plane"
    target_is = "plane"
    met = True
    reading_size = 3
    Stated: ClassVar[type[FileModel]] = StatedPlaneProbe
    words = Words(
        is_="a tip that touches flat faces",
        part="probe tip",
        motion="shift of the probe tip",
        unit="mm",
        reading="touch",
        method="a probe on the flange and flat faces in the cell",
        posture="the probe at the face",
        to_do="Move slowly towards the face until the probe touches it, and write down the joints.",
        fields=("face",),
        traced=(
            ("Probe, maker and serial number", ("probe", "probe serial", "probe serial number")),
            ("Probe, calibration certificate", ("probe certificate",)),
        ),
    )

    radius: float

    @classmethod
    def of(cls, label: str, header: StatedPlaneProbe, *, exact: bool) -> Self:
        return cls(
            label=label,
            tip=np.array(header.tip_mm, dtype=float),
            tip_std=tip_std(header, exact=exact),
            sigma=header.sigma_mm,
            radius=header.tip_diameter_mm / 2,
        )

    @property
    def key(self) -> bytes:
        return super().key + f" {self.radius}".encode()

    def coordinates(self, target: TargetEntry | None) -> tuple[Unknown, Unknown, Unknown]:
        return plane_coordinates(target)

    def reading(
        self, measured: Mapping[str, Sequence[float]], sigma: float | None, target: TargetEntry | None
    ) -> Matrix:
        return unit_normal(target)

    def residual(self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str) -> ca.SX:
        normal, d = plane_at(target, reading[:3])
        return ca.dot(normal, flange.in_base(self.tip_at(unknowns))) - self.radius - d

    def start_target(self, poses: Matrix, readings: Matrix, unknowns: Matrix) -> Matrix:
        return fitted_plane(self.tips(poses, unknowns), np.asarray(readings[0, :3]), self.radius)
