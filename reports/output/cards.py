"""What a notebook shows of an answer: a card with verdict and tables; the same as lines of text."""

from __future__ import annotations

import functools
import textwrap
from collections.abc import Sequence

from markupsafe import Markup

from ..style.blocks import Page, Table
from ..style.palette import css_variables
from .template import TEMPLATES, template

_WIDTH = 96
_MOST_ROWS = 8  # with verdict and heads, text stays below fifteen lines
_MOST_LINES = 3  # of a headline


def card(page: Page, tables: Sequence[Table]) -> str:
    """The heading, verdict and notes of a page with some tables, as HTML for another page."""
    return template("card.html.j2").render(view=page, tables=tables, css=Markup(_style()))


def text(page: Page, table: Table) -> str:
    """The same as text of at most 14 lines: title, verdict, one table; long ones are cut short."""
    said = textwrap.wrap(
        f"{page.verdict.word}. {page.verdict.sentence}", _WIDTH, max_lines=_MOST_LINES, placeholder=" …"
    )
    rows = [[cell.text for cell in row.cells] for row in table.rows]
    if len(rows) > _MOST_ROWS:
        rest = len(rows) - _MOST_ROWS + 1
        rows = [*rows[: _MOST_ROWS - 1], [f"… {rest} more"]]
    cells = [[column.text for column in table.columns], *rows]
    widths = [max(len(row[k]) for row in cells if k < len(row)) for k in range(len(table.columns))]
    lines = (
        "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=False)).rstrip()
        for row in cells
    )
    return "\n".join([f"{page.title}, {page.subtitle}", *(f"  {line}" for line in (*said, *lines))])


@functools.cache
def _style() -> str:
    sheet = (TEMPLATES / "card.css").read_text(encoding="utf-8")
    return sheet.replace("/* LIGHT */", css_variables("light")).replace("/* DARK */", css_variables("dark"))
