"""How many threads share the rows of a computation; the numbers are the same for any."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

_limit: int | None = None


def threads() -> int:
    """As many as there are cores, but one where processes work side by side."""
    return _limit or os.cpu_count() or 1


@contextmanager
def one_thread() -> Iterator[None]:
    """Within, rows are computed by one thread: the other cores have work of their own."""
    global _limit
    before, _limit = _limit, 1
    try:
        yield
    finally:
        _limit = before
