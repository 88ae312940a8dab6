"""The order of the postures: in the plan's order, the most informative one, and some again at the end."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from ...analysis.design.continuous_design import Candidates
from ...analysis.design.exact_design import design
from ...analysis.diagnostics.values_to_enter import judged
from ...analysis.observability.aim import aim, servo_joints
from ...analysis.solution import Solution
from ...analysis.status import known
from ...model.arrays import NORMAL_95, Matrix
from ...model.errors import BadInput
from ...model.files.plan import Plan, first_in_turn
from ...model.files.run import ENOUGH_CALIBRATED, ENOUGH_UNCALIBRATED
from ...model.files.shot import Shot
from ...model.likelihood.problem import Problem
from ...words import numbers

_STARTS = 8
_LOWERED = 0.98  # of its std: what all postures that are left lower by less they do not lower
_USUAL_S = 60.0  # of a measurement, where the times are not recorded


class Order(Protocol):
    """Decides which posture comes next."""

    def following(
        self, recorded: Sequence[Shot], refused: Collection[int], state: Solution | None
    ) -> int | None:
        """The number of the next measurement, that of its posture in the plan; None: it is enough.

        Decided from what is recorded, and from which postures were refused, alone.
        """
        ...


TWICE = 2  # beside the first time, where `--once-more` asks for it


class InTurn:
    """All postures of a plan of `count`, one after another."""

    def __init__(self, count: int) -> None:
        self._count = count

    def following(
        self, recorded: Sequence[Shot], refused: Collection[int], state: Solution | None
    ) -> int | None:
        done = {shot.shot for shot in recorded}.union(refused)
        return next((number for number in range(self._count) if number not in done), None)


class WithRepeats:
    """The postures of `order`, and in the end some of the recorded ones again, the first of each target in
    turn: what changed during the run shows in the difference. The number of such a measurement is that of
    the posture plus `count`, the plan's: `repeat` of them."""

    def __init__(self, order: Order, count: int, repeat: int) -> None:
        self._order, self._count, self._repeat = order, count, repeat

    def following(
        self, recorded: Sequence[Shot], refused: Collection[int], state: Solution | None
    ) -> int | None:
        number = self._order.following(recorded, refused, state)
        if number is not None:
            return number
        done = {shot.shot for shot in recorded}.union(refused)
        first = [shot for shot in recorded if shot.shot < self._count and shot.again is None]
        again = first_in_turn([shot.met_target for shot in first], self._repeat)
        numbers = [first[row].shot + self._count for row in again]
        return next((number for number in numbers if number not in done), None)


class OnceMore:
    """What `order` asks for, and in the end each posture once more that was measured again, once or by the
    order. The number of such a measurement is that of the posture and a multiple of `count`, the plan's."""

    def __init__(self, order: Order, count: int) -> None:
        self._order, self._count = order, count

    def following(
        self, recorded: Sequence[Shot], refused: Collection[int], state: Solution | None
    ) -> int | None:
        number = self._order.following(recorded, refused, state)
        if number is not None:
            return number
        done = {shot.shot for shot in recorded}
        again = [shot.again for shot in recorded if shot.again is not None]
        for posture in dict.fromkeys(again):
            if again.count(posture) < TWICE:
                number = next(n for n in itertools.count(posture + self._count, self._count) if n not in done)
                if number not in refused:
                    return number
        return None


@dataclass(eq=False)
class Adaptive:
    """The plan's postures are the candidates, each measured once at most; those that repeat others are none.

    As many as the method needs at least come first, chosen together (A-optimal); then always the one that
    lowers the largest predicted std of the offsets most, of those that postures lower, until that is within
    `tolerance` (deg; mm), the robot meets what the header requires of the TCP, or the next measurement lowers
    the U of no offset by `gain` (deg; mm) an hour. Where the measurements contradict the model (lack of fit,
    a target that has moved) no std can be relied on: then nothing is saved and all postures are measured;
    `reason` says why it ended.
    """

    plan: Plan
    tolerance: float
    gain: float | None = None
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
        self._new = [shot.shot for shot in self.plan.shots if shot.again is None]
        candidates = Candidates(self._roots(self._problem.nominal())[self._new], self._offsets)
        together = design(candidates, (min(enough, len(self._new)),), "A", seed=0, starts=_STARTS)
        self._first: list[int] = [self._new[row] for row in together.rows]

    def following(
        self, recorded: Sequence[Shot], refused: Collection[int], state: Solution | None
    ) -> int | None:
        """The next posture; None where the tolerance is reached or no posture is left."""
        made = [shot.shot for shot in recorded if shot.shot < self._problem.shots]
        done = {*made, *refused}
        left = [number for number in self._new if number not in done]
        if not left:
            self.reason = self.reason or "all postures of the plan are measured"
            return None
        first = next((number for number in self._first if number in left), None)
        if first is not None:
            return first
        if state is None:
            return left[0]
        if not state.consistent:
            self.reason = "the measurements contradict the model: none is saved"
            return left[0]
        # Without a number to spare nothing could contradict it.
        if state.worst is not None and state.dof > 0 and self._wide(state) <= self.tolerance:
            self.reason = (
                f"the largest standard uncertainty is {self._worded(state.worst)}, within"
                f" {self._worded(self.tolerance)}"
            )
            return None
        required = self.plan.header.required
        if required is not None and state.dof > 0:
            conformity = judged(state, required)
            if conformity is not None and conformity.decision == "conforms":
                self.reason = f"the TCP is within {required.tcp_mm:g} mm as required"
                return None
        parameters, fit = self._problem.parameters, state.fit
        x = parameters.with_values(self._problem.nominal(), fit.problem.parameters, fit.x)
        best, gain = self._best(left, made, x)
        hours = _seconds_each(recorded) / 3600
        if self.gain is not None and state.worst is not None and state.dof > 0 and gain / hours < self.gain:
            self.reason = (
                f"the next measurement lowers U by {self._worded(gain / hours)} an hour at the most, less"
                f" than {self._worded(self.gain)}"
            )
            return None
        return best

    def _worded(self, uncertainty: float) -> str:
        """With the unit of the offsets, if they have one."""
        units = {item.unit for item in self._problem.parameters.items if item.group == "offset"}
        return numbers.significant(uncertainty, 2, units.pop() if len(units) == 1 else "")

    def _wide(self, state: Solution) -> float:
        """The largest std of an offset that is more than assumed; where the noise is estimated from few
        numbers, possibly too small, each widened as Student's t widens its interval."""
        offsets = state.problem.parameters.group("offset")
        offsets &= np.array([known(status) for status in state.status])
        half = (state.quantiles * state.std * state.problem.parameters.display)[offsets]
        return float(np.nanmax(half)) / NORMAL_95

    def _best(self, left: list[int], made: list[int], x: Matrix) -> tuple[int, float]:
        """Of the postures `left` the one after which the largest std is the smallest, of the offsets that
        these postures lower; and by how much it lowers the U (k = 2) of an offset, at the most."""
        roots = self._roots(x)
        candidates = Candidates(roots, self._offsets)
        so_far = candidates.information(np.array(made, dtype=np.int64))
        each = roots[left].transpose(0, 2, 1) @ roots[left]
        parameters = self._problem.parameters
        unit = (parameters.prior_std * parameters.display)[parameters.free][self._offsets]
        whole = np.array([so_far, so_far + each.sum(axis=0), *(so_far + each)])
        now, with_all, *after = unit * np.sqrt(
            np.diagonal(np.linalg.inv(whole), axis1=1, axis2=2)[:, self._offsets]
        )
        lowered = with_all < _LOWERED * now
        if not lowered.any():
            lowered[:] = True
        best = int(np.argmin(np.array(after)[:, lowered].max(axis=1)))
        return left[best], float(2 * (now - after[best]).max())

    def _roots(self, x: Matrix) -> Matrix:
        """(N, d, f) whitened Jacobians of all postures, turned onto their targets at x (p,)."""
        aimed = aim(self._problem, x, servo_joints(self._problem)).problem
        return aimed.roots(aimed.whiten(x))


def _seconds_each(recorded: Sequence[Shot]) -> float:
    """How long a measurement takes, by those so far."""
    times = [shot.time_s for shot in recorded if shot.time_s is not None]
    return max(float(np.median(np.diff(times))), 1.0) if len(times) > 2 else _USUAL_S
