"""Coordinates in which the posterior is nearly normal: each target as seen from the flange of its first shot.

In the base frame a poorly known offset drags the target along an arc, and the posterior is a thin
banana. Seen from the flange of a shot that hit it, the target stays where it is, so that a turn of
everything after a joint, the target included, is a straight line along one offset. The change is a
rigid motion for given offsets: no volume factor enters.
"""

from __future__ import annotations

import numpy as np

from ..model.problem import Problem
from ..model.robot import Matrix


class SeenCoordinates:
    """v (f,): free offsets and tool scaled by their priors, targets as seen, over their prior std."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        parameters = problem.parameters
        n, count = problem.robot.n, len(problem.targets)
        self._free = parameters.free
        places = n + np.arange(3 * count).reshape(count, 3)
        # A target of which a coordinate is held stays in the base frame: seen from the flange it would move.
        moved = np.flatnonzero(self._free[places].all(axis=1))
        self._targets = moved
        self._places = places[moved]
        self._scale = parameters.prior_std[self._places]
        # The change of frame is rigid only if the three coordinates share one scale.
        self._scale[:] = self._scale.mean(axis=1, keepdims=True)
        first = np.array([np.argmax(problem.target_index == k) for k in moved], dtype=int)
        self._joints = problem.joints[first]
        self._seen = problem.functions.kernel("seen")
        self._placed = problem.functions.kernel("placed")
        self._place = problem.functions.kernel("place", compile=True)

    def from_parameters(self, x: Matrix) -> Matrix:
        """v (f,) of one parameter vector x (p,)."""
        parameters = self._problem.parameters
        z = (x - parameters.prior_mean) / parameters.prior_std
        if len(self._targets):
            delta, targets, _ = self._problem.split(x)
            (seen,) = self._seen(self._joints, delta, targets[self._targets])
            z[self._places] = seen / self._scale
        return z[self._free]

    def to_parameters(self, v: Matrix) -> Matrix:
        """x (W, p) of coordinates v (W, f); what is held stays at its prior mean."""
        parameters = self._problem.parameters
        x = np.tile(parameters.prior_mean, (len(v), 1))
        x[:, self._free] += v * parameters.prior_std[self._free]
        if len(self._targets):
            z = np.zeros_like(x)
            z[:, self._free] = v
            delta, _, _ = self._problem.split(x)
            seen = z[:, self._places] * self._scale
            count = len(self._targets)
            (placed,) = self._place(
                np.tile(self._joints, (len(v), 1)), np.repeat(delta, count, axis=0), seen.reshape(-1, 3)
            )
            x[:, self._places] = placed.reshape(len(v), count, 3)
        return x

    def jacobian(self, x: Matrix) -> Matrix:
        """(f, f) of the scaled free parameters z by v, at x (p,)."""
        parameters, n = self._problem.parameters, self._problem.robot.n
        result = np.eye(len(parameters))
        if len(self._targets):
            delta, targets, _ = self._problem.split(x)
            (seen,) = self._seen(self._joints, delta, targets[self._targets])
            _, by = self._placed(self._joints, delta, seen)
            for place, scale, own in zip(self._places, self._scale, by, strict=True):
                inverse = 1 / parameters.prior_std[place][:, None]
                result[place, :n] = own[:, :n] * parameters.prior_std[:n] * inverse
                result[np.ix_(place, place)] = own[:, n:] * scale * inverse
        return result[np.ix_(self._free, self._free)]
