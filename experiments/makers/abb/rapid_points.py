"""ABB: jointtargets and robtargets that are declared in a RAPID module.

The joints of a robtarget are those by which the nominal arm, as its controller has it, reaches the pose."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.kinematics.orientation import from_quaternion, stated_numbers
from ....model.kinematics.pendant import pendant_of
from ....model.kinematics.robot import Robot
from ...positions.arm_change import ArmChange, PositionFrames, kept, up_to_flange
from ...positions.position import NotConvertible, TaughtPosition
from ...positions.position_languages import RAPID
from ..import_jobs import Imported, ImportJob, TaughtPoint, import_points
from ..joint_text import PLAN_LINE, required_plan
from ..taught_positions import written_points

# From a robtarget to its joints, degrees as the controller counts them; None: it is not used.
Posed = Callable[[TaughtPosition], tuple[float, ...] | None]


def import_rapid(
    job: ImportJob, *, points: Sequence[str] | None = None, tool: str | None = None, frame: str | None = None
) -> Imported:
    """Measurements at the jointtargets of RAPID modules; `points` are the names of those to use.

    An element of an array has the name `name{2}`. External axes are ignored. Where the `tool` is stated, as
    seen from the flange (X,Y,Z,Q1,Q2,Q3,Q4), robtargets have the joints by which the nominal arm reaches them
    with their configuration, in the work object `frame` or wobj0.
    """
    note = "RAPID jointtargets, angles in degrees, rax_1 first, external axes ignored"
    posed: Posed = lambda one: None  # noqa: E731
    if tool is not None:
        poses = _pose(tool, "--tool"), np.eye(4) if frame is None else _pose(frame, "--frame")
        posed = _joints_of(job.robot, PositionFrames(np.eye(4), poses[1], poses[0]), points)
        note += (
            f"; robtargets by inverse kinematics of the nominal arm, tool {tool}, frame {frame or 'wobj0'}"
        )
    elif frame is not None:
        raise BadInput("--frame is of robtargets, and these need their tool", remedy="state --tool too")

    def parse(text: str, path: Path) -> list[TaughtPoint]:
        if points is None and PLAN_LINE.search(text):
            required_plan(job, path)
        return rapid_positions(text, path, posed)

    return import_points(job, parse, names=points, note=note)


def _pose(text: str, option: str) -> Matrix:
    return from_quaternion(stated_numbers(text, 7, option, "X,Y,Z,Q1,Q2,Q3,Q4"))


def _joints_of(robot: Robot, frames: PositionFrames, names: Sequence[str] | None) -> Posed:
    """For robtargets of these names (None: any); BadInput unless exactly one set of joints has the stated
    configuration."""
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


def rapid_positions(text: str, path: Path, posed: Posed = lambda one: None) -> list[TaughtPoint]:
    """All declared jointtargets and robtargets of a module, in its order."""
    points = written_points(RAPID, text, path, posed)
    return [point for point in points if not point.name.startswith("line ")]
