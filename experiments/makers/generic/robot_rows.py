"""The rows of a robot file for a chain whose links have moved: exact, whatever they are.

Between two axes there are six numbers, and a row has four or, with Hayati's beta, five of them. The rest is a
motion about and along the next axis. It commutes with the joint, so that the next row takes it up, and behind
the last row the transform to the flange:

    axes that cross or skew    Rz(theta) Tz(d) Tx(a) Rx(alpha)           Rz(c) Tz(e)
    axes nearly parallel       Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)  Rz(c)
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace

import numpy as np

from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.files.header import UrdfRef
from ....model.files.robot_file import RobotFile, StatedJoint, StatedTransform, stated_rows
from ....model.files.run import Run
from ....model.kinematics.orientation import angles_of
from ....model.kinematics.robot import DHRow, Robot, rotation_about, shift
from ....model.parsing.reading import shown
from ..calibration import RobotCalibration
from ..maker import one_line

_NEARLY_PARALLEL = float(np.sin(np.radians(5.0)))  # as of the geometry's parameters
_NO_LENGTH = 1e-10  # mm: has no direction
_ROUNDING = 1e-12  # mm or rad


@dataclass(frozen=True, eq=False)
class RowTable:
    """Rows, joint 1 first, and the transform (4, 4) from the last row to the flange. The base stays."""

    rows: tuple[DHRow, ...]
    flange: Matrix


def corrected_table(file: RobotFile, corrected: Robot) -> RowTable:
    """The rows of `corrected`: the robot of the file `stated` with other links, and with offsets."""
    nominal = [joint.row for joint in file.joints]
    theirs = file.robot()
    standard = file.convention == "standard"
    chain = [*(joint.fixed for joint in corrected.joints[1:]), corrected.flange]
    rows = list(nominal)
    rest: Matrix = np.asarray(np.linalg.inv(theirs.joints[0].fixed) @ corrected.joints[0].fixed)
    flange: Matrix = np.eye(4)
    for i, transform in enumerate(chain):
        whole = rest @ transform
        last = i + 1 == len(chain)
        if last and not standard:
            about = float(np.arctan2(rest[1, 0], rest[0, 0]))
            rows[i] = replace(rows[i], theta=nominal[i].theta + about, d=nominal[i].d + float(rest[2, 3]))
            flange = np.asarray(np.linalg.inv(_turned(rows[i])) @ whole)
            break
        of_link = i if standard else i + 1
        near = replace(nominal[of_link], theta=nominal[i].theta, d=nominal[i].d)
        if last:
            whole = whole @ np.linalg.inv(file.flange.matrix())
        near_row = _row_of(whole, near, last=last)
        rows[i] = replace(rows[i], theta=near_row.theta, d=near_row.d)
        rows[of_link] = replace(rows[of_link], a=near_row.a, alpha=near_row.alpha, beta=near_row.beta)
        rest = np.asarray(np.linalg.inv(_turned(near_row) @ _linked(near_row)) @ whole)
        if last:
            flange = rest @ file.flange.matrix()
    return RowTable(
        tuple(_clean(row, nominal_row) for row, nominal_row in zip(rows, nominal, strict=True)), flange
    )


def beyond_rows(rows: Sequence[DHRow]) -> list[int]:
    """The joints (from 1) whose rows have a beta, which a table of four columns cannot hold."""
    return [number for number, row in enumerate(rows, start=1) if row.beta != 0]


def _turned(row: DHRow) -> Matrix:
    return rotation_about("z", row.theta) @ shift(z=row.d)


def _linked(row: DHRow) -> Matrix:
    return shift(x=row.a) @ rotation_about("x", row.alpha) @ rotation_about("y", row.beta)


def _row_of(whole: Matrix, near: DHRow, *, last: bool) -> DHRow:
    """The row of a transform (4, 4), up to a motion about and along its z axis; the one next to `near`.

    Of the `last` row up to any motion, which the transform to the flange takes up.
    """
    sine = float(np.hypot(whole[0, 2], whole[1, 2]))
    if near.beta == 0 and sine >= _NEARLY_PARALLEL:
        return _of_normal(whole, near)
    return _of_origins(whole, near, turned=last)


def _of_normal(whole: Matrix, near: DHRow) -> DHRow:
    """Along the common normal of both z axes."""
    along, origin = whole[:3, 2], whole[:3, 3]
    theta = _nearest(float(np.arctan2(along[0], -along[1])), near.theta, np.pi)
    x, y = _axes(theta)
    foot = origin - along * float((origin @ y) / (along @ y))
    alpha = _nearest(float(np.arctan2(-along @ y, along[2])), near.alpha)
    return DHRow(float(foot @ x), alpha, float(foot[2]), theta)


def _of_origins(whole: Matrix, near: DHRow, *, turned: bool) -> DHRow:
    """From one origin to the other, with beta; if `turned`, theta suits the rotation and not the place."""
    origin, turn = whole[:3, 3], whole[:3, :3]
    if float(np.hypot(origin[0], origin[1])) > _NO_LENGTH and not turned:
        theta = _nearest(float(np.arctan2(origin[1], origin[0])), near.theta, np.pi)
    else:
        side = 1.0 if np.cos(near.alpha) >= 0 else -1.0
        theta = _nearest(float(np.arctan2(-side * turn[0, 1], side * turn[1, 1])), near.theta)
    x, y = _axes(theta)
    along = whole[:3, 2]
    side = 1.0 if np.cos(near.beta) >= 0 else -1.0
    alpha = _nearest(float(np.arctan2(-side * (along @ y), side * along[2])), near.alpha)
    level = float(np.hypot(along @ y, along[2]))
    beta = _nearest(float(np.arctan2(along @ x, side * level)), near.beta)
    return DHRow(float(origin @ x), alpha, float(origin[2]), theta, beta)


def _axes(theta: float) -> tuple[Matrix, Matrix]:
    turn = rotation_about("z", theta)
    return turn[:3, 0], turn[:3, 1]


def _nearest(angle: float, near: float, period: float = 2 * np.pi) -> float:
    """The angle and all that are `period` apart from it: the one next to `near`."""
    return angle + period * round((near - angle) / period)


def _clean(row: DHRow, nominal: DHRow) -> DHRow:
    """A row whose numbers are exactly nominal where they differ by rounding only."""
    values = zip(astuple(row), astuple(nominal), strict=True)
    return DHRow(*(old if abs(new - old) <= _ROUNDING * max(1.0, abs(old)) else new for new, old in values))


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
    table = corrected_table(file, calibration.corrected)
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
