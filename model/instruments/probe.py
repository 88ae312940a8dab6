"""A probe on the flange, whose tip must meet the target: a ball in a socket."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from .flange_tool import FlangeTool
from .kind import Unknown, Words
from .proposal import TIP, Point, ProposedHeader, target_at


@dataclass(frozen=True, eq=False)
class ProbeTip(FlangeTool):
    """Nothing is read: a measurement is taken when the tip sits in its socket."""

    name = "probe"
    also_called = ("ball", "sphere", "tip", "touch", "pin", "stylus", "tcp", "contact")
    columns: ClassVar[dict[str, int]] = {}
    residual_size = 3
    target = "socket"
    free_sigma = (3.0, 50.0)
    title = "Probe in a socket"
    minutes = 2.0
    words = Words(
        is_="a tip that must meet it",
        part="probe tip",
        motion="shift of the probe tip",
        unit="mm",
        reading="seat of the tip",
        method="a probe on the flange and fixed points in the cell",
        posture="the probe at the target",
        to_do="Lead the probe into its socket, and write down the joints.",
        fields=(),
        traced=(
            ("Probe, maker and serial number", ("probe", "probe serial", "probe serial number")),
            ("Probe, calibration certificate", ("probe certificate",)),
        ),
        act="lead the probe into its socket",
    )

    @classmethod
    def proposed(cls, reach: float, target: Point) -> ProposedHeader:
        tool = {"kind": "probe", "calibrated": False, "point_mm": list(TIP)}
        return ProposedHeader({"tool": tool, "targets": {"socket": target_at(target)}}, 3, turns=True)

    def _free(self) -> Iterator[Unknown]:
        for axis, value in zip("xyz", self.point.tolist(), strict=True):
            yield Unknown(axis, "mm", value, self.shift_std)

    @property
    def known_to(self) -> float:
        return self.shift_std

    def tip_at(self, unknowns: ca.SX) -> ca.SX:
        """(3, 1) mm in the flange frame; `unknowns` is x, y, z, or empty if exact."""
        return ca.SX(self.point) if self.exact else unknowns

    def ray(self, unknowns: ca.SX) -> tuple[ca.SX, ca.SX]:
        return self.tip_at(unknowns), ca.SX.zeros(3)

    def beside(self, target: ca.SX, unknowns: ca.SX) -> ca.SX:
        return target - self.tip_at(unknowns)
