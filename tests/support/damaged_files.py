"""Text files as bad media and hasty editors leave them: cut off, bytes changed, lines swapped, no numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np


def damaged(text: str, count: int, seed: int = 0) -> Iterator[str]:
    """So many damaged copies of a text, each damaged in one way; those that are as before are left out."""
    rng = np.random.default_rng(seed)
    numbers = [match.span() for match in re.finditer(r"[-+]?\d+(?:\.\d+)?", text)]
    lines = text.split("\n")
    made = 0
    while made < count:
        kind = made % 4
        if kind == 0:
            other = text[: rng.integers(1, len(text))]
        elif kind == 1:
            letters = list(text)
            for at in rng.integers(0, len(text), rng.integers(1, 4)):
                letters[at] = chr(rng.integers(32, 127))
            other = "".join(letters)
        elif kind == 2:
            first, second = rng.integers(0, len(lines), 2)
            swapped = list(lines)
            swapped[first], swapped[second] = swapped[second], swapped[first]
            other = "\n".join(swapped)
        else:
            start, end = numbers[rng.integers(len(numbers))]
            other = text[:start] + text[end:]
        if other != text:
            made += 1
            yield other
