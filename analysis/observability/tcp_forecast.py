"""The error of the TCP that measurements will leave, for arms at random and what is estimated of them.

All is linear about one arm. With x the scaled parameters of the arm, m their estimates, J the TCP by the
parameters and J_o M what nominal geometry with the offsets fitted to m makes of them, the TCP is off by
J x - J_o M m: by J (x - m) for the noise, and by (J - J_o M) m for the links that are not entered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from ...model.arrays import Mask, Matrix
from ...model.likelihood.problem import Problem
from ..covariance import drawn_by_covariance
from ..status import Status
from ..tcp_region import (
    arm_covariance,
    arms_at_random,
    default_point,
    fitted_points,
    moving_by_nominal,
    normal_inverse,
    region_postures,
    tool_point,
)

_POSTURES, _FITTED_AT = 128, 32
_SEED = 2015


@dataclass(frozen=True, eq=False)
class ArmBelief:
    """What is known of an arm and what measures it: `mean` (f,) and `covariance` (f, f) of the scaled free
    parameters of a `problem`; `dof` degrees of freedom where the noise is estimated."""

    problem: Problem
    mean: Matrix
    covariance: Matrix
    dof: float | None = None

    @cached_property
    def deviations(self) -> Matrix:
        """(D, f) of arms at random from the mean: by `arms_at_random`, and the rest as goes with them."""
        parameters = self.problem.parameters
        arm = parameters.free[parameters.arm]
        count, rng = int(arm.sum()), np.random.default_rng(_SEED + 2)
        of_arm = arms_at_random(arm_covariance(self.problem, self.covariance), self.dof)
        of_arm = of_arm[:, arm] / parameters.prior_std[parameters.arm][arm]
        by_arm = np.linalg.solve(self.covariance[:count, :count], self.covariance[:count, count:])
        left = self.covariance[count:, count:] - self.covariance[count:, :count] @ by_arm
        return np.hstack([of_arm, of_arm @ by_arm + drawn_by_covariance(left, len(of_arm), rng)])


@dataclass(frozen=True, eq=False)
class EstimatesOfArms:
    """Of arms at random: the `estimates` (D, f), or (1, f) if all have the same, and the `errors` (D, f) by
    which the arms are off them."""

    estimates: Matrix
    errors: Matrix

    @classmethod
    def made(cls, belief: ArmBelief) -> Self:
        """Those that are made: the belief is what came of them."""
        return cls(belief.mean[None], belief.deviations)

    @classmethod
    def of_new_run(cls, belief: ArmBelief, covariance: Matrix, roots: Matrix) -> Self:
        """Those of a new run of measurements with these roots (N, d, f); it has the `covariance` (f, f)."""
        return cls._by(belief, covariance, roots, belief.mean + belief.deviations)

    @classmethod
    def of_more(cls, belief: ArmBelief, covariance: Matrix, roots: Matrix) -> Self:
        """Those of measurements with these roots beside what the belief came of; they have the `covariance`
        (f, f) together."""
        drawn = belief.deviations @ np.linalg.inv(belief.covariance)
        return cls._by(belief, covariance, roots, drawn)

    @classmethod
    def _by(cls, belief: ArmBelief, covariance: Matrix, roots: Matrix, drawn: Matrix) -> Self:
        """`drawn` (D, f): arms times the information by which they are drawn to what is believed of them."""
        arms = belief.mean + belief.deviations
        rows = roots.reshape(-1, roots.shape[-1])
        noise = np.random.default_rng(_SEED + 1).normal(size=(len(arms), len(rows)))
        errors = (drawn - noise @ rows) @ covariance
        return cls(arms - errors, errors)


class TcpForecast:
    """The TCP's error over the region at x (p,), for parameters of this `status` (p,)."""

    def __init__(self, problem: Problem, x: Matrix, status: Sequence[Status]) -> None:
        self._problem, self._x = problem, x
        self._point = default_point(problem, status)[0]
        self._joints = region_postures(problem, _POSTURES)
        self._moving = moving_by_nominal(problem, self._point, self._joints)
        self._moving[0] = False  # a choice of frame

    def errors(
        self, estimates: EstimatesOfArms, determined: Mask
    ) -> tuple[tuple[float, float] | None, tuple[float, float] | None]:
        """Median and 95 % of the TCP's error, mm, with the offsets entered, and with the links too; None
        where it depends on an offset that is not `determined` (f,), the second also of an exact arm."""
        parameters = self._problem.parameters
        offsets = parameters.block("offset")
        free = parameters.free[offsets]
        entered = np.zeros(len(free), dtype=bool)
        entered[free] = determined[: int(free.sum())]
        if (self._moving & ~entered).any():
            return None, None
        by_noise = estimates.errors @ self._by_arm.T
        tcp = _length_quantiles(by_noise + estimates.estimates @ self._not_entered(entered).T)
        if not self._problem.geometry:
            return tcp, None
        return tcp, _length_quantiles(by_noise + estimates.estimates @ self._not_held.T)

    @cached_property
    def mean_square(self) -> Matrix:
        """(f, f) mm² of scaled free parameters: e' E e is the mean squared error of the TCP over the
        region."""
        return np.asarray(self._by_arm.T @ self._by_arm / len(self._joints))

    def places(self, joints: Matrix) -> Matrix:
        """(P, 3) mm the TCP at recorded `joints` (P, n)."""
        return tool_point(self._problem, self._x, self._point, joints)[0]

    @cached_property
    def _by_arm(self) -> Matrix:
        """(3 P, f) mm the TCP by the scaled free parameters."""
        return self._rows(self._point, self._joints)

    def _rows(self, points: Matrix, joints: Matrix) -> Matrix:
        """(3 P, f) mm points of the flange by the scaled free parameters."""
        parameters = self._problem.parameters
        arm = parameters.free[parameters.arm]
        _, jacobian = tool_point(self._problem, self._x, points, joints)
        rows = np.zeros((3 * len(joints), int(parameters.free.sum())))
        scaled = jacobian * parameters.prior_std[parameters.arm]
        rows[:, : int(arm.sum())] = scaled[:, :, arm].reshape(len(rows), -1)
        return rows

    @cached_property
    def _fitted(self) -> Matrix:
        """(M, f) mm the points by which values to enter are fitted."""
        points, joints, roots = fitted_points(self._problem, self._point, _FITTED_AT)
        return self._rows(points, joints) * np.repeat(roots, 3)[:, None]

    def _not_entered(self, entered: Mask) -> Matrix:
        """(3 P, f) mm by which the TCP is off for the parameters of an arm of which nominal geometry has the
        best values of the offsets `entered` (n,)."""
        parameters = self._problem.parameters
        free = parameters.free[parameters.block("offset")]
        at, out = np.flatnonzero(entered[free]), np.flatnonzero(~entered[free])
        fitted = self._fitted.copy()
        fitted[:, out] = 0.0  # neither the arm nor the controller has them
        columns = fitted[:, at]
        inverse = normal_inverse(columns)
        fit = inverse @ (columns.T @ fitted)
        fit[:, at] += np.eye(len(at)) - inverse @ (columns.T @ columns)  # what moves no point
        return np.asarray(self._by_arm - self._by_arm[:, at] @ fit)

    @cached_property
    def _not_held(self) -> Matrix:
        """(3 P, f) mm the same of what a robot file does not hold: gravity and harmonics."""
        items = [item for item in self._problem.parameters.items if not item.held]
        held = [item.group == "offset" or item.name.startswith("link") for item in items]
        return np.asarray(np.where(held, 0.0, self._by_arm))


def _length_quantiles(errors: Matrix) -> tuple[float, float]:
    """Median and 95 % of the lengths of errors (D, 3 P)."""
    lengths = np.linalg.norm(errors.reshape(len(errors), -1, 3), axis=2)
    median, p95 = np.quantile(lengths, [0.5, 0.95])
    return float(median), float(p95)
