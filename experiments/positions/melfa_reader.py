"""Positions of MELFA-BASIC programs (Mitsubishi), with the variables that are saved behind them."""

from __future__ import annotations

import re

from ...model.kinematics.orientation import from_rpy
from .position import NUMBER, Active, BackupReading, SourceFile, What, numbers_in, pose_of, split_arguments

_I = re.IGNORECASE
_VALUES = rf"\([ \t]*{NUMBER}(?:[ \t]*,[ \t]*{NUMBER})*[ \t]*\)"
_FLAGS = r"(?:[ \t]*\([ \t]*\d+[ \t]*,[ \t]*\d+[ \t]*\))?"
_LITERAL = re.compile(rf"({_VALUES})({_FLAGS})")
_NAME = r"[PJ][A-Z0-9]\w*|[PJ](?=[ \t]*\()"
_INDEX = r"(?:[ \t]*\([^()]*\))?"
_LINE = re.compile(r"(?m)^[ \t]*(?:\d+[ \t]+)?([^\r\n]*?)[ \t]*\r?$")
_STORED = re.compile(rf"({_NAME})({_INDEX})[ \t]*=[ \t]*(\(.*)", _I)
_STORES = re.compile(rf"({_NAME})({_INDEX})(?:\.\w+)?[ \t]*=[ \t]*(.*)", _I)
_MOVE = re.compile(r"(?:^|[ \t:])(Mov|Mvs|Mvr[23]?|Mvc|Mva)[ \t]+(.+)", _I)
_TOOL = re.compile(r"Tool[ \t]+(.+)", _I)
_SET = re.compile(
    r"(Base\b(?![ \t]+P_NBase[ \t]*$)|M_(?:Tool|BsNo|BTool)\b.*=|P_\w+[ \t]*=|MExB?Tl|Cmp\b"
    r"|(?:Def[ \t]+)?Plt\b)",
    _I,
)
_JUMP = re.compile(r"(?:\*\w|(?:If|Else|ElseIf|For|While|Select|Case|On|Return)\b)|.*\bGo(?:To|Sub)\b", _I)
_WORD = re.compile(rf"(?<![\w.])(?:{_NAME}){_INDEX}", _I)
_ADDED = re.compile(rf"((?:{_NAME}){_INDEX})[ \t]*([+*])[ \t]*((?:{_NAME}){_INDEX})", _I)


def read_melfa(reading: BackupReading) -> None:
    """Each program has variables of its own."""
    for file in reading.files:
        stored: dict[str, str] = {}  # names in the backup by those of the program
        lines = [line for line in _LINE.finditer(file.bare) if line[1]]
        for line in lines:
            if (entry := _STORED.fullmatch(line[1])) is not None:
                _entry(file, line.start(1), entry, reading, stored)
        active = Active()
        for line in lines:
            active.jumps |= _JUMP.match(line[1]) is not None
            if (put := _TOOL.fullmatch(line[1])) is not None:
                active.set("tool", line.start(), _tool(file, line.start(1), put[1], reading, stored))
        for line in lines:
            _statement(file, line.start(1), line[1], reading, stored, active.at("tool", line.end()))


def _plain(name: str) -> str:
    return re.sub(r"\s", "", name).lower()


def _entry(
    file: SourceFile, pos: int, entry: re.Match[str], reading: BackupReading, stored: dict[str, str]
) -> None:
    label, literal = f"{entry[1]}{entry[2]}", _LITERAL.fullmatch(entry[3])
    name = _plain(label)
    if literal is None:
        if re.fullmatch(r"\([-+.\d\s,*#]*\)?.*", entry[3]) and not re.search(r"[A-Z]", entry[3], _I):
            reading.unread(file, pos, f"{label}: this position is not understood", label)
        return None
    if name in stored:
        return reading.refuse(file, pos, f"the program overwrites the stored position {label}")
    stored[name] = f"{file.name}:{name}"
    return _literal(file, pos + entry.start(3), literal, stored[name], label, reading)


def _literal(
    file: SourceFile, pos: int, literal: re.Match[str], name: str, label: str, reading: BackupReading
) -> None:
    spans = numbers_in(literal[1], pos + literal.start(1))
    flags = numbers_in(literal[2], pos + literal.start(2))
    external = [float(file.text[slice(*span)]) for span in spans[6:]]
    if len(spans) < 6:
        return reading.unread(file, pos, f"{label} has {len(spans)} numbers", label)
    if label[0] in "jJ" and not flags:
        return reading.add(file, pos, name, label, spans[:6], axes=range(6), external=external, register=True)
    if len(flags) != 2 or label[0] in "jJ" or float(file.text[slice(*flags[1])]):
        return reading.unread(file, pos, f"{label}: turns of joints, or no flags, are not understood", label)
    register = name.endswith(f":{_plain(label)}")
    return reading.add(
        file, pos, name, label, spans[:6], flags, external=external, register=register, frame="0"
    )


def _tool(
    file: SourceFile, pos: int, text: str, reading: BackupReading, stored: dict[str, str]
) -> str | None:
    """The name of a tool that is set; None where that is computed."""
    name, numbers = stored.get(_plain(text), ""), []
    if text.upper() == "P_NTOOL":
        return "p_ntool"
    if (literal := _LITERAL.fullmatch(text)) is not None:
        name = f"{file.name}:tool{pos}"
        numbers = [float(literal[1][slice(*span)]) for span in numbers_in(literal[1])][:6]
    elif name:
        reading.added.add(name)
        numbers = [each for one in reading.positions if one.name == name for each in one.values][:6]
    if len(numbers) == 6 and ("tool", name) not in reading.frames:
        reading.frame(file, pos, "tool", name, pose_of(from_rpy, numbers))
    return name or None


def _statement(
    file: SourceFile,
    pos: int,
    text: str,
    reading: BackupReading,
    stored: dict[str, str],
    tool: str | None,
) -> None:
    if (run_time := _SET.match(text)) is not None:
        return reading.refuse(
            file, pos, f"{run_time[1]}: tools, frames or pallets are set when the program runs"
        )
    if _TOOL.fullmatch(text) or ((entry := _STORED.fullmatch(text)) and _LITERAL.fullmatch(entry[3])):
        return None
    if (move := _MOVE.search(text)) is not None:
        goals: list[str] = []
        parts = re.split(r"[ \t](?:Wth(?:If)?|Type)\b", move[2], flags=_I)[0]
        for at, part in split_arguments(parts):
            goal, begin = part.strip(), pos + move.start(2) + at + len(part) - len(part.lstrip())
            if re.fullmatch(NUMBER, goal) and goals:
                reading.doubt(file, pos, "relative", text[:40], goals[-1], (0.0, 0.0, float(goal)), "tool")
            else:
                goals += _goals(file, begin, goal, reading, stored)
        return reading.moves(file, pos, goals, tool)
    if (store := _STORES.fullmatch(text)) is not None:
        name = _plain(f"{store[1]}{store[2]}")
        if store[2] and not re.fullmatch(r"\([\d,]+\)", _plain(store[2])):
            return reading.refuse(
                file, pos, f"{store[1]}{store[2]}: which position is overwritten is not known"
            )
        reading.overwrites(file, pos, stored.get(name, f"{file.name}:{name}"), f"{store[1]}{store[2]}")
        return reading.moves(file, pos, _goals(file, pos + store.start(3), store[3].strip(), reading, stored))
    for word in _WORD.findall(text):
        if _plain(word) in stored:
            reading.doubt(file, pos, "call", f"{word} is used by this statement")
    return None


def _added(
    file: SourceFile, pos: int, sum_: re.Match[str], reading: BackupReading, stored: dict[str, str]
) -> list[str]:
    """A + B has the components of both, A * B is B in the axes of the tool at A."""
    goals, key = _goals(file, pos, sum_[1], reading, stored), stored.get(_plain(sum_[3]), "")
    reading.added.add(key)
    values = [each for one in reading.positions if one.name == key for each in one.values]
    offset = values[:3] if values and not any(values[3:]) else None
    axes: What = "tool" if sum_[2] == "*" else "frame"
    reading.doubt(file, pos, "relative", sum_[0][:40], goals[0] if goals else None, offset, axes)
    return goals


def _goals(
    file: SourceFile, pos: int, goal: str, reading: BackupReading, stored: dict[str, str]
) -> list[str]:
    """The names of a goal; of an array whose index is a variable all its elements."""
    name = _plain(goal)
    if (literal := _LITERAL.fullmatch(goal)) is not None:
        _literal(file, pos, literal, f"{file.name}:{pos}", f"line {file.line(pos)}", reading)
        return [f"{file.name}:{pos}"]
    if (sum_ := _ADDED.fullmatch(goal)) is not None:
        return _added(file, pos, sum_, reading, stored)
    if _WORD.fullmatch(goal) is None:
        reading.computed(file, pos, goal)
        reading.added |= {stored[_plain(word)] for word in _WORD.findall(goal) if _plain(word) in stored}
        return []
    if "(" in name and not re.fullmatch(r"\w+\([\d,]+\)", name):
        reading.computed(file, pos, goal)
        return sorted(each for key, each in stored.items() if key.startswith(name.partition("(")[0] + "("))
    return [stored.get(name, f"{file.name}:{name}")]
