"""Positions of programs as a maker's manifest states them, and one of them as it is read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple


class TaughtPoint(NamedTuple):
    """A point of the file: degrees (mm if prismatic), or None where it is Cartesian or was not taught.

    `number` is that of the posture of a plan, where a program of zerobeam recorded the point. `unread` says
    why it is not understood, `left_out` why it is none to measure at unless it is named; `external`: it has
    other axes besides that are not at 0. `changed` is where a program overwrites it.
    """

    name: str
    joints: tuple[float, ...] | None
    line: int
    number: int | None = None
    unread: str = ""
    left_out: str = ""
    external: bool = False
    changed: str = ""


Points = Callable[[str, list[TaughtPoint]], list[TaughtPoint]]


def as_written(text: str, points: list[TaughtPoint]) -> list[TaughtPoint]:
    """The positions of a text as they are."""
    return points


@dataclass(frozen=True)
class TaughtFormat:
    """Positions in a `language` of `experiments/positions`, taught, or recorded by a plan's program.

    `files` are those that are read, `about` the help of that, `marks` patterns of such texts, each with what
    it is. With `log` the reader also takes what a plan's program prints. `named` gives the positions of a
    text the names that people call them by; `recorded` those that a plan's program has recorded the numbers
    of their postures, and leaves out the others. `declared`: those in motions are none that was recorded.
    `digits` are the decimals of joints that the controller saves, `note` says what the positions are.
    """

    language: str
    files: str
    about: str
    marks: Sequence[tuple[str, str]]
    log: str | None = None
    named: Points = as_written
    recorded: Points = as_written
    declared: bool = False
    digits: int = 4
    note: str = ""
