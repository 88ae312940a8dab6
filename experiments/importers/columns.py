"""Columns of a table by name: which is which joint, and the delimiter between them."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Sequence

from ...model.errors import BadInput
from ...model.files.reading import did_you_mean
from ...model.kinematics.robot import Robot

_LINES = 50  # of a file, to find its delimiter in
_LINE_LENGTH = 100_000


def columns_of_joints(columns: Sequence[str] | None, robot: Robot) -> Sequence[str] | None:
    """The columns of joint 1, 2, …, in this order, from a list of them or of `column=joint`.

    A joint is named as in the robot file or on the pendant, or j1, j2, …, or by its number. BadInput for a
    joint that is not there, is missing or a duplicate.
    """
    if columns is None or not any("=" in column for column in columns):
        return columns
    names = [joint.name for joint in robot.joints]
    found: dict[int, str] = {}
    for item in columns:
        column, sign, joint = (part.strip() for part in item.rpartition("="))
        index = _joint(joint, robot)
        if not sign or not column or index is None or index in found:
            raise BadInput(
                "the joint of a column is not understood" if index not in found else "duplicate joint",
                found=item,
                allowed=f"COLUMN=JOINT, each joint once: {', '.join(names)}, or j1 to j{robot.n}",
                remedy=did_you_mean(joint, names),
            )
        found[index] = column
    missing = [name for i, name in enumerate(names) if i not in found]
    if missing:
        raise BadInput(
            "a joint has no column",
            found=", ".join(columns),
            allowed=f"one column for each of {', '.join(names)}",
            remedy=f"add COLUMN={missing[0]}",
        )
    return [found[i] for i in range(robot.n)]


def reversed_joints(stated: Sequence[str], robot: Robot) -> list[int]:
    """Indices of the joints to be reversed; BadInput for one that is not there, or a duplicate."""
    names = [joint.name for joint in robot.joints]
    found: list[int] = []
    for text in stated:
        index = _joint(text, robot)
        if index is None or index in found:
            raise BadInput(
                "the joint to be reversed is not understood" if index is None else "duplicate joint",
                found=text,
                allowed=f"each joint once: {', '.join(names)}, or j1 to j{robot.n}",
                remedy=did_you_mean(text, names),
            )
        found.append(index)
    return found


def _joint(text: str, robot: Robot) -> int | None:
    for names in ([joint.name for joint in robot.joints], robot.conventions.names or ()):
        if text in names:
            return names.index(text)
    digits = text[1:] if text[:1] in ("j", "J") else text
    return int(digits) - 1 if digits.isdecimal() and 1 <= int(digits) <= robot.n else None


def found_delimiter(text: str, decimal: str) -> str:
    """The delimiter of a table: the first of tab, semicolon, comma and blank by which its first rows all have
    the same number of columns, more than one. A comma where there is none (a table of one column)."""
    head = [line[:_LINE_LENGTH] for line in itertools.islice(io.StringIO(text), 10 * _LINES) if line.strip()]
    for delimiter in "\t;, ":
        if delimiter == decimal:
            continue
        try:
            widths = {
                len([cell for cell in row if cell.strip()] if delimiter == " " else row)
                for row in csv.reader(head[:_LINES], delimiter=delimiter)
            }
        except csv.Error:
            continue
        if len(widths) == 1 and widths.pop() > 1:
            return delimiter
    return ";" if decimal == "," else ","
