"""Positions of AS programs and saved files (Kawasaki), with the tool and base of .SYSDATA."""

from __future__ import annotations

import re

from ...model.kinematics.orientation import from_zyz
from .position import NUMBER, BackupReading, SourceFile, What, numbers_in, pose_of, split_arguments
from .position_names import SharedNames
from .script import LineProgram

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
    names = SharedNames(reading, _NAME)
    programs = [AsProgram(file, names, lines) for file in reading.files for lines in _sections(file, names)]
    for program in programs:
        program.run()


def _sections(file: SourceFile, names: SharedNames) -> list[list[re.Match[str]]]:
    """The lines of its programs; positions, tools and frames are added."""
    section, reading = "", names.reading
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
        elif section in ("TRANS", "JOINTS") and line[0].strip():
            _entry(file, line, section == "JOINTS", names)
        elif section == "SYSDATA" and (system := _SYSTEM.fullmatch(line[0])) is not None:
            what: What = "tool" if system[1].upper() == "TOOL" else "frame"
            numbers = [float(each) for each in system[2].split()]
            reading.frame(file, line.start(), what, "sysdata", pose_of(from_zyz, numbers))
    if section in ("PROGRAM", "TRANS", "JOINTS"):
        reading.unread(file, len(file.text), f"the file ends before .END of .{section}")
    return programs


def _entry(file: SourceFile, line: re.Match[str], joints: bool, names: SharedNames) -> None:
    entry, pos = _ENTRY.fullmatch(line[0]), line.start()
    if entry is None or entry["name"].startswith("#") != joints:
        return names.reading.unread(file, pos, "this position is not understood")
    spans, label = numbers_in(entry["values"], pos + entry.start("values")), entry["name"]
    name = names.plain(label)
    if len(spans) >= 6:
        if name in names.keys:
            names.reading.refuse(file, pos, f"{label} is listed twice: convert one saved file alone")
        names.keys[name] = [name]
    return names.reading.six(file, pos, name, label, spans, joints=joints, register=not joints)


class AsProgram(LineProgram):
    """A program, with the names of all files."""

    def __init__(self, file: SourceFile, names: SharedNames, lines: list[re.Match[str]]) -> None:
        super().__init__(file, names)
        self.lines = lines

    def run(self) -> None:
        """Its statements, with the tool and the base that are set where they are."""
        sets = {match[1].upper() for each in self.reading.files for match in _SETS.finditer(each.bare)}
        for line in self.lines:
            self.active.jumps |= _JUMP.match(line[0]) is not None
            if (put := _SET.fullmatch(line[0])) is not None:
                what: What = "tool" if put[1].upper() == "TOOL" else "frame"
                self.active.set(what, line.start(), self._transform(line, put[2], what))
        for line in self.lines:
            pos = line.start() + len(line[0]) - len(line[0].lstrip())
            # .SYSDATA holds what was set last: of a program that sets none it is known where none does.
            tool = self.active.at("tool", pos) or (None if "TOOL" in sets else "sysdata")
            frame = self.active.at("frame", pos) or (None if "BASE" in sets else "sysdata")
            if not _SET.fullmatch(line[0]):
                self._statement(pos, line[0], tool, frame)

    def _transform(self, line: re.Match[str], text: str, what: What) -> str | None:
        """The name of a tool or base that a statement sets; None where it is computed."""
        name = self.names.plain(text)
        if name == "null":
            return name
        if (literal := _TRANS.fullmatch(text)) is not None:
            name = f"{self.file.name}:{line.start()}"
            numbers = [float(each) for each in literal[1].split(",")]
            self.reading.frame(self.file, line.start(), what, name, pose_of(from_zyz, numbers))
            return name
        self.reading.added.add(name)
        poses = [one for one in self.reading.positions if one.name == name and one.kind == "cartesian"]
        if poses and (what, name) not in self.reading.frames:
            pose = pose_of(from_zyz, poses[0].values)
            self.reading.frame(poses[0].file, poses[0].spans[0][0], what, name, pose)
        return name if _NAME.fullmatch(text) and not name.startswith(".") else None

    def _statement(self, pos: int, text: str, tool: str | None, frame: str | None) -> None:
        if (shape := _SHAPE.match(text)) is not None:
            return self.refuse(pos, f"{shape[1]} changes the configuration of the next motion")
        if (block := _BLOCK.match(text)) is not None:
            self._goals(pos, block[1])
            return None
        if (move := _MOVE.search(text)) is not None:
            goal = next(split_arguments(move[2]))[1].split(" TILL ")[0].strip()
            names = self._goals(pos, goal)
            if "APPRO" in move[1].upper():
                away = re.search(rf",[ \t]*({NUMBER})[ \t]*$", move[2])
                offset = (0.0, 0.0, -float(away[1])) if away else None
                self.relative(pos, f"{move[1]} {goal}", names, offset, "tool")
            return self.reading.moves(self.file, pos, names, tool, frame)
        if (step := _STEP.match(text)) is not None:
            numbers = [float(each) for each in re.findall(rf"(?<![\w.]){NUMBER}(?=[ \t]*(?:,|$))", step[2])]
            plain = len(numbers) == step[2].count(",") + 1
            if "DEPART" in step[1].upper() and plain and len(numbers) == 1:
                return self.relative(pos, step[1], (), (0.0, 0.0, -numbers[0]), "tool")
            if "DRAW" in step[1].upper() and plain and len(numbers) == 3:
                return self.relative(pos, step[1], (), numbers, "tool" if step[1][0] in "tT" else "frame")
            return self.relative(pos, f"{step[1]} is a step from where the arm is")
        if re.match(r"[ \t]*HOME[2-9]?\b", text, _I):
            sentence = "HOME is stored in the controller: teach it again"
            return self.reading.doubt(self.file, pos, "elsewhere", sentence)
        if (store := _STORES.fullmatch(text)) is not None:
            name, value = self.names.plain(store[1]), (store[2] or "").strip()
            literal = _LITERAL.fullmatch(value) is not None and value.startswith("#") == name.startswith("#")
            if literal and name not in self.names.keys:
                self.names.store(store[1], name)
                return self._literal(self.file.bare.index(value, pos + len(store[1])), value, name, store[1])
            self.reading.overwrites(self.file, pos, name, store[1])
            return self.reading.moves(self.file, pos, self._goals(pos, value) if value else [])
        return self.names.used(self.file, pos, re.sub(r"^[ \t]*[\w.]+", "", text))

    def _goals(self, pos: int, goal: str) -> list[str]:
        """The names of a goal."""
        at = self.file.bare.index(goal, pos)
        if _LITERAL.fullmatch(goal) is not None:
            name = f"{self.file.name}:{at}"
            self._literal(at, goal, name, f"line {self.file.line(at)}")
            return [name]
        if goal.startswith("#["):
            self.reading.unread(self.file, at, "this position is not understood")
            return []
        return self.names.goals(self.file, pos, goal)

    def _literal(self, at: int, text: str, name: str, label: str) -> None:
        spans = numbers_in(re.sub(r"^[^(\[]*", lambda word: " " * len(word[0]), text), at)
        self.reading.six(self.file, at, name, label, spans, joints=text.startswith("#"))
