"""Tables of workbooks (.xlsx) as text, read by openpyxl, with a line for each row of the sheet."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Iterable, Sequence
from datetime import date, datetime, time
from pathlib import Path
from xml.etree.ElementTree import ParseError

from ..errors import BadInput, missing_extra
from ..parsing.reading import LARGEST, read_bytes, read_other_text, require_regular

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
