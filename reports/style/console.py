"""Marks, colours and tables of the terminal: one place for all that is printed."""

from __future__ import annotations

from rich.markup import escape
from rich.table import Table
from rich.text import Text

from ..words.wording import clipped
from . import blocks

STYLE = {
    "identified": "blue",
    "weak": "yellow",
    "unidentifiable": "magenta",
    "held": "dim",
    "unvalidated": "dim",
}
MARK = {"identified": "●", "weak": "◆", "unidentifiable": "✕", "held": "■", "unvalidated": "?"}
VERDICT_STYLE = {
    "pass": "bold blue",
    "weak": "bold yellow",
    "degenerate": "bold magenta",
    "misfit": "bold red",
}


def marked(mark: str, text: str) -> Text:
    """A text behind the shape of a status, in its colour; plain for no status."""
    return Text(f"{MARK[mark]} {text}", style=STYLE[mark]) if mark else Text(text)


def note(text: str) -> Text:
    """A note that a reader must see."""
    return Text("! ", style="bold yellow") + Text(text)


def rich_table(stated: blocks.Table, longest: int | None = None) -> Table:
    """A table of a page, for the terminal; texts of unmarked cells are cut to `longest` letters."""
    table = Table(box=None, pad_edge=False)
    for column in stated.columns:
        table.add_column(escape(column.text), justify="right" if column.align == "right" else "left")
    for row in stated.rows:
        cells: list[Text] = []
        for cell in row.cells:
            text = cell.text if longest is None or cell.mark else clipped(cell.text, longest)
            cells.append(marked(cell.mark, text))
            cells.extend(Text("") for _ in range(cell.span - 1))
        table.add_row(*cells)
    return table
