"""The text of a URScript program: its statements, and its lists of six numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import NamedTuple

from .parts import NUMBER

_COMMENT_OR_TEXT = re.compile(r'"[^"\n]*"|#[^\n]*')
_ELEMENT = re.compile(rf"\s*(?:(?P<deg>d2r\s*\(\s*)?(?P<value>{NUMBER})(?(deg)\s*\)))\s*")
_POSE = re.compile(r"(?<!\w)p\s*\Z")
_PAIRS = {")": "(", "]": "["}


class Value(NamedTuple):
    """Six numbers: whether they are a pose (else joints), where they begin and end, where each is, and
    whether it is in degrees."""

    pose: bool
    start: int
    end: int
    spans: list[tuple[int, int]]
    degrees: list[bool]

    def numbers(self, text: str) -> list[float]:
        """Metres and radians."""
        found = [float(text[start:end]) for start, end in self.spans]
        return [math.radians(value) if deg else value for value, deg in zip(found, self.degrees, strict=True)]


def without_comments(text: str) -> str:
    return _COMMENT_OR_TEXT.sub(lambda found: found[0] if found[0][0] == '"' else " " * len(found[0]), text)


def without_strings(text: str) -> str:
    """Without comments too."""
    return _COMMENT_OR_TEXT.sub(lambda found: " " * len(found[0]), text)


def statements_of(bare: str) -> Iterator[tuple[int, int]]:
    """The places of the statements, each a line, or several where a bracket is open at its end."""
    start, depth = 0, 0
    for line in re.finditer(r"[^\n]*(?:\n|\Z)", bare):
        depth += sum(line[0].count(letter) for letter in "([") - sum(line[0].count(letter) for letter in ")]")
        if depth <= 0 or line.end() == len(bare):
            statement = bare[start : line.end()]
            if statement.strip():
                yield line.end() - len(statement.lstrip()), line.end()
            start, depth = line.end(), 0


def value_at(bare: str, start: int, end: int) -> Value | None:
    """The value that a text is, `p[…]` or `[…]`; None where it is not six numbers."""
    opening = bare.index("[", start)
    begin, spans, degrees = opening + 1, [], []
    for part in bare[opening + 1 : end - 1].split(","):
        found = _ELEMENT.fullmatch(part)
        if found is None:
            return None
        spans.append((begin + found.start("value"), begin + found.end("value")))
        degrees.append(found["deg"] is not None)
        begin += len(part) + 1
    return Value(bare[start] == "p", start, end, spans, degrees) if len(spans) == 6 else None


def urscript_literals(text: str) -> list[tuple[int, int]]:
    """The places of all `p[…]`, and of all lists of six numbers."""
    bare, opened, found = without_strings(text), [], []
    for bracket in re.finditer(r"[\[\]()]", bare):
        if bracket[0] in "[(":
            opened.append(bracket)
        elif opened and opened[-1][0] == _PAIRS[bracket[0]]:
            start = opened.pop().start()
            pose = _POSE.search(bare, max(0, start - 9), start)
            if bracket[0] == "]" and pose is not None:
                found.append((pose.start(), bracket.end()))
            elif bracket[0] == "]" and value_at(bare, start, bracket.end()) is not None:
                found.append((start, bracket.end()))
    return found
