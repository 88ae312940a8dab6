"""The region over which the error of the TCP is judged, as a header states it (key `workspace`).

It is a part of the joints' ranges, a box in which the TCP is, or the postures of the user's own programs. Of
the last a file is named. It is read once: the header that comes out has the postures themselves, so that a
plan, a run and a result mean the same wherever they are kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from ..errors import BadInput
from ..kinematics.pendant import pendant_of
from ..kinematics.robot import Robot
from ..parsing.reading import (
    LARGEST_RECORDING,
    json_rows,
    read_bytes,
    read_yaml,
    require_schema,
    shown,
)
from ..parsing.validation import FileModel, Name, Vector, as_tuple, refusal, tuple_of, validate
from .joint_values import JointColumns, JointValues, check_limits, require_degrees, require_joint_count
from .text_tables import layout_of, table_of, table_text

MOST_POSTURES = 1000
_OF_A_FILE = ("units", "lengths", "postures_deg")


class StatedWorkspace(FileModel):
    """Where the TCP must be accurate: the values to enter serve this region best, and its error is stated."""

    joints: Literal["central", "full"] = Field(
        default="central",
        description="central: the central 70 % of each joint's range, joint 1 within 90° of its middle; full:"
        " the whole ranges",
    )
    box_mm: Annotated[tuple[Vector, Vector], tuple_of(2, "[[x, y, z], [x, y, z]]")] | None = Field(
        default=None,
        description="the TCP is within this box along the axes of the base frame: its lowest and its highest"
        " corner, [[x, y, z], [x, y, z]], millimetres",
    )
    positions: Name | None = Field(
        default=None,
        description="path of a file of postures, instead: of your own programs as CSV (the joints alone, in"
        " the pendant's order, a header row or none), or a run or a plan",
    )
    units: Literal["deg", "rad"] | None = Field(
        default=None, description="of the angles in that CSV file; required for one"
    )
    lengths: Literal["mm", "m"] | None = Field(
        default=None, description="of its prismatic joints; required where there are any"
    )
    postures_deg: Annotated[tuple[JointValues, ...], BeforeValidator(as_tuple)] | None = Field(
        default=None,
        description="the postures of that file, degrees (millimetres for a prismatic joint): written when it"
        " is read; it is not read again then",
    )

    @property
    def is_range(self) -> bool:
        """Whether the region is a part of the joints' ranges, and nothing narrower."""
        return self.positions is None and self.box_mm is None

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if self.box_mm is not None and any(
            low >= high for low, high in zip(self.box_mm[0], self.box_mm[1], strict=True)
        ):
            raise refusal(
                "workspace.box_mm is empty",
                key=("box_mm",),
                found=shown(self.box_mm),
                allowed="[lowest corner, highest corner], each number of the second above that of the first",
            )
        if self.positions is None:
            for key in _OF_A_FILE:
                if getattr(self, key) is not None:
                    raise refusal(
                        f"workspace.{key} is stated without a file of positions",
                        key=(key,),
                        remedy="state positions: FILE, or remove it",
                    )
            return self
        for key in ("joints", "box_mm"):
            if key in self.model_fields_set:
                raise refusal(
                    f"workspace.{key} is stated together with a file of positions",
                    key=(key,),
                    found=f"positions: {self.positions}",
                    allowed="one of the two: a file of postures is the whole region",
                )
        if self.postures_deg is not None and not 0 < len(self.postures_deg) <= MOST_POSTURES:
            raise refusal(
                "workspace.postures_deg has not the right number of postures",
                key=("postures_deg",),
                found=f"{len(self.postures_deg)} postures",
                allowed=f"1 to {MOST_POSTURES}",
            )
        return self

    def with_postures(self, robot: Robot, folder: Path, *, file: Path | None, line: int | None) -> Self:
        """The same with the postures of its file, if it names one that was not read yet. `file` and `line`
        are where it is named; BadInput for a file that is not of this robot, or says too little."""
        if self.positions is None or self.postures_deg is not None:
            return self
        path = folder / self.positions
        try:
            rows = self._rows(path, robot)
        except BadInput as error:
            if error.line is not None:
                raise
            # There is no such file, or no reading it: that is said where it is named.
            raise error.restated(
                found=error.found or self.positions,
                remedy=error.remedy or "correct workspace.positions, or the file that it names",
                file=file,
                line=line,
            ) from None
        if not 0 < len(rows) <= MOST_POSTURES:
            raise BadInput(
                "the file of positions has not the right number of postures",
                found=f"{len(rows)} postures",
                allowed=f"1 to {MOST_POSTURES}",
                remedy="keep the postures in which your programs work, and leave out those on the way",
                file=path,
            )
        return self.model_copy(update={"postures_deg": tuple(tuple(map(float, row)) for row in rows)})

    def check_postures(self, robot: Robot, *, file: Path | None, line: int | None) -> None:
        """BadInput where its postures are of another arm, or outside the limits of this one."""
        if self.postures_deg is not None:
            _require_of(robot, self.postures_deg, [line] * len(self.postures_deg), "posture", file, 0)

    def _rows(self, path: Path, robot: Robot) -> Sequence[Sequence[float]]:
        """The postures of the file, degrees (mm)."""
        if path.suffix.casefold() not in (".jsonl", ".yaml", ".yml"):
            return self._of_table(path, robot)
        for key in ("units", "lengths"):
            if getattr(self, key) is not None:
                raise BadInput(
                    f"workspace.{key} is stated for a run or a plan, which says its unit itself",
                    found=f"{key}: {getattr(self, key)}",
                    remedy="remove it",
                    file=path,
                )
        rows, lines = _of_run(path) if path.suffix.casefold() == ".jsonl" else _of_plan(path)
        _require_of(robot, rows, lines, "posture", path, 0)
        return rows

    def _of_table(self, path: Path, robot: Robot) -> Sequence[Sequence[float]]:
        text = table_text(path)
        slides = any(joint.kind == "prismatic" for joint in robot.joints)
        for key, values, needed in (("units", "deg or rad", True), ("lengths", "mm or m", slides)):
            if needed and getattr(self, key) is None:
                raise BadInput(
                    f"the unit of the {'angles' if key == 'units' else 'prismatic joints'} in the file of"
                    " positions is not stated",
                    found=f"positions: {self.positions}",
                    allowed=f"workspace.{key}: {values}",
                    file=path,
                )
        layout, pendant = layout_of(text, decimal="."), pendant_of(robot)
        table = table_of(text, path, layout, None if layout.header_row else robot)
        joints = JointColumns(pendant, None, self.units, self.lengths).read(table)
        if self.units == "deg":
            remedy = "state workspace.units: rad; if they are degrees, state the postures as a plan"
            require_degrees(robot, joints, remedy, file=path, line=table.lines[0])
        rows: list[list[float]] = joints.tolist()
        _require_of(robot, rows, table.lines, "row", path, 1)
        return rows


CENTRAL_RANGES = StatedWorkspace()


def _require_of(
    robot: Robot,
    rows: Sequence[Sequence[float]],
    lines: Sequence[int | None],
    noun: str,
    file: Path | None,
    first: int,
) -> None:
    """BadInput for the first row, degrees (mm), that is not of the robot or outside of its limits."""
    for i, (row, line) in enumerate(zip(rows, lines, strict=True)):
        require_joint_count(row, robot, f"{noun} {i + first} of the positions", file, line)
    numbers = range(first, len(rows) + first)
    joints = np.array(rows, dtype=float).reshape(len(rows), robot.n)
    check_limits(robot, joints, f"positions, {noun}", numbers, lines, limits="error", file=file)


class _PostureLine(FileModel):
    """The joints of a line of a run or a plan."""

    joints_deg: JointValues


def _of_run(path: Path) -> tuple[list[tuple[float, ...]], list[int | None]]:
    rows, _ = json_rows(read_bytes(path, LARGEST_RECORDING), path)
    require_schema(rows[0][1], "zerobeam/run/1", file=path, line=rows[0][0])
    return _joints_of(rows[1:], path)


def _of_plan(path: Path) -> tuple[list[tuple[float, ...]], list[int | None]]:
    document = read_yaml(path)
    require_schema(document.data, "zerobeam/plan/1", file=path, line=document.line(("schema",)))
    data: Any = document.data
    rows = data.get("postures_deg")
    places = [(document.line(("postures_deg", i)), row) for i, row in enumerate(rows or ())]
    return _joints_of(
        [(line, {"joints_deg": row} if isinstance(row, list) else row) for line, row in places], path
    )


def _joints_of(
    rows: Sequence[tuple[int | None, Any]], path: Path
) -> tuple[list[tuple[float, ...]], list[int | None]]:
    joints = []
    for line, row in rows:
        content = {"joints_deg": row.get("joints_deg")} if isinstance(row, dict) else row
        joints.append(validate(_PostureLine, content, file=path, line=lambda _, at=line: at).joints_deg)  # type: ignore[misc]
    return joints, [line for line, _ in rows]
