"""Positions of KRL (KUKA): .src and .dat of one name, with tools and bases of $config.dat."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import PurePosixPath

from ...model.kinematics.orientation import from_abc
from .position import (
    NUMBER,
    BackupReading,
    FileReading,
    SourceFile,
    What,
    lines_in,
    pieces,
    pose_of,
    split_arguments,
    what_of,
)
from .script import LineProgram, PositionNames

_I = re.IGNORECASE
_FIELD = re.compile(rf"(?<![\w.$])([XYZABCST]|[AE][1-6])\s+({NUMBER})(?=\s*[,}}])", _I)
_LITERAL = re.compile(
    r"(?:(?P<name>[$\w]+(?:\[\s*\d+\s*,?\s*\])?)\s*=\s*)?"
    r"\{\s*(?:\w+\s*:)?(?P<fields>\s*(?:[XYZABCST]|[AE][1-6])\s[^{}]*)\}",
    _I,
)
_UNCLOSED = re.compile(r"(\w+(?:\[\d+\])?)\s*=\s*\{\s*(?:\w+\s*:\s*)?(?:A\d|X)\s[^{}]*(?=\{|\Z)", _I)
_FDAT = re.compile(r"\b(\w+)\s*=\s*\{[^{}]*?\bTOOL_NO\s+(-?\d+)\s*,\s*BASE_NO\s+(-?\d+)([^{}]*)", _I)
_MOVE = re.compile(r"\s*(S?PTP|S?LIN|S?CIRC|SPL|ASYPTP)(_REL)?\b\s*(?P<goals>.*)", _I)
_END = re.compile(r"\s+(?:C_PTP|C_DIS|C_VEL|C_ORI|C_SPL|WITH)\b.*", _I)
_SET = re.compile(r"\s*(?:\$(TOOL|BASE)(?:\.\w+)?\s*=|BAS\s*\(\s*#(TOOL|BASE)\s*,)\s*(.*?)\s*\)?\s*", _I)
_JUMP = re.compile(r"\s*(?:(?:IF|ELSE|SWITCH|CASE|LOOP|WHILE|REPEAT|FOR|GOTO|RESUME)\b|\w+:\s*$)", _I)
# Assignments without calls, parameters of motions, motions: what follows one of them is the next line.
_STRAIGHT = re.compile(
    r"\s*(?:(?!FDAT_ACT\s*\.)[$A-Z_]\w*(?:\[[^\]]*\])?(?:\s*\.\s*\w+)*\s*=(?!=)[^(]*"
    r"|BAS\s*\(\s*#(?:TOOL|BASE|FRAMES|(?:PTP|CP)_(?:PARAMS|DAT)|(?:VEL|ACC)_(?:PTP|CP))\b[^()]*\)"
    r"|S?(?:PTP|LIN|CIRC)\b[^(]*)\s*",
    _I,
)
# What may be carried out between any two lines, but for the handler of KUKA's own template.
_BETWEEN = re.compile(r"\bDO[ \t]+(?!IR_STOPM\b)\w+[ \t]*\(", _I)
_ASSIGNED = re.compile(r"\s*([A-Z_]\w*(?:\[[^\]]*\])?)((?:\s*\.\s*\w+)*)\s*=(?!=)\s*(.*?)\s*", _I)
_ADDED = re.compile(rf"(\w+)\.([XYZ])\s*([-+])\s*({NUMBER})", _I)
_NAME = re.compile(r"[A-Z_]\w*(?:\[[^\[\]]*\])?", _I)
_BEGIN = re.compile(r"^[ \t]*DEFDAT\b", _I | re.MULTILINE)
_END_OF_LIST = re.compile(r"^[ \t]*ENDDAT\b", _I | re.MULTILINE)
_ROUTINE = re.compile(r"^[ \t]*(?:GLOBAL[ \t]+)?DEF(?:FCT)?\b", _I | re.MULTILINE)
_POSE, _AXES = "XYZABC", [f"A{i}" for i in range(1, 7)]


def read_krl(reading: BackupReading) -> None:
    """Data lists and programs; of the controller's own lists $config.dat and $machine.dat alone."""
    files = [file for file in reading.files if file.stem in ("$config", "$machine") or file.stem[:1] != "$"]
    for file in files:
        KrlData(file, reading).read()
    stored = sorted({one.name for one in reading.positions})
    between = any(_BETWEEN.search(file.bare) for file in files)
    for file in (file for file in files if file.suffix != ".dat"):
        names = PositionNames(_NAME, scope=_scope(file).lower())
        for key in sorted(stored, key=lambda key: not key.startswith(f"{names.scope}:")):
            name = key.rpartition(":")[2]
            if name not in names.keys:  # those of its own list hide others
                names.store(key if name.isdecimal() else name, key)
        ours = sorted((each for each in files if _scope(each) in ("", _scope(file))), key=_scope)
        data = [fdat for each in ours for fdat in _FDAT.finditer(each.bare)]
        for begin, end in pieces(_ROUTINE, file.bare):
            routine = KrlRoutine(file, reading, names)
            routine.frames = {fdat[1].lower(): (fdat[2], fdat[3]) for fdat in data}
            if not between:
                routine.straight = _STRAIGHT
            routine.prepare(lines_in(file.bare, begin.start(), end, r"[^\n]+"))
            routine.run()


def _scope(file: SourceFile) -> str:
    return "" if file.stem == "$config" else str(PurePosixPath(file.name).with_suffix(""))


class KrlData(FileReading):
    """The literals of a file."""

    def read(self) -> None:
        """Positions, tools and bases, and what is not whole."""
        self.whole(r"^[ \t]*(?:GLOBAL[ \t]+)?DEF(?:FCT)?\b", r"^[ \t]*END(?:FCT)?\b")
        bare = self.file.bare
        for literal in _LITERAL.finditer(bare):
            self._literal(literal)
        for unclosed in _UNCLOSED.finditer(bare):
            self.unread(unclosed.start(), f"{unclosed[1]} has no }}", unclosed[1])
        if _BEGIN.search(bare) and not _END_OF_LIST.search(bare):
            self.unread(0, "the data list is incomplete: its last line, ENDDAT, is missing")
        for remote in re.finditer(r"(?:IPO_FRAME\s+|IPO_MODE\s*=\s*)#TCP\b", bare, _I):
            self.refuse(remote.start(), "#TCP: the arm holds the work (remote TCP)")

    def _literal(self, literal: re.Match[str]) -> None:
        file, pos, name = self.file, literal.start("fields"), literal["name"] or ""
        line_start = file.bare.rfind("\n", 0, pos) + 1
        fields = {match[1].upper(): match.span(2) for match in _FIELD.finditer(file.bare, pos, literal.end())}
        values = dict(zip(fields, self.numbers([*fields.values()]), strict=True))
        if file.bare.count("{", line_start, pos) - file.bare.count("}", line_start, pos) != 1:
            return None  # a part of load data and the like
        defined = re.fullmatch(r"\$?(TOOL|BASE|ROBROOT)(?:_DATA\[(\d+)\])?", name, _I)
        if defined is not None:
            pose = pose_of(from_abc, [values[key] for key in _POSE if key in values])
            if defined[1].upper() == "ROBROOT":
                self.reading.base = pose
                return None
            return self.frame(pos, what_of(defined[1]), defined[2] or f"{file.name}:{file.line(pos)}", pose)
        move = _MOVE.fullmatch(file.bare[line_start : file.bare.find("\n", pos) % (len(file.bare) + 1)])
        relative = move is not None and (move[2] or move[1].upper() == "ASYPTP")
        if file.stem == "$machine" or name[:1] == "$" or relative:
            return None
        label, key = name or f"line {file.line(pos)}", f"{_scope(file)}:{name or pos}".lower()
        external = [value for field, value in values.items() if field[0] == "E"]
        axes = [i for i, axis in enumerate(_AXES) if axis in fields]
        if (not name and move is None) or literal["fields"].count(",") + 1 != len(fields):
            return self.unread(pos, f"{label}: it is not said what this position is, or for", label)
        if axes and not set(fields) & set("XYZBC"):
            return self.add(pos, key, label, [fields[_AXES[i]] for i in axes], axes=axes, external=external)
        if set(_POSE) <= set(fields):
            spans, words = ([fields[each] for each in keys if each in fields] for keys in (_POSE, "ST"))
            return self.add(pos, key, label, spans, words, external=external)
        return self.doubt(pos, "relative", f"{label} states some components: the others are those before")


class KrlRoutine(LineProgram):
    """A routine of a program; `frames` are tool and base of its FDAT."""

    frames: Mapping[str, tuple[str, str]]
    jump = _JUMP

    def look(self, pos: int, text: str) -> None:
        for word in re.findall(r"\w+", text.lower()):
            if pair := self.frames.get(word):
                self.active.set("tool", pos, pair[0])
                self.active.set("frame", pos, pair[1])
        if (put := _SET.fullmatch(text)) is not None:
            data = re.fullmatch(r"(?:(?:TOOL|BASE)_DATA\[\s*)?(\d+)(?:\s*\])?", put[3], _I)
            name = "0" if put[3].upper() == "$NULLFRAME" else data[1] if data else None
            name = f"{self.file.name}:{self.file.line(pos)}" if put[3].startswith("{") else name
            self.active.set(what_of(put[1] or put[2]), pos, name)

    def statement(self, pos: int, text: str) -> None:
        assigned = _ASSIGNED.fullmatch(text)
        if (move := _MOVE.fullmatch(text)) is not None:
            self._motion(pos, move)
        elif assigned is None and text.lstrip()[:1] != "$":  # $H_POS=XHOME changes no position
            self.names.used(self, pos, text)
        elif assigned is not None and not assigned[3].startswith("{"):
            self._assigned(pos, assigned)

    def _assigned(self, pos: int, assigned: re.Match[str]) -> None:
        name = self.names.plain(assigned[1])
        stored = name in self.names.keys or self.names.elements(assigned[1])
        of_motion = name == "fdat_act" and assigned[2]
        if re.match(r"(?:TOOL|BASE)_(?:DATA|TYPE)\b", assigned[1], _I) or name in self.frames or of_motion:
            return self.refuse(pos, f"{assigned[1]} is set when the program runs")
        if stored or (not assigned[2] and self.names.stored_in(assigned[3])):
            self.names.changed(self, pos, assigned[1])
        elif (added := _ADDED.fullmatch(assigned[3])) is not None:
            offset = [float(added[3] + added[4]) * (axis == added[2].upper()) for axis in "XYZ"]
            self.relative(pos, f"{added[1]}: {assigned[3]}", (), offset, "frame")
        return None

    def _motion(self, pos: int, move: re.Match[str]) -> None:
        values = {key.upper(): float(value) for key, value in _FIELD.findall(move["goals"])}
        if move[1].upper() == "ASYPTP":
            return self.refuse(pos, "ASYPTP moves external axes")
        if move[2]:
            offset = [values.get(axis, 0.0) for axis in "XYZ"] if set(values) <= set("XYZ") else None
            axes: What = "tool" if re.search(r"#TOOL\b", move["goals"], _I) else "frame"
            return self.relative(pos, f"{move[1]}_REL", (), offset, axes)
        goals: list[str] = []
        for at, goal in split_arguments(_END.sub("", move["goals"])):
            word = goal.strip()
            if word.startswith("{"):
                start = self.file.bare.index("{", pos + move.start("goals") + at)
                goals += self.names.keys.get(f"{_scope(self.file)}:{start + 1}".lower(), [])
            elif not re.fullmatch(r"CA\s.*|\$(?:AXIS|POS)_ACT", word, _I):
                goals += self.names.goals(self, pos, word)
        return self.goes(pos + move.start(1), goals)
