"""Positions of a FANUC TP program as text (.ls): P[n] of motion group 1 in joint representation."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from ...model.errors import BadInput
from .imported import Imported
from .joint3 import J3
from .points import Point, import_points

# A listing ends with /POS, one block a position: P[3:"comment"]{ GP1: UF : 0, UT : 1, J1= 1.000 deg, … };
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
    """Shots from the positions of .ls files; `points` are the numbers of those to use, as text.

    `j3` says from where joint 3 is counted: see `joint3`. Listings give degrees to three decimals.
    """
    if j3 not in ("ground", "link"):
        raise BadInput(
            "it must be stated from where joint 3 is counted",
            found=j3,
            allowed="ground (as the pendant and TP programs do), link (from link 2)",
        )
    return import_points(
        files,
        target_names,
        positions,
        header_path,
        out,
        names=points,
        ground=j3 == "ground",
        told="FANUC positions of group 1, angles in degrees, joint 1 first",
    )


def positions(text: str, path: Path) -> list[Point]:
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
        raise BadInput("the listing breaks off: its last line, /END, is missing", file=path)
    found = []
    for match in _POSITION.finditer(section):
        line = text.count("\n", 0, begin.end() + match.start("number")) + 1
        found.append(Point(match["number"], _joints(match["block"], match["number"], path, line), line))
    begun = _BEGUN.findall(section)
    if begun != [point.name for point in found]:
        raise BadInput(
            "a position of the listing has no end",
            found=f"{len(begun)} begin with P[…], {len(found)} end with }};",
            remedy="save the program as ASCII once more",
            file=path,
        )
    return found


def _joints(block: str, number: str, path: Path, line: int) -> tuple[float, ...] | None:
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
