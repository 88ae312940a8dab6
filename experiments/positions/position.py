"""What a reader finds in a backup: positions with the bytes of their numbers, tools and frames, statements
that name positions, and what is relative, computed or stored elsewhere.

A file is text of which each letter is one byte (Latin-1), so that places are bytes and all else stays.
"""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

from ...model.errors import BadInput
from ...model.kinematics.orientation import (
    Orientation,
    from_abc,
    from_quaternion,
    from_rotation_vector,
    from_rpy,
    from_xyz,
    from_zyz,
    orientation,
)
from ...model.options import PendantUnit

if TYPE_CHECKING:
    from ...model.arrays import Matrix
    from ...model.files.robot_file import Vendor
    from ...model.kinematics.inverse import Branch

Span = tuple[int, int]
Lines = list[tuple[int, str]]  # or arguments, each with its place
NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"


def lines_in(text: str, start: int = 0, end: int | None = None, line: str = r"[^\r\n]+") -> Lines:
    """The lines of a part of a text that are not empty, each with its place."""
    lines = re.compile(line).finditer(text, start, len(text) if end is None else end)
    return [(each.start(), each[0]) for each in lines]


def numbers_in(text: str, start: int = 0) -> list[Span]:
    """The places of all numbers of a text."""
    return [
        (start + match.start(), start + match.end()) for match in re.finditer(rf"(?<![\w.]){NUMBER}", text)
    ]


def values_in(text: str) -> list[float]:
    """All numbers of a text."""
    return [float(text[start:end]) for start, end in numbers_in(text)]


def words_in(text: str) -> list[str]:
    """Names and numbers of a text, whether they are right or not."""
    return re.findall(r"[\w.]+(?:(?<=[eE])[-+]\d+)?", text)


def is_computed(text: str) -> bool:
    """Whether a list has names beside its numbers: one that is damaged has none, or numbers that are none."""
    words = words_in(text)
    numbers = [word for word in words if not re.match(r"[^\W\d]", word)]
    return len(numbers) < len(words) and all(re.fullmatch(NUMBER, word) for word in numbers)


def split_arguments(text: str, between: str = ",") -> Iterator[tuple[int, str]]:
    """The parts between commas (or the letters `between`) in no brackets, each with its place in the text."""
    depth, begin = 0, 0
    for at, letter in enumerate(text):
        depth += (letter in "([{") - (letter in ")]}")
        if letter in between and depth <= 0:
            yield begin, text[begin:at]
            begin, depth = at + 1, 0
    yield begin, text[begin:]


def parts_of(text: str, start: int = 0, end: int | None = None, between: str = ",") -> Lines:
    """Those parts without blanks around, each with its place."""
    parts = split_arguments(text[start:end], between)
    return [(start + at + len(part) - len(part.lstrip()), part.strip()) for at, part in parts]


def arguments_of(text: str, start: int = 0) -> Lines:
    """The arguments of a call whose text begins behind its bracket at `start`, without blanks around, each
    with its place; those of a bracket that is not closed up to the end."""
    depth, end = 1, len(text)
    for at in range(start, len(text)):
        depth += (text[at] in "([{") - (text[at] in ")]}")
        if depth == 0:
            end = at
            break
    return parts_of(text, start, end)


def pieces(
    pattern: re.Pattern[str], text: str, start: int = 0, end: int | None = None
) -> list[tuple[re.Match[str], int]]:
    """Where a pattern is in a part of a text, each with the end of what belongs to it: where the next is."""
    end = len(text) if end is None else end
    matches = list(pattern.finditer(text, start, end))
    return [*zip(matches, [*(each.start() for each in matches[1:]), end], strict=False)]


What = Literal["tool", "frame"]
WHAT: tuple[What, What] = ("tool", "frame")
Doubt = Literal["relative", "computed", "elsewhere", "call", "group"]
_LARGEST = 1e9  # mm, deg, pulses
MOST_DIGITS = 1000
_TOO_LONG = re.compile(rf"(?<!\d)\d{{{MOST_DIGITS + 1}}}")


@dataclass(frozen=True)
class SourceFile:
    """A file of a backup: `name` is its path in it, with slashes; `remark` the pattern of its remarks."""

    name: str
    text: str
    remark: str = r"(?!)"

    def __post_init__(self) -> None:
        if (longest := _TOO_LONG.search(self.text)) is not None:
            raise BadInput(
                "a number has too many digits",
                file=self.name or None,
                line=self.line(longest.start()),
                found=f"{longest[0][:20]}…",
                allowed=f"up to {MOST_DIGITS:,} digits",
            )

    @cached_property
    def bare(self) -> str:
        """The text with blanks for remarks and for what is in strings, every letter in its place."""
        return re.sub(
            rf'"[^"\n]*"|{self.remark}',
            lambda part: (
                f'"{" " * (len(part[0]) - 2)}"' if part[0][0] == '"' else re.sub(r"[^\n]", " ", part[0])
            ),
            self.text,
        )

    @cached_property
    def _starts(self) -> list[int]:
        return [0, *(match.end() for match in re.finditer(r"\n", self.text))]

    def line(self, pos: int) -> int:
        return bisect_right(self._starts, pos)

    @property
    def suffix(self) -> str:
        """The ending of its name in small letters."""
        return "." + self.name.rpartition(".")[2].lower()

    @property
    def stem(self) -> str:
        """Its name without folders and ending, in small letters."""
        return self.name.rpartition("/")[2].rpartition(".")[0].lower()


@dataclass(frozen=True)
class TaughtPosition:
    """One literal of a position: a pose, or joints of the `axes` (from 0), in `spans` of its file's text.

    `name` is that by which statements name it, unique in the backup, `label` that of people. `tool` and
    `frame` are names where its own data state them; `configuration` has the texts of `configuration_spans`.
    A `register` holds a place or an offset: it is a position where a statement moves to it. `external`: it
    has axes besides those of the arm that are not at 0. `near` names the position in joints that is nearest
    to a pose.
    """

    file: SourceFile
    name: str
    label: str
    line: int
    kind: Literal["cartesian", "joints"]
    spans: tuple[Span, ...]
    tool: str | None = None
    frame: str | None = None
    axes: tuple[int, ...] = ()
    configuration_spans: tuple[Span, ...] = ()
    register: bool = False
    external: bool = False
    near: str | None = None

    @cached_property
    def values(self) -> tuple[float, ...]:
        """Its numbers, in the units of its language."""
        return tuple(float(self.file.text[start:end]) for start, end in self.spans)

    @property
    def configuration(self) -> tuple[str, ...]:
        return tuple(self.file.text[start:end] for start, end in self.configuration_spans)


@dataclass(frozen=True)
class FramePose:
    """A tool or frame that a backup defines; `pose` None where it says nothing fixed, and `why` then."""

    file: SourceFile
    line: int
    pose: Matrix | None
    why: str = ""


@dataclass(frozen=True)
class Statement:
    """A statement that moves to positions by their names, with this tool and frame (None: it says none)."""

    file: SourceFile
    line: int
    names: tuple[str, ...]
    tool: str | None = None
    frame: str | None = None


@dataclass(frozen=True)
class DoubtfulLine:
    """A line that a person must look at. `name` is the position that it uses, and that an `offset` (x, y, z,
    mm) is added to, in the axes of its frame or of the tool there; `offset` None: not in numbers."""

    file: SourceFile
    line: int
    kind: Doubt
    sentence: str
    name: str | None = None
    offset: tuple[float, ...] | None = None
    axes: What | None = None


@dataclass(frozen=True)
class RefusedLine:
    """A line for which the backup cannot be converted. `unread` is the label of a position there that is not
    understood, empty where it has none; None: positions are read, and something else is the reason."""

    file: SourceFile
    line: int
    sentence: str
    unread: str | None = None


@dataclass
class BackupReading:
    """What is found in the files of a backup; readers add to it by `FileReading`, `finished` judges names.

    `base` is the arm's base in the world, `model` that of the arm, where the backup states it."""

    files: Sequence[SourceFile]
    positions: list[TaughtPosition] = field(default_factory=list)
    frames: dict[tuple[What, str], FramePose] = field(default_factory=dict)
    statements: list[Statement] = field(default_factory=list)
    doubtful: list[DoubtfulLine] = field(default_factory=list)
    refused: list[RefusedLine] = field(default_factory=list)
    overwritten: list[tuple[SourceFile, int, str, str]] = field(default_factory=list)
    made: list[tuple[SourceFile, int, str]] = field(default_factory=list)  # computed, with line and label
    added: set[str] = field(default_factory=set)  # registers that statements add to places
    base: Matrix | None = None
    model: tuple[SourceFile, int, str] | None = None

    def of(self, names: Sequence[str]) -> BackupReading:
        """What is found in these files, the tools and frames of all, and what all do with their places."""
        positions = [one for one in self.positions if one.file.name in names]
        stored = {one.name for one in positions}
        changes = {one for name in stored for one in self.overwritten if _is_of(name, one[2])}
        return replace(
            self,
            positions=positions,
            statements=[
                one if one.file.name in names else replace(one, names=tuple(sorted(stored & {*one.names})))
                for one in self.statements
                if one.file.name in names or stored & {*one.names}
            ],
            doubtful=[one for one in self.doubtful if one.file.name in names or one.name in stored],
            refused=[one for one in self.refused if one.file.name in names],
            overwritten=[one for one in self.overwritten if one[0].name in names or one in changes],
            made=[one for one in self.made if one[0].name in names],
        )

    def changes(self, name: str) -> list[str]:
        """File and line of the statements that change a position, or may do so."""
        return [f"{file.name}, line {line}" for file, line, of, _ in self.overwritten if _is_of(name, of)]

    def computed(self) -> list[tuple[int, str]]:
        """Line and label of the places that are known when a program runs, not before."""
        stored = {one.name for one in self.positions}
        doubts = [one.line for one in self.doubtful if one.kind in ("computed", "relative")]
        made = [(line, label) for _, line, label in self.made]
        assigned = [(line, label) for _, line, name, label in self.overwritten if name not in stored]
        return [*((line, f"line {line}") for line in doubts), *made, *assigned]

    def finished(self) -> BackupReading:
        """What follows of names: stored elsewhere, overwritten, with several tools or frames. Each position
        then has the tool and the frame of its own data or of the statements that move to it."""
        self._leave_registers()
        stored = {one.name for one in self.positions}
        for file, line, name, label in self.overwritten:
            if name in stored:
                self.refused.append(
                    RefusedLine(file, line, f"the program overwrites the stored position {label}")
                )
            elif any(_is_of(each, name) for each in stored):
                sentence = f"{label}: which position is overwritten is not known before it runs"
                self.refused.append(RefusedLine(file, line, sentence))
            elif any((what, name) in self.frames for what in WHAT):
                self.refused.append(RefusedLine(file, line, f"{label} is set when the program runs"))
            else:
                sentence = f"{label} is computed when the program runs"
                self.doubtful.append(DoubtfulLine(file, line, "computed", sentence))
        computed = {name for _, _, name, _ in self.overwritten}
        uses: dict[tuple[str, What], set[str]] = defaultdict(set)
        for one in self.statements:
            for name in one.names:
                if name not in stored and name not in computed:
                    sentence = f"{name.rpartition(':')[2]} is stored elsewhere, or not at all"
                    self.doubtful.append(DoubtfulLine(one.file, one.line, "elsewhere", sentence, name))
                uses[name, "tool"] |= set() if one.tool is None else {one.tool}
                uses[name, "frame"] |= set() if one.frame is None else {one.frame}
        self.positions = [self._with_frames(one, uses) for one in self.positions]
        return self

    def _leave_registers(self) -> None:
        """Registers that no statement moves to hold offsets, or nobody knows what: they stay as they are."""
        goals = {name for one in self.statements for name in one.names}
        for one in self.positions:
            if one.register and one.name in goals & self.added:
                sentence = f"{one.label} is a place at one statement and an offset at another"
                self.refused.append(RefusedLine(one.file, one.line, sentence))
            elif one.register and one.name not in goals | self.added:
                sentence = f"no statement of the backup moves to {one.label}: it stays as it is"
                self.doubtful.append(DoubtfulLine(one.file, one.line, "elsewhere", sentence))
        self.positions = [one for one in self.positions if not one.register or one.name in goals]

    def _with_frames(self, one: TaughtPosition, uses: Mapping[tuple[str, What], set[str]]) -> TaughtPosition:
        names = {what: sorted(uses.get((one.name, what), ())) for what in WHAT}
        for what, values in names.items():
            if getattr(one, what) is None and len(values) > 1 and one.kind == "cartesian":
                several = f"{one.label} is used with several {what}s: {', '.join(values)}"
                self.refused.append(RefusedLine(one.file, one.line, several))
        tool, frame = (next(iter(names[what]), None) for what in WHAT)
        return replace(one, tool=one.tool or tool, frame=one.frame or frame)


def _is_of(name: str, changed: str) -> bool:
    """Whether a position is what is changed: an array, if that ends with a bracket."""
    return name == changed or (changed.endswith("[") and name.startswith(changed))


@dataclass
class FileReading:
    """What a reader finds in one file, which it adds to the `reading` of the backup; `pos` are places in the
    file's text."""

    file: SourceFile
    reading: BackupReading

    def add(
        self,
        pos: int,
        name: str,
        label: str,
        spans: Sequence[Span],
        configuration: Sequence[Span] = (),
        *,
        axes: Sequence[int] | None = None,
        external: Sequence[float] = (),
        **others: Any,
    ) -> None:
        """A position at `pos`: joints where `axes` are stated, else a pose; `external` axes must be 0."""
        if any(external):
            self.refuse(pos, f"{label} has positions of external axes, which may carry the arm or the work")
        if any(abs(number) > _LARGEST for number in self.numbers(spans)):
            return self.unread(pos, f"{label} has numbers that no arm reaches", label)
        kind: Literal["cartesian", "joints"] = "cartesian" if axes is None else "joints"
        others |= {"axes": tuple(axes or ()), "configuration_spans": tuple(configuration)}
        others |= {"external": any(external), "line": self.file.line(pos)}
        one = TaughtPosition(self.file, name, label, kind=kind, spans=tuple(spans), **others)
        return self.reading.positions.append(one)

    def six(
        self,
        pos: int,
        name: str,
        label: str,
        spans: Sequence[Span],
        configuration: Sequence[Span] = (),
        *,
        joints: bool,
        **others: Any,
    ) -> None:
        """A position of six numbers; numbers behind them are of external axes."""
        if len(spans) < 6:
            return self.unread(pos, f"{label} has {len(spans)} numbers", label)
        others |= {"axes": range(6)} if joints else {}
        external = self.numbers(spans[6:])
        return self.add(pos, name, label, spans[:6], configuration, external=external, **others)

    def numbers(self, spans: Sequence[Span]) -> list[float]:
        """Those at places of the file."""
        return [float(self.file.text[start:end]) for start, end in spans]

    def inline(self, pos: int) -> tuple[str, str]:
        """Name and label of a position that is written where it is used."""
        return f"{self.file.name}:{pos}", f"line {self.file.line(pos)}"

    def frame(
        self, pos: int, what: What, name: str, pose: Matrix | None, why: str = "it is not in numbers"
    ) -> None:
        """A tool or frame that the backup defines."""
        if (what, name) in self.reading.frames:
            self.refuse(pos, f"the {what} {name} is defined twice: convert the backup of one task alone")
        self.reading.frames[what, name] = FramePose(self.file, self.file.line(pos), pose, why)

    def refuse(self, pos: int, sentence: str) -> None:
        """A line for which nothing is converted."""
        self.unread(pos, sentence, None)

    def unread(self, pos: int, sentence: str, label: str | None = "") -> None:
        """A position that is not understood, of this label; None: one that nobody looks for by itself."""
        self.reading.refused.append(RefusedLine(self.file, self.file.line(pos), sentence, label))

    def whole(self, begins: str, ends: str) -> None:
        """Refuse a file in which more begins than ends, by patterns: it was cut off."""
        opened, closed = (
            len(re.findall(pattern, self.file.bare, re.IGNORECASE | re.MULTILINE))
            for pattern in (begins, ends)
        )
        if closed < opened:
            sentence = "the file is not whole: a module, routine or block has no end"
            self.unread(len(self.file.bare), sentence)

    def doubt(self, pos: int, kind: Doubt, sentence: str, name: str | None = None) -> None:
        """A line that a person must look at."""
        self.reading.doubtful.append(DoubtfulLine(self.file, self.file.line(pos), kind, sentence, name))

    def computed(self, pos: int, text: str) -> None:
        """A goal that is known when the program runs."""
        self.doubt(pos, "computed", f"{text[:40]} is computed when the program runs")

    def relative(
        self,
        pos: int,
        sentence: str,
        names: Sequence[str] = (),
        offset: Sequence[float] | None = None,
        axes: What | None = None,
    ) -> None:
        """A move by an offset from the first of the goals `names`, or from where the arm is."""
        by, start = None if offset is None else tuple(offset), names[0] if names else None
        line = DoubtfulLine(self.file, self.file.line(pos), "relative", sentence, start, by, axes)
        self.reading.doubtful.append(line)

    def moves(
        self, pos: int, names: Sequence[str], tool: str | None = None, frame: str | None = None
    ) -> None:
        """A statement moves to these positions."""
        self.reading.statements.append(Statement(self.file, self.file.line(pos), tuple(names), tool, frame))

    def overwrites(self, pos: int, name: str, label: str) -> None:
        """A statement changes a position when the program runs."""
        self.reading.overwritten.append((self.file, self.file.line(pos), name, label))


class Active:
    """Which tool and frame are set where, of one routine, by the order of its lines. Where a routine sets
    several and has jumps, branches or loops, one is known only where the lines from that which sets it to the
    motion are carried out one after another, whatever came before (`edges` are places of all other lines):
    more would take an analysis of its flow."""

    def __init__(self) -> None:
        self._sets: dict[What, list[tuple[int, str]]] = {"tool": [], "frame": []}
        self.jumps = False
        self.edges: list[int] = []

    def set(self, what: What, pos: int, name: str | None) -> None:
        """None: by what is only known when the program runs."""
        self._sets[what].append((pos, AT_RUN_TIME if name is None else name))

    def at(self, what: What, pos: int) -> str | None:
        """The name at a place; None where the routine has set none before."""
        before = [(at, name) for at, name in self._sets[what] if at < pos]
        doubtful = len({name for _, name in self._sets[what]}) > 1 and self.jumps
        if not before:
            return AT_RUN_TIME if doubtful else None
        last, name = before[-1]
        straight = bisect_left(self.edges, last) == bisect_left(self.edges, pos)
        return name if straight or not doubtful else AT_RUN_TIME


def what_of(word: str) -> What:
    """A tool, by the word of a language for that; else a frame."""
    return "tool" if word.upper() == "TOOL" else "frame"


AT_RUN_TIME = "?"  # a name that is no name: which one is known when the program runs


@dataclass(frozen=True)
class JointLanguage:
    """How positions of a language are read: `read` adds to a BackupReading; joints are in `unit`. `remark` is
    the pattern of its remarks, `beside` that of the names of files in a folder that say what the tools and
    frames of one are, or what happens to its positions."""

    name: str
    vendor: Vendor
    endings: tuple[str, ...]
    read: Callable[[BackupReading], None]
    _: KW_ONLY
    remark: str = "(?!)"
    unit: PendantUnit = "deg"
    beside: str = "(?!)"


class NotConvertible(Exception):
    """A position that cannot be converted; the sentence says why."""


def _states_none(texts: Sequence[str], branch: Branch, joints: Matrix) -> bool:
    return not texts


def _shared(texts: Sequence[str], branch: Branch, joints: Matrix) -> Sequence[str]:
    raise NotConvertible(
        f"once converted it has another configuration than {', '.join(texts)}, which is stated for others too"
    )


@dataclass(frozen=True, kw_only=True)
class PositionLanguage(JointLanguage):
    """How positions of a language are written, besides.

    `pose` makes a transform of numbers, which are written with `pose_decimals`; joints with `joint_decimals`.
    `matches` says whether joints, degrees, with their branch have a stated configuration (by default one that
    states none), `configuration` are its texts for joints (by default it must stay: it is stated for others
    too).
    `up` and `by_joint2` are as of `Branches`. `null` are names of the tool and frame that are none; `form`
    shows what a pose is in options. `padded`: a number stands in the room of the old one, blanks before it
    included. `unpublished`: which joints its words for a configuration stand for is not. `frames_in` names
    the files of a backup that have its tools and frames. `mark` tells that a text is of the language.
    """

    pose: Callable[[Sequence[float]], Matrix]
    form: str
    matches: Callable[[Sequence[str], Branch, Matrix], bool] = _states_none
    configuration: Callable[[Sequence[str], Branch, Matrix], Sequence[str]] = _shared
    pose_decimals: tuple[int, ...] = (6,) * 6
    joint_decimals: int = 6
    null: frozenset[str] = frozenset({"0"})
    up: int = 1
    by_joint2: bool = False
    padded: bool = False
    unpublished: bool = False
    frames_in: str = ""
    case_sensitive: bool = False
    mark: str = "(?!)"

    def pose_numbers(self, pose: Matrix) -> Sequence[float]:
        """The reverse of `pose`."""
        turn = orientation(pose[:3, :3])
        if self.pose is from_rotation_vector:  # m and rad
            return [*(pose[:3, 3] / 1000).tolist(), *turn.rotation_vector]
        return [*pose[:3, 3].tolist(), *_ANGLES[self.pose](turn)]


_ANGLES: dict[Callable[[Sequence[float]], Matrix], Callable[[Orientation], Sequence[float]]] = {
    from_quaternion: lambda turn: turn.quaternion,
    from_abc: lambda turn: turn.abc,
    from_rpy: lambda turn: turn.roll_pitch_yaw,
    from_xyz: lambda turn: turn.xyz,
    from_zyz: lambda turn: turn.zyz,
}


def pose_of(form: Callable[[Sequence[float]], Matrix], numbers: Sequence[float]) -> Matrix | None:
    """(4, 4) of numbers in a form; None of such that are none of a tool or frame, or of too few."""
    try:
        whole = len(numbers) >= 6 and all(abs(number) < _LARGEST for number in numbers)
        return form(numbers) if whole else None
    except ValueError:  # a quaternion of zeros
        return None
