"""Contents of a file that an import can choose from: its form, a table's columns and layout, other ways to
read its joints; found in a process of its own."""

from __future__ import annotations

import asyncio
import json
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ...model.arrays import Matrix
from ...model.errors import BadInput
from ...model.files.joint_values import beyond_limits, like_radians
from ...model.files.text_tables import (
    Layout,
    TextTable,
    is_workbook,
    layout_of,
    number,
    plain_rows,
    table_of,
    without_remarks,
    workbook_text,
)
from ...model.kinematics.pendant import Pendant, nearest_limit
from ...model.kinematics.robot import Robot
from ...model.parsing.reading import LARGEST_TABLE, decode_other, read_bytes, shown
from ...model.records import it, read, record, to_json
from .generic.ros import Topic, is_bag, messages, topics_of
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


# Units, signs and the convention of joint 3, judged by the robot's limits alone.
#
# A reading is excluded where it puts joints outside their limits. What the limits do not exclude they do
# not decide: then there is no choice, and the sentence says so.

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


PATIENCE_S = 60.0
MOST_MEMORY = 4 * 10**9  # bytes of address space, of which libraries take one tenth
_PROGRAM = "from zerobeam.experiments.makers.contents import main; main()"
_COMMAND = [sys.executable, "-P", "-c", _PROGRAM]  # nothing is imported from the folder


async def contents(path: Path, layout: Mapping[str, object]) -> Contents:
    """What `contents_of` finds in a file; `layout` is what is stated of a table's.

    BadInput where it refuses, or where it takes more than `PATIENCE_S` or `MOST_MEMORY`.
    """
    process = await asyncio.create_subprocess_exec(
        *_COMMAND,
        str(path),
        json.dumps(dict(layout)),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        async with asyncio.timeout(PATIENCE_S):
            answer, fault = await process.communicate()
    except TimeoutError:
        raise _too_much(path, f"no answer in {PATIENCE_S:.0f} s") from None
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    if process.returncode:
        if process.returncode < 0:
            raise _too_much(path, f"the process was ended by signal {-process.returncode}")
        raise RuntimeError(fault.decode("utf-8", "replace"))
    printed = json.loads(answer)
    if "what" in printed:
        raise BadInput(**printed)
    return read(Contents, printed)


def main() -> None:
    """Print what the file holds, or why it is refused. Arguments: the file, and the layout that is stated."""
    path, layout = Path(sys.argv[1]), json.loads(sys.argv[2])
    _limit()
    try:
        holdings = contents_of(path, layout_of(head_of(path)[0], **layout) if layout else None)
        answer = to_json(holdings)
    except MemoryError:
        error = _too_much(path, f"more than {MOST_MEMORY // 10**9} GB of memory")
        answer = _facts(error)
    except BadInput as error:
        answer = _facts(error)
    sys.stdout.write(json.dumps(answer, allow_nan=False))


def _facts(error: BadInput) -> dict[str, object]:
    """The arguments of a BadInput."""
    facts = {name: getattr(error, name) for name in ("found", "allowed", "remedy", "file")}
    texts = {name: None if fact is None else str(fact) for name, fact in facts.items()}
    return {"what": error.what, "line": error.line, **texts}


def _limit() -> None:
    """Bound memory and time, which also ends this process where the server was killed; not on Windows."""
    if sys.platform != "win32":
        import resource

        limits = {resource.RLIMIT_AS: MOST_MEMORY, resource.RLIMIT_CPU: int(PATIENCE_S)}
        for kind, limit in limits.items():
            with suppress(ValueError, OSError):  # a lower one is in force, or the system has none
                resource.setrlimit(kind, (limit, limit))


def _too_much(path: Path, how_much: str) -> BadInput:
    return BadInput(
        "the file is too much to be looked at here",
        found=how_much,
        allowed=f"{PATIENCE_S:.0f} s and {MOST_MEMORY // 10**9} GB",
        remedy="use zerobeam import on the command line, if it is the right file",
        file=path,
    )
