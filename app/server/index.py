"""What is in the folder: its files, of which kind, the newest first, and what each states.

A file is looked at once for each of its versions. Every answer that is about the folder asks here.
"""

from __future__ import annotations

import json
import math
import os
import re
import stat
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from ...analysis.answer.result import RESULT_SCHEMA, Result, parse_result
from ...model.errors import BadInput
from ...model.files.header import RUN_SCHEMA, Header
from ...model.files.plan import plan_of
from ...model.files.whole_file import refuse_existing
from ...model.parsing.confinement import resolved
from ...model.parsing.reading import parse_json, read_text, read_yaml
from ...model.parsing.validation import validate
from ...model.records import internal, it, key, record
from ...words.wording import clipped
from .requests import at_key
from .versions import kept, version_of, version_of_sum


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

    def called(self, path: Path) -> str:
        """A path below the folder as the page calls it."""
        return path.relative_to(self.root).as_posix()

    def without(self, text: str) -> str:
        """A message in which the folder's own place is left out."""
        return text.replace(f"{self.root}{os.sep}", "").replace(str(self.root), ".")


MOST_SEEN = 20_000  # files that are looked at
LARGEST_RESULT = 16 * 10**6  # bytes
_LARGEST_LISTED = 4 * 10**6  # bytes of a result that is looked at beside others
_LARGEST_RUN = 16 * 10**6  # bytes
_KEPT = 8000
_YAML = {".yaml", ".yml"}
_TYPES = {*_YAML, ".json", ".jsonl", ".urdf"}  # of files that have a kind
_HEAD = 4096  # bytes: where the schema of a file is
_SCHEMA = re.compile(rb"""["']?schema["']?\s*:\s*["']?zerobeam/(run|plan|robot|result|cell|sensors)/""")
_SHOT = re.compile(rb'"shot"\s*:\s*(\d+)')


@record(kw_only=True)
class FolderFile:
    """A file below the folder of the app."""

    at: Annotated[Path, internal]
    path: Annotated[str, it("relative to the folder, with /")]
    bytes: int
    modified_ns: Annotated[int, internal]

    @property
    @key("ISO 8601, UTC")
    def modified(self) -> str:
        return datetime.fromtimestamp(self.modified_ns / 1e9, UTC).isoformat(timespec="seconds")

    @cached_property
    @key("run, plan, header, robot, result, cell, sensors, obstacles or other")
    def kind(self) -> str:
        """By its first bytes; `other` too where it has gone, or cannot be read."""
        return kind_of(self.at)

    @cached_property
    @key("changes with the file; what If-Match takes when it is replaced")
    def version(self) -> str:
        """Empty where it has gone, or cannot be read."""
        try:
            return version_of(self.at)
        except OSError:
            return ""

    def is_of(self, sha256: object) -> bool:
        """Whether a stated SHA-256 is its own."""
        return isinstance(sha256, str) and sha256 != "" and self.version == version_of_sum(sha256)


@dataclass(frozen=True)
class Head:
    """The header that a file has, plain values; of a plan how many `postures`, of a run the numbers of its
    `shots`."""

    header: Mapping[str, Any]
    postures: int = 0
    shots: frozenset[int] = frozenset()


@dataclass(frozen=True)
class Unread:
    """Why a file says nothing; `later`: it was not read yet."""

    why: str
    later: bool = False


Facts = Head | Result | Unread


class Index:
    """The folder as it is now. Who waits for an answer has `patience_s` for files that nobody read before."""

    def __init__(self, folder: Folder, patience_s: float = math.inf) -> None:
        self.folder = folder
        self.files = sorted(_regular(folder), key=lambda file: (-file.modified_ns, file.path))
        self._end = time.monotonic() + patience_s

    def of_kinds(self, *kinds: str) -> list[FolderFile]:
        """The files of these kinds, the newest first."""
        return [file for file in self.files if file.kind in kinds]

    def of_suffix(self, suffixes: frozenset[str]) -> list[Path]:
        """The files with such an end of their name, the newest first."""
        return [file.at for file in self.files if file.at.suffix.lower() in suffixes]

    def of_sum(self, kind: str, sha256: object, near: Path | None = None) -> FolderFile | None:
        """The file of a kind that has this SHA-256: the newest, or the one nearest to a file."""
        files = self.of_kinds(kind)
        if near is not None:
            files.sort(key=lambda file: -len(Path(os.path.commonpath([file.at, near])).parts))
        return next((file for file in files if file.is_of(sha256)), None)

    def facts(self, file: FolderFile) -> Facts:
        """What a header, plan, run or result states. Nothing is fitted."""
        try:
            if time.monotonic() > self._end and not _facts_of.knows(file.at):
                return Unread("not read yet", later=True)
            facts = _facts_of(file.at)
        except BadInput as error:
            facts = _unread(error)
        except OSError as error:
            return Unread(f"the file cannot be read: {error.strerror}")
        return Unread(self.folder.without(facts.why)) if isinstance(facts, Unread) else facts


def _regular(folder: Folder) -> Iterator[FolderFile]:
    """Neither hidden files nor what symbolic links lead to, nor names that JSON in UTF-8 cannot carry."""
    count = 0
    for where, folders, names in os.walk(folder.root):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(name for name in names if not name.startswith(".")):
            count += 1
            if count > MOST_SEEN:
                return
            path = Path(where) / name
            try:
                facts = path.lstat()
                name.encode("utf-8")
            except (OSError, UnicodeEncodeError):
                continue  # the file is gone meanwhile, or not ours
            if stat.S_ISREG(facts.st_mode):
                called = folder.called(path)
                yield FolderFile(at=path, path=called, bytes=facts.st_size, modified_ns=facts.st_mtime_ns)


def kind_of(path: Path) -> str:
    """A file by its first bytes: run, plan, header, robot, result, cell, sensors, obstacles or other."""
    suffix = path.suffix.lower()
    if suffix not in _TYPES or suffix == ".urdf":
        return "robot" if suffix == ".urdf" else "other"
    try:
        return _kind(path)
    except OSError:
        return "other"


def yaml_path(folder: Folder, file: str, kind: str) -> Path:
    """Where a YAML file of a kind is written: a new file, or in place of one of this kind; Refused else."""
    with at_key("file"):
        path = folder.inside(file)
        if path.suffix.lower() not in _YAML:
            raise BadInput(
                f"this is no name of a {kind} file", found=file, allowed="a name that ends in .yaml"
            )
        if path.exists() and kind_of(path) != kind:
            allowed = f"a new file, or a {kind} file that is there"
            raise BadInput("something else has this name", found=file, allowed=allowed)
    return path


@kept(MOST_SEEN)
def _kind(path: Path) -> str:
    with path.open("rb") as file:
        head = file.read(_HEAD)
    if (schema := _SCHEMA.search(head)) is not None:
        return schema[1].decode()
    yaml = path.suffix.lower() in _YAML
    keys = set(re.findall(rb"^(\w+):", head, re.M))
    if yaml and b"robot" in keys and (keys >= {b"tool", b"noise"} or b"instruments" in keys):
        return "header"
    return "obstacles" if yaml and keys and keys <= {b"floor_mm", b"boxes", b"thickness_mm"} else "other"


@kept(_KEPT)
def _facts_of(path: Path) -> Facts:
    kind = kind_of(path)
    if kind not in _READERS:  # it has changed meanwhile
        return Unread("the file states nothing of an arm")
    try:
        return _READERS[kind](path)
    except BadInput as error:
        if kind == "plan":  # what is wrong may be its robot's file, and be put right
            raise
        return _unread(error)


def _unread(error: BadInput) -> Unread:
    where = "" if error.line is None else f"line {error.line}: "
    return Unread(clipped(f"{where}{error.what}", 200))


def _read_header(path: Path) -> Head:
    document = read_yaml(path)
    validate(Header, document.data, file=path, line=document.line)
    return Head(document.data)


def _read_plan(path: Path) -> Head:
    document = read_yaml(path)
    plan = plan_of(document)
    header = {key: value for key, value in document.data.items() if key != "postures_deg"}
    return Head(header, postures=len(plan.postures))


def _read_run(path: Path) -> Head:
    """The header of a run and the numbers of its measurements: its readings are not looked at."""
    if path.stat().st_size > _LARGEST_RUN:
        raise BadInput("the run is too long to be looked at here")
    head, _, rest = path.read_bytes().partition(b"\n")
    try:
        header = json.loads(head)
        header["provenance"] = header.get("provenance") or {}
        if header["schema"] != RUN_SCHEMA or not isinstance(header["provenance"], dict):
            raise ValueError
        shots = frozenset(int(number) for number in _SHOT.findall(rest))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise BadInput("this is no whole header of a run") from None
    return Head(header, shots=shots)


def _read_listed(path: Path) -> Result:
    if path.stat().st_size > _LARGEST_LISTED:
        raise BadInput("the result is too large to be looked at here: open it")
    return read_result(path)


_READERS: dict[str, Callable[[Path], Head | Result]] = {
    "header": _read_header,
    "plan": _read_plan,
    "run": _read_run,
    "result": _read_listed,
}


@kept(4)
def read_result(path: Path) -> Result:
    """A result file; BadInput where it is none, not whole, too large, or contradicts itself."""
    text, _ = read_text(path, LARGEST_RESULT)
    try:
        parse_json(text, file=path, line=1)  # refuses duplicate keys and NaN
        return parse_result(text)
    except (json.JSONDecodeError, RecursionError) as error:
        message = f"the file is no JSON, or cut off: {error}"
    except ValueError as error:
        message = str(error)
    raise BadInput(
        "this is not a whole result of zerobeam",
        found=message[:300],
        allowed=f"a result.json of schema {RESULT_SCHEMA}",
        remedy="make it again with zerobeam report",
        file=path,
    )
