"""Programs of which a statement is a line: positions, motions to them, tools, frames, what moves no arm.

A maker's grammar derives a line, by its rule `statement`, to one tree:

- `position`: a NAME and its `joints` or `pose`; `entry`: a NAME and `values`, which are joints or a pose by
  the last line `joints_follow` or `poses_follow`, and refused behind `nothing_follows`. Of a pose a
  CONFIGURATION is what tells the branches of the arm apart, in the language's own words; `configuration` is a
  line that states it for entries below.
- `motion`, `linear`: each `at` in it is a NAME, `joints` or a `pose`, and the arm goes there by joints or in
  a straight line (or an arc, if the language takes the orientation of every pose in it). With `only_joints`
  or `only_pose` in it a NAME must be such a position; that says it of `numbers`, a position whose declaration
  does not. A `tool` or `frame` in a motion is of this motion alone, as is a CONFIGURATION in `reached_as`.
- `tool`, `frame`: a WORD or a `pose`, from here on. `in_base`, `in_frame`: framed positions below are in the
  base frame, or in the frame that was set. In a position a `frame` is its own. `definition`: a tool or frame
  by a WORD, its `pose` in another one, the second WORD, defined before.
- `call`: a WORD, the routine. `routine`: a WORD, its begin.
- `join`: it is reached from elsewhere too, or leads there. `plain`: it moves no arm, and changes no position.

Numbers of joints and poses are VALUE. A NAME anywhere else is of what the program changes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from string import ascii_lowercase, ascii_uppercase
from typing import Any

from lark import Lark, TextSlice, Token, Tree
from lark.exceptions import UnexpectedInput

from ...model.files.robot_file import Vendor
from ...model.kinematics.robot import PendantUnit
from ..positions.position import BackupReading, JointLanguage
from .maker import blanked

NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
_CAPITALS = str.maketrans(ascii_lowercase, ascii_uppercase)
Statement = tuple[int, int, Tree[Token] | None]  # begin, end and derivation
FOLLOW = {"joints_follow": True, "poses_follow": False, "nothing_follows": None}
SIX_WITH_COMMAS = re.compile(rf"(?<![\w.])(?<![-+]){NUMBER}(?:\s*,\s*{NUMBER}){{5,}}(?![\w.])")
SIX_WITH_BLANKS = re.compile(rf"(?<![\w.])(?<![-+]){NUMBER}(?:[ \t]+{NUMBER}){{5,}}(?![\w.])")


@cache
def _parser(language: str, rule: str) -> Lark:
    text = (Path(__file__).parent / f"{language}.lark").read_text("utf-8")
    return Lark(text, parser="lalr", start=rule, propagate_positions=True, maybe_placeholders=False)


def span(part: Token | Tree[Token]) -> tuple[int, int]:
    """Start and end in the text of a part of a statement that is not empty."""
    if isinstance(part, Tree):
        return part.meta.start_pos, part.meta.end_pos
    assert part.start_pos is not None
    return part.start_pos, part.start_pos + len(part)


def understood(language: str, rule: str, text: str, start: int, end: int) -> Tree[Token] | None:
    """The derivation by `rule` of the text from `start` to `end`, with places in the whole text; None where
    the grammar has none."""
    # Lark counts the lines before a slice at each call: it gets no more than the character before.
    before = max(start - 1, 0)
    try:
        tree = _parser(language, rule).parse(TextSlice(text[before:end], start - before, end - before))
    except UnexpectedInput:
        return None
    placed: list[Any] = []
    for part in tree.iter_subtrees():
        placed += [part.meta, *(each for each in part.children if isinstance(each, Token))]
    for part_or_token in placed:
        if getattr(part_or_token, "start_pos", None) is not None:
            part_or_token.start_pos += before
        if getattr(part_or_token, "end_pos", None) is not None:
            part_or_token.end_pos += before
    return tree


def capitals(text: str) -> str:
    """The text in capitals, of the same length whatever its letters."""
    return text.translate(_CAPITALS)


@dataclass(frozen=True)
class LineLanguage:
    """A language of such programs.

    `grammar` is the file of its grammar; `remark` a pattern of its comments. Joints are in `unit`, written to
    so many decimals; `saved_decimals` are those that a controller saves, where they are fewer. `literal` has
    all that looks like joints or a pose. An `indented` language has its blocks by indentation; behind a line
    that `opens` a block there is a brace. Where more than lines of code has positions, `read` has all
    statements, and `positions` the spans that `literal` has else. `derives` says what the grammar cannot of a
    line's tree.
    """

    name: str
    grammar: str
    remark: str
    unit: PendantUnit = "deg"
    joint_decimals: int = 6
    literal: re.Pattern[str] = SIX_WITH_COMMAS
    case_sensitive: bool = False
    indented: bool = False
    opens: re.Pattern[str] | None = None
    read: Callable[[str], Iterator[Statement]] | None = None
    positions: Callable[[str], list[tuple[int, int]]] | None = None
    saved_decimals: int | None = None
    derives: Callable[[Tree[Token]], bool] | None = None

    def literals(self, text: str) -> list[tuple[int, int]]:
        """The spans of all that looks like joints or a pose."""
        if self.positions is not None:
            return self.positions(text)
        return [match.span() for match in self.literal.finditer(blanked(text, self.remark))]

    def statements(self, text: str) -> Iterator[Statement]:
        """Each line that is not blank."""
        if self.read is not None:
            yield from self.read(text)
            return
        code = blanked(text, self.remark, strings=False)
        if not self.case_sensitive:  # the grammar is in capitals
            code = capitals(code)
        depth, routine, behind_head = 0, False, False  # in a routine; the line before is its head
        opened = False  # the line before opens a block
        for line in re.finditer(r"[^\r\n]+", code):
            if line[0].strip():
                tree = understood(self.grammar, "statement", code, *line.span())
                inner = None if tree is None else tree.children[0]
                if not isinstance(inner, Tree) or (self.derives is not None and not self.derives(inner)):
                    inner = None
                indent = len(line[0]) - len(line[0].lstrip())
                if self.indented and indent != depth:
                    main = routine and not indent
                    if main or not behind_head:
                        yield line.start(), line.start(), Tree("main" if main else "join", [])
                    depth, routine = indent, routine and not main
                behind_head = inner is not None and inner.data == "routine"
                if self.opens is not None:
                    if opened and not line[0].lstrip().startswith("{"):
                        inner = None
                    opened = bool(self.opens.search(line[0])) and not line[0].rstrip().endswith("{")
                if (
                    self.indented and behind_head and indent
                ):  # a routine in a block: when it is there is not known
                    inner, behind_head = None, False
                routine |= behind_head
                yield line.start(), line.end(), inner


def tokens(tree: Tree[Token], kind: str) -> list[Token]:
    return [token for token in tree.scan_values(lambda token: isinstance(token, Token)) if token.type == kind]


def is_a_pose(tree: Tree[Token], joints_follow: bool | None) -> bool | None:
    """Whether a position is a pose; None where nothing in its line or above says it."""
    if tree.data == "entry":
        return not joints_follow
    return None if list(tree.find_data("numbers")) else bool(list(tree.find_data("pose")))


def joint_language(language: LineLanguage, vendor: Vendor) -> JointLanguage:
    """The language as `import` reads it."""

    def read(reading: BackupReading) -> None:
        for file in reading.files:
            spans = set()
            for begin, _, tree in language.statements(file.text):
                kinds = ("position", "entry", "at", "tool", "frame", "definition")
                for part in () if tree is None else reversed([*tree.iter_subtrees()]):
                    values = tokens(part, "VALUE") if part.data in kinds else []
                    if not values:
                        continue
                    places = [span(value) for value in values]
                    spans.add((places[0][0], places[-1][1]))
                    if part.data in ("tool", "frame", "definition"):
                        continue
                    names = tokens(part, "NAME")
                    label = str(names[0]) if names else f"line {file.line(begin)}"
                    axes = None if is_a_pose(part, None) else range(len(places))
                    reading.add(file, begin, label, label, places, axes=axes)
            for begin, end in language.literals(file.text):
                if (begin, end) not in spans:
                    reading.unread(file, begin, "a position of the program is not understood")

    return JointLanguage(language.name, vendor, (), read, remark=language.remark, unit=language.unit)
