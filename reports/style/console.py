"""Marks, colours and tables of the terminal: one place for all that is printed."""

from __future__ import annotations

from rich.markup import escape
from rich.table import Table
from rich.text import Text

from ..words.wording import NOT_DETERMINED, clipped
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


_NUMBERS = 24  # letters; a longer text is words, which may break


def marked(mark: str, text: str) -> Text:
    """A text behind the shape of a status, in its colour; plain for no status."""
    return Text(f"{MARK[mark]} {text}", style=STYLE[mark]) if mark else Text(text)


def note(text: str) -> Text:
    """A note that a reader must see."""
    return Text("! ", style="bold yellow") + Text(text)


def _alone(row: blocks.Row, k: int) -> bool:
    """Whether column k of the row has a cell of its own, of numbers."""
    return all(cell.span == 1 for cell in row.cells) and len(row.cells[k].text) <= _NUMBERS


def rich_table(stated: blocks.Table, longest: int | None = None) -> Table:
    """A table of a page, for the terminal; texts of unmarked cells are cut to `longest` letters."""
    table = Table(box=None, pad_edge=False)
    for k, column in enumerate(stated.columns):
        if column.align == "right":
            # Heads give way, numbers do not.
            widest = max((len(row.cells[k].text) for row in stated.rows if _alone(row, k)), default=None)
            table.add_column(escape(column.text), justify="right", min_width=widest)
        else:
            table.add_column(escape(column.text), justify="left")
    for row in stated.rows:
        cells: list[Text] = []
        for cell in row.cells:
            # There are no cells over several columns: words of one have to be short.
            whole = "not determined" if cell.span > 1 and cell.text == NOT_DETERMINED else cell.text
            text = whole if longest is None or cell.mark else clipped(whole, longest)
            cells.append(marked(cell.mark, text))
            cells.extend(Text("") for _ in range(cell.span - 1))
        table.add_row(*cells)
    return table
