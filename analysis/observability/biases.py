"""A fit, linearised; and what it makes of a wrong model: what is left in the residuals, what the offsets do.

A wrong model moves the whitened residuals by b. With the Jacobian A by the scaled parameters and
C = (A'A + I)^-1 the fit leaves M b, M = I - A C A', and moves its parameters by C A'b. What it leaves and
what it moves are independent of each other, as of any linear model with normal errors.
"""

from __future__ import annotations

import numpy as np

from ...model.arrays import Index, Mask, Matrix
from ...model.likelihood.parameters import Parameter
from ...model.likelihood.problem import Problem
from ..left_over import LeftOver
from ..recordings.recordings import by_targets


class Linearised(LeftOver):
    """A fit at x (p,): the whitened residuals r (M,) with their Jacobians by the scaled parameters, `free`
    (M, f) = A by those that are estimated, and the `covariance` C (f, f) of these, priors included.

    Of each measurement, whitened: `by_joints` (N, d, n), rad or mm; `by_spot` (N, d, d) and `by_target`
    (N, d, 3), mm; `roots` (N, d, f) by the parameters. `order` (N,) are the measurements as time goes.
    """

    def __init__(
        self, problem: Problem, x: Matrix, rival: Matrix | None = None, *, settled: bool = False
    ) -> None:
        """`rival` (M, g) are whitened columns of what else may explain the residuals, times its prior stds:
        it is fitted as well, by one linear step. So is all, of a point that is not quite the mode, where that
        is asked for (`settled`)."""
        self.problem = problem
        whitened = problem.whiten(x)
        self.jacobian, self.factor = whitened.jacobian, whitened.factor
        self.free, residual = self.jacobian[:, problem.parameters.free], whitened.residual
        if rival is not None:
            self.free = np.hstack([self.free, rival])
        self.gram = self.free.T @ self.free
        # Not by the inverse of gram + I: with hardly any noise the unit prior would be lost in its rounding.
        rows = np.vstack([self.free, np.eye(len(self.gram))])
        inverse = np.linalg.inv(np.linalg.qr(rows, mode="r"))
        self.covariance: Matrix = inverse @ inverse.T
        self.order: Index = problem.order
        self.size = problem.tool.residual_size
        if settled or rival is not None:
            parameters = problem.parameters
            z = np.zeros(len(self.gram))
            scaled = ((x - parameters.prior_mean) / parameters.prior_std)[parameters.free]
            z[: len(scaled)] = scaled
            residual = residual - self.free @ (self.covariance @ (self.free.T @ residual + z))
        super().__init__(residual, self.free @ inverse, (problem.shots, self.size))
        _, shot_jacobians = problem.linearise(x)
        roots = np.sqrt(problem.weights)[:, None, None]
        by_joints = np.linalg.solve(whitened.factor, problem.by_joints(shot_jacobians))
        self.by_joints: Matrix = np.asarray(by_joints * roots, dtype=float)
        by_spot = -np.linalg.inv(whitened.factor) * problem.active[:, None, :]
        self.by_spot: Matrix = np.asarray(by_spot * roots, dtype=float)
        self.by_target = by_targets(problem, whitened)
        self.roots = self.free[: problem.shots * self.size].reshape(problem.shots, self.size, -1)

    def by_parameters(self, which: list[int]) -> Matrix:
        """(M, k) by some parameters, rad or mm."""
        return np.asarray(self.jacobian[:, which] / self.problem.parameters.prior_std[which])

    def rows(self, of_shots: Matrix) -> Matrix:
        """(M, k) whitened columns of all residuals, from those of the measurements (N, d, k)."""
        measured, columns = self.problem.shots * self.size, of_shots.shape[-1]
        result = np.zeros((len(self.residual), columns))
        result[:measured] = of_shots.reshape(measured, columns)
        return result


class Biases(Linearised):
    """Biases b of the whitened residuals at x (p,), by u = A'b (f, k) and the squares b'b (k,).

    Errors of offsets are those of the `counted` parameters (p,) alone: an offset that is no part of a pass
    cannot make it wrong.
    """

    def __init__(self, problem: Problem, x: Matrix, counted: Mask) -> None:
        super().__init__(problem, x)
        parameters = problem.parameters
        at = parameters.among_free[problem.tolerated]
        # |M b|^2 and the squares of what has a tolerance: b'b + u' Q u.
        self.taken = self.covariance @ self.gram @ self.covariance - 2 * self.covariance
        self.taken += self.covariance[:, at] @ self.covariance[at]
        counts = parameters.group("offset") & parameters.free & counted
        self.offsets = np.flatnonzero(counts[parameters.free])
        std = np.sqrt(np.diag(self.covariance)[self.offsets])
        self.into = self.covariance[self.offsets] / std[:, None]
        # (o,) of each offset that counts: its joint, and the standard uncertainties, rad or mm.
        places = np.flatnonzero(counts)
        self.joints: Index = places - parameters.block("offset").start
        self.std = std * parameters.prior_std[places]
        # Degrees, of those that turn.
        self.degrees = np.array(
            [item.display * (item.unit == "deg") for item in (parameters.items[i] for i in places)]
        )

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
