"""Runs from joint recordings in plain CSV files: units, targets and columns are stated, never guessed."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from ..model.errors import BadInput
from ..model.header import Header, check_header, read_header
from ..model.limits import check_limits
from ..model.reading import did_you_mean, read_text, shown
from ..model.robot import Matrix, Robot
from ..model.robot_file import load_robot, rebased
from ..model.run import Shot, check_distances, unknown_targets
from ..model.validation import validate


class Imported(NamedTuple):
    """What `write_run` needs, and sentences that say how the files were understood."""

    header: Header
    shots: list[Shot]
    understood: list[str]


@dataclass(frozen=True)
class CsvLayout:
    """How the CSV files are laid out.

    With a `header_row`, `columns` names the columns of joint 1, 2, … in this order, others are left out;
    without `columns` the files hold the joints alone, joint 1 first. `lengths` is the unit of prismatic
    joints, to be stated if there are any.
    """

    units: Literal["deg", "rad"]
    header_row: bool = False
    columns: tuple[str, ...] | None = None
    delimiter: str = ","
    lengths: Literal["mm", "m"] | None = None


def import_csv(
    files: Sequence[Path | str],
    target_names: Sequence[str],
    units: Literal["deg", "rad"],
    header_path: Path | str,
    out: Path | str,
    *,
    header_row: bool = False,
    columns: Sequence[str] | None = None,
    delimiter: str = ",",
    lengths: Literal["mm", "m"] | None = None,
) -> Imported:
    """Shots from CSV files, one posture a row, all shots of a file at the one target stated for it.

    `header_path` is a header YAML file; `out` is the run file that is going to be written, so that the
    robot's path in the header can be made relative to it. Nothing is written. BadInput, with file and
    line, for whatever is not as stated.
    """
    paths, header_path, out = [Path(file) for file in files], Path(header_path), Path(out)
    if units not in ("deg", "rad"):
        raise BadInput("the unit of the angles must be stated", found=shown(units), allowed="deg, rad")
    if not paths:
        raise BadInput("there is no file to import")
    if len(target_names) != len(paths):
        raise BadInput(
            "one target name is wanted for each file",
            found=f"{len(target_names)} names, {len(paths)} files",
            remedy="state the target of each file, in the order of the files; a name may come more than once",
        )
    for i, path in enumerate(paths):
        if path.resolve() in [other.resolve() for other in paths[:i]]:
            raise BadInput("the file is given twice", file=path, remedy="give each file once")
    layout = CsvLayout(units, header_row, None if columns is None else tuple(columns), delimiter, lengths)
    header = read_header(header_path)
    robot = load_robot(header.robot, header_path.parent, file=header_path)
    check_header(header, robot, file=header_path, line=lambda _: None)
    check_distances(header, target_names, file=header_path, line=None)
    _check_layout(layout, robot)

    shots: list[Shot] = []
    told: list[str] = []
    tables: list[Matrix] = []
    for path, target in zip(paths, target_names, strict=True):
        table, lines = _read_table(path, robot, layout)
        first = len(shots)
        for row in table.tolist():
            content = {"shot": len(shots), "target": target, "joints_deg": row}
            shots.append(validate(Shot, content, file=None, line=lambda _: None))
        if header.limits == "error":
            numbers = [i + 1 for i in range(len(table))]
            check_limits(robot, table, "row", numbers, lines, limits="error", file=path)
        tables.append(table)
        told.append(f"{path}: {len(table)} shots of target {target!r}, numbered {first} to {len(shots) - 1}")

    joints = np.concatenate(tables)
    numbers = [shot.shot for shot in shots]
    limits = check_limits(robot, joints, "shot", numbers, numbers, limits="warn", file=None)
    plural = "s" if len(paths) > 1 else ""
    understood = [
        f"{len(paths)} file{plural}, {len(shots)} shots, robot {robot.name} ({robot.n} joints)",
        *told,
        _units_told(layout, robot),
        _columns_told(layout),
        *_ranges_told(robot, joints),
        *(f"note: {sentence}" for sentence in (*limits, *unknown_targets(header, target_names))),
    ]
    moved = rebased(header.robot, header_path.parent, out.parent)
    return Imported(header.model_copy(update={"robot": moved}), shots, understood)


def _check_layout(layout: CsvLayout, robot: Robot) -> None:
    slides = any(joint.kind == "prismatic" for joint in robot.joints)
    if slides and layout.lengths not in ("mm", "m"):
        raise BadInput(
            "the unit of the prismatic joints must be stated",
            found=f"{robot.name} has prismatic joints",
            allowed="mm, m",
        )
    if len(layout.delimiter) != 1 or layout.delimiter in '."\r\n+-' or layout.delimiter.isalnum():
        raise BadInput(
            "this cannot stand between values",
            found=shown(layout.delimiter),
            allowed="one character: , ; or tab",
        )
    if layout.columns is None:
        return
    if not layout.header_row:
        raise BadInput(
            "columns are named, but no header row is stated",
            remedy="say that the files have a header row, if they have one",
        )
    if len(layout.columns) != robot.n or len(set(layout.columns)) != robot.n:
        raise BadInput(
            "one column is wanted for each joint",
            found=", ".join(layout.columns),
            allowed=f"{robot.n} different names ({robot.name} has {robot.n} joints)",
        )


def _read_table(path: Path, robot: Robot, layout: CsvLayout) -> tuple[Matrix, list[int]]:
    """(N, n) degrees or mm, joint 1 first, and the line of each row."""
    text, _ = read_text(path)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=layout.delimiter, strict=True)
    rows: list[tuple[int, list[str]]] = []
    try:
        for cells in reader:
            if any(cell.strip() for cell in cells):
                rows.append((reader.line_num, [cell.strip() for cell in cells]))
    except csv.Error as error:
        raise BadInput(f"the file is not valid CSV: {error}", file=path, line=reader.line_num) from None
    if not rows:
        raise BadInput("the file has no rows", file=path)
    chosen = list(range(robot.n))
    width = robot.n
    if layout.header_row:
        line, names = rows.pop(0)
        if all(map(_is_number, names)):
            raise BadInput(
                "the first row is not a header row: it holds numbers only",
                found=shown(layout.delimiter.join(names)),
                remedy="do not state a header row: the first row would be lost",
                file=path,
                line=line,
            )
        chosen, width = _chosen_columns(names, robot, layout, path, line), len(names)
    if not rows:
        raise BadInput("the file has a header row only", file=path)
    values: list[list[float]] = []
    for line, cells in rows:
        first = line == rows[0][0]
        if first and len(cells) > 1 and not layout.header_row and not any(map(_is_number, cells)):
            raise BadInput(
                "the first row holds no numbers",
                found=shown(layout.delimiter.join(cells)),
                allowed=f"{robot.n} numbers",
                remedy="if it is a header row, say that there is one",
                file=path,
                line=line,
            )
        if len(cells) != width:
            raise _wrong_count(cells, width, first, robot, layout, path, line)
        values.append([_value(cells[column], path, line, column) for column in chosen])
    return np.array(values) * _to_display(layout, robot), [line for line, _ in rows]


def _wrong_count(
    cells: list[str], width: int, first: bool, robot: Robot, layout: CsvLayout, path: Path, line: int
) -> BadInput:
    other = next((sign for sign in ";\t " if len(cells) == 1 and sign in cells[0]), None)
    # The first row decides whether the file is of another robot; a later one is broken in itself.
    whose = "the header row" if layout.header_row else f"{robot.name}, which has {robot.n} joints"
    remedy = None
    if other is not None:
        remedy = f"the values seem to be parted by {shown(other)}: state the delimiter"
    elif first and not layout.header_row:
        remedy = "take out the columns that are no joints, or name the columns in a header row"
    return BadInput(
        "the row has the wrong number of values",
        found=f"{len(cells)} values",
        allowed=f"{width}, as {whose}",
        remedy=remedy,
        file=path,
        line=line,
    )


def _chosen_columns(names: list[str], robot: Robot, layout: CsvLayout, path: Path, line: int) -> list[int]:
    """Index of the column of each joint."""
    for name in names:
        if names.count(name) > 1:
            raise BadInput("two columns have the same name", found=shown(name), file=path, line=line)
    if layout.columns is not None:
        for name in layout.columns:
            if name not in names:
                raise BadInput(
                    "there is no column of this name",
                    found=name,
                    allowed=", ".join(names),
                    remedy=did_you_mean(name, names),
                    file=path,
                    line=line,
                )
        return [names.index(name) for name in layout.columns]
    own = [joint.name for joint in robot.joints]
    if len(names) != robot.n or (set(names) == set(own) and names != own):
        raise BadInput(
            "the columns are not simply the joints in their order",
            found=", ".join(names),
            allowed=f"{robot.n} columns, joint 1 first ({', '.join(own)})",
            remedy="name the columns of joint 1, 2, … in this order",
            file=path,
            line=line,
        )
    return list(range(robot.n))


def _number(text: str) -> float | None:
    """The number, finite or not; None where the text is none (Python alone takes 1_000 for one)."""
    try:
        return None if "_" in text else float(text)
    except ValueError:
        return None


def _is_number(text: str) -> bool:
    return _number(text) is not None


def _value(text: str, path: Path, line: int, column: int) -> float:
    value = _number(text)
    if value is None or not math.isfinite(value):
        raise BadInput(
            f"column {column + 1} is not a {'finite ' if value is not None else ''}number",
            found=shown(text),
            allowed="finite numbers with a decimal point",
            remedy="take out a row that was not fully recorded",
            file=path,
            line=line,
        )
    return value


def _to_display(layout: CsvLayout, robot: Robot) -> Matrix:
    """(n,) degrees or mm in one unit of the file."""
    angle = 1.0 if layout.units == "deg" else math.degrees(1.0)
    length = 1000.0 if layout.lengths == "m" else 1.0
    return np.array([angle if joint.kind == "revolute" else length for joint in robot.joints])


def _units_told(layout: CsvLayout, robot: Robot) -> str:
    angles = "angles in radians, turned into degrees" if layout.units == "rad" else "angles in degrees"
    if all(joint.kind == "revolute" for joint in robot.joints):
        return angles
    return f"{angles}; prismatic joints in {layout.lengths}"


def _columns_told(layout: CsvLayout) -> str:
    if layout.columns is not None:
        return f"columns by name, joint 1 first: {', '.join(layout.columns)}"
    row = "below a header row" if layout.header_row else "no header row"
    return f"columns as they stand, joint 1 first; {row}"


def _ranges_told(robot: Robot, joints: Matrix) -> list[str]:
    return [
        f"joint {i + 1} ({joint.name}): {joints[:, i].min():.2f} to {joints[:, i].max():.2f} {joint.unit}, "
        f"limits {joint.lower * joint.display:.2f} to {joint.upper * joint.display:.2f}"
        for i, joint in enumerate(robot.joints)
    ]
