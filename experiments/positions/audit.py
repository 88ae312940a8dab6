"""The audit of a conversion: what was converted is not converted again, and can be put back byte by byte."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

from ...model.errors import BadInput
from ...model.parsing.confinement import require_within
from ...model.parsing.reading import read_bytes
from ...model.records import read
from .conversion import POSITIONS_SCHEMA, Conversion, TextEdit, positions_sha256
from .program_backup import AUDIT, Backup


def read_audit(path: Path) -> Conversion:
    """The audit.json of a conversion. BadInput where it is damaged: what was converted is not known then."""
    try:
        return read(Conversion, read_bytes(path))
    except ValueError as error:
        raise BadInput(
            "this is no audit of a conversion, or not all of it",
            found=str(error),
            allowed=f"{AUDIT} as positions keep or reach wrote it",
            remedy="copy it again from where it is whole; without it take the old files from the backup that"
            " was converted. Move it elsewhere only if no file here was converted",
            file=path,
        ) from None


def require_not_converted(backup: Backup, *folders: Path) -> None:
    """BadInput where a file of the backup, or all of its positions, are those that a conversion has written
    whose audit is in one of the folders, or in a folder beside."""
    by_file = {
        name: positions_sha256([one for one in backup.reading.positions if one.file.name == name])
        for name in {one.file.name for one in backup.reading.positions}
    }
    hashes = {hashlib.sha256(each).hexdigest(): name for name, each in backup.content.items()}
    for path in _audits(*folders):
        audit = read_audit(path)
        for one in audit.files:
            name = hashes.get(one.new_sha256) or next(
                (name for name, each in by_file.items() if each == one.positions_sha256), None
            )
            if name is not None:
                raise BadInput(
                    "this backup was converted before: its positions would move a second time",
                    found=f"{name}, as {path} says ({audit.command}, {audit.source})",
                    allowed="the backup as it was before",
                    remedy=f"zerobeam positions restore {path.parent} -o FOLDER puts it back",
                    file=backup.path,
                )


def _audits(*folders: Path) -> Iterator[Path]:
    looked = {folder.resolve() for folder in folders if folder.is_dir()}
    for folder in sorted(looked):
        beside = [each for each in folder.iterdir() if each.is_dir() and each.name[0] != "."]
        for each_folder in [folder, *sorted(beside)]:  # hidden: one that is just being written
            path = each_folder / AUDIT
            if path.is_file() and POSITIONS_SCHEMA.encode() in path.read_bytes()[:200]:
                yield path


def restored(folder: Path) -> dict[str, bytes]:
    """The old bytes of all files that a conversion wrote to a folder (or that of its audit.json), by their
    paths.

    BadInput where one of them is no longer as it was written.
    """
    require_within(folder)
    folder = folder.parent if folder.name == AUDIT and not folder.is_dir() else folder
    if not (folder / AUDIT).is_file():
        raise BadInput(
            "there is no conversion here",
            found=f"no {AUDIT} in it" if folder.is_dir() else "no such folder",
            allowed=f"the folder that positions keep or reach wrote, with its {AUDIT}",
            remedy="name that folder, not the backup; or take the old files from the backup",
            file=folder,
        )
    audit, content = read_audit(folder / AUDIT), {}
    for one in audit.files:
        new = read_bytes(folder / one.file) if (folder / one.file).is_file() else b""
        if hashlib.sha256(new).hexdigest() != one.new_sha256:
            raise BadInput(
                "the file was changed after the conversion, or is missing: the old one does not follow",
                remedy="take it from the backup that was converted",
                file=folder / one.file,
            )
        old = _undone(new, one.edits)
        if hashlib.sha256(old).hexdigest() != one.sha256:
            raise BadInput(
                "the audit does not give the old file",
                found=one.file,
                remedy="take it from the backup that was converted",
                file=folder / AUDIT,
            )
        content[one.file] = old
    return content


def _undone(content: bytes, edits: tuple[TextEdit, ...]) -> bytes:
    text = content.decode("latin-1")
    for edit in edits:
        start = edit.start
        text = text[:start] + edit.old + text[start + len(edit.new) :]
    return text.encode("latin-1")
