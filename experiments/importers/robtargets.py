"""The joints of a robtarget: those by which the nominal arm, as its controller has it, reaches the pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from ...model.arrays import Matrix
from ...model.errors import BadInput
from ...model.files.robot_file import load_robot
from ...model.kinematics.branches import Branches, is_abb_configuration
from ...model.kinematics.inverse import Solver
from ...model.kinematics.orientation import from_quaternion
from ...model.kinematics.robot import Robot, same_arm, shift

_FLANGE_OF_IRB1600 = 65.0  # mm
_UNUSED = 9e9


def up_to_flange(robot: Robot, nominal: Robot) -> Robot:
    """The arm up to what its controller calls the flange: that of the paper ends at the wrist's centre."""
    if not same_arm(nominal, load_robot("irb1600")):
        return robot
    return replace(robot, flange=robot.flange @ shift(z=_FLANGE_OF_IRB1600))


@dataclass(frozen=True, eq=False)
class Robtargets:
    """Joints of robtargets of a `tool` (as seen from the flange) in a `frame` (as seen from the base)."""

    robot: Robot
    tool: Matrix
    frame: Matrix

    @cached_property
    def _solver(self) -> Solver:
        return Solver(up_to_flange(self.robot, self.robot))

    @cached_property
    def _branches(self) -> Branches:
        branches = Branches(self.robot, 1)
        if not branches.exist:
            raise BadInput(
                "robtargets are read for six-axis arms with a spherical wrist",
                found=self.robot.name,
                remedy="use jointtargets",
            )
        return branches

    def joints(self, values: Sequence[float], name: str, path: Path, line: int) -> tuple[float, ...]:
        """Degrees; BadInput unless exactly one set of joints has the stated configuration."""
        if any(value not in (0.0, _UNUSED) for value in values[11:]):
            raise BadInput(
                f"{name} has positions of external axes, which may carry the robot or the work",
                file=path,
                line=line,
            )
        flange = self.frame @ from_quaternion(values[:7]) @ np.linalg.inv(self.tool)
        stated = tuple(values[7:11])
        rows = [
            row * self.robot.display
            for thorough in (False, True)
            for own in self._solver.solutions(flange, thorough=thorough)
            for row in self._solver.with_turns(own)
        ]
        rows = [row for row in rows if is_abb_configuration(stated, self._branches.of(row), row)]
        if not rows or any(np.abs(row - rows[0]).max() > 1e-2 for row in rows):
            found = "several" if rows else "no"
            raise BadInput(
                f"{name} does not say what the joints are",
                found=f"{found} sets of joints within the limits have its pose and the configuration"
                f" [{','.join(f'{value:g}' for value in stated)}]",
                remedy="state the right --tool and --frame, or save the point as a jointtarget",
                file=path,
                line=line,
            )
        return tuple(rows[0].tolist())
