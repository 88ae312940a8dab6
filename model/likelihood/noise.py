"""What is noisy: the recorded joint positions and the recorded spot, as a header states it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..arrays import Matrix
from ..instruments.kind import Instrument
from ..kinematics.robot import Robot

if TYPE_CHECKING:
    from ..files.header import Header

COMMON = "common"  # the factor of joints and positions, where rotations have one of their own


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Standard deviations of one reading: `joint` (n,) rad or mm, `readings` (I,) mm or rad of each of the
    noises of the instruments (`Instrument.noises`: one of each, of poses two).

    With `estimated` they are right up to one common factor, which is integrated out; with `separate` up to
    one factor for all joints and one for each of the others, which are parameters like any other: `factors`
    are their names, and `of_factor` says which of them is that of the joints, then of each of the readings.
    With `estimated` the rotations of poses have factors of their own: then all of them are parameters, the
    common one too. A factor beyond `plausible`, or below 1 over it, is not taken for noise.
    """

    joint: Matrix
    readings: Matrix
    estimated: bool
    separate: bool = False
    plausible: float = 3.0
    factors: tuple[str, ...] = ("joint", "spot")
    of_factor: tuple[int, ...] = (0, 1)

    @classmethod
    def from_header(cls, header: Header, robot: Robot, tool: Instrument) -> NoiseModel:
        """The noise that a header and its instruments state; BadInput if that does not suit the robot."""
        noise = header.noise
        stds = [noise.spot_mm if each.std is None else each.std for each in tool.noises]
        angles = [each.unit == "deg" for each in tool.noises]
        split = noise.scale == "estimated" and any(angles)
        alone = np.array(angles) if split else np.ones(len(angles), dtype=bool)
        names = [each.name for each, apart in zip(tool.noises, alone, strict=True) if apart]
        return cls(
            noise.of_joints(robot),
            np.array(stds, dtype=float),
            noise.scale == "estimated" and not split,
            noise.scale == "separate" or split,
            noise.plausible_factor,
            (COMMON if split else "joint", *names),
            (0, *np.where(alone, np.cumsum(alone), 0).tolist()),
        )

    @property
    def log_det(self) -> Literal["none", "relative"]:
        """The determinant that goes with the residuals (`ShotFunctions`)."""
        return "relative" if self.separate else "none"

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
