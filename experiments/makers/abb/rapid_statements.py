"""A RAPID module as a row of statements, and its literals of positions."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from lark import Token, Tree

from ..maker import blanked
from ..program_parts import understood
from .rapid_points import REMARK

_TOKEN = re.compile(r'"[^"\n]*"|[^\W\d]\w*|:=|\S')
# What backups begin with.
_HEAD = re.compile(r"\s*(?:%%%\s*(?:VERSION\s*:\s*\d+)?\s*(?:LANGUAGE\s*:\s*\w+)?\s*%%%)?", re.IGNORECASE)
# Words that are a statement, and those at which the statements that they begin end.
_ALONE = {
    *("ELSE", "UNDO", "BACKWARD", "ENDMODULE", "ENDRECORD"),
    *("ENDPROC", "ENDFUNC", "ENDTRAP", "ENDIF", "ENDWHILE", "ENDFOR", "ENDTEST"),
}
_ENDS = {
    "IF": ("THEN", ";"),
    "ELSEIF": ("THEN", ";"),
    "WHILE": ("DO", ";"),
    "FOR": ("DO", ";"),
    "CASE": (":", ";"),
    "DEFAULT": (":", ";"),
    "PROC": (")", ";"),
    "FUNC": (")", ";"),
    "RECORD": ("ENDRECORD",),
}
_OPENING = {"module": "ENDMODULE", "if": "ENDIF", "while": "ENDWHILE", "for": "ENDFOR", "test": "ENDTEST"}
_WITHIN = {
    "elseif": ("ENDIF",),
    "else": ("ENDIF",),
    "case": ("ENDTEST",),
    "error": ("ENDPROC", "ENDFUNC", "ENDTRAP"),
}
# Numbers within the brackets of a pose, a jointtarget, a robtarget.
_SHAPES = ((3, 4), (6, 6), (3, 4, 4, 6))

Shape = int | tuple["Shape", ...] | None


class RapidStatement(NamedTuple):
    """From `start` to `end` of the text; `tree` is its derivation, None where the grammar has none."""

    start: int
    end: int
    tree: Tree[Token] | None


def statements(bare: str) -> Iterator[RapidStatement]:
    """All statements of a program without comments; nothing stands between them but white space."""
    head = _HEAD.match(bare)
    tokens = list(_TOKEN.finditer(bare, 0 if head is None else head.end()))
    words = [token[0].upper() for token in tokens]
    i = 0
    while i < len(tokens):
        last = _last(words, i)
        start, end = tokens[i].start(), tokens[last].end()
        yield RapidStatement(start, end, understood("abb/rapid", "statement", bare, start, end))
        i = last + 1


def _last(words: Sequence[str], i: int) -> int:
    """Which word is the last of the statement that begins with word `i`."""

    def first_of(ends: Sequence[str], start: int) -> int:
        ends_at = (k for k in range(start, len(words)) if words[k] in ends)
        return next(ends_at, len(words) - 1)

    def bracketed(start: int) -> int:
        return first_of((")", ";"), start) if words[start : start + 1] == ["("] else start - 1

    k = min(i + (words[i] in ("LOCAL", "TASK")), len(words) - 1)
    word = words[k]
    if word in _ALONE:
        return k
    if word == "ERROR":
        return bracketed(k + 1)
    if word in ("MODULE", "TRAP"):
        return bracketed(min(k + 2, len(words)))
    if word == "TEST":
        return max(k, first_of(("CASE", "DEFAULT", "ENDTEST"), k) - 1)
    if words[i + 1 : i + 2] == [":"]:
        return i + 1
    return first_of(_ENDS.get(word, (";",)), k)


class Blocks:
    """The blocks that are open between two statements, as the words that end them, the outermost first."""

    def __init__(self) -> None:
        self.open: list[str] = []
        self._modules = self._routines = 0

    def allow(self, tree: Tree[Token]) -> bool:
        """Whether a statement may be here; it opens or closes what it does."""
        kind, last = str(tree.data), self.open[-1] if self.open else ""
        in_routine = len(self.open) > 1
        if kind == "module":
            self._modules += 1
            right = self._modules == 1
        elif kind == "end":
            word = str(tree.children[0]).upper()
            right = last == word
            if word in self.open:
                del self.open[len(self.open) - 1 - self.open[::-1].index(word) :]
        elif kind in ("routine", "record", "alias"):
            self._routines += kind == "routine"
            right = last == "ENDMODULE"
        elif kind == "data":
            right = in_routine or (last == "ENDMODULE" and not self._routines)
        else:
            right = in_routine and last in _WITHIN.get(kind, (last,))
        if kind in _OPENING:
            self.open.append(_OPENING[kind])
        elif kind == "routine":
            self.open.append(f"END{routine_head(tree)[0]}")
        return right


def tokens(tree: Tree[Token]) -> list[Token]:
    """The tokens that are children of a tree."""
    return [child for child in tree.children if isinstance(child, Token)]


def trees(tree: Tree[Token], *kinds: str) -> list[Tree[Token]]:
    """The trees that are children of a tree, of some kinds or of all."""
    subtrees = [child for child in tree.children if isinstance(child, Tree)]
    return [each for each in subtrees if not kinds or each.data in kinds]


def routine_head(tree: Tree[Token]) -> tuple[str, str | None, Token]:
    """PROC, FUNC or TRAP, the type of what a FUNC returns, and the name."""
    word, *names = (child for child in tokens(tree) if child.type != "LOCAL")
    return word.upper(), str(names[0]) if len(names) > 1 else None, names[-1]


def rapid_literals(text: str) -> list[tuple[int, int]]:
    """The places of all values with the shape of a pose, a jointtarget or a robtarget outside comments and
    strings, whatever statement they are in."""
    literals, open_brackets = [], [_Bracket("", 0)]
    bare = blanked(text, REMARK)
    for mark in re.finditer(r"[\[\](){},;]", bare):
        sign, inner = mark[0], open_brackets[-1]
        if sign in "[({":
            open_brackets.append(_Bracket(sign, mark.start()))
        elif sign == ";":
            open_brackets = [_Bracket("", 0)]
        elif sign == ",":
            inner.commas += 1
        elif len(open_brackets) > 1:
            open_brackets.pop()
            if sign == "]":
                shape = inner.shape()
                open_brackets[-1].parts.append(shape)
                if shape in _SHAPES:
                    literals.append((inner.start, mark.end()))
    return sorted(literals)


class _Bracket:
    def __init__(self, sign: str, start: int) -> None:
        self.sign, self.start, self.commas = sign, start, 0
        self.parts: list[Shape] = []

    def shape(self) -> Shape:
        if not self.parts:
            return self.commas + 1
        return tuple(self.parts) if len(self.parts) == self.commas + 1 else None
