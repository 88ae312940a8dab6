"""What was made of files, kept until they change."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

_FRESH_NS = 10**8  # a file that was written since may be written again at the same time of its clock

Value = TypeVar("Value")


class _State(NamedTuple):
    """A file as it is, and what is asked beside it."""

    path: str
    inode: int
    modified_ns: int
    changed_ns: int
    size: int
    beside: tuple[object, ...]


class Kept(Generic[Value]):
    """A function of a file, and of what else is asked, that is called again once the file has changed; the
    oldest answer is forgotten."""

    def __init__(self, most: int, make: Callable[..., Value]) -> None:
        self.make = make
        self._most = most
        self._made: OrderedDict[_State, Value] = OrderedDict()

    def __call__(self, path: Path, *beside: object) -> Value:
        """What is made of the file as it is now."""
        key = _state(path, *beside)
        if key not in self._made:
            made = self.make(path, *beside)
            if abs(time.time_ns() - key.modified_ns) < _FRESH_NS:
                return made
            self._made[key] = made
            while len(self._made) > self._most:
                self._made.popitem(last=False)
        self._made.move_to_end(key)
        return self._made[key]

    def knows(self, path: Path) -> bool:
        """Whether it was made of the file as it is now."""
        return _state(path) in self._made


def _state(path: Path, *beside: object) -> _State:
    facts = path.stat()
    return _State(str(path), facts.st_ino, facts.st_mtime_ns, facts.st_ctime_ns, facts.st_size, beside)


def kept(most: int) -> Callable[[Callable[..., Value]], Kept[Value]]:
    """Keep what a function makes of the last so many files."""
    return lambda make: Kept(most, make)
