"""A page on the disk: HTML, PDF, its answer as JSON, its tables as CSV, its figures as SVG."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from ...words.spreadsheet import Row, csv_text
from ..style.blocks import Page
from ..style.canvas import Picture
from .html import PageKind, Turnable, html
from .pdf import pdf


def write_page(
    folder: Path,
    stem: str,
    page: Page,
    pictures: Mapping[str, Picture],
    kind: PageKind,
    *,
    answer: tuple[str, str],
    tables: Mapping[str, Iterable[Row]] | None = None,
    turnable: Turnable | None = None,
) -> list[str]:
    """Write `stem`.html and .pdf, `answer` (file name and text), the tables by file name and the figures into
    an empty folder; returns the names of the figures. The HTML of a report carries its answer."""
    name, text = answer
    (folder / name).write_text(text, encoding="utf-8")
    for file, rows in (tables or {}).items():
        (folder / file).write_text(csv_text(rows), encoding="utf-8")
    attached = text if kind == "report" else ""
    with ThreadPoolExecutor(1) as beside:  # typst leaves the interpreter to others
        document = beside.submit(pdf, page, pictures)
        text = html(page, pictures, kind, attached, turnable)
        (folder / f"{stem}.html").write_text(text, encoding="utf-8")
        (folder / f"{stem}.pdf").write_bytes(document.result())
    (folder / "figures").mkdir()
    for name, picture in pictures.items():
        (folder / "figures" / f"{name}.svg").write_text(picture.svg, encoding="utf-8")
    return [f"{name}.svg" for name in pictures]
