"""Units, signs and the convention of joint 3, judged by the robot's limits alone.

A reading is excluded where it puts joints outside their limits. What the limits do not exclude they do not
decide: then there is no choice, and the sentence says so.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...model.arrays import Matrix
from ...model.files.limits import beyond_limits, like_radians
from ...model.kinematics.pendant import Pendant, nearest_limit
from ...model.kinematics.robot import Robot

_WAYS = {
    "deg": "degrees",
    "rad": "radians",
    "mm": "millimetres",
    "m": "metres",
    "recorded": "the sign as recorded",
    "reversed": "the sign reversed",
    "link": "joint 3 counted from link 2",
    "ground": "joint 3 counted from the ground",
}


@dataclass(frozen=True)
class Reading:
    """`choice` is the way to read that is proposed, None where none is.

    `decided` says that every other way is excluded by limits; `outside` counts the rows with a joint outside
    its limits, by way.
    """

    choice: str | None
    decided: bool
    why: str
    outside: Mapping[str, int]


def unit_reading(robot: Robot, raw: Matrix) -> Reading | None:
    """The unit of the angles of recorded values (N, n); None without a revolute joint that has a column.

    Columns that are not known are NaN: they are within all limits.
    """
    revolute = _kind(robot, "revolute")
    if np.isnan(raw[:, revolute]).all():
        return None
    rows = {"deg": _only(raw, revolute), "rad": np.degrees(_only(raw, revolute))}
    by_limits = _by_limits(robot, rows)
    if by_limits.choice is None and not any(by_limits.outside.values()):
        known = np.where(np.isnan(rows["deg"]), 0.0, raw)
        if like_radians(robot, known):
            largest = float(np.nanmax(np.abs(rows["deg"])))
            why = (
                f"no joint beyond {largest:.4g} in {len(raw)} rows, as in radians: in degrees the arm would"
                " hardly have moved; the limits allow both: check it at the source"
            )
            return Reading("rad", False, why, by_limits.outside)
    return by_limits


def length_reading(robot: Robot, raw: Matrix) -> Reading | None:
    """The unit of the prismatic joints, as `unit_reading`; None without one that has a column."""
    slides = _kind(robot, "prismatic")
    if not slides or np.isnan(raw[:, slides]).all():
        return None
    return _by_limits(robot, {"mm": _only(raw, slides), "m": _only(raw, slides) * 1000})


def sign_readings(robot: Robot, joints: Matrix) -> list[Reading | None]:
    """The sign of each joint of values (N, n), degrees or mm; None of one without a column."""
    readings: list[Reading | None] = []
    for i in range(robot.n):
        column = _only(joints, [i])
        known = not np.isnan(column).all()
        readings.append(_by_limits(robot, {"recorded": column, "reversed": -column}) if known else None)
    return readings


def j3_reading(robot: Robot, joints: Matrix) -> Reading | None:
    """What joint 3 of values (N, n), degrees, is counted from; None where joint 2 or 3 has no column, or is
    not revolute."""
    kinds = [joint.kind for joint in robot.joints[1:3]]
    if kinds != ["revolute", "revolute"] or np.isnan(joints[:, 1:3]).any():
        return None
    ways = {"link": joints, "ground": Pendant(robot, "ground").between_links(joints)}
    return _by_limits(robot, {way: _only(values, [1, 2]) for way, values in ways.items()}, [2])


def _by_limits(robot: Robot, rows: Mapping[str, Matrix], judged: Sequence[int] | None = None) -> Reading:
    """The one way that has no row outside the limits, if the others have some; `judged` joints count."""
    beyond = {way: beyond_limits(robot, values) for way, values in rows.items()}
    if judged is not None:
        for wrong in beyond.values():
            wrong[:, [i for i in range(robot.n) if i not in judged]] = False
    outside = {way: int(wrong.any(axis=1).sum()) for way, wrong in beyond.items()}
    count = len(next(iter(rows.values())))
    within = [way for way, number in outside.items() if not number]
    if len(within) == len(rows):
        return Reading(None, False, "not decided: the limits allow both", outside)
    reasons = "; ".join(
        f"with {_WAYS[way]} {outside[way]} of {count} rows are outside the limits"
        f" ({_farthest(robot, rows[way], beyond[way])})"
        for way in rows
        if outside[way]
    )
    if not within:
        return Reading(None, False, f"none fits: {reasons}", outside)
    return Reading(within[0], True, f"{reasons}, with {_WAYS[within[0]]} none", outside)


def _farthest(robot: Robot, values: Matrix, wrong: NDArray[np.bool_]) -> str:
    met = [
        (int(i), nearest_limit(robot, values[row] / robot.display, int(i))) for row, i in np.argwhere(wrong)
    ]
    i, limit = max(met, key=lambda each: each[1].excess)
    counting = limit.counting and f" {limit.counting}"
    return (
        f"J{i + 1}{counting} {limit.value:.5g} {robot.joints[i].unit}, limits {limit.lower:.5g} to"
        f" {limit.upper:.5g}"
    )


def _kind(robot: Robot, kind: str) -> list[int]:
    return [i for i, joint in enumerate(robot.joints) if joint.kind == kind]


def _only(values: Matrix, columns: list[int]) -> Matrix:
    """The values with NaN in all other columns."""
    result = np.full(values.shape, np.nan)
    result[:, columns] = values[:, columns]
    return result
