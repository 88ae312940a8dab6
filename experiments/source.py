"""The hash of the sources: another version, or an edited one, may give other numbers."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

_ROOMS = ("analysis", "experiments", "model", "reports", "words")


@cache
def source_hash() -> str:
    """SHA-256 of the sources by which results are computed and written."""
    root, digest = Path(__file__).resolve().parents[1], hashlib.sha256()
    for room in _ROOMS:
        for path in sorted((root / room).rglob("*.py")):
            digest.update(path.relative_to(root).as_posix().encode() + b"\0")
            digest.update(path.read_bytes().replace(b"\r\n", b"\n") + b"\0")
    return digest.hexdigest()
