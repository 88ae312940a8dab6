"""In which line a position of a text is."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from itertools import accumulate


def line_numbers(text: str) -> Callable[[int], int]:
    """A function that gives the line, from 1, of a position in the text; the text is looked through once.

    Examples
    --------
    >>> line_of = line_numbers("a\\nb\\n")
    >>> line_of(0), line_of(1), line_of(2), line_of(4)
    (1, 1, 2, 3)
    """
    starts = [0, *accumulate(len(line) for line in text.split("\n"))]
    starts = [start + k for k, start in enumerate(starts[:-1])]
    return lambda position: bisect_right(starts, position)
