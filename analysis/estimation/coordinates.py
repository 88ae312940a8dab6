"""Coordinates in which the posterior is nearly normal: each target as seen from the flange of its first shot.

In the base frame a poorly known offset drags the target along an arc, and the posterior is a thin
banana. Seen from the flange of a shot that hit it, the target stays where it is, so that a rotation of
everything after a joint, the target included, is a straight line along one offset. The change is a
rigid motion for given offsets: no volume factor enters.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ...model.arrays import Index, Matrix
from ...model.c_source import GridInput, per_both, per_inner
from ...model.likelihood.density import Density, together


class MappedPoint(NamedTuple):
    """Parameter vectors x (W, p), and `jacobian` (W, f, f) of the scaled free parameters z by v."""

    x: Matrix
    jacobian: Matrix

    def gradient(self, by_z: Matrix) -> Matrix:
        """(W, f) by v of what has the gradient (W, f) by z."""
        return np.asarray((by_z[:, None] @ self.jacobian)[:, 0])

    def information(self, by_z: Matrix) -> Matrix:
        """(W, f, f) by v of an information (W, f, f) by z."""
        return np.asarray(self.jacobian.transpose(0, 2, 1) @ by_z @ self.jacobian)


class FlangeCoordinates:
    """v (f,): free parameters over their prior stds; targets in the flange frame of their first shot.

    Rows are those of the density: `of` (W,) names the data set of each.
    """

    def __init__(self, density: Density) -> None:
        problem = density.problem
        self._problem = problem
        parameters = problem.parameters
        count = len(problem.targets) - problem.stations
        self._free = parameters.free
        places = np.arange(len(parameters))[parameters.block("target")].reshape(count, 3)
        # A target of which a coordinate is held stays in the base frame: seen from the flange it would move.
        # So does a plane: its coordinates are no point's.
        points = np.array([item.unit == "mm" for item in parameters.items])
        moved = np.flatnonzero((self._free & points)[places].all(axis=1))
        self._targets = moved
        self._places = places[moved]
        # The change of frame is rigid only if the three coordinates share one scale.
        self._scale = parameters.prior_std[self._places].mean(axis=1)
        first = np.array([np.argmax(problem.target_index == k) for k in moved], dtype=int)
        self._joints = density.joints[:, first]
        # A product with one nonzero a column is exact, and dearer indexing is spared.
        self._to_x = (np.eye(len(parameters)) * parameters.prior_std)[self._free]
        own_scale = np.repeat(self._scale, 3)
        self._to_in_flange = np.eye(len(parameters))[self._free][:, self._places.reshape(-1)] * own_scale
        every = len(moved) == count
        self._where = parameters.block("target") if every else self._places.reshape(-1)
        at_v = parameters.among_free
        turning = np.flatnonzero(self._free[parameters.arm])  # the arm is at the start of x
        target_scales = np.broadcast_to(self._scale[:, None], (len(moved), 3))
        by_scale = np.hstack([np.tile(parameters.prior_std[turning], (len(moved), 1)), target_scales])
        self._by_scale = by_scale[:, None, :] / parameters.prior_std[self._places][:, :, None]
        self._columns = np.append(turning, parameters.arm.stop + np.arange(3))  # of `placed`
        self._moving = together(self._columns)
        # Where z of each moved target is by the v that move it, in (f * f,).
        self._size = int(self._free.sum())
        self._moves = np.array(
            [np.append(at_v[turning], at_v[columns]) for columns in self._places], dtype=int
        )
        rows = at_v[self._places]
        where = rows[:, :, None] * self._size + self._moves.reshape(len(moved), 1, -1 if len(moved) else 0)
        self._where_by = where.reshape(-1)

    def from_parameters(self, x: Matrix, of: Index | None = None) -> Matrix:
        """v (W, f) of parameter vectors x (W, p)."""
        parameters = self._problem.parameters
        z = (x - parameters.prior_mean) / parameters.prior_std
        if len(self._targets):
            parts = self._problem.split(x)
            (in_flange,) = self._each("seen", of, parts.arm, parts.targets[:, self._targets])
            z[:, self._places] = in_flange.reshape(len(x), -1, 3) / self._scale[:, None]
        return z[:, self._free]

    def to_parameters(self, v: Matrix, of: Index | None = None) -> Matrix:
        """x (W, p) of coordinates v (W, f); what is held stays at its prior mean."""
        x, in_flange = self._spread_out(v)
        if len(self._targets):
            (placed,) = self._each("place", of, self._problem.split(x).arm, in_flange)
            x[:, self._where] = placed.reshape(len(v), 3 * len(self._targets))
        return x

    def at(self, v: Matrix, of: Index | None = None) -> MappedPoint:
        """x (W, p) of coordinates v (W, f), and how it moves with v."""
        x, in_flange = self._spread_out(v)
        jacobian = np.zeros((len(v), self._size * self._size))
        jacobian[:, :: self._size + 1] = 1.0
        if len(self._targets):
            placed, by = self._each("placed", of, self._problem.split(x).arm, in_flange)
            x[:, self._where] = placed.reshape(len(v), 3 * len(self._targets))
            by = by.reshape(len(v), len(self._targets), 3, by.shape[-1])
            jacobian[:, self._where_by] = (by[..., self._moving] * self._by_scale).reshape(
                len(v), len(self._where_by)
            )
        return MappedPoint(x, jacobian.reshape(len(v), self._size, self._size))

    def jacobian(self, x: Matrix, of: Index | None = None) -> Matrix:
        """(W, f, f) of the scaled free parameters z by v, at x (W, p)."""
        return self.at(self.from_parameters(x, of), of).jacobian

    def moved(self, target: int) -> tuple[GridInput, Index, Index, Matrix, float] | None:
        """What a compiled climb takes of a target, None where it stays in the base frame: the joints of its
        first shot, the m coordinates v that move it (the last three its own), the columns of `placed` that
        belong to them, by what each is multiplied (m, 3), and the scale of its own."""
        if target not in self._targets:
            return None
        k = self._targets.tolist().index(target)
        joints = self._joints[:, k]
        first = per_inner(joints, 1) if len(joints) == 1 else per_both(joints[:, None])
        return first, self._moves[k], self._columns, self._by_scale[k].T, float(self._scale[k])

    def covariance(self, x: Matrix, of_z: Matrix, of: Index | None = None) -> Matrix:
        """(W, f, f) of v at x (W, p), from the covariance of z (W, f, f)."""
        from_z = np.linalg.inv(self.jacobian(x, of))
        return np.asarray(from_z @ of_z @ from_z.transpose(0, 2, 1))

    def _spread_out(self, v: Matrix) -> tuple[Matrix, Matrix]:
        """(W, p) x but for the moved targets, and (W, moved, 3) mm these in the flange frame."""
        x = self._problem.parameters.prior_mean + v @ self._to_x
        return x, (v @ self._to_in_flange).reshape(len(v), len(self._targets), 3)

    def _each(self, name: str, of: Index | None, arm: Matrix, points: Matrix) -> tuple[Matrix, ...]:
        """A function of joints, arm and a point, for every row and moved target."""
        rows, count = len(arm), len(self._targets)
        kernel = self._problem.functions.kernel(name)
        if count == 1 and len(self._joints) == 1:
            return kernel(self._joints[0, 0], arm, points[:, 0])
        joints = self._joints if of is None or len(self._joints) == 1 else self._joints[of]
        return kernel(
            np.broadcast_to(joints, (rows, count, joints.shape[2])).reshape(rows * count, joints.shape[2]),
            np.repeat(arm, count, axis=0),
            points.reshape(-1, 3),
        )


@lru_cache(maxsize=8)
def flange_coordinates(density: Density) -> FlangeCoordinates:
    """The coordinates of a density, made once."""
    return FlangeCoordinates(density)
