"""A table's columns and delimiters as they are found, before it is said which is which joint."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.files.reading import LARGEST_TABLE, decode, read_bytes, require_regular, shown
from ....model.kinematics.robot import Robot
from ..columns import found_delimiter
from ..table import DELIMITERS, Table, number, table_of

HEAD = 4 * 10**6  # bytes of a table that are looked at while somebody waits
_COUNTED = re.compile(r"(.*?)(\d{1,2})(\D*)")
_COMMA = re.compile(r"[-+]?\d+,\d+([eE][-+]?\d+)?")


@dataclass(frozen=True)
class Column:
    """`stated` is what an import calls the column: its name, or its number where the name cannot be stated.

    `lowest` and `highest` are of its numbers, None where it holds something else: `other`, of line `line`.
    """

    name: str
    stated: str
    lowest: float | None
    highest: float | None
    other: str | None
    line: int | None


@dataclass(frozen=True)
class Layout:
    """How a table is laid out, as far as it can be seen; `why` has a sentence for each that was found."""

    header_row: bool
    delimiter: str
    decimal: str
    why: tuple[str, ...]


def head_of(path: Path, most: int = HEAD) -> tuple[str, bool]:
    """The text of a table's first rows, whole lines, and whether that is all of it."""
    require_regular(path)
    size = path.stat().st_size
    if size <= most:
        return decode(read_bytes(path, LARGEST_TABLE), file=path, line=None), True
    with path.open("rb") as file:
        content = file.read(most)
    whole = content[: content.rfind(b"\n") + 1]
    if not whole:
        raise BadInput(
            "the first line of the file is too long to be a row",
            found=f"no end of a line in {most // 10**6 or 1} MB",
            file=path,
        )
    return decode(whole, file=path, line=None), False


def layout_of(text: str) -> Layout:
    """What delimiter, decimal sign and header row a text seems to have."""
    points = found_delimiter(text, ".")
    cells = _first(text, points, 3)
    comma = points != "," and any(_COMMA.fullmatch(cell) for row in cells for cell in row)
    decimal = "," if comma else "."
    delimiter = found_delimiter(text, decimal)
    rows = _first(text, delimiter, 1)
    first = rows[0] if rows else []
    header = bool(first) and not any(number(cell, decimal) is not None for cell in first)
    why = [f"delimiter: {DELIMITERS.get(delimiter, delimiter)}, by which the rows have equally many columns"]
    if comma:
        why.append("decimal comma: numbers are written with one")
    why.append(
        "header row: no cell of the first row is a number"
        if header
        else "no header row: the first row holds numbers"
    )
    return Layout(header, delimiter, decimal, tuple(why))


def layout_stated(found: Layout, stated: Mapping[str, Any]) -> Layout:
    """The layout as it is stated, by field, and as it is found where it is not."""
    return dataclasses.replace(found, **stated)


def table_with(path: Path, text: str, layout: Layout) -> Table:
    """The table of a text; BadInput with the line where it is none."""
    found = found_delimiter(text, layout.decimal) == layout.delimiter
    return table_of(
        text,
        path,
        header_row=layout.header_row,
        delimiter=None if found else layout.delimiter,  # found ones may have blanks about them
        decimal=layout.decimal,
        joints_of=None,
    )


def columns_of(table: Table) -> list[Column]:
    names = table.names or tuple(f"column {i + 1}" for i in range(table.width))
    return [_column(table, i, name) for i, name in enumerate(names)]


def proposed_columns(found: Sequence[Column], robot: Robot) -> tuple[list[str], str] | None:
    """Columns that seem to be those of joint 1, 2, …, and why; None where nothing says so, or several do.

    By the robot's own names, by names that are counted from 0 or 1, or as the only columns of numbers.
    """
    own = [joint.name for joint in robot.joints]
    stated = {column.name: column.stated for column in found}
    if set(own) <= set(stated):
        return [stated[name] for name in own], "the columns have the names of the robot's joints"
    counted: dict[tuple[str, str], dict[int, Column]] = {}
    for column in found:
        match = _COUNTED.fullmatch(column.name)
        if match is not None and column.lowest is not None and column.stated == column.name:
            counted.setdefault((match[1], match[3]), {})[int(match[2])] = column
    series = [
        [columns[k] for k in range(first, first + robot.n)]
        for columns in counted.values()
        for first in (0, 1)
        if set(columns) == set(range(first, first + robot.n))
    ]
    if len(series) == 1:
        first, last = series[0][0].name, series[0][-1].name
        why = f"{first} to {last} are the only columns that are counted to {robot.n} joints"
        return [column.stated for column in series[0]], why
    plain = [column for column in found if column.lowest is not None]
    if not series and len(plain) == robot.n and len(found) == robot.n:
        return [column.stated for column in plain], f"the file has {robot.n} columns, as the robot has joints"
    return None


def values_of(table: Table, column: int) -> Matrix:
    """(N,) numbers of a column; BadInput with the line of the first that is none."""
    return table.numbers([column])[:, 0]


def _column(table: Table, i: int, name: str) -> Column:
    plain = table.names is not None and name and not set(name) & set(",=") and not name.isdecimal()
    stated = name if plain else str(i + 1)
    try:
        values = values_of(table, i)
    except BadInput:
        line, text = next(
            (line, text)
            for line, text in zip(table.lines, table.texts(i), strict=True)
            if (value := number(text, table.decimal)) is None or not np.isfinite(value)
        )
        return Column(name, stated, None, None, shown(text), line)
    return Column(name, stated, float(values.min()), float(values.max()), None, None)


def _first(text: str, delimiter: str, count: int) -> Sequence[list[str]]:
    lines = [line for line in text[:100_000].splitlines() if line.strip()][:count]
    return [[cell.strip().strip('"') for cell in line.split(delimiter) if cell.strip()] for line in lines]
