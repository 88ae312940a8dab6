"""Programs whose statements move to positions: what the readers of all languages share, what those share
whose lines assign positions to names, and the names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from .position import (
    Active,
    BackupReading,
    FileReading,
    Lines,
    SourceFile,
    What,
    arguments_of,
    is_computed,
    numbers_in,
    parts_of,
    values_in,
    words_in,
)


@dataclass
class PositionNames:
    """`word` is a name with its index. `keys` are names in the backup by those of statements, `scope` is
    whose they are, if not of a file alone."""

    word: re.Pattern[str]
    keys: dict[str, list[str]] = field(default_factory=dict)
    scope: str | None = None
    arrays: dict[str, list[str]] = field(default_factory=dict)  # by their names without an index

    def plain(self, name: str) -> str:
        """A name without blanks, in small letters."""
        return re.sub(r"\s", "", name).lower()

    def store(self, name: str, *keys: str) -> None:
        """A name of positions that are in the backup."""
        plain = self.plain(name)
        self.keys.setdefault(plain, []).extend(keys)
        self.arrays.setdefault(stem_of(plain), []).extend(keys)

    def of(self, file: SourceFile, name: str) -> list[str]:
        """Those of a name, which may be stored elsewhere."""
        return self.keys.get(
            self.plain(name), [f"{file.name if self.scope is None else self.scope}:{self.plain(name)}"]
        )

    def elements(self, text: str) -> list[str] | None:
        """Those of an array, in the backup, of which a name has no index, or a variable for it; None of
        another name."""
        name, index = self.plain(text), re.search(r"[\[(].*", text, re.DOTALL)
        if name in self.keys or (index is not None and re.fullmatch(r".[\d,\s]+.", index[0])):
            return None
        return sorted(self.arrays.get(stem_of(name), ()))

    def goals(self, here: FileReading, pos: int, text: str) -> list[str]:
        """Those of a goal; of an array whose index is a variable all its elements."""
        if self.word.fullmatch(text) is None:
            here.computed(pos, text)
            here.reading.added |= {
                key for word in self.stored_in(text) for key in self.keys.get(self.plain(word), ())
            }
            return []
        elements = self.elements(text)
        if elements is None or not re.search(r"[\[(]", text):
            return self.of(here.file, text)
        here.computed(pos, text)
        return elements

    def changed(self, here: FileReading, pos: int, text: str) -> None:
        """A statement changes the position of this name when the program runs."""
        if re.search(r"[\[(]", text) and self.elements(text):
            return here.refuse(pos, f"{text}: which position is overwritten is not known before it runs")
        for each in self.of(here.file, text):
            here.overwrites(pos, each, text)
        return None

    def used(self, here: FileReading, pos: int, text: str) -> None:
        """A statement that is no motion has these names."""
        for word in self.stored_in(text):
            keys = self.elements(word) or self.of(here.file, word)
            here.doubt(pos, "call", f"{word} is used by this statement", keys[0])

    def stored_in(self, text: str) -> list[str]:
        """The names of positions of the backup that are in a text, or of arrays of them."""
        words = []
        for word in self.word.findall(text):
            if self.keys.get(self.plain(word)) or self.elements(word):
                words.append(word)
            elif inner := re.search(r"[\[(].*", word, re.DOTALL):
                words += self.stored_in(inner[0][1:])
        return words


def stem_of(name: str) -> str:
    """That of an array, without an index."""
    return re.split(r"[\[(]", name)[0]


class SharedNames(PositionNames):
    """Names that belong to all files: what is stored nowhere has its own."""

    def of(self, file: SourceFile, name: str) -> list[str]:
        return self.keys.get(self.plain(name), [self.plain(name)])


class LineProgram(FileReading):
    """A program, or a section of a file, whose lines are statements. First `look` takes what they set, and
    `jump` is how one begins that branches, `straight` is all of one that is followed by the next, and that
    nothing but the one before leads to; then `statement` takes the positions of each. `literal` (with the
    group `numbers`) is that of a position, `begin` how one begins that says what it is, `shifts` are those of
    a goal with an offset (groups `goal`, `by` and `sign`) in these axes."""

    jump = straight = re.compile(r"(?!)")
    literal = begin = re.compile(r"(?!)")
    shifts: Sequence[tuple[re.Pattern[str], What | None]] = ()

    def __init__(self, file: SourceFile, reading: BackupReading, names: PositionNames) -> None:
        super().__init__(file, reading)
        self.names, self.active = names, Active()
        self.joints = False  # whether the motion at hand takes a literal as joints
        self.lines: Lines = []

    def look(self, pos: int, text: str) -> None:
        """A line that may set the tool or the frame."""

    def statement(self, pos: int, text: str) -> None:
        """A line that may move, or change a position."""
        raise NotImplementedError

    def prepare(self, lines: Lines) -> None:
        """What these lines set where; a `def` before all others is no branch."""
        self.lines = lines
        for number, (pos, text) in enumerate(lines):
            self.active.jumps |= (number > 0 or text[:4] != "def ") and self.jump.match(text) is not None
            if text.strip() and self.straight.fullmatch(text) is None:
                self.active.edges.append(pos)
            self.look(pos, text)

    def run(self) -> None:
        """Its motions, and what else has positions."""
        for pos, text in self.lines:
            self.statement(pos, text)

    def goes(self, pos: int, names: Sequence[str], frame: str | None = None) -> None:
        """A motion with the tool that is set there, and the frame, if none is stated."""
        self.moves(pos, names, self.active.at("tool", pos), frame or self.active.at("frame", pos))

    def is_joints(self, literal: re.Match[str]) -> bool | None:
        """Whether a literal is joints; None where it does not say so itself."""
        return None

    def goal(self, pos: int, text: str) -> list[str]:
        """The names of a goal of a motion."""
        for pattern, axes in self.shifts:
            if (shift := pattern.fullmatch(text)) is not None:
                names = self.goal(pos + shift.start("goal"), shift["goal"])
                unit = -1 if shift.groupdict().get("sign") == "-" else 1
                self.step(pos, text, shift["by"], names, axes, unit)
                return names
        if (literal := self.literal.fullmatch(text)) is not None:
            (key, label), joints = self.inline(pos), self.is_joints(literal)
            self.add_literal(pos, literal, key, label, joints=self.joints if joints is None else joints)
            return [one.name for one in self.reading.positions[-1:] if one.name == key]
        self.damaged(pos, text, self.inline(pos)[1])
        return self.names.goals(self, pos, text)

    def damaged(self, pos: int, text: str, label: str) -> None:
        """A text that begins as a literal and is none: a position that is not understood, unless it is
        computed, of names."""
        begin = self.begin.match(text)
        numbers = "" if begin is None else text[begin.end() :]
        if words_in(numbers) and not is_computed(numbers):
            self.unread(pos, f"{label}: this position is not understood", label)

    def add_literal(
        self, pos: int, literal: re.Match[str], key: str, label: str, *, joints: bool, register: bool = False
    ) -> None:
        """The position of a literal at `pos`."""
        spans = numbers_in(literal["numbers"], pos + literal.start("numbers"))
        self.six(pos, key, label, spans, joints=joints, register=register)

    def added(self, text: str) -> list[float]:
        """The numbers of a stored position that is no place, but an offset or a tool; empty of others."""
        keys = self.names.keys.get(self.names.plain(text), [])
        self.reading.added |= {*keys}
        return [value for one in self.reading.positions if one.name in keys for value in one.values]

    def step(
        self,
        pos: int,
        text: str,
        by: str,
        names: Sequence[str] = (),
        axes: What | None = None,
        unit: float = 1,
    ) -> None:
        """A relative motion by mm of what a text means, from a goal or from where the arm is; it is not in
        numbers where it rotates too."""
        literal = self.literal.fullmatch(by)
        numbers = self.added(by) if literal is None else values_in(literal["numbers"])
        plain = len(numbers) >= 3 and not any(numbers[3:6])
        self.relative(pos, text[:40], names, [unit * each for each in numbers[:3]] if plain else None, axes)


class Script(LineProgram):
    """One program. A language has the patterns: `assign` has `name`, `index` and `value`, `move` ends where
    its arguments begin, `refused` are words that set tools or frames. `kinds` say whether motions take a name
    as joints."""

    assign: re.Pattern[str]
    move: re.Pattern[str]
    refused: re.Pattern[str]
    word = re.compile(r"(?<![\w.\"'$])[A-Za-z_]\w*(?!\w)")

    def __init__(self, file: SourceFile, reading: BackupReading, names: PositionNames | None = None) -> None:
        super().__init__(file, reading, names or PositionNames(self.word))
        self.kinds: dict[str, set[bool]] = {}

    def setting(self, pos: int, text: str) -> None:
        """A line that may set the tool or the frame."""

    def goals_of(self, move: re.Match[str], arguments: Lines) -> Lines:
        """Those of the arguments that are goals: two of a circle."""
        return arguments[: 2 if move["kind"].endswith("c") else 1]

    def motion(self, pos: int, move: re.Match[str], arguments: Lines) -> None:
        """A motion, with its arguments: of goals in the base, by default."""
        names = [name for at, text in self.goals_of(move, arguments) for name in self.goal(at, text)]
        self.goes(pos, names, "base")

    def takes_joints(self, move: re.Match[str]) -> bool:
        """Whether a literal that does not say it is joints in this motion."""
        return True

    def other(self, pos: int, text: str) -> None:
        """A line that neither moves nor assigns."""
        self.names.used(self, pos, text)

    def arguments(self, text: str, move: re.Match[str]) -> Lines:
        return arguments_of(text, move.end())

    # What they share

    def scan(self, start: int = 0, end: int | None = None) -> None:
        """Prepare its lines from one place to another, of which brackets that are open go on."""
        lines = [line for line in parts_of(self.file.bare, start, end, "\n;") if line[1]]
        for pos, text in lines:
            if len(re.findall(r"[\[({]", text)) != len(re.findall(r"[\])}]", text)):
                self.unread(pos, "a bracket is not closed, or not opened")
            for move in self.move.finditer(text):
                for _, goal in self.goals_of(move, self.arguments(text, move)):
                    for word in self.word.findall(goal):
                        self.kinds.setdefault(self.names.plain(word), set()).add(self.takes_joints(move))
        self.prepare(lines)

    def look(self, pos: int, text: str) -> None:
        """What a line sets, and assigns."""
        self.setting(pos, text)
        if (assign := self.assign.fullmatch(text)) is not None and not assign["index"]:
            self.assigned(pos, assign)

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
        if assign is None and not moves and self.jump.match(text):
            self.names.used(self, pos, text)
        elif assign is None and not moves:
            self.other(pos, text)
        elif assign is not None and not moves:
            name, plain, value = assign["name"], self.names.plain(assign["name"]), assign["value"].strip()
            fixed = self.literal.fullmatch(value) is not None and not assign["index"]
            if not fixed and (self.begin.match(value) or self.names.stored_in(value)):
                self.reading.made.append((self.file, self.file.line(pos), name))
            if not fixed and (plain in self.names.keys or plain in self.kinds or self.names.elements(name)):
                self.names.changed(self, pos, name)
            self.names.used(self, pos, assign["index"] + assign["value"])
