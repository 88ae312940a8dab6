"""A log: joints over time, without rows of its own for shots; they are where the arm stood still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...model.errors import BadInput
from ...model.robot import Matrix, Robot
from .dwells import Stand, Stillness, calmest, find_stands, repeats, stand_of_each
from .imported import Found


class Mark(NamedTuple):
    """Somebody, or the robot's program, said "a shot now": when (s), and at which target if that was said."""

    time_s: float
    target: str | None


@dataclass(frozen=True)
class Log:
    """N readings of one file. `times` (N,) s since the first; `joints` (N, n) deg or mm; `spots` (N, 2) mm.

    `marks` is None where every stand is a shot.
    """

    path: Path
    times: Matrix
    joints: Matrix
    spots: Matrix | None = None
    marks: Sequence[Mark] | None = None

    def shots(self, robot: Robot, still: Stillness, target: str | None) -> Found:
        """One shot for each stand, or for each that is marked; the joints are averaged over it.

        `target` is that of all shots; without it the marks must say it. BadInput if the arm never stood
        still, if it did not at a mark, or if times do not ascend.
        """
        tolerance = still.tolerance(robot)
        back = np.flatnonzero(np.diff(self.times) < 0)
        if len(back):
            raise BadInput(
                "the times do not ascend",
                found=f"{self.times[back[0] + 1]:.6g} s after {self.times[back[0]]:.6g} s, from the first on",
                remedy="import each recording from a file of its own; check the column of times",
                file=self.path,
            )
        stands, drifting = find_stands(self.times, self.joints, tolerance, still.seconds)
        if not stands:
            raise self._no_stand(robot, still, tolerance, drifting)
        chosen, targets = self._chosen(stands, still, target)
        kept = [stands[i] for i in chosen]
        joints = np.array([stand.joints for stand in kept])
        spots = None if self.spots is None else np.array([self.spots[s.used].mean(axis=0) for s in kept])
        times = np.array([(stand.start_s + stand.end_s) / 2 for stand in kept])
        told = [
            *_told(robot, kept, tolerance),
            *(_passed_over(robot, stand, tolerance) for stand in drifting),
        ]
        if len(kept) < len(stands):
            told.append(f"  stands without a marker, left out: {len(stands) - len(kept)}")
        if self.marks is not None and len(self.marks) > len(kept):
            again = len(self.marks) - len(kept)
            told.append(f"  markers beyond the first in a stand: {again}; each stand is one shot")
        return Found(self.path, "stand", joints, targets, spots=spots, times=times, told=told)

    def _chosen(
        self, stands: Sequence[Stand], still: Stillness, target: str | None
    ) -> tuple[list[int], list[str]]:
        """Indices of the stands that are shots, and the target of each."""
        if self.marks is None:
            if target is None:
                raise BadInput("the target of the file's stands is not stated", file=self.path)
            return list(range(len(stands))), [target] * len(stands)
        if not self.marks:
            raise BadInput("no shots found: there is no marker in the recording", file=self.path)
        times = np.array([mark.time_s for mark in self.marks])
        names: dict[int, str] = {}
        for mark, at in zip(self.marks, stand_of_each(stands, times, still.seconds), strict=True):
            if at is None:
                near = _nearest(stands, mark.time_s)
                raise BadInput(
                    "the arm did not stand still at a marker",
                    found=f"marker at {mark.time_s:.3f} s; nearest stand {_span(near)}",
                    allowed=f"joints within {still.deg:g} deg for {still.seconds:g} s around the marker",
                    remedy="state a larger tolerance or a shorter time if the arm was really at rest",
                    file=self.path,
                )
            name = mark.target if target is None else target
            if name is None:
                raise BadInput(
                    "the markers do not name a target",
                    remedy="state the target of the file's shots (--target)",
                    file=self.path,
                )
            if names.setdefault(at, name) != name:
                raise BadInput(
                    "two markers in one stand name different targets",
                    found=f"{names[at]!r} and {name!r}, stand {_span(stands[at])}",
                    remedy="a beam is on one target at a time: take out the marker that is wrong",
                    file=self.path,
                )
        chosen = sorted(names)
        return chosen, [names[i] for i in chosen]

    def _no_stand(
        self, robot: Robot, still: Stillness, tolerance: Matrix, drifting: Sequence[Stand]
    ) -> BadInput:
        found = f"a recording of {self.times[-1]:.3f} s, {len(self.times)} readings"
        if drifting:
            found = _passed_over(robot, drifting[0], tolerance).strip()
        elif (best := calmest(self.times, self.joints, tolerance, still.seconds)) is not None:
            start, joint, moved = best
            found += f"; at its calmest, from {start:.3f} s, joint {joint + 1} moves by {moved:.4g}"
            found += f" {robot.joints[joint].unit}"
        return BadInput(
            "no shots found: the arm never stands still",
            found=found,
            allowed=f"joints within {still.deg:g} deg for {still.seconds:g} s, readings at most "
            f"{still.seconds / 2:g} s apart",
            remedy="state the tolerance and the least time of your stands; check the unit of the angles",
            file=self.path,
        )


def _nearest(stands: Sequence[Stand], time_s: float) -> Stand:
    return min(stands, key=lambda stand: max(stand.start_s - time_s, time_s - stand.end_s))


def _span(stand: Stand) -> str:
    return f"{stand.start_s:.3f} to {stand.end_s:.3f} s"


def _told(robot: Robot, stands: Sequence[Stand], tolerance: Matrix) -> list[str]:
    told = []
    for i, (stand, earlier) in enumerate(zip(stands, repeats(stands, tolerance), strict=True)):
        widest = int(np.argmax(stand.spread / tolerance))
        sentence = (
            f"  stand {i + 1}: {_span(stand)}, mean of {stand.used.stop - stand.used.start} readings, "
            f"spread up to {stand.spread[widest]:.4f} {robot.joints[widest].unit} (joint {widest + 1})"
        )
        told.append(sentence + ("" if earlier is None else f"; repeats stand {earlier + 1}"))
    return told


def _passed_over(robot: Robot, stand: Stand, tolerance: Matrix) -> str:
    joint = int(np.argmax(stand.spread / tolerance))
    return (
        f"  passed over: {_span(stand)}, joint {joint + 1} drifts by "
        f"{stand.spread[joint]:.4g} {robot.joints[joint].unit}, more than {tolerance[joint]:g}"
    )
