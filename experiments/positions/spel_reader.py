"""Positions of SPEL+ (Epson): files of points (.pts) and literals of programs."""

from __future__ import annotations

import re

from ...model.kinematics.orientation import from_abc
from .position import BackupReading, FileReading, What, pose_of
from .position_names import SharedNames
from .script import LineProgram
from .statement_text import NUMBER, lines_in, numbers_in, parts_of, values_in

_I, _M = re.IGNORECASE, re.MULTILINE
_POINT = re.compile(r"^[ \t]*Point\d+[ \t]*\{([^{}]*)\}", _M)
_FIELD = re.compile(r"^[ \t]*([a-z]\w*)=([^\r\n]*?)[ \t]*\r?$", _M)
_HEAD = re.compile(r"^(?:ENVT\d+,.*|(?:sVersion|[nb]Display\w+|nNumberOf(?:Joints|Points))=.*)$", _M)
_COUNT = re.compile(r"^nNumberOf(Joints|Points)=(\d+)", _M)
_POSE, _WORDS = [f"r{axis}" for axis in "XYZUVW"], ("nHand", "nElbow", "nWrist")
# Of further axes and turns it is not published what they mean for an arm with six joints.
_ZERO = ("rR", "rS", "rT", "nJ1Flag", "nJ2Flag", "nJ4Flag", "nJ6Flag", "rJ1Angle", "rJ4Angle", "nUndefined")
_VALUES = {
    **dict.fromkeys(_POSE, NUMBER),
    **dict.fromkeys(_ZERO, r"0(?:\.0*)?"),
    **dict.fromkeys(("nNumber", "nLocal"), r"\d+"),
    **dict.fromkeys((*_WORDS, "sLabel", "sDescription", "bSimVisible"), ".*"),
}
_FUNCTION = re.compile(r"^[ \t]*Function\b.*?^[ \t]*Fend\b", _I | _M | re.DOTALL)
_MOVE = re.compile(r"(?:^|[ \t:])(Go|Move|Jump|Jump3|Jump3CP|Arc|Arc3|CVMove|Pass)[ \t]+([^\r\n]+)", _I)
_STEP = re.compile(r"(?:^|[ \t:])(TGo|TMove|BGo|BMove|PTran)[ \t]+([^\r\n]+)", _I)
_REFUSED = re.compile(r"[ \t]*(Pulse[ \t]+\S|Local[ \t]+\w|Base[ \t]+\w|LocalClr|Hofs|Calib|Teach)", _I)
_CHANGES = re.compile(r"[ \t]*(ImportPoints|PDel|ClearPoints)\b", _I)
_TOOL = re.compile(r"[ \t]*Tool[ \t]+(\d+)?", _I)
_TLSET = re.compile(r"[ \t]*TLSet[ \t]+(\d+)[ \t]*,[ \t]*XY[ \t]*\(([^()]*)\)[ \t]*", _I)
_JUMP = re.compile(r"[ \t]*(?:If|Else\w*|For|Do|Loop|While|Select|Case|GoTo|\w+:)(?:\b|$)", _I)
_STORES = re.compile(
    r"[ \t]*(?:C[XYZRSTUVW][ \t]*\([ \t]*)?(P\d+|P[ \t]*\([^()]*\)|[A-Z_]\w*)[ \t]*\)?[ \t]*=", _I
)
_OPTION = re.compile(r"!|\b(?:Till|Find|Sense|LimZ)\b", _I)
_GOAL = re.compile(
    r"(?P<name>P[ \t]*\([ \t]*\d+[ \t]*\)|[A-Z_]\w*)"
    r"(?P<added>(?:[ \t]*[-+:][ \t]*[XYZUVW][ \t]*\([^()]*\))*)"
    r"(?P<other>[ \t]*(?:/\w+|@\w+)?).*",
    _I,
)
_LITERAL = re.compile(r"(XY|JA)[ \t]*\(([^()]*)\)((?:[ \t]*/\w+)*)", _I)
_SHIFT = re.compile(rf"([-+])[ \t]*([XYZ])[ \t]*\([ \t]*({NUMBER})[ \t]*\)", _I)
_WORD = re.compile(r"(?<![\w.])[A-Z_]\w*", _I)
_CALLED = re.compile(r"(?!P[ \t]*\([ \t]*\d+[ \t]*\))\w+[ \t]*\(", _I)


def read_spel(reading: BackupReading) -> None:
    """Files of points first, then functions. P1 of a program is that of each file of points."""
    names = SpelNames(_WORD)
    for file in sorted(reading.files, key=lambda file: file.suffix != ".pts"):
        if file.suffix == ".pts":
            _points(FileReading(file, reading), names)
            continue
        for function in _FUNCTION.finditer(file.bare):
            program = SpelFunction(file, reading, names)
            program.prepare(lines_in(file.bare, *function.span())[1:])
            program.run()


class SpelNames(SharedNames):
    """P1, P01 and P(1) are one."""

    def plain(self, name: str) -> str:
        name = re.sub(r"p\((\d+)\)", r"p\1", super().plain(name))
        return f"p{int(name[1:])}" if re.fullmatch(r"p\d+", name) else name

    def elements(self, text: str) -> list[str] | None:
        if not re.fullmatch(r"p(?:\(.*)?", self.plain(text), re.DOTALL):
            return super().elements(text)
        return sorted(key for name, keys in self.keys.items() if re.fullmatch(r"p\d+", name) for key in keys)


def _points(here: FileReading, names: SharedNames) -> None:
    file = here.file
    rest = _POINT.sub(lambda point: re.sub(r"[^\n]", " ", point[0]), file.text)
    for pos, line in lines_in(_HEAD.sub(lambda head: " " * len(head[0]), rest)):
        if line.strip():
            here.refuse(pos, "this position is not understood")
    if (checksum := re.search(r"^ENVT\d+,", file.text, _M)) is not None:
        sentence = "this line has a checksum, of which nothing is published: it stays as it was"
        here.doubt(checksum.start(), "call", sentence)
    points = list(_POINT.finditer(file.text))
    for count in _COUNT.finditer(file.text):
        if int(count[2]) != (6 if count[1] == "Joints" else len(points)):
            here.refuse(count.start(), f"{count[0]}: there are {len(points)} points of six joints")
    for point in points:
        fields = {field[1]: field for field in _FIELD.finditer(file.text, *point.span(1))}
        spans = {key: field.span(2) for key, field in fields.items()}
        value = {key: field[2] for key, field in fields.items()}
        number, label = value.get("nNumber", ""), value.get("sLabel", '""').strip('"')
        known = all(re.fullmatch(_VALUES.get(key, "(?!)"), text) for key, text in value.items())
        lines = [line for line in point[1].split("\n") if line.strip()]
        if not known or len(fields) != len(lines) or not {*_POSE, "nNumber"} <= {*fields}:
            here.refuse(point.start(), f"Point {number or '?'} is not understood")
            continue
        name = f"{file.name}:P{int(number)}"
        if name in names.keys.get(f"p{int(number)}", ()):
            here.refuse(point.start(), f"P{number} is listed twice")
        for key in (f"p{int(number)}", label):
            names.store(key, name)
        frame = str(int(value.get("nLocal", "0")))
        pose, words = [spans[key] for key in _POSE], [spans[key] for key in _WORDS if key in spans]
        here.add(point.start(), name, label or f"P{number}", pose, words, frame=frame)


class SpelFunction(LineProgram):
    """A function of a program."""

    jump = _JUMP

    def look(self, pos: int, text: str) -> None:
        if (put := _TOOL.match(text)) is not None:
            self.active.set("tool", pos, put[1] and str(int(put[1])))
        if (made := _TLSET.fullmatch(text)) is not None and made[2].count(",") == 5:
            self.frame(pos, "tool", made[1], pose_of(from_abc, values_in(made[2])))
        elif re.match(r"[ \t]*TLSet\b", text, _I):
            self.refuse(pos, "TLSet: tools are set when the program runs")

    def statement(self, pos: int, text: str) -> None:
        name = self.names.plain(store[1]) if (store := _STORES.match(text)) else ""
        if (refused := _REFUSED.match(text)) is not None:
            return self.refuse(pos, f"{refused[1].split()[0]}: pulses, frames or points that are set then")
        if (changes := _CHANGES.match(text)) is not None:
            return self.doubt(pos, "elsewhere", f"{changes[1]} changes points when the program runs")
        if (move := _MOVE.search(text)) is not None:
            for at, part in parts_of(_OPTION.split(move[2])[0]):
                self._goal(pos + move.start(2) + at, part)
            return None
        if (step := _STEP.search(text)) is not None:
            axes: What = "frame" if step[1][0] in "bB" else "tool"
            return self.relative(pos, step[1], (), _offset(step[2]), axes)
        if store and (name in self.names.keys or re.match(r"p[\d(]", name)):
            return self.names.changed(self, pos, store[1])
        return self.names.used(self, pos, text)

    def _goal(self, pos: int, goal: str) -> None:
        literal, match = _LITERAL.match(goal), _GOAL.fullmatch(goal)
        if literal is not None:
            spans = numbers_in(literal[2], pos + literal.start(2))
            more = "@" in goal or re.search(r"\)[ \t]*[-+:]", goal)
            if len(spans) != 6 or literal[2].count(",") != 5 or more:
                return self.refuse(pos, f"{goal[:40]} is not understood")
            joints, (name, label) = literal[1].upper() == "JA", self.inline(pos)
            self.six(pos, name, label, spans, joints=joints, frame=None if joints else "0")
            return self.goes(pos, [name])
        if match is None or match["name"].lower() == "here" or _CALLED.match(goal):
            return self.computed(pos, goal)
        if re.fullmatch(r"CP|C[0-7]|LJM|ROT|ECP|SYNC", match["name"], _I):
            return None
        if match["other"].strip():
            self.refuse(pos, f"{goal[:40]}: another configuration or frame than the point has")
        several = self.names.of(self.file, match["name"])
        if match["added"].strip():
            self.relative(pos, goal[:40], several, _offset(match["added"]), "frame")
        return self.goes(pos, several)


def _offset(text: str) -> list[float] | None:
    """mm of an offset: +X(5) -Z(10), or XY(5, 0, -10, 0); None where it rotates, or is not in numbers."""
    text = re.sub(r"\s|Here", "", text)
    if (literal := re.match(rf"XY\(({NUMBER}(?:,{NUMBER})*)\)", text, _I)) is not None:
        numbers = [float(each) for each in literal[1].split(",")]
        return None if any(numbers[3:]) else numbers[:3]
    shifts = [(axis.upper(), float(sign + value)) for sign, axis, value in _SHIFT.findall(text)]
    by = [sum(value for each, value in shifts if each == axis) for axis in "XYZ"]
    return by if shifts and not _SHIFT.sub("", text) else None
