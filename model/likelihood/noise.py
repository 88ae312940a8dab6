"""What is noisy: the recorded joint positions and the recorded spot."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Matrix
from ..kinematics.robot import Robot

if TYPE_CHECKING:
    from ..files.header import Header


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Standard deviations of one reading: `joint` (n,) rad or mm, `spot` mm.

    With `estimated` they are right up to one common factor, which is integrated out; with `separate` up to
    one factor for all joints and one for the spot, which are parameters like any other. A factor beyond
    `plausible`, or below 1 over it, is not taken for noise.
    """

    joint: Matrix
    spot: float
    estimated: bool
    separate: bool = False
    plausible: float = 3.0

    @classmethod
    def from_header(cls, header: Header, robot: Robot) -> NoiseModel:
        """The noise that a header states; BadInput if that does not suit the robot."""
        noise = header.noise
        return cls(
            noise.of_joints(robot),
            noise.spot_mm,
            noise.scale == "estimated",
            noise.scale == "separate",
            noise.plausible_factor,
        )

    @property
    def known(self) -> bool:
        return not (self.estimated or self.separate)

    @cached_property
    def variances(self) -> Matrix:
        """(n + 1,): the joints' variances, then the spot's."""
        return np.append(self.joint**2, self.spot**2)
