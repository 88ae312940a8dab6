"""Runs from CSV files and logs: units, targets and columns are stated or known, never guessed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.files.limits import like_radians
from ....model.files.text_tables import (
    DELIMITERS,
    TextTable,
    columns_as_on_pendant,
    columns_of_joints,
    not_joints_alone,
    read_table,
    reversed_joints,
)
from ....model.kinematics.pendant import Pendant, pendant_of
from ....model.kinematics.robot import J3, Robot
from ....model.parsing.reading import shown
from ..import_jobs import FileMeasurements, Imported, ImportJob, uncollected
from .dwells import JointLog, Mark, Stillness, held
from .layouts import PER_SECOND, CsvLayout


def import_csv(
    job: ImportJob,
    layout: CsvLayout,
    *,
    still: Stillness | None = None,
) -> Imported:
    """Measurements from CSV files of one layout: one a row, or with `still` one for each dwell of the arm.

    All measurements of a file are at the target stated for it, or at that in `target_column`. Nothing is
    written. BadInput, with file and line, for what does not fit.
    """
    layout = replace(layout, columns=columns_of_joints(layout.columns, job.robot))
    still = still or Stillness.of_options(layout.still_deg, layout.still_s, layout.still_mm)
    layout.check(job.robot)
    pendant = pendant_of(job.robot, layout.j3)
    if layout.target_column is None:
        targets: list[str | None] = [*job.targets()]
    elif job.names:
        raise BadInput("targets are stated both by name and by a column", remedy="state one of the two")
    else:
        targets = [None] * len(job.paths)
    _check_shots(layout, still)
    parts = []
    with uncollected():
        for k, (path, target) in enumerate(zip(job.paths, targets, strict=True)):
            job.progress(f"file {k + 1}/{len(job.paths)}", k / len(job.paths) / 2)
            parts.append(_measured(path, target, pendant, layout, still))
        if layout.units == "deg" and not layout.small_angles:
            _require_degrees(parts, job.robot)
        job.progress(f"{sum(len(part.joints) for part in parts)} measurements", 0.5)
        return job.finish(parts, [*_units_used(layout, pendant), *_columns_used(layout, pendant)])


def _require_degrees(parts: Sequence[FileMeasurements], robot: Robot) -> None:
    """BadInput where all angles are as small as radians would be, which are 57 times larger."""
    joints = np.concatenate([part.joints for part in parts])
    if like_radians(robot, joints):
        raise BadInput(
            "the angles look like radians, but degrees are stated",
            found=f"no joint beyond {np.abs(joints).max():.4g}, in {len(joints)} postures",
            allowed="angles in the stated unit",
            remedy="state --units rad; or --small-angles, if they are in degrees",
            file=parts[0].path,
        )


def _check_shots(layout: CsvLayout, still: Stillness | None) -> None:
    if still is None and layout.marker_column is not None:
        raise BadInput(
            "a column of markers is stated, but not what counts as a dwell",
            remedy="state the tolerance and the shortest time (--still-deg, --still-s)",
        )
    if still is None:
        return
    if layout.time_column is None:
        raise BadInput("dwells can be found only with a column of times", remedy="state it and its unit")
    if layout.shot_column is not None:
        raise BadInput(
            "a dwell has many rows, and no number of its own", remedy="leave out the column of numbers"
        )
    if layout.target_column is not None and layout.marker_column is None:
        raise BadInput(
            "the target of a dwell cannot be read from a column without markers",
            remedy="state a marker column, or one target for each file",
        )


def _measured(
    path: Path, target: str | None, pendant: Pendant, layout: CsvLayout, still: Stillness | None
) -> FileMeasurements:
    robot = pendant.robot
    table = read_table(
        path,
        header_row=layout.header_row,
        delimiter=layout.delimiter,
        decimal=layout.decimal,
        joints_of=robot if layout.joints_alone else None,
    )
    joints = table.numbers(_joint_columns(table, pendant, layout)) * _to_display(layout, pendant)
    joints[:, reversed_joints(layout.reversed_joints, robot)] *= -1
    joints = pendant.between_links(joints)
    spots = times = None
    if layout.spot_columns is not None:
        spots = table.numbers([table.column(name) for name in layout.spot_columns])
    if layout.time_column is not None and layout.time_units is not None:
        clock = table.numbers([table.column(layout.time_column)])[:, 0]
        times = (clock - clock[0]) / PER_SECOND[layout.time_units]
    names = None if layout.target_column is None else table.texts(table.column(layout.target_column))
    notes = [f"  delimiter found: {DELIMITERS[table.delimiter]}"] if layout.delimiter is None else []
    if still is not None and times is not None:
        marks = None if layout.marker_column is None else _marks(table, layout.marker_column, times, names)
        if layout.changes_only:
            still.tolerance(robot)
            times, joints = held(times, joints, still.seconds)
        dwells = JointLog(path, times, joints, spots, marks).shots(robot, still, target)
        return replace(dwells, notes=[*notes, *dwells.notes])
    return FileMeasurements(
        path,
        "row",
        joints,
        [target] * len(joints) if target is not None else names or [],
        lines=table.lines,
        numbers=None if layout.shot_column is None else _shot_numbers(table, layout.shot_column),
        spots=spots,
        times=times,
        notes=notes,
    )


def _joint_columns(table: TextTable, pendant: Pendant, layout: CsvLayout) -> list[int]:
    """Index of the column of each joint."""
    if layout.columns is not None:
        return [table.column(name) for name in layout.columns]
    if not layout.joints_alone:
        raise not_joints_alone(table, pendant)
    return columns_as_on_pendant(table, pendant)


def _marks(table: TextTable, column: str, times: Matrix, names: list[str] | None) -> list[Mark]:
    """A marker at each row where the column takes a new value other than empty or 0."""
    texts = table.texts(table.column(column))
    values = [text if text.lower() not in ("", "0", "0.0", "false", "nan") else None for text in texts]
    return [
        Mark(float(times[i]), None if names is None else names[i])
        for i, value in enumerate(values)
        if value is not None and (i == 0 or value != values[i - 1])
    ]


def _shot_numbers(table: TextTable, name: str) -> list[int]:
    column = table.column(name)
    for line, text in zip(table.lines, table.texts(column), strict=True):
        if not text.isdecimal() or len(text) > 9:
            raise BadInput(
                f"column {column + 1} is not a measurement number",
                found=shown(text),
                allowed="whole numbers from 0",
                file=table.path,
                line=line,
            )
    return [int(text) for text in table.texts(column)]


def _to_display(layout: CsvLayout, pendant: Pendant) -> Matrix:
    """(n,) degrees or mm in one unit of the file."""
    if layout.units == "pulse":
        return 1.0 / pendant.per_degree("pulse")
    angle = 1.0 if layout.units == "deg" else math.degrees(1.0)
    length = 1000.0 if layout.lengths == "m" else 1.0
    return np.array([angle if joint.kind == "revolute" else length for joint in pendant.robot.joints])


def _units_used(layout: CsvLayout, pendant: Pendant) -> list[str]:
    angles = {
        "rad": "angles in radians, converted to degrees",
        "deg": "angles in degrees",
        "pulse": "joints in pulses, converted to degrees by the robot file's pulses_per_deg",
    }[layout.units]
    if layout.lengths is not None and any(joint.kind == "prismatic" for joint in pendant.robot.joints):
        angles += f"; prismatic joints in {layout.lengths}"
    return [angles, *([] if pendant.counting is None else [pendant.counting])]


def _columns_used(layout: CsvLayout, pendant: Pendant) -> list[str]:
    if layout.columns is not None:
        notes = [f"columns by name, joint 1 first: {', '.join(layout.columns)}"]
    else:
        row = "below a header row" if layout.header_row else "no header row"
        plain = pendant.order == sorted(pendant.order)
        notes = [f"columns in file order, {'joint 1 first' if plain else 'as on the pendant'}; {row}"]
    others = {
        "target": layout.target_column,
        "measurement number": layout.shot_column,
        "spot in mm (dx, dy)": None if layout.spot_columns is None else ", ".join(layout.spot_columns),
        f"time in {layout.time_units}": layout.time_column,
        "marker": layout.marker_column,
    }
    if layout.reversed_joints:
        notes.append(f"signs reversed: {', '.join(layout.reversed_joints)}")
    notes += [f"{what}: column {name}" for what, name in others.items() if name is not None]
    return notes


def import_log(
    layout_of: Callable[[int], CsvLayout],
    job: ImportJob,
    *,
    still: Stillness,
    delimiter: str | None = None,
    decimal: str = ".",
    marker_column: str | None = None,
    j3: J3 | None = None,
) -> Imported:
    """Measurements from logs, whose layout depends on the number of joints: at each dwell, or at those that
    `marker_column` marks. `j3`: what the controller counts joint 3 from, if not as the robot file states."""
    layout = replace(layout_of(job.robot.n), marker_column=marker_column, decimal=decimal, j3=j3)
    layout = replace(layout, delimiter=delimiter or layout.delimiter)
    return import_csv(job, layout, still=still)
