"""What was made of files, kept until they change."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

_FRESH_NS = 10**8  # a file that was written since may be written again at the same time of its clock

Value = TypeVar("Value")


class Kept:
    """What was made of files, until they change; the oldest is forgotten."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._made: OrderedDict[tuple[str, int, int, int, int], Any] = OrderedDict()

    def of(self, path: Path, make: Callable[[Path], Value]) -> Value:
        """What `make` makes of the file as it is now."""
        facts = path.stat()
        key = (str(path), facts.st_ino, facts.st_mtime_ns, facts.st_ctime_ns, facts.st_size)
        if key not in self._made:
            made = make(path)
            if abs(time.time_ns() - facts.st_mtime_ns) < _FRESH_NS:
                return made
            self._made[key] = made
            while len(self._made) > self._most:
                self._made.popitem(last=False)
        self._made.move_to_end(key)
        value: Value = self._made[key]
        return value
