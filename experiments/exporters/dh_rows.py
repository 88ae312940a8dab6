"""The rows of a robot file for a chain whose links have moved: exact, whatever they are.

Between two axes there are six numbers, and a row has four or, with Hayati's beta, five of them. The rest is a
motion about and along the next axis. It commutes with the joint, so that the next row takes it up, and behind
the last row the transform to the flange:

    axes that cross or skew    Rz(theta) Tz(d) Tx(a) Rx(alpha)           Rz(c) Tz(e)
    axes nearly parallel       Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)  Rz(c)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...model.arrays import Matrix
from ...model.files.robot_file import RobotFile
from ...model.kinematics.robot import DHRow, Robot, rotation_about, shift

_NEARLY_PARALLEL = float(np.sin(np.radians(5.0)))  # as of the geometry's parameters
_NO_LENGTH = 1e-10  # mm: has no direction
_ROUNDING = 1e-12  # mm or rad


@dataclass(frozen=True, eq=False)
class Table:
    """Rows, joint 1 first, and the transform (4, 4) from the last row to the flange. The base stays."""

    rows: tuple[DHRow, ...]
    flange: Matrix


def corrected_table(stated: RobotFile, corrected: Robot) -> Table:
    """The rows of `corrected`: the robot of the file `stated` with other links, and with offsets."""
    nominal = [joint.row for joint in stated.joints]
    theirs = stated.robot()
    standard = stated.convention == "standard"
    chain = [*(joint.fixed for joint in corrected.joints[1:]), corrected.flange]
    rows = list(nominal)
    rest: Matrix = np.asarray(np.linalg.inv(theirs.joints[0].fixed) @ corrected.joints[0].fixed)
    flange: Matrix = np.eye(4)
    for i, transform in enumerate(chain):
        whole = rest @ transform
        last = i + 1 == len(chain)
        if last and not standard:
            about = float(np.arctan2(rest[1, 0], rest[0, 0]))
            rows[i] = replace(rows[i], theta=nominal[i].theta + about, d=nominal[i].d + float(rest[2, 3]))
            flange = np.asarray(np.linalg.inv(_turned(rows[i])) @ whole)
            break
        of_link = i if standard else i + 1
        near = replace(nominal[of_link], theta=nominal[i].theta, d=nominal[i].d)
        if last:
            whole = whole @ np.linalg.inv(stated.flange.matrix())
        found = _row_of(whole, near, last=last)
        rows[i] = replace(rows[i], theta=found.theta, d=found.d)
        rows[of_link] = replace(rows[of_link], a=found.a, alpha=found.alpha, beta=found.beta)
        rest = np.asarray(np.linalg.inv(_turned(found) @ _linked(found)) @ whole)
        if last:
            flange = rest @ stated.flange.matrix()
    return Table(tuple(_clean(row, own) for row, own in zip(rows, nominal, strict=True)), flange)


def beyond_rows(rows: Sequence[DHRow]) -> list[int]:
    """The joints (from 1) whose rows have a beta, which a table of four columns cannot hold."""
    return [number for number, row in enumerate(rows, start=1) if row.beta != 0]


def _turned(row: DHRow) -> Matrix:
    return rotation_about("z", row.theta) @ shift(z=row.d)


def _linked(row: DHRow) -> Matrix:
    return shift(x=row.a) @ rotation_about("x", row.alpha) @ rotation_about("y", row.beta)


def _row_of(whole: Matrix, near: DHRow, *, last: bool) -> DHRow:
    """The row of a transform (4, 4), up to a motion about and along its z axis; the one next to `near`.

    Of the `last` row up to any motion, which the transform to the flange takes up.
    """
    sine = float(np.hypot(whole[0, 2], whole[1, 2]))
    if near.beta == 0 and sine >= _NEARLY_PARALLEL:
        return _of_normal(whole, near)
    return _of_origins(whole, near, turned=last)


def _of_normal(whole: Matrix, near: DHRow) -> DHRow:
    """Along the common normal of both z axes."""
    along, place = whole[:3, 2], whole[:3, 3]
    theta = _nearest(float(np.arctan2(along[0], -along[1])), near.theta, np.pi)
    x, y = _axes(theta)
    foot = place - along * float((place @ y) / (along @ y))
    alpha = _nearest(float(np.arctan2(-along @ y, along[2])), near.alpha)
    return DHRow(float(foot @ x), alpha, float(foot[2]), theta)


def _of_origins(whole: Matrix, near: DHRow, *, turned: bool) -> DHRow:
    """From one origin to the other, with beta; if `turned`, theta suits the rotation and not the place."""
    place, turn = whole[:3, 3], whole[:3, :3]
    if float(np.hypot(place[0], place[1])) > _NO_LENGTH and not turned:
        theta = _nearest(float(np.arctan2(place[1], place[0])), near.theta, np.pi)
    else:
        side = 1.0 if np.cos(near.alpha) >= 0 else -1.0
        theta = _nearest(float(np.arctan2(-side * turn[0, 1], side * turn[1, 1])), near.theta)
    x, y = _axes(theta)
    along = whole[:3, 2]
    side = 1.0 if np.cos(near.beta) >= 0 else -1.0
    alpha = _nearest(float(np.arctan2(-side * (along @ y), side * along[2])), near.alpha)
    level = float(np.hypot(along @ y, along[2]))
    beta = _nearest(float(np.arctan2(along @ x, side * level)), near.beta)
    return DHRow(float(place @ x), alpha, float(place[2]), theta, beta)


def _axes(theta: float) -> tuple[Matrix, Matrix]:
    turn = rotation_about("z", theta)
    return turn[:3, 0], turn[:3, 1]


def _nearest(angle: float, near: float, period: float = 2 * np.pi) -> float:
    """The angle and all that are `period` apart from it: the one next to `near`."""
    return angle + period * round((near - angle) / period)


def _clean(row: DHRow, nominal: DHRow) -> DHRow:
    """The same without the rounding of what is nominal."""

    def own(value: float, stated: float) -> float:
        return stated if abs(value - stated) <= _ROUNDING * max(1.0, abs(stated)) else value

    return DHRow(
        own(row.a, nominal.a),
        own(row.alpha, nominal.alpha),
        own(row.d, nominal.d),
        own(row.theta, nominal.theta),
        own(row.beta, nominal.beta),
    )
