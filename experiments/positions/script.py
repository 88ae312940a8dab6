"""Programs whose statements move to positions: what the readers of all languages share, and what those share
whose lines assign positions to names."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

from .position import (
    NUMBER,
    Active,
    BackupReading,
    Doubt,
    SourceFile,
    Span,
    What,
    arguments_of,
    numbers_in,
    split_arguments,
)
from .position_names import PositionNames

Arguments = list[tuple[int, str]]  # each with its place


class LineProgram:
    """A program, or a section of a file, whose lines are statements: what is set where, and its positions."""

    def __init__(self, file: SourceFile, names: PositionNames) -> None:
        self.file, self.names, self.reading = file, names, names.reading
        self.active = Active()

    def add(
        self,
        pos: int,
        name: str,
        label: str,
        spans: Sequence[Span],
        configuration: Sequence[Span] = (),
        **others: Any,
    ) -> None:
        self.reading.add(self.file, pos, name, label, spans, configuration, **others)

    def unread(self, pos: int, sentence: str, label: str | None = "") -> None:
        self.reading.unread(self.file, pos, sentence, label)

    def refuse(self, pos: int, sentence: str) -> None:
        self.reading.refuse(self.file, pos, sentence)

    def doubt(self, pos: int, kind: Doubt, sentence: str) -> None:
        self.reading.doubt(self.file, pos, kind, sentence)

    def moves(
        self, pos: int, names: Sequence[str], tool: str | None = None, frame: str | None = None
    ) -> None:
        self.reading.moves(self.file, pos, names, tool, frame)

    def relative(
        self,
        pos: int,
        sentence: str,
        names: Sequence[str] = (),
        offset: Sequence[float] | None = None,
        axes: What | None = None,
    ) -> None:
        """A move by an offset from a goal, or from where the arm is."""
        by = None if offset is None else tuple(offset)
        self.reading.doubt(self.file, pos, "relative", sentence, names[0] if names else None, by, axes)


class Script(LineProgram):
    """One program. A language has the patterns: `literal` has the group `numbers`, `begin` is how one begins
    that says what it is, `assign` has `name`, `index` and `value`, `move` ends where its arguments begin,
    `refused` are words that set tools or frames. `kinds` say whether motions take a name as joints."""

    literal: re.Pattern[str]
    begin = re.compile(r"(?!)")
    assign: re.Pattern[str]
    move: re.Pattern[str]
    jump: re.Pattern[str]
    refused: re.Pattern[str]
    word = re.compile(r"(?<![\w.\"'$])[A-Za-z_]\w*(?!\w)")

    def __init__(self, file: SourceFile, reading: BackupReading, names: PositionNames | None = None) -> None:
        super().__init__(file, names or PositionNames(reading, self.word))
        self.kinds: dict[str, set[bool]] = {}
        self.joints = False  # whether the motion at hand takes a literal as joints

    # What a language says

    def is_joints(self, literal: re.Match[str]) -> bool | None:
        """Whether a literal is joints; None where it does not say so itself."""
        raise NotImplementedError

    def setting(self, pos: int, text: str) -> None:
        """A line that may set the tool or the frame."""

    def goals_of(self, move: re.Match[str], arguments: Arguments) -> Arguments:
        """Those of the arguments that are goals."""
        raise NotImplementedError

    def motion(self, pos: int, move: re.Match[str], arguments: Arguments) -> None:
        """A motion, with its arguments."""
        raise NotImplementedError

    def takes_joints(self, move: re.Match[str]) -> bool:
        """Whether a literal that does not say it is joints in this motion."""
        return True

    def other(self, pos: int, text: str) -> None:
        """A line that neither moves nor assigns."""
        self.names.used(self.file, pos, text)

    def arguments(self, text: str, move: re.Match[str]) -> Arguments:
        return arguments_of(text, move.end())

    # What they share

    def prepare(self, start: int = 0, end: int | None = None) -> None:
        """Its lines from one place to another, of which brackets that are open go on: what they set and
        assign."""
        parts = split_arguments(self.file.bare[start:end], "\n;")
        self.lines = [
            (start + at + len(part) - len(part.lstrip()), part.strip()) for at, part in parts if part.strip()
        ]
        for number, (pos, text) in enumerate(self.lines):
            if len(re.findall(r"[\[({]", text)) != len(re.findall(r"[\])}]", text)):
                self.unread(pos, "a bracket is not closed, or not opened")
            self.active.jumps |= (number > 0 or text[:4] != "def ") and self.jump.match(text) is not None
            for move in self.move.finditer(text):
                for _, goal in self.goals_of(move, self.arguments(text, move)):
                    for word in self.word.findall(goal):
                        self.kinds.setdefault(self.names.plain(word), set()).add(self.takes_joints(move))
        for pos, text in self.lines:
            self.setting(pos, text)
            if (assign := self.assign.fullmatch(text)) is not None and not assign["index"]:
                self.assigned(pos, assign)

    def run(self) -> None:
        """Its motions, and what else has positions."""
        for pos, text in self.lines:
            self.statement(pos, text)

    def assigned(self, pos: int, assign: re.Match[str]) -> None:
        """A position, if it is a literal that says what it is, or that a motion takes as what it is."""
        value, name = assign["value"].strip(), assign["name"]
        literal = self.literal.fullmatch(value)
        if literal is None:
            return self.damaged(pos, value, name)
        joints = self.is_joints(literal)
        kinds = self.kinds.get(self.names.plain(name), set()) if joints is None else {joints}
        if not kinds:
            return None
        if self.names.plain(name) in self.names.keys or len(kinds) > 1:
            return self.refuse(pos, f"{name} has several values, or is joints and a pose")
        (key,) = self.names.of(self.file, name)
        self.names.store(name, key)
        at = pos + assign.start("value")
        return self.add_literal(at, literal, key, name, joints=kinds == {True}, register=True)

    def damaged(self, pos: int, text: str, label: str) -> None:
        """A text that begins as a literal and is none: a position that is not understood, unless it is
        computed, of names."""
        begin = self.begin.match(text)
        words = [] if begin is None else re.findall(r"[\w.]+(?:(?<=[eE])[-+]\d+)?", text[begin.end() :])
        numbers = [word for word in words if not re.match(r"[^\W\d]", word)]
        if numbers and (numbers == words or not all(re.fullmatch(NUMBER, word) for word in numbers)):
            self.unread(pos, f"{label}: this position is not understood", label)

    def add_literal(
        self, pos: int, literal: re.Match[str], key: str, label: str, *, joints: bool, register: bool = False
    ) -> None:
        """The position of a literal at `pos`."""
        spans = numbers_in(literal["numbers"], pos + literal.start("numbers"))
        self.reading.six(self.file, pos, key, label, spans, joints=joints, register=register)

    def statement(self, pos: int, text: str) -> None:
        if (refused := self.refused.search(text)) is not None:
            sentence = f"{' '.join(refused[0].split())}: tools or frames are set when the program runs"
            self.refuse(pos, sentence)
        moves = list(self.move.finditer(text))
        for move in moves:
            arguments = [(pos + at, part) for at, part in self.arguments(text, move)]
            self.joints = self.takes_joints(move)
            self.motion(pos + move.start(), move, arguments)
        assign = self.assign.fullmatch(text)
        if assign is None and not moves and not self.jump.match(text):
            self.other(pos, text)
        elif assign is not None and not moves:
            name, plain = assign["name"], self.names.plain(assign["name"])
            fixed = self.literal.fullmatch(assign["value"].strip()) is not None and not assign["index"]
            if re.search(r"[\[(].*[a-z_]", plain) and plain not in self.names.keys:
                sentence = f"{name}: which position is overwritten is not known before it runs"
                self.refuse(pos, sentence)
            elif not fixed and (plain in self.names.keys or plain in self.kinds):
                self.reading.overwrites(self.file, pos, self.names.of(self.file, name)[0], name)
            self.names.used(self.file, pos, assign["value"])

    def goal(self, pos: int, text: str) -> list[str]:
        """The names of a goal of a motion."""
        if (literal := self.literal.fullmatch(text)) is not None:
            key, joints = f"{self.file.name}:{pos}", self.is_joints(literal)
            joints = self.joints if joints is None else joints
            self.add_literal(pos, literal, key, f"line {self.file.line(pos)}", joints=joints)
            return [one.name for one in self.reading.positions[-1:] if one.name == key]
        self.damaged(pos, text, f"line {self.file.line(pos)}")
        return self.names.goals(self.file, pos, text)

    def step(
        self,
        pos: int,
        text: str,
        by: str,
        names: Sequence[str] = (),
        axes: What | None = None,
        unit: float = 1,
    ) -> None:
        """A relative motion by what a text means, from a goal or from where the arm is."""
        self.reading.added |= set(self.names.keys.get(self.names.plain(by), []))
        self.relative(pos, text[:40], names, self.offset(by, unit), axes)

    def offset(self, text: str, unit: float = 1) -> list[float] | None:
        """mm of a literal or a name; None where it is not in numbers, or a rotation too."""
        keys, literal = self.names.keys.get(self.names.plain(text), []), self.literal.fullmatch(text)
        numbers = [value for one in self.reading.positions if one.name in keys for value in one.values]
        if literal is not None:
            spans: Iterable[tuple[int, int]] = numbers_in(literal["numbers"])
            numbers = [float(literal["numbers"][slice(*span)]) for span in spans]
        return (
            [unit * value for value in numbers[:3]] if len(numbers) >= 3 and not any(numbers[3:6]) else None
        )
