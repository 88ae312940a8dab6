"""Positions of AS programs and saved files (Kawasaki), with the tool and base of .SYSDATA."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ...model.kinematics.orientation import from_zyz
from .position import (
    NUMBER,
    WHAT,
    BackupReading,
    FileReading,
    Lines,
    What,
    numbers_in,
    parts_of,
    pose_of,
    values_in,
    what_of,
)
from .script import LineProgram, SharedNames

_I = re.IGNORECASE
_SECTION = re.compile(r"\.([A-Z][A-Z0-9_]*)(?:[ \t].*|[ \t]*)", _I)
_INDEX = r"(?:\[[^\]]*\])?"
_ENTRY = re.compile(
    rf"[ \t]*(?P<name>#?[\w.$]+{_INDEX})[ \t]+(?P<values>{NUMBER}(?:[ \t]*[, \t][ \t]*{NUMBER})*)[ \t]*", _I
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
_STORES = re.compile(
    rf"[ \t]*(?:POINT(?:/\w+)?|HERE)[ \t]+([#.]*[\w.]+{_INDEX})(?:[ \t]*=[ \t]*(.*?))?[ \t]*", _I
)
_NAME = re.compile(rf"#?[.&]*[A-Z_][\w.]*{_INDEX}", _I)
_VALUES = rf"[ \t]*{NUMBER}(?:[ \t]*,[ \t]*{NUMBER})*[ \t]*"
_NUMBERS = re.compile(rf"{NUMBER}(?:[ \t]*,[ \t]*{NUMBER})*")


def read_as(reading: BackupReading) -> None:
    """The sections of all files: data first, then programs."""
    names = SharedNames(_NAME)
    files = [FileReading(file, reading) for file in reading.files]
    programs = [(here, lines) for here in files for lines in _sections(here, names)]
    for here, lines in programs:
        program = AsProgram(here.file, reading, names)
        program.prepare(lines)
        program.run()


def _sections(here: FileReading, names: SharedNames) -> list[Lines]:
    """The lines of its programs; positions, tools and frames are added."""
    section, file = "", here.file
    programs: list[Lines] = []
    lines = [line for line in re.finditer(r"[^\r\n]+", file.bare) if not line[0].startswith(".*")]
    if (model := _MODEL.search(file.text)) is not None:
        here.reading.model = (file, file.line(model.start()), model[1])
    for line in lines:
        head = _SECTION.fullmatch(line[0])
        if head is not None and (section != "PROGRAM" or head[1].upper() in ("END", "PROGRAM")):
            section = "" if head[1].upper() == "END" else head[1].upper()
            programs += [[]] if section == "PROGRAM" else []
        elif section == "PROGRAM":
            programs[-1].append((line.start(), line[0]))
        elif section in ("TRANS", "JOINTS") and line[0].strip():
            _entry(here, line.start(), line[0], section == "JOINTS", names)
        elif section == "SYSDATA" and (system := _SYSTEM.fullmatch(line[0])) is not None:
            here.frame(line.start(), what_of(system[1]), "sysdata", pose_of(from_zyz, values_in(system[2])))
    if section in ("PROGRAM", "TRANS", "JOINTS"):
        here.unread(len(file.text), f"the file ends before .END of .{section}")
    return programs


def _entry(here: FileReading, pos: int, text: str, joints: bool, names: SharedNames) -> None:
    entry = _ENTRY.fullmatch(text)
    if entry is None or entry["name"].startswith("#") != joints:
        return here.unread(pos, "this position is not understood")
    spans, label = numbers_in(entry["values"], pos + entry.start("values")), entry["name"]
    name = names.plain(label)
    if len(spans) >= 6 and name in names.keys:
        here.refuse(pos, f"{label} is listed twice: convert one saved file alone")
    elif len(spans) >= 6:
        names.store(label, name)
    return here.six(pos, name, label, spans, joints=joints, register=not joints)


class AsProgram(LineProgram):
    """A program, with the names of all files."""

    jump = _JUMP
    literal = re.compile(
        rf"(?:(?P<square>#\[)|(?:#PPOINT|TRANS)[ \t]*\()(?P<numbers>{_VALUES})(?(square)\]|\))", _I
    )

    def look(self, pos: int, text: str) -> None:
        if (put := _SET.fullmatch(text)) is not None:
            what = what_of(put[1])
            self.active.set(what, pos, self._transform(pos, put[2], what))

    def _transform(self, pos: int, text: str, what: What) -> str | None:
        """The name of a tool or base that a statement sets; None where it is computed."""
        name = self.names.plain(text)
        if name == "null":
            return name
        literal = self.literal.fullmatch(text)
        if literal is not None and text[0] != "#" and literal["numbers"].count(",") == 5:
            name, _ = self.inline(pos)
            self.frame(pos, what, name, pose_of(from_zyz, values_in(literal["numbers"])))
            return name
        self.added(name)
        poses = [one for one in self.reading.positions if one.name == name and one.kind == "cartesian"]
        if poses and (what, name) not in self.reading.frames:
            of_file = FileReading(poses[0].file, self.reading)
            of_file.frame(poses[0].spans[0][0], what, name, pose_of(from_zyz, poses[0].values))
        return name if _NAME.fullmatch(text) and not name.startswith(".") else None

    def goes(self, pos: int, names: Sequence[str], frame: str | None = None) -> None:
        """.SYSDATA holds what was set last: of a program that sets none it is known where none does."""
        sets = {what_of(match[1]) for each in self.reading.files for match in _SETS.finditer(each.bare)}
        of = (self.active.at(what, pos) or (None if what in sets else "sysdata") for what in WHAT)
        self.moves(pos, names, *of)

    def is_joints(self, literal: re.Match[str]) -> bool:
        return literal[0].startswith("#")

    def statement(self, pos: int, text: str) -> None:
        if _SET.fullmatch(text):
            return None
        if (shape := _SHAPE.match(text)) is not None:
            return self.refuse(pos, f"{shape[1]} changes the configuration of the next motion")
        if re.match(r"[ \t]*HOME[2-9]?\b", text, _I):
            return self.doubt(pos, "elsewhere", "HOME is stored in the controller: teach it again")
        if (block := _BLOCK.match(text)) is not None:
            self.goal(pos + block.start(1), block[1])
            return None
        if (move := _MOVE.search(text)) is not None:
            at, goal = parts_of(move[2])[0]
            names = self.goal(pos + move.start(2) + at, goal := goal.split(" TILL ")[0].strip())
            if "APPRO" in move[1].upper():
                away = re.search(rf",[ \t]*({NUMBER})[ \t]*$", move[2])
                offset = (0.0, 0.0, -float(away[1])) if away else None
                self.relative(pos, f"{move[1]} {goal}", names, offset, "tool")
            return self.goes(pos, names)
        if (step := _STEP.match(text)) is not None:
            word, by = step[1].upper(), step[2].strip()
            numbers = values_in(by) if _NUMBERS.fullmatch(by) else []
            if "DEPART" in word and len(numbers) == 1:
                return self.relative(pos, step[1], (), (0.0, 0.0, -numbers[0]), "tool")
            if "DRAW" in word and len(numbers) == 3:
                return self.relative(pos, step[1], (), numbers, "tool" if word[0] == "T" else "frame")
            return self.relative(pos, f"{step[1]} is a step from where the arm is")
        if (store := _STORES.fullmatch(text)) is None:
            return self.names.used(self, pos, re.sub(r"^[ \t]*[\w.]+", "", text))
        name, value = self.names.plain(store[1]), store[2] or ""
        literal = self.literal.fullmatch(value)
        if literal and name not in self.names.keys and self.is_joints(literal) == name.startswith("#"):
            self.names.store(store[1], name)
            at, joints = pos + store.start(2), self.is_joints(literal)
            return self.add_literal(at, literal, name, store[1], joints=joints)
        self.names.changed(self, pos, store[1])
        return self.moves(pos, self.goal(pos + store.start(2), value) if value else [])

    def goal(self, pos: int, text: str) -> list[str]:
        if text.startswith("#[") and self.literal.fullmatch(text) is None:
            self.unread(pos, "this position is not understood")
            return []
        return super().goal(pos, text)
