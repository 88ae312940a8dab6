"""What a fit makes of a wrong model: what is left of it in the residuals, and how far it moves the offsets.

A wrong model moves the whitened residuals by b. With the Jacobian A by the scaled parameters and
C = (A'A + I)^-1 the fit leaves M b, M = I - A C A', and moves its parameters by C A'b. What it leaves and
what it moves are independent of each other, as of any linear model with normal errors.
"""

from __future__ import annotations

import numpy as np

from ...model.arrays import Index, Matrix
from ...model.likelihood.parameters import Parameter
from ...model.likelihood.problem import Problem
from ..recordings.recordings import by_targets


class Biases:
    """Biases b of the whitened residuals at x (p,), by u = A'b (f, k) and the squares b'b (k,)."""

    def __init__(self, problem: Problem, x: Matrix) -> None:
        self.problem, parameters = problem, problem.parameters
        whitened = problem.whiten(x)
        jacobian = whitened.jacobian
        self.residual, self.columns = whitened.residual, jacobian[:, parameters.free]
        gram = self.columns.T @ self.columns
        self.covariance: Matrix = np.asarray(np.linalg.inv(gram + np.eye(len(gram))), dtype=float)
        at = parameters.among_free[problem.tolerated]
        # |M b|^2 and the squares of what has a tolerance: b'b + u' Q u.
        self.taken = self.covariance @ gram @ self.covariance - 2 * self.covariance
        self.taken += self.covariance[:, at] @ self.covariance[at]
        self.offsets = np.flatnonzero(parameters.group("offset")[parameters.free])
        std = np.sqrt(np.diag(self.covariance)[self.offsets])
        self.into = self.covariance[self.offsets] / std[:, None]
        # (o,) of each free offset: its joint, and the standard uncertainties, rad or mm.
        places = np.flatnonzero(parameters.group("offset") & parameters.free)
        self.joints: Index = places - parameters.block("offset").start
        self.std = std * parameters.prior_std[places]
        _, shot_jacobians = problem.linearise(x)
        by_joints = np.linalg.solve(whitened.factor, problem.by_joints(shot_jacobians))
        # (N, d, n) of each measurement by its joints, rad or mm; (N, d, d) by its spot, mm;
        # (N, d, 3) by its target, mm; (N, d, f) by the parameters.
        self.by_joints = by_joints * np.sqrt(problem.weights)[:, None, None]
        self.by_spot = -np.linalg.inv(whitened.factor) * np.sqrt(problem.weights)[:, None, None]
        self.by_target = by_targets(problem, whitened)
        self.roots = problem.roots(whitened)
        self.jacobian = jacobian

    def by_parameters(self, which: list[int]) -> Matrix:
        """(M, k) by some parameters, rad or mm."""
        return np.asarray(self.jacobian[:, which] / self.problem.parameters.prior_std[which])

    def squares(self, square: Matrix, u: Matrix) -> Matrix:
        """(k,) the noncentralities of the squares of residuals and tolerances."""
        return np.asarray(np.maximum(square + (u * (self.taken @ u)).sum(axis=0), 0.0))

    def left(self, square: Matrix, u: Matrix) -> Matrix:
        """(k,) the noncentralities b'M b of tests for these very biases."""
        return np.asarray(np.maximum(square - (u * (self.covariance @ u)).sum(axis=0), 0.0))

    def errors(self, u: Matrix) -> Matrix:
        """(o, k) the errors of the offsets by biases, in their u."""
        return np.asarray(self.into @ u)

    def off(self, u: Matrix) -> Matrix:
        """(k,) the largest error of an offset by biases, in its u."""
        return np.asarray(np.abs(self.errors(u)).max(axis=0, initial=0.0))

    def of_shots(self, parts: Matrix) -> tuple[Matrix, Matrix]:
        """The squares (k,) and u (f, k) of biases of the measurements (N, d, k)."""
        return (parts**2).sum(axis=(0, 1)), np.einsum("nda,ndk->ak", self.roots, parts)


def revolute(problem: Problem) -> list[int]:
    """The joints that turn, from 0."""
    return [i for i, joint in enumerate(problem.robot.joints) if joint.kind == "revolute"]


def tool_items(problem: Problem, unit: str) -> list[int]:
    """The places of a calibrated tool's parameters that have a tolerance, of this unit."""

    def counts(item: Parameter) -> bool:
        return item.group == "tool" and item.tolerated and item.unit == unit and not item.held

    return [i for i, item in enumerate(problem.parameters.items) if counts(item)]
