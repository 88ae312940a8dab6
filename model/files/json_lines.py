"""JSON lines: one value a line, of which a recording that broke off may have torn the last."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..errors import BadInput
from .reading import decode, parse_json, shown


def json_rows(content: bytes, path: Path) -> tuple[list[tuple[int, Any]], int | None]:
    """(line, value) of every line that is not blank, and the number of the last one if that is torn."""
    raw = [(i, line) for i, line in enumerate(content.split(b"\n"), start=1) if line.strip()]
    rows: list[tuple[int, Any]] = []
    for number, line in raw:
        # A line that breaks off is never JSON, as its last brace is missing. After a power cut it may
        # also end in bytes of no meaning.
        last = number == raw[-1][0] and rows
        try:
            text = decode(line, file=path, line=number)
        except BadInput:
            if last:
                return rows, number
            if not rows and b"\0" in content:
                raise BadInput(
                    "this is a binary file, not text",
                    allowed="text in UTF-8",
                    remedy="give a run file (.jsonl)",
                    file=path,
                ) from None
            raise
        try:
            rows.append((number, parse_json(text, file=path, line=number)))
        except json.JSONDecodeError as error:
            if last:
                return rows, number
            raise BadInput(
                f"the line is not JSON: {error.msg} at character {error.pos + 1}",
                found=shown(text[:70]),
                allowed="one JSON object a line: the header, then the measurements",
                remedy="remove the line if the recording broke off here"
                if rows
                else "give a run file (.jsonl)",
                file=path,
                line=number,
            ) from None
    return rows, None


# Made once: json.dumps makes one for each line.
_ENCODER = json.JSONEncoder(ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def json_line(content: dict[str, Any]) -> str:
    return _ENCODER.encode(content) + "\n"
