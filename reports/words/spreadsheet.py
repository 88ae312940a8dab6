"""All CSV that is written: for spreadsheets, so that no text in it is taken for a formula."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping

from .wording import shown

Row = Mapping[str, object]

_FORMULA = ("=", "+", "-", "@")  # what a cell begins with that a spreadsheet evaluates


def csv_text(rows: Iterable[Row]) -> str:
    """Rows with the same keys as CSV with a header; what is not known is an empty cell."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    names: list[str] = []
    for row in rows:
        if not names:
            names = list(row)
            writer.writerow(map(_cell, names))
        writer.writerow(_cell(row[name]) for name in names)
    return out.getvalue()


def _cell(value: object) -> object:
    """Text on one line; an apostrophe before it keeps a spreadsheet from evaluating it. Numbers stay."""
    if not isinstance(value, str):
        return value
    text = shown(value)
    return f"'{text}" if text.lstrip().startswith(_FORMULA) else text
