"""Files of rows and columns, text or workbooks: their layout, numbers with their line, columns by name or
number."""

from __future__ import annotations

import csv
import io
import itertools
import math
import re
import zipfile
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, time
from pathlib import Path
from typing import TypeVar
from xml.etree.ElementTree import ParseError

import numpy as np

from ..arrays import Matrix
from ..errors import BadInput, located, missing_extra
from ..kinematics.robot import Robot
from ..parsing.reading import (
    LARGEST,
    LARGEST_TABLE,
    did_you_mean,
    read_bytes,
    read_other_text,
    require_regular,
    shown,
)
from ..records import record

_CONTENT = "xl/workbook.xml"  # what makes an archive a workbook
_MOST_UNPACKED = 512 * 10**6  # bytes
# What openpyxl ends with where an archive or a document in it is broken.
_FAULTS = (
    *(AttributeError, EOFError, IndexError, KeyError, NotImplementedError, OSError, RuntimeError, TypeError),
    *(ValueError, ParseError, zipfile.BadZipFile, zlib.error),
)
_MOST_CELLS = 10**7  # empty ones count: a sheet may place two cells at its corners


def table_text(path: Path, most: int = LARGEST) -> str:
    """Text of a table of another program: that of a text file as `read_other_text`, that of a workbook with
    tabs between the cells, numbers with a decimal point and as exact as they are stored.

    A workbook has one sheet with cells that is not hidden; of a formula the value is read that was saved with
    it. BadInput for more sheets, for none, and for what is no whole workbook.
    """
    return workbook_text(path) if is_workbook(path) else read_other_text(path, most)


def is_workbook(path: Path) -> bool:
    """Whether a file is an .xlsx, whatever its name. What is no file is none: to read it says why."""
    try:
        require_regular(path)
        with zipfile.ZipFile(path) as archive:
            return _CONTENT in archive.namelist()
    except (BadInput, *_FAULTS):
        return False


def workbook_text(path: Path) -> str:
    """The one sheet of a workbook as `table_text` has it."""
    try:
        from openpyxl import load_workbook
    except ImportError:
        raise missing_extra("a workbook (.xlsx)", "xlsx") from None
    content = io.BytesIO(read_bytes(path, LARGEST))
    try:
        with zipfile.ZipFile(content) as archive:
            unpacked = sum(entry.file_size for entry in archive.infolist())
            if unpacked > _MOST_UNPACKED:
                raise _too_large(path, f"{unpacked // 10**6} MB unpacked")
        book = load_workbook(content, read_only=True, data_only=True)
        shown = [sheet for sheet in book.worksheets if sheet.sheet_state == "visible"]
        for sheet in shown:
            sheet.reset_dimensions()  # stated by whatever wrote the file, and often wrong
        texts = {sheet.title: _text(sheet.iter_rows(values_only=True), path) for sheet in shown}
    except _FAULTS as error:
        raise BadInput(
            "the workbook cannot be read",
            found=str(error)[:200],
            allowed="an .xlsx as spreadsheet programs save it",
            remedy="save it again, or as CSV",
            file=path,
        ) from None
    filled = {title: text for title, text in texts.items() if text.strip()}
    if len(filled) != 1:
        raise BadInput(
            "a workbook with one table is read",
            found=f"sheets with cells: {', '.join(filled)}" if filled else "no cell",
            allowed="one sheet that has cells and is not hidden",
            remedy="save the sheet with the measurements as a workbook of its own, or as CSV",
            file=path,
        )
    return next(iter(filled.values()))


def _text(rows: Iterable[Sequence[object]], path: Path) -> str:
    """Rows as wide as the widest that has a cell, in their lines; empty ones at the end are left out."""
    made: list[list[str]] = []
    width = 0
    for row in rows:
        texts = [*map(_cell, row)]
        while texts and not texts[-1]:
            texts.pop()
        width = max(width, len(texts))
        made.append(texts)
        if len(made) * max(width, 1) > _MOST_CELLS:
            raise _too_large(path, f"more than {_MOST_CELLS} cells")
    lines = ("\t".join([*texts, *[""] * (width - len(texts))]) if texts else "" for texts in made)
    return "\n".join(lines).rstrip("\n") + "\n"


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return str(int(value)) if value.is_integer() else repr(value)
    if isinstance(value, datetime | date | time):
        return value.isoformat()
    text = " ".join(str(value).split())
    return f'"{text.replace(chr(34), 2 * chr(34))}"' if text.startswith('"') else text


def _too_large(path: Path, how_much: str) -> BadInput:
    return BadInput(
        "the workbook is too large",
        found=how_much,
        allowed=f"{_MOST_UNPACKED // 10**6} MB unpacked, {_MOST_CELLS} cells",
        remedy="save the sheet with the measurements as CSV",
        file=path,
    )


_Value = TypeVar("_Value")
PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
_LINES = 50  # of a file, to find its delimiter in
_LINE_LENGTH = 100_000
_LIST = re.compile(
    r"^[^{}\n]*\bj\s*:\s*\{(?P<joints>[^{}\n]*)\}(?:\s*\{(?:\s*EJ)?(?P<external>[^{}\n]*)\})?[^{}\n]*$",
    re.IGNORECASE | re.MULTILINE,
)
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+([eE][-+]?\d+)?")
# As people call them: those that are looked for, and any other one as it is.
DELIMITERS = {"\t": "tab", ";": "semicolon", ",": "comma", " ": "blank"}


def check_signs(delimiter: str | None, decimal: str) -> None:
    """BadInput for a delimiter (None: it is found) or a decimal sign that cannot be one."""
    if decimal not in (".", ","):
        raise BadInput("not a decimal sign", found=shown(decimal), allowed=". or ,")
    if delimiter is None:
        return
    if len(delimiter) != 1 or delimiter in '."\r\n+-' or delimiter.isalnum():
        raise BadInput("not a delimiter", found=shown(delimiter), allowed="one character: , ; or tab")
    if delimiter == decimal:
        raise BadInput(
            "the decimal comma and the delimiter are the same",
            found=shown(delimiter),
            remedy="state the delimiter, such as ;",
        )


@record
class Layout:
    """The layout of a table, as it is stated or as far as its text shows it; `why` has a sentence for each
    conclusion."""

    header_row: bool
    delimiter: str
    decimal: str
    why: tuple[str, ...]


def layout_of(
    text: str, *, header_row: bool | None = None, delimiter: str | None = None, decimal: str | None = None
) -> Layout:
    """Delimiter, decimal sign and header row of a table: what is not stated as its text seems to have it."""
    why = []
    if decimal is None:
        sign = delimiter or found_delimiter(text, ".")
        cells = [cell for row in first_rows(text, sign, 3) for cell in row]
        decimal = "," if sign != "," and any(_DECIMAL_COMMA.fullmatch(cell) for cell in cells) else "."
        if decimal == ",":
            why.append("decimal comma: numbers are written with one")
    if delimiter is None:
        delimiter = found_delimiter(text, decimal)
        name = DELIMITERS.get(delimiter, delimiter)
        why.insert(0, f"delimiter: {name}, by which the rows have equally many columns")
    if header_row is None:
        first = next(iter(first_rows(text, delimiter, 1)), [])
        header_row = bool(first) and not any(number(cell, decimal) is not None for cell in first)
        why.append(
            "header row: no cell of the first row is a number"
            if header_row
            else "no header row: the first row holds numbers"
        )
    return Layout(header_row, delimiter, decimal, tuple(why))


def first_rows(text: str, delimiter: str, count: int) -> list[list[str]]:
    """The cells, but for empty ones, of the first rows of a text."""
    lines = [line for line in text[:_LINE_LENGTH].splitlines() if line.strip()][:count]
    return [[cell.strip().strip('"') for cell in line.split(delimiter) if cell.strip()] for line in lines]


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


_UNIT_OF_NAME = re.compile(
    r"\s*[\[(_ ](mm|m|[uµμ]m|inch|in|deg|degrees?|°|rad|radians?)[\])]?\s*$", re.IGNORECASE
)
_UNITS = {"µm": "um", "μm": "um", "in": "inch", "°": "deg"}
_UNITS |= {"degree": "deg", "degrees": "deg", "radian": "rad", "radians": "rad"}


def bare_name(name: str) -> str:
    """A column's name without the unit behind it."""
    return _UNIT_OF_NAME.sub("", name).strip()


def unit_of_name(name: str) -> str | None:
    """The unit behind a column's name: mm, m, um, inch, deg or rad; None where there is none.

    >>> unit_of_name("J1 [rad]"), unit_of_name("x_mm"), unit_of_name("dx")
    ('rad', 'mm', None)
    """
    match = _UNIT_OF_NAME.search(name)
    return None if match is None else _UNITS.get(match[1].lower(), match[1].lower())


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

    def require_units(self, columns: Iterable[int], units: Iterable[str | None], remedy: str) -> None:
        """BadInput where the name of one of the columns has another unit behind it than the one it is read
        in; None: any."""
        for column, unit in zip(columns, units, strict=True):
            name = "" if self.names is None else self.names[column]
            if unit is not None and unit_of_name(name) not in (None, unit):
                raise BadInput(
                    "the header row says another unit than is stated",
                    found=f"{name}, read in {unit}",
                    allowed="the unit in which the column was written",
                    remedy=remedy,
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

    def columns(self, names: Sequence[str]) -> Matrix:
        """(N, names) finite numbers of columns, as `numbers`."""
        return self.numbers([self.column(name) for name in names])

    def numbers_at(self, row: int, columns: Sequence[int]) -> list[float]:
        """Finite numbers of one row, as `numbers`."""
        return [self._value(row, column) for column in columns]

    def texts(self, column: int) -> list[str]:
        return [row[column] for row in self.rows]

    def whole_numbers(self, name: str, *, at_end: bool = False) -> list[int]:
        """The whole numbers of a column; those `at_end` of its texts: 12 of 'p12'."""
        pattern = re.compile(rf"{'(?:.*[^0-9.,])?' if at_end else ''}([0-9]{{1,9}})")
        return self._each(
            name,
            lambda text: int(pattern.fullmatch(text)[1]),  # type: ignore[index]
            "a measurement number",
            "a whole number, or a name that ends with one" if at_end else "whole numbers from 0",
        )

    def seconds(self, name: str, units: str) -> Matrix:
        """(N,) s, of a column of numbers in s, ms, us or ns, of ISO 8601 (`iso`) or of dates in a pattern.
        Times without a zone are counted as if they were of UTC."""
        if units in PER_SECOND:
            return np.asarray(self.columns([name])[:, 0] / PER_SECOND[units])
        if units != "iso" and "%" not in units:
            raise BadInput(
                "the unit of the times is not understood",
                found=units,
                allowed="s, ms, us, ns, iso, or a pattern such as %m/%d/%Y %H:%M:%S",
                remedy=did_you_mean(units, [*PER_SECOND, "iso"]),
            )

        def second(text: str) -> float:
            time = datetime.fromisoformat(text) if units == "iso" else datetime.strptime(text, units)
            return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()

        return np.array(self._each(name, second, "a time", "ISO 8601" if units == "iso" else units))

    def _each(self, name: str, value: Callable[[str], _Value], what: str, allowed: str) -> list[_Value]:
        """The value of each text of a column; BadInput with the line of the first that has none."""
        values = []
        for line, text in zip(self.lines, self.texts(self.column(name)), strict=True):
            try:
                values.append(value(text))
            except (ValueError, TypeError):
                raise BadInput(
                    f"column {name} is not {what} here",
                    found=shown(text),
                    allowed=allowed,
                    file=self.path,
                    line=line,
                ) from None
        return values

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
    """The table of a file; without `delimiter` it is found."""
    text = plain_rows(table_text(path, LARGEST_TABLE), path)
    layout = layout_of(text, header_row=header_row, delimiter=delimiter, decimal=decimal)
    return table_of(text, path, layout, joints_of)


def read_remarked_table(path: Path, delimiter: str | None, decimal: str) -> tuple[TextTable, list[str]]:
    """A table and its lines of remarks. The names of columns are in the first row, if no cell of it is a
    number, or in the last remark before it, if it has as many cells."""
    text, remarks = without_remarks(plain_rows(table_text(path, LARGEST_TABLE), path))
    layout = layout_of(text, delimiter=delimiter, decimal=decimal)
    lines, named = text.split("\n"), layout.header_row
    first = next((i for i, line in enumerate(lines) if line.strip()), 0)
    above = [i for i in remarks if i < first]
    if above and not named:
        # A remark may name fewer columns than there are: dates, and what was added after them.
        both = first_rows(f"{remarks[above[-1]]}\n{lines[first]}", layout.delimiter, 2)
        if len(both) == 2 and len(both[0]) == len(both[1]):
            named = not any(number(cell, decimal) is not None for cell in both[0])
            lines[above[-1]] = remarks[above[-1]] if named else ""
    layout = replace(layout, header_row=named)
    return table_of("\n".join(lines), path, layout), list(remarks.values())


def without_remarks(text: str, signs: tuple[str, ...] = ("//", "#")) -> tuple[str, dict[int, str]]:
    """The text with empty lines for those that begin with one of the `signs`, and these by their index."""
    lines = text.splitlines()
    remarks = {i: line.strip() for i, line in enumerate(lines) if line.lstrip().startswith(signs)}
    rows = "\n".join("" if i in remarks else line for i, line in enumerate(lines))
    return rows, {i: line.lstrip("/#").strip() for i, line in remarks.items()}


def plain_rows(text: str, path: Path) -> str:
    """Rows of lists `j:{10,20,…}{EJ 0,…}`, as Rokae's programs have them, as plain rows; another text as it
    is. BadInput where an external axis is not at 0."""
    if _LIST.search(text[:_LINE_LENGTH]) is None:
        return text
    for match in _LIST.finditer(text):
        if re.search("[1-9]", match["external"] or ""):
            raise BadInput(
                "a list of joints has external axes that are not at 0",
                found=shown(match[0].strip()),
                allowed="joints alone: external axes may carry the arm or the target",
                remedy="record with the external axes at 0, and remove the other rows",
                file=path,
                line=text.count("\n", 0, match.start()) + 1,
            )
    return _LIST.sub(lambda match: match["joints"], text)


def table_of(text: str, path: Path, layout: Layout, joints_of: Robot | None = None) -> TextTable:
    """The table of a text; `path` is named in errors. Without a header row `joints_of` means: its columns are
    a robot's joints."""
    with located(path):
        return _table(text, path, layout, joints_of)


def _table(text: str, path: Path, layout: Layout, joints_of: Robot | None) -> TextTable:
    header_row, delimiter, decimal = layout.header_row, layout.delimiter, layout.decimal
    # Columns that are aligned with blanks have several between them.
    reader = csv.reader(
        io.StringIO(text, newline=""), delimiter=delimiter, strict=True, skipinitialspace=delimiter == " "
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
    if remedy is None and len(cells) < width:
        remedy = "complete the row: each joint has a value in every row"
    elif remedy is None and first:
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
