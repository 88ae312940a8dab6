"""Positions of RAPID modules (ABB)."""

from __future__ import annotations

import re

import numpy as np

from ...model.arrays import Matrix
from ...model.kinematics.orientation import from_quaternion
from .position import NUMBER, BackupReading, SourceFile, What, numbers_in, pose_of, split_arguments

_UNUSED = 9e9  # of an external axis
_REST = r"(?<!PROC )(?<![\w\\.])"


def _row(count: int) -> str:
    return r"\s*\[" + ",".join([rf"\s*{NUMBER}\s*"] * count) + r"\]\s*"


_LITERAL = re.compile(rf"(?P<pose>\[{_row(3)},{_row(4)},{_row(4)},{_row(6)}\])|\[{_row(6)},{_row(6)}\]")
_FRAME = rf"\s*(\[{_row(3)},{_row(4)}\])"
_TOOL = re.compile(rf"\s*\[\s*(TRUE|FALSE)\s*,{_FRAME}", re.IGNORECASE)
_WOBJ = re.compile(
    rf'\s*\[\s*(TRUE|FALSE)\s*,\s*(TRUE|FALSE)\s*,\s*"[^"]*"\s*,{_FRAME}\s*,{_FRAME}', re.IGNORECASE
)
_DATA = re.compile(
    r"\b(?P<local>LOCAL\s+)?(?:CONST|PERS|VAR)\s+(?P<kind>robtarget|jointtarget|tooldata|wobjdata)\s+(?P<name>[A-Za-z]\w*)\s*"
    r"(?P<sizes>\{[\d\s,]*\})?\s*(?::=(?P<value>[^;]*))?;",
    re.IGNORECASE,
)
_WORDS = r"(?:Move|Trigg|Search|Arc|Spot|Paint|Disp|Nut|Glue)\w*\b(?=\s*[\\A-Z\[*])(?!\s*:=)"
_MOVE = re.compile(_REST + _WORDS, re.IGNORECASE)
_SHIFTED = re.compile(r"\b(PDispOn|PDispSet|EOffsOn|EOffsSet)\b", re.IGNORECASE)
_ADDED = re.compile(r"(Offs|RelTool)\s*\(\s*(\w+(?:\s*\{[^}]*\})?)\s*,(.*)\)", re.IGNORECASE | re.DOTALL)
_ASSIGNED = re.compile(r"(?<![\w.\\])([A-Za-z]\w*)\s*(?:\{[^{}]*\})?(?:\.\w+)*\s*:=")
_WORD = re.compile(r"[A-Za-z]\w*")


def read_rapid(reading: BackupReading) -> None:
    """All modules of a task: data first, then statements."""
    kinds: dict[str, str] = {}  # of what is declared, by its name in small letters
    for file in reading.files:
        reading.whole(file, r"^[ \t]*MODULE\b", r"\bENDMODULE\b")
        for data in _DATA.finditer(file.bare):
            _declared(file, data, reading, kinds)
    for file in reading.files:
        end, text = 0, _DATA.sub(lambda data: " " * (len(data[0]) - 1) + ";", file.bare)
        for match in re.finditer(";", text):
            _statement(file, text[end : match.start()], end, reading, kinds)
            end = match.end()


def _name(file: SourceFile, word: str, kinds: dict[str, str]) -> str:
    """A name as it is unique: LOCAL data are of their module alone, and hide those of others."""
    local = f"{file.name}:{word.strip().lower()}"
    return local if local in kinds else word.strip().lower()


def _declared(file: SourceFile, data: re.Match[str], reading: BackupReading, kinds: dict[str, str]) -> None:
    kind, name, value, pos = (
        data["kind"].lower(),
        data["name"].lower(),
        data["value"] or "",
        data.start("name"),
    )
    name = f"{file.name}:{name}" if data["local"] else name
    if kinds.setdefault(name, kind) != kind or (
        kind.endswith("target") and any(name == one.name for one in reading.positions)
    ):
        reading.refuse(file, pos, f"{data['name']} is declared twice: convert the backup of one task alone")
    if kind.endswith("target"):
        literals = list(_LITERAL.finditer(value))
        for number, literal in enumerate(literals, start=1):
            label = f"{data['name']}{{{number}}}" if data["sizes"] else data["name"]
            _position(file, literal, data.start("value"), name, label, reading)
        if re.sub(r"[\[\],\s]", "", _LITERAL.sub("", value)) or (value and not literals):
            reading.unread(file, pos, f"the numbers of {data['name']} are not understood", data["name"])
    elif value:
        tool, why, pose = kind == "tooldata", f"{data['name']} is not understood", None
        match = (_TOOL if tool else _WOBJ).match(value)
        if match is not None and (match[1].upper() == "TRUE") != tool:
            why = f"{data['name']} is a stationary tool, or work that the arm holds (remote TCP)"
        elif match is not None and not tool and match[2].upper() == "FALSE":
            why = f"{data['name']} is moved by an external unit"
        elif match is not None:
            outer, inner = _pose(match[2 if tool else 3]), np.eye(4) if tool else _pose(match[4])
            pose = None if outer is None or inner is None else outer @ inner
        reading.frame(file, pos, "tool" if tool else "frame", name, pose, why)


def _position(
    file: SourceFile, literal: re.Match[str], offset: int, name: str, label: str, reading: BackupReading
) -> None:
    pos = offset + literal.start()
    spans = numbers_in(literal[0], pos)
    values = [float(file.text[begin:end]) for begin, end in spans]
    external = [value for value in values[11 if literal["pose"] else 6 :] if value != _UNUSED]
    if not literal["pose"]:
        reading.add(file, pos, name, label, spans[:6], axes=range(6), external=external)
    elif any(values[3:7]):
        reading.add(file, pos, name, label, spans[:7], spans[7:11], external=external)
    else:
        reading.unread(file, pos, f"{label} has no orientation", label)


def _pose(text: str) -> Matrix | None:
    return pose_of(from_quaternion, [float(text[start:end]) for start, end in numbers_in(text)])


def _statement(
    file: SourceFile, text: str, start: int, reading: BackupReading, kinds: dict[str, str]
) -> None:
    for assigned in _ASSIGNED.finditer(text):
        name = _name(file, assigned[1], kinds)
        kind = kinds.get(name, "")
        if kind.endswith("target"):
            reading.overwrites(file, start + assigned.start(1), name, assigned[1])
        elif kind or name in ("tool0", "wobj0"):
            reading.refuse(file, start + assigned.start(1), f"{assigned[1]} is set when the program runs")
    if shifted := _SHIFTED.search(text):
        reading.refuse(file, start + shifted.start(), f"{shifted[0]} moves all targets when the program runs")
    if (move := _MOVE.search(text)) is not None:
        return _motion(file, text[move.start() :], start + move.start(), reading, kinds)
    for literal in _LITERAL.finditer(text):
        reading.refuse(file, start + literal.start(), "it is not said what this position is for")
    for word in _WORD.finditer(_ASSIGNED.sub(lambda assigned: " " * len(assigned[0]), text)):
        if kinds.get(_name(file, word[0], kinds), "").endswith("target"):
            reading.doubt(file, start + word.start(), "call", f"{word[0]} is used by this statement")
    return None


def _motion(file: SourceFile, text: str, start: int, reading: BackupReading, kinds: dict[str, str]) -> None:
    word = _WORD.match(text)
    assert word is not None
    parts = [
        (at, re.sub(r"^(\s*\\\w+)+\s*(?::=.*)?", "", part))
        for at, part in split_arguments(text[word.end() :])
    ]
    parts = [(start + word.end() + at, part.strip()) for at, part in parts if part.strip()]
    words = [part.split("\\")[0].strip() for _, part in parts[1:]]
    words = [_name(file, each, kinds) for each in words if _WORD.fullmatch(each)]
    tools = [each for each in words if kinds.get(each) == "tooldata" or each == "tool0"] or words[-1:]
    frame = re.search(r"\\\s*WObj\s*:=\s*(\w+)", text, re.IGNORECASE)
    count, moved = 2 if re.match(r"(?:Move|Trigg|Search|Arc)C", word[0], re.IGNORECASE) else 1, []
    for at, part in parts[:count] if not word[0].lower().startswith("moveext") else ():
        goal = part if "(" in part else part.split("\\")[0].strip()
        added = _ADDED.fullmatch(goal)
        name = re.sub(r"\s*\{.*", "", added[2] if added else goal)
        if (literal := _LITERAL.fullmatch(goal)) is not None:
            at = file.bare.index("[", at)
            name = f"{file.name}:{at}"
            _position(file, literal, at, name, f"line {file.line(at)}", reading)
        elif not _WORD.fullmatch(name) or ("(" in goal and added is None):
            reading.computed(file, at, goal)
            continue
        name = name if literal else _name(file, name, kinds)
        if added:
            numbers = [float(each) for each in re.findall(rf"(?<![\w.]){NUMBER}(?=\s*(?:,|$))", added[3])]
            plain = len(numbers) == 3 == added[3].count(",") + 1 and "\\" not in added[3]
            offset = (*numbers,) if plain else None
            axes: What = "tool" if added[1].lower() == "reltool" else "frame"
            reading.doubt(file, at, "relative", f"{added[1]} of {added[2]}", name, offset, axes)
        moved.append(name)
    return reading.moves(
        file, start, moved, tools[0] if tools else None, _name(file, frame[1], kinds) if frame else "wobj0"
    )
