"""How many threads share the rows of a computation; the numbers are the same for any."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController

_WITH_BLAS = frozenset({"scipy.linalg", "scipy.optimize", "scipy.sparse", "scipy.special", "scipy.stats"})

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


def one_blas_thread() -> AbstractContextManager[object]:
    """Within, linear algebra is done by one thread: for small matrices more cost more than they give, and
    change the last bits. `threadpool_limits` does so too, but looks for the libraries each time (2 ms)."""
    limited: AbstractContextManager[object] = _libraries(_WITH_BLAS.intersection(sys.modules)).limit(
        limits=1, user_api="blas"
    )
    return limited


@cache
def _libraries(loaded: frozenset[str]) -> ThreadpoolController:
    """Those that are there once these modules are loaded."""
    return ThreadpoolController()
