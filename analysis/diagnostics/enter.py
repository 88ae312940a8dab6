"""Values to enter: what a controller takes is not what the arm is.

A controller with nominal geometry takes offsets alone. Those that serve it best also make up for links that
deviate, as far as offsets can: they minimise the expected squared error of the TCP over the workspace under
the posterior of the whole model,

    E |T(q; theta) - N(q; c)|^2 = |T(q; E theta) - N(q; c)|^2 + tr(J C J'),

with T the arm, N the nominal one with the offsets c entered, and J C J' the covariance of T, to first order
(JCGM 102). The last term does not depend on c: what is entered is the least-squares fit of N to the mean arm.

The region is what the arm reaches in front of it: joint 1 within 90 degrees of the middle of its range, the
other joints over theirs. The points are the flange's origin and the tool's stated point, with equal weights.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from ...model.arrays import Matrix
from ...model.files.header import StatedRequirement
from ...model.likelihood.problem import Problem
from ..recordings.recordings import drawn_by_covariance
from ..solution import Solution
from ..status import known
from .accuracy import NO_EFFECT, arm_covariance, spread_postures, tool_point, within_limits

_POSTURES = 256
_DRAWS = 200  # of the posterior
_STEPS = 4  # Gauss-Newton from the estimates: what is left is below a micrometre
_FRONT = float(np.radians(90.0))
_CONFORMS = 0.95  # JCGM 106, 8.3.3: the guard band of a 5 % risk


@dataclass(frozen=True)
class TcpError:
    """The error of the TCP over the region, mm: the median and the length that 95 % stay below, over postures
    and the posterior together; `median_band_mm` holds the median of this arm with 95 %."""

    median_mm: float
    p95_mm: float
    median_band_mm: tuple[float, float]


@dataclass(frozen=True)
class Entered:
    """What to enter into a controller with `of` geometry, by name, deg (mm); and the TCP's error to expect
    with nothing entered and with these."""

    of: Literal["nominal"]
    values: dict[str, float]
    tcp_before: TcpError
    tcp_after: TcpError


@dataclass(frozen=True)
class Conformity:
    """Does the robot meet what it must (JCGM 106)? `tcp_95_mm` is the error that 95 % of the region stays
    below once the values are entered, the middle of its posterior; `probability` that it is within
    `required_mm`. It conforms from 95 % on, and does not below 5 %: between, measurements do not decide."""

    required_mm: float
    tcp_95_mm: float
    probability: float
    decision: Literal["conforms", "does not conform", "undecided"]
    rule: str = "conforms where the probability is 95 % or more, does not where it is 5 % or less (JCGM 106)"


def entered(
    solution: Solution, required: StatedRequirement | None = None
) -> tuple[Entered | None, Conformity | None]:
    """The values to enter, and whether the robot then meets what is required.

    None where an offset that moves the TCP is not determined, or the model does not describe the
    measurements: nothing can be promised then.
    """
    if not solution.converged or solution.misfit is not None:
        return None, None
    region = _Region(solution)
    if region.undetermined:
        return None, None
    values = region.fitted()
    before, after = region.errors(np.zeros_like(values)), region.errors(values)
    items = solution.problem.parameters.items
    result = Entered(
        of="nominal",
        values={items[i].name: float(values[i]) * items[i].display for i in region.estimated},
        tcp_before=_tcp_error(before),
        tcp_after=_tcp_error(after),
    )
    return result, None if required is None else _conformity(after, required.tcp_mm)


class _Region:
    """The arm as the posterior has it, over the region: positions (R, 3) mm of the points at the mean, and
    (R, 3, a) their Jacobians by the arm's parameters."""

    def __init__(self, solution: Solution) -> None:
        self.solution, problem = solution, solution.problem
        self.problem: Problem = problem
        offsets = problem.parameters.block("offset")
        self.estimated = [i for i in range(offsets.start + 1, offsets.stop) if known(solution.status[i])]
        points = [np.zeros(3), problem.tool.point]
        joints = _front(problem)
        self.joints, self.points = np.tile(joints, (2, 1)), np.repeat(points, len(joints), axis=0)
        placed = [tool_point(problem, solution.fit.x, point, joints) for point in points]
        self.position = np.concatenate([position for position, _ in placed])
        self.jacobian = np.concatenate([jacobian for _, jacobian in placed])

    @property
    def undetermined(self) -> bool:
        """Whether an offset that the measurements do not determine moves a point."""
        parameters = self.problem.parameters
        offsets = parameters.block("offset")
        left = [i for i in range(offsets.start + 1, offsets.stop) if i not in self.estimated]
        moved = np.abs(self.jacobian[:, :, left]) * parameters.prior_std[left]
        return bool((moved > NO_EFFECT).any())

    def nominal(self, offsets: Matrix) -> tuple[Matrix, Matrix]:
        """(R, 3) mm with these offsets (n,) entered and nominal geometry, and (R, 3, n) by them."""
        arm = np.zeros(self.problem.parameters.arm.stop)
        arm[: len(offsets)] = offsets
        position, jacobian = self.problem.functions.kernel("placed")(self.joints, arm, self.points)
        return position, jacobian[:, :, : len(offsets)]

    def fitted(self) -> Matrix:
        """(n,) the offsets that bring nominal geometry nearest to the mean arm; 0 where not estimated."""
        n = self.problem.robot.n
        values = np.zeros(n)
        values[self.estimated] = self.solution.fit.x[self.estimated]
        for _ in range(_STEPS):
            position, jacobian = self.nominal(values)
            by = jacobian[:, :, self.estimated].reshape(-1, len(self.estimated))
            left = (self.position - position).reshape(-1)
            values[self.estimated] += np.linalg.lstsq(by, left, rcond=None)[0]
        return values

    @cached_property
    def spread(self) -> Matrix:
        """(3, draws, R) mm by which the points of arms at random from the posterior are off those of the mean
        arm."""
        problem, fit = self.problem, self.solution.fit
        rng = np.random.default_rng(2014)
        drawn = drawn_by_covariance(arm_covariance(problem, fit.covariance), _DRAWS, rng)
        if problem.noise.estimated and self.solution.dof:
            drawn *= np.sqrt(self.solution.dof / rng.chisquare(self.solution.dof, size=(_DRAWS, 1)))
        return np.array([drawn @ self.jacobian[:, k].T for k in range(3)])

    def errors(self, offsets: Matrix) -> Matrix:
        """(draws, R) mm: of those arms, with these offsets (n,) entered."""
        apart = self.position - self.nominal(offsets)[0]
        # Axis by axis: a norm over the first of three axes takes several times as long.
        squares = np.zeros(self.spread.shape[1:])
        for spread, off in zip(self.spread, apart.T, strict=True):
            along = spread + off
            squares += along * along
        return np.asarray(np.sqrt(squares))


def _front(problem: Problem) -> Matrix:
    """(P, n) postures within the limits, joint 1 within 90 degrees of the middle of its range."""
    robot = problem.robot
    lower, upper = robot.lower.copy(), robot.upper.copy()
    if robot.joints[0].kind == "revolute":
        middle = (lower[0] + upper[0]) / 2
        lower[0], upper[0] = max(lower[0], middle - _FRONT), min(upper[0], middle + _FRONT)
    return within_limits(robot, spread_postures(lower, upper, _POSTURES))


def _tcp_error(errors: Matrix) -> TcpError:
    low, high = np.quantile(np.median(errors, axis=1), [0.025, 0.975])
    median, p95 = np.quantile(errors, [0.5, 0.95])
    return TcpError(float(median), float(p95), (float(low), float(high)))


def _conformity(errors: Matrix, required_mm: float) -> Conformity:
    """By the error that 95 % of the region stays below, of each drawn arm."""
    p95 = np.quantile(errors, 0.95, axis=1)
    probability = float((p95 <= required_mm).mean())
    decision: Literal["conforms", "does not conform", "undecided"] = "undecided"
    if probability >= _CONFORMS:
        decision = "conforms"
    elif probability <= 1 - _CONFORMS:
        decision = "does not conform"
    return Conformity(required_mm, float(np.median(p95)), probability, decision)
