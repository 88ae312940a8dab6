"""Files in one zip archive, made while it is sent: neither on the disk nor whole in memory."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path

_PART = 2**18  # bytes read at once
_PACKED = {".html", ".json", ".jsonl", ".svg", ".csv"}  # by what is worth it; the others are packed already


def archive(files: Iterable[tuple[Path, str]]) -> Iterator[bytes]:
    """The bytes of a zip archive of files, each with its name in it; one that has gone is left out."""
    sink = _Sink()
    with zipfile.ZipFile(sink, "w") as whole:  # type: ignore[call-overload]
        for path, name in files:
            try:
                file = path.open("rb")
            except OSError:
                continue
            packed = zipfile.ZIP_DEFLATED if path.suffix.lower() in _PACKED else zipfile.ZIP_STORED
            with file:
                entry = zipfile.ZipInfo.from_file(path, name, strict_timestamps=False)
                entry.compress_type = packed
                with whole.open(entry, "w", force_zip64=True) as inside:
                    while part := file.read(_PART):
                        inside.write(part)
                        yield sink.taken()
            yield sink.taken()
    yield sink.taken()


class _Sink:
    """What a zip archive is written to: a stream that cannot go back."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def write(self, data: bytes) -> int:
        self._parts.append(bytes(data))
        return len(data)

    def flush(self) -> None:
        """Nothing is held back."""

    def taken(self) -> bytes:
        """What was written since the last call."""
        parts, self._parts = self._parts, []
        return b"".join(parts)
