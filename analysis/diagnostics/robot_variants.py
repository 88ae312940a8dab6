"""What a robot may be instead of the one that a run names: another arm, or its file with one error mended."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np

from ...model.arrays import Matrix
from ...model.files.robot_file import built_in_robots, load_robot
from ...model.kinematics.dh import DHRow, along_z, as_row, with_fixed
from ...model.kinematics.robot import Robot
from ...model.parsing.confinement import BUILT_IN

_VENDOR = re.compile(r"^vendor: *([\w-]+)", re.MULTILINE)


@dataclass(frozen=True, eq=False)
class Variant:
    """Another robot. `joints` (from 1) are those before and behind a twist of which the sign is reversed, or
    the last one for the link that ends in the flange; `of` is the name of another arm. There are
    exp(`log_choices`) of its kind."""

    cause: Literal["twist", "convention", "arm"]
    robot: Robot
    joints: tuple[int, ...] = ()
    of: str = ""
    log_choices: float = 0.0


def file_variants(robot: Robot) -> Iterator[Variant]:
    """Twists, and the other convention of the rows."""
    robot = along_z(robot)
    first, *ends = (*(joint.fixed for joint in robot.joints), robot.flange)
    rows = [as_row(end) for end in ends]
    for k, row in enumerate(rows):
        if row is None or abs(np.sin(row.alpha)) <= 1e-6:
            continue
        link = replace(row, alpha=-row.alpha).matrix()
        joints = (k + 1, k + 2) if k + 1 < robot.n else (k + 1,)
        yield Variant("twist", with_fixed(robot, [first, *ends[:k], link, *ends[k + 1 :]]), joints)
    yield from _conventions(robot, first, [row for row in rows if row is not None])


def _conventions(robot: Robot, first: Matrix, rows: Sequence[DHRow]) -> Iterator[Variant]:
    """Rows of standard Denavit-Hartenberg parameters that were read as modified ones, and the reverse.

    Between joints i and i + 1 both have theta and d of row i; a and alpha are those of row i by the standard,
    of row i + 1 by the modified convention.
    """
    if len(rows) < robot.n:
        return
    links = [(row.a, row.alpha) for row in rows]
    before = as_row(first)
    if before is not None and (before.d, before.theta) == links[-1] == (0.0, 0.0):
        moved = _with_links(rows, [(before.a, before.alpha), *links[:-1]])
        yield Variant("convention", with_fixed(robot, [np.eye(4), *moved]), of="standard")
    moved = _with_links(rows, [*links[1:], (0.0, 0.0)])
    before_first = first @ DHRow(*links[0], 0.0, 0.0).matrix()
    yield Variant("convention", with_fixed(robot, [before_first, *moved]), of="modified")


def _with_links(rows: Sequence[DHRow], links: Sequence[tuple[float, float]]) -> list[Matrix]:
    """(4, 4) of each row with another a and alpha."""
    return [DHRow(*link, row.d, row.theta).matrix() for link, row in zip(links, rows, strict=True)]


def other_arms(robot: Robot, *, siblings: bool) -> Iterator[Variant]:
    """Built-in arms with joints of the same kinds: those of the same maker, or all others."""
    kinds = [joint.kind for joint in robot.joints]
    names = [name for name, vendor in _vendors() if (vendor == robot.vendor) == siblings]
    arms = [arm for arm in map(_built_in, names) if arm.name != robot.name]
    arms = [arm for arm in arms if [joint.kind for joint in arm.joints] == kinds]
    for arm in arms:
        yield Variant("arm", arm, of=arm.name, log_choices=float(np.log(len(arms))))


@cache
def _vendors() -> tuple[tuple[str, str], ...]:
    """Names and makers of the built-in arms: to read the files whole takes longer than to look for a line."""
    texts = ((name, (BUILT_IN / f"{name}.yaml").read_text(encoding="utf-8")) for name in built_in_robots())
    return tuple((name, match[1] if (match := _VENDOR.search(text)) else "") for name, text in texts)


@cache
def _built_in(name: str) -> Robot:
    return load_robot(name, Path())
