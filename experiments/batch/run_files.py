"""The files of a batch, and a name for each that no other has."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from ...model.errors import BadInput

PATTERN = "**/*.jsonl"


def run_files(given: Sequence[Path], pattern: str, out: Path) -> list[Path]:
    """The files that are `given`, and those in folders given that match `pattern`; each once, in the order of
    their paths. What lies in `out` is no input."""
    found: dict[Path, Path] = {}
    for path in given:
        if not path.exists():
            raise BadInput(
                "there is no such file or folder", found=path, allowed="run files, or folders of run files"
            )
        if not path.is_dir():
            found.setdefault(path.resolve(), path)
            continue
        try:
            matching = sorted(path.glob(pattern))
        except (ValueError, NotImplementedError) as error:
            raise BadInput(
                f"the pattern cannot be used: {error}",
                found=pattern,
                allowed="a pattern relative to the folders given, such as 2026-*/*.jsonl",
                argument="--glob",
            ) from None
        inside = [own for own in matching if own.is_file() and not _within(own, out)]
        for own in inside:
            found.setdefault(own.resolve(), own)
        if not inside:
            raise BadInput(
                "no file in this folder matches the pattern",
                found=path,
                allowed=f"files that match {pattern}",
                remedy="name another folder, or another pattern with --glob",
            )
    return [found[path] for path in sorted(found)]


def names_of(files: Sequence[str], kept: Mapping[str, str], reserved: Collection[str]) -> dict[str, str]:
    """A name for each of `files` (paths with /): the stem; with the folders above it before it as far as
    it takes where several have that stem. No two are the same for a file system that ignores case.

    A file that has one in `kept` keeps it, so that results stay where they are.
    """
    names = {file: kept[file] for file in files if file in kept}
    taken = {name.casefold() for name in (*kept.values(), *reserved)}
    left = [file for file in files if file not in names]
    depth = 1
    while left:
        tried = {file: _name(file, depth) for file in left}
        count = Counter(name.casefold() for name in tried.values())
        again = []
        for file, name in tried.items():
            if count[name.casefold()] == 1 and name.casefold() not in taken:
                names[file] = name
            else:
                again.append(file)
        taken.update(names[file].casefold() for file in left if file in names)
        if len(again) == len(left) and all(depth >= len(file.split("/")) for file in again):
            for file in again:  # the whole paths differ in case, or where a hyphen is, alone
                number = 2
                while f"{_name(file, depth)}-{number}".casefold() in taken:
                    number += 1
                names[file] = f"{_name(file, depth)}-{number}"
                taken.add(names[file].casefold())
            again = []
        left, depth = again, depth + 1
    return names


def _name(file: str, depth: int) -> str:
    """The last `depth` parts of a path, without the ending, joined."""
    parts = [part for part in file.split("/") if part not in ("", ".", "..")]
    last, _, ending = parts[-1].rpartition(".")
    stem = last if last and ending else parts[-1]
    return "-".join((*parts[-depth:-1], stem)) if depth > 1 else stem


def _within(path: Path, folder: Path) -> bool:
    return path.resolve().is_relative_to(folder.resolve())


def shown_path(path: Path, folder: Path) -> str:
    """A path relative to a folder, with /: it moves along with both."""
    try:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:  # another drive of Windows
        return path.resolve().as_posix()
