"""All CSV that is written: for spreadsheets, so that no text in it is taken for a formula."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Mapping

from .wording import shown

Row = Mapping[str, object]

_FORMULA = ("=", "+", "-", "@")  # what a cell begins with that a spreadsheet evaluates


def csv_text(rows: Iterable[Row]) -> str:
    """Rows with the same keys as CSV with a header; what is not known is an empty cell."""
    return "".join(csv_lines(rows))


def csv_lines(rows: Iterable[Row]) -> Iterator[str]:
    """The same line by line, as the rows come."""
    names: list[str] = []
    for row in rows:
        if not names:
            names = list(row)
            yield _line(names)
        yield _line(row[name] for name in names)


def _line(cells: Iterable[object]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerow(map(_cell, cells))
    return out.getvalue()


def _cell(value: object) -> object:
    """Text on one line; an apostrophe before it keeps a spreadsheet from evaluating it. Numbers stay."""
    if not isinstance(value, str):
        return value
    text = shown(value)
    return f"'{text}" if text.lstrip().startswith(_FORMULA) else text
