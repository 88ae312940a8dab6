"""Positions of RAPID modules (ABB)."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ...model.kinematics.orientation import from_quaternion
from .position import (
    NUMBER,
    BackupReading,
    FileReading,
    What,
    numbers_in,
    pose_of,
    split_arguments,
    values_in,
)

_UNUSED = 9e9  # of an external axis
_REST = r"(?<!PROC )(?<![\w\\.])"


def _row(count: int) -> str:
    return r"\s*\[" + ",".join([rf"\s*{NUMBER}\s*"] * count) + r"\]\s*"


_LITERAL = re.compile(rf"(?P<pose>\[{_row(3)},{_row(4)},{_row(4)},{_row(6)}\])|\[{_row(6)},{_row(6)}\]")
_FRAME = rf"\s*(\[{_row(3)},{_row(4)}\])"
_TOOL = re.compile(rf"\s*\[\s*(TRUE|FALSE)\s*,{_FRAME}", re.IGNORECASE)
_WOBJ = re.compile(
    rf'\s*\[\s*(TRUE|FALSE)\s*,\s*(TRUE|FALSE)\s*,\s*"[^"]*"\s*,{_FRAME}\s*,{_FRAME}', re.IGNORECASE
)
_DATA = re.compile(
    r"\b(?P<local>LOCAL\s+)?(?:CONST|PERS|VAR)\s+(?P<kind>robtarget|jointtarget|tooldata|wobjdata)\s+(?P<name>[A-Za-z]\w*)\s*"
    r"(?P<sizes>\{[\d\s,]*\})?\s*(?::=(?P<value>[^;]*))?;",
    re.IGNORECASE,
)
_WORDS = r"(?:Move|Trigg|Search|Arc|Spot|Paint|Disp|Nut|Glue)\w*\b(?=\s*[\\A-Z\[*])(?!\s*:=)"
_MOVE = re.compile(_REST + _WORDS, re.IGNORECASE)
_SHIFTED = re.compile(r"\b(PDispOn|PDispSet|EOffsOn|EOffsSet)\b", re.IGNORECASE)
_ADDED = re.compile(r"(Offs|RelTool)\s*\(\s*(\w+(?:\s*\{[^}]*\})?)\s*,(.*)\)", re.IGNORECASE | re.DOTALL)
_ASSIGNED = re.compile(r"(?<![\w.\\])([A-Za-z]\w*)\s*(?:\{[^{}]*\})?(?:\.\w+)*\s*:=")
_WORD = re.compile(r"[A-Za-z]\w*")
_SWITCH = re.compile(r"^(\s*\\\w+)+\s*(?::=.*)?")


def read_rapid(reading: BackupReading) -> None:
    """All modules of a task: data first, then statements."""
    kinds: dict[str, str] = {}  # of what is declared, by its name in small letters
    modules = [RapidModule(file, reading, kinds) for file in reading.files]
    for module in modules:
        module.whole(r"^[ \t]*MODULE\b", r"\bENDMODULE\b")
        for data in _DATA.finditer(module.file.bare):
            module.declared(data)
    for module in modules:
        end, text = 0, _DATA.sub(lambda data: " " * (len(data[0]) - 1) + ";", module.file.bare)
        for match in re.finditer(";", text):
            module.statement(text[end : match.start()], end)
            end = match.end()


@dataclass
class RapidModule(FileReading):
    """A module; `kinds` are those of the data of all modules."""

    kinds: dict[str, str]

    def _name(self, word: str) -> str:
        """A name as it is unique: LOCAL data are of their module alone, and hide those of others."""
        local = f"{self.file.name}:{word.strip().lower()}"
        return local if local in self.kinds else word.strip().lower()

    def declared(self, data: re.Match[str]) -> None:
        """Data of a kind: positions, a tool or a work object."""
        kind, label, value, pos = data["kind"].lower(), data["name"], data["value"] or "", data.start("name")
        name = f"{self.file.name}:{label.lower()}" if data["local"] else label.lower()
        target = kind.endswith("target")
        known = self.kinds.setdefault(name, kind)
        if known != kind or (target and any(name == one.name for one in self.reading.positions)):
            self.refuse(pos, f"{label} is declared twice: convert the backup of one task alone")
        if target:
            literals = list(_LITERAL.finditer(value))
            for number, literal in enumerate(literals, start=1):
                each = f"{label}{{{number}}}" if data["sizes"] else label
                self._position(literal, data.start("value"), name, each)
            if re.sub(r"[\[\],\s]", "", _LITERAL.sub("", value)) or (value and not literals):
                self.unread(pos, f"the numbers of {label} are not understood", label)
        elif value:
            tool, why, pose = kind == "tooldata", f"{label} is not understood", None
            match = (_TOOL if tool else _WOBJ).match(value)
            if match is not None and (match[1].upper() == "TRUE") != tool:
                why = f"{label} is a stationary tool, or work that the arm holds (remote TCP)"
            elif match is not None and not tool and match[2].upper() == "FALSE":
                why = f"{label} is moved by an external unit"
            elif match is not None:
                texts = match[2 if tool else 3], "0,0,0,1,0,0,0" if tool else match[4]
                outer, inner = (pose_of(from_quaternion, values_in(each)) for each in texts)
                pose = None if outer is None or inner is None else outer @ inner
            self.frame(pos, "tool" if tool else "frame", name, pose, why)

    def _position(self, literal: re.Match[str], offset: int, name: str, label: str) -> None:
        pos = offset + literal.start()
        spans = numbers_in(literal[0], pos)
        values = self.numbers(spans)
        external = [value for value in values[11 if literal["pose"] else 6 :] if value != _UNUSED]
        if not literal["pose"]:
            self.add(pos, name, label, spans[:6], axes=range(6), external=external)
        elif any(values[3:7]):
            self.add(pos, name, label, spans[:7], spans[7:11], external=external)
        else:
            self.unread(pos, f"{label} has no orientation", label)

    def statement(self, text: str, start: int) -> None:
        """A statement that is no declaration."""
        for assigned in _ASSIGNED.finditer(text):
            name, pos = self._name(assigned[1]), start + assigned.start(1)
            kind = self.kinds.get(name, "")
            if kind.endswith("target"):
                self.overwrites(pos, name, assigned[1])
            elif kind or name in ("tool0", "wobj0"):
                self.refuse(pos, f"{assigned[1]} is set when the program runs")
        if shifted := _SHIFTED.search(text):
            self.refuse(start + shifted.start(), f"{shifted[0]} moves all targets when the program runs")
        if (move := _MOVE.search(text)) is not None:
            return self._motion(text[move.start() :], start + move.start())
        for literal in _LITERAL.finditer(text):
            self.refuse(start + literal.start(), "it is not said what this position is for")
        called = re.match(r"\s*[A-Za-z]\w*\s+(?!:=)[^:]*", text)  # a procedure may change its arguments
        used = ("target", "data") if called else ("target",)
        for word in _WORD.finditer(_ASSIGNED.sub(lambda assigned: " " * len(assigned[0]), text)):
            if self.kinds.get(name := self._name(word[0]), "").endswith(used):
                self.doubt(start + word.start(), "call", f"{word[0]} is used by this statement", name)
        return None

    def _motion(self, text: str, start: int) -> None:
        word = _WORD.match(text)
        assert word is not None
        behind = [(at, _SWITCH.sub("", part)) for at, part in split_arguments(text[word.end() :])]
        parts = [(start + word.end() + at, part.strip()) for at, part in behind if part.strip()]
        words = [part.split("\\")[0].strip() for _, part in parts[1:]]
        words = [self._name(each) for each in words if _WORD.fullmatch(each)]
        tools = [each for each in words if self.kinds.get(each, each) in ("tooldata", "tool0")] or words[-1:]
        frame = re.search(r"\\\s*WObj\s*:=\s*(\w+)", text, re.IGNORECASE)
        count, moved = 2 if re.match(r"(?:Move|Trigg|Search|Arc)C", word[0], re.IGNORECASE) else 1, []
        for at, part in parts[:count] if not word[0].lower().startswith("moveext") else ():
            goal = part if "(" in part else part.split("\\")[0].strip()
            moved += self._goal(at, goal)
        work = self._name(frame[1]) if frame else "wobj0"
        return self.moves(start, moved, tools[0] if tools else None, work)

    def _goal(self, at: int, goal: str) -> list[str]:
        """Its name; Offs and RelTool are relative to it."""
        if (literal := _LITERAL.fullmatch(goal)) is not None:
            at = self.file.bare.index("[", at)
            name, label = self.inline(at)
            self._position(literal, at, name, label)
            return [name]
        added = _ADDED.fullmatch(goal)
        word = re.sub(r"\s*\{.*", "", added[2] if added else goal)
        if not _WORD.fullmatch(word) or ("(" in goal and added is None):
            self.computed(at, goal)
            return []
        name = self._name(word)
        if added:
            numbers = [float(each) for each in re.findall(rf"(?<![\w.]){NUMBER}(?=\s*(?:,|$))", added[3])]
            plain = len(numbers) == 3 == added[3].count(",") + 1 and "\\" not in added[3]
            axes: What = "tool" if added[1].lower() == "reltool" else "frame"
            self.relative(at, f"{added[1]} of {added[2]}", [name], numbers if plain else None, axes)
        return [name]
