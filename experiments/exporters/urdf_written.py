"""A URDF file of a robot that comes from rows: any link can be in it.

Links have no bodies: it is the kinematics alone, from the link `base` to the link `flange`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from xml.sax.saxutils import quoteattr

from ...model.arrays import Matrix
from ...model.files.urdf import MILLIMETRES
from ...model.kinematics.orientation import angles_of
from ...model.kinematics.robot import Joint, Robot

BASE, FLANGE = "base", "flange"
_ESCAPED = {"\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}


def written_urdf(robot: Robot, head: Sequence[str]) -> str:
    """The text of the file; `head` are lines of its comment."""
    links = [BASE, *(f"link{i}" for i in range(1, robot.n + 1)), FLANGE]
    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        f"<robot name={_quoted(robot.name)}>",
        "<!--",
        *(re.sub("-(?=-)", "- ", line) for line in head),
        "-->",
        *(f"  <link name={_quoted(name)}/>" for name in links),
    ]
    for joint, parent, child in zip(robot.joints, links, links[1:], strict=False):
        lines += _joint(joint, parent, child)
    lines += [
        f'  <joint name={_quoted(_free(robot))} type="fixed">',
        f'    {_origin(robot.flange)}<parent link="{links[-2]}"/><child link="{FLANGE}"/>',
        "  </joint>",
        "</robot>",
    ]
    return "\n".join(lines) + "\n"


def _joint(joint: Joint, parent: str, child: str) -> list[str]:
    unit = MILLIMETRES if joint.kind == "prismatic" else 1.0
    lower, upper = joint.lower / unit, joint.upper / unit
    speed = 0.0 if joint.speed is None else joint.speed / unit
    return [
        f'  <joint name={_quoted(joint.name)} type="{joint.kind}">',
        f'    {_origin(joint.fixed)}<parent link="{parent}"/><child link="{child}"/>',
        f'    <axis xyz="{_numbers(joint.axis)}"/>',
        f'    <limit lower="{lower!r}" upper="{upper!r}" effort="0" velocity="{speed!r}"/>',
        "  </joint>",
    ]


def _origin(transform: Matrix) -> str:
    place = _numbers(transform[:3, 3] / MILLIMETRES)
    return f'<origin xyz="{place}" rpy="{_numbers(angles_of(transform[:3, :3]))}"/>'


def _numbers(values: Sequence[float] | Matrix) -> str:
    return " ".join(repr(float(value)) for value in values)


def _free(robot: Robot) -> str:
    """A name that no joint has."""
    name = "to_flange"
    while name in {joint.name for joint in robot.joints}:
        name += "_"
    return name


def _quoted(name: str) -> str:
    return quoteattr(name, _ESCAPED)
