"""The text of statements: numbers, words, arguments, each with its place."""

from __future__ import annotations

import re
from collections.abc import Iterator

Span = tuple[int, int]
Lines = list[tuple[int, str]]  # or arguments, each with its place
NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"


def lines_in(text: str, start: int = 0, end: int | None = None, line: str = r"[^\r\n]+") -> Lines:
    """The lines of a part of a text that are not empty, each with its place."""
    lines = re.compile(line).finditer(text, start, len(text) if end is None else end)
    return [(each.start(), each[0]) for each in lines]


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


def is_computed(text: str) -> bool:
    """Whether a list has names beside its numbers: one that is damaged has none, or numbers that are none."""
    words = words_in(text)
    numbers = [word for word in words if not re.match(r"[^\W\d]", word)]
    return len(numbers) < len(words) and all(re.fullmatch(NUMBER, word) for word in numbers)


def split_arguments(text: str, between: str = ",") -> Iterator[tuple[int, str]]:
    """The parts between commas (or the letters `between`) in no brackets, each with its place in the text."""
    depth, begin = 0, 0
    for at, letter in enumerate(text):
        depth += (letter in "([{") - (letter in ")]}")
        if letter in between and depth <= 0:
            yield begin, text[begin:at]
            begin, depth = at + 1, 0
    yield begin, text[begin:]


def parts_of(text: str, start: int = 0, end: int | None = None, between: str = ",") -> Lines:
    """Those parts without blanks around, each with its place."""
    parts = split_arguments(text[start:end], between)
    return [(start + at + len(part) - len(part.lstrip()), part.strip()) for at, part in parts]


def arguments_of(text: str, start: int = 0) -> Lines:
    """The arguments of a call whose text begins behind its bracket at `start`, without blanks around, each
    with its place; those of a bracket that is not closed up to the end."""
    depth, end = 1, len(text)
    for at in range(start, len(text)):
        depth += (text[at] in "([{") - (text[at] in ")]}")
        if depth == 0:
            end = at
            break
    return parts_of(text, start, end)


def pieces(
    pattern: re.Pattern[str], text: str, start: int = 0, end: int | None = None
) -> list[tuple[re.Match[str], int]]:
    """Where a pattern is in a part of a text, each with the end of what belongs to it: where the next is."""
    end = len(text) if end is None else end
    matches = list(pattern.finditer(text, start, end))
    return [*zip(matches, [*(each.start() for each in matches[1:]), end], strict=False)]
