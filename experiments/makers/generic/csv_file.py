"""Runs from CSV files and logs: units, targets and columns are stated or known, never guessed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.files.joint_columns import JointColumns
from ....model.files.text_tables import DELIMITERS, TextTable, read_table
from ....model.files.workbook import is_workbook
from ..import_jobs import FileMeasurements, Imported, ImportJob, Keys
from .dwells import JointLog, Mark, held
from .layouts import NO_DWELLS, CsvLayout, Stillness


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
        spots = None if layout.spot_columns is None else table.columns(layout.spot_columns)
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
