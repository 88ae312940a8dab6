"""Runs from CSV files and logs: units, targets and columns are stated or known, never guessed; of a log over
time, where the arm dwells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.files.joint_values import JointColumns
from ....model.files.text_tables import DELIMITERS, TextTable, is_workbook, read_table
from ....model.kinematics.robot import Robot
from ..import_jobs import FileMeasurements, Imported, ImportJob, Keys
from .layouts import NO_DWELLS, CsvLayout, Stillness

_ROUNDING = 1e-9  # of times: a window of 0.5 s holds 126 readings at 250 Hz, however they are rounded
_MOST_ROWS = 10**7


class Dwell(NamedTuple):
    """Readings `first` to `last` at rest from `start_s` to `end_s`, of which those in `used` are averaged.

    `joints` (n,) is their mean and `spread` (n,) their range, degrees or mm.
    """

    first: int
    last: int
    start_s: float
    end_s: float
    used: slice
    joints: Matrix
    spread: Matrix

    def __str__(self) -> str:
        return f"{self.start_s:.3f} to {self.end_s:.3f} s"

    def rejected(self, robot: Robot, tolerance: Matrix) -> str:
        """Why it is none."""
        joint = int(np.argmax(self.spread / tolerance))
        return (
            f"rejected: {self}, joint {joint + 1} drifts by {self.spread[joint]:.4g}"
            f" {robot.joints[joint].unit}, more than {tolerance[joint]:g}"
        )


def find_dwells(
    times: Matrix, joints: Matrix, tolerance: Matrix, seconds: float
) -> tuple[list[Dwell], list[Dwell]]:
    """Dwells, and those rejected because the arm drifted: at rest in each window, but not as a whole.

    `times` (N,) s ascend; `joints` (N, n) and `tolerance` (n,) are degrees or mm. A window of `seconds` is at
    rest if all its readings of each joint lie within the tolerance and no two follow each other by more than
    half of it (the motion in a gap is unknown). Windows at rest that overlap are one dwell. A quarter of
    `seconds` is dropped at each end, where the arm settles or starts again; the rest must be within the
    tolerance.
    """
    first, last = _windows(times, seconds)
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
    dwells: list[Dwell] = []
    drifting: list[Dwell] = []
    for begin, end in zip(first[opens].tolist(), last[closes].tolist(), strict=True):
        dwell = _dwell(times, joints, begin, end, seconds)
        (dwells if np.all(dwell.spread <= tolerance) else drifting).append(dwell)
    return dwells, drifting


def calmest(
    times: Matrix, joints: Matrix, tolerance: Matrix, seconds: float
) -> tuple[float, int, float] | None:
    """Time (s), joint (from 0) and movement (degrees or mm) of the window in which the arm moved least."""
    first, last = _windows(times, seconds)
    if not len(first):
        return None
    moved = _ranges(joints, first, last)
    window = int(np.argmin((moved / tolerance).max(axis=1)))
    joint = int(np.argmax(moved[window] / tolerance))
    return float(times[first[window]]), joint, float(moved[window, joint])


def dwell_of_each(dwells: Sequence[Dwell], marks: Matrix) -> tuple[NDArray[np.int64], Matrix]:
    """Index of the dwell that each marker (s) is nearest to, and how far away it is, s: 0 within."""
    start, end = np.array([[dwell.start_s, dwell.end_s] for dwell in dwells]).T
    away = np.maximum(np.maximum(start - marks[:, None], marks[:, None] - end), 0)
    return away.argmin(axis=1), away.min(axis=1)


def repeats(dwells: Sequence[Dwell], tolerance: Matrix) -> list[int | None]:
    """For each dwell the first earlier one with the same joints within the tolerance, or None."""
    joints = np.array([dwell.joints for dwell in dwells]).reshape(len(dwells), len(tolerance))
    earlier: list[int | None] = []
    for i in range(len(dwells)):
        same = np.flatnonzero(np.all(np.abs(joints[:i] - joints[i]) <= tolerance, axis=1))
        earlier.append(int(same[0]) if len(same) else None)
    return earlier


def held(times: Matrix, joints: Matrix, seconds: float) -> tuple[Matrix, Matrix]:
    """A log with a row only where the joints changed, as one with rows all the time.

    A row is valid until the next one: it is repeated so that rows are at most a quarter of `seconds` apart.
    How long the last one was valid is unknown.
    """
    needed = np.maximum(np.ceil(np.diff(times) / (seconds / 4)), 1)
    if needed.sum() > _MOST_ROWS:
        raise BadInput(
            "the times of the log are too far apart for dwells so short",
            found=f"{times[-1] - times[0]:.6g} s, and --still-s {seconds:g}",
            allowed=f"at most {_MOST_ROWS / 4:g} times --still-s",
            remedy="correct the times or --still-s, or divide the log",
        )
    counts = np.append(needed.astype(int), 1)
    row = np.repeat(np.arange(len(times)), counts)
    step_in_row = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
    step = np.append(np.diff(times), 0.0) / counts
    return times[row] + step_in_row * step[row], joints[row]


def _dwell(times: Matrix, joints: Matrix, first: int, last: int, seconds: float) -> Dwell:
    start, end = float(times[first]), float(times[last])
    inner = np.searchsorted(times, [start + seconds / 4, end - seconds / 4 + _ROUNDING])
    used = slice(int(inner[0]), int(inner[1]))
    return Dwell(first, last, start, end, used, joints[used].mean(axis=0), np.ptp(joints[used], axis=0))


def _windows(times: Matrix, seconds: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last reading of each window of so many seconds."""
    last = np.searchsorted(times, times + seconds - _ROUNDING)
    first = np.flatnonzero(last < len(times))
    return first, last[first]


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


class Mark(NamedTuple):
    """A marker, set by a person or the robot's program: its time (s), and the target if it names one."""

    time_s: float
    target: str | None


@dataclass(frozen=True)
class JointLog:
    """N readings of one file. `times` (N,) s since the first; `joints` (N, n) deg or mm; `spots` (N, 2) mm.

    `marks` is None where every dwell is a measurement.
    """

    path: Path
    times: Matrix
    joints: Matrix
    spots: Matrix | None = None
    marks: Sequence[Mark] | None = None

    def measurements(
        self, robot: Robot, still: Stillness, target: str | None, how: Sequence[str] = ()
    ) -> FileMeasurements:
        """One measurement for each dwell, or for each marked one; the joints are averaged over it.

        `target` is that of all measurements; without it the markers name it. `how` says how the file was
        read. BadInput without a dwell, for a marker outside all dwells, or if times do not increase.
        """
        tolerance = still.tolerance(robot)
        back = np.flatnonzero(np.diff(self.times) < 0)
        if len(back):
            raise BadInput(
                "the times do not increase",
                found=f"{self.times[back[0] + 1]:.6g} s after {self.times[back[0]]:.6g} s",
                remedy="import each recording from its own file; check the time column",
            )
        dwells, drifting = find_dwells(self.times, self.joints, tolerance, still.seconds)
        drifts = [dwell.rejected(robot, tolerance) for dwell in drifting]
        if not dwells:
            raise self._without_dwell(robot, still, tolerance, drifts)
        targets = self._chosen(dwells, still, target)
        kept = [dwells[i] for i in targets]
        notes = [*how, *_sentences(robot, kept, tolerance), *(f"  {drift}" for drift in drifts)]
        if len(kept) < len(dwells):
            notes.append(f"  dwells without a marker, not imported: {len(dwells) - len(kept)}")
        if self.marks is not None and len(self.marks) > len(kept):
            again = len(self.marks) - len(kept)
            notes.append(f"  second and later markers in a dwell: {again}; each dwell is one measurement")
        spots = self.spots
        keys = {
            "target": list(targets.values()),
            "spot_mm": None if spots is None else np.array([spots[one.used].mean(axis=0) for one in kept]),
            "time_s": [(dwell.start_s + dwell.end_s) / 2 for dwell in kept],
        }
        return FileMeasurements(self.path, "dwell", np.array([one.joints for one in kept]), keys, notes=notes)

    def _chosen(self, dwells: Sequence[Dwell], still: Stillness, target: str | None) -> dict[int, str]:
        """The target of each dwell that is a measurement, by its index, in their order."""
        if self.marks is None:
            if target is None:
                raise BadInput("the target of the file is not stated")
            return dict.fromkeys(range(len(dwells)), target)
        if not self.marks:
            raise BadInput("no measurements found: there is no marker in the recording")
        names: dict[int, str] = {}
        nearest, away = dwell_of_each(dwells, np.array([mark.time_s for mark in self.marks]))
        for mark, at, off in zip(self.marks, nearest.tolist(), away, strict=True):
            if off > still.seconds / 2:
                raise BadInput(
                    "the arm did not dwell at a marker",
                    found=f"marker at {mark.time_s:.3f} s; nearest dwell {dwells[at]}",
                    allowed=f"{still} around the marker",
                    remedy="state a larger tolerance or a shorter time if the arm was at rest",
                )
            name = mark.target if target is None else target
            if name is None:
                raise BadInput(
                    "the markers do not name a target",
                    remedy="state the target of the file (--target)",
                )
            if names.setdefault(at, name) != name:
                raise BadInput(
                    "two markers in one dwell name different targets",
                    found=f"{names[at]!r} and {name!r}, dwell {dwells[at]}",
                    remedy="a measurement has one target: remove the wrong marker",
                )
        return dict(sorted(names.items()))

    def _without_dwell(
        self, robot: Robot, still: Stillness, tolerance: Matrix, drifts: Sequence[str]
    ) -> BadInput:
        recording = f"a recording of {self.times[-1]:.3f} s, {len(self.times)} readings"
        if drifts:
            recording = drifts[0]
        elif (best := calmest(self.times, self.joints, tolerance, still.seconds)) is not None:
            start, joint, moved = best
            recording += f"; in the calmest window, from {start:.3f} s, joint {joint + 1} moves by"
            recording += f" {moved:.4g} {robot.joints[joint].unit}"
        return BadInput(
            "no measurements found: the arm never dwells",
            found=recording,
            allowed=f"{still}, readings at most {still.seconds / 2:g} s apart",
            remedy="state the tolerance and the shortest time of a dwell; check the unit of the angles",
        )


def _sentences(robot: Robot, dwells: Sequence[Dwell], tolerance: Matrix) -> list[str]:
    notes = []
    for i, (dwell, earlier) in enumerate(zip(dwells, repeats(dwells, tolerance), strict=True)):
        widest = int(np.argmax(dwell.spread / tolerance))
        sentence = (
            f"  dwell {i + 1}: {dwell}, mean of {dwell.used.stop - dwell.used.start} readings, "
            f"spread up to {dwell.spread[widest]:.4f} {robot.joints[widest].unit} (joint {widest + 1})"
        )
        notes.append(sentence + ("" if earlier is None else f"; repeats dwell {earlier + 1}"))
    return notes


def import_csv(job: ImportJob, layout: CsvLayout, still: Stillness = NO_DWELLS) -> Imported:
    """Measurements from CSV files of one layout: one a row, or one for each dwell if that is stated.

    All measurements of a file are at the target stated for it, or at that in `target_column`. Nothing is
    written. BadInput, with file and line, for what does not fit.
    """
    robot, dwells = job.robot, still.defined
    joints = JointColumns.of_options(
        robot,
        layout.columns,
        layout.units,
        lengths=layout.lengths,
        reversed_joints=layout.reversed_joints,
        j3=layout.j3,
        others=bool(layout.others),
    )
    layout.check(dwells=dwells)
    if job.names and layout.target_column is not None:
        raise BadInput("targets are stated both by name and by a column", remedy="state one of the two")

    def read(path: Path, target: str | None) -> FileMeasurements:
        table = read_table(
            path,
            header_row=layout.header_row,
            delimiter=layout.delimiter,
            decimal=layout.decimal,
            joints_of=robot if joints.alone else None,
        )
        values = joints.read(table)
        sought = layout.delimiter is None and not is_workbook(path)
        notes = [f"  delimiter found: {DELIMITERS[table.delimiter]}"] if sought else []
        names = None if layout.target_column is None else table.texts(table.column(layout.target_column))
        spots = None
        if layout.spot_columns is not None:
            across = [table.column(name) for name in layout.spot_columns]
            table.require_units(across, ["mm", "mm"], "convert the spots to mm, and name the columns so")
            spots = table.numbers(across)
        times = None
        if layout.time_column is not None and layout.time_units is not None:
            times = table.seconds(layout.time_column, layout.time_units)
            times = times - times[0]
        if dwells and times is not None:
            column = layout.marker_column
            marks = None if column is None else _marks(table, column, times, names)
            if layout.changes_only:
                still.tolerance(robot)
                times, values = held(times, values, still.seconds)
            return JointLog(path, times, values, spots, marks).measurements(robot, still, target, notes)
        keys: Keys = {
            "target": names or [target] * len(values),
            "shot": None if layout.shot_column is None else table.whole_numbers(layout.shot_column),
            "spot_mm": spots,
            "time_s": times,
        }
        return FileMeasurements(path, "row", values, keys, table.lines, notes)

    head = "; below a header row" if layout.header_row else "; no header row"
    others = [f"{what}: column {name}" for what, name in layout.others.items()]
    return job.measured(
        read,
        [*joints.sentences(head), *others],
        named=layout.target_column is None,
        in_radians=None
        if layout.units != "deg" or layout.small_angles
        else "state --units rad; or --small-angles, if they are in degrees",
    )


def _marks(table: TextTable, column: str, times: Matrix, names: Sequence[str] | None) -> list[Mark]:
    """A marker at each row where the column takes a new value other than empty or 0."""
    texts = table.texts(table.column(column))
    values = [text if text.lower() not in ("", "0", "0.0", "false", "nan") else None for text in texts]
    return [
        Mark(float(times[i]), None if names is None else names[i])
        for i, value in enumerate(values)
        if value is not None and (i == 0 or value != values[i - 1])
    ]
