"""What is noisy: the recorded joint positions and the recorded spot."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from .errors import BadInput
from .robot import Matrix, Robot

if TYPE_CHECKING:
    from .files.header import Header


@dataclass(frozen=True, eq=False)
class Noise:
    """Standard deviations of one reading: `joint` (n,) rad or mm, `spot` mm.

    With `estimated` they are right up to one common factor, which is integrated out; with `separate` up to
    one factor for all joints and one for the spot, which are parameters like any other.
    """

    joint: Matrix
    spot: float
    estimated: bool
    separate: bool = False

    @classmethod
    def from_header(cls, header: Header, robot: Robot) -> Noise:
        stated = header.noise
        if isinstance(stated.joint_deg, tuple | list):
            joint = np.array(stated.joint_deg, dtype=float)
            if joint.shape != (robot.n,):
                raise BadInput(
                    "noise.joint_deg has the wrong number of values",
                    found=f"{joint.size} values",
                    allowed=f"one number, or {robot.n} numbers ({robot.name} has {robot.n} joints)",
                )
        else:
            if stated.joint_mm is None and any(j.kind == "prismatic" for j in robot.joints):
                raise BadInput(
                    "noise.joint_mm is missing",
                    found=f"{robot.name} has prismatic joints, whose noise is in mm",
                    remedy="add noise.joint_mm, the standard deviation of one reading in mm",
                )
            joint = np.array(
                [stated.joint_deg if j.kind == "revolute" else stated.joint_mm for j in robot.joints],
                dtype=float,
            )
        return cls(
            joint / robot.display, stated.spot_mm, stated.scale == "estimated", stated.scale == "separate"
        )

    @property
    def known(self) -> bool:
        return not (self.estimated or self.separate)

    @cached_property
    def variances(self) -> Matrix:
        """(n + 1,): the joints' variances, then the spot's."""
        return np.append(self.joint**2, self.spot**2)
