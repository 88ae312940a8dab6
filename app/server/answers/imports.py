"""Recordings: what is in them, which column is which joint, and the header of a run as a form."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from ....experiments.arm_shown import JointLimits
from ....experiments.makers import contents
from ....experiments.makers import contents as columns_found
from ....experiments.makers.contents import Contents
from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.files.header import Header, RobotRef, check_header, header_content, write_header
from ....model.files.joint_values import JointColumns, beyond_limits
from ....model.files.robot_file import load_robot
from ....model.files.text_tables import TextTable, check_signs, layout_of, table_of
from ....model.kinematics.pendant import Pendant
from ....model.kinematics.robot import Robot
from ....model.parsing.reading import read_yaml
from ....model.parsing.validation import FileModel, as_tuple, validate
from ....model.records import it, record
from ..index import Folder, yaml_path
from ..requests import Content, Precondition, at_key, end_point, keyed, noted, wrong
from ..versions import VersionOfFile, replacing, version_of, version_of_sum
from .robot_library import require_robot_inside, rounded, whole_ref

_MOST_FILES = 200
_SHOWN = 8  # rows of a table
Ends = tuple[float, float]


class TableForm(FileModel):
    """How tables are laid out; what is not stated is found."""

    header_row: bool | None = Field(default=None, description="whether the first row names the columns")
    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = Field(
        default=None, description="delimiter between two values"
    )
    decimal: Literal[".", ","] | None = Field(default=None, description="decimal sign")


class RecordingRequest(TableForm):
    """A recording to look at."""

    file: str = Field(description="path below the folder")


class ColumnsRequest(TableForm):
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


FileOfHeader = Annotated[str, it("path below the folder (.yaml), which paths in the header are relative to")]
StatedHeader = Annotated[Content, it("the content of a header file")]


@record(kw_only=True)
class RecordingAnswer(Contents):
    """What a file is and holds, and what an import can choose from."""

    file: str
    bytes: int


@record(kw_only=True)
class JointColumn(JointLimits):
    """A joint as its column has it."""

    recorded: Annotated[Ends | None, it("range of the column; null without one")]
    seen: Annotated[Ends | None, it("range of the joint; null where the unit is not stated")]
    outside: Annotated[int | None, it("rows outside the limits")]
    sign: contents.Reading | None


@record(kw_only=True)
class ProposedColumns:
    """Columns that are proposed for the joints."""

    choice: list[str | None]
    why: str


@record(kw_only=True)
class ColumnsAnswer:
    """Columns as joints, and what the limits say of unit, signs and joint 3 (null: nothing)."""

    robot: str
    rows: int
    whole: Annotated[bool, it("all rows were looked at")]
    joints: list[JointColumn]
    columns: ProposedColumns | None
    units: contents.Reading | None
    lengths: contents.Reading | None
    j3: contents.Reading | None
    first: Annotated[list[list[float | None]], it("the first rows, as joints")]


@record(kw_only=True)
class HeaderUse:
    """A header that can be used."""

    robot: str
    joints: int
    target: str
    notes: list[str]


@record(kw_only=True)
class WrittenHeader(HeaderUse, VersionOfFile):
    """A header that was written."""


@record(kw_only=True)
class ReadHeader(VersionOfFile):
    """The header of a header file or a plan, as it is stated."""

    header: Content
    target: str
    notes: list[str]


@end_point("POST /api/recording", "What a recording is, and what it holds.")
async def recording(folder: Folder, request: RecordingRequest) -> RecordingAnswer:
    """What a file is and holds."""
    path = folder.file(request.file)
    holdings = await contents.contents(path, _layout(request))
    return RecordingAnswer(file=folder.called(path), bytes=path.stat().st_size, **vars(holdings))


@end_point("POST /api/columns", "Columns as joints: ranges, limits, units, signs.")
def columns(folder: Folder, request: ColumnsRequest) -> ColumnsAnswer:
    """Per joint its column, its range against its limits; what these say of unit, signs and joint 3."""
    robot = _robot(folder, request)
    chosen = request.columns
    if chosen is not None and len(chosen) != robot.n:
        raise wrong(
            ("columns",), "one column is required for each joint", len(chosen), f"{robot.n} ({robot.name})"
        )
    for i, number in enumerate(request.reversed_joints):
        if not 1 <= number <= robot.n:
            raise wrong(("reversed_joints", i), "there is no such joint", number, f"1 to {robot.n}")
    with at_key("j3"):
        counting = Pendant(robot, request.j3)
    joint_columns = JointColumns(
        counting,
        None,
        request.units,
        request.lengths,
        [str(number) for number in request.reversed_joints],
    )
    tables, whole = [], True
    for name in request.files:
        path = folder.file(name)
        text, all_of_it = columns_found.head_of(path, max(10**5, columns_found.HEAD // len(request.files)))
        whole = whole and all_of_it
        tables.append(table_of(text, path, layout_of(text, **_layout(request))))
    raw = np.concatenate([_raw(table, chosen, robot) for table in tables])
    proposed = columns_found.proposed_columns(columns_found.columns_of(tables[0]), robot)
    pendant = joint_columns.pendant
    recorded = raw * joint_columns.per_unit  # NaN where the unit is not stated
    joints = joint_columns.joints(raw)
    outside = beyond_limits(robot, joints)
    units = contents.unit_reading(robot, pendant.between_links(raw))
    lengths = contents.length_reading(robot, raw)
    sign = [None] * robot.n if pendant.ground else contents.sign_readings(robot, recorded)
    j3 = contents.j3_reading(robot, pendant.counted(joints)) if robot.n > 2 else None
    return ColumnsAnswer(
        robot=robot.name,
        rows=len(raw),
        whole=whole,
        joints=[
            JointColumn(
                name=joint.name,
                unit=joint.unit,
                lower=joint.lower * joint.display,
                upper=joint.upper * joint.display,
                recorded=_range(raw[:, i]),
                seen=_range(joints[:, i]),
                outside=None if np.isnan(joints[:, i]).all() else int(outside[:, i].sum()),
                sign=sign[i],
            )
            for i, joint in enumerate(robot.joints)
        ],
        columns=proposed and ProposedColumns(choice=list(proposed[0]), why=proposed[1]),
        units=units,
        lengths=lengths,
        j3=j3,
        first=[[None if np.isnan(value) else value for value in row] for row in rounded(joints[:_SHOWN], 6)],
    )


@end_point("GET /api/header/schema", "JSON Schema of a header.")
def schema(_: Folder) -> Content:
    """JSON Schema of a header."""
    from ....experiments.schema import json_schema  # with all kinds of files: half a second

    return json_schema("header")


@end_point("GET /api/header", "The header of a header file or plan.")
def header_file(folder: Folder, file: str) -> ReadHeader:
    """The header of a header file or a plan, as it is stated."""
    path = folder.file(file)
    document = read_yaml(path)
    content = document.data
    if isinstance(content, dict):
        content = {key: value for key, value in content.items() if key != "postures_deg"}
    with noted() as notes:
        read = validate(Header, content, file=path, line=document.line)
        require_robot_inside(folder, content, path.parent)
        robot = load_robot(read.robot, path.parent, file=path)
        check_header(read, robot, file=path, line=document.line)
    plain = header_content(read, "zerobeam/plan/1")
    del plain["schema"]
    return ReadHeader(
        version=version_of_sum(document.sha256),
        file=folder.called(path),
        header=plain,
        target=read.only_target,
        notes=notes,
    )


@end_point("POST /api/header/check", "Whether a header can be used.")
def check(folder: Folder, file: FileOfHeader, header: StatedHeader) -> HeaderUse:
    """Whether a header can be used, and with which robot; Refused with the key of what is wrong."""
    return _checked(folder, file, header)[1]


@end_point("PUT /api/header", "Writes a header: a new file, or in place of a header.")
def write(
    folder: Folder, file: FileOfHeader, header: StatedHeader, precondition: Precondition
) -> WrittenHeader:
    """Write a header as a new file or over a header, whole or not at all; nothing else is ever replaced, nor
    another version than the one that was read."""
    path = yaml_path(folder, file, "header")
    read, use = _checked(folder, file, header)
    with replacing(path, precondition, lambda: header_file(folder, file)) as force:
        write_header(path, read, force=force)
    return WrittenHeader(version=version_of(path), file=folder.called(path), **vars(use))


def _checked(folder: Folder, file: str, header: Content) -> tuple[Header, HeaderUse]:
    path = folder.inside(file)

    def use(line: Any) -> tuple[Header, Robot]:
        read = validate(Header, header, file=None, line=line)
        require_robot_inside(folder, header, path.parent)
        try:
            robot = load_robot(read.robot, path.parent)
        except BadInput as error:
            raise error.restated(file=None, line=line(("robot",))) from error
        check_header(read, robot, file=None, line=line)
        return read, robot

    with noted() as notes:
        read, robot = keyed(header, use, ("header",))
    return read, HeaderUse(robot=robot.name, joints=robot.n, target=read.only_target, notes=notes)


def _robot(folder: Folder, request: ColumnsRequest) -> Robot:
    start = folder.root if request.beside is None else folder.inside(request.beside).parent
    with at_key("robot"):
        return load_robot(whole_ref(folder, request.robot, start), start)


def _layout(request: TableForm) -> Content:
    layout = request.model_dump(include={"header_row", "delimiter", "decimal"}, exclude_none=True)
    check_signs(layout.get("delimiter"), layout.get("decimal", "."))
    return layout


def _raw(table: TextTable, chosen: tuple[str | None, ...] | None, robot: Robot) -> Matrix:
    """(N, n) values as they are in the table, NaN for a joint without a column."""
    values = np.full((len(table.rows), robot.n), np.nan)
    for i, name in enumerate(chosen or ()):
        if name is not None:
            with at_key("columns", i):
                values[:, i] = table.numbers([table.column(name)])[:, 0]
    return values


def _range(values: Matrix) -> Ends | None:
    if np.isnan(values).any():
        return None
    return float(values.min()), float(values.max())
