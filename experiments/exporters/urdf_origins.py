"""A corrected copy of a run's URDF: each exported offset goes into its joint's origin.

The joint moves by `origin * motion(axis, q)`. With the origin `origin * motion(axis, offset)` the same
recorded q gives the true pose, since motions about or along one axis add up. All other bytes stay.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from xml.parsers import expat

import casadi as ca
import numpy as np

from ...model.errors import BadInput
from ...model.files.header import UrdfRef
from ...model.files.reading import read_bytes, read_text, shown
from ...model.files.run import Run
from ...model.files.urdf import MILLIMETRES, roll_pitch_yaw
from ...model.robot import Joint, Matrix, axis_rotation
from .calibration import Calibration, Offset

_START_TAG = re.compile(rb"<[^\s/>]+(?:\s+[^\s=]+\s*=\s*(?:\"[^\"]*\"|'[^']*'))*\s*/?>")
_ATTRIBUTE = re.compile(rb"\s+([^\s=]+)\s*=\s*(\"[^\"]*\"|'[^']*')")
_BOM = b"\xef\xbb\xbf"
_Edit = tuple[int, int, bytes]  # from, to, replacement


@dataclass
class _Element:
    """A start tag: where it begins in the file, and its attributes."""

    start: int
    attributes: dict[str, str]


@dataclass
class _Found:
    """Of one file: the top element, and the joint elements with their origins."""

    robot: list[_Element] = field(default_factory=list)
    joints: list[tuple[_Element, list[_Element]]] = field(default_factory=list)


def urdf_text(run: Run, calibration: Calibration) -> str:
    """The text of the corrected URDF; BadInput if the run's robot is not a chain of a URDF file."""
    ref = run.header.robot
    if not isinstance(ref, UrdfRef):
        raise BadInput(
            "the run's robot does not come from a URDF file, so there is none to correct",
            found=f"robot: {shown(ref)}",
            allowed="robot: {urdf, base, tip}",
            remedy="export json or csv; in a robot file add each offset to theta_deg of its row (d_mm if"
            " prismatic)",
            file=run.path,
            line=run.header_line,
        )
    path = run.path.parent / ref.urdf
    text, _ = read_text(path)
    content = text.encode()
    found = _elements(content)
    newline = b"\r\n" if b"\r\n" in content else b"\n"
    edits = [_comment(content, found.robot[0], calibration, newline)]
    for joint, offset in zip(run.robot.joints, calibration.offsets, strict=True):
        if not offset.exported:
            continue
        same = [pair for pair in found.joints if pair[0].attributes.get("name") == joint.name]
        if len(same) != 1:
            raise BadInput(
                f"the URDF file has {len(same)} joints of the same name",
                found=shown(joint.name),
                file=path,
                remedy="give every joint a name of its own, in the URDF file of the run",
            )
        edits.append(_origin(content, joint, offset, *same[0]))
    for start, end, instead in sorted(edits, reverse=True):
        content = content[:start] + instead + content[end:]
    bom = "\ufeff" if read_bytes(path).startswith(_BOM) else ""
    return bom + content.decode()


def _elements(content: bytes) -> _Found:
    """The elements of a URDF that has been read as the run's robot, so that it is well-formed."""
    found = _Found()
    stack: list[str] = []
    parser = expat.ParserCreate(encoding="utf-8")

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = _Element(parser.CurrentByteIndex, attributes)
        if not stack:
            found.robot.append(element)
        elif len(stack) == 1 and tag == "joint":
            found.joints.append((element, []))
        elif len(stack) == 2 and stack[1] == "joint" and tag == "origin":
            found.joints[-1][1].append(element)
        stack.append(tag)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop()
    parser.Parse(content, True)
    return found


def _tag(content: bytes, element: _Element) -> bytes:
    tag = _START_TAG.match(content, element.start)
    assert tag is not None
    return tag.group()


def _comment(content: bytes, robot: _Element, calibration: Calibration, newline: bytes) -> _Edit:
    """What the file is, just inside its top element. `--` is not allowed in a comment of XML."""
    lines = [
        *calibration.head,
        "Exported offsets are in the origins of their joints: recorded positions give true poses.",
        "Limits are those of recorded positions, as before. Tool and targets are not in here.",
    ]
    safe = [re.sub("-(?=-)", "- ", line).encode() for line in lines]
    at = robot.start + len(_tag(content, robot))
    return at, at, newline + newline.join([b"<!--", *safe, b"-->"])


def _origin(
    content: bytes, joint: Joint, offset: Offset, element: _Element, origins: list[_Element]
) -> _Edit:
    """The joint's origin moved by its offset: `rpy` alone changes if it is revolute, `xyz` if prismatic."""
    stated = origins[0].attributes if origins else {}
    turn = roll_pitch_yaw(*_numbers(stated.get("rpy")))[:3, :3]
    if joint.kind == "revolute":
        name, values = "rpy", _roll_pitch_yaw_of(turn @ _rotation(joint.axis, offset.internal))
    else:
        name = "xyz"
        shift = turn @ joint.axis * offset.internal / MILLIMETRES
        values = tuple(np.array(_numbers(stated.get("xyz"))) + shift)
    text = f'"{" ".join(repr(float(value)) for value in values)}"'.encode()
    if not origins:
        at = element.start + len(_tag(content, element))
        return at, at, b"<origin " + name.encode() + b"=" + text + b"/>"
    tag = _tag(content, origins[0])
    at = len(b"<origin")
    for attribute in _ATTRIBUTE.finditer(tag, at):
        if attribute.group(1) == name.encode():
            return origins[0].start + attribute.start(2), origins[0].start + attribute.end(2), text
    start = origins[0].start + at
    return start, start, b" " + name.encode() + b"=" + text


def _numbers(text: str | None) -> tuple[float, float, float]:
    x, y, z = (0.0, 0.0, 0.0) if text is None else (float(word) for word in text.split())
    return x, y, z


def _rotation(axis: Matrix, angle: float) -> Matrix:
    """(3, 3) about a unit axis (3,) by an angle in rad."""
    return np.asarray(ca.evalf(axis_rotation(axis, ca.cos(ca.SX(angle)), ca.sin(ca.SX(angle)))).full())


def _roll_pitch_yaw_of(rotation: Matrix) -> tuple[float, float, float]:
    """The angles, rad, of R = Rz(yaw) Ry(pitch) Rx(roll).

    Pitch and roll are taken from Rz(-yaw) R, so that they suit whatever yaw came out where the pitch is near
    90 degrees and roll and yaw turn about one axis.
    """
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    cosine, sine = math.cos(yaw), math.sin(yaw)
    pitch = math.atan2(-rotation[2, 0], cosine * rotation[0, 0] + sine * rotation[1, 0])
    roll = math.atan2(
        sine * rotation[0, 2] - cosine * rotation[1, 2], cosine * rotation[1, 1] - sine * rotation[0, 1]
    )
    return roll, pitch, yaw
