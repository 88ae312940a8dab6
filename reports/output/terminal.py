"""Pages in the terminal: words, tables and commands at the width of the screen, without pictures."""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

from ...analysis.answer.answer_message import Message
from ...model.parsing.confinement import free_path
from ...words.wording import ended, sentence, visible
from ..style.blocks import (
    Bars,
    Block,
    Cell,
    Column,
    Commands,
    Directions,
    Facts,
    Legend,
    Page,
    Paragraph,
    Table,
)

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
_MOST_ROWS, _FIRST_ROWS = 40, 20  # of a longer table the first
_HEAD = 10  # letters of a line of a head, at least
_NARROWEST = 16  # letters of a column that has to give way
_GAP = "  "
# Between these no command is broken: an option with its value, or what a shell takes as one word.
_WORD = r"(?:'[^']*'|\"[^\"]*\"|[^\s'\"])+"  # of a shell
_OPTION_OR_WORD = re.compile(rf"(?<!\S)--?[a-z][\w-]* (?=[^-\s]){_WORD}|{_WORD}")
_WRITES = re.compile(r"(?<=\s)(-o|--save) ([\w./-]+)(?=\s|$)")  # a file or folder
_TEXT_WIDTH = 96  # letters of a line of a text without a terminal


class Terminal(Console):
    """A console to which no text gets that a terminal would obey or a person not see: it is escaped.

    Its own colours and movements of the cursor are not text, and pass.
    """

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else visible(text), style, control)


def print_page(out: Console, page: Page) -> None:
    """The message or the verdict, the notes, then the sections."""
    if page.message is not None:
        print_message(out, page.message, page.front)
    elif page.verdict.word:
        verdict, style = f"{page.verdict.word}.", VERDICT_STYLE[page.verdict.key]
        print_text(out, f" {page.verdict.sentence}", verdict, style)
    for note in page.notes:
        _print_note(out, note)
    above = page.message is not None or page.verdict.word
    for section in page.sections:
        if section.title:
            if above:
                out.print()
            print_text(out, "", section.title, "bold")
        print_blocks(out, section.all)
        above = True


def page_text(page: Page) -> str:
    """The page as plain text: title, verdict, what to do, sections; notes are left to the page."""
    if page.message is not None:
        page = replace(page, message=replace(page.message, basis=(), cautions=()))
    return _indented(f"{page.title}, {page.subtitle}", lambda out: print_page(out, replace(page, notes=[])))


def table_text(table: Table) -> str:
    """A table as plain text, its caption first."""
    return _indented(table.caption, lambda out: print_rows(out, table))


def _indented(head: str, show: Callable[[Console], None]) -> str:
    out = Console(file=io.StringIO(), width=_TEXT_WIDTH, color_system=None)
    with out.capture() as captured:
        show(out)
    return "\n".join([head, *(f"{_GAP}{line}" for line in captured.get().splitlines())])


def print_message(out: Console, message: Message, front: Sequence[Block] = ()) -> None:
    """What is read first of an answer. One without a grade is grey."""
    print_text(out, "", sentence(message.verdict), VERDICT_STYLE[message.grade or "held"])
    if message.cause is not None:
        print_text(out, sentence(message.cause))
    print_text(out, sentence(message.action.text), "To do: ", "bold")
    if message.action.command is not None:
        _print_commands(out, (message.action.command,))
    print_blocks(out, front)
    for text in message.basis:
        print_text(out, "", sentence(text), "dim")
    for text in message.cautions:
        _print_note(out, text)


def print_blocks(out: Console, blocks: Iterable[Block]) -> None:
    """Blocks one below the other."""
    for block in blocks:
        match block:
            case Paragraph(text):
                print_text(out, text)
            case Commands(lines):
                _print_commands(out, lines)
            case Facts(rows):
                for name, text in rows:
                    print_text(out, text, f"{name}: ", "dim")
            case Legend(reasons=reasons):
                # What the marks mean is said on the page.
                for entry in reasons:
                    print_text(out, entry.text, f"{MARK[entry.status]} {entry.word} ", STYLE[entry.status])
            case Directions(items):
                for item in items:
                    exact = item.kind.startswith("exact")
                    print_text(out, f"{item.combination}: {item.kind}", "✕ " if exact else "◆ ", "bold")
                    print_text(out, item.reason, "  why:   ", indent=9)
                    print_text(out, item.remedy, "  to do: ", indent=9)
            case Table():
                _print_table(out, block)
            case Bars():
                _print_bars(out, block)


def print_text(out: Console, text: str, lead: str = "", style: str = "", indent: int = 0) -> None:
    """A text behind its `lead`, which has the `style`, in lines that break between words alone."""
    lines = textwrap.wrap(lead + text, out.width, break_on_hyphens=False, subsequent_indent=" " * indent)
    shown = Text("\n".join(lines))
    shown.stylize(style, 0, len(shown) if not text else len(lead))
    out.print(shown, soft_wrap=True)


def _print_note(out: Console, text: str) -> None:
    print_text(out, ended(text), "! ", "bold yellow")


def free_name(name: str) -> str:
    """The same, or with a number where this folder has something of that name: none is overwritten."""
    path = free_path(Path(name))
    return name if path == Path(name) else path.as_posix()


def _pasteable(command: str) -> str:
    """A command that can be carried out in this folder: the file that it writes has a free name, but for a
    recording that it goes on with."""
    if "--resume" in command.split():
        return command
    return _WRITES.sub(lambda each: f"{each[1]} {free_name(each[2])}", command)


def _print_commands(out: Console, commands: Sequence[str]) -> None:
    """Commands as they are to be typed."""
    for line in map(_pasteable, commands):
        width = max(out.width - 3, 20)
        if len(line) > width:
            width -= 5
        whole = _OPTION_OR_WORD.sub(lambda each: each.group().replace(" ", "\0"), line)
        wrapped = textwrap.wrap(whole, width, break_long_words=False, break_on_hyphens=False)
        for part in " \\\n     ".join(wrapped).replace("\0", " ").splitlines():
            out.print(Text(f"   {part}"), soft_wrap=True)


def _print_bars(out: Console, bars: Bars) -> None:
    print_text(out, "", bars.caption, "italic")
    name, text = (max(len(getattr(row, each)) for row in bars.rows) for each in ("name", "text"))
    room = max(min(out.width, _TEXT_WIDTH) - name - text - 2 * len(_GAP), 1)
    for row, share in zip(bars.rows, bars.shares, strict=True):
        line = Text(f"{row.name.ljust(name)}{_GAP}{row.text.rjust(text)}{_GAP}")
        line.append("█" * max(round(share * room), share > 0), style=STYLE[row.tone])
        out.print(line, soft_wrap=True)


def _print_table(out: Console, table: Table) -> None:
    more = len(table.rows) - _FIRST_ROWS if len(table.rows) > _MOST_ROWS else 0
    if table.caption:
        print_text(out, "", table.caption, "italic")
    print_rows(out, replace(table, rows=table.rows[:_FIRST_ROWS]) if more else table)
    if more:
        print_text(out, f"… {more} more: see --json or the report")


def print_rows(out: Console, table: Table) -> None:
    """All rows of a table, however many they are."""
    for part in _parts(table, out.width) if table.in_parts else [table]:
        for line in table_lines(part, out.width):
            out.print(line, soft_wrap=True)


def _parts(table: Table, width: int) -> Iterator[Table]:
    """The first column with as many of the others as fit beside it, then with those that follow."""
    sizes, begin = _sizes(table, len(table.columns) * width), 1
    while begin < len(sizes):
        room, end = width - sizes[0], begin
        while end < len(sizes) and (end == begin or sizes[end] + len(_GAP) <= room):
            room, end = room - sizes[end] - len(_GAP), end + 1
        kept = [0, *range(begin, end)]
        rows = [replace(row, cells=[row.cells[k] for k in kept]) for row in table.rows]
        yield replace(table, columns=[table.columns[k] for k in kept], rows=rows)
        begin = end


def table_lines(table: Table, width: int) -> list[Text]:
    """A table in lines of so many letters, if its words allow: numbers to the right, a head over its numbers.
    A cell over several columns may run on to the end of its line."""
    sizes = _sizes(table, width)
    heads = [_wrapped(column.text, size) for column, size in zip(table.columns, sizes, strict=True)]
    tallest = max(map(len, heads), default=0)
    aligns = [column.align for column in table.columns]
    head = [
        ([""] * (tallest - len(lines)) + lines, size, align, "")
        for lines, size, align in zip(heads, sizes, aligns, strict=True)
    ]
    lines = _lines(head)
    for row in table.rows:
        cells: list[_Cell] = []
        at = 0
        for cell in row.cells:
            end = at + cell.span
            room = sum(sizes[at:end]) + len(_GAP) * (cell.span - 1)
            if cell.span > 1 and end == len(sizes):
                room = max(room, width - sum(sizes[:at]) - len(_GAP) * at)
            align = aligns[at] if cell.span == 1 else "left"
            style = STYLE[cell.mark] if cell.mark else ""
            mark = f"{MARK[cell.mark]} " if cell.mark else ""
            cells.append((_wrapped(cell.text, room, mark), room, align, style))
            at = end
        lines += _lines(cells)
    return lines


_Cell = tuple[Sequence[str], int, str, str]  # its lines, their width, `left` or `right`, its style


def _lines(cells: Sequence[_Cell]) -> list[Text]:
    """Cells side by side, as many lines as the tallest has."""
    lines = []
    for pieces in zip_longest(*(texts for texts, *_ in cells), fillvalue=""):
        line = Text()
        for piece, (_, size, align, style) in zip(pieces, cells, strict=True):
            padded = piece.rjust(size) if align == "right" else piece.ljust(size)
            line.append(padded + _GAP, style=style)
        line.rstrip()
        lines.append(line)
    return lines


def _sizes(table: Table, width: int) -> list[int]:
    """Widths of the columns. Where the line is too long, texts give way before numbers."""
    texts: list[list[str]] = [[] for _ in table.columns]
    words = [column.text.split(" ") for column in table.columns]
    wide: list[tuple[int, int, int]] = []
    for row in table.rows:
        at = 0
        for cell in row.cells:
            if cell.span == 1:
                texts[at].append(_shown(cell))
                words[at] += [_shown(replace(cell, text=word)) for word in cell.text.split(" ")]
            elif at + cell.span < len(texts):
                wide.append((at, at + cell.span, len(_shown(cell))))
            at += cell.span
    cells = [max(map(len, column), default=0) for column in texts]
    whole = [max(size, len(column.text)) for size, column in zip(cells, table.columns, strict=True)]
    broken = [
        _with_head(size, column) if column.align == "right" else whole_size
        for size, column, whole_size in zip(cells, table.columns, whole, strict=True)
    ]
    sizes = whole if sum(whole) + len(_GAP) * (len(whole) - 1) <= width else broken
    for start, end, letters in wide:
        sizes[end - 1] += max(letters - sum(sizes[start:end]) - len(_GAP) * (end - start - 1), 0)
    least = [min(_NARROWEST, max(map(len, each), default=0)) for each in words]
    for aligned in ({"left"}, {"left", "right"}):
        while sum(sizes) + len(_GAP) * (len(sizes) - 1) > width:
            broad = [k for k, one in enumerate(table.columns) if one.align in aligned and sizes[k] > least[k]]
            if not broad:
                break
            sizes[max(broad, key=lambda k: sizes[k])] -= 1
    return sizes


def _with_head(size: int, column: Column) -> int:
    """The width of a column whose head may be broken."""
    room = max(_HEAD, size, *map(len, column.text.split(" ")))
    return max([size, *map(len, _wrapped(column.text, room))])


def _shown(cell: Cell) -> str:
    return f"{MARK[cell.mark]} {cell.text}" if cell.mark else cell.text


def _wrapped(text: str, width: int, mark: str = "") -> list[str]:
    room = max(width, len(mark) + 1)
    hanging = " " * len(mark)
    return textwrap.wrap(text, room, initial_indent=mark, subsequent_indent=hanging, break_on_hyphens=False)
