"""What `zerobeam robot` prints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ...experiments.arm_shown import ShownArm, ShownPose
from ...model.arms.joint_three import COUNTED_FROM_GROUND
from ...model.files.robot_file import built_in_robots, stated_rows
from ...model.robot import Joint
from ..words import numbers
from ..words.wording import counted, listed, shown

_NOT_STATED = "–"


def print_robots(console: Console) -> None:
    """The built-in robots, one a line."""
    table = Table(box=None, pad_edge=False)
    for column in ("name", "vendor", "model", "joints"):
        table.add_column(column, no_wrap=True)
    for name in built_in_robots():
        stated = stated_rows(name, Path())
        table.add_row(name, stated.vendor or "", stated.model or "", str(len(stated.joints)))
    console.print(table)


def print_arm(console: Console, arm: ShownArm) -> None:
    """Joints, reach, and the flange in each posture."""
    robot = arm.robot
    known = ", ".join(shown(each) for each in (robot.vendor, arm.model) if each)
    title = f"{shown(robot.name)}{f' ({known})' if known else ''}: {counted(robot.n, 'joint')}"
    console.print(Text(title, style="bold"))
    table = Table(box=None, pad_edge=False)
    for column in ("joint", "name", "kind", "lower", "upper", "top speed"):
        table.add_column(column, justify="left" if column in ("name", "kind") else "right")
    for number, joint in enumerate(robot.joints, start=1):
        table.add_row(f"J{number}", Text(shown(joint.name)), joint.kind, *_range(joint))
    console.print(table)
    reach = numbers.with_unit(numbers.fixed(arm.reach_mm, 0), "mm")
    console.print(Text(f"Reach: the flange gets up to {reach} from the axis of joint 1."))
    for pose in arm.poses:
        console.print()
        _print_pose(console, pose, arm)
    console.print()
    console.print(Text("Compare with the pendant: pose of the flange in the base frame, without a tool."))
    if robot.vendor in COUNTED_FROM_GROUND:
        said = "Joint 3 is counted from link 2 here. The pendant counts it from the ground: --j3 ground."
        console.print(Text(said))


def _range(joint: Joint) -> list[str]:
    speed = _NOT_STATED
    if joint.speed is not None:
        speed = numbers.with_unit(numbers.exact(round(joint.speed * joint.display, 2)), joint.unit) + "/s"
    return [_value(joint.lower * joint.display, joint), _value(joint.upper * joint.display, joint), speed]


def _value(value: float, joint: Joint) -> str:
    return numbers.with_unit(numbers.exact(round(value, 6)), joint.unit)


def _print_pose(console: Console, pose: ShownPose, arm: ShownArm) -> None:
    values = [
        _value(float(value) * joint.display, joint)
        for value, joint in zip(pose.joints, arm.robot.joints, strict=True)
    ]
    console.print(Text(f"Joints {', '.join(values)}", style="bold"))
    if pose.outside:
        beyond = listed([f"J{number}" for number in pose.outside])
        console.print(Text(f"beyond the limits: {beyond}", style="yellow"))
    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(no_wrap=True)
    table.add_column(style="dim")
    turned = pose.orientation
    rows: list[tuple[str, Sequence[float], int, str, str]] = [
        ("X, Y, Z", pose.place_mm, 2, "mm", "all"),
        ("q1, q2, q3, q4", turned.quaternion, 5, "", "ABB"),
        ("A, B, C", turned.abc, 3, "deg", "KUKA"),
        ("W, P, R", turned.roll_pitch_yaw, 3, "deg", "FANUC, roll pitch yaw"),
        ("rx, ry, rz", turned.rotation_vector, 4, "rad", "UR"),
        ("Rx, Ry, Rz", turned.xyz, 3, "deg", "Stäubli"),
    ]
    for label, values_, digits, unit, who in rows:
        numbers_ = ", ".join(numbers.with_unit(numbers.fixed(v, digits), unit) for v in values_)
        table.add_row(label, numbers_, who)
    console.print(table)
