"""Recordings: what is in them, which column is which joint, and the header of a run as a form."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import BeforeValidator, Field

from ....experiments.makers import contents as columns_found
from ....experiments.makers import readings
from ....experiments.makers.generic.tables import TextTable, check_signs
from ....experiments.schema import json_schema
from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.files.header import Header, RobotRef, check_header, header_content, write_header
from ....model.files.limits import beyond_limits
from ....model.files.reading import read_yaml
from ....model.files.robot_file import load_robot
from ....model.files.validation import FileModel, as_tuple, validate
from ....model.kinematics.pendant import Pendant
from ....model.kinematics.robot import Robot
from ..asked import Refused, keyed, refused
from ..end_point import EndPoint
from ..folder import Folder
from . import contents_process
from .notes import noted
from .robots import require_robot_inside, rounded, whole_ref

_MOST_FILES = 200
_SHOWN = 8  # rows of a table
_Value = TypeVar("_Value")


class AskedTable(FileModel):
    """How tables are laid out; what is not stated is found."""

    header_row: bool | None = Field(default=None, description="whether the first row names the columns")
    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = Field(
        default=None, description="delimiter between two values"
    )
    decimal: Literal[".", ","] | None = Field(default=None, description="decimal sign")


class AskedRecording(AskedTable):
    """A recording to look at."""

    file: str = Field(description="path below the folder")


class AskedColumns(AskedTable):
    """Which columns of tables are which joints."""

    files: Annotated[
        tuple[str, ...], BeforeValidator(as_tuple), Field(min_length=1, max_length=_MOST_FILES)
    ] = Field(description="paths below the folder, of tables of one layout")
    robot: RobotRef = Field(description="a built-in name, a robot file, or {urdf, base, tip}")
    beside: str | None = Field(
        default=None, description="the file that the robot's path is relative to (default: the folder)"
    )
    columns: Annotated[tuple[str | None, ...], BeforeValidator(as_tuple)] | None = Field(
        default=None, description="column of joint 1, 2, …, null where it is not stated"
    )
    units: Literal["deg", "rad"] | None = Field(default=None, description="unit of the angles")
    lengths: Literal["mm", "m"] | None = Field(default=None, description="unit of prismatic joints")
    reversed_joints: Annotated[tuple[int, ...], BeforeValidator(as_tuple)] = Field(
        default=(), description="joints, from 1, that were recorded with the other sign"
    )
    j3: Literal["link", "ground"] | None = Field(
        default=None, description="what joint 3 is counted from (default: as the robot file states)"
    )


class AskedHeader(FileModel):
    """A header to check or to write."""

    file: str = Field(description="path below the folder (.yaml), which paths in the header are relative to")
    header: dict[str, Any] = Field(description="the content of a header file")


async def recording(folder: Folder, wanted: AskedRecording) -> dict[str, Any]:
    """What a file is (`form`, `why`), what it holds (`count`), and what an import can choose from."""
    path = folder.file(wanted.file)
    found = await contents_process.contents(path, _stated_layout(wanted))
    return {"file": folder.called(path), "bytes": path.stat().st_size, **found}


def columns(folder: Folder, wanted: AskedColumns) -> dict[str, Any]:
    """Per joint its column, the range seen against its limits and the rows outside; what the limits say of
    unit, signs and joint 3 (null where there is nothing to say)."""
    robot = _robot(folder, wanted)
    given = wanted.columns
    if given is not None and len(given) != robot.n:
        raise _wrong(
            ("columns",), "one column is required for each joint", len(given), f"{robot.n} ({robot.name})"
        )
    for i, number in enumerate(wanted.reversed_joints):
        if not 1 <= number <= robot.n:
            raise _wrong(("reversed_joints", i), "there is no such joint", number, f"1 to {robot.n}")
    pendant = _at(("j3",), lambda: Pendant(robot, wanted.j3))
    tables, whole = [], True
    for name in wanted.files:
        path = folder.file(name)
        text, all_of_it = columns_found.head_of(path, max(10**5, columns_found.HEAD // len(wanted.files)))
        whole = whole and all_of_it
        layout = columns_found.layout_stated(columns_found.layout_of(text), _stated_layout(wanted))
        tables.append(columns_found.table_with(path, text, layout))
    raw = np.concatenate([_raw(table, given, robot) for table in tables])
    proposed = columns_found.proposed_columns(columns_found.columns_of(tables[0]), robot)
    scale = _scale(robot, wanted)
    signs = np.ones(robot.n)
    signs[[number - 1 for number in wanted.reversed_joints]] = -1
    recorded = raw * scale  # NaN where the unit is not stated
    joints = pendant.between_links(recorded * signs)
    outside = beyond_limits(robot, joints)
    units = readings.unit_reading(robot, pendant.between_links(raw))
    lengths = readings.length_reading(robot, raw)
    sign = [None] * robot.n if pendant.ground else readings.sign_readings(robot, recorded)
    j3 = readings.j3_reading(robot, recorded * signs) if robot.n > 2 else None
    return {
        "robot": robot.name,
        "rows": len(raw),
        "whole": whole,
        "joints": [
            {
                "name": joint.name,
                "unit": joint.unit,
                "lower": joint.lower * joint.display,
                "upper": joint.upper * joint.display,
                "recorded": _range(raw[:, i]),
                "seen": _range(joints[:, i]),
                "outside": None if np.isnan(joints[:, i]).all() else int(outside[:, i].sum()),
                "sign": _reading(sign[i]),
            }
            for i, joint in enumerate(robot.joints)
        ],
        "columns": None if proposed is None else {"choice": proposed[0], "why": proposed[1]},
        "units": _reading(units),
        "lengths": _reading(lengths),
        "j3": _reading(j3),
        "first": [
            [None if np.isnan(value) else value for value in row] for row in rounded(joints[:_SHOWN], 6)
        ],
    }


def schema(_: Folder) -> dict[str, Any]:
    """JSON Schema of a header."""
    return json_schema("header")


def header(folder: Folder, name: str) -> dict[str, Any]:
    """The header of a header file or a plan, as it is stated."""
    path = folder.file(name)
    document = read_yaml(path)
    content = document.data
    if isinstance(content, dict):
        content = {key: value for key, value in content.items() if key != "postures_deg"}
    with noted() as notes:
        stated = validate(Header, content, file=path, line=document.line)
        require_robot_inside(folder, content, path.parent)
        robot = load_robot(stated.robot, path.parent, file=path)
        check_header(stated, robot, file=path, line=document.line)
    plain = header_content(stated, "zerobeam/plan/1")
    del plain["schema"]
    return {"file": folder.called(path), "header": plain, "target": stated.only_target, "notes": notes}


def check(folder: Folder, wanted: AskedHeader) -> dict[str, Any]:
    """Whether a header can be used, and with which robot; Refused with the key of what is wrong."""
    stated, robot, notes = _checked(folder, wanted)
    return {"robot": robot.name, "joints": robot.n, "target": stated.only_target, "notes": notes}


def write(folder: Folder, wanted: AskedHeader) -> dict[str, Any]:
    """Write a header as a new file, whole or not at all."""
    if Path(wanted.file).suffix.lower() not in {".yaml", ".yml"}:
        raise _wrong(("file",), "a header cannot have this name", wanted.file, "a name that ends in .yaml")
    path = _at(("file",), lambda: folder.new(wanted.file))
    stated, robot, notes = _checked(folder, wanted)
    write_header(path, stated)
    return {
        "file": folder.called(path),
        "robot": robot.name,
        "joints": robot.n,
        "target": stated.only_target,
        "notes": notes,
    }


def _checked(folder: Folder, wanted: AskedHeader) -> tuple[Header, Robot, list[str]]:
    path = folder.inside(wanted.file)

    def use(line: Any) -> tuple[Header, Robot]:
        stated = validate(Header, wanted.header, file=None, line=line)
        require_robot_inside(folder, wanted.header, path.parent)
        try:
            robot = load_robot(stated.robot, path.parent)
        except BadInput as error:
            at = line(("robot",))
            raise BadInput(
                error.what, found=error.found, allowed=error.allowed, remedy=error.remedy, line=at
            ) from error
        check_header(stated, robot, file=None, line=line)
        return stated, robot

    with noted() as notes:
        stated, robot = keyed(wanted.header, use, ("header",))
    return stated, robot, notes


def _robot(folder: Folder, wanted: AskedColumns) -> Robot:
    start = folder.root if wanted.beside is None else folder.inside(wanted.beside).parent
    return _at(("robot",), lambda: load_robot(whole_ref(folder, wanted.robot, start), start))


def _stated_layout(wanted: AskedTable) -> dict[str, Any]:
    stated = wanted.model_dump(include={"header_row", "delimiter", "decimal"}, exclude_none=True)
    check_signs(stated.get("delimiter"), stated.get("decimal", "."))
    return stated


def _raw(table: TextTable, given: tuple[str | None, ...] | None, robot: Robot) -> Matrix:
    """(N, n) values as they are in the table, NaN for a joint without a column."""
    values = np.full((len(table.rows), robot.n), np.nan)
    for i, name in enumerate(given or ()):
        if name is not None:
            values[:, i] = _at(("columns", i), partial(_numbers, table, name))
    return values


def _numbers(table: TextTable, name: str) -> Matrix:
    return table.numbers([table.column(name)])[:, 0]


def _scale(robot: Robot, wanted: AskedColumns) -> Matrix:
    """(n,) degrees or mm in one unit of the table; NaN where the unit is not stated."""
    angle = {"deg": 1.0, "rad": float(np.degrees(1.0)), None: np.nan}[wanted.units]
    length = {"mm": 1.0, "m": 1000.0, None: np.nan}[wanted.lengths]
    return np.array([angle if joint.kind == "revolute" else length for joint in robot.joints])


def _range(values: Matrix) -> list[float] | None:
    if np.isnan(values).any():
        return None
    return [float(values.min()), float(values.max())]


def _reading(found: readings.Reading | None) -> dict[str, Any] | None:
    return None if found is None else dataclasses.asdict(found)


def _wrong(key: tuple[str | int, ...], what: str, found: object, allowed: object) -> Refused:
    return refused(BadInput(what, found=found, allowed=allowed), key)


def _at(key: tuple[str | int, ...], use: Callable[[], _Value]) -> _Value:
    try:
        return use()
    except BadInput as error:
        same = refused(error, key)
        same.line = error.line
        raise same from error


END_POINTS = [
    EndPoint("/api/recording", "POST", "What a recording is, and what it holds.", recording, AskedRecording),
    EndPoint(
        "/api/columns", "POST", "Columns as joints: ranges, limits, units, signs.", columns, AskedColumns
    ),
    EndPoint("/api/header/schema", "GET", "JSON Schema of a header.", schema),
    EndPoint("/api/header", "GET", "The header of a header file or plan.", header, asked=("file",)),
    EndPoint("/api/header", "PUT", "Writes a header as a new file.", write, AskedHeader),
    EndPoint("/api/header/check", "POST", "Whether a header can be used.", check, AskedHeader),
]
