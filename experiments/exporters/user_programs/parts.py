"""What a program of any language consists of here: targets, the motions to them, what cannot be corrected."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ....model.arms.branches import Branch
from ....model.arms.joint_three import J3
from ....model.robot import Matrix, Robot
from ..programs.steps import decimal

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

    `matches` says whether joints, degrees, of a branch have the stated configuration, which `stated` names;
    None where none is stated: then the joints are those nearest to `near`, or to those of the motion before.
    `write` turns a pose and the joints it is reached with into the text for them.
    """

    name: str
    line: int
    pose: Matrix
    tool: Matrix
    frame: Matrix
    matches: Callable[[Branch, Matrix], bool] | None
    stated: str
    write: Callable[[Matrix, Branch | None, Matrix], list[Edit]]
    near: Matrix | None = None


Target = JointTarget | PoseTarget


class Motion(NamedTuple):
    """To the target `name`, None for one that is left as it is; `linear` if the arm keeps its branch on the
    way, `first` if it is not known where it comes from."""

    name: str | None
    line: int
    linear: bool
    first: bool


@dataclass
class Parsed:
    """A program: `targets` by name, motions in the text's order, `problems` (line, sentence) that forbid to
    write it, and sentences about what it `left` as it was or took for granted."""

    targets: dict[str, Target] = field(default_factory=dict)
    motions: list[Motion] = field(default_factory=list)
    problems: list[tuple[int, str]] = field(default_factory=list)
    left: list[str] = field(default_factory=list)

    def changed(self, line: int, name: str) -> None:
        """A target's name where it is neither declared nor the target of a motion."""
        if not self.speaks_of(line):
            self.problems.append((line, f"{name} is used or changed when the program runs"))

    def speaks_of(self, line: int, name: str = "") -> bool:
        """Whether a problem is in this line, or names this name."""
        word = re.compile(rf"(?<!\w){re.escape(name)}(?!\w)", re.IGNORECASE)
        return any(own == line or (name and word.search(said)) for own, said in self.problems)


@dataclass(frozen=True)
class Stated:
    """What a person states of a program: poses (4, 4) of tools and frames by name ("" for any), names to
    `leave`, joints (n,) degrees `near` which poses without a configuration are, and from where a FANUC counts
    joint 3."""

    tools: Mapping[str, Matrix] = field(default_factory=dict)
    frames: Mapping[str, Matrix] = field(default_factory=dict)
    leave: frozenset[str] = frozenset()
    near: Matrix | None = None
    j3: J3 | None = None


@dataclass(frozen=True)
class Source:
    """The text of a program for one robot, and what is stated of it."""

    text: str
    robot: Robot
    stated: Stated

    def written(self, key: str) -> str:
        """A name, known in small letters (an element of an array as `name{1}`), as the program writes it."""
        word, brace, rest = key.partition("{")
        found = re.search(rf"(?<!\w){re.escape(word)}(?!\w)", self.text, re.IGNORECASE)
        return (word if found is None else found[0]) + brace + rest

    def line(self, place: int) -> int:
        return self.text.count("\n", 0, place) + 1


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
        Edit(start, end, new_number(text[start:end], float(value), places))
        for (start, end), value, places in zip(spans, values, decimals, strict=True)
    ]


def number_spans(text: str, start: int, end: int) -> list[tuple[int, int]]:
    """The places of all numbers in a part of a text."""
    return [found.span() for found in re.compile(rf"(?<![\w.]){NUMBER}").finditer(text, start, end)]
