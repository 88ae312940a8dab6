"""Text files of rows and columns: numbers with their line, columns by name or number, as joints."""

from __future__ import annotations

import csv
import io
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..arrays import Matrix
from ..errors import BadInput, located
from ..kinematics.pendant import Pendant
from ..kinematics.robot import Robot
from ..parsing.reading import LARGEST_TABLE, did_you_mean, read_other_text, shown

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
    column_of: dict[int, str] = {}
    for item in columns:
        column, sign, joint = (part.strip() for part in item.rpartition("="))
        index = _joint(joint, robot)
        if not sign or not column or index is None or index in column_of:
            raise BadInput(
                "the joint of a column is not understood" if index not in column_of else "duplicate joint",
                found=item,
                allowed=f"COLUMN=JOINT, each joint once: {', '.join(names)}, or j1 to j{robot.n}",
                remedy=did_you_mean(joint, names),
            )
        column_of[index] = column
    missing = [name for i, name in enumerate(names) if i not in column_of]
    if missing:
        raise BadInput(
            "a joint has no column",
            found=", ".join(columns),
            allowed=f"one column for each of {', '.join(names)}",
            remedy=f"add COLUMN={missing[0]}",
        )
    return [column_of[i] for i in range(robot.n)]


def reversed_joints(texts: Sequence[str], robot: Robot) -> list[int]:
    """Indices of the joints to be reversed; BadInput for one that is not there, or a duplicate."""
    names = [joint.name for joint in robot.joints]
    indices: list[int] = []
    for text in texts:
        index = _joint(text, robot)
        if index is None or index in indices:
            raise BadInput(
                "the joint to be reversed is not understood" if index is None else "duplicate joint",
                found=text,
                allowed=f"each joint once: {', '.join(names)}, or j1 to j{robot.n}",
                remedy=did_you_mean(text, names),
            )
        indices.append(index)
    return indices


def _joint(text: str, robot: Robot) -> int | None:
    for names in ([joint.name for joint in robot.joints], robot.conventions.names or ()):
        if text in names:
            return names.index(text)
    digits = text[1:] if text[:1] in ("j", "J") else text
    return int(digits) - 1 if digits.isdecimal() and 1 <= int(digits) <= robot.n else None


def columns_as_on_pendant(table: TextTable, pendant: Pendant) -> list[int]:
    """Index of the column of each joint in a table of the joints alone, in the pendant's order; BadInput for
    a header row that says otherwise."""
    robot, names = pendant.robot, list(table.names or ())
    joint_names = [robot.joints[i].name for i in pendant.order]
    if names and (len(names) != robot.n or (set(names) == set(joint_names) and names != joint_names)):
        raise not_joints_alone(table, pendant)
    return [pendant.order.index(i) for i in range(robot.n)]


def not_joints_alone(table: TextTable, pendant: Pendant) -> BadInput:
    """The error about a table of other columns, where none are named."""
    robot = pendant.robot
    joint_names = [robot.joints[i].name for i in pendant.order]
    return BadInput(
        "the columns are not just the joints in their order",
        found=", ".join(table.names or ()) or f"{table.width} columns",
        allowed=f"{robot.n} columns, in the pendant's order ({', '.join(joint_names)})",
        remedy="name the columns of joint 1, 2, … in this order",
        file=table.path,
        line=table.header_line or None,
    )


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


# As people call them: those that are looked for, and any other one as it is.
DELIMITERS = {"\t": "tab", ";": "semicolon", ",": "comma", " ": "blank"}


@dataclass(frozen=True)
class TextTable:
    """Rows of text cells, all of one width, and their `lines`; `names` are of the header row, if any."""

    path: Path
    names: tuple[str, ...] | None
    header_line: int
    rows: list[list[str]]
    lines: list[int]
    decimal: str
    delimiter: str = ","

    @property
    def width(self) -> int:
        return len(self.rows[0])

    def column(self, name: str) -> int:
        """Index of a column that is stated by its name, or by its number counted from 1."""
        if self.names is not None and name in self.names:
            return self.names.index(name)
        if name.isdecimal() and len(name) < 10 and 1 <= int(name) <= self.width:
            return int(name) - 1
        if self.names is None:
            raise BadInput(
                "there is no column of this number",
                found=name,
                allowed=f"1 to {self.width}",
                remedy="column names need a header row: state it if the files have one",
                file=self.path,
                line=self.lines[0],
            )
        raise BadInput(
            "there is no column of this name",
            found=name,
            allowed=", ".join(self.names),
            remedy=_other_delimiter(self.names) or did_you_mean(name, self.names),
            file=self.path,
            line=self.header_line,
        )

    def numbers(self, columns: list[int]) -> Matrix:
        """(N, columns) finite numbers; BadInput with line and column of the first that is none."""
        parts = [_finite(self.texts(column), self.decimal) for column in columns]
        if any(part is None for part in parts):
            # One by one: the first that is none is named.
            return np.array([[self._value(i, column) for column in columns] for i in range(len(self.rows))])
        return np.array(parts).T

    def numbers_at(self, row: int, columns: Sequence[int]) -> list[float]:
        """Finite numbers of one row, as `numbers`."""
        return [self._value(row, column) for column in columns]

    def texts(self, column: int) -> list[str]:
        return [row[column] for row in self.rows]

    def _value(self, row: int, column: int) -> float:
        text = self.rows[row][column]
        value = number(text, self.decimal)
        if value is None or not math.isfinite(value):
            raise BadInput(
                f"column {column + 1} is not a {'finite ' if value is not None else ''}number",
                found=shown(text),
                allowed=f"finite numbers with a decimal {'point' if self.decimal == '.' else 'comma'}",
                remedy="remove a row that was not fully recorded",
                file=self.path,
                line=self.lines[row],
            )
        return value


def number(text: str, decimal: str = ".") -> float | None:
    """The number, finite or not; None where the text is none (Python alone takes 1_000 for one)."""
    if "_" in text or (decimal == "," and "." in text):
        return None
    try:
        return float(text.replace(",", ".") if decimal == "," else text)
    except ValueError:
        return None


def _finite(texts: list[str], decimal: str) -> Matrix | None:
    """All numbers of a column at once; None where one is not finite or no number."""
    letters = "".join(texts)
    if "_" in letters or (decimal == "," and "." in letters):
        return None
    if decimal == ",":
        texts = [text.replace(",", ".") for text in texts]
    try:
        values = np.fromiter(map(float, texts), dtype=float, count=len(texts))
    except ValueError:
        return None
    return values if np.isfinite(values).all() else None


def read_table(
    path: Path, *, header_row: bool, delimiter: str | None, decimal: str, joints_of: Robot | None
) -> TextTable:
    """The table of a file; without `delimiter` it is found. Without a header row `joints_of` means: its
    columns are a robot's joints."""
    text = read_other_text(path, LARGEST_TABLE)
    return table_of(
        text, path, header_row=header_row, delimiter=delimiter, decimal=decimal, joints_of=joints_of
    )


def table_of(
    text: str, path: Path, *, header_row: bool, delimiter: str | None, decimal: str, joints_of: Robot | None
) -> TextTable:
    """Parse a table from its text; `path` is named in errors. Else as `read_table`."""
    with located(path):
        return _table(text, path, header_row, delimiter, decimal, joints_of)


def _table(
    text: str, path: Path, header_row: bool, delimiter: str | None, decimal: str, joints_of: Robot | None
) -> TextTable:
    padded = delimiter is None
    delimiter = found_delimiter(text, decimal) if delimiter is None else delimiter
    # Columns that are aligned with blanks have several between them.
    padded = padded and delimiter == " "
    reader = csv.reader(
        io.StringIO(text, newline=""), delimiter=delimiter, strict=True, skipinitialspace=padded
    )
    rows: list[list[str]] = []
    lines: list[int] = []
    try:
        for cells in reader:
            row = list(map(str.strip, cells))
            if any(row):
                rows.append(row)
                lines.append(reader.line_num)
    except csv.Error as error:
        raise BadInput(f"the file is not valid CSV: {error}", line=reader.line_num) from None
    if not rows:
        raise BadInput("the file has no rows")
    names, header_line = None, 0
    if header_row:
        names, header_line = tuple(rows.pop(0)), lines.pop(0)
        _check_names(names, header_line, delimiter, decimal)
        if not rows:
            raise BadInput("the file has a header row only")
        width, whose = len(names), "the header row"
    else:
        if len(rows[0]) > 1 and not any(number(cell, decimal) is not None for cell in rows[0]):
            raise BadInput(
                "the first row holds no numbers",
                found=shown(delimiter.join(rows[0])),
                allowed="numbers" if joints_of is None else f"{joints_of.n} numbers",
                remedy="the decimal sign seems to be a comma: state it (--decimal ,)"
                if decimal == "." and all(number(cell, ",") is not None for cell in rows[0])
                else "if it is a header row, state it (--header-row)",
                line=lines[0],
            )
        width, whose = len(rows[0]), "the first row"
        if joints_of is not None:
            width, whose = joints_of.n, f"{joints_of.name}, which has {joints_of.n} joints"
    for cells, line in zip(rows, lines, strict=True):
        if len(cells) != width:
            whole = not header_row and line == lines[0]
            raise _wrong_count(cells, width, whose, whole, line)
    return TextTable(path, names, header_line, rows, lines, decimal, delimiter)


def _check_names(names: tuple[str, ...], line: int, delimiter: str, decimal: str) -> None:
    if all(number(name, decimal) is not None for name in names):
        raise BadInput(
            "the first row is not a header row: it holds numbers only",
            found=shown(delimiter.join(names)),
            remedy="do not state a header row: the first row would be lost",
            line=line,
        )
    for name in names:
        if names.count(name) > 1:
            raise BadInput("two columns have the same name", found=shown(name), line=line)


def _wrong_count(cells: list[str], width: int, whose: str, first: bool, line: int) -> BadInput:
    # The first row decides whether the file is of another robot; a later one is broken in itself.
    remedy = _other_delimiter(cells)
    if remedy is None and first:
        remedy = "remove the columns that are not joints, or name the columns"
    return BadInput(
        "the row has the wrong number of values",
        found=f"{len(cells)} values",
        allowed=f"{width}, as {whose}",
        remedy=remedy,
        line=line,
    )


def _other_delimiter(cells: Sequence[str]) -> str | None:
    other = next((sign for sign in ";\t, " if len(cells) == 1 and sign in cells[0]), None)
    return None if other is None else f"the delimiter seems to be {shown(other)}: state it"
