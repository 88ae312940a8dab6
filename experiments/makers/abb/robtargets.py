"""ABB: the joints of robtargets, by which the nominal arm, as its controller has it, reaches their poses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.kinematics.orientation import from_quaternion, stated_numbers
from ....model.kinematics.pendant import pendant_of
from ....model.kinematics.robot import Robot
from ...positions.arm_change import ArmChange, PositionFrames, kept, up_to_flange
from ...positions.position import NotConvertible, TaughtPosition
from ...positions.position_languages import RAPID
from ..taught_positions import Posed


def joints_of(robot: Robot, tool: str, frame: str | None, names: Sequence[str] | None) -> Posed:
    """Of robtargets of these names (None: any), of a stated `tool` and in a work object `frame` or wobj0, the
    joints with their configuration; BadInput unless exactly one set of joints has it."""
    in_frame = np.eye(4) if frame is None else _pose(frame, "--frame")
    frames = PositionFrames(np.eye(4), in_frame, _pose(tool, "--tool"))
    pendant = pendant_of(robot)
    arm = ArmChange(up_to_flange(robot, robot), RAPID, pendant, *kept(np.zeros(robot.n)))
    if arm.branches is None:
        raise BadInput(
            "robtargets are read for six-axis arms with a spherical wrist",
            found=robot.name,
            remedy="use jointtargets",
        )

    def posed(one: TaughtPosition) -> tuple[float, ...] | None:
        if names is not None and one.label not in names:
            return None
        if one.external:
            raise BadInput(
                f"{one.label} has positions of external axes, which may carry the robot or the work"
            )
        try:
            joints = arm.joints_at(frames.flange(RAPID.pose(one.values)), one.configuration)
        except NotConvertible as error:
            raise BadInput(
                f"{one.label} does not say what the joints are",
                found=str(error),
                remedy="state the right --tool and --frame, or save the point as a jointtarget",
                line=one.line,
            ) from None
        return tuple(pendant.counted(joints).tolist())

    return posed


def _pose(text: str, option: str) -> Matrix:
    return from_quaternion(stated_numbers(text, 7, option, "X,Y,Z,Q1,Q2,Q3,Q4"))
