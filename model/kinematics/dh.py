"""Denavit-Hartenberg rows and chains of transforms: one made of the other, exactly.

Between two axes there are six numbers, and a row has four or, with Hayati's beta, five of them. The rest is a
motion about and along the next axis. It commutes with the joint, so that the next row takes it up, and behind
the last row the transform to the flange:

    axes that cross or skew    Rz(theta) Tz(d) Tx(a) Rx(alpha)           Rz(c) Tz(e)
    axes nearly parallel       Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)  Rz(c)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from functools import reduce
from typing import Literal, NamedTuple

import numpy as np

from ..arrays import Matrix
from .robot import Robot, onto_z, rotation_about, shift

Convention = Literal["standard", "modified"]
# What a row's numbers do, in turn; None is the joint's own motion, about or along z.
# standard (eq. 1 of the paper): Rz(theta + q) Tz(d) Tx(a) Rx(alpha) Ry(beta).
# modified (Craig):              Rx(alpha) Tx(a) Ry(beta) Rz(theta + q) Tz(d).
ORDER: dict[Convention, tuple[str | None, ...]] = {
    "standard": (None, "theta", "d", "a", "alpha", "beta"),
    "modified": ("alpha", "a", "beta", None, "theta", "d"),
}
AXIS = {"theta": "z", "d": "z", "a": "x", "alpha": "x", "beta": "y"}
LENGTHS = ("d", "a")

NEARLY_PARALLEL = float(np.sin(np.radians(5.0)))  # the sine of the angle between two axes
_NO_LENGTH = 1e-10  # mm: has no direction
_ROUNDING = 1e-12  # mm or rad
_EXACT = 1e-9  # of a transform that is a row, rad and mm


@dataclass(frozen=True)
class DHRow:
    """One Denavit-Hartenberg row: a, d in mm, alpha, theta in rad (theta is the joint's zero position).

    `beta` is the further rotation about y, rad, of two axes that are nearly parallel (Hayati and Mirmirani).
    """

    a: float
    alpha: float
    d: float
    theta: float
    beta: float = 0.0

    def matrix(self, names: Sequence[str | None] = ORDER["standard"]) -> Matrix:
        """(4, 4) of the numbers `names`, in this order."""
        steps = (self._step(name) for name in names if name is not None and getattr(self, name))
        return reduce(np.matmul, steps, np.eye(4))

    def _step(self, name: str) -> Matrix:
        value = getattr(self, name)
        if name in LENGTHS:
            return shift(**{AXIS[name]: value})
        return rotation_about(AXIS[name], value)


def dh_chain(rows: Sequence[DHRow], convention: Convention) -> tuple[list[Matrix], Matrix]:
    """Fixed transforms before each joint and the one after the last, all joints moving about or along z."""
    order = ORDER[convention]
    at = order.index(None)
    fixed: list[Matrix] = []
    pending = np.eye(4)
    for row in rows:
        fixed.append(pending @ row.matrix(order[:at]))
        pending = row.matrix(order[at:])
    return fixed, pending


def as_row(transform: Matrix) -> DHRow | None:
    """The standard row that a transform (4, 4) is; None of one that is no row."""
    theta = float(np.arctan2(transform[1, 0], transform[0, 0]))
    alpha = float(np.arctan2(transform[2, 1], transform[2, 2]))
    a = float(transform[0, 3] * np.cos(theta) + transform[1, 3] * np.sin(theta))
    row = DHRow(a, alpha, float(transform[2, 3]), theta)
    return row if np.abs(row.matrix() - transform).max() < _EXACT * max(1.0, abs(a)) else None


def along_z(robot: Robot) -> Robot:
    """The same robot written with joints that all move about or along their z axes."""
    turns = [onto_z(joint.axis) for joint in robot.joints]
    fixed = [joint.fixed @ turn for joint, turn in zip(robot.joints, turns, strict=True)]
    back = [turn.T for turn in turns]
    between = [fixed[0], *(before @ at for before, at in zip(back, fixed[1:], strict=False))]
    return with_fixed(robot, [*between, back[-1] @ robot.flange])


def with_fixed(robot: Robot, fixed: Sequence[Matrix]) -> Robot:
    """The robot with other transforms (n + 1), the flange last, and joints along z."""
    joints = tuple(
        replace(joint, fixed=at, axis=np.array([0.0, 0.0, 1.0]))
        for joint, at in zip(robot.joints, fixed, strict=False)
    )
    return replace(robot, joints=joints, flange=fixed[-1])


class RowTable(NamedTuple):
    """Rows, joint 1 first, and the transform (4, 4) from the last row to the flange. The base stays."""

    rows: tuple[DHRow, ...]
    flange: Matrix


def table_of(
    robot: Robot, near: Sequence[DHRow], convention: Convention, first: Matrix, flange: Matrix
) -> RowTable:
    """The rows of a robot whose joints are along z, those next to `near`: it is the arm of these rows, with
    `first` (4, 4) before joint 1 and `flange` behind the last row, whose links have moved."""
    rows, standard = list(near), convention == "standard"
    turning, linking = ORDER["standard"][1:3], ORDER["standard"][3:]
    rest = np.asarray(np.linalg.inv(first) @ robot.joints[0].fixed)
    behind: Matrix = np.eye(4)
    for i, transform in enumerate([*(joint.fixed for joint in robot.joints[1:]), robot.flange]):
        whole = rest @ transform
        last = i + 1 == robot.n
        if last and not standard:
            about = float(np.arctan2(rest[1, 0], rest[0, 0]))
            rows[i] = replace(rows[i], theta=near[i].theta + about, d=near[i].d + float(rest[2, 3]))
            behind = np.asarray(np.linalg.inv(rows[i].matrix(turning)) @ whole)
            break
        of_link = i if standard else i + 1
        if last:
            whole = whole @ np.linalg.inv(flange)
        row = _row_of(whole, replace(near[of_link], theta=near[i].theta, d=near[i].d), last=last)
        rows[i] = replace(rows[i], theta=row.theta, d=row.d)
        rows[of_link] = replace(rows[of_link], a=row.a, alpha=row.alpha, beta=row.beta)
        rest = np.asarray(np.linalg.inv(row.matrix(turning) @ row.matrix(linking)) @ whole)
        if last:
            behind = rest @ flange
    return RowTable(tuple(_clean(row, nominal) for row, nominal in zip(rows, near, strict=True)), behind)


def _row_of(whole: Matrix, near: DHRow, *, last: bool) -> DHRow:
    """The row of a transform (4, 4), up to a motion about and along its z axis; the one next to `near`.

    Of the `last` row up to any motion, which the transform to the flange takes up.
    """
    sine = float(np.hypot(whole[0, 2], whole[1, 2]))
    if near.beta == 0 and sine >= NEARLY_PARALLEL:
        return _of_normal(whole, near)
    return _of_origins(whole, near, turned=last)


def _of_normal(whole: Matrix, near: DHRow) -> DHRow:
    """Along the common normal of both z axes."""
    along, origin = whole[:3, 2], whole[:3, 3]
    theta = _nearest(float(np.arctan2(along[0], -along[1])), near.theta, np.pi)
    x, y = _axes(theta)
    foot = origin - along * float((origin @ y) / (along @ y))
    alpha = _nearest(float(np.arctan2(-along @ y, along[2])), near.alpha)
    return DHRow(float(foot @ x), alpha, float(foot[2]), theta)


def _of_origins(whole: Matrix, near: DHRow, *, turned: bool) -> DHRow:
    """From one origin to the other, with beta; if `turned`, theta suits the rotation and not the place."""
    origin, turn = whole[:3, 3], whole[:3, :3]
    if float(np.hypot(origin[0], origin[1])) > _NO_LENGTH and not turned:
        theta = _nearest(float(np.arctan2(origin[1], origin[0])), near.theta, np.pi)
    else:
        side = 1.0 if np.cos(near.alpha) >= 0 else -1.0
        theta = _nearest(float(np.arctan2(-side * turn[0, 1], side * turn[1, 1])), near.theta)
    x, y = _axes(theta)
    along = whole[:3, 2]
    side = 1.0 if np.cos(near.beta) >= 0 else -1.0
    alpha = _nearest(float(np.arctan2(-side * (along @ y), side * along[2])), near.alpha)
    level = float(np.hypot(along @ y, along[2]))
    beta = _nearest(float(np.arctan2(along @ x, side * level)), near.beta)
    return DHRow(float(origin @ x), alpha, float(origin[2]), theta, beta)


def _axes(theta: float) -> tuple[Matrix, Matrix]:
    turn = rotation_about("z", theta)
    return turn[:3, 0], turn[:3, 1]


def _nearest(angle: float, near: float, period: float = 2 * np.pi) -> float:
    """The angle and all that are `period` apart from it: the one next to `near`."""
    return angle + period * round((near - angle) / period)


def _clean(row: DHRow, nominal: DHRow) -> DHRow:
    """A row whose numbers are exactly nominal where they differ by rounding only."""
    values = zip(astuple(row), astuple(nominal), strict=True)
    return DHRow(*(old if abs(new - old) <= _ROUNDING * max(1.0, abs(old)) else new for new, old in values))
