"""A robot as it is understood: what `zerobeam robot` shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..analysis.pendant_check.pose_check import PendantCheck, check_poses
from ..analysis.pendant_check.poses import FORM_OF_VENDOR, FORMS, AngleForm, Counting
from ..model.arrays import Matrix
from ..model.errors import BadInput
from ..model.files.header import UrdfRef
from ..model.files.robot_file import built_in_robots, load_robot, stated_rows
from ..model.kinematics.inverse import longest_reach
from ..model.kinematics.orientation import Orientation, orientation
from ..model.kinematics.pendant import Pendant, beyond_limits, pendant_of
from ..model.kinematics.robot import J3, PendantUnit, Robot
from ..words.pendant_check import check_sentences
from ..words.wording import counted
from .makers.joint_text import typed_joints
from .makers.pose_text import typed_poses


@dataclass(frozen=True, eq=False)
class ShownPose:
    """The flange at `joints` (n,) rad or mm: `place_mm` (3,) and the orientation in the base frame.

    `outside` are the joints (from 1) beyond their limits.
    """

    joints: Matrix
    place_mm: tuple[float, float, float]
    orientation: Orientation
    outside: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class ShownArm:
    """A robot, what its maker calls it and its payload class in kg (None: not stated), its reach in mm, and
    the flange in postures.

    `pendant` says how joints are counted where they are read and shown; `check` is what poses of the pendant
    say of the file.
    """

    robot: Robot
    pendant: Pendant
    model: str | None
    payload_kg: float | None
    reach_mm: float
    poses: tuple[ShownPose, ...]
    check: PendantCheck | None = None


def typed_arm(
    ref: str | UrdfRef,
    joints: Sequence[str],
    *,
    units: PendantUnit | None,
    j3: J3 | None,
    poses: Sequence[str] = (),
    angles: AngleForm | None = None,
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
        longest_reach(robot),
        tuple(_pose(robot, posture) for posture in postures),
    )


def arm_json(arm: ShownArm) -> dict[str, object]:
    """`zerobeam/arm/1` (docs/files.md)."""
    robot, pendant, facts = arm.robot, arm.pendant, arm.robot.conventions
    lower, upper = (limits.tolist() for limits in pendant.limits)
    return {
        "schema": "zerobeam/arm/1",
        "name": robot.name,
        "vendor": robot.vendor,
        "model": arm.model,
        "payload_kg": arm.payload_kg,
        "reach_mm": round(arm.reach_mm, 1),
        "mounting": {"below_base_mm": facts.below_base},
        "pendant": {
            "joint3": pendant.joint3,
            "names": pendant.names,
            "order": [i + 1 for i in pendant.order],
            "unit": pendant.unit,
            "less_joint2": pendant.less_joint2,
            "stated": facts.joint3 is not None,
        },
        "encoder": {"joint3": facts.encoder3},
        "joints": [
            {
                "name": joint.name,
                "kind": joint.kind,
                "unit": joint.unit,
                "lower": lower[i],
                "upper": upper[i],
                "speed": None if joint.speed is None else joint.speed * joint.display,
            }
            for i, joint in enumerate(robot.joints)
        ],
        "poses": [
            {
                "joints_deg": (pose.joints * robot.display).tolist(),
                "counted_deg": pendant.counted(pose.joints * robot.display).tolist(),
                "outside": list(pose.outside),
                "xyz_mm": list(pose.place_mm),
                "quaternion_wxyz": list(pose.orientation.quaternion),
                "rpy_deg": list(pose.orientation.roll_pitch_yaw),
                "abc_deg": list(pose.orientation.abc),
                "rotation_vector_rad": list(pose.orientation.rotation_vector),
                "rx_ry_rz_deg": list(pose.orientation.xyz),
                "zyz_deg": list(pose.orientation.zyz),
            }
            for pose in arm.poses
        ],
        "check": None if arm.check is None else _check_json(arm.check),
    }


def _check_json(check: PendantCheck) -> dict[str, object]:
    return {
        "agrees": check.agrees,
        "deviations": [
            {
                "mm": each.place_mm,
                "deg": each.angle_deg,
                "allowed_mm": each.allowed_mm,
                "allowed_deg": each.allowed_deg,
            }
            for each in check.deviations
        ],
        "suspects": [
            {"entry": each.entry, "kind": each.kind, "is": each.old, "would_be": each.new}
            for each in check.suspects
        ],
        "same_arm": check.same_arm,
        "unchecked": list(dict.fromkeys(each.entry for each in check.unchecked)),
        "sentences": check_sentences(check),
    }


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


def _pose(robot: Robot, joints: Matrix) -> ShownPose:
    pose = robot.fk(joints, "rad")
    x, y, z = (float(value) for value in pose[:3, 3])
    outside = np.flatnonzero(beyond_limits(robot, joints)) + 1
    return ShownPose(joints, (x, y, z), orientation(pose[:3, :3]), tuple(int(i) for i in outside))
