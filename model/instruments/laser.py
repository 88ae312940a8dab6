"""A laser on the flange, whose beam must pass the target: the centre of a position-sensitive detector."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import casadi as ca
import numpy as np

from ..arrays import Matrix
from .flange_tool import FlangeTool
from .kind import Unknown, Words
from .proposal import Point, ProposedHeader, target_at

# The two axes across each nominal beam axis, in the order of tilt1, tilt2 and shift1, shift2.
_ACROSS = {0: (1, 2), 1: (2, 0), 2: (0, 1)}


@dataclass(frozen=True, eq=False)
class LaserBeam(FlangeTool):
    """Its reading is where the target is across the beam, along b1 and b2 (`beam_frame`)."""

    name = "laser"
    also_called = ("beam", "pointer", "psd", "light")
    columns: ClassVar[dict[str, int]] = {"spot_mm": 2}
    residual_size = 2
    target = "psd"
    free_sigma = (3.0, 10.0)
    beam = True
    title = "Laser and PSD"
    minutes = 2.0
    mark = "psd"
    words = Words(
        is_="a beam that must pass the target",
        part="beam",
        motion="tilt of the laser",
        unit="deg",
        reading="spot",
        method="a laser on the flange and a position-sensitive detector in the cell",
        posture="its beam to the target",
        to_do="Go to the posture slowly; look at cables, stops and people. Jog the wrist in small steps until"
        " the PSD reads zero in both directions. Look at its sum signal: too little light is no reading."
        " Write down the joints as the controller shows them, to its last digit, and go on.",
        fields=("PSD x, y (mm), sum signal",),
        traced=(
            ("PSD, maker and serial number", ("psd", "psd serial", "psd serial number")),
            ("PSD, calibration certificate", ("psd certificate",)),
            ("Laser, maker and serial number", ("laser", "laser serial", "laser serial number")),
            ("Laser, calibration certificate", ("laser certificate",)),
        ),
        act="bring the beam onto the target with the last joints",
    )

    @classmethod
    def proposed(cls, reach: float, target: Point) -> ProposedHeader:
        tool = {
            "kind": "laser",
            "calibrated": False,
            "point_mm": [0.0, 0.0, 65.0],
            "direction": [1.0, 0.0, 0.0],
        }
        return ProposedHeader({"tool": tool, "targets": {"psd": target_at(target)}}, 2)

    def _free(self) -> Iterator[Unknown]:
        for axis in ("tilt1", "tilt2"):
            yield Unknown(axis, "deg", 0.0, self.tilt_std)
        for axis in ("shift1", "shift2"):
            yield Unknown(axis, "mm", 0.0, self.shift_std)

    @property
    def turns(self) -> bool:
        return not self.calibrated

    @property
    def known_to(self) -> float:
        return float(np.degrees(self.tilt_std))

    def ray(self, unknowns: ca.SX) -> tuple[ca.SX, ca.SX]:
        point, direction, _ = self.beam_frame(unknowns)
        return point, direction

    def beside(self, target: ca.SX, unknowns: ca.SX) -> ca.SX:
        point, _, across = self.beam_frame(unknowns)
        return across.T @ (target - point)

    def beam_frame(self, unknowns: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Point p (3, 1) mm, unit direction u (3, 1) and basis B (3, 2) across it, in the flange frame.

        `unknowns` is tilt1, tilt2 (rad), shift1, shift2 (mm), or empty if exact. The tilts and shifts
        act on the two coordinate axes across the nominal beam axis: unlike the paper's {m, n, y0, z0} they
        stay regular when the beam is along x.
        """
        assert self.direction is not None
        nominal_b1, nominal_b2 = self._across(ca.SX(self.direction))
        point, direction = ca.SX(self.point), ca.SX(self.direction)
        if not self.exact:
            tilt1, tilt2, shift1, shift2 = ca.vertsplit(unknowns)
            direction = direction + ca.tan(tilt1) * nominal_b1 + ca.tan(tilt2) * nominal_b2
            direction = direction / ca.sqrt(ca.sumsqr(direction))
            point = point + shift1 * nominal_b1 + shift2 * nominal_b2
        return point, direction, ca.horzcat(*self._across(direction))

    def nominal_beam(self) -> tuple[Matrix, Matrix, Matrix]:
        """Point (3,) mm, unit direction (3,) and basis (3, 2) of the beam as stated, in the flange frame."""
        return self._stated_beam

    @cached_property
    def _stated_beam(self) -> tuple[Matrix, Matrix, Matrix]:
        exact = replace(self, is_calibrated=True, tolerated=False)
        point, direction, across = exact.beam_frame(ca.SX())
        return ca.DM(point).full()[:, 0], ca.DM(direction).full()[:, 0], ca.DM(across).full()

    def _across(self, direction: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Orthonormal b1, b2 across `direction`: the two other axes of the nominal beam axis, made square."""
        assert self.direction is not None
        axis = int(np.argmax(np.abs(self.direction)))
        e1, e2 = (ca.SX(np.eye(3)[i]) for i in _ACROSS[axis])
        b1 = e1 - ca.dot(e1, direction) * direction
        b1 = b1 / ca.sqrt(ca.sumsqr(b1))
        b2 = e2 - ca.dot(e2, direction) * direction
        b2 = b2 - ca.dot(e2, b1) * b1
        return b1, b2 / ca.sqrt(ca.sumsqr(b2))
