"""Folders that are written whole or not at all, and never over what zerobeam did not write there."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from ...interruption import interruptible, uninterrupted
from ...model.errors import BadInput, NotWritten
from ...model.files.whole_file import WRITER, is_part, remove_abandoned, writer
from ...model.parsing.confinement import require_within
from ...words.spreadsheet import Row, csv_text
from ..style.blocks import Page
from ..style.canvas import Picture
from .html import PageKind, Turnable, html
from .pdf import pdf

# What file managers leave behind in any folder that was looked at.
LITTER = {".DS_Store", "Thumbs.db", "desktop.ini"}
_UNFINISHED = re.compile(rf"\.zerobeam-new-{WRITER}")
_TAKEN_AWAY = re.compile(rf"\.zerobeam-taken-{WRITER}")

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
    was there as it was. Raises BadInput where `folder` is a file or not ours, NotWritten where it cannot be
    written.
    """
    target = Path(os.path.realpath(folder))
    check_target(target, kind)
    with uninterrupted():
        made = _make_parents(target.parent, kind)
        remove_abandoned(target.parent, _TAKEN_AWAY, remove=_put_back)
        remove_abandoned(target.parent, _UNFINISHED, remove=shutil.rmtree)
        try:
            new = _folder_beside(target, "new", kind)
            try:
                with interruptible():
                    filled = fill(new)
                _swap(new, target, kind)
            except OSError as error:
                raise _cannot_write(target, kind, error) from error
            finally:
                shutil.rmtree(new, ignore_errors=True)
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
        names = names_in(folder)
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


def names_in(folder: Path) -> set[str]:
    """What is in a folder but for what file managers and killed processes leave there."""
    return {entry.name for entry in folder.iterdir() if not is_part(entry.name)} - LITTER


def _is_ours(folder: Path, kind: Kind) -> bool:
    try:
        content = json.loads((folder / kind.mark).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
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
        prefix = f".zerobeam-{purpose}-{writer()}-"
        beside = Path(tempfile.mkdtemp(prefix=prefix, dir=target.parent))
        # mkdtemp's folder is private; ours gets the rights that any new folder would have.
        mask = os.umask(0)
        os.umask(mask)
        beside.chmod(0o777 & ~mask)
    except OSError as error:
        raise _cannot_write(target.parent, kind, error) from error
    return beside


def _put_back(left: Path) -> None:
    """What a process that was killed amid `_swap` had taken away: back in its place, unless that is taken."""
    for before in left.iterdir():
        target = left.parent / before.name
        if not target.exists():
            before.rename(target)
    shutil.rmtree(left)


def _swap(new: Path, target: Path, kind: Kind) -> None:
    """Put `new` in the place of `target`; what was there goes last, and comes back if the rename fails."""
    try:
        if not target.exists():
            new.rename(target)
            return
        old = _folder_beside(target, "taken", kind) / target.name
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


def _cannot_write(where: Path, kind: Kind, error: OSError) -> NotWritten:
    return NotWritten(
        f"the {kind.noun} cannot be written to {str(where)!r}",
        found=error.strerror or str(error),
        remedy="name a folder that may be written to",
    )


def write_page(
    folder: Path,
    stem: str,
    page: Page,
    pictures: Mapping[str, Picture],
    kind: PageKind,
    *,
    answer: tuple[str, str],
    tables: Mapping[str, Iterable[Row]] | None = None,
    turnable: Turnable | None = None,
) -> list[str]:
    """Write `stem`.html and .pdf, `answer` (file name and text), the tables by file name and the figures into
    an empty folder; returns the names of the figures. The HTML of a report carries its answer."""
    name, text = answer
    (folder / name).write_text(text, encoding="utf-8")
    for file, rows in (tables or {}).items():
        (folder / file).write_text(csv_text(rows), encoding="utf-8")
    attached = text if kind == "report" else ""
    with ThreadPoolExecutor(1) as beside:  # typst leaves the interpreter to others
        document = beside.submit(pdf, page, pictures)
        text = html(page, pictures, kind, attached, turnable)
        (folder / f"{stem}.html").write_text(text, encoding="utf-8")
        (folder / f"{stem}.pdf").write_bytes(document.result())
    (folder / "figures").mkdir()
    for name, picture in pictures.items():
        (folder / "figures" / f"{name}.svg").write_text(picture.svg, encoding="utf-8")
    return [f"{name}.svg" for name in pictures]
