"""Files that are written whole or not at all, and never over another one."""

from __future__ import annotations

import contextlib
import os
import re
import socket
import sys
import tempfile
import time
import zlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from io import FileIO, StringIO
from pathlib import Path
from typing import Any, Self

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from ...interruption import interruptible, uninterrupted
from ..errors import BadInput, NotWritten
from ..parsing.confinement import require_within

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

# In names of what is not finished: by which process of which computer; without, by an earlier version.
WRITER = r"(?:(?P<here>[0-9a-f]{8})-(?P<process>[0-9]+)-)?[a-z0-9_]{8}"
_PART = re.compile(rf"\.(?P<name>.+)\.{WRITER}\.part")
_DAY_S = 24 * 3600
_WRITABLE = 0o222
_BEHIND_THE_END = 2**31 - 2  # the last byte that Windows' C library can lock, and no file of ours is as long


def refuse_existing(
    path: Path,
    *,
    or_else: str | None = None,
    force: bool | None = None,
    keep: Iterable[Path | None] = (),
) -> None:
    """BadInput if something of this name is there, or if there is no folder to put it in.

    `or_else` is what may be done with a file that is there, besides choosing another name. With `force` a
    regular file may be there, unless it is read-only or one of those to `keep`; None: there is no option.
    """
    require_within(path, hidden=True)
    if force and path.is_file():
        if any(kept is not None and kept.exists() and path.samefile(kept) for kept in keep):
            raise BadInput(
                "the file is one of those that are read: it would be lost",
                file=path,
                remedy="choose another name; --force replaces other files only",
            )
        if not path.stat().st_mode & _WRITABLE:  # the folder would allow to replace it all the same
            raise BadInput(
                "the file is read-only", file=path, remedy="make it writable, or choose another name"
            )
    elif path.exists() or path.is_symlink():
        folder = path.is_dir()
        may_replace = force is not None and not folder
        remedy = "have it replaced (--force)" if may_replace else "move it away first"
        remedy = remedy if or_else is None or folder else or_else
        raise BadInput(
            "there is a folder of this name" if folder else "the file exists already",
            file=path,
            remedy=f"choose another name, or {remedy}: nothing is overwritten",
        )
    if not path.parent.is_dir():
        raise BadInput(
            "the folder to write into does not exist", found=path.parent, file=path, remedy="make it first"
        )


@uninterrupted()
def write_whole(path: Path, content: str | bytes | Iterable[str], *, force: bool | None = None) -> None:
    """Write text as UTF-8, or bytes, next to `path`, bring it to the disk, then give it its name.

    Text may come in pieces: between them a request to end is obeyed, and whatever they raise leaves no file.
    With `force` it takes the place of a file that is there.
    """
    refuse_existing(path, force=force)
    remove_abandoned(path.parent, _PART, path.name)
    try:
        prefix = f".{path.name}.{writer()}-"
        handle, part = tempfile.mkstemp(prefix=prefix, suffix=".part", dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                if isinstance(content, str | bytes):
                    file.write(content if isinstance(content, bytes) else content.encode("utf-8"))
                else:
                    with interruptible():
                        file.writelines(piece.encode("utf-8") for piece in content)
                file.flush()
                os.fsync(file.fileno())
            os.chmod(part, 0o666 & ~_umask())
            _name(Path(part), path, bool(force))
        finally:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(part)
        sync_folder(path.parent)
    except FileExistsError:
        refuse_existing(path)
        raise
    except OSError as error:
        raise NotWritten(f"the file cannot be written: {error.strerror}", file=path) from None


def is_part(name: str) -> bool:
    """Whether a file of this name is one that `write_whole` has not finished."""
    return _PART.fullmatch(name) is not None


def writer() -> str:
    """Name of this computer and this process, for the names of unfinished files."""
    return f"{_here()}-{os.getpid()}"


def _here() -> str:
    return f"{zlib.crc32(socket.gethostname().encode()):08x}"


def remove_abandoned(
    folder: Path,
    pattern: re.Pattern[str],
    name: str | None = None,
    remove: Callable[[Path], object] = os.unlink,
) -> None:
    """Remove what matches a pattern with `WRITER`, of processes that were killed or of more than a day ago;
    with `name` only what the pattern's group `name` says to be of it."""
    with contextlib.suppress(OSError):  # whoever may not look here may not write here either
        for entry in os.scandir(folder):
            match = pattern.fullmatch(entry.name)
            if match is None or (name is not None and match["name"] != name) or entry.is_symlink():
                continue
            old = time.time() - entry.stat(follow_symlinks=False).st_mtime > _DAY_S
            if old or (match["here"] == _here() and _has_ended(int(match["process"]))):
                with contextlib.suppress(OSError):
                    remove(Path(entry.path))


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


def _name(part: Path, path: Path, force: bool) -> None:
    if force:
        os.replace(part, path)
        return
    if os.name == "nt":
        os.rename(part, path)  # refuses a name that is taken
        return
    try:
        os.link(part, path)  # so does this; POSIX rename would overwrite
    except FileExistsError:
        raise
    except OSError:  # a file system without hard links
        refuse_existing(path)
        os.rename(part, path)


def _umask() -> int:
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


def sync_folder(folder: Path) -> None:
    """Bring the folder's list of names to the disk, where the system can (Windows does it by itself)."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def lock(file: FileIO) -> bool:
    """Keep other processes out of an open file until it is closed; False where one of them has it.

    The lock is the system's and on the file itself: it ends with the process, and nothing is left beside the
    file. Windows lets nobody read what is locked, so there it is a byte far behind the end.
    """
    try:
        if sys.platform == "win32":
            position = file.tell()
            file.seek(_BEHIND_THE_END)
            try:
                msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
            finally:
                file.seek(position)
        else:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    return True


# YAML as people write it


def schema_line(path: Path, name: str) -> str:
    """The first line of a YAML file that lets an editor complete its keys: it names NAME.schema.json, where
    that is beside the file (`zerobeam schema NAME > NAME.schema.json`); nothing where it is not."""
    schema = path.with_name(f"{name}.schema.json")
    return f"# yaml-language-server: $schema={schema.name}\n" if schema.is_file() else ""


def yaml_text(content: Mapping[str, object]) -> str:
    """Content of a file as YAML."""
    yaml = YAML()
    yaml.width = 4096
    yaml.indent(mapping=2, sequence=4, offset=2)
    text = StringIO()
    yaml.dump(content, text)
    return text.getvalue()


def flow(value: Any) -> Any:
    """The same list or mapping, to be written on one line."""
    commented: Any = CommentedMap(value) if isinstance(value, dict) else CommentedSeq(value)
    commented.fa.set_flow_style()
    return commented


def short_in_one_line(content: Mapping[str, object]) -> dict[str, object]:
    """Mappings of the header stay open for the eye; lists and what is deeper go on one line."""
    result: dict[str, object] = {}
    for key, value in content.items():
        if isinstance(value, dict):
            result[key] = CommentedMap(
                {name: flow(item) if isinstance(item, dict | list) else item for name, item in value.items()}
            )
        elif isinstance(value, list):
            result[key] = CommentedSeq(flow(item) if isinstance(item, dict) else item for item in value)
        else:
            result[key] = value
    return result


class Closing(ABC):
    """`close` is called at the end of a `with`, however that ends."""

    @abstractmethod
    def close(self) -> None: ...

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
