"""Runs from tables of points and poses that trackers and coordinate measuring machines measured.

Units, the level of an uncertainty and the order of Euler angles are stated, never guessed.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np

from ....model.arrays import Index, Matrix
from ....model.errors import BadInput, located
from ....model.files.limits import like_radians
from ....model.files.text_tables import (
    DELIMITERS,
    TextTable,
    columns_of_joints,
    found_delimiter,
    number,
    table_of,
)
from ....model.instruments.pose import put_right
from ....model.kinematics.orientation import orientation
from ....model.kinematics.pendant import Pendant, pendant_of
from ....model.parsing.reading import LARGEST_TABLE, did_you_mean, read_other_text, shown
from ..import_jobs import FileMeasurements, Imported, ImportJob, uncollected
from .euler import found_order, require_as_stated, rotations
from .layouts import PER_SECOND, PointLayout

Unit = Literal["mm", "m", "inch"]
Level = Literal["1sigma", "95", "none"]
Match = Literal["number", "time"]
MILLIMETRES: dict[str, float] = {"mm": 1.0, "m": 1000.0, "inch": 25.4}
SIGMAS: dict[str, float] = {"1sigma": 1.0, "95": 1.959964}  # of a normal distribution, two-sided

_WORDS = {
    **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetre", "millimetres"), "mm"),
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), "m"),
    **dict.fromkeys(("in", "inch", "inches"), "inch"),
}
_UNIT = re.compile(r"\bunits?\b\s*[:=,]?\s*([a-z]+)", re.IGNORECASE)
_COMMENT = ("//", "#")
_MARKER = re.compile(r"([xyz])[ _.-]?(\d{1,3})|[a-z]{0,8}(\d{1,3})[ _.-]([xyz])", re.IGNORECASE)
_UNSEEN = ("", "nan", "-", "null", "none")
_UNIT_OF_NAME = re.compile(r"[\[(_ ](mm|m|inch|in)[\])]?$", re.IGNORECASE)
_UNCERTAINTY = re.compile(
    r"(?:^|[^a-z])(?:u|std|sd|sigma|unc[a-z]*)[-_ .]*([xyz])(?:[^a-z]|$)", re.IGNORECASE
)


def import_points(job: ImportJob, layout: PointLayout) -> Imported:
    """Measurements from one table of points, each with the joints that belong to it.

    Nothing is written. BadInput, with file and line, for what does not fit or is not stated.
    """
    layout.check()
    if len(job.paths) != 1:
        raise BadInput("points are imported from one file", found=f"{len(job.paths)} files")
    if len(job.names) > 1:
        raise BadInput(
            "several targets are stated for one file", found=", ".join(job.names), allowed="--target once"
        )
    path, pendant = job.paths[0], pendant_of(job.robot, layout.j3)
    with uncollected():
        job.progress("reading", 0.1)
        table, head = read_points(path, layout.delimiter, layout.decimal)
        points, visible, unit, notes = _points(table, head, layout)
        joints, rows, matched = _joints(table, pendant, layout)
        if layout.quaternion_columns is not None or layout.rotation_columns is not None:
            points, quaternions, how = _poses(table, job, points, joints, layout)
            more: list[dict[str, object]] = [
                {"measured_mm": row, "measured_quat": quaternion}
                for row, quaternion in zip(points.tolist(), quaternions, strict=True)
            ]
            notes += how
        else:
            more = [{"measured_mm": row} for row in points.tolist()]
        sigmas, how = _sigmas(table, unit, layout)
        for one, i in zip(more, visible.tolist() if sigmas else [], strict=False):
            one["sigma_mm"] = sigmas[i // len(layout.markers)]
        notes += how
        if layout.reflector_column is not None:
            reflectors = table.texts(table.column(layout.reflector_column))
        else:
            reflectors = [layout.markers[i % len(layout.markers)] for i in visible.tolist()]
        # Of each measurement the row of the table, and with that the joints.
        of = [i // len(layout.markers) for i in visible.tolist()]
        joints, rows, count = joints[of], [rows[i] for i in of], len(of)
        shared = {row for row, times in Counter(rows).items() if times > 1}
        for one, row, reflector in zip(more, rows, reflectors, strict=True):
            if layout.instrument is not None:
                one["instrument"] = layout.instrument
            if reflector:
                one["reflector"] = reflector
            if row in shared:
                one["posture"] = row
        times = None
        if layout.time_column is not None and layout.time_units is not None:
            clock = _times(table, layout.time_column, layout.time_units)
            times = (clock - clock[0])[of]
        part = FileMeasurements(
            path,
            "row",
            joints,
            [job.names[0] if job.names else None] * count,
            lines=[table.lines[i] for i in of],
            times=times,
            notes=[*matched, f"  delimiter: {DELIMITERS.get(table.delimiter, table.delimiter)}"],
            more=more,
        )
        job.progress(f"{count} measurements", 0.5)
        return job.finish([part], notes)


def read_points(path: Path, delimiter: str | None, decimal: str) -> tuple[TextTable, list[str]]:
    """A table and its lines of remarks. The names of columns are in the first row, if no cell of it is a
    number, or in the last remark before it, if it has as many cells."""
    text = read_other_text(path, LARGEST_TABLE)
    lines = text.splitlines()
    remarks = [i for i, line in enumerate(lines) if line.lstrip().startswith(_COMMENT)]
    head = [lines[i].lstrip().lstrip("/#").strip() for i in remarks]
    for i in remarks:
        lines[i] = ""
    with located(path):
        rows = [i for i, line in enumerate(lines) if line.strip()]
        if not rows:
            raise BadInput("the file has no rows")
        sign = found_delimiter("\n".join(lines[i] for i in rows), decimal) if delimiter is None else delimiter
        first = _cells(lines[rows[0]], sign)
        named = not any(number(cell, decimal) is not None for cell in first)
        above = [i for i in remarks if i < rows[0]]
        if not named and above:
            text = head[remarks.index(above[-1])]
            cells = _cells(text, sign)
            # A remark may name fewer columns than there are: dates, and what was added after them.
            if len(cells) == len(first) and not any(number(cell, decimal) is not None for cell in cells):
                lines[above[-1]], named = text, True
    table = table_of(
        "\n".join(lines), path, header_row=named, delimiter=sign, decimal=decimal, joints_of=None
    )
    return table, head


def _cells(line: str, delimiter: str) -> list[str]:
    return [cell.strip() for cell in (line.split() if delimiter == " " else line.split(delimiter))]


def _points(
    table: TextTable, head: Sequence[str], layout: PointLayout
) -> tuple[Matrix, Index, str, list[str]]:
    """(N, 3) mm, which of all markers of all rows each is, the unit that they have in the table, and how they
    were understood."""
    names = _columns_of_markers(table, layout) if layout.columns is None else layout.columns
    columns = [table.column(name) for name in names]
    in_file = {
        _WORDS[word.lower()] for line in head for word in _UNIT.findall(line) if word.lower() in _WORDS
    }
    for i in columns if table.names is not None else []:
        if match := _UNIT_OF_NAME.search(table.names[i] if table.names else ""):
            in_file.add(_WORDS[match[1].lower()])
    units = {*in_file, *([] if layout.units is None else [layout.units])}
    if len(units) != 1:
        raise BadInput(
            "the unit of the coordinates is not stated" if not units else "the units contradict each other",
            found=", ".join(sorted(units)) or "no unit in the file",
            allowed="--units mm, m or inch",
            remedy="state the unit in which the table was written",
            file=table.path,
        )
    (unit,) = units
    where = "as the file says" if in_file else "as stated"
    notes = [f"points: columns {', '.join(names)} in {unit}, {where}"]
    count = len(layout.markers)
    if count == 1:
        return table.numbers(columns) * MILLIMETRES[unit], np.arange(len(table.rows)), unit, notes
    # A marker that was not seen has no numbers.
    groups = [columns[3 * k : 3 * k + 3] for k in range(count)]
    visible = np.array(
        [
            count * i + k
            for i, row in enumerate(table.rows)
            for k, group in enumerate(groups)
            if any(row[column].lower() not in _UNSEEN for column in group)
        ],
        dtype=np.int64,
    )
    points = np.array([table.numbers_at(i // count, groups[i % count]) for i in visible.tolist()])
    notes.append(f"  {count} markers in a row, {', '.join(layout.markers)}: {len(visible)} measurements")
    return points.reshape(-1, 3) * MILLIMETRES[unit], visible, unit, notes


def _columns_of_markers(table: TextTable, layout: PointLayout) -> list[str]:
    """The columns of x, y and z of each marker by their names: x, y, z, or x1, y1, z1, x2, … of several."""
    by_marker: dict[str, dict[str, str]] = {}
    for name in table.names or ():
        if match := _MARKER.fullmatch(_UNIT_OF_NAME.sub("", name).strip()):
            by_marker.setdefault(match[2] or match[3], {})[(match[1] or match[4]).lower()] = name
    numbered = [
        axes for _, axes in sorted(by_marker.items(), key=lambda item: int(item[0])) if len(axes) == 3
    ]
    if len(numbered) < 2:
        return [_axis_column(table, axis) for axis in "xyz"]
    if len(numbered) != len(layout.markers) or not all(layout.markers):
        raise BadInput(
            "a row has the positions of several markers, and it is not stated which reflector each is",
            found=", ".join(name for axes in numbered for name in axes.values()),
            allowed=f"--reflector with {len(numbered)} names of the header's reflectors, in their order",
            remedy="state --reflector R1,R2,…; or --columns with the three of one marker",
            file=table.path,
            line=table.header_line or table.lines[0],
        )
    return [axes[axis] for axes in numbered for axis in "xyz"]


def _axis_column(table: TextTable, axis: str) -> str:
    """The name of the column of an axis, which has a unit behind it or none."""
    matching = [name for name in table.names or () if _UNIT_OF_NAME.sub("", name).strip().lower() == axis]
    if len(matching) == 1:
        return matching[0]
    raise BadInput(
        f"the column of {axis} is not found by its name",
        found=", ".join(table.names or ()) or f"{table.width} columns without names",
        allowed=axis.upper(),
        remedy="state --columns with the names of x, y, z, or their numbers from 1",
        file=table.path,
        line=table.header_line or table.lines[0],
    )


def _joints(table: TextTable, pendant: Pendant, layout: PointLayout) -> tuple[Matrix, list[int], list[str]]:
    """(N, n) degrees or mm at each point, the row of the joints' table of each, and how they were matched."""
    robot = pendant.robot
    columns = columns_of_joints(layout.joint_columns, robot) or ()
    if len(columns) != robot.n or len(set(columns)) != robot.n:
        raise BadInput(
            "one column is required for each joint",
            found=", ".join(columns),
            allowed=f"{robot.n} different ones ({robot.name} has {robot.n} joints)",
        )
    beside = table
    if layout.joints is not None:
        beside, _ = read_points(layout.joints, None, layout.decimal)
    joints = beside.numbers([beside.column(name) for name in columns])
    slides = [joint.kind == "prismatic" for joint in robot.joints]
    if any(slides) and layout.lengths is None:
        raise BadInput(
            "the unit of the prismatic joints is not stated",
            found=f"{robot.name} has prismatic joints",
            allowed="--lengths mm or m",
        )
    angle = 1.0 if layout.joint_units == "deg" else math.degrees(1.0)
    joints = joints * np.where(slides, 1000.0 if layout.lengths == "m" else 1.0, angle)
    if layout.joint_units == "deg" and not layout.small_angles and like_radians(robot, joints):
        raise BadInput(
            "the joints look like radians, but degrees are stated",
            found=f"no joint beyond {np.abs(joints).max():.4g}, in {len(joints)} postures",
            remedy="state --joint-units rad; or --small-angles, if they are in degrees",
            file=beside.path,
        )
    joints = pendant.between_links(joints)
    understood = [f"  joints: columns {', '.join(columns)}, {layout.joint_units}"]
    if beside is table:
        return joints, list(range(len(joints))), understood
    rows, sentence = _matched(table, beside, layout)
    understood.append(f"  joints of {beside.path} matched {sentence}")
    idle = len(joints) - len(set(rows))
    if idle:
        understood.append(f"  {idle} of {len(joints)} rows of joints have no point")
    return joints[rows], rows, understood


def _matched(points: TextTable, joints: TextTable, layout: PointLayout) -> tuple[list[int], str]:
    """The row of joints of each point, and how it was found."""
    if layout.match == "time":
        return _by_time(points, joints, layout)
    if layout.number_column is None or layout.joints_number_column is None:
        if len(points.rows) != len(joints.rows):
            raise BadInput(
                "there are not as many points as joints",
                found=f"{len(points.rows)} points, {len(joints.rows)} rows of joints",
                allowed="equally many rows, or numbers in both tables",
                remedy="state --number-column and --joints-number-column, or --match time",
                file=joints.path,
            )
        return list(range(len(points.rows))), "row by row, in the order of both files"
    row_of: dict[int, int] = {}
    for i, value in enumerate(_numbers(joints, layout.joints_number_column)):
        if value in row_of:
            raise BadInput(
                "two rows of joints have the same number",
                found=f"{value}, first on line {joints.lines[row_of[value]]}",
                file=joints.path,
                line=joints.lines[i],
            )
        row_of[value] = i
    rows = []
    for line, value in zip(points.lines, _numbers(points, layout.number_column), strict=True):
        if value not in row_of:
            raise BadInput(
                "a point has a number that no joints have",
                found=value,
                allowed=f"{min(row_of)} to {max(row_of)}, as in {joints.path.name}",
                remedy="remove the point, or correct the numbers",
                file=points.path,
                line=line,
            )
        rows.append(row_of[value])
    return rows, "by their numbers"


def _numbers(table: TextTable, name: str) -> list[int]:
    """The whole number at the end of each text of a column: 12 of 'p12'."""
    column = table.column(name)
    numbers = []
    for line, text in zip(table.lines, table.texts(column), strict=True):
        match = re.search(r"(?<![0-9.,])[0-9]{1,9}$", text)
        if match is None:
            raise BadInput(
                f"column {name} has no number here",
                found=shown(text),
                allowed="a whole number, or a name that ends with one",
                file=table.path,
                line=line,
            )
        numbers.append(int(match[0]))
    return numbers


def _by_time(points: TextTable, joints: TextTable, layout: PointLayout) -> tuple[list[int], str]:
    assert layout.time_column
    assert layout.time_units
    assert layout.joints_time_column
    assert layout.within_s
    at = _times(points, layout.time_column, layout.time_units)
    clock = _times(joints, layout.joints_time_column, layout.joints_time_units or layout.time_units)
    order = np.argsort(clock, kind="stable")
    ordered = clock[order]
    right = np.clip(np.searchsorted(ordered, at), 1, max(len(ordered) - 1, 1))
    right = np.minimum(right, len(ordered) - 1)
    left = np.maximum(right - 1, 0)
    nearest = np.where(np.abs(ordered[left] - at) <= np.abs(ordered[right] - at), left, right)
    off = np.abs(ordered[nearest] - at)
    far = int(np.argmax(off))
    if off[far] > layout.within_s:
        raise BadInput(
            "a point has no joints at its time",
            found=f"the nearest are {off[far]:.6g} s away; {int((off > layout.within_s).sum())} such points",
            allowed=f"within {layout.within_s:g} s",
            remedy="compare the clocks of both files, or state a larger --within-s",
            file=points.path,
            line=points.lines[far],
        )
    return order[nearest].tolist(), f"by time, {off[far]:.3g} s apart at most"


def _times(table: TextTable, name: str, units: str) -> Matrix:
    """(N,) s, of a column of numbers or dates."""
    column = table.column(name)
    if units in PER_SECOND:
        return np.asarray(table.numbers([column])[:, 0] / PER_SECOND[units])
    if units != "iso" and "%" not in units:
        raise BadInput(
            "the unit of the times is not understood",
            found=units,
            allowed="s, ms, us, ns, iso, or a pattern such as %m/%d/%Y %H:%M:%S",
            remedy=did_you_mean(units, [*PER_SECOND, "iso"]),
        )
    seconds = []
    for line, text in zip(table.lines, table.texts(column), strict=True):
        try:
            time = datetime.fromisoformat(text) if units == "iso" else datetime.strptime(text, units)
        except ValueError:
            raise BadInput(
                f"column {name} is not a time here",
                found=shown(text),
                allowed="ISO 8601" if units == "iso" else units,
                file=table.path,
                line=line,
            ) from None
        # Both files count times without a zone as if they were of UTC.
        seconds.append((time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp())
    return np.array(seconds)


def _poses(
    table: TextTable, job: ImportJob, points: Matrix, joints: Matrix, layout: PointLayout
) -> tuple[Matrix, list[list[float]], list[str]]:
    """(N, 3) mm and [w, x, y, z] of each pose, and how the orientation was understood."""
    quaternions, notes = _quaternions(table, job, joints, layout)
    if layout.inverse in ("rotation", "pose"):
        as_read = np.hstack([points, quaternions])
        right = put_right(as_read, "inverse_pose" if layout.inverse == "pose" else "inverse")
        what = "rotations inverted" if layout.inverse == "rotation" else "poses inverted, positions with them"
        return right[:, :3], right[:, 3:7].tolist(), [*notes, f"  {what}, as stated"]
    if layout.inverse is None and layout.euler != "find":
        with located(table.path):
            require_as_stated(
                np.hstack([points, quaternions]),
                job.robot.fk(joints, "deg"),
                layout.quaternion_columns,
            )
    return points, quaternions, notes


def _quaternions(
    table: TextTable, job: ImportJob, joints: Matrix, layout: PointLayout
) -> tuple[list[list[float]], list[str]]:
    """[w, x, y, z] of each pose, and how the orientation was understood."""
    if layout.quaternion_columns is not None:
        values = table.numbers([table.column(name) for name in layout.quaternion_columns])
        sentence = f"orientation: quaternion w, x, y, z of columns {', '.join(layout.quaternion_columns)}"
        return values.tolist(), [sentence]
    assert layout.rotation_columns is not None
    assert layout.euler is not None
    names = layout.rotation_columns
    angles = table.numbers([table.column(name) for name in names])
    if layout.rotation_units == "deg":
        angles = np.radians(angles)
    elif np.abs(angles).max() > 4 * math.pi:
        raise BadInput(
            "the angles of the orientation look like degrees, but radians are stated",
            found=f"up to {np.abs(angles).max():.4g}",
            remedy="state --rotation-units deg",
            file=table.path,
        )
    sentence = f"orientation: columns {', '.join(names)} in {layout.rotation_units}, "
    if layout.euler == "find":
        flange = job.robot.fk(joints, "deg")[:, :3, :3]
        with located(table.path):
            fitting = found_order(angles, names, flange, inverse=layout.inverse in ("rotation", "pose"))
        turned, sentence = fitting.rotations, sentence + fitting.sentence
    else:
        turned, sentence = rotations(angles, layout.euler), sentence + layout.euler
    return [list(orientation(rotation).quaternion) for rotation in turned], [sentence]


def _sigmas(table: TextTable, unit: str, layout: PointLayout) -> tuple[list[float], list[str]]:
    """sigma_mm of each point, empty where none is to be taken, and how it was understood."""
    names = layout.uncertainty_columns
    if names is None:
        by_axis = {
            match[1].lower(): name
            for name in table.names or ()
            if (match := _UNCERTAINTY.search(name)) is not None
        }
        names = [by_axis[axis] for axis in "xyz"] if len(by_axis) == 3 else None
    if names is None:
        if layout.uncertainty in SIGMAS:
            raise BadInput(
                "the level of an uncertainty is stated, but not its columns",
                found=f"--uncertainty {layout.uncertainty}",
                remedy="state --uncertainty-columns ux,uy,uz, or leave it out",
                file=table.path,
            )
        return [], []
    if layout.uncertainty is None:
        raise BadInput(
            "the level of the uncertainty columns is not stated",
            found=", ".join(names),
            allowed="--uncertainty 1sigma, 95 or none (the header's noise counts)",
            remedy="look it up in the settings of the software that wrote the table",
            file=table.path,
            line=table.header_line or None,
        )
    if layout.uncertainty == "none":
        return [], [f"uncertainty: columns {', '.join(names)} are not used"]
    values = table.numbers([table.column(name) for name in names])
    if not (values > 0).all():
        row, column = (int(i) for i in np.argwhere(~(values > 0))[0])
        raise BadInput(
            "an uncertainty is not above 0",
            found=f"{names[column]}: {values[row, column]:g}",
            remedy="remove the row, or state --uncertainty none",
            file=table.path,
            line=table.lines[row],
        )
    sigma = np.sqrt(np.mean(values**2, axis=1)) * MILLIMETRES[unit] / SIGMAS[layout.uncertainty]
    divided = "as they are" if layout.uncertainty == "1sigma" else "divided by 1.96 (95 %, normal)"
    return sigma.tolist(), [f"sigma_mm: root mean square of {', '.join(names)}, {divided}"]
