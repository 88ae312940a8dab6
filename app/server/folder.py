"""The one folder that the app reads and writes: names from outside never lead out of it."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import Annotated, NamedTuple

from ...model.errors import BadInput
from ...model.files.whole_file import refuse_existing
from ...model.parsing.confinement import resolved
from ...model.records import it, record
from .kept import Kept
from .versions import version_of

MOST_FILES = 2000  # listed
MOST_SEEN = 20_000  # looked at for them
_TYPES = {".yaml", ".yml", ".json", ".jsonl", ".urdf"}  # of files that have a kind
_KINDS = Kept(MOST_SEEN)
_HEAD = 4096  # bytes: where the schema of a file is
_SCHEMA = re.compile(rb"""["']?schema["']?\s*:\s*["']?zerobeam/(run|plan|robot|result|cell|sensors)/""")


@record(kw_only=True)
class FolderFile:
    """A file below the folder of the app."""

    path: Annotated[str, it("relative to the folder, with /")]
    kind: Annotated[str, it("run, plan, header, robot, result, cell, sensors, obstacles or other")]
    bytes: int
    modified: Annotated[str, it("ISO 8601, UTC")]
    version: Annotated[str, it("changes with the file; what If-Match takes when it is replaced")]


class KindOfFile(NamedTuple):
    """A file below the folder of the app: its path, kind, and when it was modified, ISO 8601, UTC."""

    path: str
    kind: str
    modified: str


class Folder:
    """A folder, and paths that are relative to it.

    Attributes
    ----------
    root : Path
        The folder, symbolic links resolved.
    """

    def __init__(self, root: Path) -> None:
        if not root.is_dir():
            raise BadInput(
                "the folder of the app does not exist", found=root, remedy="name a folder that does: --dir"
            )
        self.root = Path(os.path.realpath(root))

    def inside(self, name: str, start: Path | None = None) -> Path:
        """The resolved path of a name that is relative to `start` (the folder itself); it need not exist.

        BadInput where it is hidden, or not below the folder, once symbolic links are followed.
        """
        return resolved(self.root, name, start)

    def private(self, name: str) -> Path:
        """The path of a file of the app itself, in `.zerobeam`; BadInput where a link leads elsewhere."""
        return resolved(self.root, f".zerobeam/{name}", hidden=True)

    def file(self, name: str) -> Path:
        """The path of a regular file below the folder that is not hidden; BadInput where there is none."""
        path = self.inside(name)
        if not path.is_file():
            raise BadInput("there is no such file in the app's folder", found=name[:100])
        return path

    def new(self, name: str) -> Path:
        """The path of a file that is to be made: in a folder that is there, not hidden, no other's name."""
        path = self.inside(name)
        refuse_existing(path)
        return path

    def free(self, path: Path) -> Path:
        """This path, or one like it with a number behind its name: nothing is there yet."""
        number, free = 1, path
        while free.exists() or free.is_symlink():
            number += 1
            free = path.with_name(f"{path.stem}-{number}{path.suffix}")
        return free

    def called(self, path: Path) -> str:
        """A path below the folder as the page calls it."""
        return path.relative_to(self.root).as_posix()

    def without(self, text: str) -> str:
        """A message in which the folder's own place is left out."""
        return text.replace(f"{self.root}{os.sep}", "").replace(str(self.root), ".")

    def files(self) -> list[FolderFile]:
        """The files below the folder, newest first.

        Neither hidden files nor what symbolic links lead to, `MOST_FILES` at the most.
        """
        files = []
        for path, facts in self._newest()[:MOST_FILES]:
            size, modified = facts.st_size, _moment(facts)
            try:
                kind, version = _KINDS.of(self.root / path, kind_of), version_of(self.root / path)
            except OSError:  # gone meanwhile, or not to be read
                kind, version = "other", ""
            files.append(FolderFile(path=path, kind=kind, bytes=size, modified=modified, version=version))
        return files

    def of_kinds(self, kinds: frozenset[str]) -> list[KindOfFile]:
        """All files of these kinds, newest first."""
        files = []
        for path, facts in self._newest():
            if PurePosixPath(path).suffix.lower() in _TYPES:
                try:
                    kind = _KINDS.of(self.root / path, kind_of)
                except OSError:
                    continue  # gone meanwhile
                if kind in kinds:
                    files.append(KindOfFile(path, kind, _moment(facts)))
        return files

    def of_suffix(self, suffixes: frozenset[str]) -> list[Path]:
        """The files with such an end of their name, newest first."""
        return [
            self.root / path for path, _ in self._newest() if PurePosixPath(path).suffix.lower() in suffixes
        ]

    def _newest(self) -> list[tuple[str, os.stat_result]]:
        return sorted(self._regular(), key=lambda row: (-row[1].st_mtime_ns, row[0]))

    def _regular(self) -> Iterator[tuple[str, os.stat_result]]:
        count = 0
        for where, folders, names in os.walk(self.root):
            folders[:] = sorted(name for name in folders if not name.startswith("."))
            for name in sorted(names):
                if name.startswith("."):
                    continue
                count += 1
                if count > MOST_SEEN:
                    return
                path = Path(where) / name
                try:
                    facts = path.lstat()
                except OSError:
                    continue  # gone meanwhile
                if stat.S_ISREG(facts.st_mode) and _writable_name(path.name):
                    yield self.called(path), facts


def _moment(facts: os.stat_result) -> str:
    return datetime.fromtimestamp(facts.st_mtime, UTC).isoformat(timespec="seconds")


def _writable_name(name: str) -> bool:
    """Whether JSON in UTF-8 can carry it."""
    try:
        name.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


def kind_of(path: Path) -> str:
    """A file by its first bytes: run, plan, header, robot, result, cell, sensors, obstacles or other."""
    if path.suffix.lower() not in _TYPES:
        return "other"
    if path.suffix.lower() == ".urdf":
        return "robot"
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError:
        return "other"
    if (schema := _SCHEMA.search(head)) is not None:
        return schema[1].decode()
    yaml = path.suffix.lower() in {".yaml", ".yml"}
    keys = set(re.findall(rb"^(\w+):", head, re.M))
    if yaml and b"robot" in keys and (keys >= {b"tool", b"noise"} or b"instruments" in keys):
        return "header"
    return "obstacles" if yaml and keys and keys <= {b"floor_mm", b"boxes", b"thickness_mm"} else "other"
