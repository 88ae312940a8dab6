"""The order of the postures: in the plan's order, the most informative one, closing measurements."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from ...analysis.design.continuous_design import Candidates
from ...analysis.design.exact_design import design
from ...analysis.observability.aim import aim, servo_joints
from ...analysis.solution import Solution
from ...model.arrays import NORMAL_95, Matrix
from ...model.errors import BadInput
from ...model.files.plan import Plan
from ...model.files.run import ENOUGH_CALIBRATED, ENOUGH_UNCALIBRATED
from ...model.files.shot import Shot
from ...model.likelihood.problem import Problem

_STARTS = 8


class Order(Protocol):
    """Decides which posture comes next."""

    def following(
        self, recorded: Sequence[Shot], refused: Collection[int], state: Solution | None
    ) -> int | None:
        """The number of the next measurement, that of its posture in the plan; None: it is enough.

        Decided from what is recorded, and from which postures were refused, alone.
        """
        ...


class InTurn:
    """All postures of a plan of `count`, one after another."""

    def __init__(self, count: int) -> None:
        self._count = count

    def following(
        self, recorded: Sequence[Shot], refused: Collection[int], state: Solution | None
    ) -> int | None:
        done = {shot.shot for shot in recorded}.union(refused)
        return next((number for number in range(self._count) if number not in done), None)


class WithClosing:
    """The postures of `order`, and in the end the first recorded posture of each target once more: the best
    test of whether a target has moved. The number of such a measurement is that of the posture plus `count`,
    the plan's."""

    def __init__(self, order: Order, count: int) -> None:
        self._order, self._count = order, count

    def following(
        self, recorded: Sequence[Shot], refused: Collection[int], state: Solution | None
    ) -> int | None:
        number = self._order.following(recorded, refused, state)
        if number is not None:
            return number
        done = {shot.shot for shot in recorded}.union(refused)
        first: dict[str, int] = {}
        for shot in recorded:
            first.setdefault(shot.met_target, shot.shot + self._count)
        return next((closing for closing in first.values() if closing not in done), None)


@dataclass(eq=False)
class Adaptive:
    """The plan's postures are the candidates, each measured once at most.

    As many as the method needs at least come first, chosen together (A-optimal); then always the one that
    lowers the largest predicted std of the offsets most, until that is within `tolerance` (deg; mm). Where
    the measurements contradict the model (lack of fit, a target that has moved) no std can be relied on: then
    nothing is saved and all postures are measured; `reason` says why it ended.
    """

    plan: Plan
    tolerance: float
    reason: str | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        if not self.tolerance > 0:
            raise BadInput("the tolerance is not above 0", found=self.tolerance)
        self._problem = Problem.from_plan(self.plan)
        parameters = self._problem.parameters
        self._offsets = parameters.group("offset")[parameters.free]
        if not self._offsets.any():
            raise BadInput("there is nothing to adapt to: every offset is held", remedy="free some in `held`")
        enough = ENOUGH_CALIBRATED if self._problem.tool.calibrated else ENOUGH_UNCALIBRATED
        candidates = Candidates(self._roots(self._problem.nominal()), self._offsets)
        together = design(candidates, (min(enough, self._problem.shots),), "A", seed=0, starts=_STARTS)
        self._first = [int(row) for row in together.rows]

    def following(
        self, recorded: Sequence[Shot], refused: Collection[int], state: Solution | None
    ) -> int | None:
        """The next posture; None where the tolerance is reached or no posture is left."""
        made = [shot.shot for shot in recorded if shot.shot < self._problem.shots]
        done = {*made, *refused}
        left = [number for number in range(self._problem.shots) if number not in done]
        if not left:
            self.reason = self.reason or "all postures of the plan are measured"
            return None
        first = [number for number in self._first if number in left]
        if first:
            return first[0]
        if state is None:
            return left[0]
        if not state.consistent:
            self.reason = "the measurements contradict the model: none is saved"
            return left[0]
        # Without a number to spare nothing could contradict it.
        if state.worst is not None and state.dof > 0 and self._wide(state) <= self.tolerance:
            self.reason = f"the largest standard uncertainty is {state.worst:.3g}, within {self.tolerance:g}"
            return None
        parameters, fit = self._problem.parameters, state.fit
        x = parameters.with_values(self._problem.nominal(), fit.problem.parameters, fit.x)
        return self._best(left, made, x)

    def _wide(self, state: Solution) -> float:
        """The largest std of an offset; where the noise is estimated from few numbers, possibly too small,
        each widened as Student's t widens its interval."""
        offsets = state.problem.parameters.group("offset")
        half = (state.quantiles * state.std * state.problem.parameters.display)[offsets]
        return float(np.nanmax(half)) / NORMAL_95

    def _best(self, left: list[int], made: list[int], x: Matrix) -> int:
        """Of the postures `left` the one after which the largest std is the smallest."""
        roots = self._roots(x)
        candidates = Candidates(roots, self._offsets)
        so_far = candidates.information(np.array(made, dtype=np.int64))
        after = so_far + roots[left].transpose(0, 2, 1) @ roots[left]
        variances = np.diagonal(np.linalg.inv(after), axis1=1, axis2=2)[:, self._offsets]
        parameters = self._problem.parameters
        unit = (parameters.prior_std * parameters.display)[parameters.free][self._offsets]
        return left[int(np.argmin((variances * unit**2).max(axis=1)))]

    def _roots(self, x: Matrix) -> Matrix:
        """(N, d, f) whitened Jacobians of all postures, turned onto their targets at x (p,)."""
        aimed = aim(self._problem, x, servo_joints(self._problem)).problem
        return aimed.roots(aimed.whiten(x))
