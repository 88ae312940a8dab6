"""Remedies that are tried: what a change of the postures, or a closer tolerance, would make of what the data
determine poorly.

All is predicted by the information of the measurements, without a fit. A change that gains little, or that
makes another offset clearly worse, is no remedy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...model.arrays import Index, Mask, Matrix
from ...model.kernel import one_blas_thread
from ...model.kinematics.pendant import beyond_limits
from ...model.likelihood.parameters import Parameter
from ...model.likelihood.problem import Problem
from ..status import Status
from .aim import aim, servo_joints
from .causes import (
    CommonMotion,
    Equivalent,
    How,
    NotResolvable,
    NullDirection,
    ParallelAxes,
    Predicted,
    TargetUnseen,
    ToolAgainstTarget,
    ToolRotation,
    Tried,
    WithinTolerances,
    worst_direction,
)
from .predictions import besides

Allowed = Callable[[Problem], Mask]  # of aimed shots (N,), which of them the constraints of a plan allow

_MENDED_BY_POSTURES = (
    CommonMotion,
    Equivalent,
    NotResolvable,
    ParallelAxes,
    TargetUnseen,
    ToolAgainstTarget,
    WithinTolerances,
)
_TURNS = {"revolute": (30.0, 45.0, 60.0, 90.0), "prismatic": (100.0, 150.0, 200.0, 300.0)}  # degrees, mm
_SPREADS = {"revolute": (60.0, 90.0, 120.0), "prismatic": (200.0, 300.0, 400.0)}
IN_TURN = (-0.5, 0.5, 0.0)  # of a spread, from measurement to measurement
_CLOSER_TOOL, _CLOSER_ARM = (2.0, 5.0, 10.0), (2.0, 5.0)  # times smaller tolerances
_EFFORT: tuple[How, ...] = ("replace", "add", "vary", "tolerances")  # the easiest first
_MOST_CHANGED = 12  # postures of which one is changed
_MOST_VARIED = 30  # of more postures so many stand for all
_STILL_AIMED = 2 / 3  # of the postures that are varied must still meet their targets
_WORTH_TELLING = 0.8  # a change that leaves more than this of u is no remedy
_DETERMINED = 0.5  # of the prior's std: at most this is left of what was not determined
_HARM = 1.1  # times as large another u may become
_ABOUT_AS_GOOD = 1.25  # an easier change is preferred to one that is better by less
_MOST_PREDICTED = 3
_ROUNDING = 1e-13  # of a variance


class _Trial(NamedTuple):
    """A change, with the std (f,) of the scaled free parameters after it."""

    how: How
    amount: float
    std: Matrix
    joint: int | None = None
    postures: tuple[int, ...] = ()

    @property
    def effort(self) -> tuple[int, float]:
        return _EFFORT.index(self.how), abs(self.amount)


@dataclass(frozen=True, eq=False)
class RemedySearch:
    """Changes of the aimed shots of a problem at x (p,), of parameters with this `status` (p,).

    `std` (f,) is that of the scaled free parameters, priors included; `weight` 1 / noise scale². The shots
    are called by their `numbers`. Of those that are `measured` none can be replaced: one more can be
    measured, or all anew. Postures that are not `allowed` are not proposed.
    """

    problem: Problem
    x: Matrix
    status: Sequence[Status]
    std: Matrix
    numbers: Sequence[int]
    weight: float = 1.0
    measured: bool = False
    allowed: Allowed | None = None

    def with_remedies(self, null_space: Sequence[NullDirection]) -> tuple[NullDirection, ...]:
        """The directions, each with the remedy that does most for what it leaves poorly determined."""
        with one_blas_thread():
            return tuple(replace(each, tried=self._for(each, null_space)) for each in null_space)

    def _for(self, direction: NullDirection, null_space: Sequence[NullDirection]) -> Tried | None:
        trials: list[_Trial] = []
        cause, parameters = direction.cause, self.problem.parameters
        known_tool = isinstance(cause, ToolRotation) and cause.known_to is not None
        if known_tool or isinstance(cause, _MENDED_BY_POSTURES):
            trials += [*self._singles, *self._spreads]
        if known_tool:
            trials += self._closer(parameters.group("tool") & parameters.tolerated, _CLOSER_TOOL)
        if isinstance(cause, WithinTolerances):
            trials += self._closer(parameters.tolerated, _CLOSER_ARM)
        concerned = self._concerned(direction, null_space)
        trial = self._best(trials, concerned) if trials and len(concerned) else None
        return None if trial is None else self._described(trial, concerned)

    def _concerned(self, direction: NullDirection, null_space: Sequence[NullDirection]) -> Index:
        """Places among the free parameters of what owes its status to a direction: offsets, or others where
        there is none; where nothing does, of the one that leads it."""
        items = list(enumerate(self._items))
        poor = [
            k
            for k, item in items
            if self._status[k] in ("weak", "unidentifiable")
            and not item.tolerated
            and item.group != "noise"
            and worst_direction(null_space, item.name) is direction
        ]
        offsets = [k for k in poor if self._items[k].group == "offset"]
        leading = [k for k, item in items if direction.combination.get(item.name) == 1.0]
        return np.array(offsets or poor or leading, dtype=np.int64)

    def _best(self, trials: Sequence[_Trial], concerned: Index) -> _Trial | None:
        """Of those that help, and harm no offset, the easiest that is about as good as the best."""
        if not trials:
            return None
        std, known, offsets = np.array([trial.std for trial in trials]), self._determined, self._offsets
        before, after = self.std / self._tolerance, std / self._tolerance
        others = offsets[known[offsets]]
        useful = (after <= np.maximum(_HARM * before, 1.0))[:, others].all(axis=1)
        lost = concerned[~known[concerned]]
        if len(lost):
            useful &= (std[:, lost] <= _DETERMINED).all(axis=1)
        else:
            useful &= after[:, concerned].max(axis=1) <= _WORTH_TELLING * before[concerned].max()
        if not useful.any():
            return None
        need = np.where(useful, np.maximum(after[:, concerned].max(axis=1), 1.0), np.inf)
        most = 1.0 if need.min() <= 1.0 else _ABOUT_AS_GOOD * need.min()
        good = np.flatnonzero(need <= most).tolist()
        return trials[min(good, key=lambda k: (*trials[k].effort, after[k, concerned].max()))]

    def _described(self, trial: _Trial, concerned: Index) -> Tried:
        helped = ~self._determined | (trial.std <= _WORTH_TELLING * self.std)
        improved = concerned[helped[concerned]]
        order = improved[np.argsort(-(trial.std / self._tolerance)[improved], kind="stable")]
        predicted = []
        for k in order[:_MOST_PREDICTED].tolist():
            item, before = self._items[k], float(self.std[k] * self._shown[k])
            predicted.append(
                Predicted(
                    name=item.name,
                    unit=item.unit,
                    before=before if self._determined[k] else None,
                    after=float(trial.std[k] * self._shown[k]),
                    tolerance=item.tolerance * item.display,
                )
            )
        others = sorted(set(range(self.problem.shots)) - set(trial.postures)) if trial.how == "vary" else []
        unchanged = tuple(int(self.numbers[i]) for i in others)
        return Tried(
            how=trial.how,
            amount=trial.amount,
            predicted=tuple(predicted),
            joint=trial.joint,
            unit=None if trial.joint is None else self._unit_of(trial.joint),
            postures=tuple(int(self.numbers[i]) for i in trial.postures),
            unchanged=unchanged,
            measured=self.measured,
            aimed=self.problem.tool.beam,
        )

    def _unit_of(self, joint: int) -> str:
        return self.problem.robot.joints[joint - 1].unit

    @cached_property
    def _items(self) -> list[Parameter]:
        return [item for item in self.problem.parameters.items if not item.held]

    @cached_property
    def _status(self) -> list[Status]:
        return [self.status[i] for i in np.flatnonzero(self.problem.parameters.free).tolist()]

    @cached_property
    def _determined(self) -> Mask:
        return np.array([status != "unidentifiable" for status in self._status])

    @cached_property
    def _shown(self) -> Matrix:
        """(f,) a std of 1 in the units that people read."""
        return np.array([item.prior_std * item.display for item in self._items])

    @cached_property
    def _tolerance(self) -> Matrix:
        """(f,) in prior stds."""
        return np.array([item.tolerance / item.prior_std for item in self._items])

    @cached_property
    def _offsets(self) -> Index:
        return np.array([k for k, item in enumerate(self._items) if item.group == "offset"], dtype=np.int64)

    @cached_property
    def _now(self) -> Matrix:
        """(N, d, f) the roots of the information of the shots as they are."""
        return self._weighted(self.problem)

    def _weighted(self, problem: Problem) -> Matrix:
        """(M, d, f) the roots of the information of shots."""
        return np.asarray(np.sqrt(self.weight) * problem.roots(problem.whiten(self.x)))

    @cached_property
    def _besides(self) -> Matrix:
        """(f, f) of distances and priors."""
        return besides(self.problem, self.problem.whiten(self.x))

    @cached_property
    def _information(self) -> Matrix:
        """(f, f) of all."""
        return self._besides + _square(self._now)

    @cached_property
    def _changed(self) -> tuple[Index, list[tuple[int, int, float]]]:
        """Which postures are changed one at a time, and how: of each the posture, the joint, the amount."""
        some = _spaced(self.problem.shots, _MOST_CHANGED)
        robot = self.problem.robot
        return some, [
            (i, j, sign * amount)
            for i in some.tolist()
            for j in _moved(self.problem, i)
            for amount in _TURNS[robot.joints[j].kind]
            for sign in (1.0, -1.0)
        ]

    @cached_property
    def _varied(self) -> tuple[Index, list[tuple[int, float]]]:
        """Which postures stand for all that are varied, and how: the joint, the amount."""
        some = _spaced(self.problem.shots, _MOST_VARIED)
        moved = set.intersection(*(set(_moved(self.problem, i)) for i in some.tolist()))
        robot = self.problem.robot
        return some, [(j, amount) for j in sorted(moved) for amount in _SPREADS[robot.joints[j].kind]]

    @cached_property
    def _roots(self) -> list[Matrix | None]:
        """(d, f) the root of the information of each shot that is tried, all of `_changed` and then those of
        each of `_varied`; None where it cannot be measured or is not allowed."""
        problem, (_, singles), (some, spreads) = self.problem, self._changed, self._varied
        display, share = problem.robot.display, in_turn(problem.select(some))
        rows = [i for i, _, _ in singles] + some.tolist() * len(spreads)
        turned = [j for _, j, _ in singles] + [j for j, _ in spreads for _ in some]
        amount = [size for *_, size in singles] + [size * part for _, size in spreads for part in share]
        each = np.array(turned)
        aimed, possible = changed(problem, self.x, np.array(rows), each, np.array(amount) / display[each])
        fit = np.flatnonzero(possible)
        if self.allowed is not None and len(fit):
            fit = fit[self.allowed(aimed.select(fit))]
        roots: list[Matrix | None] = [None] * len(rows)
        if len(fit):
            for row, root in zip(fit.tolist(), self._weighted(aimed.select(fit)), strict=True):
                roots[row] = root
        return roots

    @cached_property
    def _singles(self) -> list[_Trial]:
        """One posture with one joint rotated, in its place or as one more."""
        some, tries = self._changed
        fit = [k for k, root in enumerate(self._roots[: len(tries)]) if root is not None]
        if not fit:
            return []
        roots = np.array([self._roots[k] for k in fit])
        stds: list[tuple[How, Matrix]] = [("add", _with(_inverse(self._information), roots))]
        if not self.measured and self.problem.shots > 1:
            old = self._now[some]
            without = _inverse(self._information - old.transpose(0, 2, 1) @ old)
            which = np.searchsorted(some, [tries[k][0] for k in fit])
            stds.append(("replace", _with(without[which], roots)))
        return [
            _Trial(how, tries[k][2], std, tries[k][1] + 1, (tries[k][0],))
            for how, every in stds
            for k, std in zip(fit, every, strict=True)
        ]

    @cached_property
    def _spreads(self) -> list[_Trial]:
        """All postures with one joint rotated in turn."""
        (problem, (some, tries)), trials = (self.problem, self._varied), []
        for k, (j, amount) in enumerate(tries):
            roots = self._roots[len(self._changed[1]) + k * len(some) :][: len(some)]
            fit = [i for i, root in enumerate(roots) if root is not None]
            if len(fit) < _STILL_AIMED * len(some):
                continue
            new = np.array([root for root in roots if root is not None])
            kept = np.delete(self._now[some], fit, axis=0)
            total = self._besides + problem.shots / len(some) * (_square(kept) + _square(new))
            those = some[fit].tolist() if len(some) == problem.shots else range(problem.shots)
            std = np.sqrt(np.diag(_inverse(total)))
            trials.append(_Trial("vary", amount, std, j + 1, tuple(those)))
        return trials

    def _closer(self, tolerated: Mask, times: Sequence[float]) -> list[_Trial]:
        """So many times smaller tolerances of these parameters (p,)."""
        which = np.diag(tolerated[self.problem.parameters.free].astype(float))
        stds = [np.sqrt(np.diag(_inverse(self._information + (k**2 - 1) * which))) for k in times]
        return [_Trial("tolerances", k, std) for k, std in zip(times, stds, strict=True)]


def changed(problem: Problem, x: Matrix, rows: Index, turned: Index, change: Matrix) -> tuple[Problem, Mask]:
    """Shots like the `rows` (M,) of aimed ones with one joint of each, `turned` (M,), rotated by `change`
    (M,) rad or mm, and aimed again by others at x (p,); (M,) whether each meets its target within the limits.
    """
    joints, weights, each = problem.joints[rows].copy(), servo_joints(problem)[rows], np.arange(len(rows))
    joints[each, turned] += change
    weights[each, turned] = 0.0
    aimed = aim(problem.select(rows).moved(joints), x, weights)
    inside = ~beyond_limits(problem.robot, aimed.problem.joints, 0.0).any(axis=1)
    return aimed.problem, aimed.hit & aimed.ahead & inside


def carried_out(problem: Problem, x: Matrix, tried: Tried, numbers: Sequence[int]) -> Problem:
    """The new shots of a change of postures of aimed shots, which `numbers` (N,) call, in the order of its
    `postures`."""
    assert tried.joint is not None
    amount = tried.amount / problem.robot.joints[tried.joint - 1].display
    rows = np.array([list(numbers).index(number) for number in tried.postures])
    change = amount * in_turn(problem)[rows] if tried.how == "vary" else np.full(len(rows), amount)
    return changed(problem, x, rows, np.full(len(rows), tried.joint - 1), change)[0]


def in_turn(problem: Problem) -> Matrix:
    """(N,) shares of a spread, in turn over the measurements of each target."""
    share = np.empty(problem.shots)
    for k in np.unique(problem.target_index):
        rows = np.flatnonzero(problem.target_index == k)
        share[rows] = np.resize(IN_TURN, len(rows))
    return share


def _moved(problem: Problem, i: int) -> list[int]:
    """The joints of a shot that may be changed: those that the servo does not turn, else all."""
    servo = servo_joints(problem)[i]
    return np.flatnonzero(servo == 0).tolist() or list(range(problem.robot.n))


def _spaced(count: int, most: int) -> Index:
    """So many places at the most, evenly among `count`."""
    return np.linspace(0, count - 1, min(count, most)).round().astype(np.int64)


def _square(roots: Matrix) -> Matrix:
    """(f, f) the information of shots by their roots (M, d, f)."""
    flat = roots.reshape(-1, roots.shape[-1])
    return np.asarray(flat.T @ flat)


def _inverse(information: Matrix) -> Matrix:
    return np.asarray(np.linalg.inv(information), dtype=float)


def _with(covariance: Matrix, roots: Matrix) -> Matrix:
    """(M, f) stds after one more shot, by its root (M, d, f) of information and the covariance (f, f) or
    (M, f, f) before it; infinite where rounding leaves nothing of them."""
    gained = roots @ covariance  # (M, d, f)
    inner = gained @ roots.transpose(0, 2, 1) + np.eye(roots.shape[1])
    before = np.diagonal(covariance, axis1=-2, axis2=-1)
    after = before - (gained * np.linalg.solve(inner, gained)).sum(axis=1)
    return np.sqrt(np.where(after > _ROUNDING * before, after, np.inf))
