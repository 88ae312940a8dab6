"""A probe on the flange that touches balls."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import Field

from ..arrays import Mask, Matrix
from ..errors import BadInput
from ..parsing.validation import FileModel
from .kind import (
    TIP,
    Flange,
    Point,
    ProposedHeader,
    Target,
    TargetEntry,
    Unknown,
    Words,
    target_at,
    whole_point,
)
from .tips import BallTipStation, StatedBallTip, directions, distance, sphere_through


class StatedSphereProbe(StatedBallTip):
    """A probe on the flange that touches balls."""

    kind: Literal["sphere"] = Field(description="this kind of instrument")


@dataclass(frozen=True, eq=False)
class SphereProbe(BallTipStation):
    """Its residual is how far the tip's ball of `radius` mm is off the target's ball, along their centres.

    A reading is the radius of the target's ball, mm (1,).
    """

    name = "sphere"
    also_called = ("ball", "master ball", "datum ball")
    target = "ball"
    target_is = "point"
    touches_ball = True
    reading_size = 1
    Stated: ClassVar[type[FileModel]] = StatedSphereProbe
    title = "Touches of balls"
    mark = "sphere"
    words = Words(
        is_="a tip that touches balls",
        part="probe tip",
        motion="shift of the probe tip",
        unit="mm",
        reading="touch",
        method="a probe on the flange and balls in the cell",
        posture="the probe at the ball",
        to_do="Move slowly towards the ball until the probe touches it, and write down the joints.",
        fields=(),
        traced=(
            ("Probe, maker and serial number", ("probe", "probe serial", "probe serial number")),
            ("Probe, calibration certificate", ("probe certificate",)),
            ("Ball, calibration certificate", ("ball certificate",)),
        ),
        act="move slowly until the probe touches the ball",
    )

    @classmethod
    def proposed(cls, reach: float, target: Point) -> ProposedHeader:
        stylus = {"kind": "sphere", "tip_mm": list(TIP), "tip_diameter_mm": 6.0, "sigma_mm": 0.02}
        balls = {
            name: {"kind": "sphere", "diameter_mm": 25.4}
            | target_at(np.add(target, whole_point((0.0, side * reach, 0.0))))
            for name, side in (("ball1", -0.15), ("ball2", 0.15))
        }
        return ProposedHeader({"instruments": {"stylus": stylus}, "targets": balls}, 1, turns=True)

    def coordinates(self, target: TargetEntry | None) -> tuple[Unknown, Unknown, Unknown]:
        if target is None or target.diameter_mm is None:
            raise BadInput(
                "a ball without a diameter cannot be used",
                found="no diameter_mm",
                allowed="a number above 0, millimetres",
                remedy="state the target's diameter_mm",
            )
        return super().coordinates(target)

    def reading(
        self, measured: Mapping[str, Sequence[float]], sigma: float | None, target: TargetEntry | None
    ) -> Matrix:
        """What reads no ball has the radius 0."""
        return np.array([0.0 if target is None else (target.diameter_mm or 0.0) / 2])

    def residual(self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str) -> ca.SX:
        return distance(flange.in_base(self.tip_at(unknowns)), target) - self.radius - reading[0]

    def goals(self, rng: np.random.Generator, count: int, target: Target) -> Matrix:
        return np.asarray(target.numbers + self._apart(target) * directions(rng, count))

    def prevented(self, poses: Matrix, target: Target, variant: str) -> dict[str, Mask]:
        outward = self.tips(poses) - target.numbers
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        return {"the probe comes through the ball": self.through(poses, outward)}

    def _apart(self, target: Target) -> float:
        """Of the centres of tip and ball, mm."""
        return self.radius + float(self.reading({}, None, target.entry)[0])

    def outlines(self, target: Matrix, reading: Matrix, touched: Matrix) -> tuple[Matrix, ...]:
        """Three great circles."""
        angle = np.linspace(0, 2 * np.pi, 25)
        circle = reading[0] * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))])
        return tuple(target + np.roll(circle, k, axis=1) for k in range(3))

    def start_target(self, poses: Matrix, readings: Matrix, unknowns: Matrix) -> Matrix:
        return sphere_through(self.tips(poses, unknowns), readings[:, 0] + self.radius, zero_free=False)
