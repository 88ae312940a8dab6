"""Notes of our own that a calculation gives, for the page instead of the terminal."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def noted() -> Iterator[list[str]]:
    """The notes of our own that are given within, for the page instead of the terminal."""
    notes: list[str] = []
    ours = __package__.partition(".")[0]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield notes
    notes += [str(note.message) for note in caught if note.category.__module__.startswith(ours)]
