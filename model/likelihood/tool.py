"""What the flange carries: a laser whose beam must pass the target, or a probe whose tip must meet it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import casadi as ca
import numpy as np

from ..arrays import Matrix

if TYPE_CHECKING:
    from ..files.header import Header

# The two axes across each nominal beam axis, in the order of tilt1, tilt2 and shift1, shift2.
_ACROSS = {0: (1, 2), 1: (2, 0), 2: (0, 1)}

ToolKind = Literal["laser", "probe"]


@dataclass(frozen=True, eq=False)
class Tool:
    """Nominal tool in the flange frame: `point` (3,) mm on the beam (or the tip), `direction` (3,) unit.

    `direction` is None for a probe. `tilt_std` (rad) and `shift_std` (mm) are the prior stds of how far the
    tool is from that; of a calibrated one only if it is `tolerated`: else it is exact, and has no parameters.
    """

    kind: ToolKind
    calibrated: bool
    point: Matrix
    direction: Matrix | None
    tilt_std: float
    shift_std: float
    tolerated: bool = False

    @classmethod
    def from_header(cls, header: Header) -> Tool:
        tool = header.tool
        direction = None if tool.direction is None else np.array(tool.direction, dtype=float)
        return cls(
            kind=tool.kind,
            calibrated=tool.calibrated,
            point=np.array(tool.point_mm, dtype=float),
            direction=None if direction is None else direction / np.linalg.norm(direction),
            tilt_std=float(np.radians(tool.sigma.tilt_deg)),
            shift_std=tool.sigma.shift_mm,
            tolerated=not header.exact_tool,
        )

    @property
    def exact(self) -> bool:
        """Whether the tool is as stated, and no part of it is estimated."""
        return self.calibrated and not self.tolerated

    @property
    def residual_size(self) -> int:
        """Components of one residual: 2 across a beam, 3 for a probe."""
        return 2 if self.kind == "laser" else 3

    @property
    def free_axes(self) -> tuple[str, ...]:
        """The k free tool parameters: none if the tool is exact."""
        if self.exact:
            return ()
        return ("tilt1", "tilt2", "shift1", "shift2") if self.kind == "laser" else ("x", "y", "z")

    def tip(self, unknowns: ca.SX) -> ca.SX:
        """Tip of a probe (3, 1) mm in the flange frame; `unknowns` is x, y, z, or empty if exact."""
        return ca.SX(self.point) if self.exact else unknowns

    def beam(self, unknowns: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Point p (3, 1) mm, unit direction u (3, 1) and basis B (3, 2) across it, in the flange frame.

        `unknowns` is tilt1, tilt2 (rad), shift1, shift2 (mm), or empty if exact. The tilts and shifts
        act on the two coordinate axes across the nominal beam axis: unlike the paper's {m, n, y0, z0} they
        stay regular when the beam is along x.
        """
        if self.direction is None:
            raise ValueError("a probe has no beam")
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
        point, direction, across = replace(self, calibrated=True, tolerated=False).beam(ca.SX())
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
