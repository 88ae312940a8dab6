"""The text of statements: numbers, words, arguments, each with its place."""

from __future__ import annotations

import re
from collections.abc import Iterator

Span = tuple[int, int]
NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"


def numbers_in(text: str, start: int = 0) -> list[Span]:
    """The places of all numbers of a text."""
    return [
        (start + match.start(), start + match.end()) for match in re.finditer(rf"(?<![\w.]){NUMBER}", text)
    ]


def values_in(text: str) -> list[float]:
    """All numbers of a text."""
    return [float(text[start:end]) for start, end in numbers_in(text)]


def words_in(text: str) -> list[str]:
    """Names and numbers of a text, whether they are right or not."""
    return re.findall(r"[\w.]+(?:(?<=[eE])[-+]\d+)?", text)


def split_arguments(text: str, between: str = ",") -> Iterator[tuple[int, str]]:
    """The parts between commas (or the letters `between`) in no brackets, each with its place in the text."""
    depth, begin = 0, 0
    for at, letter in enumerate(text):
        depth += (letter in "([{") - (letter in ")]}")
        if letter in between and depth <= 0:
            yield begin, text[begin:at]
            begin, depth = at + 1, 0
    yield begin, text[begin:]


def arguments_of(text: str, start: int = 0) -> list[tuple[int, str]]:
    """The arguments of a call whose text begins behind its bracket at `start`, without blanks around, each
    with its place; those of a bracket that is not closed up to the end."""
    depth, end = 1, len(text)
    for at in range(start, len(text)):
        depth += (text[at] in "([{") - (text[at] in ")]}")
        if depth == 0:
            end = at
            break
    parts = split_arguments(text[start:end])
    return [(start + at + len(part) - len(part.lstrip()), part.strip()) for at, part in parts]
