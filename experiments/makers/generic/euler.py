"""Orientations of tables: rotations of a stated order of Euler angles, or the order by which the flange's
rotations fit; and whether poses fit as they are stated."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.instruments.pose import OtherPose, put_right
from ....model.instruments.rotations import nearest_rotation

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
