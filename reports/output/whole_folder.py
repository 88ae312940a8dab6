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
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from ...interruption import interruptible, uninterrupted
from ...model.errors import BadInput, NotWritten
from ...model.files.whole_file import WRITER, is_part, remove_abandoned, writer
from ...model.parsing.confinement import require_within
from ...model.records import dumps
from ...words.wording import Row, csv_text
from ..style.blocks import Page
from ..style.canvas import Picture

if TYPE_CHECKING:
    from .html import PageKind, Turnable

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
    pages: str = ""
    shown_as: PageKind = "study"

    @classmethod
    def of_answer(
        cls, noun: str, mark: str, schema: str, *others: str, pages: str = "", shown_as: PageKind = "study"
    ) -> Kind:
        """The folder of an answer, with pages called as its JSON file is, or `pages`; `others` are its tables
        and what else may be in it."""
        pages = pages or Path(mark).stem
        names = frozenset({f"{pages}.html", f"{pages}.pdf", mark, "figures", *others})
        return cls(noun, names, mark, schema, pages, shown_as)


@dataclass(frozen=True)
class FolderContents:
    """What is written of an answer: itself as JSON, its page with pictures and scene, rows by the name of the
    CSV file, and `others`, which are written last."""

    answer: dict[str, Any]
    page: Page
    pictures: Iterable[Picture | None] = ()
    tables: Mapping[str, Iterable[Row]] = field(default_factory=dict)
    turnable: Turnable | None = None
    others: Callable[[Path], None] = lambda folder: None


@dataclass(frozen=True)
class Written:
    """The files of an answer; `result` is its JSON."""

    folder: Path
    html: Path
    pdf: Path
    result: Path
    tables: tuple[Path, ...]
    figures: tuple[Path, ...]


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


def write_answer(folder: Path | str, kind: Kind, contents: FolderContents) -> Written:
    """Write an answer to `folder`, replacing one of its kind that zerobeam wrote there before.

    Whole or not at all. Raises BadInput where `folder` is a file, is not ours, or cannot be written.
    """
    figures = write_folder(folder, kind, lambda new_folder: write_files(new_folder, kind, contents))
    folder = Path(folder)
    return Written(
        folder=folder,
        html=folder / f"{kind.pages}.html",
        pdf=folder / f"{kind.pages}.pdf",
        result=folder / kind.mark,
        tables=tuple(folder / name for name in contents.tables),
        figures=tuple(folder / "figures" / name for name in figures),
    )


def write_files(folder: Path, kind: Kind, contents: FolderContents) -> list[str]:
    """Write all files of an answer into an empty folder; returns the names of the figures. The HTML of a
    report carries its answer."""
    # What checks a folder, or prints a page, has no use for their libraries.
    from .html import html
    from .pdf import pdf

    page, answer = contents.page, dumps(contents.answer)
    pictures = {picture.name: picture for picture in contents.pictures if picture is not None}
    (folder / kind.mark).write_text(answer, encoding="utf-8")
    for file, rows in contents.tables.items():
        (folder / file).write_text(csv_text(rows), encoding="utf-8")
    with ThreadPoolExecutor(1) as beside:  # typst leaves the interpreter to others
        document = beside.submit(pdf, page, pictures)
        attached = answer if kind.shown_as == "report" else ""
        text = html(page, pictures, kind.shown_as, attached, contents.turnable)
        (folder / f"{kind.pages}.html").write_text(text, encoding="utf-8")
        (folder / f"{kind.pages}.pdf").write_bytes(document.result())
    if pictures:
        (folder / "figures").mkdir()
    for name, picture in pictures.items():
        (folder / "figures" / f"{name}.svg").write_text(picture.svg, encoding="utf-8")
    contents.others(folder)
    return [f"{name}.svg" for name in pictures]
