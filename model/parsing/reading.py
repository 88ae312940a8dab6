"""Text, YAML and JSON as plain values; every refusal says in which file and line, and what is allowed.

YAML is read by the core schema of YAML 1.2 (`no` and `2024-05-01` are text, not a boolean or a
date). Keys are text and unique; numbers are finite, everywhere.
"""

from __future__ import annotations

import codecs
import difflib
import hashlib
import json
import math
import os
import re
import shlex
import stat
import warnings
from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any, Literal

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from ..errors import BadInput
from .confinement import require_within

KeyPath = tuple[str | int, ...]
Schema = Literal[
    "zerobeam/run/1",
    "zerobeam/plan/1",
    "zerobeam/robot/1",
    "zerobeam/cell/1",
    "zerobeam/sensors/1",
    "zerobeam/psd-calibration/1",
]

# Bytes of a file, by its kind (docs/files.md).
LARGEST_YAML = 4 * 10**6
LARGEST = 64 * 10**6  # what other programs write: URDF, programs and configurations of controllers
LARGEST_RECORDING = 256 * 10**6  # runs and results
LARGEST_TABLE = 1024 * 10**6  # logs in CSV

_AT_ONCE = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
_ZIP = b"PK\3\4"
_KINDS = {
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}

MOST_VALUES = 200_000  # in a YAML file: a plan of 20 000 postures
DEEPEST = 50  # levels of nesting: no file of ours has more than six


def read_bytes(path: Path, most: int = LARGEST) -> bytes:
    """Content of a regular file of at most `most` bytes; BadInput for one that is missing, a folder, a
    device, a pipe, unreadable, too large or empty."""
    try:
        require_regular(path)
        # What a name stands for may have changed meanwhile: opening waits for nobody at the end of a pipe.
        with open(os.open(path, os.O_RDONLY | _AT_ONCE), "rb") as file:
            content = file.read(most + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise BadInput(f"the file cannot be read: {reason}", file=path) from None
    if len(content) > most:
        raise BadInput(
            "the file is too large",
            found=f"more than {most // 10**6} MB",
            allowed=f"at most {most // 10**6} MB for a file of this kind",
            remedy="is it the right file? If so, divide it into several files",
            file=path,
        )
    if not content.strip():
        raise BadInput(
            "the file is empty", remedy="is it the right file? Save it again where it was made", file=path
        )
    return content


def real_path(path: Path) -> Path:
    """The path with all links followed; links in a circle stay, and are refused when the file is read."""
    return Path(os.path.realpath(path))


def require_regular(path: Path) -> None:
    """BadInput for what is no regular file. It is not opened: a device has no end, a pipe may never begin."""
    require_within(path)
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        raise BadInput("there is no such file", file=path, remedy=_near_file(path)) from None
    if stat.S_ISDIR(mode):
        raise BadInput("this is a folder, not a file", file=path, remedy="name a file inside it")
    if not stat.S_ISREG(mode):
        raise BadInput(
            "this is not a regular file",
            found=_KINDS.get(stat.S_IFMT(mode), "something else"),
            allowed="a regular file",
            remedy="save what comes from it to a file first",
            file=path,
        )


def read_text(path: Path, most: int = LARGEST) -> tuple[str, str]:
    """Text of a UTF-8 file of at most `most` bytes, and the SHA-256 of its bytes."""
    content = read_bytes(path, most)
    return decode(content, file=path, line=None), hashlib.sha256(content).hexdigest()


class NotUtf8(UserWarning):
    """A file of another program whose text is not UTF-8, and how it was read."""


def read_other_text(path: Path, most: int = LARGEST) -> str:
    """Text of a file of another program, of at most `most` bytes: UTF-8, else as `decode_other`."""
    return decode_other(read_bytes(path, most), file=path)


def decode_other(content: bytes, *, file: Path) -> str:
    """UTF-8 text, or that of an older program with national letters: Windows-1252, else Latin-1, which a
    NotUtf8 warning says. BadInput for UTF-16, and for what is no text."""
    try:
        return decode(content, file=file, line=None)
    except BadInput:
        if b"\0" in content or content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            raise
    name = "Windows-1252"
    try:
        text = content.decode("cp1252")
    except UnicodeDecodeError:
        text, name = content.decode("latin-1"), "Latin-1"
    at = next(i for i, byte in enumerate(content) if byte > 127)
    line = content.count(b"\n", 0, at) + 1
    warnings.warn(
        f"{file.name} is not UTF-8 (line {line}). It is read as {name}: letters in its names may be others",
        NotUtf8,
        stacklevel=2,
    )
    return text


def decode(content: bytes, *, file: Path, line: int | None) -> str:
    """UTF-8 text (a byte order mark is left out); BadInput with the line of the first bad byte.

    `line` is the number of the line that `content` is; None for a whole file.
    """
    try:
        if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) or _is_utf16(content):
            raise BadInput(
                "the text is UTF-16",
                allowed="text in UTF-8",
                remedy="save the file as UTF-8 (Excel: CSV UTF-8)",
                file=file,
                line=line,
            )
        if content.startswith(_ZIP):
            raise BadInput(
                "this is an archive (a spreadsheet such as .ods, or a zip), not text",
                allowed="text in UTF-8",
                remedy="save the table as CSV (Excel: CSV UTF-8)",
                file=file,
                line=line,
            )
        if b"\0" in content:
            raise BadInput("this is a binary file, not text", file=file, line=line, allowed="text in UTF-8")
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        at = content.count(b"\n", 0, error.start) + 1 if line is None else line
        raise BadInput(
            "the text is not UTF-8",
            found=f"byte 0x{content[error.start]:02x}",
            allowed="text in UTF-8",
            remedy="save the file as UTF-8",
            file=file,
            line=at,
        ) from None


def _is_utf16(content: bytes) -> bool:
    """Whether nearly every other byte of the beginning is 0, as of Latin letters in UTF-16 without a mark."""
    head = content[:128]
    zeros = head[::2].count(0), head[1::2].count(0)
    return len(head) >= 8 and min(zeros) == 0 and max(zeros) > 0.8 * (len(head) // 2)


def _near_file(path: Path) -> str | None:
    try:
        names = [entry.name for entry in path.parent.iterdir()]
    except OSError:
        return f"the folder {path.parent} does not exist either"
    kind = _kind(path.name)
    # By their stems, for they share their ending.
    stems = {Path(name).stem: name for name in names if not kind or _kind(name) == kind}
    near = _nearest(path.stem, stems)
    return None if near is None else _meant(stems[near])


def _kind(name: str) -> str:
    """The ending of a file's name, one for the two of a format: a program is no answer to a missing plan."""
    suffix = Path(name).suffix.lower()
    return {".yml": ".yaml", ".json": ".jsonl"}.get(suffix, suffix)


# What people call a thing, and the word for it here, where that is among those allowed.
_MEANT: dict[str, str] = {
    **dict.fromkeys(("point", "position", "offset", "origin", "tip_mm", "tcp_mm", "ball_mm"), "point_mm"),
    **dict.fromkeys(("min", "lower_limit", "min_deg"), "lower_deg"),
    **dict.fromkeys(("max", "upper_limit", "max_deg"), "upper_deg"),
    **dict.fromkeys(("dh", "mdh", "craig"), "modified"),
    **dict.fromkeys(("classic", "distal"), "standard"),
    **dict.fromkeys(("postures", "poses", "joints"), "postures_deg"),
}


def also_called(name: str, words: Iterable[str]) -> None:
    """`did_you_mean` takes each of the words for `name`."""
    _MEANT.update(dict.fromkeys(words, name))


def did_you_mean(word: str, known: Iterable[str]) -> str | None:
    """'did you mean …?' where one of the known words is near, else None.

    Near is also the word without its unit (`a` for `a_mm`), and what people call the same thing (`ball`).
    """
    near = _nearest(word, known)
    return None if near is None else _meant(near)


def _meant(name: str) -> str:
    return f"did you mean {name!r}?"


def _nearest(word: str, known: Iterable[str]) -> str | None:
    known, low = list(known), word.lower()
    same = [name for name in known if name.lower() == low or name.rpartition("_")[0] == low]
    if meant := _MEANT.get(low):
        same += [name for name in known if name == meant]
    near = same or difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    return near[0] if near else None


def unknown_name(what: str, name: str, known: Sequence[str]) -> BadInput:
    """The error for a name that is none of those that are known."""
    return BadInput(what, found=name, allowed=", ".join(known), remedy=did_you_mean(name, known))


@dataclass(frozen=True)
class Document:
    """Plain values of a YAML file, and the line of each of their places."""

    data: Any
    file: Path
    sha256: str
    lines: Mapping[KeyPath, int]

    def line(self, key: KeyPath) -> int | None:
        """Line of a place, or of the nearest one around it (for a key that is missing)."""
        for length in range(len(key), -1, -1):
            if key[:length] in self.lines:
                return self.lines[key[:length]]
        return None


class _TooMany(Exception):
    """More values than a file may hold; the argument is the line."""


class _Bounded(Composer):
    """ruamel's composer; it ends at a number of nodes, each of which takes a kilobyte."""

    _left = 2 * MOST_VALUES  # keys are nodes too

    def compose_node(self, parent: Any, index: Any) -> Any:
        self._left -= 1
        if self._left < 0:
            raise _TooMany(self.parser.peek_event().start_mark.line + 1)
        return super().compose_node(parent, index)


def read_yaml(path: Path) -> Document:
    """One YAML 1.2 document whose top is a mapping."""
    text, sha256 = read_text(path, LARGEST_YAML)
    reader = YAML(typ="safe", pure=True)
    reader.Composer = _Bounded
    try:
        node = reader.compose(text)
    except _TooMany as error:
        raise BadInput(
            f"the file holds more than {MOST_VALUES} values", file=path, line=error.args[0]
        ) from None
    except MarkedYAMLError as error:
        if _begins_as_run(text):
            raise BadInput(
                "this is a run: JSON lines, not YAML",
                remedy=f"analyse it: zerobeam analyse {shlex.quote(path.as_posix())}",
                file=path,
            ) from None
        mark = error.problem_mark or error.context_mark
        raise BadInput(
            f"the file is not valid YAML: {error.problem or error.context}",
            file=path,
            line=None if mark is None else mark.line + 1,
        ) from None
    except (YAMLError, RecursionError, ValueError) as error:
        raise BadInput(f"the file is not valid YAML: {error}", file=path) from None
    if not isinstance(node, MappingNode):
        raise BadInput(
            "the file does not hold keys and values",
            allowed="a YAML mapping, such as 'robot: irb1600'",
            file=path,
            line=None if node is None else node.start_mark.line + 1,
        )
    lines: dict[KeyPath, int] = {(): node.start_mark.line + 1}
    return Document(_plain(node, (), path, lines), path, sha256, lines)


def _begins_as_run(text: str) -> bool:
    try:
        top = json.loads(text.lstrip().partition("\n")[0])
    except (ValueError, RecursionError):
        return False
    return isinstance(top, dict) and str(top.get("schema")).startswith("zerobeam/run/")


CORE_SCHEMA: tuple[tuple[re.Pattern[str], Callable[[str], Any]], ...] = (
    (re.compile(r"null|Null|NULL|~|"), lambda text: None),
    (re.compile(r"true|True|TRUE"), lambda text: True),
    (re.compile(r"false|False|FALSE"), lambda text: False),
    (re.compile(r"[-+]?[0-9]+"), int),
    (re.compile(r"0o[0-7]+"), lambda text: int(text, 8)),
    (re.compile(r"0x[0-9a-fA-F]+"), lambda text: int(text, 16)),
    (re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?"), float),
    (re.compile(r"[-+]?(\.inf|\.Inf|\.INF)|\.nan|\.NaN|\.NAN"), lambda text: math.nan),
)
TAGS = {f"tag:yaml.org,2002:{kind}" for kind in ("null", "bool", "int", "float", "str", "seq", "map")}
# Resolved from the look of plain text by YAML 1.1 habits; by the core schema of 1.2 it is just text.
TEXT_TAGS = {f"tag:yaml.org,2002:{kind}" for kind in ("timestamp", "value", "merge")}


def _plain(node: Node, path: KeyPath, file: Path, lines: dict[KeyPath, int]) -> Any:
    """Plain values of a node by the core schema (YAML 1.2.2, section 10.3)."""
    line = node.start_mark.line + 1
    if len(path) > DEEPEST:
        raise BadInput("the values are nested too deeply", file=file, line=line)
    if node.tag not in TAGS and not (isinstance(node, ScalarNode) and node.tag in TEXT_TAGS):
        raise BadInput("a YAML tag is not allowed here", found=node.tag, file=file, line=line)
    if isinstance(node, ScalarNode):
        return _scalar(node, file, line)
    if isinstance(node, SequenceNode):
        items = []
        for i, item in enumerate(node.value):
            _at(item, (*path, i), file, lines)
            items.append(_plain(item, (*path, i), file, lines))
        return items
    mapping: dict[str, object] = {}
    for key_node, value_node in node.value:
        key = _plain(key_node, path, file, {}) if isinstance(key_node, ScalarNode) else None
        line = key_node.start_mark.line + 1
        if not isinstance(key, str):
            raise BadInput(
                "a key must be text",
                found=shown(key) if isinstance(key_node, ScalarNode) else "a list or mapping",
                remedy="put it in quotes",
                file=file,
                line=line,
            )
        if key in mapping:
            raise BadInput(
                f"duplicate key {key!r}",
                found=f"first on line {lines[(*path, key)]}",
                allowed="each key once",
                remedy="remove one of them",
                file=file,
                line=line,
            )
        _at(key_node, (*path, key), file, lines)
        mapping[key] = _plain(value_node, (*path, key), file, lines)
    return mapping


def _at(node: Node, path: KeyPath, file: Path, lines: dict[KeyPath, int]) -> None:
    lines[path] = node.start_mark.line + 1
    if len(lines) > MOST_VALUES:
        # Aliases of aliases grow without bound in a file of a few lines.
        raise BadInput(f"the file holds more than {MOST_VALUES} values", file=file, line=lines[path])


def _scalar(node: ScalarNode, file: Path, line: int) -> Any:
    text: str = node.value
    if node.style is not None or node.tag in TEXT_TAGS:
        return text
    for pattern, value in CORE_SCHEMA:
        if pattern.fullmatch(text):
            try:
                result = value(text)
            except ValueError as error:
                raise BadInput(f"the number cannot be read: {error}", file=file, line=line) from None
            if isinstance(result, float) and not math.isfinite(result):
                raise _not_finite(text, file, line)
            return result
    return text


def _not_finite(text: str, file: Path, line: int | None) -> BadInput:
    return BadInput(
        "a number is not finite",
        found=text,
        allowed="finite numbers",
        remedy="leave out what was not measured",
        file=file,
        line=line,
    )


def parse_json(text: str, *, file: Path, line: int) -> Any:
    """Value of one line of JSON; `json.JSONDecodeError` if it is no JSON (a torn line, perhaps).

    BadInput for what is JSON to lenient readers only: a duplicate key, NaN, Infinity,
    a number too large for a float.
    """

    def once(pairs: list[tuple[str, object]]) -> dict[str, object]:
        result: dict[str, object] = {}
        for key, value in pairs:
            if key in result:
                raise BadInput(
                    f"duplicate key {key!r}",
                    allowed="each key once",
                    remedy="remove one of them",
                    file=file,
                    line=line,
                )
            result[key] = value
        return result

    def constant(word: str) -> Any:
        raise _not_finite(word, file, line)

    def number(digits: str) -> float:
        value = float(digits)
        if not math.isfinite(value):
            raise _not_finite(digits, file, line)
        return value

    def whole(digits: str) -> int:
        if not math.isfinite(float(digits)):
            raise _not_finite(f"{digits[:20]}…", file, line)
        return int(digits)

    try:
        return json.loads(
            text, object_pairs_hook=once, parse_constant=constant, parse_float=number, parse_int=whole
        )
    except RecursionError:
        raise BadInput("the values are nested too deeply", file=file, line=line) from None


def shown(value: object) -> str:
    """A value as in a JSON file, cut to a length that a message can carry."""
    try:
        text = json.dumps(value, ensure_ascii=False)
    except (TypeError, ValueError):
        text = str(value)
    return text if len(text) <= 70 else text[:69] + "…"


def require_schema(data: object, schema: Schema, *, file: Path, line: int | None) -> None:
    """Say which kind of file is wanted before its keys are judged one by one."""
    actual = data.get("schema") if isinstance(data, dict) else None
    if actual != schema:
        kind = schema.split("/")[1]
        raise BadInput(
            f"this is not a {kind} file of this version",
            found="no 'schema' key" if actual is None else f"schema: {shown(actual)}",
            allowed=f"schema: {schema}",
            remedy=f"give a {kind} file" if actual is not None else f"if this is a {kind} file, add the key",
            file=file,
            line=line,
        )


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
                remedy="remove the line if the recording broke off here" if rows else _run_instead(path),
                file=path,
                line=number,
            ) from None
    return rows, None


def _run_instead(path: Path) -> str:
    if path.suffix.lower() == ".csv":
        return f"make a run of it: zerobeam import csv {shlex.quote(path.as_posix())} … (--help says how)"
    return "give a run file (.jsonl)"


# Made once: json.dumps makes one for each line.
_ENCODER = json.JSONEncoder(ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def json_line(content: Mapping[str, object]) -> str:
    return _ENCODER.encode(content) + "\n"


def line_numbers(text: str) -> Callable[[int], int]:
    """A function that gives the line, from 1, of a position in the text; the text is looked through once.

    Examples
    --------
    >>> line_of = line_numbers("a\\nb\\n")
    >>> line_of(0), line_of(1), line_of(2), line_of(4)
    (1, 1, 2, 3)
    """
    starts = [0, *accumulate(len(line) for line in text.split("\n"))]
    starts = [start + k for k, start in enumerate(starts[:-1])]
    return lambda position: bisect_right(starts, position)
