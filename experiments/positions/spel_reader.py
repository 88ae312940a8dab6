"""Positions of SPEL+ (Epson): files of points (.pts) and literals of programs."""

from __future__ import annotations

import re

from ...model.kinematics.orientation import from_abc
from .position import NUMBER, Active, BackupReading, SourceFile, What, numbers_in, pose_of, split_arguments

_I, _M = re.IGNORECASE, re.MULTILINE
_POINT = re.compile(r"^[ \t]*Point\d+[ \t]*\{([^{}]*)\}", _M)
_FIELD = re.compile(r"^[ \t]*([a-z]\w*)=([^\r\n]*?)[ \t]*\r?$", _M)
_HEAD = re.compile(r"^(?:ENVT\d+,.*|(?:sVersion|[nb]Display\w+|nNumberOf(?:Joints|Points))=.*)$", _M)
_COUNT = re.compile(r"^nNumberOf(Joints|Points)=(\d+)", _M)
_POSE = [f"r{axis}" for axis in "XYZUVW"]
_WORDS = ("nHand", "nElbow", "nWrist")
# Further axes and turns: what they mean for an arm with six joints is not published.
_ZERO = ("rR", "rS", "rT", "nJ1Flag", "nJ2Flag", "nJ4Flag", "nJ6Flag", "rJ1Angle", "rJ4Angle", "nUndefined")
_OTHERS = ("nNumber", "sLabel", "sDescription", "nLocal", "bSimVisible")
_FUNCTION = re.compile(r"^[ \t]*Function\b.*?^[ \t]*Fend\b", _I | _M | re.DOTALL)
_MOVE = re.compile(r"(?:^|[ \t:])(Go|Move|Jump|Jump3|Jump3CP|Arc|Arc3|CVMove|Pass)[ \t]+([^\r\n]+)", _I)
_STEP = re.compile(r"(?:^|[ \t:])(TGo|TMove|BGo|BMove|PTran)[ \t]+([^\r\n]+)", _I)
_REFUSED = re.compile(r"[ \t]*(Pulse[ \t]+\S|Local[ \t]+\w|Base[ \t]+\w|LocalClr|Hofs|Calib|Teach)", _I)
_TOOL = re.compile(r"[ \t]*Tool[ \t]+(\d+)?", _I)
_TLSET = re.compile(r"[ \t]*TLSet[ \t]+(\d+)[ \t]*,[ \t]*XY[ \t]*\(([^()]*)\)[ \t]*", _I)
_JUMP = re.compile(r"[ \t]*(?:If|Else\w*|For|Do|Loop|While|Select|Case|GoTo|\w+:)(?:\b|$)", _I)
_STORES = re.compile(
    r"[ \t]*(?:C[XYZRSTUVW][ \t]*\([ \t]*)?(P\d+|P[ \t]*\([^()]*\)|[A-Z_]\w*)[ \t]*\)?[ \t]*=", _I
)
_GOAL = re.compile(
    r"(?P<name>P[ \t]*\([ \t]*\d+[ \t]*\)|[A-Z_]\w*)"
    r"(?P<added>(?:[ \t]*[-+:][ \t]*[XYZUVW][ \t]*\([^()]*\))*)"
    r"(?P<other>[ \t]*(?:/\w+|@\w+)?).*",
    _I,
)
_LITERAL = re.compile(r"(XY|JA)[ \t]*\(([^()]*)\)((?:[ \t]*/\w+)*)", _I)
_SHIFT = re.compile(rf"([-+])[ \t]*([XYZ])[ \t]*\([ \t]*({NUMBER})[ \t]*\)", _I)


def read_spel(reading: BackupReading) -> None:
    """Files of points first, then functions. P1 of a program is that of each file of points."""
    names: dict[str, list[str]] = {}
    for file in reading.files:
        if file.suffix == ".pts":
            _points(file, reading, names)
    for file in reading.files:
        if file.suffix != ".pts":
            for function in _FUNCTION.finditer(file.bare):
                lines = list(re.finditer(r"[^\r\n]+", file.bare[: function.end()]))
                _function(file, [line for line in lines if line.start() > function.start()], reading, names)


def _points(file: SourceFile, reading: BackupReading, names: dict[str, list[str]]) -> None:
    rest = _POINT.sub(lambda point: re.sub(r"[^\n]", " ", point[0]), file.text)
    for line in re.finditer(r"[^\r\n]+", _HEAD.sub(lambda head: " " * len(head[0]), rest)):
        if line[0].strip():
            reading.refuse(file, line.start(), "this position is not understood")
    if (checksum := re.search(r"^ENVT\d+,", file.text, _M)) is not None:
        sentence = "this line has a checksum, of which nothing is published: it stays as it was"
        reading.doubt(file, checksum.start(), "call", sentence)
    points = list(_POINT.finditer(file.text))
    for count in _COUNT.finditer(file.text):
        if int(count[2]) != (6 if count[1] == "Joints" else len(points)):
            reading.refuse(file, count.start(), f"{count[0]}: there are {len(points)} points of six joints")
    for point in points:
        fields = {field[1]: field for field in _FIELD.finditer(file.text, *point.span(1))}
        spans = {key: field.span(2) for key, field in fields.items()}
        value = {key: field[2] for key, field in fields.items()}
        number, label = value.get("nNumber", ""), value.get("sLabel", '""').strip('"')
        zero = [re.fullmatch(r"0(?:\.0*)?", value.get(key, "0")) for key in _ZERO]
        if (
            len(fields) != len([line for line in point[1].split("\n") if line.strip()])
            or not {*fields} <= {*_POSE, *_WORDS, *_ZERO, *_OTHERS}
            or not {*_POSE} <= {*fields}
            or not all(re.fullmatch(NUMBER, value[key]) for key in _POSE)
            or not number.isdecimal()
            or not value.get("nLocal", "0").isdecimal()
            or not all(zero)
        ):
            reading.refuse(file, point.start(), f"Point {number or '?'} is not understood")
            continue
        name = f"{file.name}:P{int(number)}"
        if name in names.get(f"p{int(number)}", ()):
            reading.refuse(file, point.start(), f"P{number} is listed twice")
        for key in (f"p{int(number)}", label.lower()):
            names.setdefault(key, []).append(name)
        frame = str(int(value.get("nLocal", "0")))
        pose, words = [spans[key] for key in _POSE], [spans[key] for key in _WORDS if key in spans]
        reading.add(file, point.start(), name, label or f"P{number}", pose, words, frame=frame)


def _function(
    file: SourceFile, lines: list[re.Match[str]], reading: BackupReading, names: dict[str, list[str]]
) -> None:
    active = Active()
    for line in lines:
        active.jumps |= _JUMP.match(line[0]) is not None
        if (put := _TOOL.match(line[0])) is not None:
            active.set("tool", line.start(), put[1] and str(int(put[1])))
        if (made := _TLSET.fullmatch(line[0])) is not None and made[2].count(",") == 5:
            numbers = numbers_in(made[2])
            pose = (
                pose_of(from_abc, [float(made[2][slice(*span)]) for span in numbers])
                if len(numbers) == 6
                else None
            )
            reading.frame(file, line.start(), "tool", made[1], pose)
        elif re.match(r"[ \t]*TLSet\b", line[0], _I):
            reading.refuse(file, line.start(), "TLSet: tools are set when the program runs")
    for line in lines:
        _statement(file, line, reading, names, active.at("tool", line.end()))


def _statement(
    file: SourceFile,
    line: re.Match[str],
    reading: BackupReading,
    names: dict[str, list[str]],
    tool: str | None,
) -> None:
    text, pos = line[0], line.start() + len(line[0]) - len(line[0].lstrip())
    if (refused := _REFUSED.match(text)) is not None:
        return reading.refuse(
            file, pos, f"{refused[1].split()[0]}: pulses, frames or points that are set then"
        )
    if (move := _MOVE.search(text)) is not None:
        for at, part in split_arguments(re.split(r"!|\b(?:Till|Find|Sense|LimZ)\b", move[2], flags=_I)[0]):
            begin = line.start() + move.start(2) + at + len(part) - len(part.lstrip())
            _goal(file, begin, part.strip(), reading, names, tool)
        return None
    if (step := _STEP.search(text)) is not None:
        axes: What = "frame" if step[1][0] in "bB" else "tool"
        return reading.doubt(file, pos, "relative", step[1], None, _step(step[2]), axes)
    if (store := _STORES.match(text)) is not None:
        name = re.sub(r"\s", "", store[1]).lower()
        name = re.sub(r"p\((\d+)\)", r"p\1", name)
        if name.startswith("p("):
            return reading.refuse(file, pos, f"{store[1]}: which point is overwritten is not known before")
        for each in names.get(name, [name] if re.fullmatch(r"p\d+", name) else []):
            reading.overwrites(file, pos, each, store[1])
        if name in names or re.fullmatch(r"p\d+", name):
            return None
    for word in re.findall(r"(?<![\w.])[A-Z_]\w*", text, _I):
        if word.lower() in names:
            reading.doubt(file, pos, "call", f"{word} is used by this statement")
    return None


def _step(text: str) -> list[float] | None:
    """mm of a step: +X(5) -Z(10), or XY(5, 0, -10, 0); None where it rotates, or is not in numbers."""
    text = re.sub(r"\s|Here", "", text)
    if (literal := re.match(rf"XY\(({NUMBER}(?:,{NUMBER})*)\)", text, _I)) is not None:
        numbers = [float(each) for each in literal[1].split(",")]
        return None if any(numbers[3:]) else numbers[:3]
    shifts = [(axis.upper(), float(sign + value)) for sign, axis, value in _SHIFT.findall(text)]
    by = [sum(value for each, value in shifts if each == axis) for axis in "XYZ"]
    return by if shifts and not _SHIFT.sub("", text) else None


def _goal(
    file: SourceFile,
    pos: int,
    goal: str,
    reading: BackupReading,
    names: dict[str, list[str]],
    tool: str | None,
) -> None:
    literal, match = _LITERAL.match(goal), _GOAL.fullmatch(goal)
    if literal is not None:
        spans = numbers_in(literal[2], pos + literal.start(2))
        if len(spans) != 6 or literal[2].count(",") != 5 or "@" in goal or re.search(r"\)[ \t]*[-+:]", goal):
            return reading.refuse(file, pos, f"{goal[:40]} is not understood")
        joints = literal[1].upper() == "JA"
        name = f"{file.name}:{pos}"
        axes = range(6) if joints else None
        reading.add(
            file, pos, name, f"line {file.line(pos)}", spans, axes=axes, frame=None if joints else "0"
        )
        return reading.moves(file, pos, [name], tool)
    called = re.match(r"\w+[ \t]*\(", goal) is not None and not re.match(
        r"P[ \t]*\([ \t]*\d+[ \t]*\)", goal, _I
    )
    if match is None or match["name"].lower() == "here" or called:
        return reading.computed(file, pos, goal)
    if re.fullmatch(r"CP|C[0-7]|LJM|ROT|ECP|SYNC", match["name"], _I):
        return None
    name = re.sub(r"[\s()]", "", match["name"]).lower()
    name = f"p{int(name[1:])}" if re.fullmatch(r"p\d+", name) else name
    if match["other"].strip():
        reading.refuse(file, pos, f"{goal[:40]}: another configuration or frame than the point has")
    several = names.get(name, [name])
    if match["added"].strip():
        shifts = _SHIFT.findall(match["added"])
        plain = len(shifts) == len(re.findall(r"\(", match["added"]))
        by = tuple(sum(float(s + v) for s, a, v in shifts if a.upper() == axis) for axis in "XYZ")
        reading.doubt(file, pos, "relative", goal[:40], several[0], by if plain else None, "frame")
    return reading.moves(file, pos, several, tool)
