"""A robot file with the rows of a corrected arm: exact, whatever its links are."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.files.header import UrdfRef
from ....model.files.robot_file import RobotFile, StatedJoint, StatedTransform, stated_rows
from ....model.files.run import Run
from ....model.kinematics.dh import DHRow, RowTable
from ....model.kinematics.orientation import angles_of
from ....model.parsing.reading import shown
from ..calibration import RobotCalibration
from ..maker import one_line


def beyond_rows(rows: Sequence[DHRow]) -> list[int]:
    """The joints (from 1) whose rows have a beta, which a table of four columns cannot hold."""
    return [number for number, row in enumerate(rows, start=1) if row.beta != 0]


def robot_text(run: Run, calibration: RobotCalibration) -> str:
    """The text of the file; BadInput where the run's robot has no rows, as it comes from a URDF file."""
    ref = run.header.robot
    if isinstance(ref, UrdfRef):
        raise BadInput(
            "the run's robot comes from a URDF file, which has no Denavit-Hartenberg rows to correct",
            found=f"robot: {shown(ref.urdf)}",
            allowed="robot: the name of a built-in robot, or the path of a robot file",
            remedy="zerobeam export urdf: a URDF file can hold any link",
            file=run.path,
            line=run.header_line,
        )
    file = stated_rows(ref, run.path.parent)
    table = file.table_of(calibration.corrected)
    return rows_text([*calibration.head, *_on_rows(table.rows)], file, table)


def rows_text(head: Sequence[str], file: RobotFile, table: RowTable) -> str:
    """A robot file with the rows of `table`, all else as `stated`; `head` are the lines of comment above."""
    return "\n".join(
        [
            *(f"# {line}" for line in head),
            "schema: zerobeam/robot/1",
            f"name: {_quoted(file.name)}",
            *([f"vendor: {file.vendor}"] if file.vendor else []),
            *([f"model: {_quoted(file.model)}"] if file.model else []),
            f"convention: {file.convention}",
            "joints:",
            *(f"  - {_joint(joint, row)}" for joint, row in zip(file.joints, table.rows, strict=True)),
            *_transform("base", file.base),
            *_transform("flange", _as_transform(table.flange, file.flange)),
            *_conventions(file),
            "",
        ]
    )


def _on_rows(rows: tuple[DHRow, ...]) -> list[str]:
    lines = [
        "The offsets are in these rows: recorded positions give true poses. Limits are those of recorded"
    ]
    lines.append("    positions, as before. Tool and targets are not in here.")
    beyond = beyond_rows(rows)
    if beyond:
        joints = ", ".join(f"J{number}" for number in beyond)
        lines += [
            f"{joints}: beta_deg is a rotation about y behind alpha (Hayati), as the next axis is nearly",
            "    parallel or the last. A table of a, alpha, d and theta alone cannot hold it: for programs",
            "    without it use zerobeam export urdf.",
        ]
    return [one_line(line) for line in lines]


def _joint(joint: StatedJoint, row: DHRow) -> str:
    """A row in one line: the corrected numbers in place of the stated ones, all else as it was."""
    angles = np.degrees([row.alpha, row.theta, row.beta]).tolist()
    numbers = {
        "a_mm": row.a,
        "alpha_deg": angles[0],
        "d_mm": row.d,
        "theta_deg": angles[1],
        "beta_deg": angles[2],
    }
    if row == joint.row:
        numbers = {key: getattr(joint, key) for key in numbers}
    if not numbers["beta_deg"]:
        del numbers["beta_deg"]
    rest = joint.model_dump(exclude_unset=True, exclude={*numbers, "beta_deg"})
    parts = [f"{key}: {_quoted(value)}" for key, value in {**numbers, **rest}.items()]
    return "{" + ", ".join(parts) + "}"


def _quoted(value: object) -> str:
    """As YAML has it too: names are printable, of whatever script."""
    return json.dumps(value, ensure_ascii=False)


def _as_transform(transform: Matrix, before: StatedTransform) -> StatedTransform:
    if np.allclose(transform, before.matrix(), rtol=0, atol=1e-13):
        return before
    x, y, z = transform[:3, 3].tolist()
    roll, pitch, yaw = np.degrees(angles_of(transform[:3, :3])).tolist()
    return StatedTransform(xyz_mm=(x, y, z), rpy_deg=(roll, pitch, yaw))


def _conventions(file: RobotFile) -> list[str]:
    """Lines on the mounting and the counting of joints, as the file states them."""
    keys = ("mounting", "pendant", "limits", "encoder")
    content = file.model_dump(mode="json", include=set(keys), exclude_unset=True, exclude_none=True)
    return [f"{key}: {_quoted(content[key])}" for key in keys if content.get(key)]


def _transform(key: str, transform: StatedTransform) -> list[str]:
    if transform == StatedTransform():
        return []
    numbers = f"xyz_mm: {json.dumps(list(transform.xyz_mm))}, rpy_deg: {json.dumps(list(transform.rpy_deg))}"
    return [f"{key}: {{{numbers}}}"]
