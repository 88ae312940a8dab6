"""Versions of files: who replaces a file says which version it was made from, so that no work is lost; and
what is kept of a file as long as it is the same."""

from __future__ import annotations

import hashlib
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import is_dataclass
from pathlib import Path
from typing import Annotated, Any, Generic, NamedTuple, TypeVar

from ...model.errors import BadInput, NotWritten
from ...model.records import it, record, to_json
from .requests import Content, ErrorAnswer, Precondition

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


MOST_HASHED = 16 * 10**6  # bytes; a larger file has its version by size and time
_DIGITS = 32


@record(kw_only=True)
class Versioned:
    """What is made of one file."""

    version: Annotated[str, it("of the file: what If-Match takes when it is replaced")]


@record(kw_only=True)
class VersionOfFile(Versioned):
    """A file of the folder as it was read or written, and what more is said of it."""

    file: str


@record(kw_only=True)
class WrittenFile(VersionOfFile):
    """A file that was written as it was sent."""

    bytes: int


@record(kw_only=True)
class CurrentFile(Versioned):
    """What a file holds now."""

    content: Annotated[
        Content | str | None,
        it("what GET answers, the text of a file that is sent as it is; null where it is neither"),
    ]


@record(kw_only=True)
class ConflictAnswer(ErrorAnswer):
    """A refusal: the file is not the one that was to be replaced."""

    current: Annotated[CurrentFile | None, it("null where there is no file any more")]


class Conflict(BadInput):
    """A file is not the version that was to be replaced; `current` is what is there."""

    current: CurrentFile | None = None


def version_of_bytes(content: bytes) -> str:
    """The version of a file of this content, `MOST_HASHED` at the most."""
    return version_of_sum(hashlib.sha256(content).hexdigest())


def version_of_sum(sha256: str) -> str:
    """The version of a file of this SHA-256."""
    return sha256[:_DIGITS]


@kept(8000)
def version_of(path: Path) -> str:
    """The version of a file; OSError where it cannot be read."""
    facts = path.stat()
    if facts.st_size > MOST_HASHED:
        return f"{facts.st_size:x}-{facts.st_mtime_ns:x}-{facts.st_ino:x}"[:_DIGITS]
    return version_of_bytes(path.read_bytes())


def etag(version: str) -> str:
    """A version as the header ETag has it."""
    return f'"{version}"'


def matches(header: str, version: str) -> bool:
    """Whether If-Match or If-None-Match names this version."""
    names = [name.strip().removeprefix("W/").strip('"') for name in header.split(",")]
    return "*" in names or version in names


@contextmanager
def replacing(path: Path, precondition: Precondition, current: Callable[[], object]) -> Iterator[bool]:
    """Within, the file may be written, in a folder that is made where there is none: whether it takes the
    place of one that is there.

    Conflict where it is not the one that `precondition` states, also where a new file's name is taken
    meanwhile. `current` reads what is there.
    """
    there = path.exists()
    if there and not path.is_file():
        raise BadInput("there is a folder of this name", file=path, remedy="choose another name")
    match, none_match = precondition.match, precondition.none_match
    if match is not None and not there:
        raise Conflict(
            "the file is no longer there",
            found=path.name,
            remedy="save under a new name, or as a new file of this name",
            file=path,
        )
    if there and (match is None or none_match is not None or not matches(match, version_of.make(path))):
        raise _conflict(path, changed=match is not None, current=current)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise NotWritten(f"the folder cannot be made: {error.strerror}", file=path.parent) from None
    try:
        yield there
    except BadInput:
        if not there and path.exists():
            raise _conflict(path, changed=False, current=current) from None
        raise


def _conflict(path: Path, *, changed: bool, current: Callable[[], object]) -> Conflict:
    error = Conflict(
        "the file has changed since it was read" if changed else "the file exists already",
        found=path.name,
        allowed="the version that is there, in If-Match" if changed else "a name that is free, or If-Match",
        remedy="look at both, and keep one of them or choose another name",
        file=path,
    )
    version = version_of.make(path)
    try:
        content = current()
    except BadInput:
        content = None
    plain: Any = to_json(content) if is_dataclass(content) else content
    error.current = CurrentFile(version=version, content=plain)
    return error
