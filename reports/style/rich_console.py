"""The console that everything is printed to: its marks, colours and tables."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, RenderableType
from rich.markup import escape
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from ...words.wording import NOT_DETERMINED, clipped, visible
from . import blocks

STYLE = {
    "identified": "blue",
    "weak": "yellow",
    "unidentifiable": "magenta",
    "assumed": "dim",
    "held": "dim",
    "unvalidated": "dim",
}
MARK = {
    "identified": "●",
    "weak": "◆",
    "assumed": "○",
    "unidentifiable": "✕",
    "held": "■",
    "unvalidated": "?",
}
VERDICT_STYLE = {
    "pass": "bold blue",
    "weak": "bold yellow",
    "degenerate": "bold magenta",
    "misfit": "bold red",
    "held": "bold",
    "violated": "bold red",
}


LONGEST_NAME = 26  # letters in a cell without a mark
_HEAD = 10  # letters of a line of a head, at least


def marked(mark: str, text: str) -> Text:
    """A text behind the shape of a status, in its colour; plain for no status."""
    return Text(f"{MARK[mark]} {text}", style=STYLE[mark]) if mark else Text(text)


def note(text: str) -> Text:
    """A note that a reader must see."""
    return Text("! ", style="bold yellow") + Text(text)


def _over_numbers(head: str, table: blocks.Table, k: int) -> str:
    """The head of column `k` in lines hardly longer than its cells: numbers do not give way to a head."""
    widths = [len(row.cells[k].text) for row in table.rows if all(cell.span == 1 for cell in row.cells)]
    return "\n".join(textwrap.wrap(head, max(_HEAD, *widths))) if widths else head


def rich_table(rows: blocks.Table, longest: int | None = None) -> Table:
    """A table of a page, for the terminal; texts of unmarked cells are cut to `longest` letters."""
    table = Table(box=None, pad_edge=False)
    for k, column in enumerate(rows.columns):
        right = column.align == "right"
        head = _over_numbers(column.text, rows, k) if right else column.text
        table.add_column(escape(head), justify="right" if right else "left")
    for row in rows.rows:
        cells: list[Text] = []
        for cell in row.cells:
            # There are no cells over several columns: words of one have to be short.
            whole = "not determined" if cell.span > 1 and cell.text == NOT_DETERMINED else cell.text
            text = whole if longest is None or cell.mark else clipped(whole, longest)
            cells.append(marked(cell.mark, text))
            cells.extend(Text("") for _ in range(cell.span - 1))
        table.add_row(*cells)
    return table


def print_block(out: Console, block: blocks.Block) -> None:
    """A block of a page, for the terminal; pictures are left out."""
    match block:
        case blocks.Paragraph(text):
            out.print(Text(text))
        case blocks.Facts(rows):
            for name, text in rows:
                out.print(Text(f"{name}: ", style="dim") + Text(text))
        case blocks.Legend(reasons=reasons):
            # What the marks mean is said on the page.
            for entry in reasons:
                mark = Text(f"{MARK[entry.status]} {entry.word} ", style=STYLE[entry.status])
                out.print(mark + Text(entry.text))
        case blocks.Table():
            out.print(Text(block.caption, style="italic"))
            out.print(rich_table(block, LONGEST_NAME))


class Terminal(Console):
    """A console to which no text gets that a terminal would obey or a person not see: it is escaped.

    Its own colours and movements of the cursor are not text, and pass.
    """

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else visible(text), style, control)
