"""Positions of KRL (KUKA): .src and .dat of one name, with tools and bases of $config.dat."""

from __future__ import annotations

import re
from pathlib import PurePosixPath

from ...model.kinematics.orientation import from_abc
from .position import NUMBER, Active, BackupReading, SourceFile, What, pose_of, split_arguments

_I = re.IGNORECASE
_FIELD = re.compile(rf"(?<![\w.$])([XYZABCST]|[AE][1-6])\s+({NUMBER})(?=\s*[,}}])", _I)
_LITERAL = re.compile(
    r"(?:(?P<name>[$\w]+(?:\[\s*\d+\s*,?\s*\])?)\s*=\s*)?"
    r"\{\s*(?:\w+\s*:)?(?P<fields>\s*(?:[XYZABCST]|[AE][1-6])\s[^{}]*)\}",
    _I,
)
_UNCLOSED = re.compile(r"(\w+(?:\[\d+\])?)\s*=\s*\{\s*(?:\w+\s*:\s*)?(?:A\d|X)\s[^{}]*(?=\{|\Z)", _I)
_FDAT = re.compile(r"\b(\w+)\s*=\s*\{[^{}]*?\bTOOL_NO\s+(-?\d+)\s*,\s*BASE_NO\s+(-?\d+)([^{}]*)", _I)
_REMOTE = re.compile(r"(?:IPO_FRAME\s+|IPO_MODE\s*=\s*)#TCP\b", _I)
_MOVE = re.compile(r"\s*(S?PTP|S?LIN|S?CIRC|SPL|ASYPTP)(_REL)?\b\s*(?P<goals>.*)", _I)
_END = re.compile(r"\s+(?:C_PTP|C_DIS|C_VEL|C_ORI|C_SPL|WITH)\b.*", _I)
_SET = re.compile(r"\s*(?:\$(TOOL|BASE)\s*=|BAS\s*\(\s*#(TOOL|BASE)\s*,)\s*(.*?)\s*\)?\s*", _I)
_JUMP = re.compile(
    r"\s*(?:(?:IF|ELSE|SWITCH|CASE|LOOP|WHILE|REPEAT|FOR|GOTO|INTERRUPT|RESUME)\b|\w+:\s*$)", _I
)
_ASSIGNED = re.compile(r"\s*([A-Z_]\w*(?:\[[^\]]*\])?)((?:\.\w+)*)\s*=(?!=)\s*(.*?)\s*", _I)
_ADDED = re.compile(rf"(\w+)\.([XYZ])\s*([-+])\s*({NUMBER})", _I)
_NAME = re.compile(r"[A-Z_]\w*(?:\[\s*\d+\s*\])?", _I)
_BEGIN = re.compile(r"^[ \t]*DEFDAT\b", _I | re.MULTILINE)
_END_OF_LIST = re.compile(r"^[ \t]*ENDDAT\b", _I | re.MULTILINE)
_POSE, _AXES = "XYZABC", [f"A{i}" for i in range(1, 7)]


def read_krl(reading: BackupReading) -> None:
    """Data lists and programs; of the controller's own lists $config.dat and $machine.dat alone."""
    frames: dict[str, tuple[str, str]] = {}  # tool and base of FDAT, by scope and name
    files = [file for file in reading.files if file.stem in ("$config", "$machine") or file.stem[:1] != "$"]
    for file in files:
        frames |= {
            f"{_scope(file)}:{fdat[1]}".lower(): (fdat[2], fdat[3]) for fdat in _FDAT.finditer(file.bare)
        }
        reading.whole(file, r"^[ \t]*(?:GLOBAL[ \t]+)?DEF(?:FCT)?\b", r"^[ \t]*END(?:FCT)?\b")
        for literal in _LITERAL.finditer(file.bare):
            _literal(file, literal, reading)
        for unclosed in _UNCLOSED.finditer(file.bare):
            reading.unread(file, unclosed.start(), f"{unclosed[1]} has no }}", unclosed[1])
        if _BEGIN.search(file.bare) and not _END_OF_LIST.search(file.bare):
            reading.unread(file, 0, "the data list is incomplete: its last line, ENDDAT, is missing")
        for remote in _REMOTE.finditer(file.bare):
            reading.refuse(file, remote.start(), "#TCP: the arm holds the work (remote TCP)")
    names = {one.name for one in reading.positions}
    for file in files:
        lines = list(re.finditer(r"[^\n]+", file.bare)) if file.suffix != ".dat" else []
        starts = [
            i for i, line in enumerate(lines) if re.match(r"\s*(?:GLOBAL\s+)?DEF(?:FCT)?\b", line[0], _I)
        ]
        for begin, end in zip(starts, [*starts[1:], len(lines)], strict=False):
            _routine(file, lines[begin:end], reading, frames, names)


def _scope(file: SourceFile) -> str:
    return "" if file.stem == "$config" else str(PurePosixPath(file.name).with_suffix(""))


def _key(name: str, file: SourceFile, names: set[str]) -> str:
    """Of its own data list, else of another."""
    name = re.sub(r"\s", "", name).lower()
    local = f"{_scope(file)}:{name}".lower()
    return next((key for key in (local, *sorted(names)) if key in names and key.endswith(f":{name}")), local)


def _literal(file: SourceFile, literal: re.Match[str], reading: BackupReading) -> None:
    pos, name = literal.start("fields"), literal["name"]
    line_start = file.bare.rfind("\n", 0, pos) + 1
    fields = {match[1].upper(): match.span(2) for match in _FIELD.finditer(file.bare, pos, literal.end())}
    values = {key: float(file.text[slice(*span)]) for key, span in fields.items()}
    if file.bare.count("{", line_start, pos) - file.bare.count("}", line_start, pos) != 1:
        return None  # a part of load data and the like
    defined = re.fullmatch(r"\$?(TOOL|BASE|ROBROOT)(?:_DATA\[(\d+)\])?", name or "", _I)
    if defined is not None:
        pose = pose_of(from_abc, [values[key] for key in _POSE]) if set(_POSE) <= set(values) else None
        if defined[1].upper() == "ROBROOT":
            reading.base = pose
            return None
        what: What = "tool" if defined[1].upper() == "TOOL" else "frame"
        return reading.frame(file, pos, what, defined[2] or f"{file.name}:{file.line(pos)}", pose)
    move = _MOVE.fullmatch(file.bare[line_start : file.bare.find("\n", pos) % (len(file.bare) + 1)])
    if file.stem == "$machine" or (name or "")[:1] == "$" or (move is not None and move[2]):
        return None
    label, key = name or f"line {file.line(pos)}", f"{_scope(file)}:{name or pos}".lower()
    external = [value for field, value in values.items() if field[0] == "E"]
    axes = [i for i, axis in enumerate(_AXES) if axis in fields]
    if move is not None and move[1].upper() == "ASYPTP":
        return None
    if (name is None and move is None) or literal["fields"].count(",") + 1 != len(fields):
        return reading.unread(file, pos, f"{label}: it is not said what this position is, or for", label)
    if axes and not set(fields) & set("XYZBC"):
        return reading.add(
            file, pos, key, label, [fields[_AXES[i]] for i in axes], axes=axes, external=external
        )
    if set(_POSE) <= set(fields):
        configuration = [fields[each] for each in "ST" if each in fields]
        return reading.add(
            file, pos, key, label, [fields[each] for each in _POSE], configuration, external=external
        )
    return reading.doubt(
        file, pos, "relative", f"{label} states some components: the others are those before"
    )


def _routine(
    file: SourceFile,
    lines: list[re.Match[str]],
    reading: BackupReading,
    frames: dict[str, tuple[str, str]],
    names: set[str],
) -> None:
    active = Active()
    for line in lines:
        active.jumps |= _JUMP.match(line[0]) is not None
        for word in re.findall(r"\w+", line[0].lower()):
            if pair := frames.get(f"{_scope(file)}:{word}".lower(), frames.get(f":{word}")):
                active.set("tool", line.start(), pair[0])
                active.set("frame", line.start(), pair[1])
        if (put := _SET.fullmatch(line[0])) is not None:
            data = re.fullmatch(r"(?:(?:TOOL|BASE)_DATA\[\s*)?(\d+)(?:\s*\])?", put[3], _I)
            name = "0" if put[3].upper() == "$NULLFRAME" else data[1] if data else None
            name = f"{file.name}:{file.line(line.start())}" if put[3].startswith("{") else name
            active.set("tool" if (put[1] or put[2]).upper() == "TOOL" else "frame", line.start(), name)
    for line in lines:
        assigned, pos = _ASSIGNED.fullmatch(line[0]), line.start() + len(line[0]) - len(line[0].lstrip())
        if (move := _MOVE.fullmatch(line[0])) is not None:
            _motion(file, pos, move, reading, active, names)
        elif assigned is not None and not assigned[3].startswith("{"):
            sources = [_key(word, file, names) for word in _NAME.findall(assigned[3])]
            added = _ADDED.fullmatch(assigned[3])
            if _key(assigned[1], file, names) in names or (not assigned[2] and set(sources) & names):
                reading.overwrites(file, pos, _key(assigned[1], file, names), assigned[1])
            elif added is not None:
                offset = tuple(float(added[3] + added[4]) * (axis == added[2].upper()) for axis in "XYZ")
                reading.doubt(file, pos, "relative", f"{added[1]}: {assigned[3]}", None, offset, "frame")


def _motion(
    file: SourceFile, pos: int, move: re.Match[str], reading: BackupReading, active: Active, names: set[str]
) -> None:
    values = {key.upper(): float(value) for key, value in _FIELD.findall(move["goals"])}
    if move[1].upper() == "ASYPTP":
        return reading.refuse(file, pos, "ASYPTP moves external axes")
    if move[2]:
        offset = tuple(values.get(axis, 0.0) for axis in "XYZ") if set(values) <= set("XYZ") else None
        axes: What = "tool" if re.search(r"#TOOL\b", move["goals"], _I) else "frame"
        return reading.doubt(file, pos, "relative", f"{move[1]}_REL", None, offset, axes)
    goals: list[str] = []
    for at, goal in split_arguments(_END.sub("", move["goals"])):
        word = goal.strip()
        if word.startswith("{"):
            start = file.bare.index("{", pos + move.start("goals") - move.start(1) + at)
            if any(one.name == f"{_scope(file)}:{start + 1}".lower() for one in reading.positions):
                goals.append(f"{_scope(file)}:{start + 1}".lower())
        elif _NAME.fullmatch(word):
            goals.append(_key(word, file, names))
        elif not re.fullmatch(r"CA\s.*|\$(?:AXIS|POS)_ACT", word, _I):
            reading.computed(file, pos, word)
    return reading.moves(file, pos, goals, active.at("tool", pos), active.at("frame", pos))
