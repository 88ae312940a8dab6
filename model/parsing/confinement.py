"""The folder that a calculation or command of the app is confined to: each path is resolved here, or refused.

Names in a request, and in the words of a job, are resolved by `resolved`. What opens a file, whoever names
it, calls `require_within` first: it does nothing where nothing is confined.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from ..errors import BadInput

WITHIN = "ZEROBEAM_WITHIN"  # in the environment of a process: the folder that it is confined to
TOLERANCES = "ZEROBEAM_TOLERANCES"  # the file of the plant's tolerances
BUILT_IN = Path(__file__).parents[1] / "robots"  # the program's own files of robots
_LONGEST, _LONGEST_PART = (
    1000,
    255,
)  # letters of a name; bytes of a part of it: the most of usual file systems
_confined: ContextVar[Path | None] = ContextVar("_confined", default=None)


@contextmanager
def confined(folder: Path) -> Iterator[None]:
    """Within, `require_within` refuses what is not below `folder`."""
    token = _confined.set(folder)
    try:
        yield
    finally:
        _confined.reset(token)


def confining_folder() -> Path | None:
    """The folder that this calculation or process is confined to; None where it is not."""
    folder = os.environ.get(WITHIN)
    return _confined.get() or (None if folder is None else Path(folder))


def resolved(folder: Path, name: str, start: Path | None = None, *, hidden: bool = False) -> Path:
    """The path below `folder`, symbolic links followed, of a name relative to `start` (default: `folder`).

    The file need not exist. BadInput for a name that is no plain relative path, leads out of the folder or to
    the folder itself, or to something hidden (a part of its path begins with a dot), unless `hidden`.
    """
    parts = name.split("/")
    if (
        not name
        or len(name) > _LONGEST
        or any(len(part.encode("utf-8", "replace")) > _LONGEST_PART for part in parts)
        or any(letter in name for letter in "\0:\\")
        or os.path.isabs(name)
    ):
        raise _refused("this path cannot be used here", name)
    return _below(folder, (start or folder) / name, name, hidden)


def require_within(
    path: Path, *, hidden: bool = False, file: Path | None = None, line: int | None = None
) -> None:
    """BadInput for a path that this calculation or process may not use: as `resolved`; it may be absolute.

    `file` and `line` are where the path is named. The program's own files of robots may be used, and the file
    of tolerances that the environment names.
    """
    folder = confining_folder()
    if folder is None:
        return
    try:
        if path.parent != BUILT_IN and str(path) != os.environ.get(TOLERANCES):
            _below(Path(os.path.realpath(folder)), path, str(path), hidden)
    except BadInput as error:
        raise _refused(error.what, str(path), file, line) from None


def require_device(name: str) -> None:
    """BadInput, where this process is confined, for what is no serial port: a device below /dev, or COM1 …"""
    if confining_folder() is None or re.fullmatch(r"COM\d+", name):
        return
    if not os.path.realpath(name).startswith("/dev/"):
        raise BadInput(
            "this is no serial port", found=name[:200], allowed="a device below /dev, or COM1, COM2, …"
        )


def _below(folder: Path, path: Path, name: str, hidden: bool) -> Path:
    try:
        real = Path(os.path.realpath(path))
    except ValueError:  # half a letter, or NUL
        raise _refused("this path cannot be used here", name) from None
    if not real.is_relative_to(folder) or real == folder:
        raise _refused("this path is not below the app's folder", name)
    if not hidden and any(part.startswith(".") for part in real.relative_to(folder).parts):
        raise _refused("the app uses no hidden files", name)
    return real


def _refused(what: str, name: str, file: Path | None = None, line: int | None = None) -> BadInput:
    allowed = "a path below the app's folder, relative to it, no part of which begins with a dot"
    remedy = None if file is None else "put the file that it names into the folder, and name it from there"
    return BadInput(what, found=name[:200], allowed=allowed, remedy=remedy, file=file, line=line)


def free_path(path: Path) -> Path:
    """This path, or one like it with a number behind its name: nothing is there yet."""
    number, free = 1, path
    while free.exists() or free.is_symlink():
        number += 1
        free = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return free
