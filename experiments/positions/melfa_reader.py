"""Positions of MELFA-BASIC programs (Mitsubishi), with the variables that are saved behind them."""

from __future__ import annotations

import re

from ...model.kinematics.orientation import from_rpy
from .position import BackupReading, pose_of
from .position_names import PositionNames
from .script import LineProgram
from .statement_text import NUMBER, Lines, numbers_in, parts_of, values_in

_I = re.IGNORECASE
_VALUES = rf"\([ \t]*{NUMBER}(?:[ \t]*,[ \t]*{NUMBER})*[ \t]*\)"
_FLAGS = r"(?:[ \t]*\([ \t]*\d+[ \t]*,[ \t]*\d+[ \t]*\))?"
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
_ONE = rf"(?:{_NAME}){_INDEX}"
_WORD = re.compile(rf"(?<![\w.]){_ONE}", _I)


def read_melfa(reading: BackupReading) -> None:
    """Each program has variables of its own."""
    for file in reading.files:
        program = MelfaProgram(file, reading, PositionNames(_WORD))
        lines = [(line.start(1), line[1]) for line in _LINE.finditer(file.bare) if line[1]]
        program.variables(lines)
        program.prepare(lines)
        program.run()


class MelfaProgram(LineProgram):
    """A program with its variables."""

    jump = _JUMP
    literal = re.compile(rf"(?P<numbers>{_VALUES})(?P<flags>{_FLAGS})")
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
        if (put := _TOOL.fullmatch(text)) is not None:
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
        if _TOOL.fullmatch(text) or (entry and self.literal.fullmatch(entry[3])):
            return None
        if (move := _MOVE.search(text)) is not None:
            goals: list[str] = []
            for at, goal in parts_of(re.split(r"[ \t](?:Wth(?:If)?|Type)\b", move[2], flags=_I)[0]):
                if re.fullmatch(NUMBER, goal) and goals:
                    self.relative(pos, text[:40], goals[-1:], (0.0, 0.0, float(goal)), "tool")
                else:
                    goals += self.goal(pos + move.start(2) + at, goal)
            return self.goes(pos, goals)
        if (store := _STORES.fullmatch(text)) is not None:
            self.names.changed(self, pos, f"{store[1]}{store[2]}")
            return self.moves(pos, self.goal(pos + store.start(3), store[3].strip()))
        return self.names.used(self, pos, text)
