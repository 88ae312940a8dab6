"""Positions of programs in dialects of BASIC: MELFA-BASIC (Mitsubishi), PacScript (Denso), SPEL+ (Epson)."""

from __future__ import annotations

import re

from ...model.kinematics.orientation import from_abc, from_rpy
from .position import (
    NUMBER,
    WHAT,
    BackupReading,
    FileReading,
    Lines,
    What,
    lines_in,
    numbers_in,
    parts_of,
    pose_of,
    values_in,
    what_of,
)
from .script import LineProgram, PositionNames, Script, SharedNames

_I = re.IGNORECASE
_MELFA_VALUES = rf"\([ \t]*{NUMBER}(?:[ \t]*,[ \t]*{NUMBER})*[ \t]*\)"
_FLAGS = r"(?:[ \t]*\([ \t]*\d+[ \t]*,[ \t]*\d+[ \t]*\))?"
_NAME = r"[PJ][A-Z0-9]\w*|[PJ](?=[ \t]*\()"
_INDEX = r"(?:[ \t]*\([^()]*\))?"
_LINE = re.compile(r"(?m)^[ \t]*(?:\d+[ \t]+)?([^\r\n]*?)[ \t]*\r?$")
_STORED = re.compile(rf"({_NAME})({_INDEX})[ \t]*=[ \t]*(\(.*)", _I)
_MELFA_STORES = re.compile(rf"({_NAME})({_INDEX})(?:\.\w+)?[ \t]*=[ \t]*(.*)", _I)
_MELFA_MOVE = re.compile(r"(?:^|[ \t:])(Mov|Mvs|Mvr[23]?|Mvc|Mva)[ \t]+(.+)", _I)
_MELFA_TOOL = re.compile(r"Tool[ \t]+(.+)", _I)
_SET = re.compile(
    r"(Base\b(?![ \t]+P_NBase[ \t]*$)|M_(?:Tool|BsNo|BTool)\b.*=|P_\w+[ \t]*=|MExB?Tl|Cmp\b"
    r"|(?:Def[ \t]+)?Plt\b)",
    _I,
)
_MELFA_JUMP = re.compile(
    r"(?:\*\w|(?:If|Else|ElseIf|For|While|Select|Case|On|Return)\b)|.*\bGo(?:To|Sub)\b", _I
)
_ONE = rf"(?:{_NAME}){_INDEX}"
_MELFA_WORD = re.compile(rf"(?<![\w.]){_ONE}", _I)


def read_melfa(reading: BackupReading) -> None:
    """Each program has variables of its own."""
    for file in reading.files:
        program = MelfaProgram(file, reading, PositionNames(_MELFA_WORD))
        lines = [(line.start(1), line[1]) for line in _LINE.finditer(file.bare) if line[1]]
        program.variables(lines)
        program.prepare(lines)
        program.run()


class MelfaProgram(LineProgram):
    """A program with its variables."""

    jump = _MELFA_JUMP
    literal = re.compile(rf"(?P<numbers>{_MELFA_VALUES})(?P<flags>{_FLAGS})")
    shifts = (  # components of both; B in the axes of the tool at A
        (re.compile(rf"(?P<goal>{_ONE})[ \t]*\+[ \t]*(?P<by>{_ONE})", _I), "frame"),
        (re.compile(rf"(?P<goal>{_ONE})[ \t]*\*[ \t]*(?P<by>{_ONE})", _I), "tool"),
    )

    def variables(self, lines: Lines) -> None:
        """Those that are saved behind it."""
        for pos, text in lines:
            if (entry := _STORED.fullmatch(text)) is not None:
                self._entry(pos, entry)

    def look(self, pos: int, text: str) -> None:
        if (put := _MELFA_TOOL.fullmatch(text)) is not None:
            self.active.set("tool", pos, self._tool(pos, put[1]))

    def _entry(self, pos: int, entry: re.Match[str]) -> None:
        label, literal = f"{entry[1]}{entry[2]}", self.literal.fullmatch(entry[3])
        name = self.names.plain(label)
        if literal is None:
            if re.fullmatch(r"\([-+.\d\s,*#]*\)?.*", entry[3]) and not re.search(r"[A-Z]", entry[3], _I):
                self.unread(pos, f"{label}: this position is not understood", label)
            return None
        if name in self.names.keys:
            return self.refuse(pos, f"the program overwrites the stored position {label}")
        self.names.store(label, key := f"{self.file.name}:{name}")
        joints = label[0] in "jJ"
        return self.add_literal(pos + entry.start(3), literal, key, label, joints=joints, register=True)

    def add_literal(
        self, pos: int, literal: re.Match[str], key: str, label: str, *, joints: bool, register: bool = False
    ) -> None:
        spans = numbers_in(literal["numbers"], pos + literal.start("numbers"))
        flags = numbers_in(literal["flags"], pos + literal.start("flags"))
        plain = len(flags) == 2 and not joints and not any(self.numbers(flags[1:]))
        if len(spans) >= 6 and not plain and (flags or not joints):
            return self.unread(pos, f"{label}: turns of joints, or no flags, are not understood", label)
        frame = None if joints else "0"
        return self.six(pos, key, label, spans, flags, joints=joints, register=register, frame=frame)

    def _tool(self, pos: int, text: str) -> str | None:
        """The name of a tool that is set; None where that is computed."""
        if text.upper() == "P_NTOOL":
            return "p_ntool"
        (name,), numbers = self.names.keys.get(self.names.plain(text), [""]), self.added(text)[:6]
        if (literal := self.literal.fullmatch(text)) is not None:
            name, numbers = f"{self.file.name}:tool{pos}", values_in(literal["numbers"])[:6]
        if len(numbers) == 6 and ("tool", name) not in self.reading.frames:
            self.frame(pos, "tool", name, pose_of(from_rpy, numbers))
        return name or None

    def statement(self, pos: int, text: str) -> None:
        entry = _STORED.fullmatch(text)
        if (run_time := _SET.match(text)) is not None:
            return self.refuse(pos, f"{run_time[1]}: tools, frames or pallets are set when the program runs")
        if _MELFA_TOOL.fullmatch(text) or (entry and self.literal.fullmatch(entry[3])):
            return None
        if (move := _MELFA_MOVE.search(text)) is not None:
            goals: list[str] = []
            for at, goal in parts_of(re.split(r"[ \t](?:Wth(?:If)?|Type)\b", move[2], flags=_I)[0]):
                if re.fullmatch(NUMBER, goal) and goals:
                    self.relative(pos, text[:40], goals[-1:], (0.0, 0.0, float(goal)), "tool")
                else:
                    goals += self.goal(pos + move.start(2) + at, goal)
            return self.goes(pos, goals)
        if (store := _MELFA_STORES.fullmatch(text)) is not None:
            self.names.changed(self, pos, f"{store[1]}{store[2]}")
            return self.moves(pos, self.goal(pos + store.start(3), store[3].strip()))
        return self.names.used(self, pos, text)


_LIST = rf"{NUMBER}(?:\s*,\s*{NUMBER})*"
_PART = re.compile(r"^[ \t]*(?:Sub|Function|Program)\b", _I | re.MULTILINE)
_KINDS = re.compile(r"(?:Dim[ \t]+(.+?)[ \t]+As[ \t]+|Def)(Pos|Joint|Jnt)\w*\b(.*)", _I)
_DEFINED = rf"(Tool|Work)[ \t]+(\d+)[ \t]*,[ \t]*P?[ \t]*\(\s*({_LIST})\s*\)[ \t]*"
_CHANGED = re.compile(r"Change(Tool|Work)[ \t]+(\d+)?", _I)
_BY = r"(?P<goal>.*?)\s*,\s*(?P<by>P?\s*\([^()]*\)|[^,()]*)\s*"
_GOALS = {"move": slice(1, None), "approach": slice(1, 2), "archmove": slice(1), "drivea": slice(1)}
_PAC_OPTION = re.compile(r"(?:S|Speed|Accel|Decel|Time)\s*=.*|Next|If\b.*", _I)


def read_pacscript(reading: BackupReading) -> None:
    """P[n] and J[n] belong to all programs, other names to those of one file."""
    programs, shared = [], PacNames(PacProgram.word)
    for file in reading.files:
        names = PacNames(shared.word, shared.keys, file.name, shared.arrays)
        starts = [match.start() for match in _PART.finditer(file.bare)][1:]
        for start, end in zip([0, *starts], [*starts, len(file.bare)], strict=True):
            programs.append(PacProgram(file, reading, names))
            programs[-1].scan(start, end)
    for program in programs:
        program.run()


class PacNames(SharedNames):
    """P10 and P[10] are one, in all programs."""

    def plain(self, name: str) -> str:
        name = re.sub(r"([pj])0*(\d+)", r"\1[\2]", re.sub(r"\s", "", name).lower())
        return name if re.match(r"[pj]\[", name) else f"{self.scope}:{name}"


class PacProgram(Script):
    """A Sub or PROGRAM, with the names of its file."""

    literal = re.compile(rf"(?P<kind>[PJT])?\s*\(\s*(?P<numbers>{_LIST})\s*\)", _I)
    begin = re.compile(r"[PJT]\s*\(", _I)
    assign = re.compile(
        r"(?:Let\w*[ \t]+)?(?P<name>[PJ]\s*\[[^\]]*\]|[A-Z_]\w*)(?P<index>(?:\([^()]*\))?)\s*="
        r"\s*(?P<value>.*)",
        _I | re.DOTALL,
    )
    move = re.compile(r"(?:^|[ \t:])(?P<kind>Move|Approach|Depart|Draw|DriveA|ArchMove|Rotate)H?\b[ \t]*", _I)
    jump = re.compile(r"(?:If|Else\w*|For|Do|Loop|While|Select|Case|GoTo|\*\w+)\b", _I)
    refused = re.compile(rf"^(?!{_DEFINED}$)(?:Tool|Work)[ \t]+\w.*|^(?:SetBase|Base)[ \t]+\S.*", _I)
    word = re.compile(r"(?<![\w.\"'$])(?:[PJ]\s*\[[^\]]*\]|[A-Z_]\w*)(?!\w)", _I)
    shifts = (
        (re.compile(rf"Dev\s*\(\s*{_BY}\)", _I | re.DOTALL), "frame"),
        (re.compile(rf"DevH\s*\(\s*{_BY}\)", _I | re.DOTALL), "tool"),
        (re.compile(rf"(?P<goal>.+?)\s*(?P<sign>[-+])\s*(?P<by>P?\s*\(\s*{_LIST}\s*\))", _I), "frame"),
    )
    changed = False

    def is_joints(self, literal: re.Match[str]) -> bool | None:
        return literal["kind"].upper() == "J" if literal["kind"] else None

    def setting(self, pos: int, text: str) -> None:
        if (kinds := _KINDS.match(text)) is not None:
            for name in re.findall(r"[A-Z_]\w*", kinds[1] or kinds[3], _I):
                self.kinds[self.names.plain(name)] = {kinds[2].upper() != "POS"}
        if (assign := self.assign.fullmatch(text)) is not None:
            name = self.names.plain(assign["name"])
            self.kinds |= {name: {name[0] == "j"}} if re.match(r"[pj]\[", name) else {}
        if (made := re.fullmatch(_DEFINED, text, _I)) is not None:
            self.frame(pos, what_of(made[1]), made[2], pose_of(from_rpy, values_in(made[3])[:6]))
        if (change := _CHANGED.match(text)) is not None:
            self.active.set(what_of(change[1]), pos, change[2] and str(int(change[2])))
            self.changed = True
        if re.match(r"TakeArm\b", text, _I) and self.changed:  # what it changes is not published
            for what in WHAT:
                self.active.set(what, pos, None)

    def other(self, pos: int, text: str) -> None:
        if not _KINDS.match(text):
            super().other(pos, text)

    def add_literal(
        self, pos: int, literal: re.Match[str], key: str, label: str, *, joints: bool, register: bool = False
    ) -> None:
        spans = numbers_in(literal["numbers"], pos + literal.start("numbers"))
        if (literal["kind"] or "").upper() == "T" or (not joints and len(spans) > 7):
            return self.refuse(pos, f"{label}: this position is not understood")
        spans, figure = (spans, []) if joints else (spans[:6], spans[6:])
        return self.six(pos, key, label, spans, figure, joints=joints, register=register)

    def arguments(self, text: str, move: re.Match[str]) -> Lines:
        """Without path options (@P) and those of motion."""
        every = parts_of(text, move.end())
        parts = [(at, part, re.match(r"(?:@[ \t]*\w+[ \t]*)?", part)) for at, part in every]
        rest = [(at + skip.end(), part[skip.end() :].strip()) for at, part, skip in parts if skip]
        return [(at, part) for at, part in rest if part and not _PAC_OPTION.fullmatch(part)]

    def goals_of(self, move: re.Match[str], arguments: Lines) -> Lines:
        spline = [text.lower() for _, text in arguments[:1]] == ["s"]
        return [] if spline else arguments[_GOALS.get(move["kind"].lower(), slice(0))]

    def motion(self, pos: int, move: re.Match[str], arguments: Lines) -> None:
        kind, text = move["kind"].lower(), " ".join(part for _, part in arguments)
        names = [name for at, goal in self.goals_of(move, arguments) for name in self.goal(at, goal)]
        if kind in ("approach", "depart", "draw"):
            by = arguments[-1][1] if arguments else ""
            by = by.lstrip("Vv") if kind == "draw" else f"(0, 0, -{by})"
            self.step(pos, f"{move['kind']} {text}", by, names, "frame" if kind == "draw" else "tool")
        elif kind == "rotate" or not (names or kind == "move"):
            self.relative(pos, f"{move['kind']} is a step from where the arm is")
        elif not names:
            self.computed(pos, f"Move {text}")
        return self.goes(pos, names)


_M = re.MULTILINE
_POINT = re.compile(r"^[ \t]*Point\d+[ \t]*\{([^{}]*)\}", _M)
_FIELD = re.compile(r"^[ \t]*([a-z]\w*)=([^\r\n]*?)[ \t]*\r?$", _M)
_HEAD = re.compile(r"^(?:ENVT\d+,.*|(?:sVersion|[nb]Display\w+|nNumberOf(?:Joints|Points))=.*)$", _M)
_COUNT = re.compile(r"^nNumberOf(Joints|Points)=(\d+)", _M)
_POSE, _WORDS = [f"r{axis}" for axis in "XYZUVW"], ("nHand", "nElbow", "nWrist")
# Of further axes and turns it is not published what they mean for an arm with six joints.
_ZERO = ("rR", "rS", "rT", "nJ1Flag", "nJ2Flag", "nJ4Flag", "nJ6Flag", "rJ1Angle", "rJ4Angle", "nUndefined")
_SPEL_VALUES = {
    **dict.fromkeys(_POSE, NUMBER),
    **dict.fromkeys(_ZERO, r"0(?:\.0*)?"),
    **dict.fromkeys(("nNumber", "nLocal"), r"\d+"),
    **dict.fromkeys((*_WORDS, "sLabel", "sDescription", "bSimVisible"), ".*"),
}
_FUNCTION = re.compile(r"^[ \t]*Function\b.*?^[ \t]*Fend\b", _I | _M | re.DOTALL)
_SPEL_MOVE = re.compile(r"(?:^|[ \t:])(Go|Move|Jump|Jump3|Jump3CP|Arc|Arc3|CVMove|Pass)[ \t]+([^\r\n]+)", _I)
_STEP = re.compile(r"(?:^|[ \t:])(TGo|TMove|BGo|BMove|PTran)[ \t]+([^\r\n]+)", _I)
_REFUSED = re.compile(r"[ \t]*(Pulse[ \t]+\S|Local[ \t]+\w|Base[ \t]+\w|LocalClr|Hofs|Calib|Teach)", _I)
_CHANGES = re.compile(r"[ \t]*(ImportPoints|PDel|ClearPoints)\b", _I)
_SPEL_TOOL = re.compile(r"[ \t]*Tool[ \t]+(\d+)?", _I)
_TLSET = re.compile(r"[ \t]*TLSet[ \t]+(\d+)[ \t]*,[ \t]*XY[ \t]*\(([^()]*)\)[ \t]*", _I)
_SPEL_JUMP = re.compile(r"[ \t]*(?:If|Else\w*|For|Do|Loop|While|Select|Case|GoTo|\w+:)(?:\b|$)", _I)
_SPEL_STORES = re.compile(
    r"[ \t]*(?:C[XYZRSTUVW][ \t]*\([ \t]*)?(P\d+|P[ \t]*\([^()]*\)|[A-Z_]\w*)[ \t]*\)?[ \t]*=", _I
)
_SPEL_OPTION = re.compile(r"!|\b(?:Till|Find|Sense|LimZ)\b", _I)
_GOAL = re.compile(
    r"(?P<name>P[ \t]*\([ \t]*\d+[ \t]*\)|[A-Z_]\w*)"
    r"(?P<added>(?:[ \t]*[-+:][ \t]*[XYZUVW][ \t]*\([^()]*\))*)"
    r"(?P<other>[ \t]*(?:/\w+|@\w+)?).*",
    _I,
)
_LITERAL = re.compile(r"(XY|JA)[ \t]*\(([^()]*)\)((?:[ \t]*/\w+)*)", _I)
_SHIFT = re.compile(rf"([-+])[ \t]*([XYZ])[ \t]*\([ \t]*({NUMBER})[ \t]*\)", _I)
_SPEL_WORD = re.compile(r"(?<![\w.])[A-Z_]\w*", _I)
_CALLED = re.compile(r"(?!P[ \t]*\([ \t]*\d+[ \t]*\))\w+[ \t]*\(", _I)


def read_spel(reading: BackupReading) -> None:
    """Files of points first, then functions. P1 of a program is that of each file of points."""
    names = SpelNames(_SPEL_WORD)
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
        known = all(re.fullmatch(_SPEL_VALUES.get(key, "(?!)"), text) for key, text in value.items())
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

    jump = _SPEL_JUMP

    def look(self, pos: int, text: str) -> None:
        if (put := _SPEL_TOOL.match(text)) is not None:
            self.active.set("tool", pos, put[1] and str(int(put[1])))
        if (made := _TLSET.fullmatch(text)) is not None and made[2].count(",") == 5:
            self.frame(pos, "tool", made[1], pose_of(from_abc, values_in(made[2])))
        elif re.match(r"[ \t]*TLSet\b", text, _I):
            self.refuse(pos, "TLSet: tools are set when the program runs")

    def statement(self, pos: int, text: str) -> None:
        name = self.names.plain(store[1]) if (store := _SPEL_STORES.match(text)) else ""
        if (refused := _REFUSED.match(text)) is not None:
            return self.refuse(pos, f"{refused[1].split()[0]}: pulses, frames or points that are set then")
        if (changes := _CHANGES.match(text)) is not None:
            return self.doubt(pos, "elsewhere", f"{changes[1]} changes points when the program runs")
        if (move := _SPEL_MOVE.search(text)) is not None:
            for at, part in parts_of(_SPEL_OPTION.split(move[2])[0]):
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
