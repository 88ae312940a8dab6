"""Runs from tables of points and poses that trackers and coordinate measuring machines measured, in whatever
order of angles.

Units, the level of an uncertainty and the order of Euler angles are stated, never guessed.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ....model.arrays import Index, Matrix
from ....model.errors import BadInput
from ....model.files.joint_values import JointColumns
from ....model.files.text_tables import (
    DELIMITERS,
    TextTable,
    bare_name,
    read_remarked_table,
    unit_of_name,
)
from ....model.instruments.frames import nearest_rotation
from ....model.instruments.pose import OtherPose, put_right
from ....model.kinematics.orientation import orientation
from ..import_jobs import FileMeasurements, Imported, ImportJob, Keys
from .layouts import PointLayout

VECTOR = "vector"  # an orientation by a rotation vector, in place of an order
_PLAIN = ["".join(axes) for axes in itertools.permutations("XYZ")]
_SAME_TWICE = [f"{a}{b}{a}" for a in "XYZ" for b in "XYZ" if a != b]
ORDERS = [f"{axes}-{way}" for axes in (*_PLAIN, *_SAME_TWICE) for way in ("fixed", "moving")]
_LARGEST_DEG = 2.0  # of a nominal arm from its measured orientations
_AGREEING = 0.3  # of pairs of poses, at least, turn by the same angle
_STEPS = (1, 2, 3, 5, 7)  # how far apart the poses of a pair are
_CLEARLY = 20.0  # log likelihood ratio to the next order, a component of each pose (Laplace)
_LEAST = 5  # poses
_ACROSS_MM = 500.0  # an arm: a degree there is as wrong as a rotation by one


def rotations(angles: Matrix, order: str) -> Matrix:
    """(N, 3, 3) of angles (N, 3), rad, about the axes of an order such as XYZ-fixed or ZYX-moving; of
    rotation vectors (axis times angle) where the order is `vector`.

    The first angle is about the first axis, and is the first rotation; fixed axes stay, moving ones turn with
    the body. BadInput for an order that there is not.
    """
    if order.lower() == VECTOR:
        return np.asarray(Rotation.from_rotvec(angles).as_matrix())
    match = re.fullmatch(r"([xyz]{3})-(fixed|moving)", order, re.IGNORECASE)
    if match is None or f"{match[1].upper()}-{match[2].lower()}" not in ORDERS:
        raise BadInput(
            "there is no such order of Euler angles",
            found=order,
            allowed="XYZ-fixed, ZYX-moving, ZYZ-moving, …, vector (a rotation vector) or find",
            remedy="state the axes in the order of the columns, and whether they stay or turn with the body",
        )
    axes = match[1].upper() if match[2].lower() == "moving" else match[1].lower()
    return np.asarray(Rotation.from_euler(axes, angles).as_matrix())


def found_order(
    angles: Matrix, columns: Sequence[str], flange: Matrix, *, inverse: bool = False
) -> tuple[Matrix, str]:
    """The rotations (N, 3, 3) of angles (N, 3), rad, by the order by which they are those of something on the
    flange, whose rotations (N, 3, 3) are nominal, as seen from anywhere; and a sentence on the order.

    The columns are angles about x, y and z; tried are all orders of these rotations, and rotation vectors.
    Another naming of the axes would be a change of frames, which are not known. `inverse`: the inverse of
    each rotation is what fits. BadInput where no order fits, or where another one fits nearly as well.
    """
    if len(angles) < _LEAST:
        raise BadInput(
            "too few poses to find the order of the angles",
            found=f"{len(angles)} poses",
            allowed=f"{_LEAST} or more",
            remedy="state the order, such as --euler XYZ-fixed",
        )
    tried = {f"{VECTOR} of {', '.join(columns)}": rotations(angles, VECTOR)}
    for axes in _PLAIN:
        at = ["XYZ".index(axis) for axis in axes]
        # The same rotations backwards about axes that move are named by the columns as they are.
        name = "XYZ-moving" if axes == "ZYX" else f"{axes}-fixed"
        named = columns if axes == "ZYX" else [columns[i] for i in at]
        tried[f"{name} of {', '.join(named)}"] = rotations(angles[:, at], f"{axes}-fixed")
    misfits = {
        name: _aligned(turned.transpose(0, 2, 1) if inverse else turned, flange)[0]
        for name, turned in tried.items()
    }
    name, other = sorted(misfits, key=misfits.__getitem__)[:2]
    best, next_best = misfits[name], misfits[other]
    fits = f"{name} to {best:.3g}° (median); the next is {other} to {next_best:.3g}°"
    if best > _LARGEST_DEG or not _clearly(best, next_best, len(angles)):
        raise BadInput(
            "no order of the angles fits the nominal arm"
            if best > _LARGEST_DEG
            else "several orders of the angles fit",
            found=fits,
            allowed=f"one order within {_LARGEST_DEG:g}°, and the next clearly worse in so many poses",
            remedy="state the order, or check which joints belong to which pose",
        )
    return tried[name], f"the order that fits: {fits}"


def _clearly(best: float, other: float, poses: int) -> bool:
    """Whether one misfit is clearly below another one, by so many poses."""
    return bool(poses * np.log(other / max(best, 1e-6)) > _CLEARLY)


def require_as_stated(as_read: Matrix, flange: Matrix, columns: Sequence[str] | None) -> None:
    """BadInput where poses (N, 7), mm and quaternion, fit the nominal poses (N, 4, 4) of the flange no better
    as they are stated than in another way: inverted, or (of quaternion `columns`) with w last.

    Where nothing fits, nothing is said here: the joints may be wrong.
    """
    if len(as_read) < _LEAST:
        return
    # By how it fits: what is wrong of the readings, and how that is stated.
    ways: dict[str, tuple[OtherPose, str]] = {
        "as inverse rotations": ("inverse", "--inverse rotation"),
        "as inverse poses": ("inverse_pose", "--inverse pose"),
    }
    if columns is not None:
        ways["with w last"] = ("quaternion", f"--quaternion-columns {','.join((columns[3], *columns[:3]))}")
    as_stated = _misfit_of_poses(as_read, flange)
    scores = {name: _misfit_of_poses(put_right(as_read, wrong), flange) for name, (wrong, _) in ways.items()}
    other = min(scores, key=scores.__getitem__)
    if scores[other] > _LARGEST_DEG or _clearly(as_stated, scores[other], len(as_read)):
        return
    both = as_stated <= _LARGEST_DEG
    raise BadInput(
        f"the poses fit the nominal arm {'both as stated and ' if both else ''}{other}"
        + ("" if both else ", and not as stated"),
        found=f"as stated to {as_stated:.3g}° (median), {other} to {scores[other]:.3g}°",
        remedy=f"state {ways[other][1]}" + ("; or --inverse none, where they are as stated" if both else ""),
    )


def _misfit_of_poses(poses: Matrix, flange: Matrix) -> float:
    """Degrees: how far poses (N, 7) are from the nominal poses (N, 4, 4) of the flange, by their rotations
    and by their positions as seen across half a metre, whichever is more."""
    measured = Rotation.from_quat(poses[:, 3:7], scalar_first=True).as_matrix()
    misfit, world = _aligned(measured, flange[:, :3, :3])
    if misfit > _LARGEST_DEG:
        return misfit
    # world' p - o = F x - t, of which x and t are sought.
    right = poses[:, :3] @ world - flange[:, :3, 3]
    columns = np.hstack([flange[:, :3, :3].reshape(-1, 3), np.tile(np.eye(3), (len(poses), 1))])
    left = right.ravel() - columns @ np.linalg.lstsq(columns, right.ravel(), rcond=1e-3)[0]
    off = float(np.median(np.linalg.norm(left.reshape(-1, 3), axis=1)))
    return max(misfit, float(np.degrees(off / _ACROSS_MM)))


def _aligned(measured: Matrix, flange: Matrix) -> tuple[float, Matrix]:
    """Degrees, median: how far M_i is from A F_i B, with the rotations A and B that fit best; and A.

    B aligns the relative rotations of poses, B^T (F_i^T F_j) B = M_i^T M_j, by their axes (as in hand-eye
    calibration; Park and Martin 1994). Only pairs whose angles agree count, so that wrong rows do not; A is
    then the mean of those M_i B^T F_i^T that are near most others.
    """
    m, f = (
        np.concatenate([np.swapaxes(r[:-step], 1, 2) @ r[step:] for step in _STEPS if step < len(r)])
        for r in (measured, flange)
    )
    agreeing = np.abs(_angles(m) - _angles(f)) < _LARGEST_DEG
    if agreeing.sum() < max(3, _AGREEING * len(agreeing)):
        return 180.0, np.eye(3)
    mount = nearest_rotation(_axes(f[agreeing]).T @ _axes(m[agreeing]))
    worlds = measured @ np.swapaxes(flange @ mount, 1, 2)
    tried = worlds[:: max(1, len(worlds) // 50)]
    off = np.array([_angles(world.T @ worlds) for world in tried])
    nearest = off[int(np.argmin(np.median(off, axis=1)))]
    world = nearest_rotation(worlds[nearest <= np.median(nearest)].sum(axis=0))
    return float(np.median(_angles(world.T @ worlds))), world


def _angles(r: Matrix) -> Matrix:
    """(N,) degrees, of rotations (N, 3, 3)."""
    return np.asarray(np.degrees(Rotation.from_matrix(r).magnitude()))


def _axes(r: Matrix) -> Matrix:
    """(N, 3) axis times sine of the angle: what is aligned, and 0 where the axis is not clear."""
    return np.stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], axis=1) / 2.0


MILLIMETRES: dict[str, float] = {"mm": 1.0, "m": 1000.0, "inch": 25.4}
SIGMAS: dict[str, float] = {"1sigma": 1.0, "95": 1.959964}  # of a normal distribution, two-sided

_WORDS = {
    **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetre", "millimetres"), "mm"),
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), "m"),
    **dict.fromkeys(("in", "inch", "inches"), "inch"),
}
_UNIT = re.compile(r"\bunits?\b\s*[:=,]?\s*([a-z]+)", re.IGNORECASE)
_MARKER = re.compile(r"([xyz])[ _.-]?(\d{1,3})|[a-z]{0,8}(\d{1,3})[ _.-]([xyz])", re.IGNORECASE)
_UNSEEN = ("", "nan", "-", "null", "none")
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
    columns = JointColumns.of_options(
        job.robot, layout.joint_columns, layout.joint_units, lengths=layout.lengths, j3=layout.j3
    )

    def read(path: Path, target: str | None) -> FileMeasurements:
        table, head = read_remarked_table(path, layout.delimiter, layout.decimal)
        points, visible, unit, notes = _points(table, head, layout)
        beside = table
        if layout.joints is not None:
            beside, _ = read_remarked_table(layout.joints, None, layout.decimal)
        joints = columns.read(beside)
        rows, matched = _matched(table, beside, layout)
        quaternions: Matrix | None = None
        oriented: list[str] = []
        if layout.quaternion_columns is not None or layout.rotation_columns is not None:
            points, quaternions, oriented = _poses(table, job, points, joints[rows], layout)
        sigmas, how = _sigmas(table, unit, layout)
        # Of each measurement the row of the table, the row of joints, and which of the markers it is.
        at, marker = np.divmod(visible, len(layout.markers))
        rows = rows[at]
        if layout.reflector_column is not None:
            texts = table.texts(table.column(layout.reflector_column))
            reflectors = [texts[i] for i in at.tolist()]
        else:
            reflectors = [layout.markers[i] for i in marker.tolist()]
        shared = np.bincount(rows, minlength=len(joints))[rows] > 1
        times = None
        if layout.time_column is not None and layout.time_units is not None:
            clock = table.seconds(layout.time_column, layout.time_units)
            times = (clock - clock[0])[at]
        keys: Keys = {
            "target": [*job.names] * len(at) or None,
            "measured_mm": points,
            "measured_quat": quaternions,
            "sigma_mm": None if sigmas is None else sigmas[at],
            "instrument": None if layout.instrument is None else [layout.instrument] * len(at),
            "reflector": [name or None for name in reflectors] if any(reflectors) else None,
            "posture": [row if again else None for row, again in zip(rows.tolist(), shared, strict=True)],
            "time_s": times,
        }
        notes += [
            *oriented,
            *how,
            *matched,
            f"  delimiter: {DELIMITERS.get(table.delimiter, table.delimiter)}",
        ]
        return FileMeasurements(path, "row", joints[rows], keys, [table.lines[i] for i in at.tolist()], notes)

    in_degrees = layout.joint_units == "deg" and not layout.small_angles
    remedy = "state --joint-units rad; or --small-angles, if they are in degrees"
    return job.measured(read, columns.sentences(), named=False, in_radians=remedy if in_degrees else None)


def _points(
    table: TextTable, head: Sequence[str], layout: PointLayout
) -> tuple[Matrix, Index, str, list[str]]:
    """(N, 3) mm, which of all markers of all rows each is, the unit that they have in the table, and how they
    were understood."""
    names = layout.columns or _columns_of_markers(table, layout)
    columns = [table.column(name) for name in names]
    in_file = {
        _WORDS[word.lower()] for line in head for word in _UNIT.findall(line) if word.lower() in _WORDS
    }
    if table.names is not None:
        in_file |= {unit for i in columns if (unit := unit_of_name(table.names[i])) is not None}
    units = {*in_file, *([] if layout.units is None else [layout.units])}
    if len(units) != 1 or not units <= MILLIMETRES.keys():
        one = "the unit of the coordinates is not stated" if not units else "there is no such unit"
        raise BadInput(
            one if len(units) < 2 else "the units contradict each other",
            found=", ".join(sorted(units)) or "no unit in the file",
            allowed="--units mm, m or inch",
            remedy="state the unit in which the table was written",
            file=table.path,
        )
    (unit,) = units
    where = "as the file says" if in_file else "as stated"
    notes = [f"  points: columns {', '.join(names)} in {unit}, {where}"]
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
        if match := _MARKER.fullmatch(bare_name(name)):
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
    matching = [name for name in table.names or () if bare_name(name).lower() == axis]
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


def _matched(points: TextTable, joints: TextTable, layout: PointLayout) -> tuple[Index, list[str]]:
    """(N,) the row of joints of each point, and how it was found."""
    if joints is points:
        return np.arange(len(points.rows)), []
    if layout.match == "time":
        rows, how = _by_time(points, joints, layout)
    elif layout.number_column is not None and layout.joints_number_column is not None:
        rows, how = _by_number(points, joints, layout.number_column, layout.joints_number_column)
    elif len(points.rows) == len(joints.rows):
        rows, how = np.arange(len(points.rows)), "row by row, in the order of both files"
    else:
        raise BadInput(
            "there are not as many points as joints",
            found=f"{len(points.rows)} points, {len(joints.rows)} rows of joints",
            allowed="equally many rows, or numbers in both tables",
            remedy="state --number-column and --joints-number-column, or --match time",
            file=joints.path,
        )
    understood = [f"  joints of {joints.path} matched {how}"]
    if idle := len(joints.rows) - len(np.unique(rows)):
        understood.append(f"  {idle} of {len(joints.rows)} rows of joints have no point")
    return rows, understood


def _by_number(points: TextTable, joints: TextTable, column: str, of_joints: str) -> tuple[Index, str]:
    row_of: dict[int, int] = {}
    for i, value in enumerate(joints.whole_numbers(of_joints, at_end=True)):
        if row_of.setdefault(value, i) != i:
            raise BadInput(
                "two rows of joints have the same number",
                found=f"{value}, first on line {joints.lines[row_of[value]]}",
                file=joints.path,
                line=joints.lines[i],
            )
    numbers = points.whole_numbers(column, at_end=True)
    for line, value in zip(points.lines, numbers, strict=True):
        if value not in row_of:
            raise BadInput(
                "a point has a number that no joints have",
                found=value,
                allowed=f"{min(row_of)} to {max(row_of)}, as in {joints.path.name}",
                remedy="remove the point, or correct the numbers",
                file=points.path,
                line=line,
            )
    return np.array([row_of[value] for value in numbers]), "by their numbers"


def _by_time(points: TextTable, joints: TextTable, layout: PointLayout) -> tuple[Index, str]:
    assert layout.time_column
    assert layout.time_units
    assert layout.joints_time_column
    assert layout.within_s
    at = points.seconds(layout.time_column, layout.time_units)
    clock = joints.seconds(layout.joints_time_column, layout.joints_time_units or layout.time_units)
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
    return order[nearest], f"by time, {off[far]:.3g} s apart at most"


def _poses(
    table: TextTable, job: ImportJob, points: Matrix, joints: Matrix, layout: PointLayout
) -> tuple[Matrix, Matrix, list[str]]:
    """(N, 3) mm and (N, 4) [w, x, y, z] of each pose, and how the orientation was understood."""
    flange = job.robot.fk(joints, "deg")
    quaternions, sentence = _quaternions(table, flange, layout)
    as_read = np.hstack([points, quaternions])
    if layout.inverse in ("rotation", "pose"):
        as_read = put_right(as_read, "inverse_pose" if layout.inverse == "pose" else "inverse")
        what = "rotations inverted" if layout.inverse == "rotation" else "poses inverted, positions with them"
        sentence += f"; {what}, as stated"
    elif layout.inverse is None and layout.euler != "find":
        require_as_stated(as_read, flange, layout.quaternion_columns)
    return as_read[:, :3], as_read[:, 3:7], [f"  {sentence}"]


def _quaternions(table: TextTable, flange: Matrix, layout: PointLayout) -> tuple[Matrix, str]:
    """(N, 4) [w, x, y, z] of each pose at the poses (N, 4, 4) of the flange, and how the orientation was
    understood."""
    if layout.quaternion_columns is not None:
        names = ", ".join(layout.quaternion_columns)
        return table.columns(
            layout.quaternion_columns
        ), f"orientation: quaternion w, x, y, z of columns {names}"
    assert layout.rotation_columns is not None
    assert layout.euler is not None
    angles = table.columns(layout.rotation_columns)
    if layout.rotation_units == "deg":
        angles = np.radians(angles)
    elif np.abs(angles).max() > 4 * math.pi:
        raise BadInput(
            "the angles of the orientation look like degrees, but radians are stated",
            found=f"up to {np.abs(angles).max():.4g}",
            remedy="state --rotation-units deg",
        )
    order = layout.euler
    if order == "find":
        inverse = layout.inverse in ("rotation", "pose")
        turned, order = found_order(angles, layout.rotation_columns, flange[:, :3, :3], inverse=inverse)
    else:
        turned = rotations(angles, order)
    sentence = (
        f"orientation: columns {', '.join(layout.rotation_columns)} in {layout.rotation_units}, {order}"
    )
    return np.array([orientation(rotation).quaternion for rotation in turned]), sentence


def _sigmas(table: TextTable, unit: str, layout: PointLayout) -> tuple[Matrix | None, list[str]]:
    """(N,) sigma_mm of each point, None where none is to be taken, and how it was understood."""
    names = layout.uncertainty_columns
    if names is None:
        found_names = ((_UNCERTAINTY.search(name), name) for name in table.names or ())
        by_axis = {match[1].lower(): name for match, name in found_names if match is not None}
        names = [by_axis[axis] for axis in "xyz"] if len(by_axis) == 3 else None
    if names is None:
        if layout.uncertainty in SIGMAS:
            raise BadInput(
                "the level of an uncertainty is stated, but not its columns",
                found=f"--uncertainty {layout.uncertainty}",
                remedy="state --uncertainty-columns ux,uy,uz, or leave it out",
                file=table.path,
            )
        return None, []
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
        return None, [f"  uncertainty: columns {', '.join(names)} are not used"]
    values = table.columns(names)
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
    return sigma, [f"  sigma_mm: root mean square of {', '.join(names)}, {divided}"]
