"""A robot with its offsets as a robot file and as a URDF, also of one that comes from rows: any link can be
in it.

Links have no bodies: it is the kinematics alone, from the link `base` to the link `flange`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

import numpy as np

from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.files.header import UrdfRef
from ....model.files.robot_file import RobotFile, stated_rows
from ....model.files.run import Run
from ....model.files.urdf import MILLIMETRES, last_joint
from ....model.kinematics.orientation import angles_of
from ....model.kinematics.robot import Joint, Robot, euler
from ....model.parsing.reading import read_bytes, read_text, shown
from ..calibration import GeometryValue, JointOffset, RobotCalibration
from ..plan_programs import filled

BASE, FLANGE = "base", "flange"
_ESCAPED = {"\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}


def written_urdf(robot: Robot, head: Sequence[str]) -> str:
    """The text of the file; `head` are lines of its comment."""
    name = "to_flange"  # one that no joint has
    while name in {joint.name for joint in robot.joints}:
        name += "_"
    values = {
        "robot": robot,
        "head": [re.sub("-(?=-)", "- ", line) for line in head],
        "links": [BASE, *(f"link{i}" for i in range(1, robot.n + 1)), FLANGE],
        "origins": [_origin_element(each) for each in (*(j.fixed for j in robot.joints), robot.flange)],
        "metre": MILLIMETRES,
        "free": name,
    }
    (text,) = filled(Path(__file__).with_name("urdf.j2"), values, _quoted_name, line=str)
    return text


def _origin_element(transform: Matrix) -> str:
    xyz = _spaced(transform[:3, 3] / MILLIMETRES)
    return f'<origin xyz="{xyz}" rpy="{_spaced(angles_of(transform[:3, :3]))}"/>'


def _spaced(values: Sequence[float] | Matrix) -> str:
    return " ".join(repr(float(value)) for value in values)


def _quoted_name(name: str) -> str:
    return quoteattr(name, _ESCAPED)


_START_TAG = re.compile(rb"<[^\s/>]+(?:\s+[^\s=]+\s*=\s*(?:\"[^\"]*\"|'[^']*'))*\s*/?>")
_ATTRIBUTE = re.compile(rb"\s+([^\s=]+)\s*=\s*(\"[^\"]*\"|'[^']*')")
_BOM = b"\xef\xbb\xbf"
_NOTES = (
    "Exported offsets are in the origins of their joints: recorded positions give true poses.",
    "Limits are those of recorded positions, as before. Tool and targets are not in here.",
)
_SAME = 1e-12  # mm, and of rotation matrices: no geometry, but rounding
_Edit = tuple[int, int, bytes]  # from, to, replacement


@dataclass
class _Element:
    """A start tag: where it begins in the file, and its attributes."""

    start: int
    attributes: dict[str, str]


@dataclass
class _UrdfElements:
    """The top element of a file, and its joint elements with their origins."""

    robot: list[_Element] = field(default_factory=list)
    joints: list[tuple[_Element, list[_Element]]] = field(default_factory=list)


def urdf_text(run: Run, calibration: RobotCalibration) -> str:
    """The text of the corrected URDF; of a robot that does not come from a URDF file, of a new one."""
    ref = run.header.robot
    if not isinstance(ref, UrdfRef):
        return written_urdf(calibration.corrected, [*calibration.head, *_NOTES])
    path = run.path.parent / ref.urdf
    text, _ = read_text(path)
    content = text.encode()
    elements = _elements(content)
    newline = b"\r\n" if b"\r\n" in content else b"\n"
    edits = [_comment(content, elements.robot[0], calibration, newline)]
    corrected = calibration.corrected
    turned = run.robot.with_offsets(np.array([offset.applied_rad for offset in calibration.offsets]))
    for i, (joint, offset) in enumerate(zip(run.robot.joints, calibration.offsets, strict=True)):
        moved = corrected.joints[i].fixed
        if not np.allclose(moved, turned.joints[i].fixed, rtol=0, atol=_SAME):
            by = np.linalg.inv(joint.fixed) @ moved
            edits += _whole_origin(content, by, *_only(elements, joint.name, path))
        elif offset.exported:
            edits.append(_origin(content, joint, offset, *_only(elements, joint.name, path)))
    if not np.allclose(corrected.flange, run.robot.flange, rtol=0, atol=_SAME):
        name, kind = last_joint(path, ref.base, ref.tip)
        if kind != "fixed":
            raise BadInput(
                "the last link's geometry has no place in the file: the last joint moves the tip itself",
                found=f"tip: {shown(ref.tip)}",
                allowed="a tip behind a fixed joint",
                remedy="add a link behind a fixed joint to the URDF file, as tip; or exclude by name:"
                + "".join(f" --without {value.name}" for value in _of_last(calibration, run.robot.n)),
                file=path,
            )
        by = np.linalg.inv(run.robot.flange) @ corrected.flange
        edits += _whole_origin(content, by, *_only(elements, name, path))
    for start, end, instead in sorted(edits, reverse=True):
        content = content[:start] + instead + content[end:]
    bom = "\ufeff" if read_bytes(path).startswith(_BOM) else ""
    return bom + content.decode()


def _of_last(calibration: RobotCalibration, n: int) -> list[GeometryValue]:
    return [
        value for value in calibration.geometry if value.applied_rad and value.name.startswith(f"link{n}.")
    ]


def _only(elements: _UrdfElements, name: str, path: Path) -> tuple[_Element, list[_Element]]:
    """The joint element of that name, with its origins."""
    same = [pair for pair in elements.joints if pair[0].attributes.get("name") == name]
    if len(same) != 1:
        raise BadInput(
            f"the URDF file has {len(same)} joints of the same name",
            found=shown(name),
            file=path,
            remedy="give every joint a name of its own, in the URDF file of the run",
        )
    return same[0]


def _elements(content: bytes) -> _UrdfElements:
    """The elements of a URDF that has been read as the run's robot, so that it is well-formed."""
    elements = _UrdfElements()
    stack: list[str] = []
    parser = expat.ParserCreate(encoding="utf-8")

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = _Element(parser.CurrentByteIndex, attributes)
        if not stack:
            elements.robot.append(element)
        elif len(stack) == 1 and tag == "joint":
            elements.joints.append((element, []))
        elif len(stack) == 2 and stack[1] == "joint" and tag == "origin":
            elements.joints[-1][1].append(element)
        stack.append(tag)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop()
    parser.Parse(content, True)
    return elements


def _tag(content: bytes, element: _Element) -> bytes:
    tag = _START_TAG.match(content, element.start)
    assert tag is not None
    return tag.group()


def _comment(content: bytes, robot: _Element, calibration: RobotCalibration, newline: bytes) -> _Edit:
    """A comment on the file's origin, inside its top element. XML allows no `--` in a comment."""
    lines = [*calibration.head, *_NOTES]
    safe = [re.sub("-(?=-)", "- ", line).encode() for line in lines]
    at = robot.start + len(_tag(content, robot))
    return at, at, newline + newline.join([b"<!--", *safe, b"-->"])


def _origin(
    content: bytes, joint: Joint, offset: JointOffset, element: _Element, origins: list[_Element]
) -> _Edit:
    """The joint's origin moved by its offset: `rpy` alone changes if it is revolute, `xyz` if prismatic."""
    attributes = origins[0].attributes if origins else {}
    turn = euler("xyz", _numbers(attributes.get("rpy")))[:3, :3]
    if joint.kind == "revolute":
        name, values = "rpy", angles_of(turn @ joint.motion(offset.applied_rad)[:3, :3])
    else:
        name = "xyz"
        shift = turn @ joint.axis * offset.applied_rad / MILLIMETRES
        values = tuple(np.array(_numbers(attributes.get("xyz"))) + shift)
    return _with_attribute(content, name, values, element, origins)


def _whole_origin(content: bytes, by: Matrix, element: _Element, origins: list[_Element]) -> list[_Edit]:
    """The joint's origin times a transform `by` (4, 4), mm."""
    attributes = origins[0].attributes if origins else {}
    before = euler("xyz", _numbers(attributes.get("rpy")))
    before[:3, 3] = np.array(_numbers(attributes.get("xyz"))) * MILLIMETRES
    after = before @ by
    xyz = tuple((after[:3, 3] / MILLIMETRES).tolist())
    angles = angles_of(after[:3, :3])
    if not origins:
        at = element.start + len(_tag(content, element))
        return [(at, at, b"<origin xyz=" + _text(xyz) + b" rpy=" + _text(angles) + b"/>")]
    edits = [
        _with_attribute(content, name, values, element, origins)
        for name, values in (("xyz", xyz), ("rpy", angles))
    ]
    if edits[0][:2] == edits[1][:2]:  # neither was there: both go to one place
        return [(*edits[0][:2], edits[0][2] + edits[1][2])]
    return edits


def _text(values: tuple[float, ...]) -> bytes:
    return f'"{" ".join(repr(float(value)) for value in values)}"'.encode()


def _with_attribute(
    content: bytes, name: str, values: tuple[float, ...], element: _Element, origins: list[_Element]
) -> _Edit:
    text = _text(values)
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


def robot_text(run: Run, calibration: RobotCalibration) -> str:
    """The text of the file; BadInput where the run's robot has no rows, as it comes from a URDF file."""
    ref = run.header.robot
    if isinstance(ref, UrdfRef):
        raise BadInput(
            "the run's robot comes from a URDF file, which has no Denavit-Hartenberg rows to correct",
            found=f"robot: {shown(ref.urdf)}",
            allowed="robot: the name of a built-in robot, or the path of a robot file",
            remedy="zerobeam export urdf: a URDF file can hold any link",
            file=run.path,
            line=run.header_line,
        )
    file = stated_rows(ref, run.path.parent).of_robot(calibration.corrected)
    return file.text([*calibration.head, *_on_rows(file)])


def _on_rows(file: RobotFile) -> list[str]:
    lines = [
        "The offsets are in these rows: recorded positions give true poses. Limits are those of recorded",
        "    positions, as before. Tool and targets are not in here.",
    ]
    beyond = ", ".join(f"J{number}" for number, joint in enumerate(file.joints, start=1) if joint.beta_deg)
    if beyond:
        lines += [
            f"{beyond}: beta_deg is a rotation about y behind alpha (Hayati), as the next axis is nearly",
            "    parallel or the last. A table of a, alpha, d and theta alone cannot hold it: for programs",
            "    without it use zerobeam export urdf.",
        ]
    return lines
