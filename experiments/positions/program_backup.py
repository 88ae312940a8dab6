"""A backup of a controller, a file or a folder: its files, their language, what is in them."""

from __future__ import annotations

import re
import zlib
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from zipfile import BadZipFile, ZipFile

from ...model.errors import BadInput
from ...model.parsing.confinement import require_within
from ...model.parsing.reading import LARGEST, require_regular
from .position import BackupReading, FileReading, JointLanguage, PositionLanguage, RefusedLine, SourceFile
from .position_languages import LANGUAGES

AUDIT = "audit.json"
_PROGRAM = r"\.(?:mod|src|ls|prg|va|jbi|as|pg|pts|dtx|pgx|pcs|drl|script|mb[456])$"
_GZIP = b"\x1f\x8b"
_ENDINGS = {ending for language in LANGUAGES for ending in language.endings}
_MOST_FILES = 20_000
_LARGEST_ARCHIVE = 2**28  # bytes of its programs


@dataclass(frozen=True, eq=False)
class Backup:
    """The files of a language in a backup, as bytes by their paths in it, and what is read of them.

    Of a single file `chosen` is its path: the others beside it say what its tools and frames are."""

    path: Path
    language: PositionLanguage
    content: dict[str, bytes]
    reading: BackupReading
    chosen: tuple[str, ...]

    @property
    def single(self) -> bool:
        """Whether one file was named, and not the folder or archive of a backup."""
        return self.path.is_file() and self.path.suffix.lower() != ".zip"


def read_backup(path: Path, vendor: str | None = None) -> Backup:
    """The backup at `path`; `vendor` is that of the arm, where the ending of a file is of several languages.

    BadInput where there is nothing to read, or where it may be of several languages.
    """
    require_within(path)
    if not path.exists():
        raise BadInput(
            "there is no such file or folder",
            remedy="name a program, or the folder or zip of a backup",
            file=path,
        )
    if path.is_dir() or path.suffix.lower() == ".zip":
        content = _folder(path) if path.is_dir() else _archive(path)
        language, chosen = _language_of(path, content, vendor), tuple(content)
        content = {name: each for name, each in content.items() if _ending(name) in language.endings}
    else:
        require_regular(path)
        beside = _folder(path.parent, deep=False)
        chosen = tuple(name for name in beside if Path(name).stem.lower() == path.stem.lower())
        language = _language_of(path, {name: beside[name] for name in chosen}, vendor)
        content = together(path, language)
    return Backup(path, language, content, reading_of(language, content, chosen), chosen)


def together(path: Path, language: JointLanguage) -> dict[str, bytes]:
    """A file, with those of its folder that say what its tools and frames are, or what becomes of its
    positions."""
    pattern = re.compile(rf"{re.escape(path.stem)}\.\w+|{language.beside}", re.IGNORECASE)
    files = _folder(path.parent, deep=False)
    names = [name for name in files if _ending(name) in language.endings and pattern.fullmatch(name)]
    return {name: files[name] for name in names}


def reading_of(language: PositionLanguage, content: dict[str, bytes], chosen: Sequence[str]) -> BackupReading:
    """What the files say; of those that are not chosen only tools, frames and the arm."""
    files, unread, compressed = [], [], []
    for name, each in content.items():
        text = each.decode("latin-1")
        if each.startswith(_GZIP):
            compressed.append(SourceFile(name, text))
        elif "\0" in text or each.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
            unread.append(
                RefusedLine(
                    SourceFile(name, ""), 1, "this is a binary file, or UTF-16: save it as plain text"
                )
            )
        else:
            files.append(SourceFile(name, text, language.remark))
    reading = BackupReading(files)
    language.read(reading)
    for file in compressed:
        sentence = "this program is compressed: it is not read, and its positions stay as they are"
        FileReading(file, reading).doubt(0, "elsewhere", sentence)
    reading.refused += [line for line in unread if re.search(_PROGRAM, line.file.name, re.IGNORECASE)]
    return reading.of(chosen).finished()


def _folder(folder: Path, *, deep: bool = True) -> dict[str, bytes]:
    paths = [
        path
        for path in sorted(folder.rglob("*") if deep else folder.iterdir())
        if path.suffix.lower() in _ENDINGS
        and path.is_file()
        and not path.is_symlink()
        and path.stat().st_size <= LARGEST
    ]
    if len(paths) > _MOST_FILES:
        raise BadInput(
            "the folder has too many files",
            found=len(paths),
            allowed=_MOST_FILES,
            remedy="name a folder with the programs alone",
            file=folder,
        )
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def _archive(path: Path) -> dict[str, bytes]:
    """The files of a zip archive; BadInput for one that is damaged, encrypted, too large, or has names that
    lead elsewhere."""
    require_regular(path)
    try:
        with ZipFile(path) as archive:
            names = {each.filename: each for each in archive.infolist() if not each.is_dir()}
            outside = [
                name for name in names if {"..", ""} & {*name.split("/")} or "\\" in name or ":" in name
            ]
            if outside or any(PurePosixPath(name).name == AUDIT for name in names):
                raise BadInput(
                    "the archive is no backup of a controller as it was",
                    found=outside[0] if outside else f"{AUDIT}: it was converted before",
                    allowed="the files of a backup, with their folders",
                    remedy="name the backup as the controller wrote it",
                    file=path,
                )
            entries = {
                name: each
                for name, each in names.items()
                if _ending(name) in _ENDINGS and each.file_size <= LARGEST
            }
            if (
                len(entries) > _MOST_FILES
                or sum(each.file_size for each in entries.values()) > _LARGEST_ARCHIVE
            ):
                raise BadInput(
                    "the archive is too large",
                    allowed=f"{_MOST_FILES} files of programs",
                    remedy="name a folder with the programs alone",
                    file=path,
                )
            return {name: archive.read(each) for name, each in entries.items()}
    except (BadZipFile, zlib.error, RuntimeError, NotImplementedError, EOFError) as error:
        raise BadInput(
            "the archive cannot be read",
            found=str(error),
            remedy="make the archive again, without a password; or name the folder of its files",
            file=path,
        ) from None


def _ending(name: str) -> str:
    return Path(name).suffix.lower()


def _language_of(path: Path, content: dict[str, bytes], vendor: str | None) -> PositionLanguage:
    of_file = {
        name: [
            language
            for language in LANGUAGES
            if _ending(name) in language.endings
            and re.search(language.mark, each.decode("latin-1"), re.MULTILINE | re.IGNORECASE) is not None
        ]
        for name, each in content.items()
    }
    several = [language for language in LANGUAGES if any(language in some for some in of_file.values())]
    fitting = [language for language in several if language.vendor == vendor] or several
    if len(fitting) == 1:
        for name, some in of_file.items():
            if some and fitting[0] not in some:
                raise BadInput(
                    "the backup has files of another language, which would stay as they are",
                    found=f"{name}: {some[0].name}",
                    allowed=f"files of one controller: {fitting[0].name}",
                    remedy="move the others elsewhere, and convert them as a backup of their own",
                    file=path,
                )
        return fitting[0]
    about = ", ".join(f"{language.name} ({' '.join(language.endings)})" for language in LANGUAGES)
    raise BadInput(
        "the backup is of several languages" if fitting else "there is nothing in it that is read here",
        found=", ".join(language.name for language in fitting)
        or f"{len(content)} files with endings that are read",
        allowed=about,
        remedy="name the folder of one controller"
        if fitting
        else "save the programs at the controller as text, and name their folder",
        file=path,
    )
