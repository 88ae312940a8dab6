"""What `zerobeam robot` shows."""

from __future__ import annotations

from pathlib import Path

from ...experiments.arm_shown import ShownArm, ShownPose
from ...model.files.robot_file import built_in_robots, stated_rows
from ...model.kinematics.pendant import COUNTED_FROM_GROUND, UNITS_IN_WORDS, Pendant
from ...model.kinematics.robot import Joint
from ...words import numbers
from ...words.pendant_check import check_sentences
from ...words.wording import counted, listed, shown
from ..style.blocks import Page, Paragraph, Section, Table, Verdict, row_of, section_of, table_of

_NOT_STATED = "–"
_ENCODERS = {
    "link": "the angle between links 2 and 3",
    "ground": "the direction of link 3, whatever joint 2 does",
}


def robots_table() -> Table:
    """The built-in robots, one a line."""
    robots = [(name, stated_rows(name, Path())) for name in built_in_robots()]
    rows = [row_of(name, arm.vendor or "", arm.model or "", str(len(arm.joints))) for name, arm in robots]
    return table_of("", ["name", "vendor", "model", "joints"], rows, "l")


def robot_page(arm: ShownArm) -> Page:
    """Joints, reach, the flange in each posture, and whether the pendant agrees."""
    robot = arm.robot
    known = ", ".join(shown(each) for each in (robot.vendor, arm.model) if each)
    reach = numbers.with_unit(numbers.fixed(arm.reach_mm, 0), "mm")
    lines = [*_conventions(arm.pendant), f"Reach: the flange gets up to {reach} from the axis of joint 1."]
    if arm.payload_kg is not None:
        lines.append(f"Payload class: {numbers.with_unit(numbers.exact(arm.payload_kg), 'kg')}.")
    title = f"{shown(robot.name)}{f' ({known})' if known else ''}"
    what = section_of(f"{title}: {counted(robot.n, 'joint')}", _joints(arm), *map(Paragraph, lines))
    return Page(
        title, "", Verdict("held", "", ""), [], [what, *(_pose(p, arm) for p in arm.poses), _compared(arm)]
    )


def _compared(arm: ShownArm) -> Section:
    if arm.check is None:
        text = "Pose of the flange in the base frame, without a tool."
        return section_of("Compare with the pendant", Paragraph(text))
    first, *rest = check_sentences(arm.check)
    return section_of(first, *(Paragraph(f"- {line}") for line in rest))


def _joints(arm: ShownArm) -> Table:
    lower, upper = (limits.tolist() for limits in arm.pendant.limits)
    rows = []
    for i in arm.pendant.order:
        joint = arm.robot.joints[i]
        cells = _value(lower[i], joint), _value(upper[i], joint), _speed(joint)
        rows.append(row_of(shown(arm.pendant.names[i]), shown(joint.name), joint.kind, *cells))
    return table_of("", ["joint", "name", "kind", "lower", "upper", "top speed"], rows, "rllr")


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
    slides = any(joint.kind == "prismatic" for joint in robot.joints)
    in_mm = "; prismatic joints in mm" if slides and pendant.unit != "pulse" else ""
    lines.append(f"The pendant shows {shown(order)}, in {UNITS_IN_WORDS[pendant.unit]}{in_mm}.")
    if facts.encoder3 is not None:
        lines.append(f"The encoder of joint 3 measures {_ENCODERS[facts.encoder3]}.")
    return lines


def _speed(joint: Joint) -> str:
    if joint.speed is None:
        return _NOT_STATED
    return numbers.with_unit(numbers.exact(round(joint.speed * joint.display, 2)), joint.unit) + "/s"


def _value(value: float, joint: Joint) -> str:
    return numbers.with_unit(numbers.exact(round(value, 6)), joint.unit)


def _pose(pose: ShownPose, arm: ShownArm) -> Section:
    pendant = arm.pendant
    of_pendant = pendant.shown(pose.joints * arm.robot.display).tolist()
    values = [
        numbers.with_unit(numbers.exact(round(value, 6)), pendant.units[i])
        for value, i in zip(of_pendant, pendant.order, strict=True)
    ]
    outside = [pendant.names[number - 1] for number in pose.outside]
    turned = pose.orientation
    forms = [
        ("X, Y, Z", pose.xyz_mm, 2, "mm", "all"),
        ("q1, q2, q3, q4", turned.quaternion, 5, "", "ABB"),
        ("A, B, C", turned.abc, 3, "deg", "KUKA"),
        ("W, P, R", turned.roll_pitch_yaw, 3, "deg", "FANUC, roll pitch yaw"),
        ("rx, ry, rz", turned.rotation_vector, 4, "rad", "UR"),
        ("Rx, Ry, Rz", turned.xyz, 3, "deg", "Stäubli"),
        ("A, B, C (ZYZ)", turned.zyz, 3, "deg", "Doosan; O, A, T of Kawasaki"),
    ]
    rows = [
        row_of(name, ", ".join(numbers.with_unit(numbers.fixed(v, digits), unit) for v in parts), who)
        for name, parts, digits, unit, who in forms
    ]
    return section_of(
        f"Joints {', '.join(values)}",
        Paragraph(f"beyond the limits: {listed(outside)}") if outside else None,
        table_of("", ["", "", ""], rows, "l"),
    )
