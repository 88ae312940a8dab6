"""What a robot may be instead of the one that a run names: another arm, or its file with one error mended."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np

from ...model.arrays import Matrix
from ...model.files.robot_file import built_in_robots, load_robot
from ...model.kinematics.robot import Robot, rotation_about, shift
from ...model.parsing.confinement import BUILT_IN

_VENDOR = re.compile(r"^vendor: *([\w-]+)", re.MULTILINE)
_ROUNDING = 1e-9  # of a transform, rad and mm


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
    ends = _ends(robot)
    twisted = [k for k in range(robot.n) if (row := _row(ends[k])) is not None and abs(np.sin(row[1])) > 1e-6]
    for k in twisted:
        a, alpha, d, theta = _row(ends[k]) or (0.0, 0.0, 0.0, 0.0)
        link = _transform(a, -alpha, d, theta)
        joints = (k + 1, k + 2) if k + 1 < robot.n else (k + 1,)
        yield Variant("twist", _with_ends(robot, [*ends[:k], link, *ends[k + 1 :]]), joints)
    yield from _conventions(robot, ends)


def _ends(robot: Robot) -> list[Matrix]:
    """(n) the transform behind each joint, the axes of all turned onto z."""
    turns = [_onto_z(joint.axis) for joint in robot.joints]
    behind = [joint.fixed @ turn for joint, turn in zip(robot.joints[1:], turns[1:], strict=True)]
    return [np.linalg.inv(turn) @ end for turn, end in zip(turns, [*behind, robot.flange], strict=True)]


def _with_ends(robot: Robot, ends: list[Matrix], first: Matrix | None = None) -> Robot:
    """The robot with these transforms behind its joints, which all move about or along z."""
    if first is None:
        first = robot.joints[0].fixed @ _onto_z(robot.joints[0].axis)
    fixed = [first, *ends[:-1]]
    joints = tuple(
        replace(joint, fixed=at, axis=np.array([0.0, 0.0, 1.0]))
        for joint, at in zip(robot.joints, fixed, strict=True)
    )
    return replace(robot, joints=joints, flange=ends[-1])


def with_axes_along_z(robot: Robot) -> Robot:
    """The same robot written with joints that all move about or along their z axes."""
    return _with_ends(robot, _ends(robot))


def _onto_z(axis: Matrix) -> Matrix:
    """(4, 4) a rotation that takes z onto a unit `axis`."""
    result = np.eye(4)
    if axis[2] > -1 + 1e-12:
        vector = np.array([-axis[1], axis[0], 0.0])  # z × axis
        cross = np.array([[0, 0, vector[1]], [0, 0, -vector[0]], [-vector[1], vector[0], 0]])
        result[:3, :3] = np.eye(3) + cross + cross @ cross / (1 + axis[2])
    else:
        result[:3, :3] = np.diag([1.0, -1.0, -1.0])
    return result


def _row(end: Matrix) -> tuple[float, float, float, float] | None:
    """a, alpha, d, theta of Rz(theta) Tz(d) Tx(a) Rx(alpha); None of a transform that is no such row."""
    theta = float(np.arctan2(end[1, 0], end[0, 0]))
    alpha = float(np.arctan2(end[2, 1], end[2, 2]))
    a = float(end[0, 3] * np.cos(theta) + end[1, 3] * np.sin(theta))
    row = (a, alpha, float(end[2, 3]), theta)
    return row if np.abs(_transform(*row) - end).max() < _ROUNDING * max(1.0, abs(a)) else None


def _transform(a: float, alpha: float, d: float, theta: float) -> Matrix:
    turn = rotation_about("z", theta) @ shift(z=d)
    return np.asarray(turn @ shift(x=a) @ rotation_about("x", alpha))


def _conventions(robot: Robot, ends: list[Matrix]) -> Iterator[Variant]:
    """Rows of standard Denavit-Hartenberg parameters that were read as modified ones, and the reverse.

    Between joints i and i + 1 both have theta and d of row i; a and alpha are those of row i by the standard,
    of row i + 1 by the modified convention.
    """
    first = robot.joints[0].fixed @ _onto_z(robot.joints[0].axis)
    every = [_row(end) for end in ends]
    rows = [row for row in every if row is not None]
    if len(rows) < len(every):
        return
    links = [(a, alpha) for a, alpha, _, _ in rows]
    before = _row(first)
    if before is not None and before[2:] == (0.0, 0.0) and links[-1] == (0.0, 0.0):
        shifted = [before[:2], *links[:-1]]
        moved = [_transform(a, alpha, *row[2:]) for (a, alpha), row in zip(shifted, rows, strict=True)]
        yield Variant("convention", _with_ends(robot, moved, np.eye(4)), of="standard")
    shifted = [*links[1:], (0.0, 0.0)]
    moved = [_transform(a, alpha, *row[2:]) for (a, alpha), row in zip(shifted, rows, strict=True)]
    yield Variant(
        "convention", _with_ends(robot, moved, first @ _transform(*links[0], 0.0, 0.0)), of="modified"
    )


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
