"""ABB: jointtargets that are declared in a RAPID module."""

from __future__ import annotations

import ast
import re
from collections.abc import Sequence
from pathlib import Path

from ...model.errors import BadInput
from ...model.files.reading import shown
from .imported import Imported, Stated
from .taught import Point, import_points

# CONST jointtarget p1:=[[rax_1,…,rax_6],[eax_a,…,eax_f]]; an array has its size in braces.
DECLARED = re.compile(
    r"\b(?:CONST|PERS|VAR)\s+(?P<kind>jointtarget|robtarget|tooldata|wobjdata)\s+(?P<name>[A-Za-z]\w*)\s*"
    r"(?P<sizes>\{[\d\s,]*\})?\s*:=(?P<value>[^;]*);",
    re.IGNORECASE,
)
_TEXT = re.compile(r'"[^"\n]*"|![^\n]*')  # strings and comments
_NUMBERS = re.compile(r"[\[\]\s,0-9eE+.\-]*")
_AXES = 6


def import_rapid(
    files: Sequence[Path | str],
    target_names: Sequence[str],
    stated: Stated,
    out: Path | str,
    *,
    points: Sequence[str] | None = None,
) -> Imported:
    """Measurements at the jointtargets of RAPID modules; `points` are the names of those to use.

    An element of an array has the name `name{2}`. External axes are ignored.
    """
    return import_points(
        files,
        target_names,
        rapid_positions,
        stated,
        out,
        names=points,
        note="RAPID jointtargets, angles in degrees, rax_1 first, external axes ignored",
    )


def rapid_positions(text: str, path: Path) -> list[Point]:
    """All declared jointtargets and robtargets of a module, in its order; a robtarget has no joints."""
    bare = without_text(text)
    found: list[Point] = []
    for match in DECLARED.finditer(bare):
        if match["kind"].lower() not in ("jointtarget", "robtarget"):
            continue
        line = bare.count("\n", 0, match.start("name")) + 1
        name, cartesian = match["name"], match["kind"].lower() == "robtarget"
        values = _values(match["value"], name, path, line)
        if match["sizes"] is None:
            found.append(Point(name, None if cartesian else _axes(values, name, path, line), line))
            continue
        if "," in match["sizes"] or not isinstance(values, list):
            raise _unreadable(name, match["value"], path, line)
        for i, element in enumerate(values, start=1):
            own = f"{name}{{{i}}}"
            found.append(Point(own, None if cartesian else _axes(element, own, path, line), line))
    return found


def without_text(text: str) -> str:
    """The program with blanks for its strings and comments."""
    return _TEXT.sub(lambda found: " " * len(found[0]), text)


def _values(text: str, name: str, path: Path, line: int) -> object:
    if _NUMBERS.fullmatch(text):
        try:
            value: object = ast.literal_eval(text.strip())
        except (ValueError, SyntaxError, RecursionError, MemoryError):
            pass
        else:
            return value
    raise _unreadable(name, text, path, line)


def _axes(value: object, name: str, path: Path, line: int) -> tuple[float, ...]:
    if isinstance(value, list) and len(value) == 2 and isinstance(value[0], list):
        axes = value[0]
        if len(axes) == _AXES and all(isinstance(axis, int | float) for axis in axes):
            return tuple(float(axis) for axis in axes)
    raise _unreadable(name, str(value), path, line)


def _unreadable(name: str, text: str, path: Path, line: int) -> BadInput:
    return BadInput(
        f"the axes of {name} cannot be read",
        found=shown(" ".join(text.split())[:80]),
        allowed="[[rax_1,…,rax_6],[eax_a,…,eax_f]], in numbers",
        file=path,
        line=line,
    )
