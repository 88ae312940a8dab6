"""Parts of a program of any language: its grammar, targets, the motions to them, what cannot be corrected.

A grammar is a list of what may stand in a program that is corrected. A statement that it does not derive,
as a whole, refuses the program.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from lark import Lark, TextSlice, Token, Tree
from lark.exceptions import UnexpectedInput

from ...model.arrays import Matrix
from ...model.errors import BadInput
from ...model.kinematics.branches import Branch
from ...model.kinematics.robot import J3, Robot
from ...model.parsing.reading import did_you_mean, line_numbers
from .plan_programs import decimal


@cache
def _parser(language: str, rule: str) -> Lark:
    text = (Path(__file__).parent / f"{language}.lark").read_text("utf-8")
    return Lark(text, parser="lalr", start=rule, propagate_positions=True, maybe_placeholders=False)


def span(part: Token | Tree[Token]) -> tuple[int, int]:
    """Start and end in the text of a part of a statement that is not empty."""
    if isinstance(part, Tree):
        return part.meta.start_pos, part.meta.end_pos
    assert part.start_pos is not None
    return part.start_pos, part.start_pos + len(part)


def understood(language: str, rule: str, text: str, start: int, end: int) -> Tree[Token] | None:
    """The derivation by `rule` of the text from `start` to `end`, with places in the whole text; None where
    the grammar has none."""
    # Lark counts the lines before a slice at each call: it gets no more than the character before.
    before = max(start - 1, 0)
    try:
        tree = _parser(language, rule).parse(TextSlice(text[before:end], start - before, end - before))
    except UnexpectedInput:
        return None
    placed: list[Any] = []
    for part in tree.iter_subtrees():
        placed += [part.meta, *(each for each in part.children if isinstance(each, Token))]
    for part_or_token in placed:
        if getattr(part_or_token, "start_pos", None) is not None:
            part_or_token.start_pos += before
        if getattr(part_or_token, "end_pos", None) is not None:
            part_or_token.end_pos += before
    return tree


NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
NULL = np.eye(4)


class Edit(NamedTuple):
    """Text that takes the place of that from `start` to `end` of a file."""

    start: int
    end: int
    text: str


@dataclass(frozen=True, eq=False)
class JointTarget:
    """Joints (n,) of the robot file, degrees (mm); `write` turns others into the text for them."""

    name: str
    line: int
    joints: Matrix
    write: Callable[[Matrix], list[Edit]]


@dataclass(frozen=True, eq=False)
class PoseTarget:
    """A pose (4, 4), mm, of the tool (as seen from the flange) in a frame (as seen from the base).

    `matches` says whether joints, degrees, of a branch have the stated `configuration`; None where none is
    stated: then each motion to it says which (`Motion.near`), or the motion before.
    `write` turns a pose and the joints it is reached with into the text for them. `matching` is as `matches`,
    of joints alone, for a language whose configurations are not those of `Branch`; they are not rewritten.
    `turns` says whether joints, degrees, have the turns that are stated, as they are meant and as they are
    corrected.
    `words` of a configuration that does not select joints are compared with those of the joints nearest by;
    `words_mean` says what they are.
    """

    name: str
    line: int
    pose: Matrix
    tool: Matrix
    frame: Matrix
    matches: Callable[[Branch, Matrix], bool] | None
    configuration: str
    write: Callable[[Matrix, Branch | None, Matrix], list[Edit]]
    matching: Callable[[Matrix], bool] | None = None
    turns: Callable[[Matrix], bool] | None = None
    words: Callable[[Branch, Matrix], str] | None = None
    words_mean: str = ""

    @property
    def configured(self) -> bool:
        """Whether the target itself says in which configuration the arm reaches it."""
        return self.matches is not None or self.matching is not None


Target = JointTarget | PoseTarget


class Motion(NamedTuple):
    """To the target `name`, None for one that is left as it is.

    `linear`: the arm keeps its branch on the way. `first`: straight-line code does not lead here from the
    motion above (a label, a branch of an if, a call, the begin of a routine stands between). `unchecked`:
    the controller ignores the stated configuration of the target, and keeps the branch that the arm is in:
    that of the motion above, or, where this is the `first`, one that the language has made sure of.
    `near`: joints (n,) degrees to which the controller takes the nearest that reach a pose.
    """

    name: str | None
    line: int
    linear: bool
    first: bool
    unchecked: bool = False
    near: Matrix | None = None


class LiteralSpan(NamedTuple):
    """A literal of the program, with the shape of a pose or of joints: from `start` to `end`, and what it
    is."""

    start: int
    end: int
    use: Literal["target", "frame", "left"]


@dataclass
class Parsed:
    """A program: `targets` by name, motions in the text's order, `problems` (line, sentence) that forbid to
    write it, sentences about what it `left` as it was or took for granted, and the places of its literals."""

    targets: dict[str, Target] = field(default_factory=dict)
    motions: list[Motion] = field(default_factory=list)
    problems: list[tuple[int, str]] = field(default_factory=list)
    left: list[str] = field(default_factory=list)
    literals: list[LiteralSpan] = field(default_factory=list)

    def changed(self, line: int, name: str) -> None:
        """A target's name where it is neither declared nor the target of a motion."""
        if not self.speaks_of(line):
            self.problems.append((line, f"{name} is used or changed when the program runs"))

    def speaks_of(self, line: int, name: str = "") -> bool:
        """Whether a problem is in this line, or names this name."""
        word = re.compile(rf"(?<!\w){re.escape(name)}(?!\w)", re.IGNORECASE)
        return any(
            problem_line == line or (name and word.search(sentence))
            for problem_line, sentence in self.problems
        )


class RequiredPose(NamedTuple):
    """A tool or frame of a program whose pose a person must state: `option --tool` or `--frame`, its name
    ("" for the one that is open) and the `form` of the pose."""

    option: Literal["--tool", "--frame"]
    name: str
    form: str

    def __str__(self) -> str:
        return f"{self.option} {self.name}={self.form}" if self.name else f"{self.option} {self.form}"


@dataclass(frozen=True)
class ProgramFacts:
    """Facts of a program that a person states: poses (4, 4) of tools and frames by name ("" for the one that
    the program leaves open), names to `leave`, routines of other files that move no arm and change no frame
    (`calls`), joints (n,) degrees `near` which poses without a configuration are, and from where a FANUC
    counts joint 3.

    A language looks names up here alone, so that `check_names` has seen all that the program has. Names are
    in small letters where the language ignores case.
    """

    tools: Mapping[str, Matrix] = field(default_factory=dict)
    frames: Mapping[str, Matrix] = field(default_factory=dict)
    leave: frozenset[str] = frozenset()
    near: Matrix | None = None
    j3: J3 | None = None
    calls: frozenset[str] = frozenset()
    _in_program: dict[str, dict[str, str]] = field(default_factory=lambda: defaultdict(dict))
    _required: dict[RequiredPose, None] = field(default_factory=dict)

    def tool(self, name: str, declared: Matrix | None = None) -> Matrix | None:
        """The pose (4, 4) of a tool of the program, which may declare it itself; None where nothing says
        it."""
        return self._pose("--tool", self.tools, name, declared)

    def frame(self, name: str, declared: Matrix | None = None) -> Matrix | None:
        """The pose (4, 4) of a work object, base or user frame, as `tool`."""
        return self._pose("--frame", self.frames, name, declared)

    def has(self, option: Literal["--tool", "--frame"], name: str) -> None:
        """The program has this tool or frame, whether a target needs it or not."""
        self._in_program[option][name] = name

    def require(self, option: Literal["--tool", "--frame"], name: str, form: str) -> str:
        """Note that a tool or frame ("" for the one that is open) must be stated: "state --tool …"."""
        required = RequiredPose(option, name, form)
        self._required[required] = None
        return f"state {required}"

    @property
    def required(self) -> tuple[RequiredPose, ...]:
        """The poses that must be stated, each once: tools, then frames."""
        return tuple(sorted(self._required, key=lambda pose: pose.option == "--frame"))

    def leaves(self, name: str, written: str = "") -> bool:
        """Whether a target of the program (as `written` there) is to be left as it is."""
        self._in_program["--leave"][name] = written or name
        return name in self.leave

    def harmless(self, routine: str, written: str = "") -> bool:
        """Whether a routine of another file is stated to move no arm and to change no frame, tool or
        target."""
        self._in_program["--call"][routine] = written or routine
        return routine in self.calls

    def _pose(
        self, option: str, poses: Mapping[str, Matrix], name: str, declared: Matrix | None
    ) -> Matrix | None:
        self._in_program[option][name] = name
        pose = poses.get(name)
        if pose is not None and declared is not None and not np.allclose(pose, declared):
            raise BadInput(
                f"{option} {name} has another value in the program",
                remedy=f"leave {option} {name} out, or correct the value in the program",
            )
        if declared is not None or (pose is not None and name):
            return declared if pose is None else pose
        if "" in poses:
            self._in_program[f"{option} without a name"][name] = name
        return poses.get("")

    def check_names(self) -> None:
        """BadInput for a name in an option that the program does not have, or that may be either of two."""
        for option, names in (
            ("--tool", self.tools),
            ("--frame", self.frames),
            ("--leave", self.leave),
            ("--call", self.calls),
        ):
            here = self._in_program[option]
            for name in sorted(names):
                if name and name not in here:
                    raise BadInput(
                        f"{option} names what the program does not have",
                        found=name,
                        allowed=", ".join(sorted(filter(None, here.values()))) or "nothing in this program",
                        remedy=did_you_mean(name, [*here.values()]),
                    )
            open_names = self._in_program[f"{option} without a name"]
            if "" in names and len(open_names) != 1:
                raise BadInput(
                    f"{option} without a name is for the one that the program leaves open",
                    found=", ".join(sorted(open_names)) or "none",
                    remedy=f"state {option} NAME=POSE for each" if open_names else f"leave {option} out",
                )


@dataclass(frozen=True)
class Source:
    """The text of a program for one robot, and what is stated of it."""

    text: str
    robot: Robot
    facts: ProgramFacts

    def written(self, key: str) -> str:
        """A name, known in small letters (an element of an array as `name{1}`), as the program writes it."""
        word = re.split(r"[\[{]", key)[0]
        match = re.search(rf"(?<!\w){re.escape(word)}(?!\w)", self.text, re.IGNORECASE)
        return (word if match is None else match[0]) + key[len(word) :]

    def key_at(self, pos: int, keys: Container[str]) -> str:
        """A name for the target of a motion that is written in the motion, none of `keys`."""
        key = f"the target in line {self.line(pos)}"
        while key in keys:
            key += "'"
        return key

    @cached_property
    def line(self) -> Callable[[int], int]:
        """The line of a place in the text."""
        return line_numbers(self.text)


@dataclass(frozen=True)
class Language:
    """The language of one maker's programs.

    `targets` reads a program; remarks are put behind `head`, a pattern, and begin with `remark`; `pose` is
    the pose (4, 4) of numbers that are stated in the `form`. `literals` has the spans of all literals of
    poses and joints, found without the grammar; `up` and `by_joint2` as of `Branches`. `remark_width` is how
    long a remark may be, if that is little; `remark_end` closes it. Files whose endings are in `marked` take
    no remarks: the first match of the pattern says that they are corrected. `with_data` puts that into the
    data of a file by its ending (text, mark), where an editor keeps it that drops remarks.
    """

    name: str
    targets: Callable[[Source], Parsed]
    head: str
    remark: str
    pose: Callable[[Sequence[float]], Matrix]
    form: str
    literals: Callable[[str], list[tuple[int, int]]]
    case_sensitive: bool = False
    up: int = 1
    remark_width: int | None = None
    by_joint2: bool = False
    remark_end: str = ""
    marked: Mapping[str, re.Pattern[str]] = field(default_factory=dict)
    with_data: Mapping[str, Callable[[str, str], str]] = field(default_factory=dict)


def new_number(old: str, value: float, decimals: int) -> str:
    """The text of a number: as it was where it is the same to so many decimals."""
    if abs(float(old) - value) <= 0.5 * 10.0**-decimals:
        return old
    return decimal(round(value, decimals) + 0.0) if decimals else str(round(value))


def number_edits(
    spans: Sequence[tuple[int, int]], text: str, values: Sequence[float], decimals: Sequence[int]
) -> list[Edit]:
    """Numbers at places of the text replaced by `values`."""
    return [
        Edit(start, end, new_number(text[start:end], float(value), digits))
        for (start, end), value, digits in zip(spans, values, decimals, strict=True)
    ]
