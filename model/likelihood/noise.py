"""What is noisy: the recorded joint positions and the recorded spot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Matrix
from ..instruments.kind import Instrument
from ..kinematics.robot import Robot

if TYPE_CHECKING:
    from ..files.header import Header


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Standard deviations of one reading: `joint` (n,) rad or mm, `readings` (I,) mm or rad of each of the
    noises of the instruments (`Instrument.noises`: one of each, of poses two).

    With `estimated` they are right up to one common factor, which is integrated out; with `separate` up to
    one factor for all joints and one for each of the others, which are parameters like any other: `factors`
    are their names. A factor beyond `plausible`, or below 1 over it, is not taken for noise.
    """

    joint: Matrix
    readings: Matrix
    estimated: bool
    separate: bool = False
    plausible: float = 3.0
    factors: tuple[str, ...] = ("joint", "spot")

    @classmethod
    def from_header(cls, header: Header, robot: Robot, tool: Instrument) -> NoiseModel:
        """The noise that a header and its instruments state; BadInput if that does not suit the robot."""
        noise = header.noise
        stds = [noise.spot_mm if each.std is None else each.std for each in tool.noises]
        names = [each.name for each in tool.noises]
        return cls(
            noise.of_joints(robot),
            np.array(stds, dtype=float),
            noise.scale == "estimated",
            noise.scale == "separate",
            noise.plausible_factor,
            ("joint", *names),
        )

    @property
    def known(self) -> bool:
        return not (self.estimated or self.separate)

    @property
    def spot(self) -> float:
        """That of the first instrument."""
        return float(self.readings[0])

    def times(self, factor: float) -> NoiseModel:
        return replace(self, joint=self.joint * factor, readings=self.readings * factor)

    @cached_property
    def variances(self) -> Matrix:
        """(n + I,): the joints' variances, then those of the readings."""
        return np.append(self.joint**2, self.readings**2)
