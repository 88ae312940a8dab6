"""Positions of MELFA-BASIC programs (Mitsubishi), with the variables that are saved behind them."""

from __future__ import annotations

import re

from ...model.kinematics.orientation import from_rpy
from .position import BackupReading, pose_of
from .position_names import PositionNames
from .script import LineProgram, Lines
from .statement_text import NUMBER, numbers_in, split_arguments, values_in

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
        program = MelfaProgram(file, reading, PositionNames(_WORD))
        lines = [(line.start(1), line[1]) for line in _LINE.finditer(file.bare) if line[1]]
        program.variables(lines)
        program.prepare(lines)
        program.run()


class MelfaProgram(LineProgram):
    """A program with its variables."""

    jump = _JUMP

    def variables(self, lines: Lines) -> None:
        """Those that are saved behind it."""
        for pos, text in lines:
            if (entry := _STORED.fullmatch(text)) is not None:
                self._entry(pos, entry)

    def look(self, pos: int, text: str) -> None:
        if (put := _TOOL.fullmatch(text)) is not None:
            self.active.set("tool", pos, self._tool(pos, put[1]))

    def _entry(self, pos: int, entry: re.Match[str]) -> None:
        label, literal = f"{entry[1]}{entry[2]}", _LITERAL.fullmatch(entry[3])
        name = self.names.plain(label)
        if literal is None:
            if re.fullmatch(r"\([-+.\d\s,*#]*\)?.*", entry[3]) and not re.search(r"[A-Z]", entry[3], _I):
                self.unread(pos, f"{label}: this position is not understood", label)
            return None
        if name in self.names.keys:
            return self.refuse(pos, f"the program overwrites the stored position {label}")
        self.names.store(label, f"{self.file.name}:{name}")
        return self._literal(pos + entry.start(3), literal, f"{self.file.name}:{name}", label, register=True)

    def _literal(
        self, pos: int, literal: re.Match[str], name: str, label: str, *, register: bool = False
    ) -> None:
        spans = numbers_in(literal[1], pos + literal.start(1))
        flags = numbers_in(literal[2], pos + literal.start(2))
        joints = label[0] in "jJ"
        plain = len(flags) == 2 and not joints and not any(self.numbers(flags[1:]))
        if len(spans) >= 6 and not plain and (flags or not joints):
            return self.unread(pos, f"{label}: turns of joints, or no flags, are not understood", label)
        frame = None if joints else "0"
        return self.six(pos, name, label, spans, flags, joints=joints, register=register, frame=frame)

    def _tool(self, pos: int, text: str) -> str | None:
        """The name of a tool that is set; None where that is computed."""
        if text.upper() == "P_NTOOL":
            return "p_ntool"
        (name,), numbers = self.names.keys.get(self.names.plain(text), [""]), self.added(text)[:6]
        if (literal := _LITERAL.fullmatch(text)) is not None:
            name, numbers = f"{self.file.name}:tool{pos}", values_in(literal[1])[:6]
        if len(numbers) == 6 and ("tool", name) not in self.reading.frames:
            self.frame(pos, "tool", name, pose_of(from_rpy, numbers))
        return name or None

    def statement(self, pos: int, text: str) -> None:
        if (run_time := _SET.match(text)) is not None:
            return self.refuse(pos, f"{run_time[1]}: tools, frames or pallets are set when the program runs")
        if _TOOL.fullmatch(text) or ((entry := _STORED.fullmatch(text)) and _LITERAL.fullmatch(entry[3])):
            return None
        if (move := _MOVE.search(text)) is not None:
            goals: list[str] = []
            parts = re.split(r"[ \t](?:Wth(?:If)?|Type)\b", move[2], flags=_I)[0]
            for at, part in split_arguments(parts):
                goal, begin = part.strip(), pos + move.start(2) + at + len(part) - len(part.lstrip())
                if re.fullmatch(NUMBER, goal) and goals:
                    self.relative(pos, text[:40], goals[-1:], (0.0, 0.0, float(goal)), "tool")
                else:
                    goals += self._goals(begin, goal)
            return self.goes(pos, goals)
        if (store := _STORES.fullmatch(text)) is not None:
            label = f"{store[1]}{store[2]}"
            self.names.changed(self, pos, label)
            return self.moves(pos, self._goals(pos + store.start(3), store[3].strip()))
        return self.names.used(self, pos, text)

    def _goals(self, pos: int, goal: str) -> list[str]:
        """The names of a goal. A + B has the components of both, A * B is B in the axes of the tool at A."""
        if (literal := _LITERAL.fullmatch(goal)) is not None:
            name, label = self.inline(pos)
            self._literal(pos, literal, name, label)
            return [name]
        if (sum_ := _ADDED.fullmatch(goal)) is None:
            return self.names.goals(self, pos, goal)
        goals, values = self._goals(pos, sum_[1]), self.added(sum_[3])
        offset = values[:3] if values and not any(values[3:]) else None
        self.relative(pos, sum_[0][:40], goals, offset, "tool" if sum_[2] == "*" else "frame")
        return goals
