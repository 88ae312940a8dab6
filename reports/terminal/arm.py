"""What `zerobeam robot` prints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ...experiments.arm_shown import ShownArm, ShownPose
from ...model.files.robot_file import built_in_robots, stated_rows
from ...model.kinematics.pendant import COUNTED_FROM_GROUND, Pendant
from ...model.kinematics.robot import Joint
from ...words import numbers
from ...words.pendant_check import check_sentences
from ...words.wording import counted, listed, shown

_NOT_STATED = "–"
_UNITS = {"deg": "degrees", "rad": "radians", "pulse": "pulses"}
_ENCODERS = {
    "link": "the angle between links 2 and 3",
    "ground": "the direction of link 3, whatever joint 2 does",
}


def print_robots(console: Console) -> None:
    """The built-in robots, one a line."""
    table = Table(box=None, pad_edge=False)
    for column in ("name", "vendor", "model", "joints"):
        table.add_column(column, no_wrap=True)
    for name in built_in_robots():
        robot = stated_rows(name, Path())
        table.add_row(name, robot.vendor or "", robot.model or "", str(len(robot.joints)))
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
    lower, upper = (limits.tolist() for limits in arm.pendant.limits)
    for i in arm.pendant.order:
        joint = robot.joints[i]
        cells = _value(lower[i], joint), _value(upper[i], joint), _speed(joint)
        table.add_row(Text(shown(arm.pendant.names[i])), Text(shown(joint.name)), joint.kind, *cells)
    console.print(table)
    for line in _conventions(arm.pendant):
        console.print(Text(line))
    reach = numbers.with_unit(numbers.fixed(arm.reach_mm, 0), "mm")
    console.print(Text(f"Reach: the flange gets up to {reach} from the axis of joint 1."))
    if arm.payload_kg is not None:
        payload = numbers.with_unit(numbers.exact(arm.payload_kg), "kg")
        console.print(Text(f"Payload class: {payload}."))
    for pose in arm.poses:
        console.print()
        _print_pose(console, pose, arm)
    console.print()
    if arm.check is None:
        console.print(Text("Compare with the pendant: pose of the flange in the base frame, without a tool."))
        return
    first, *rest = check_sentences(arm.check)
    console.print(Text(first, style="bold" if arm.check.agrees else "bold yellow"))
    for line in rest:
        console.print(Text(f"- {line}"))


def _conventions(pendant: Pendant) -> list[str]:
    """How the arm is mounted and counted, a sentence each."""
    robot, facts = pendant.robot, pendant.robot.conventions
    if facts.below_base is None:
        lines = ["Mounting face: not stated; it is taken to be at z = 0 of the base frame."]
    else:
        height = numbers.with_unit(numbers.exact(-facts.below_base), "mm")
        lines = [f"Mounting face: at z = {height} of the base frame. It is the floor of a plan."]
    if pendant.ground:
        low, high = (
            numbers.with_unit(numbers.exact(round(limit * robot.display[2], 6)), "deg")
            for limit in (robot.lower[2], robot.upper[2])
        )
        lines.append(
            f"Joint 3 is counted from the ground ({pendant.source}): the angle between links 2 and 3 is"
            f" J2 + J3; it may be from {low} to {high}."
        )
    elif pendant.override is None and facts.joint3 is None and robot.vendor in COUNTED_FROM_GROUND:
        lines.append(
            "What the pendant counts joint 3 from is not stated: here it is link 2. A FANUC counts it from"
            " the ground: state pendant: {joint3: ground} in the robot file."
        )
    else:
        lines.append(f"Joint 3 is counted from link 2 ({pendant.source}).")
    order = ", ".join(pendant.names[i] for i in pendant.order)
    lines.append(f"The pendant shows {shown(order)}, in {_UNITS[pendant.unit]}.")
    if facts.encoder3 is not None:
        lines.append(f"The encoder of joint 3 measures {_ENCODERS[facts.encoder3]}.")
    return lines


def _speed(joint: Joint) -> str:
    if joint.speed is None:
        return _NOT_STATED
    return numbers.with_unit(numbers.exact(round(joint.speed * joint.display, 2)), joint.unit) + "/s"


def _value(value: float, joint: Joint) -> str:
    return numbers.with_unit(numbers.exact(round(value, 6)), joint.unit)


def _print_pose(console: Console, pose: ShownPose, arm: ShownArm) -> None:
    pendant = arm.pendant
    of_pendant = pendant.shown(pose.joints * arm.robot.display).tolist()
    values = [
        numbers.with_unit(numbers.exact(round(value, 6)), pendant.units[i])
        for value, i in zip(of_pendant, pendant.order, strict=True)
    ]
    console.print(Text(f"Joints {', '.join(values)}", style="bold"))
    if pose.outside:
        beyond = listed([pendant.names[number - 1] for number in pose.outside])
        console.print(Text(f"beyond the limits: {beyond}", style="yellow"))
    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(no_wrap=True)
    table.add_column(style="dim")
    turned = pose.orientation
    rows: list[tuple[str, Sequence[float], int, str, str]] = [
        ("X, Y, Z", pose.xyz_mm, 2, "mm", "all"),
        ("q1, q2, q3, q4", turned.quaternion, 5, "", "ABB"),
        ("A, B, C", turned.abc, 3, "deg", "KUKA"),
        ("W, P, R", turned.roll_pitch_yaw, 3, "deg", "FANUC, roll pitch yaw"),
        ("rx, ry, rz", turned.rotation_vector, 4, "rad", "UR"),
        ("Rx, Ry, Rz", turned.xyz, 3, "deg", "Stäubli"),
        ("A, B, C (ZYZ)", turned.zyz, 3, "deg", "Doosan; O, A, T of Kawasaki"),
    ]
    for label, values_, digits, unit, who in rows:
        numbers_ = ", ".join(numbers.with_unit(numbers.fixed(v, digits), unit) for v in values_)
        table.add_row(label, numbers_, who)
    console.print(table)
