"""Positions of AS programs and saved files (Kawasaki), with the tool and base of .SYSDATA."""

from __future__ import annotations

import re

from ...model.kinematics.orientation import from_zyz
from .position import NUMBER, Active, BackupReading, SourceFile, What, numbers_in, pose_of, split_arguments

_I = re.IGNORECASE
_SECTION = re.compile(r"\.([A-Z][A-Z0-9_]*)(?:[ \t].*|[ \t]*)", _I)
_INDEX = r"(?:\[[^\]]*\])?"
_ENTRY = re.compile(
    rf"[ \t]*(?P<name>#?[\w.$]+{_INDEX})[ \t]+"
    rf"(?P<values>{NUMBER}(?:(?:[ \t]*,[ \t]*|[ \t]+){NUMBER})*)[ \t]*",
    _I,
)
_SYSTEM = re.compile(rf"(TOOL|BASE)((?:[ \t]+{NUMBER}){{6}})[ \t]*", _I)
_MODEL = re.compile(r"^ZROBOT\.TYPE\b[^\n]*?[ \t]([A-Z]{2}\w+-\w+)", re.MULTILINE)
_MOVE = re.compile(r"(?:^|[ \t:])([JLHX]MOVE|C[12]MOVE|[JL]APPRO)2?[ \t]+(.+)", _I)
_STEP = re.compile(r"[ \t]*(?:\w+:)?[ \t]*([JL]DEPART2?|T?DRAW|DRIVE|ALIGN)\b[ \t]*(.*)", _I)
_BLOCK = re.compile(r"[ \t]*(?:JOINT|LINEAR|CIR[12]|FLINEAR)\b.*?(#\[[^\]]*\])", _I)
_SHAPE = re.compile(r"[ \t]*(RIGHTY|LEFTY|ABOVE|BELOW|[UD]WRIST)\b", _I)
_SET = re.compile(r"[ \t]*(TOOL|BASE)[ \t]+(.+?)[ \t]*", _I)
_SETS = re.compile(r"^[ \t]*(TOOL|BASE)[ \t]+(?![-+.\d \t])", _I | re.MULTILINE)
_JUMP = re.compile(
    r"[ \t]*(?:IF|ELSE|ELSEIF|FOR|WHILE|DO|UNTIL|CASE|VALUE|ANY|GOTO|\w+:)(?:[ \t]|$)|.*\bGOTO\b", _I
)
_STORES = re.compile(rf"[ \t]*(?:POINT(?:/\w+)?|HERE)[ \t]+([#.]*[\w.]+{_INDEX})(?:[ \t]*=[ \t]*(.*))?", _I)
_NAME = re.compile(rf"#?[.&]*[A-Z_][\w.]*{_INDEX}", _I)
_VALUES = rf"[ \t]*{NUMBER}(?:[ \t]*,[ \t]*{NUMBER})*[ \t]*"
_LITERAL = re.compile(rf"#\[{_VALUES}\]|(?:#PPOINT|TRANS)[ \t]*\({_VALUES}\)", _I)
_TRANS = re.compile(rf"TRANS[ \t]*\(([ \t]*{NUMBER}(?:[ \t]*,[ \t]*{NUMBER}){{5}})[ \t]*\)", _I)


def read_as(reading: BackupReading) -> None:
    """The sections of all files: data first, then programs."""
    stored: set[str] = set()
    programs = [(file, lines) for file in reading.files for lines in _sections(file, reading, stored)]
    for file, lines in programs:
        _program(file, lines, reading, stored)


def _sections(file: SourceFile, reading: BackupReading, stored: set[str]) -> list[list[re.Match[str]]]:
    """The lines of its programs; positions, tools and frames are added."""
    section = ""
    programs: list[list[re.Match[str]]] = []
    lines = [line for line in re.finditer(r"[^\r\n]+", file.bare) if not line[0].startswith(".*")]
    if (model := _MODEL.search(file.text)) is not None:
        reading.model = (file, file.line(model.start()), model[1])
    for line in lines:
        head = _SECTION.fullmatch(line[0])
        if head is not None and (section != "PROGRAM" or head[1].upper() in ("END", "PROGRAM")):
            section = "" if head[1].upper() == "END" else head[1].upper()
            programs += [[]] if section == "PROGRAM" else []
        elif section == "PROGRAM":
            programs[-1].append(line)
        elif section in ("TRANS", "JOINTS"):
            _entry(file, line, section == "JOINTS", reading, stored)
        elif section == "SYSDATA" and (system := _SYSTEM.fullmatch(line[0])) is not None:
            what: What = "tool" if system[1].upper() == "TOOL" else "frame"
            numbers = [float(each) for each in system[2].split()]
            reading.frame(file, line.start(), what, "sysdata", pose_of(from_zyz, numbers))
    if section in ("PROGRAM", "TRANS", "JOINTS"):
        reading.unread(file, len(file.text), f"the file ends before .END of .{section}")
    return programs


def _entry(
    file: SourceFile, line: re.Match[str], joints: bool, reading: BackupReading, stored: set[str]
) -> None:
    if not line[0].strip():
        return None
    entry = _ENTRY.fullmatch(line[0])
    if entry is None or entry["name"].startswith("#") != joints:
        return reading.unread(file, line.start(), "this position is not understood")
    spans = numbers_in(entry["values"], line.start() + entry.start("values"))
    name, label = _plain(entry["name"]), entry["name"]
    if len(spans) < 6:
        return reading.unread(file, line.start(), f"{label} has {len(spans)} numbers", label)
    if name in stored:
        reading.refuse(file, line.start(), f"{label} is listed twice: convert one saved file alone")
    stored.add(name)
    external = [float(file.text[slice(*span)]) for span in spans[6:]]
    if joints:
        return reading.add(file, line.start(), name, label, spans[:6], axes=range(6), external=external)
    return reading.add(file, line.start(), name, label, spans[:6], external=external, register=True)


def _plain(name: str) -> str:
    return re.sub(r"\s", "", name).lower()


def _program(file: SourceFile, lines: list[re.Match[str]], reading: BackupReading, stored: set[str]) -> None:
    active = Active()
    sets = {match[1].upper() for each in reading.files for match in _SETS.finditer(each.bare)}
    for line in lines:
        active.jumps |= _JUMP.match(line[0]) is not None
        if (put := _SET.fullmatch(line[0])) is not None:
            what: What = "tool" if put[1].upper() == "TOOL" else "frame"
            active.set(what, line.start(), _transform(file, line, put, what, reading))
    for line in lines:
        pos = line.start() + len(line[0]) - len(line[0].lstrip())
        # .SYSDATA holds what was set last: of a program that sets none it is known where none does.
        tool = active.at("tool", pos) or (None if "TOOL" in sets else "sysdata")
        frame = active.at("frame", pos) or (None if "BASE" in sets else "sysdata")
        _statement(file, pos, line, reading, stored, (tool, frame))


def _transform(
    file: SourceFile, line: re.Match[str], put: re.Match[str], what: What, reading: BackupReading
) -> str | None:
    """The name of a tool or base that a statement sets; None where it is computed."""
    name = _plain(put[2])
    if name == "null":
        return name
    if (literal := _TRANS.fullmatch(put[2])) is not None:
        name = f"{file.name}:{line.start()}"
        numbers = [float(each) for each in literal[1].split(",")]
        reading.frame(file, line.start(), what, name, pose_of(from_zyz, numbers))
        return name
    reading.added.add(name)
    poses = [one for one in reading.positions if one.name == name and one.kind == "cartesian"]
    if poses and (what, name) not in reading.frames:
        reading.frame(poses[0].file, poses[0].spans[0][0], what, name, pose_of(from_zyz, poses[0].values))
    return name if _NAME.fullmatch(put[2]) and not name.startswith(".") else None


def _statement(
    file: SourceFile,
    pos: int,
    line: re.Match[str],
    reading: BackupReading,
    stored: set[str],
    active: tuple[str | None, str | None],
) -> None:
    text = line[0]
    if (shape := _SHAPE.match(text)) is not None:
        return reading.refuse(file, pos, f"{shape[1]} changes the configuration of the next motion")
    if _SET.fullmatch(text):
        return None
    if (block := _BLOCK.match(text)) is not None:
        _goals(file, pos, block[1], reading, stored)
        return None
    if (move := _MOVE.search(text)) is not None:
        goal = next(split_arguments(move[2]))[1].split(" TILL ")[0].strip()
        names = _goals(file, pos, goal, reading, stored)
        if "APPRO" in move[1].upper():
            away = re.search(rf",[ \t]*({NUMBER})[ \t]*$", move[2])
            offset = (0.0, 0.0, -float(away[1])) if away else None
            start = names[0] if names else None
            reading.doubt(file, pos, "relative", f"{move[1]} {goal}", start, offset, "tool")
        return reading.moves(file, pos, names, *active)
    if (step := _STEP.match(text)) is not None:
        numbers = [float(each) for each in re.findall(rf"(?<![\w.]){NUMBER}(?=[ \t]*(?:,|$))", step[2])]
        plain = len(numbers) == step[2].count(",") + 1
        if "DEPART" in step[1].upper() and plain and len(numbers) == 1:
            return reading.doubt(file, pos, "relative", step[1], None, (0.0, 0.0, -numbers[0]), "tool")
        if "DRAW" in step[1].upper() and plain and len(numbers) == 3:
            axes: What = "tool" if step[1][0] in "tT" else "frame"
            return reading.doubt(file, pos, "relative", step[1], None, numbers, axes)
        return reading.doubt(file, pos, "relative", f"{step[1]} is a step from where the arm is")
    if re.match(r"[ \t]*HOME[2-9]?\b", text, _I):
        return reading.doubt(file, pos, "elsewhere", "HOME is stored in the controller: teach it again")
    if (store := _STORES.fullmatch(text)) is not None:
        name, value = _plain(store[1]), (store[2] or "").strip()
        if name not in stored and _LITERAL.fullmatch(value) and value.startswith("#") == name.startswith("#"):
            stored.add(name)
            at = file.bare.index(value, pos + len(store[1]))
            return _literal(file, at, value, name, store[1], reading)
        reading.overwrites(file, pos, name, store[1])
        return reading.moves(file, pos, _goals(file, pos, value, reading, stored) if value else [])
    rest = re.sub(r"^[ \t]*[\w.]+", "", text)
    for name in _NAME.findall(rest):
        if _plain(name) in stored:
            reading.doubt(file, pos, "call", f"{name} is used by this statement")
    return None


def _goals(file: SourceFile, pos: int, goal: str, reading: BackupReading, stored: set[str]) -> list[str]:
    """The names of a goal; of an array whose index is a variable all its elements."""
    name, at = _plain(goal), file.bare.index(goal, pos)
    if _LITERAL.fullmatch(goal) is not None:
        name = f"{file.name}:{at}"
        _literal(file, at, goal, name, f"line {file.line(at)}", reading)
        return [name]
    if goal.startswith("#["):
        reading.unread(file, at, "this position is not understood")
        return []
    if _NAME.fullmatch(goal) is None:
        reading.computed(file, pos, goal)
        reading.added |= {_plain(each) for each in _NAME.findall(goal)} & stored
        return []
    if "[" in name and name not in stored and not re.fullmatch(r"[^\[]*\[[\d,]+\]", name):
        reading.computed(file, pos, goal)
        return sorted(each for each in stored if each.startswith(name.partition("[")[0] + "["))
    return [name]


def _literal(file: SourceFile, at: int, text: str, name: str, label: str, reading: BackupReading) -> None:
    begin = re.search(r"[(\[]", text)
    assert begin is not None
    spans = numbers_in(text[begin.end() :], at + begin.end())
    external = [float(file.text[slice(*span)]) for span in spans[6:]]
    axes = range(6) if text.startswith("#") else None
    if len(spans) < 6:
        return reading.unread(file, at, f"{label} has {len(spans)} numbers", label)
    return reading.add(file, at, name, label, spans[:6], axes=axes, external=external)
