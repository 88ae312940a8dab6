"""Where an arm stood still in a recording of its joints over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...model.errors import BadInput
from ...model.robot import Matrix, Robot

_ROUNDING = 1e-9  # of times: a window of 0.5 s holds 126 readings at 250 Hz, however they are rounded


@dataclass(frozen=True)
class Stillness:
    """What counts as standing still: every joint within `deg` (prismatic: `mm`) for at least `seconds`."""

    deg: float
    seconds: float
    mm: float | None = None

    def tolerance(self, robot: Robot) -> Matrix:
        """(n,) degrees or mm; BadInput if one of the figures is missing or not above zero."""
        slides = any(joint.kind == "prismatic" for joint in robot.joints)
        if slides and self.mm is None:
            raise BadInput(
                "the tolerance of standing still is not stated for prismatic joints",
                found=f"{robot.name} has prismatic joints",
                remedy="state it in mm (--still-mm)",
            )
        for value, name in ((self.deg, "--still-deg"), (self.seconds, "--still-s"), (self.mm, "--still-mm")):
            if value is not None and not (value > 0 and math.isfinite(value)):
                raise BadInput(
                    f"{name} cannot be used", found=f"{value:g}", allowed="a finite number above 0"
                )
        return np.array([self.deg if joint.kind == "revolute" else self.mm for joint in robot.joints])


class Stand(NamedTuple):
    """Readings `first` to `last` at rest from `start_s` to `end_s`, of which those in `used` are averaged.

    `joints` (n,) is the mean of these and `spread` (n,) largest less smallest of them, degrees or mm.
    """

    first: int
    last: int
    start_s: float
    end_s: float
    used: slice
    joints: Matrix
    spread: Matrix


def find_stands(
    times: Matrix, joints: Matrix, tolerance: Matrix, seconds: float
) -> tuple[list[Stand], list[Stand]]:
    """Stands, and those passed over because the arm drifted: still in each window, but not as a whole.

    `times` (N,) s ascend; `joints` (N, n) and `tolerance` (n,) are degrees or mm. A window of `seconds` is at
    rest if all its readings of each joint lie within the tolerance and no two follow each other by more than
    half of it (what the arm did in a gap is not known). Windows at rest that overlap are one stand. A quarter
    of `seconds` is left out at both of its ends, where the arm still comes to rest or moves off again; what
    remains must be within the tolerance.
    """
    last = np.searchsorted(times, times + seconds - _ROUNDING)
    first = np.flatnonzero(last < len(times))
    last = last[first]
    if not len(first):
        return [], []
    longest_step = _largest(np.diff(times, append=times[-1])[:, None], first, last - 1)[:, 0]
    rest = np.all(_ranges(joints, first, last) <= tolerance, axis=1) & (
        longest_step <= seconds / 2 + _ROUNDING
    )
    first, last = first[rest], last[rest]
    if not len(first):
        return [], []
    opens = np.flatnonzero(np.append(True, first[1:] > last[:-1]))
    closes = np.append(opens[1:], len(first)) - 1
    stands: list[Stand] = []
    drifting: list[Stand] = []
    for begin, end in zip(first[opens].tolist(), last[closes].tolist(), strict=True):
        stand = _stand(times, joints, begin, end, seconds)
        (stands if np.all(stand.spread <= tolerance) else drifting).append(stand)
    return stands, drifting


def calmest(
    times: Matrix, joints: Matrix, tolerance: Matrix, seconds: float
) -> tuple[float, int, float] | None:
    """Time (s), joint (from 0) and movement (degrees or mm) of the window in which the arm moved least."""
    last = np.searchsorted(times, times + seconds - _ROUNDING)
    first = np.flatnonzero(last < len(times))
    if not len(first):
        return None
    moved = _ranges(joints, first, last[first])
    window = int(np.argmin((moved / tolerance).max(axis=1)))
    joint = int(np.argmax(moved[window] / tolerance))
    return float(times[first[window]]), joint, float(moved[window, joint])


def stand_of_each(stands: Sequence[Stand], marks: Matrix, seconds: float) -> list[int | None]:
    """Index of the stand that each mark (s) falls into, or is no farther from than half of `seconds`."""
    if not stands:
        return [None] * len(marks)
    start, end = np.array([[stand.start_s, stand.end_s] for stand in stands]).T
    away = np.maximum(np.maximum(start - marks[:, None], marks[:, None] - end), 0)
    nearest = away.argmin(axis=1)
    return [
        int(i) if distance <= seconds / 2 else None
        for i, distance in zip(nearest, away.min(axis=1), strict=True)
    ]


def repeats(stands: Sequence[Stand], tolerance: Matrix) -> list[int | None]:
    """Of each stand, the first one before it whose joints were the same within the tolerance."""
    joints = np.array([stand.joints for stand in stands]).reshape(len(stands), len(tolerance))
    found: list[int | None] = []
    for i in range(len(stands)):
        same = np.flatnonzero(np.all(np.abs(joints[:i] - joints[i]) <= tolerance, axis=1))
        found.append(int(same[0]) if len(same) else None)
    return found


def held(times: Matrix, joints: Matrix, seconds: float) -> tuple[Matrix, Matrix]:
    """A log that has a row only where the joints changed, as one that has rows all the time.

    Each row holds until the next one: it is repeated so that rows are a quarter of `seconds` apart at most.
    How long the last one held is not known.
    """
    counts = np.append(np.maximum(np.ceil(np.diff(times) / (seconds / 4)).astype(int), 1), 1)
    row = np.repeat(np.arange(len(times)), counts)
    place = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
    step = np.append(np.diff(times), 0.0) / counts
    return times[row] + place * step[row], joints[row]


def _stand(times: Matrix, joints: Matrix, first: int, last: int, seconds: float) -> Stand:
    start, end = float(times[first]), float(times[last])
    inner = np.searchsorted(times, [start + seconds / 4, end - seconds / 4 + _ROUNDING])
    used = slice(int(inner[0]), int(inner[1]))
    return Stand(first, last, start, end, used, joints[used].mean(axis=0), np.ptp(joints[used], axis=0))


def _ranges(values: Matrix, first: NDArray[np.int64], last: NDArray[np.int64]) -> Matrix:
    return _largest(values, first, last) + _largest(-values, first, last)


def _largest(values: Matrix, first: NDArray[np.int64], last: NDArray[np.int64]) -> Matrix:
    """(M, m) largest of each column of `values` (N, m) over the rows `first` to `last`, both (M,).

    A window is two that overlap, of 2^k rows each: the largest of these for all rows is made from those of
    2^(k - 1), and only one such table is kept at a time.
    """
    power = np.frexp(last - first + 1)[1] - 1
    result = np.empty((len(first), values.shape[1]))
    table = values
    for k in range(int(power.max()) + 1):
        if k:
            half = 2 ** (k - 1)
            table = np.maximum(table[:-half], table[half:])
        mine = power == k
        result[mine] = np.maximum(table[first[mine]], table[last[mine] - 2**k + 1])
    return result
