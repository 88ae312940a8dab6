"""Fits of hypotheses: each with all else as it is, at the stated noise, and what it leaves.

The best of a class is found by fits side by side; of many measurements a part is tried first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy

from ...model.arrays import Index, Matrix
from ...model.likelihood.density import Density
from ...model.likelihood.parameters import Parameters
from ...model.likelihood.problem import Problem
from ..estimation.fit import CONTRADICTED, LikelihoodFit, modes, start_at
from ..placements import placements
from .displacement import displacement
from .hypotheses import Cause, Change, changes, widened

CHANCE = 1e-3  # that what is left is noise, that a gain is chance, that a rival is the better one
HALVED = 0.5  # what does not agree with the noise has to leave no more than this share of the residuals
REDUCED = 0.75  # the same of link geometry: beyond it arms deflect, by as much again
_FAR = 4.0  # prior stds beyond which an estimate contradicts its prior
_FEW_STEPS = 60  # of a first try
_ROUNDS = 10  # in which measurements that stand out are left out
_EXACT = 60  # measurements up to which each is left out in turn, and every change point is tried
_CHANGE_POINTS = 5  # that the linearised test proposes, of more measurements
_LARGEST = 1e300


class _Effort(NamedTuple):
    """`first` measurements on which the hypotheses are tried first, where there are more; the best
    `confirmed` of those that explain them go on to all."""

    first: int
    confirmed: int


_COLUMNS = _Effort(150, 6)
_TWISTS = _Effort(60, 2)  # the functions of a robot with twists as joints are not compiled


@dataclass(frozen=True)
class Left:
    """What a hypothesis leaves: `chi2` of the residuals at the stated noise, with `dof`; `cost` the same with
    the squares of the estimates in prior stds; `numbers` counts the residuals, and `farthest` is the largest
    distance of an estimate from its prior mean in prior stds. `freed` parameters are chosen to suit the data
    (their effective number, where tolerances bound them), out of exp(`log_choices`) ways to do so, and
    `volume` is that of a `Change`."""

    cause: Cause | None
    chi2: float
    cost: float
    numbers: int
    dof: int
    farthest: float
    joints: tuple[int, ...] = ()
    targets: tuple[str, ...] = ()
    measurements: tuple[int, ...] = ()
    amount: float = 0.0
    freed: float = 0
    log_choices: float = 0.0
    volume: float = 0.0

    @property
    def factor(self) -> float:
        """The residual over the noise; over all numbers where the fit leaves none over."""
        return float(np.sqrt(self.chi2 / (self.dof or self.numbers)))

    def agrees(self, slack: float) -> bool:
        """Whether residuals and estimates are what noise (up to `slack` times) and priors allow."""
        chi2 = self.chi2 / slack**2
        total = chi2 + self.cost - self.chi2
        return (
            self.farthest <= _FAR
            and bool(scipy.special.chdtrc(self.numbers, total) >= CONTRADICTED)
            and (self.dof <= 0 or bool(scipy.special.chdtrc(self.dof, chi2) >= CHANCE))
        )

    def explains(self, base: Left, slack: float) -> bool:
        """Whether it agrees, or leaves at most half of the residuals; with links within tolerances, which no
        arm is without, three quarters are enough."""
        if self.cause == "geometry" and self.farthest <= _FAR:
            return self.agrees(slack) or self.factor <= REDUCED * base.factor
        return self.agrees(slack) or self.factor <= HALVED * base.factor


def lefts(
    density: Density,
    start: Matrix,
    of: Index | None = None,
    *,
    most_steps: int = 200,
) -> tuple[Matrix, list[Left]]:
    """The modes x (W, p) from each start, and what is left there, of no cause yet."""
    x = modes(density, start, of, most_steps=most_steps).x
    return x, lefts_at(density, x, of)


def lefts_at(density: Density, x: Matrix, of: Index | None = None) -> list[Left]:
    """What is left at each x (W, p), of no cause yet."""
    problem = density.problem
    slopes = density.slopes(x, of)
    z = density.scaled(x)
    distances = len(problem.distances)
    numbers = np.broadcast_to(density.numbers(of), len(x)) + distances
    information = slopes.information - np.eye(density.size)
    finite = np.isfinite(information).all(axis=(1, 2))
    rank = np.zeros(len(x), dtype=int)
    rank[finite] = (np.linalg.eigvalsh(information[finite]) >= 1.0).sum(axis=1)
    cost = np.nan_to_num(-2 * slopes.value, nan=_LARGEST, posinf=_LARGEST)
    squares = (z**2).sum(axis=1)
    return [
        Left(
            cause=None,
            chi2=max(float(cost[w] - squares[w]), 0.0),
            cost=float(cost[w]),
            numbers=int(numbers[w]),
            dof=max(int(numbers[w] - rank[w]), 0),
            farthest=float(np.abs(z[w]).max(initial=0.0)),
        )
        for w in range(len(x))
    ]


def tried(problem: Problem, x: Matrix, base: Left, fit: LikelihoodFit, slack: float) -> Iterator[Left]:
    """What every hypothesis leaves of a problem at known noise. The fit as recorded ended at x (p,) and
    leaves `base`; `fit` is the same at the noise as the header has it, `slack` that of `Left.agrees`."""
    yield from _of_changes(problem, list(changes(problem, x)), base, slack, _COLUMNS)
    wide = widened(problem)
    if wide is not None:
        yield from _of_changes(wide.problem, list(wide.changes(problem.joints)), base, slack, _TWISTS)
    yield from _without_a_placement(problem, x, base)
    yield from _without_measurements(problem, x, base, slack)
    yield from _with_a_moved_target(problem, base, fit)


def _of_changes(
    problem: Problem, hypotheses: list[Change], base: Left, slack: float, effort: _Effort
) -> list[Left]:
    """With other recorded positions."""
    rows = _thinned(problem, effort.first)
    few = problem.select(rows)
    recorded = np.array([change.recorded for change in hypotheses])
    x, left = _with_joints(few, recorded[:, rows], None)
    if few.shots < problem.shots:
        explains = [i for i, own in enumerate(left) if own.explains(base, slack)]
        best = sorted(explains, key=lambda i: left[i].cost)[: effort.confirmed]
        confirmed = _with_joints(problem, recorded[best], x[best])[1] if best else []
        share = problem.data_size / few.data_size
        left = [_scaled_up(own, share, problem.data_size) for own in left]
        for i, own in zip(best, confirmed, strict=True):
            left[i] = own
    return [
        replace(
            own,
            cause=change.cause,
            joints=change.joints,
            amount=change.amount,
            freed=change.freed,
            volume=change.volume,
        )
        for change, own in zip(hypotheses, left, strict=True)
    ]


def _scaled_up(left: Left, share: float, numbers: int) -> Left:
    """What a part of the measurements leaves, as if it were all; never taken for an agreement."""
    chi2 = left.chi2 * share
    return replace(left, chi2=chi2, cost=_LARGEST, numbers=numbers, dof=max(int(left.dof * share), 1))


def _with_joints(problem: Problem, recorded: Matrix, start: Matrix | None) -> tuple[Matrix, list[Left]]:
    """What is left with other recorded positions (W, N, n), each from zero offsets or from `start` (W, p)."""
    density, rows = Density(problem, recorded), np.arange(len(recorded))
    first = start is None
    if start is None:
        start = start_at(problem, np.zeros((len(recorded), density.size)), recorded)
    return lefts(density, start, rows, most_steps=_FEW_STEPS if first else 200)


def _thinned(problem: Problem, most: int) -> Index:
    """The places of some measurements of each target, evenly over its own; all where they are few."""
    if problem.shots <= most:
        return np.arange(problem.shots)
    each = max(3, most // len(problem.targets))
    chosen = []
    for k in range(len(problem.targets)):
        own = np.flatnonzero(problem.target_index == k)
        chosen.append(
            own[np.unique(np.linspace(0, len(own) - 1, each).round().astype(int))] if len(own) else own
        )
    return np.sort(np.concatenate(chosen))


def _without(problem: Problem, x: Matrix, weights: Matrix, base: Left) -> list[Left]:
    """What is left with weights (W, N) of the measurements, from x (p,) and from zero offsets."""
    density = Density(problem).weighted(weights)
    count = len(weights)
    plain = start_at(problem, np.zeros((1, density.size)))
    of = np.tile(np.arange(count), 2)
    start = np.concatenate([np.tile(x, (count, 1)), np.tile(plain, (count, 1))])
    _, left = lefts(density, start, of, most_steps=_FEW_STEPS)
    better = [min(left[w], left[w + count], key=lambda own: own.cost) for w in range(count)]
    return [replace(own, freed=max(base.dof - own.dof, 1)) for own in better]


def _without_a_placement(problem: Problem, x: Matrix, base: Left) -> list[Left]:
    """Without the measurements of one placement, where there are two placements or more."""
    every = placements(problem)
    if len(every) < 2:
        return []
    weights = np.ones((len(every), problem.shots))
    for w, placement in enumerate(every):
        weights[w, placement.rows] = 0.0
    return [
        replace(own, cause="placement", targets=placement.targets)
        for placement, own in zip(every, _without(problem, x, weights, base), strict=True)
        if own.dof > 0
    ]


def _without_measurements(problem: Problem, x: Matrix, base: Left, slack: float) -> list[Left]:
    """Without one measurement, and without a few: each more is the one whose loss leaves least."""
    count = problem.shots
    if count > _EXACT:
        return _without_outlying(problem, x, base)
    gone: list[int] = []
    found: list[Left] = []
    for _ in range(min(3, max(1, count // 6))):
        rest = [i for i in range(count) if i not in gone]
        weights = np.ones((len(rest), count))
        weights[:, gone] = 0.0
        weights[np.arange(len(rest)), rest] = 0.0
        left = _without(problem, x, weights, base)
        best = int(np.argmin([own.cost for own in left]))
        gone.append(rest[best])
        if left[best].dof == 0:
            break
        found.append(_as_measurements(problem, left[best], gone))
        if left[best].agrees(slack):
            break
    return found


def _without_outlying(problem: Problem, x: Matrix, base: Left) -> list[Left]:
    """Of many measurements: without those that stand out, again and again until no more do."""
    density, gone = Density(problem), np.zeros(problem.shots, dtype=bool)
    d, left = problem.tool.residual_size, None
    for _ in range(_ROUNDS):
        quads = density.quads(x)
        # One far off pulls all: what stands out is judged by the rest, as long as that is too large.
        scale = max(1.0, float(np.median(quads[~gone]) / scipy.special.chdtri(d, 0.5)))
        off = scipy.special.chdtrc(d, quads / scale) * problem.shots < CHANCE
        if not (off & ~gone).any() or (off | gone).sum() > max(3, problem.shots // 10):
            break
        gone |= off
        moved, (own,) = lefts(density.weighted(1.0 - gone[None]), x[None])
        x, left = moved[0], replace(own, freed=max(base.dof - own.dof, 1))
    return [] if left is None else [_as_measurements(problem, left, np.flatnonzero(gone).tolist())]


def _as_measurements(problem: Problem, left: Left, gone: list[int]) -> Left:
    numbers = tuple(sorted(problem.shot_numbers[i] for i in gone))
    names = tuple(dict.fromkeys(problem.targets[problem.target_index[i]] for i in sorted(gone)))
    n, m = problem.shots, len(gone)
    ways = float(
        scipy.special.gammaln(n + 1) - scipy.special.gammaln(m + 1) - scipy.special.gammaln(n - m + 1)
    )
    return replace(left, cause="measurements", targets=names, measurements=numbers, log_choices=ways)


def _with_a_moved_target(problem: Problem, base: Left, fit: LikelihoodFit) -> list[Left]:
    """With a target at two places, before and after a measurement: of many measurements where the linearised
    test finds it likeliest."""
    order = np.argsort(problem.shot_numbers, kind="stable")
    likely = None
    if problem.shots > _EXACT:
        moved = displacement(fit) if fit.converged else None
        likely = [] if moved is None else [moved.at, *moved.elsewhere[: _CHANGE_POINTS - 1]]
    found = []
    for k, name in enumerate(problem.targets):
        own = order[problem.target_index[order] == k]
        numbers = [problem.shot_numbers[i] for i in own]
        after = [
            at
            for at, pair in enumerate(pairwise(numbers), start=1)
            if likely is None or (name, *pair) in likely
        ]
        if not after:
            continue
        twice = _at_two_places(problem, k, own)
        weights = np.ones((len(after), problem.shots + len(own)))
        for w, at in enumerate(after):
            weights[w, own[at:]] = 0.0
            weights[w, problem.shots : problem.shots + at] = 0.0
        density = Density(twice).weighted(weights)
        start = start_at(twice, np.zeros((len(after), density.size)))
        _, left = lefts(density, start, np.arange(len(after)), most_steps=_FEW_STEPS)
        found += [
            replace(
                own_left,
                cause="moved_target",
                targets=(name,),
                measurements=(numbers[at - 1], numbers[at]),
                freed=max(base.dof - own_left.dof, 1),
            )
            for at, own_left in zip(after, left, strict=True)
            if own_left.dof > 0
        ]
    return found


def _at_two_places(problem: Problem, target: int, own: Index) -> Problem:
    """The problem with its measurements `own` of a target once more behind all others, there at a further
    target."""
    parameters = problem.parameters
    items, end = list(parameters.items), parameters.block("target").stop
    name = f"{problem.targets[target]} moved"
    for item in reversed(items[parameters.block("target", target)]):
        items.insert(end, replace(item, name=f"{name}.{item.axis}", of=name))
    again = problem.select(np.concatenate([np.arange(problem.shots), own]))
    index = again.target_index.copy()
    index[problem.shots :] = len(problem.targets)
    return replace(
        again,
        parameters=Parameters(tuple(items)),
        targets=(*problem.targets, name),
        target_index=index,
        guessed=np.append(problem.guessed, problem.guessed[target]),
    )
