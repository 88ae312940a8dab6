"""Contents of a file that an import can choose from: its form, a table's columns and layout."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np

from ...model.errors import BadInput
from ...model.files.text_tables import (
    Layout,
    TextTable,
    layout_of,
    number,
    plain_rows,
    table_of,
    without_remarks,
)
from ...model.files.workbook import is_workbook, workbook_text
from ...model.kinematics.robot import Robot
from ...model.parsing.reading import LARGEST_TABLE, decode_other, read_bytes, shown
from ...model.records import it, record
from .generic.bags import is_bag
from .generic.ros import Topic, messages, topics_of
from .joint_text import PROGRAM_LINE, is_log_of_program, program_is_no_recording, writes_log
from .known_logs import known_logs
from .maker import FormatMark, Reader, makers
from .taught_positions import POSTURE

HEAD = 4 * 10**6  # bytes of a table that are looked at while somebody waits
_COUNTED = re.compile(r"(.*?)(\d{1,2})(\D*)")


@record
class TableColumn:
    """`stated` is what an import calls the column: its name, or its number where the name cannot be stated.

    `lowest` and `highest` are of its numbers, None where it holds something else: `other`, of line `line`.
    """

    name: str
    stated: str
    lowest: float | None
    highest: float | None
    other: str | None
    line: int | None


def head_of(path: Path, most: int = HEAD) -> tuple[str, bool]:
    """The text of a table's first rows, whole lines, and whether that is all of it."""
    if is_workbook(path):
        return workbook_text(path), True
    size = path.stat().st_size
    if size <= most:
        return plain_rows(decode_other(read_bytes(path, LARGEST_TABLE), file=path), path), True
    with path.open("rb") as file:
        content = file.read(most)
    whole = content[: content.rfind(b"\n") + 1]
    if not whole:
        raise BadInput(
            "the first line of the file is too long to be a row",
            found=f"no end of a line in {most // 10**6 or 1} MB",
            file=path,
        )
    return plain_rows(decode_other(whole, file=path), path), False


def columns_of(table: TextTable) -> list[TableColumn]:
    names = table.names or tuple(f"column {i + 1}" for i in range(table.width))
    return [_column(table, i, name) for i, name in enumerate(names)]


def proposed_columns(table_columns: Sequence[TableColumn], robot: Robot) -> tuple[list[str], str] | None:
    """Columns that seem to be those of joint 1, 2, …, and why; None where nothing says so, or several do.

    By the robot's own names, by names that are counted from 0 or 1, or as the only columns of numbers.
    """
    joint_names = [joint.name for joint in robot.joints]
    called = {column.name: column.stated for column in table_columns}
    if set(joint_names) <= set(called):
        return [called[name] for name in joint_names], "the columns have the names of the robot's joints"
    counted: dict[tuple[str, str], dict[int, TableColumn]] = {}
    for column in table_columns:
        match = _COUNTED.fullmatch(column.name)
        if match is not None and column.lowest is not None and column.stated == column.name:
            counted.setdefault((match[1], match[3]), {})[int(match[2])] = column
    series = [
        [columns[k] for k in range(first, first + robot.n)]
        for columns in counted.values()
        for first in (0, 1)
        if set(columns) == set(range(first, first + robot.n))
    ]
    if len(series) == 1:
        first, last = series[0][0].name, series[0][-1].name
        why = f"{first} to {last} are the only columns that are counted to {robot.n} joints"
        return [column.stated for column in series[0]], why
    plain = [column for column in table_columns if column.lowest is not None]
    if not series and len(plain) == robot.n and len(table_columns) == robot.n:
        return [column.stated for column in plain], f"the file has {robot.n} columns, as the robot has joints"
    return None


def _column(table: TextTable, i: int, name: str) -> TableColumn:
    plain = table.names is not None and name and not set(name) & set(",=") and not name.isdecimal()
    called = name if plain else str(i + 1)
    try:
        values = table.numbers([i])
    except BadInput:
        line, text = next(
            (line, text)
            for line, text in zip(table.lines, table.texts(i), strict=True)
            if (value := number(text, table.decimal)) is None or not np.isfinite(value)
        )
        return TableColumn(name, called, None, None, shown(text), line)
    return TableColumn(name, called, float(values.min()), float(values.max()), None, None)


_OURS = re.compile(r"""^[ \t]*\{?[ \t]*["']?schema["']?\s*:\s*["']?zerobeam/(\w[\w-]*)/""", re.MULTILINE)
_JOINT_STATE = re.compile(r"^(?:name|position)\s*:", re.MULTILINE)
_MOST_SHOWN = 500  # points, messages


@record
class NamedPoint:
    """A taught point, and whether it has joints."""

    name: str
    joints: bool


@record
class Contents:
    """What a recording holds: a table, taught points, a bag, joint states in text, or a file of ours."""

    form: Annotated[str, it("what the file is")]
    why: Annotated[str, it("how that is seen")]
    count: Annotated[str, it("what it has, in words")]
    formats: Annotated[tuple[str, ...], it("of imports that may read it: the words behind `import`")] = ()
    layout: Layout | None = None
    columns: tuple[TableColumn, ...] = ()
    rows: Annotated[int, it("of a table: how many were looked at")] = 0
    whole: Annotated[bool, it("of a table: these are all")] = True
    points: tuple[NamedPoint, ...] = ()
    topics: tuple[Topic, ...] = ()
    names: Annotated[tuple[str, ...], it("of joint states in text: the joints")] = ()
    kind: Annotated[str, it("of a file of zerobeam")] = ""


def contents_of(path: Path, layout: Layout | None = None) -> Contents:
    """The contents of a file; `layout` is that of a table, if it is stated.

    BadInput for what no importer reads.
    """
    kind = is_bag(path)
    if kind is not None:
        topics = topics_of(path)
        states = [topic for topic in topics if topic.joints]
        count = "; ".join(f"{topic.messages} joint states on {topic.name}" for topic in states)
        why = f"the first bytes of {kind}"
        return Contents("ros", why, count or "no joint states", ("ros",), topics=topics)
    text, whole = head_of(path)
    if layout is None and whole and (contents := _program(path, text)) is not None:
        return contents
    return _table(path, text, whole, layout)


def _program(path: Path, text: str) -> Contents | None:
    """Contents of a file that a program wrote; None where it seems to be a table."""
    if (ours := _OURS.search(text[:4096])) is not None:
        count = f"a file of zerobeam: {ours[1]}"
        return Contents("ours", f"its schema, zerobeam/{ours[1]}", count, kind=ours[1])
    if is_log_of_program(text):
        lines = len(PROGRAM_LINE.findall(text))
        why, formats = "lines that a plan's program writes", [r.name for r in _readers() if r.program_log]
        return Contents("program log", why, f"{lines} postures", tuple(formats))
    marked = [
        (reader, mark)
        for reader in _readers()
        for mark in reader.marks
        if re.search(mark.pattern, text, re.MULTILINE | re.IGNORECASE)
    ]
    if marked:
        return _points(marked, text, path)
    if writes_log(text):
        raise program_is_no_recording(path)
    if len(set(_JOINT_STATE.findall(text))) == 2:
        states = messages(text)
        names = tuple(dict.fromkeys(name for _, message in states for name in message.get("name", ())))
        count = f"{len(states)} messages, each a measurement"
        return Contents("joint states", "its keys, as of JointState messages", count, ("ros",), names=names)
    if "delta_theta" in text and "delta_alpha" in text:
        raise BadInput(
            "this is the factory calibration of a UR arm, not a recording",
            remedy="make a robot file of it: zerobeam import ur-calibration",
            file=path,
        )
    return None


def _readers() -> list[Reader]:
    return [reader for maker in makers() for reader in maker.read if not reader.hidden]


def _points(marked: Sequence[tuple[Reader, FormatMark]], text: str, path: Path) -> Contents:
    """The positions of a text, of the first of the formats that it may have. Those of a plan's program are
    not chosen: it says itself which are measurements."""
    reader, mark = marked[0]
    written = mark.points(text, path)
    points = [point for point in written if not point.left_out]
    taught = sum(point.joints is not None for point in points)
    count = f"{len(points)} points, {taught} with joint values"
    is_plan = any(POSTURE.fullmatch(point.name) for point in points)
    shown = (
        ()
        if is_plan
        else tuple(NamedPoint(point.name, point.joints is not None) for point in points[:_MOST_SHOWN])
    )
    formats = tuple(dict.fromkeys(reader.name for reader, _ in marked))
    return Contents(reader.name, mark.why, count, formats, points=shown)


def _table(path: Path, text: str, whole: bool, stated_layout: Layout | None) -> Contents:
    if not text.strip():
        read_bytes(path)  # says that it is empty
        raise BadInput("the file is empty", file=path)
    rows, remarks = without_remarks(text, ("//",))
    layout = stated_layout or layout_of(rows)
    table = table_of(rows, path, layout)
    columns = tuple(columns_of(table))
    if not any(column.lowest is not None for column in columns):
        raise BadInput(
            "the file is no recording that can be imported: it has no column of numbers",
            found=", ".join(column.name for column in columns[:10])[:200],
            allowed="a table of joint positions, a log, a ROS bag, a program or points of a controller",
            file=path,
        )
    names = set(table.names or ())
    form, why = "csv", "its rows with equally many columns"
    formats = ["csv", "points", *(f"log {log.name}" for log in known_logs() if not log.columns)]
    log = next((log for log in known_logs() if log.columns and names.issuperset(log.columns)), None)
    if log is not None:
        form, formats = f"log {log.name}", [f"log {log.name}", "csv"]
        why = f"its columns {' and '.join(log.columns)}, as of: {log.about}"
    elif remarks:
        form, formats = "points", ["points"]
        why = "its remarks (//), as a tracker's program writes them"
    count = f"{len(table.rows)} rows of {table.width} columns"
    if not whole:
        count += " in its first part; the rest is checked at the import"
    return Contents(
        form,
        why,
        count,
        tuple(formats),
        layout=layout,
        columns=columns,
        rows=len(table.rows),
        whole=whole,
    )
