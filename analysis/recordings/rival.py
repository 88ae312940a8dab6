"""A rival explanation of the residuals: links that deviate from the nominal geometry within a tolerance.

Of an arm whose geometry is taken as nominal, residuals that a moved target, a step or a correlation would
explain may as well come from links 0.3 mm longer or 0.1° twisted. The link before each joint but the first is
let shift and rotate in all directions (the first link is the base, the last the tool).
"""

from __future__ import annotations

import numpy as np

from ...model.problem import Problem, Whitened
from ...model.robot import Matrix

LENGTH_MM = 0.3
ANGLE = float(np.radians(0.1))


def link_tolerances(
    problem: Problem, x: Matrix, whitened: Whitened, length_mm: float = LENGTH_MM, angle: float = ANGLE
) -> Matrix | None:
    """(M, 5 or 6 columns for each of n - 1 links) whitened residuals by link errors of one prior std: shifts
    (mm) along and rotations (rad) about the axes of the next joint's frame before its motion, but for the
    rotation about a revolute joint's own axis, which is its offset.

    None where the geometry is fitted (parameters of the group `geometry` that are not held): there it is no
    rival. A motion of all that follows the link is that of the target the other way round.
    """
    items = problem.parameters.items
    if any(str(item.group) == "geometry" and not item.held for item in items):
        return None
    by_target = by_targets(problem, whitened)
    parts = problem.split(x)
    target = parts.targets[problem.target_index]
    positions = problem.joints + x[problem.parameters.block("offset")]
    rotation, origin = np.tile(np.eye(3), (problem.shots, 1, 1)), np.zeros((problem.shots, 3))
    columns = []
    for i, joint in enumerate(problem.robot.joints):
        origin = origin + rotation @ joint.fixed[:3, 3]
        rotation = rotation @ joint.fixed[:3, :3]
        if i > 0:
            shifts = rotation * length_mm
            arm = (target - origin)[:, :, None]
            turns = np.cross(rotation, arm, axis=1) * angle
            if joint.kind == "revolute":
                # Two directions across the axis.
                across = np.linalg.svd(joint.axis[None])[2][1:].T
                turns = turns @ across
            columns.append(-by_target @ np.concatenate([shifts, turns], axis=2))
        if joint.kind == "revolute":
            rotation = rotation @ _turned(joint.axis, positions[:, i])
        else:
            origin = origin + rotation @ joint.axis * positions[:, i, None]
    count = problem.shots * problem.tool.miss_size
    rows = np.concatenate(columns, axis=2).reshape(count, -1) if columns else np.zeros((count, 0))
    if not rows.shape[1]:
        return None
    return np.vstack([rows, np.zeros((len(whitened.residual) - count, rows.shape[1]))])


def by_targets(problem: Problem, whitened: Whitened) -> Matrix:
    """(N, d, 3) of the whitened residuals by their targets' coordinates in mm, held or not."""
    parameters, d = problem.parameters, problem.tool.miss_size
    own = problem.columns[:, parameters.in_shot("target")]
    jacobian = whitened.jacobian[: problem.shots * d].reshape(problem.shots, d, -1)
    by_scaled = np.take_along_axis(jacobian, np.repeat(own[:, None, :], d, axis=1), axis=2)
    return np.asarray(by_scaled / parameters.prior_std[own][:, None, :])


def _turned(axis: Matrix, angles: Matrix) -> Matrix:
    """(N, 3, 3) rotations about a unit axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, cosine = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + (1 - cosine) * (cross @ cross))
