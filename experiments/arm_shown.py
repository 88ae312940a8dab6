"""A robot as it is understood: what `zerobeam robot` shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from ..analysis.pendant_check.pose_check import PendantCheck, check_poses
from ..analysis.pendant_check.poses import FORM_OF_VENDOR, FORMS, Counting
from ..model.arrays import Matrix
from ..model.errors import BadInput
from ..model.files.header import UrdfRef
from ..model.files.robot_file import built_in_robots, load_robot, stated_rows
from ..model.kinematics.inverse import longest_reach
from ..model.kinematics.orientation import Orientation, Three, orientation
from ..model.kinematics.pendant import Pendant, beyond_limits, pendant_of
from ..model.kinematics.robot import JointKind, Robot
from ..model.options import J3, PendantUnit, PoseAngles
from ..model.records import inline, internal, it, key, record
from ..words.wording import counted
from .makers.joint_text import typed_joints, typed_poses


@record(eq=False)
class ShownPose:
    """The flange at `joints` (n,), rad or mm, in the base frame."""

    joints: Annotated[Matrix, internal]
    joints_deg: Annotated[tuple[float, ...], it("joint 3 from link 2, degrees (mm)")]
    counted_deg: Annotated[tuple[float, ...], it("as the pendant counts, degrees (mm)")]
    outside: Annotated[tuple[int, ...], it("joints beyond their limits, from 1")]
    xyz_mm: Annotated[Three, it("the flange in the base frame")]
    orientation: Annotated[
        Orientation,
        inline(
            quaternion="quaternion_wxyz",
            roll_pitch_yaw="rpy_deg",
            abc="abc_deg",
            rotation_vector="rotation_vector_rad",
            xyz="rx_ry_rz_deg",
            zyz="zyz_deg",
        ),
    ]


@record
class JointLimits:
    """A joint with its limits."""

    name: str
    unit: Annotated[str, it("of its limits; a second of its `speed`")]
    lower: Annotated[float, it("in the pendant's counting")]
    upper: float


@record
class ShownJoint(JointLimits):
    """A joint of the robot, its limits in the pendant's counting."""

    kind: Annotated[JointKind, it("what it does")]
    speed: Annotated[float | None, it("null where not stated")]


@record(eq=False)
class ShownArm:
    """A robot, what its maker calls it, its reach, and the flange in postures.

    `pendant` says how joints are counted where they are read and shown; `check` is what poses of the pendant
    say of the file.
    """

    schema: Annotated[Literal["zerobeam/arm/1"], it("kind and version of the document")] = field(
        default="zerobeam/arm/1", kw_only=True
    )
    robot: Annotated[Robot, internal]
    pendant: Annotated[Pendant, it("how joints are counted where they are read and shown")]
    model: Annotated[str | None, it("null where not stated")]
    payload_kg: Annotated[float | None, it("payload class; null where not stated")]
    reach_mm: Annotated[float, it("the farthest that the flange gets from the axis of joint 1")]
    poses: Annotated[tuple[ShownPose, ...], it("the flange in each posture")]
    check: Annotated[PendantCheck | None, it("of poses of the pendant; null without `--pose`")] = None

    @property
    @key("of the robot")
    def name(self) -> str:
        return self.robot.name

    @property
    @key("null where not stated")
    def vendor(self) -> str | None:
        return self.robot.vendor

    @property
    @key("`below_base_mm` of the mounting face, null where not stated")
    def mounting(self) -> dict[str, float | None]:
        return {"below_base_mm": self.robot.conventions.below_base}

    @property
    @key("`joint3`: what its encoder measures, null where not stated")
    def encoder(self) -> dict[str, J3 | None]:
        return {"joint3": self.robot.conventions.encoder3}

    @property
    @key("joint 1 first")
    def joints(self) -> tuple[ShownJoint, ...]:
        lower, upper = (limits.tolist() for limits in self.pendant.limits)
        return tuple(
            ShownJoint(one.name, one.unit, low, high, one.kind, one.speed and one.speed * one.display)
            for one, low, high in zip(self.robot.joints, lower, upper, strict=True)
        )


def typed_arm(
    ref: str | UrdfRef,
    joints: Sequence[str],
    *,
    units: PendantUnit | None,
    j3: J3 | None,
    poses: Sequence[str] = (),
    angles: PoseAngles | None = None,
) -> ShownArm:
    """The robot of a name or file; `joints` are texts of joint values as the pendant shows them (none: the
    zero posture), in `units` and with joint 3 from `j3` where these are not as the robot file states.

    `poses` are texts of the poses that the pendant shows there, orientations in the form `angles` (None: that
    of the maker); the file is checked against them.
    """
    robot = load_robot(ref)
    pendant = pendant_of(robot, j3) if joints else Pendant(robot, j3)
    arm = _shown(ref, pendant, [_typed(pendant, text, units or pendant.unit) for text in joints])
    if not poses:
        return arm
    form = angles or FORM_OF_VENDOR.get(robot.vendor or "")
    if form is None:
        raise BadInput(
            "how does the pendant show orientations?",
            found="the robot file names no vendor whose form is known" if angles is None else angles,
            allowed="--angles " + ", ".join(FORMS),
        )
    reading = Counting(form, pendant.joint3)
    source = stated_rows(ref, Path()) if isinstance(ref, str) and _has_rows(ref) else robot
    read = typed_poses(joints, poses, pendant, units or pendant.unit, form)
    return replace(arm, check=check_poses(source, reading, read))


def _has_rows(ref: str | UrdfRef) -> bool:
    return isinstance(ref, str) and (ref in built_in_robots() or ref.lower().endswith((".yaml", ".yml")))


def shown_arm(
    ref: str | UrdfRef,
    joints_deg: Sequence[Sequence[float]],
    *,
    j3: J3 | None = None,
    as_in_files: bool = True,
) -> ShownArm:
    """A robot with joint values (n,) in degrees (mm), joint 1 first, in each posture.

    Its pendant counts joint 3 by `j3` (None: as the robot file states); so are the values, unless they are
    `as_in_files`, from link 2. BadInput where there are not n values.
    """
    robot = load_robot(ref)
    pendant = Pendant(robot, j3)
    for values in joints_deg:
        if len(values) != robot.n:
            raise BadInput(
                f"{robot.name} has another number of joints",
                found=counted(len(values), "joint value"),
                allowed=robot.n,
            )
    typed = [np.array(values, dtype=float) for values in joints_deg]
    linked = typed if as_in_files else [pendant.between_links(values) for values in typed]
    return _shown(ref, pendant, [values / robot.display for values in linked])


def _shown(ref: str | UrdfRef, pendant: Pendant, joints: Sequence[Matrix]) -> ShownArm:
    robot = pendant.robot
    file = stated_rows(ref, Path()) if isinstance(ref, str) and _has_rows(ref) else None
    model, payload = (None, None) if file is None else (file.model, file.payload_kg)
    postures = joints or [np.zeros(robot.n)]
    return ShownArm(
        robot,
        pendant,
        model,
        payload,
        round(longest_reach(robot), 1),
        tuple(_pose(pendant, posture) for posture in postures),
    )


def _typed(pendant: Pendant, text: str, units: PendantUnit) -> Matrix:
    """(n,) rad or mm."""
    typed = typed_joints(text, pendant.robot.n, pendant)
    if typed.unit is not None and typed.unit != units:
        raise BadInput(
            f"the joint values are in {typed.unit} and --units says {units}",
            found=text.strip(),
            remedy=f"state --units {typed.unit}",
        )
    values = np.array(typed.values) / pendant.per_degree(units)
    return pendant.between_links(values) / pendant.robot.display


def _pose(pendant: Pendant, joints: Matrix) -> ShownPose:
    robot = pendant.robot
    pose, shown = robot.fk(joints, "rad"), joints * robot.display
    x, y, z = (float(value) for value in pose[:3, 3])
    outside = np.flatnonzero(beyond_limits(robot, joints)) + 1
    return ShownPose(
        joints,
        tuple(shown.tolist()),
        tuple(pendant.counted(shown).tolist()),
        tuple(outside.tolist()),
        (x, y, z),
        orientation(pose[:3, :3]),
    )
