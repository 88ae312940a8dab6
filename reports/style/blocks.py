"""What all pages are made of: sections of blocks, all display strings, so that one template shows them all.

HTML templates read the attributes; for typst `pdf` writes them as JSON, a block with its `kind`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, TypeVar

from ...analysis.answer.answer_message import Message
from ...words.numbers import NO_BREAK

_PHONE, _MARK = 49, 2  # letters of a phone's line, of a mark


@dataclass(frozen=True)
class Cell:
    """A cell of a table; `mark` is the status (a role of the palette) whose shape is in it, or ""; `link` the
    file beside the page that the first cell of a row leads to, or ""."""

    text: str
    span: int = 1
    mark: str = ""
    link: str = ""


Thing = TypeVar("Thing")
Columns = Mapping[str, Callable[[Thing], str | Cell]]  # of a table, by their heads


@dataclass(frozen=True)
class Row:
    """A row of a table; `tone` is the status that colours it, or ""."""

    cells: Sequence[Cell]
    tone: str = ""


@dataclass(frozen=True)
class Column:
    """The head of a column; `align` is `left` or `right`."""

    text: str
    align: str


@dataclass(frozen=True)
class Table:
    """A table with a caption and a head; `screen_only`: paper has it not; `in_parts`: where lines are too
    short for all columns, those that are left follow below, behind the first."""

    caption: str
    columns: Sequence[Column]
    rows: Sequence[Row]
    screen_only: bool = False
    in_parts: bool = False
    kind: ClassVar[str] = "table"

    @property
    def narrow(self) -> bool:
        """Whether a phone shows it as a table: its rows fit a line there, heads broken at spaces."""
        letters = [max(map(len, column.text.split()), default=0) for column in self.columns]
        for row in self.rows:
            at = 0
            for cell in row.cells:
                if cell.span == 1 and at < len(letters):
                    letters[at] = max(letters[at], len(cell.text) + (_MARK if cell.mark else 0))
                at += cell.span
        return sum(letters) + len(letters) <= _PHONE


@dataclass(frozen=True)
class Paragraph:
    """Text, in which a percent sign does not part from its number; `screen_only`: paper has it not."""

    text: str
    screen_only: bool = False
    kind: ClassVar[str] = "text"

    def __post_init__(self) -> None:
        object.__setattr__(self, "text", self.text.replace(" %", f"{NO_BREAK}%"))


@dataclass(frozen=True)
class Commands:
    """Lines to be typed or copied, as they are."""

    lines: Sequence[str]
    kind: ClassVar[str] = "commands"


@dataclass(frozen=True)
class Facts:
    """Rows of a name and a text."""

    rows: Sequence[tuple[str, str]]
    kind: ClassVar[str] = "facts"


@dataclass(frozen=True)
class Form:
    """Rows of a name and a text, on a ruled line for ink where there is none; `to_sign`, names of lines with
    room for a signature."""

    rows: Sequence[tuple[str, str]]
    to_sign: Sequence[str] = ()
    kind: ClassVar[str] = "form"


@dataclass(frozen=True)
class LegendEntry:
    """The mark of a status with a word and what it means; or with names and a sentence about them."""

    status: str
    word: str
    text: str


@dataclass(frozen=True)
class Legend:
    """What the marks mean, then sentences that are headed by one."""

    entries: Sequence[LegendEntry]
    reasons: Sequence[LegendEntry]
    kind: ClassVar[str] = "legend"


@dataclass(frozen=True)
class FigureBlock:
    """The picture of this name; nothing is shown where there is no such picture. `screen_only`: paper has it
    not."""

    name: str
    screen_only: bool = False
    kind: ClassVar[str] = "figure"


@dataclass(frozen=True)
class SceneBlock:
    """The picture that can be turned (`run_scene.py`), if the page has one."""

    screen_only: bool = False

    kind: ClassVar[str] = "scene"


@dataclass(frozen=True)
class Direction:
    """A combination of parameters that the data do not determine, how badly, why, and what to do."""

    combination: str
    kind: str
    reason: str
    remedy: str


@dataclass(frozen=True)
class Directions:
    """What the data do not determine, one combination after the other."""

    items: Sequence[Direction]
    kind: ClassVar[str] = "directions"


@dataclass(frozen=True)
class Bar:
    """A quantity as a bar: `text` is the number with its unit, `tone` a role of the palette."""

    name: str
    value: float
    text: str
    tone: str


@dataclass(frozen=True)
class Bars:
    """Quantities to compare, from zero; `shares` of the largest."""

    caption: str
    rows: Sequence[Bar]
    kind: ClassVar[str] = "bars"
    shares: Sequence[float] = field(init=False)

    def __post_init__(self) -> None:
        largest = max((row.value for row in self.rows), default=0.0)
        object.__setattr__(self, "shares", [row.value / largest if largest else 0.0 for row in self.rows])


Block = Table | Paragraph | Commands | Facts | Form | Legend | FigureBlock | SceneBlock | Directions | Bars


@dataclass(frozen=True)
class Section:
    """A section of level 1, or of level 2 below one of level 1.

    `lead` stays on one page with the heading, `blocks` follow it. A section of level 1 that is `folded` shows
    its heading alone on a screen, until it is opened; on paper it is whole. `brief`: it is shown in the
    terminal, too.
    """

    title: str
    lead: Sequence[Block]
    blocks: Sequence[Block]
    level: int = 1
    new_page: bool = False
    folded: bool = False
    brief: bool = False

    @property
    def all(self) -> tuple[Block, ...]:
        """The blocks in their order."""
        return (*self.lead, *self.blocks)


@dataclass(frozen=True)
class Verdict:
    """`key` is `pass`, `weak`, `degenerate`, `misfit`; `held` of what was simulated."""

    key: str
    word: str
    sentence: str


@dataclass(frozen=True)
class Page:
    """A whole report or study. `facts` are in its head: when, which machine, by whom. The `message` of an
    answer stands in place of the verdict's word and sentence, and of notes. `front` stands on page one
    between what to do and what the answer rests on; `band`, above the verdict, says that no robot was
    measured."""

    title: str
    subtitle: str
    verdict: Verdict
    notes: Sequence[str]
    sections: Sequence[Section]
    facts: Sequence[tuple[str, str]] = ()
    message: Message | None = None
    front: Sequence[Block] = ()
    band: str = ""

    @property
    def brief(self) -> Page:
        """What the terminal shows of it: the sections that are `brief`, or the first one where none is."""
        marked = [section for section in self.sections if section.brief]
        return replace(self, sections=marked or self.sections[:1])

    @property
    def chapters(self) -> list[list[Section]]:
        """The sections of level 1, each with those of level 2 below it."""
        chapters: list[list[Section]] = []
        for section in self.sections:
            if section.level == 1 or not chapters:
                chapters.append([])
            chapters[-1].append(section)
        return chapters


def on_screen(table: Table | None) -> Table | None:
    """A table that paper has not: every number of it is in the JSON."""
    return None if table is None else replace(table, screen_only=True)


def on_paper(blocks: Sequence[Block]) -> list[Block]:
    """The blocks without those of the screen alone."""
    return [block for block in blocks if not getattr(block, "screen_only", False)]


def plain_page(title: str, *blocks: Block | None) -> Page:
    """Blocks without a verdict."""
    return Page(title, "", Verdict("held", "", ""), [], [section_of(title, *blocks)])


def table_of(caption: str, heads: Sequence[str], rows: Iterable[Row], aligned: str = "lr") -> Table:
    """A table; `aligned` has l (left) or r (right) for each column, its last letter for all that follow."""
    letters = aligned.ljust(len(heads), aligned[-1])
    sides = {"l": "left", "r": "right"}
    columns = [Column(head, sides[letter]) for head, letter in zip(heads, letters, strict=False)]
    return Table(caption, tuple(columns), tuple(rows))


def table_by(
    caption: str,
    things: Iterable[Thing],
    columns: Columns[Thing],
    aligned: str = "lr",
    tone: Callable[[Thing], str] = lambda thing: "",
) -> Table:
    """A row for each of the things: what each of the `columns`, by its head, says of it. A column that says
    nothing of any is left out; `aligned` has a letter for it all the same."""
    rows = [(row_of(*(says(thing) for says in columns.values())).cells, tone(thing)) for thing in things]
    letters = aligned.ljust(len(columns), aligned[-1])
    kept = [k for k in range(len(columns)) if not rows or any(cells[k].text for cells, _ in rows)]
    heads = list(columns)
    shown = [Row(tuple(cells[k] for k in kept), colour) for cells, colour in rows]
    return table_of(caption, [heads[k] for k in kept], shown, "".join(letters[k] for k in kept) or "l")


def row_of(*cells: str | Cell, tone: str = "") -> Row:
    return Row(tuple(cell if isinstance(cell, Cell) else Cell(cell) for cell in cells), tone)


def section_of(
    title: str, *blocks: Block | None, level: int = 1, new_page: bool = False, brief: bool = False
) -> Section:
    """A section; None is left out. What leads up to its first figure stays with it, unless a table does."""
    present = tuple(block for block in blocks if block is not None)
    kinds = [block.kind for block in present]
    end = kinds.index("figure") + 1 if "figure" in kinds else 0
    if "table" in kinds[:end]:
        end = 0
    return Section(title, present[:end], present[end:], level, new_page, brief=brief)
