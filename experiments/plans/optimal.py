"""Making a plan: the best k of many candidate postures, in an order that shortens the travel."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import numpy as np

from ...analysis.design.continuous_design import Candidates, Criterion
from ...analysis.design.exact_design import Design, design
from ...analysis.observability.identifiability import identify
from ...analysis.observability.power import DetectionPower, WrongModel, change_risk, halves, powers
from ...analysis.observability.predictions import (
    CurvePoint,
    mounted_spread,
    predicted_std,
    roots_with_ties,
    typical,
)
from ...model.arrays import Index, Matrix
from ...model.errors import BadInput
from ...model.files.header import Header
from ...model.instruments.kind import Measurement
from ...model.kernel import one_blas_thread
from ...model.kinematics.robot import Robot
from ...model.likelihood.problem import Problem
from ...model.records import it
from ...words.numbers import percent
from ...words.observability import power_limit
from ..processes import on_cluster
from .candidates import CandidatePostures, Planned, pools_in_words

_UNDETERMINED = 0.5  # of its prior: an offset that all candidates leave beyond this is not planned for
_EXACT_ORDER = 9  # measurements up to which the shortest order is found for certain
_LOOSEN = "loosen what removes most, move the target, or ask for more candidates"
_OF_TYPICAL = 20  # candidates, by which a place of what is guessed on the flange is typical
_SEVERAL = 300  # candidates: what these together do not notice, no plan of them does
_COUNTED: frozenset[WrongModel] = frozenset({"tool", "jump", "backlash", "noise"})  # that a plan must notice
_CHOICES = 60  # of what is measured again
_SPEED = 1.0  # rad/s (m/s) where the robot file states none


@dataclass(frozen=True, eq=False)
class Proposal:
    """An optimal plan. `postures` (k, n) rad or mm in travel order, in which `planned` (k,) are measured, and
    then some of them again: `again` (k,) are the rows that they repeat, None of those that are new;
    `std` of each offset that is not held, by name, in degrees (mm), the prior included: one that is near its
    prior is not determined by the measurements; `travel_s` from the first posture to the last at full joint
    speed, None where the robot file states no speeds; `candidates` how many there were to choose from;
    `converged` False where the steps for the bound were used up, so that it may be lower than it could be;
    `power` that of a run against wrong models, `unnoticed` those of them that no plan of these candidates
    notices, where they do harm."""

    postures: Matrix
    planned: tuple[Planned, ...]
    again: tuple[int | None, ...]
    criterion: Annotated[Criterion, it("null for a pattern, as all of the choice is")]
    std: dict[str, float]
    value: Annotated[float, it("of the criterion")]
    bound: Annotated[float, it("a lower bound for all plans from these candidates")]
    efficiency: Annotated[float, it("bound over value: the plan is at least that good")]
    support: Annotated[int, it("number of postures in the continuous design behind the bound")]
    travel_s: Annotated[
        float | None,
        it(
            "time of the moves at full joint speeds, in the order of the file; null if the robot file states"
            " no speeds"
        ),
    ]
    candidates: Annotated[int, it("number of candidate postures")]
    converged: Annotated[
        bool,
        it("false where the steps for the bound were used up: it holds, and `efficiency` may be higher"),
    ]
    power: tuple[DetectionPower, ...]
    unnoticed: tuple[DetectionPower, ...]

    @property
    def worst(self) -> float:
        return max(self.std.values())

    @property
    def lacking(self) -> tuple[DetectionPower, ...]:
        """The wrong models that a run may not notice although other plans would, and that do harm."""
        counted = _COUNTED - {each.wrong for each in self.hopeless}
        return tuple(each for each in self.power if each.harmful and each.wrong in counted)

    @property
    def hopeless(self) -> tuple[DetectionPower, ...]:
        """The wrong models that a run may not notice, as any of these candidates, and that do harm."""
        kinds = {each.wrong for each in self.unnoticed}
        return tuple(each for each in self.power if each.harmful and each.wrong in kinds)


@dataclass(frozen=True, eq=False)
class Fewest:
    """The answer to "how many measurements?". `proposal` is None where no number up to `most` is enough;
    `curve` lists the numbers of measurements that were tried, up to that of the answer."""

    tolerance: Annotated[float, it("as requested")]
    most: Annotated[int, it("as requested")]
    proposal: Proposal | None
    curve: tuple[CurvePoint, ...]
    limit: Annotated[str | None, it("why no number of measurements is enough, in words; null if one is")]


class Planner:
    """Chooses measurements for one header and robot from candidate postures: of each instrument so many."""

    def __init__(
        self,
        header: Header,
        robot: Robot,
        targets: Mapping[str, Matrix],
        pools: Sequence[CandidatePostures],
        repeat: int = 0,
    ) -> None:
        """`targets` are the numbers (3,) of those of which the header does not say them. Measurements are
        chosen for a typical place of reflectors, mounts and tips that are only guessed; `repeat` of them are
        made again at the end."""
        self._repeat = repeat
        self._removed = pools_in_words(pools)
        self._robot, self._postures = robot, np.concatenate([pool.postures for pool in pools])
        if not len(self._postures):
            raise BadInput("no posture is fit for a plan", found=self._removed, remedy=_LOOSEN)
        self._planned = [pool.planned for pool in pools for _ in pool.postures]
        self._labels = tuple(dict.fromkeys(each.instrument for each in self._planned))
        measured = [[Measurement(*each, {})] for each in self._planned]
        self._problem = Problem.of_measured(header, robot, self._postures, measured, planned=True)
        self._x = self._problem.nominal()
        for name, numbers in targets.items():
            block = self._problem.parameters.block("target", self._problem.targets.index(name))
            self._x[block] = numbers
        self._guessed, self._at_guess = self._problem.at_predicted(self._x), self._x
        self._mounted = mounted_spread(header, self._problem)
        few = np.arange(len(self._postures))[:: max(len(self._postures) // _OF_TYPICAL, 1)]
        _, self._x = typical(self._guessed.select(few), self._at_guess, self._mounted)
        self._problem = self._problem.at_predicted(self._x)
        parameters = self._problem.parameters
        free = parameters.free
        whitened = self._problem.whiten(self._x)
        self._factor = whitened.factor
        roots = roots_with_ties(self._problem, whitened)
        self._offsets = [item for item in parameters.items if item.group == "offset" and not item.held]
        if not self._offsets:
            raise BadInput("there is nothing to plan for: every offset is held", remedy="free some in `held`")
        self._columns = np.flatnonzero(parameters.group("offset")[free])
        # What all candidates together leave unidentifiable would swamp the criterion with its prior.
        information = np.einsum("cdf,cdg->fg", roots, roots) + np.eye(roots.shape[2])
        determined = np.sqrt(np.diag(np.linalg.inv(information))) < _UNDETERMINED
        offsets = parameters.group("offset")[free] & determined
        if not offsets.any():
            raise BadInput(
                "no measurement at this target makes any offset identifiable",
                found=f"all {len(self._postures)} candidates together carry almost no information",
                remedy="hold what is unidentifiable (`held`), or calibrate the tool",
            )
        self._all_determined = bool(determined[self._columns].all())
        groups = np.array([self._labels.index(each.instrument) for each in self._planned])
        self.candidates = Candidates(roots, offsets, groups)
        step = len(self._postures) // _SEVERAL if len(pools) > 1 else 1  # some of every pool
        several = self._problem.select(np.arange(len(self._postures))[:: max(step, 1)][:_SEVERAL])
        self._unnoticed = tuple(
            each for each in powers(several, self._x, identify(several, self._x)) if each.harmful
        )

    def optimal(
        self,
        shots: int | Mapping[str, int],
        criterion: Criterion = "A",
        *,
        seed: int = 0,
        starts: int | None = None,
    ) -> Proposal:
        """The best plan of that many measurements, or of so many by each instrument (by its label), that was
        found, with its certified efficiency."""
        return self._proposal(self._design(shots, criterion, seed, starts))

    def _design(
        self, shots: int | Mapping[str, int], criterion: Criterion, seed: int, starts: int | None = None
    ) -> Design:
        by_label = {self._labels[0]: shots} if isinstance(shots, int) else shots
        if set(by_label) != set(self._labels):
            raise BadInput(
                "it is not said how many measurements each instrument makes",
                found=", ".join(by_label),
                allowed=", ".join(self._labels),
            )
        counts = [by_label[label] for label in self._labels]
        for group, count in enumerate(counts):
            if count < 1:
                raise BadInput("a plan has at least one measurement", found=count)
            if count > (self.candidates.group == group).sum():
                raise BadInput(
                    "there are fewer candidates than measurements",
                    found=f"{count} measurements; {self._removed}",
                    remedy=_LOOSEN,
                )
        with one_blas_thread():
            return design(self.candidates, counts, criterion, seed, starts, on_cluster)

    def fewest(self, tolerance: float, most: int, criterion: Criterion = "A", *, seed: int = 0) -> Fewest:
        """The fewest measurements, up to `most`, whose worst predicted std (deg; mm) is within `tolerance`,
        and that notice every wrong model that some plan notices and that does harm."""
        if not tolerance > 0:
            raise BadInput("the tolerance is not above 0", found=tolerance)
        unknowns = self._problem.parameters.without_tolerance
        least = max(2, -(-unknowns // round(float(self._problem.sizes.max()))))
        if most < least:
            raise BadInput(
                "too few measurements to identify the offsets",
                found=most,
                allowed=f"{least} measurements or more",
            )
        designs: dict[int, Design] = {}
        made: dict[int, Proposal] = {}

        def enough(shots: int) -> bool:
            designs[shots] = self._design(shots, criterion, seed)
            made[shots] = proposal = self._proposal(designs[shots])
            return proposal.worst <= tolerance and not proposal.lacking

        low, high = least, most
        # An unidentifiable offset keeps every number from the tolerance: one is enough to show it.
        reached = enough(most) and self._all_determined
        while reached and low < high:
            middle = (low + high) // 2
            low, high = (low, middle) if enough(middle) else (middle + 1, high)
        proposal = made[high]
        curve = tuple(CurvePoint(shots, made[shots].worst) for shots in sorted(made) if shots <= high)
        if reached:
            return Fewest(tolerance, most, proposal, curve, None)
        short = proposal.worst > tolerance or not proposal.lacking
        limit = self._limit(designs[most], tolerance) if short else power_limit(proposal.lacking)
        return Fewest(tolerance, most, None, curve, limit)

    def _limit(self, chosen: Design, tolerance: float) -> str:
        """The limit of the worst offset's std in words: a gauge, spot noise or joint noise."""
        worst, variance, prior, spot = self._parts(chosen.rows)
        if prior > 0.5:
            return (
                f"the measurements carry almost no information about {worst}: {percent(prior)} of what would"
                " be known of it is the prior (`zerobeam check` on a plan of this kind says why)"
            )
        joint = 1 - prior - spot
        source, share = ("the spot noise", spot) if spot > joint else ("the joint noise", joint)
        needed = int(np.ceil(len(chosen.rows) * variance / tolerance**2))
        return (
            f"{source} (it makes {percent(share)} of the variance of {worst}, the worst); u falls with the"
            f" root of the number of measurements, so some {needed} would be needed"
        )

    def _parts(self, rows: Index) -> tuple[str, float, float, float]:
        """Of a plan: its worst offset, that offset's variance (deg^2; mm^2), and the shares of it that the
        prior and the spot noise make; the rest is the joint noise's."""
        inverse = np.linalg.inv(self.candidates.information(rows))
        display = np.array([item.prior_std * item.display for item in self._offsets])
        variances = np.diag(inverse)[self._columns] * display**2
        worst = int(np.argmax(variances))
        column = inverse[:, self._columns[worst]]
        total = float(column[self._columns[worst]])
        # With C the covariance and A the whitened rows, C = C (A'A + 1) C: each noise enters through A C.
        through = self.candidates.roots[rows] @ column
        back = np.linalg.solve(self._factor[rows].transpose(0, 2, 1), through[:, :, None])
        sources = self._problem.of_sources(self._problem.noise.variances).sum(axis=0)[rows]
        spot = float((sources * back[:, :, 0] ** 2).sum())
        return (
            self._offsets[worst].name,
            float(variances[worst]),
            float(column @ column) / total,
            spot / total,
        )

    def _proposal(self, chosen: Design) -> Proposal:
        order, again, travel = self._order(chosen.rows)
        measurements, x = typical(self._guessed.select(order), self._at_guess, self._mounted)
        scaled = predicted_std(measurements, x)[self._columns]  # as `check` promises it
        unit = np.mean([(item.prior_std * item.display) ** 2 for item in self._offsets])
        return Proposal(
            postures=self._postures[order],
            planned=tuple(self._planned[i] for i in order.tolist()),
            again=again,
            criterion=chosen.criterion,
            std={
                item.name: float(std) * item.prior_std * item.display
                for item, std in zip(self._offsets, scaled, strict=True)
            },
            value=chosen.value * float(unit),
            bound=chosen.bound * float(unit),
            efficiency=chosen.efficiency,
            support=chosen.support,
            travel_s=travel if all(j.speed is not None for j in self._robot.joints) else None,
            candidates=len(self._postures),
            converged=chosen.converged,
            power=powers(measurements, x, identify(measurements, x)),
            unnoticed=self._unnoticed,
        )

    def _order(self, rows: Index) -> tuple[Index, tuple[int | None, ...], float]:
        """Two halves between which a jump of a joint's zero is noticed, each in an order that makes the way
        short, and what is measured first again at the end; which each repeats; and the time of the way, s."""
        first, second = (
            rows[half][travel_order(self._robot, self._postures[rows[half]])[0]]
            for half in halves(self._problem.select(rows), self._x)
        )
        ways = [np.concatenate([a, b]) for a in (first, first[::-1]) for b in (second, second[::-1])]
        way = min(ways, key=lambda one: travel_time(self._robot, self._postures[one]))
        count = min(self._repeat, len(way))
        if count:
            # What is measured again has the same offsets in a pass.
            identified = identify(self._problem.select(way), self._x)
            way = min(
                self._with_repeats(way, count),
                key=lambda one: change_risk(self._problem.select(one), self._x, identified),
            )
        again = (None,) * len(rows) + tuple(range(count))
        return way, again, travel_time(self._robot, self._postures[way])

    def _with_repeats(self, way: Index, count: int) -> Iterator[Index]:
        """The way with so many of its measurements first and again at the end, for choices of them at
        random."""
        rng = np.random.default_rng(0)
        for _ in range(_CHOICES):
            chosen = np.zeros(len(way), dtype=bool)
            chosen[rng.choice(len(way), count, replace=False)] = True
            yield np.concatenate([way[chosen], way[~chosen], way[chosen]])


def travel_order(robot: Robot, postures: Matrix) -> tuple[list[int], float]:
    """Order of the postures (k, n) that makes the way short, and its time in s at full joint speeds.

    The slowest joint sets the time of a move. Exact for few postures (dynamic programming, Held & Karp
    1962), else nearest neighbour from the best start, improved by reversing stretches (2-opt).
    """
    time = (np.abs(postures[:, None] - postures[None]) / _speed(robot)).max(axis=2)
    order = _shortest(time) if len(time) <= _EXACT_ORDER else _two_opt(time)
    return order, float(sum(time[a, b] for a, b in pairwise(order)))


def travel_time(robot: Robot, postures: Matrix) -> float:
    """Time of the way from the first of the postures (k, n) to the last, s, at full joint speeds."""
    return float((np.abs(np.diff(postures, axis=0)) / _speed(robot)).max(axis=1).sum())


def _speed(robot: Robot) -> Matrix:
    unit = [1.0 if joint.kind == "revolute" else 1000.0 for joint in robot.joints]
    return np.array([joint.speed or _SPEED * u for joint, u in zip(robot.joints, unit, strict=True)])


def _shortest(time: Matrix) -> list[int]:
    count = len(time)
    best: dict[tuple[int, int], tuple[float, int]] = {(1 << i, i): (0.0, -1) for i in range(count)}
    for visited in range(1, 1 << count):
        for last in range(count):
            if (visited, last) not in best:
                continue
            so_far = best[visited, last][0]
            for following in range(count):
                if visited & (1 << following):
                    continue
                key, total = (visited | (1 << following), following), so_far + time[last, following]
                if key not in best or total < best[key][0]:
                    best[key] = (total, last)
    everything = (1 << count) - 1
    last = min(range(count), key=lambda i: best[everything, i][0])
    order, visited = [], everything
    while last >= 0:
        order.append(last)
        before = best[visited, last][1]
        visited, last = visited & ~(1 << last), before
    return order[::-1]


def _two_opt(time: Matrix) -> list[int]:
    count = len(time)
    orders = []
    for start in range(count):
        order = [start]
        while len(order) < count:
            rest = np.setdiff1d(np.arange(count), order)
            order.append(int(rest[np.argmin(time[order[-1], rest])]))
        orders.append(order)
    order = min(orders, key=lambda o: _length(time, o))
    improved = True
    while improved:
        improved = False
        for i in range(count - 1):
            for j in range(i + 1, count):
                other = order[:i] + order[i : j + 1][::-1] + order[j + 1 :]
                if _length(time, other) < _length(time, order) - 1e-12:
                    order, improved = other, True
    return order


def _length(time: Matrix, order: Sequence[int]) -> float:
    return float(sum(time[a, b] for a, b in pairwise(order)))
