"""Folders that are written whole or not at all, and never over what zerobeam did not write there."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import socket
import tempfile
import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from ...interruption import interruptible, uninterrupted
from ...model.errors import BadInput
from ...model.paths.confinement import require_within

# What file managers leave behind in any folder that was looked at.
LITTER = {".DS_Store", "Thumbs.db", "desktop.ini"}
# A folder that is not finished: where and by which process it is written; without, of earlier versions.
_UNFINISHED = re.compile(r"\.zerobeam-new-(?:(?P<here>[0-9a-f]{8})-(?P<process>[0-9]+)-)?[a-z0-9_]{8}")
_DAY_S = 24 * 3600

Made = TypeVar("Made")


@dataclass(frozen=True)
class Kind:
    """A kind of folder: `names` is all that may be in it, `mark` the JSON file that states `schema`."""

    noun: str
    names: frozenset[str]
    mark: str
    schema: str


def write_folder(folder: Path | str, kind: Kind, fill: Callable[[Path], Made]) -> Made:
    """Let `fill` write into an empty folder, then give that the place of `folder`; returns what `fill` does.

    Everything is written to a folder next to it and renamed at the end, so that a fault leaves what
    was there as it was. Raises BadInput where `folder` is a file, is not ours, or cannot be written.
    """
    target = Path(os.path.realpath(folder))
    check_target(target, kind)
    with uninterrupted():
        made = _make_parents(target.parent, kind)
        _sweep(target.parent)
        try:
            aside = _folder_beside(target, "new", kind)
            try:
                with interruptible():
                    filled = fill(aside)
                _swap(aside, target, kind)
            except OSError as error:
                raise _cannot_write(target, kind, error) from error
            finally:
                shutil.rmtree(aside, ignore_errors=True)
        except BaseException:
            for parent in made:
                _remove_if_empty(parent)
            raise
    return filled


def check_target(folder: Path | str, kind: Kind) -> None:
    """Raise BadInput unless this kind may be written to `folder`: absent, empty, or one of ours."""
    folder = Path(folder)
    require_within(folder)
    allowed = f"a folder that does not exist, is empty, or holds a {kind.noun} of zerobeam and nothing else"
    if folder.is_dir():
        names = {entry.name for entry in folder.iterdir()} - LITTER
        foreign = sorted(names - kind.names)
        if foreign:
            listed = ", ".join(repr(name) for name in foreign[:3]) + (", …" if len(foreign) > 3 else "")
            raise BadInput(
                f"the {kind.noun}'s folder {str(folder)!r} holds other things, which would be lost",
                found=listed,
                allowed=allowed,
                remedy="name another folder, or move them away",
            )
        if names and not _is_ours(folder, kind):
            raise BadInput(
                f"the {kind.noun}'s folder {str(folder)!r} was not written by zerobeam",
                found=f"no {kind.mark} of schema {kind.schema}",
                allowed=allowed,
                remedy="name another folder, or empty this one",
            )
    elif folder.exists() or folder.is_symlink():
        raise BadInput(
            f"the {kind.noun}'s folder {str(folder)!r} is a file",
            allowed=allowed,
            remedy="name another folder",
        )


def _is_ours(folder: Path, kind: Kind) -> bool:
    try:
        content = json.loads((folder / kind.mark).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and content.get("schema") == kind.schema


def _make_parents(parent: Path, kind: Kind) -> list[Path]:
    """Make the folders above; those that were made, the innermost first."""
    missing = [folder for folder in (parent, *parent.parents) if not folder.exists()]
    try:
        parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        for folder in missing:
            _remove_if_empty(folder)
        raise _cannot_write(parent, kind, error) from error
    return missing


def _folder_beside(target: Path, purpose: str, kind: Kind) -> Path:
    try:
        prefix = f".zerobeam-{purpose}-{_here()}-{os.getpid()}-"
        beside = Path(tempfile.mkdtemp(prefix=prefix, dir=target.parent))
        # mkdtemp's folder is private; ours gets the rights that any new folder would have.
        mask = os.umask(0)
        os.umask(mask)
        beside.chmod(0o777 & ~mask)
    except OSError as error:
        raise _cannot_write(target.parent, kind, error) from error
    return beside


def _here() -> str:
    """This computer, in the names of folders that several may write beside."""
    return f"{zlib.crc32(socket.gethostname().encode()):08x}"


def _sweep(parent: Path) -> None:
    """Remove what was being written here by processes that were killed, or more than a day ago."""
    with contextlib.suppress(OSError):  # whoever may not look here may not write here either
        for entry in os.scandir(parent):
            ours = _UNFINISHED.fullmatch(entry.name)
            if ours is None or not entry.is_dir(follow_symlinks=False):
                continue
            old = time.time() - entry.stat(follow_symlinks=False).st_mtime > _DAY_S
            if old or (ours["here"] == _here() and _has_ended(int(ours["process"]))):
                shutil.rmtree(entry.path, ignore_errors=True)


def _has_ended(process: int) -> bool:
    if os.name == "nt":  # where os.kill ends a process, whatever the signal
        return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    except (PermissionError, OverflowError):
        pass
    return False


def _swap(new: Path, target: Path, kind: Kind) -> None:
    """Put `new` in the place of `target`; what was there goes last, and comes back if the rename fails."""
    try:
        if not target.exists():
            new.rename(target)
            return
        old = _folder_beside(target, "old", kind) / "before"
        try:
            target.rename(old)
            new.rename(target)
        except BaseException:
            if old.exists():
                old.rename(target)
            old.parent.rmdir()
            raise
        shutil.rmtree(old.parent, ignore_errors=True)
    except OSError as error:
        raise _cannot_write(target, kind, error) from error


def _remove_if_empty(folder: Path) -> None:
    with contextlib.suppress(OSError):
        folder.rmdir()


def _cannot_write(where: Path, kind: Kind, error: OSError) -> BadInput:
    return BadInput(
        f"the {kind.noun} cannot be written to {str(where)!r}",
        found=error.strerror or str(error),
        remedy="name a folder that may be written to",
    )
