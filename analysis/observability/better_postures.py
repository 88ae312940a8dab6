"""Better postures: random ones that reach their targets, exchanged as an exact design, then moved a little as
long as that helps. A few hundred are enough: what they lack the moves make up for.

`plan optimal` chooses from many more and proves how good the choice is; this says within a fraction of a
second about what it will reach.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...model.arrays import Index, Mask, Matrix
from ...model.files.plan import USUAL, StatedConstraints
from ...model.instruments.kind import Target, TargetEntry
from ...model.kinematics.pendant import beyond_limits
from ...model.likelihood.problem import Problem
from ..design.continuous_design import Candidates, offset_covariance, variance
from ..design.exact_design import exchange, values_with
from .aim import ahead, beam_lengths, brought_to_targets, one_turn
from .clearance import arm_in_the_way
from .predictions import roots_with_ties
from .remedies import Allowed

_DRAWN = 1500  # at once
_POOL, _ENOUGH = 300, 100  # of those that can be measured
_TRIES = 3
_STARTS = ((8, 4), (15, 2))  # up to so many measurements that many starts of the exchange; else one
_ROUNDS = 6
_NEAR = 8  # new postures near each that is chosen, a round
_STEP, _SMALLER = 0.4, 0.7  # rad (or shares of a metre) of the first round, and of each from the one before
_HALVED = (1, 3)  # rounds after which the worse half of the starts is given up
_UNDETERMINED = 0.5  # of its prior: an offset that all postures leave beyond this does not count
_OBEYED = 0.5  # share of the measurements: the usual constraints that fewer keep are not theirs


class PostureSet(NamedTuple):
    """`joints` (C, n) rad or mm, aimed; `like` (C,) which shot of the problem each is like but for its
    joints; `roots` (C, d, f) of their information."""

    joints: Matrix
    like: Index
    roots: Matrix

    def some(self, rows: Index) -> PostureSet:
        return PostureSet(self.joints[rows], self.like[rows], self.roots[rows])


@dataclass(frozen=True, eq=False)
class PostureSearch:
    """Postures for the measurements of an aimed `problem` at x (p,): of its instrument and its targets, which
    a header says `entries` of. Those that are not `allowed`, and in which the arm blocks a beam or a line of
    sight, are left out; `weight` is 1 / noise scale²."""

    problem: Problem
    x: Matrix
    entries: Mapping[str, TargetEntry]
    allowed: Allowed
    weight: float = 1.0

    def best(self, counts: Sequence[int]) -> dict[int, PostureSet]:
        """The best postures by the A-criterion for so many measurements each; none where there are too few
        to choose from."""
        pool, rng = self.pool, deepcopy(self._drawn_first[1])
        counts = [count for count in counts if count < len(pool.joints)]
        offsets = self._counted(pool)
        if not counts or not offsets.any():
            return {}
        candidates = Candidates(pool.roots, offsets)
        order = _greedy(candidates, max(counts))
        designs: list[_Design] = []
        for count in counts:
            starts = next((starts for most, starts in _STARTS if count <= most), 1)
            firsts = [order[:count]]
            firsts += [rng.choice(len(pool.joints), count, replace=False) for _ in range(starts - 1)]
            ends = [exchange(candidates, first, "A")[1] for first in firsts]
            designs += [_Design(pool.some(rows), offsets) for rows in ends]
        for number in range(_ROUNDS):
            self._move(designs, _STEP * _SMALLER**number, rng)
            if number in _HALVED:
                designs = [one for count in counts for one in _better_half(designs, count)]
        best = {count: _better_half(designs, count)[0] for count in counts}
        return {count: one.chosen for count, one in best.items()}

    @property
    def pool(self) -> PostureSet:
        """Random postures that can be measured."""
        return self._drawn_first[0]

    @cached_property
    def _drawn_first(self) -> tuple[PostureSet, np.random.Generator]:
        rng = np.random.default_rng(0)
        return self._drawn(rng), rng

    def next_best(self, covariance: Matrix, error: Matrix, count: int) -> Iterator[tuple[int, float]]:
        """One of the pool after the other, each the one by which a mean squared error becomes
        smallest beside those before it: which, and the error then, tr(C E).

        `covariance` C (f, f) of the scaled free parameters as they are, `error` E (f, f) the squared error by
        them. One measurement with the root R (d, f) leaves C - C R' (1 + R C R')^-1 R C."""
        roots, left = self.pool.roots, covariance
        for _ in range(min(count, len(roots))):
            gained = roots @ left
            inner = gained @ roots.transpose(0, 2, 1) + np.eye(roots.shape[1])
            less = np.trace(
                np.linalg.solve(inner, gained @ error @ gained.transpose(0, 2, 1)), axis1=1, axis2=2
            )
            best = int(np.argmax(less))
            left = left - gained[best].T @ np.linalg.solve(inner[best], gained[best])
            yield best, float(np.trace(left @ error))

    def _drawn(self, rng: np.random.Generator) -> PostureSet:
        robot = self.problem.robot
        low, high = one_turn(robot, robot.lower, robot.upper)
        # Of each target and what reads there the first shot.
        kinds = np.column_stack([self.problem.target_index, self.problem.active])
        like = np.resize(np.sort(np.unique(kinds, axis=0, return_index=True)[1]), _DRAWN)
        pools: list[PostureSet] = []
        while len(pools) < _TRIES and sum(len(pool.like) for pool in pools) < _ENOUGH:
            joints = rng.uniform(low, high, size=(_DRAWN, robot.n))
            pools.append(self._measurable(like, joints, rng)[0])
        whole = PostureSet(*(np.concatenate(parts) for parts in zip(*pools, strict=True)))
        return whole.some(np.arange(min(len(whole.like), _POOL)))

    def _measurable(self, like: Index, joints: Matrix, rng: np.random.Generator) -> tuple[PostureSet, Index]:
        """Those of the joints (C, n), brought to their targets, in which can be measured; and which."""
        problem, x = self.problem, self.x
        which = np.arange(len(joints))
        shots = problem.select(like).moved(joints)
        if problem.tool.beam:
            which = np.flatnonzero(ahead(shots, x))
            shots = shots.select(which)
        aimed, reached = brought_to_targets(shots, x, self.entries, rng)
        fit = np.flatnonzero(
            reached & ahead(aimed, x) & ~beyond_limits(problem.robot, aimed.joints, 0.0).any(axis=1)
        )
        fit = fit[self.allowed(aimed.select(fit))] if len(fit) else fit
        fit = fit[~arm_in_the_way(aimed.select(fit), x, self.entries)] if len(fit) else fit
        aimed, which = aimed.select(fit), which[fit]
        if not len(fit):
            size = int(problem.parameters.free.sum())
            return PostureSet(
                aimed.joints, like[which], np.zeros((0, problem.tool.residual_size, size))
            ), which
        aimed = aimed.at_predicted(x)
        roots = np.sqrt(self.weight) * roots_with_ties(aimed, aimed.whiten(x))
        return PostureSet(aimed.joints, like[which], roots), which

    def _counted(self, pool: PostureSet) -> Mask:
        """(f,) the offsets that all postures together determine."""
        parameters = self.problem.parameters
        offsets = parameters.group("offset")[parameters.free]
        information = np.einsum("cdf,cdg->fg", pool.roots, pool.roots) + np.eye(len(offsets))
        return np.asarray(offsets & (np.sqrt(np.diag(np.linalg.inv(information))) < _UNDETERMINED))

    def _move(self, designs: Sequence[_Design], step: float, rng: np.random.Generator) -> None:
        """Give each posture of the designs the best of some that are near to it, if that is better."""
        joints = np.concatenate([np.repeat(one.chosen.joints, _NEAR, axis=0) for one in designs])
        like = np.concatenate([np.repeat(one.chosen.like, _NEAR) for one in designs])
        scale = np.array([1.0 if j.kind == "revolute" else 1000.0 for j in self.problem.robot.joints])
        near, which = self._measurable(like, joints + step * scale * rng.normal(size=joints.shape), rng)
        first = 0
        for one in designs:
            one.improve(near, which // _NEAR - first)
            first += one.count


class _Design:
    """The postures chosen so far, by the information on the `offsets` (f,)."""

    def __init__(self, chosen: PostureSet, offsets: Mask) -> None:
        self.chosen = PostureSet(chosen.joints.copy(), chosen.like, chosen.roots.copy())
        self._offsets = offsets

    @property
    def count(self) -> int:
        return len(self.chosen.joints)

    @property
    def information(self) -> Matrix:
        """(f, f), the unit prior included."""
        return Candidates(self.chosen.roots, self._offsets).information(np.arange(self.count))

    def improve(self, near: PostureSet, of: Index) -> None:
        """Exchange postures one by one for the best of those `near` them, `of` (C,) which of them."""
        information, joints, roots = self.information, self.chosen.joints, self.chosen.roots
        for k in range(self.count):
            rows = np.flatnonzero(of == k)
            if not len(rows):
                continue
            without = information - roots[k].T @ roots[k]
            some = Candidates(np.concatenate([roots[k : k + 1], near.roots[rows]]), self._offsets)
            values = values_with(some, without, np.asarray(np.linalg.inv(without)), "A")
            best = int(np.argmin(values))
            if best:
                joints[k], roots[k] = near.joints[rows[best - 1]], near.roots[rows[best - 1]]
                information = without + roots[k].T @ roots[k]

    def value(self) -> float:
        covariance = offset_covariance(Candidates(self.chosen.roots, self._offsets), self.information)
        return variance(covariance, "A")


def _better_half(designs: Sequence[_Design], count: int) -> list[_Design]:
    """Of those with so many measurements."""
    same = sorted((one for one in designs if one.count == count), key=_Design.value)
    return same[: -(-len(same) // 2)]


def _greedy(candidates: Candidates, count: int) -> Index:
    """One candidate after the other, each the best beside those before it."""
    rows: list[int] = []
    information = np.eye(candidates.roots.shape[2])
    for _ in range(count):
        values = values_with(candidates, information, np.asarray(np.linalg.inv(information)), "A")
        values[rows] = np.inf
        rows.append(int(np.argmin(values)))
        information = information + candidates.roots[rows[-1]].T @ candidates.roots[rows[-1]]
    return np.array(rows)


def usual_constraints(problem: Problem, x: Matrix) -> StatedConstraints:
    """The constraints of `plan optimal` that aimed shots keep, where nothing is stated."""
    if not problem.tool.beam:
        return StatedConstraints(margin_deg=USUAL.margin_deg)
    if np.count_nonzero(_faced(USUAL, problem, x)) >= _OBEYED * problem.shots:
        return USUAL
    return StatedConstraints(margin_deg=USUAL.margin_deg, beam_mm=USUAL.beam_mm)


def kept(
    constraints: StatedConstraints, problem: Problem, x: Matrix, entries: Mapping[str, TargetEntry]
) -> Mask:
    """(N,) which aimed shots keep to what constraints say of joints and beams, and can be measured: all but
    what the arm and the beam may hit."""
    margin = np.radians(constraints.margin_deg or 0.0)
    slack = np.array([margin * (1.0 if j.kind == "revolute" else 1000.0) for j in problem.robot.joints])
    fine: Mask = np.asarray(~beyond_limits(problem.robot, problem.joints, -slack).any(axis=1))
    if problem.tool.beam and constraints.beam_mm is not None:
        length, _ = beam_lengths(problem, x)
        fine &= (length >= constraints.beam_mm[0]) & (length <= constraints.beam_mm[1])
    if problem.tool.beam and constraints.facing is not None:
        fine &= _faced(constraints, problem, x)
    poses, targets = problem.poses(x), problem.split(x).targets
    for k in np.unique(problem.target_index).tolist():
        rows = np.flatnonzero(problem.target_index == k)
        target = Target(targets[k], entries.get(problem.targets[k]))
        for mask in problem.tool.prevented(poses[rows], target, problem.tool.variants[0]).values():
            fine[rows] &= ~mask
    return fine


def _faced(constraints: StatedConstraints, problem: Problem, x: Matrix) -> Mask:
    """(N,) which beams come to the front of the detector, no flatter than is allowed."""
    assert constraints.facing is not None
    normal = np.array(constraints.facing) / np.linalg.norm(constraints.facing)
    _, direction = beam_lengths(problem, x)
    return np.asarray(-(direction @ normal) >= np.cos(np.radians(constraints.acceptance)))
