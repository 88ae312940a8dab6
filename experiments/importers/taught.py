"""Taught points in a FANUC program (.ls) or a KUKA data list (.dat): each that is used is a measurement."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...model.errors import BadInput
from ...model.files.limits import require_joint_count
from ...model.files.reading import did_you_mean, read_text, shown
from ...model.robot import Robot
from .imported import J3, J3_NOTE, Found, Imported, Job, from_ground, one_target_each


class Point(NamedTuple):
    """A point of the file: degrees (mm if prismatic), or None where it is Cartesian or was not taught."""

    name: str
    joints: tuple[float, ...] | None
    line: int


def import_points(
    files: Sequence[Path | str],
    target_names: Sequence[str],
    parse: Callable[[str, Path], list[Point]],
    header_path: Path | str,
    out: Path | str,
    *,
    names: Sequence[str] | None,
    ground: bool = False,
    note: str,
) -> Imported:
    """Measurements at the points of files, as `parse` (text, path) reads them; `names` selects some.

    `ground`: joint 3 is counted from the ground. BadInput for a point without joint values.
    """
    job = Job.begin(files, header_path)
    one_target_each(job.paths, target_names)
    found = []
    for path, target in zip(job.paths, target_names, strict=True):
        points = _chosen(parse(read_text(path)[0], path), names, path)
        rows = [_joints(point, job.robot, path) for point in points]
        joints = from_ground(np.array(rows), job.robot) if ground else np.array(rows)
        listed = f"  points in their order: {', '.join(point.name for point in points)}"
        lines = [point.line for point in points]
        found.append(Found(path, "point", joints, [target] * len(points), lines=lines, notes=[listed]))
    return job.finish(found, out, [note, *([J3_NOTE] if ground else [])])


def _chosen(points: Sequence[Point], names: Sequence[str] | None, path: Path) -> list[Point]:
    known = [point.name for point in points]
    if not points:
        raise BadInput("no measurements found: the file has no points", file=path)
    if names is None:
        return list(points)
    for name in names:
        if name not in known:
            raise BadInput(
                "there is no point of this name",
                found=name,
                allowed=", ".join(known),
                remedy=did_you_mean(name, known),
                file=path,
            )
    return [points[known.index(name)] for name in dict.fromkeys(names)]


def _joints(point: Point, robot: Robot, path: Path) -> tuple[float, ...]:
    if point.joints is None:
        raise BadInput(
            f"point {point.name} has no joint values",
            found="a Cartesian position, or one that was not taught",
            allowed="joint values: the configuration of the arm is not guessed",
            remedy="show it as joints on the controller and save again, or name the points to use (--points)",
            file=path,
            line=point.line,
        )
    require_joint_count(point.joints, robot, f"point {point.name}", path, point.line)
    return point.joints


# FANUC: a listing ends with /POS and blocks like P[3:"comment"]{ GP1: UF : 0, UT : 1, J1= 1.000 deg, … };
_POSITION = re.compile(
    r"^\s*P\[\s*(?P<number>\d+)[^\]]*\]\s*\{(?P<block>.*?)\}\s*;", re.MULTILINE | re.DOTALL
)
_BEGUN = re.compile(r"^\s*P\[\s*(\d+)", re.M)
_GROUP_1 = re.compile(r"GP1\s*:(?P<values>.*?)(?=GP\d+\s*:|\Z)", re.DOTALL)
_JOINT = re.compile(r"\bJ(?P<number>\d)\s*=\s*(?P<value>[-+]?(?:\d+\.?\d*|\.\d+))\s*(?P<unit>deg|mm)\b")
_ANY_JOINT = re.compile(r"\bJ\d\s*=")


def import_fanuc(
    files: Sequence[Path | str],
    target_names: Sequence[str],
    header_path: Path | str,
    out: Path | str,
    *,
    j3: J3,
    points: Sequence[str] | None = None,
) -> Imported:
    """Measurements at the P[n] of FANUC .ls files (group 1); `points` are the numbers of some, as text.

    `j3` says from where joint 3 is counted (`from_ground`). Listings give degrees to three decimals.
    """
    if j3 not in ("ground", "link"):
        raise BadInput(
            "the reference of joint 3 is not stated",
            found=j3,
            allowed="ground (as the pendant and TP programs do), link (from link 2)",
        )
    return import_points(
        files,
        target_names,
        fanuc_positions,
        header_path,
        out,
        names=points,
        ground=j3 == "ground",
        note="FANUC positions of group 1, angles in degrees, joint 1 first",
    )


def fanuc_positions(text: str, path: Path) -> list[Point]:
    """All P[n] of a listing, in its order."""
    begin = re.search(r"^/POS\b", text, re.MULTILINE)
    if begin is None:
        raise BadInput(
            "the file is not a TP program with positions",
            found="no line /POS",
            allowed="a text listing (.ls)",
            remedy="save the program as ASCII, not as .tp",
            file=path,
        )
    section = text[begin.end() :]
    if re.search(r"^/END\b", section, re.MULTILINE) is None:
        raise BadInput("the listing is incomplete: its last line, /END, is missing", file=path)
    found = []
    for match in _POSITION.finditer(section):
        line = text.count("\n", 0, begin.end() + match.start("number")) + 1
        found.append(Point(match["number"], _fanuc_joints(match["block"], match["number"], path, line), line))
    begun = _BEGUN.findall(section)
    if begun != [point.name for point in found]:
        raise BadInput(
            "a position of the listing is incomplete",
            found=f"{len(begun)} begin with P[…], {len(found)} end with }};",
            remedy="save the program as ASCII again",
            file=path,
        )
    return found


def _fanuc_joints(block: str, number: str, path: Path, line: int) -> tuple[float, ...] | None:
    group = _GROUP_1.search(block)
    if group is None:
        return None
    values = _JOINT.findall(group["values"])
    stated = len(_ANY_JOINT.findall(group["values"]))
    if not stated:
        return None
    # A position that was never taught is printed as J1= ********; a slide shows mm, which is no joint here.
    orderly = [int(joint) for joint, _, _ in values] == list(range(1, stated + 1))
    if not orderly or any(unit != "deg" for _, _, unit in values):
        raise BadInput(
            f"the joints of P[{number}] cannot be read",
            found=" ".join(group["values"].split()),
            allowed="J1=… deg, J2=… deg, …, all taught",
            file=path,
            line=line,
        )
    return tuple(float(value) for _, value, _ in values)


# KUKA: DECL E6AXIS XP1={A1 -90.0,A2 …,E6 0.0}, or P[1]={E6AXIS: A1 …} of an array: an aggregate of KRL that
# begins with an axis is an axis position, one that begins with X is Cartesian.
_AGGREGATE = re.compile(
    r"(?P<name>\w+(?:\[\d+\])?)\s*=\s*\{\s*(?:\w+\s*:)?(?P<fields>\s*(?:A\d|X)\s[^{}]*)(?P<closed>\}?)",
    re.IGNORECASE,
)
_AXIS = re.compile(r"^A(\d)\s+([-+]?(?:\d+\.?\d*|\.\d+)(?:E[-+]?\d+)?)$", re.IGNORECASE)


def import_kuka(
    files: Sequence[Path | str],
    target_names: Sequence[str],
    header_path: Path | str,
    out: Path | str,
    *,
    points: Sequence[str] | None = None,
) -> Imported:
    """Measurements at the axis positions of KUKA .dat files; `points` are the names of those to use (XP1, …).

    External axes (E1, …) are ignored. The signs of the axes are KUKA's: the robot file must have them too.
    """
    return import_points(
        files,
        target_names,
        kuka_positions,
        header_path,
        out,
        names=points,
        note="KUKA axis positions, angles in degrees, A1 first, external axes ignored",
    )


def kuka_positions(text: str, path: Path) -> list[Point]:
    """All positions of a data list, in its order; comments (;) are skipped."""
    bare = re.sub(r";[^\n]*", "", text)
    if re.search(r"^\s*DEFDAT\b", bare, re.MULTILINE | re.IGNORECASE) and not re.search(
        r"^\s*ENDDAT\b", bare, re.MULTILINE | re.IGNORECASE
    ):
        raise BadInput("the data list is incomplete: its last line, ENDDAT, is missing", file=path)
    found = []
    for match in _AGGREGATE.finditer(bare):
        line = bare.count("\n", 0, match.start("name")) + 1
        cartesian = match["fields"].strip()[0] in "Xx"
        found.append(Point(match["name"], None if cartesian else _axes(match, path, line), line))
    return found


def _axes(match: re.Match[str], path: Path, line: int) -> tuple[float, ...]:
    fields = [field.strip() for field in match["fields"].split(",")]
    axes = [field for field in fields if field[:1].upper() == "A"]
    values = [_AXIS.match(axis) for axis in axes]
    numbers = [int(value[1]) for value in values if value is not None]
    if not match["closed"] or not axes or numbers != list(range(1, len(axes) + 1)):
        raise BadInput(
            f"the axes of {match['name']} cannot be read",
            found=shown(match["fields"].strip()[:80]),
            allowed="{A1 …, A2 …, …}, each once, in this order",
            file=path,
            line=line,
        )
    return tuple(float(value[2]) for value in values if value is not None)
