"""Hypotheses on what is wrong with a recording or a robot file, and what a fit of each leaves.

Columns exchanged, signs, zeros, units and coupled joints are changes of what was recorded: data sets of one
problem, which one batch of fits tries; of many measurements a part is tried first. A twist of the robot file
with the wrong sign becomes one too, for a robot with one more joint in every twisted link, about the common
normal of the two axes: it is at 0 where the file is right, and at minus twice the twist where its sign is
wrong. All else is as it is in each fit, at the stated noise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import Literal, NamedTuple

import numpy as np
import scipy

from ...model.arrays import Index, Matrix
from ...model.kinematics.robot import Joint, Robot
from ...model.likelihood.constraint import ShotFunctions
from ...model.likelihood.density import Density
from ...model.likelihood.geometry import NOMINAL
from ...model.likelihood.parameters import Parameter, Parameters
from ...model.likelihood.problem import Problem
from ..displacement import displacement
from ..estimation.fit import CONTRADICTED, LikelihoodFit, modes, start_at
from ..observability.geometry import with_links
from ..placements import placements

Cause = Literal[
    "swapped_joints",
    "sign",
    "zero",
    "units",
    "coupling",
    "twist",
    "placement",
    "measurements",
    "moved_target",
    "geometry",
]

_PARALLEL = 1e-6  # sine of a twist below which it has no sign
_TWO_TURNS = 4 * np.pi  # rad: further no arm goes, and no angle is recorded
_QUARTERS = (90.0, -90.0, 180.0)
_Z = np.array([0.0, 0.0, 1.0])
SIGNIFICANCE = 1e-3  # p-value of residuals by noise and of a gain by chance; likelihood ratio to a rival
HALVED = 0.5  # what does not agree with the noise has to leave no more than this share of the residuals
REDUCED = 0.75  # the same of link geometry: beyond it arms deflect, by as much again
_FAR = 4.0  # prior stds beyond which an estimate contradicts its prior
_FEW_STEPS = 60  # of a first try
_ROUNDS = 10  # of leaving outliers out
_EXACT = 60  # measurements up to which each is left out in turn, and every change point is tried
_CHANGE_POINTS = 5  # that the linearised test proposes, of more measurements
_LARGEST = 1e300


@dataclass(frozen=True, eq=False)
class Change:
    """One thing that may be wrong, and the positions (N, n) that would have been recorded without it.

    `joints` are numbered from 1: those concerned; of a twist the joints before and behind the link, or the
    last one for the link that ends in the flange. `amount` is what is added to a zero (deg), the factor of
    units, or how many times joint 2 is added to joint 3. `freed` counts the parameters chosen to suit the
    data, and `volume` is the logarithm of the factor by which positions shrink.
    """

    cause: Cause
    joints: tuple[int, ...]
    recorded: Matrix
    amount: float = 0.0
    freed: int = 0
    volume: float = 0.0


def changes(problem: Problem, x: Matrix) -> Iterator[Change]:
    """All changes of the recorded positions worth trying; `x` (p,) is where the fit as recorded ended."""
    robot, recorded = problem.robot, problem.joints
    kinds = [joint.kind for joint in robot.joints]
    revolute = [i for i, kind in enumerate(kinds) if kind == "revolute"]
    for i, j in combinations(range(robot.n), 2):
        if kinds[i] == kinds[j]:
            swapped = recorded.copy()
            swapped[:, [i, j]] = recorded[:, [j, i]]
            yield Change("swapped_joints", (i + 1, j + 1), swapped)
    for i in range(robot.n):
        reversed_ = recorded.copy()
        reversed_[:, i] *= -1
        yield Change("sign", (i + 1,), reversed_)
    for i in revolute:
        for degrees in _QUARTERS:
            yield Change("zero", (i + 1,), _added(recorded, i, np.radians(degrees)), degrees)
    yield from _far_zeros(problem, x, revolute)
    yield from _units(recorded, revolute)
    if robot.n > 2 and kinds[1:3] == ["revolute"] * 2:
        for times in (1.0, -1.0):
            yield Change("coupling", (2, 3), _added(recorded, 2, times * recorded[:, 1]), times)


def _added(recorded: Matrix, joint: int, what: Matrix | float) -> Matrix:
    result = recorded.copy()
    result[:, joint] += what
    return result


def _far_zeros(problem: Problem, x: Matrix, revolute: list[int]) -> Iterator[Change]:
    """Zeros as far off as the fit as recorded has them, where that is beyond the prior and no quarter."""
    parameters = problem.parameters
    block = parameters.block("offset")
    off, std = x[block], parameters.prior_std[block]
    for i in revolute:
        quarter = np.pi / 2 * np.round(off[i] / (np.pi / 2))
        near = quarter != 0 and abs(off[i] - quarter) <= 4 * std[i]
        if parameters.free[block][i] and abs(off[i]) > 4 * std[i] and not near:
            degrees = float(np.degrees(off[i]))
            yield Change("zero", (i + 1,), _added(problem.joints, i, float(off[i])), degrees, freed=1)


def _units(recorded: Matrix, revolute: list[int]) -> Iterator[Change]:
    """Radians that were taken for degrees, or degrees that were converted to degrees once more."""
    largest = float(np.abs(recorded[:, revolute]).max(initial=0.0))
    everywhere = tuple(i + 1 for i in revolute)
    for factor in (np.degrees(1.0), np.radians(1.0)):
        if revolute and (largest * factor <= _TWO_TURNS if factor > 1 else largest > _TWO_TURNS):
            scaled = recorded.copy()
            scaled[:, revolute] *= factor
            yield Change("units", everywhere, scaled, float(factor), volume=-float(np.log(factor)))


# Twists


@dataclass(frozen=True, eq=False)
class Widened:
    """A problem whose robot has one more joint, held, for each twist.

    `robot_joints` (n,) are the indices of the robot's joints, `twists` the link (by the number of its first
    joint), the index and the twist (rad) of the others.
    """

    problem: Problem
    robot_joints: Index
    twists: tuple[tuple[int, int, float], ...]

    def of(self, recorded: Matrix) -> Matrix:
        """(N, m) positions of all joints from the recorded ones (N, n), each twist as in the file."""
        result = np.zeros((len(recorded), self.problem.robot.n))
        result[:, self.robot_joints] = recorded
        return result

    def changes(self, recorded: Matrix) -> Iterator[Change]:
        """Each twist with its sign reversed."""
        n = len(self.robot_joints)
        for link, joint, twist in self.twists:
            positions = self.of(recorded)
            positions[:, joint] = -2 * twist
            yield Change("twist", (link, link + 1) if link < n else (link,), positions)


def widened(problem: Problem) -> Widened | None:
    """The problem with its twists as joints; None where the robot has none, or its geometry is no chain of
    revolute and prismatic joints with a sign to reverse. Links are nominal there."""
    robot = problem.robot
    if problem.geometry:
        problem = problem.with_geometry(NOMINAL)
    joints: list[Joint] = []
    robot_joints: list[int] = []
    twists: list[tuple[int, int, float]] = []
    ends = [*((joint.fixed, joint.axis) for joint in robot.joints[1:]), (robot.flange, _Z)]
    pending = robot.joints[0].fixed
    for link, (joint, (fixed, axis)) in enumerate(zip(robot.joints, ends, strict=True), start=1):
        robot_joints.append(len(joints))
        joints.append(replace(joint, fixed=pending))
        pending = fixed
        split = _at_twist(joint.axis, fixed, axis)
        if split is not None:
            before, twist = split
            twists.append((link, len(joints), twist))
            joints.append(
                Joint(f"twist{link}", "revolute", before, np.array([1.0, 0.0, 0.0]), -2 * np.pi, 2 * np.pi)
            )
            pending = np.linalg.inv(before) @ fixed
    if not twists:
        return None
    wide = Robot(robot.name, tuple(joints), pending)
    noise = np.zeros(len(joints))
    noise[robot_joints] = problem.noise.joint
    every = np.zeros((problem.shots, len(joints)))
    every[:, robot_joints] = problem.joints
    return Widened(
        replace(
            problem,
            robot=wide,
            noise=replace(problem.noise, joint=noise),
            parameters=_with_held(problem.parameters, [joint for _, joint, _ in twists]),
            functions=ShotFunctions(wide, problem.tool),
            joints=every,
        ),
        np.array(robot_joints),
        tuple(twists),
    )


def _at_twist(axis: Matrix, fixed: Matrix, next_axis: Matrix) -> tuple[Matrix, float] | None:
    """A frame (4, 4) on the next axis whose x is the common normal of both axes, and the twist (rad) about
    it; None where the axes are parallel. `fixed` leads from the frame of one joint to that of the next."""
    along = fixed[:3, :3] @ next_axis
    normal = np.cross(axis, along)
    sine, cosine = float(np.linalg.norm(normal)), float(axis @ along)
    if sine < _PARALLEL:
        return None
    normal = normal / sine
    # The point of the next axis that is nearest to the axis: p + s along, with (p + s along) across both.
    point = fixed[:3, 3]
    foot = point - along * float(np.cross(axis, normal) @ point) / float(np.cross(axis, normal) @ along)
    frame = np.eye(4)
    frame[:3, :3] = np.column_stack([normal, np.cross(along, normal), along])
    frame[:3, 3] = foot
    return frame, float(np.arctan2(sine, cosine))


def _with_held(parameters: Parameters, joints: list[int]) -> Parameters:
    """The parameters with a held offset more at each of these places among the joints, in rising order."""
    items = list(parameters.items)
    for joint in joints:
        name = f"twist{joint}"
        items.insert(joint, Parameter(name, "offset", name, "offset", "deg", 0.0, 1.0, 1.0, True, "header"))
    return Parameters(tuple(items))


class _Effort(NamedTuple):
    """`first` measurements on which the hypotheses are tried first, where there are more; the best
    `confirmed` of those that explain them go on to all."""

    first: int
    confirmed: int


_COLUMNS = _Effort(150, 6)
_TWISTS = _Effort(60, 2)  # the functions of a robot with twists as joints are not compiled


@dataclass(frozen=True)
class HypothesisFit:
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
            and (self.dof <= 0 or bool(scipy.special.chdtrc(self.dof, chi2) >= SIGNIFICANCE))
        )

    def explains(self, base: HypothesisFit, slack: float) -> bool:
        """Whether it agrees, or leaves at most half of the residuals; with links within tolerances, which no
        arm is without, three quarters are enough."""
        if self.cause == "geometry" and self.farthest <= _FAR:
            return self.agrees(slack) or self.factor <= REDUCED * base.factor
        return self.agrees(slack) or self.factor <= HALVED * base.factor


def fits_from(
    density: Density,
    start: Matrix,
    of: Index | None = None,
    *,
    most_steps: int = 200,
) -> tuple[Matrix, list[HypothesisFit]]:
    """The modes x (W, p) from each start, and what is left there, of no cause yet."""
    x = modes(density, start, of, most_steps=most_steps).x
    return x, fits_at(density, x, of)


def fits_at(density: Density, x: Matrix, of: Index | None = None) -> list[HypothesisFit]:
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
        HypothesisFit(
            cause=None,
            chi2=max(float(cost[w] - squares[w]), 0.0),
            cost=float(cost[w]),
            numbers=int(numbers[w]),
            dof=max(int(numbers[w] - rank[w]), 0),
            farthest=float(np.abs(z[w]).max(initial=0.0)),
        )
        for w in range(len(x))
    ]


def hypothesis_fits(
    problem: Problem, x: Matrix, base: HypothesisFit, fit: LikelihoodFit, slack: float
) -> Iterator[HypothesisFit]:
    """What every hypothesis leaves of a problem at known noise. The fit as recorded ended at x (p,) and
    leaves `base`; `fit` is the same at the noise as the header has it, `slack` that of
    `HypothesisFit.agrees`."""
    yield from _of_changes(problem, list(changes(problem, x)), base, slack, _COLUMNS)
    wide = widened(problem)
    if wide is not None:
        yield from _of_changes(wide.problem, list(wide.changes(problem.joints)), base, slack, _TWISTS)
    yield from _without_a_placement(problem, x, base)
    yield from _without_measurements(problem, x, base, slack)
    yield from _with_a_moved_target(problem, base, fit)


def _of_changes(
    problem: Problem, hypotheses: list[Change], base: HypothesisFit, slack: float, effort: _Effort
) -> list[HypothesisFit]:
    """With other recorded positions."""
    rows = _thinned(problem, effort.first)
    few = problem.select(rows)
    recorded = np.array([change.recorded for change in hypotheses])
    x, left = _with_joints(few, recorded[:, rows], None)
    if few.shots < problem.shots:
        explains = [i for i, fit in enumerate(left) if fit.explains(base, slack)]
        best = sorted(explains, key=lambda i: left[i].cost)[: effort.confirmed]
        confirmed = _with_joints(problem, recorded[best], x[best])[1] if best else []
        share = problem.data_size / few.data_size
        left = [_scaled_up(fit, share, problem.data_size) for fit in left]
        for i, fit in zip(best, confirmed, strict=True):
            left[i] = fit
    return [
        replace(
            fit,
            cause=change.cause,
            joints=change.joints,
            amount=change.amount,
            freed=change.freed,
            volume=change.volume,
        )
        for change, fit in zip(hypotheses, left, strict=True)
    ]


def _scaled_up(left: HypothesisFit, share: float, numbers: int) -> HypothesisFit:
    """What a part of the measurements leaves, as if it were all; never taken for an agreement."""
    chi2 = left.chi2 * share
    return replace(left, chi2=chi2, cost=_LARGEST, numbers=numbers, dof=max(int(left.dof * share), 1))


def _with_joints(
    problem: Problem, recorded: Matrix, start: Matrix | None
) -> tuple[Matrix, list[HypothesisFit]]:
    """What is left with other recorded positions (W, N, n), each from zero offsets or from `start` (W, p)."""
    density, rows = Density(problem, recorded), np.arange(len(recorded))
    first = start is None
    if start is None:
        start = start_at(problem, np.zeros((len(recorded), density.size)), recorded)
    return fits_from(density, start, rows, most_steps=_FEW_STEPS if first else 200)


def _thinned(problem: Problem, most: int) -> Index:
    """The places of some measurements of each target, evenly over its own; all where they are few."""
    if problem.shots <= most:
        return np.arange(problem.shots)
    each = max(3, most // len(problem.targets))
    chosen = []
    for k in range(len(problem.targets)):
        rows = np.flatnonzero(problem.target_index == k)
        chosen.append(
            rows[np.unique(np.linspace(0, len(rows) - 1, each).round().astype(int))] if len(rows) else rows
        )
    return np.sort(np.concatenate(chosen))


def _without(problem: Problem, x: Matrix, weights: Matrix, base: HypothesisFit) -> list[HypothesisFit]:
    """What is left with weights (W, N) of the measurements, from x (p,) and from zero offsets."""
    density = Density(problem).weighted(weights)
    count = len(weights)
    plain = start_at(problem, np.zeros((1, density.size)))
    of = np.tile(np.arange(count), 2)
    start = np.concatenate([np.tile(x, (count, 1)), np.tile(plain, (count, 1))])
    _, left = fits_from(density, start, of, most_steps=_FEW_STEPS)
    better = [min(left[w], left[w + count], key=lambda fit: fit.cost) for w in range(count)]
    return [replace(fit, freed=max(base.dof - fit.dof, 1)) for fit in better]


def _without_a_placement(problem: Problem, x: Matrix, base: HypothesisFit) -> list[HypothesisFit]:
    """Without the measurements of one placement, where there are two placements or more."""
    every = placements(problem)
    if len(every) < 2:
        return []
    weights = np.ones((len(every), problem.shots))
    for w, placement in enumerate(every):
        weights[w, placement.rows] = 0.0
    return [
        replace(fit, cause="placement", targets=placement.targets)
        for placement, fit in zip(every, _without(problem, x, weights, base), strict=True)
        if fit.dof > 0
    ]


def _without_measurements(
    problem: Problem, x: Matrix, base: HypothesisFit, slack: float
) -> list[HypothesisFit]:
    """Without one measurement, and without a few: each more is the one whose loss leaves least."""
    count = problem.shots
    if count > _EXACT:
        return _without_outlying(problem, x, base)
    gone: list[int] = []
    fits: list[HypothesisFit] = []
    for _ in range(min(3, max(1, count // 6))):
        rest = [i for i in range(count) if i not in gone]
        weights = np.ones((len(rest), count))
        weights[:, gone] = 0.0
        weights[np.arange(len(rest)), rest] = 0.0
        left = _without(problem, x, weights, base)
        best = int(np.argmin([fit.cost for fit in left]))
        gone.append(rest[best])
        if left[best].dof == 0:
            break
        fits.append(_as_measurements(problem, left[best], gone))
        if left[best].agrees(slack):
            break
    return fits


def _without_outlying(problem: Problem, x: Matrix, base: HypothesisFit) -> list[HypothesisFit]:
    """Of many measurements: without the outliers, again and again until there are no more."""
    density, gone = Density(problem), np.zeros(problem.shots, dtype=bool)
    d, left = problem.tool.residual_size, None
    for _ in range(_ROUNDS):
        quads = density.quads(x)
        # One far off pulls all: an outlier is judged by the scale of the rest, as long as that is too large.
        scale = max(1.0, float(np.median(quads[~gone]) / scipy.special.chdtri(d, 0.5)))
        off = scipy.special.chdtrc(d, quads / scale) * problem.shots < SIGNIFICANCE
        if not (off & ~gone).any() or (off | gone).sum() > max(3, problem.shots // 10):
            break
        gone |= off
        moved, (fit,) = fits_from(density.weighted(1.0 - gone[None]), x[None])
        x, left = moved[0], replace(fit, freed=max(base.dof - fit.dof, 1))
    return [] if left is None else [_as_measurements(problem, left, np.flatnonzero(gone).tolist())]


def _as_measurements(problem: Problem, left: HypothesisFit, gone: list[int]) -> HypothesisFit:
    numbers = tuple(sorted(problem.shot_numbers[i] for i in gone))
    names = tuple(dict.fromkeys(problem.targets[problem.target_index[i]] for i in sorted(gone)))
    n, m = problem.shots, len(gone)
    ways = float(
        scipy.special.gammaln(n + 1) - scipy.special.gammaln(m + 1) - scipy.special.gammaln(n - m + 1)
    )
    return replace(left, cause="measurements", targets=names, measurements=numbers, log_choices=ways)


def _with_a_moved_target(problem: Problem, base: HypothesisFit, fit: LikelihoodFit) -> list[HypothesisFit]:
    """With a target at two places, before and after a measurement: of many measurements where the linearised
    test finds it likeliest."""
    order = np.argsort(problem.shot_numbers, kind="stable")
    likely = None
    if problem.shots > _EXACT:
        moved = displacement(fit) if fit.converged else None
        likely = [] if moved is None else [moved.at, *moved.elsewhere[: _CHANGE_POINTS - 1]]
    fits = []
    for k, name in enumerate(problem.targets):
        rows = order[problem.target_index[order] == k]
        numbers = [problem.shot_numbers[i] for i in rows]
        after = [
            at
            for at, pair in enumerate(pairwise(numbers), start=1)
            if likely is None or (name, *pair) in likely
        ]
        if not after:
            continue
        twice = _at_two_places(problem, k, rows)
        weights = np.ones((len(after), problem.shots + len(rows)))
        for w, at in enumerate(after):
            weights[w, rows[at:]] = 0.0
            weights[w, problem.shots : problem.shots + at] = 0.0
        density = Density(twice).weighted(weights)
        start = start_at(twice, np.zeros((len(after), density.size)))
        _, left = fits_from(density, start, np.arange(len(after)), most_steps=_FEW_STEPS)
        fits += [
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
    return fits


def _at_two_places(problem: Problem, target: int, rows: Index) -> Problem:
    """The problem with its measurements `own` of a target once more behind all others, there at a further
    target."""
    parameters = problem.parameters
    items, end = list(parameters.items), parameters.block("target").stop
    name = f"{problem.targets[target]} moved"
    for item in reversed(items[parameters.block("target", target)]):
        items.insert(end, replace(item, name=f"{name}.{item.axis}", of=name))
    again = problem.select(np.concatenate([np.arange(problem.shots), rows]))
    index = again.target_index.copy()
    index[problem.shots :] = len(problem.targets)
    return replace(
        again,
        parameters=Parameters(tuple(items)),
        targets=(*problem.targets, name),
        target_index=index,
        guessed=np.append(problem.guessed, problem.guessed[target]),
    )


def with_links_freed(problem: Problem, x: Matrix) -> HypothesisFit | None:
    """What is left with the links free within typical tolerances; the fit with nominal geometry ended at
    x (p,), at known noise. None where the problem has geometry parameters already.

    The deviations of the links count as residuals, by their tolerances: with geometry marginalised both
    together have the degrees of freedom that the residuals have with nominal geometry. As the tolerances are
    priors, not each of the parameters counts as one that was chosen to suit the data: the effective number is
    the trace of the reduction, the sum of l / (1 + l) over the eigenvalues l of the information that the
    measurements have on the links, in units of their tolerances, when all else is estimated.
    """
    if problem.geometry:
        return None
    whole, start = with_links(problem, x)
    density = Density(whole)
    ended, (left,) = fits_from(density, start[None], most_steps=_FEW_STEPS)
    estimated = whole.parameters.free & whole.parameters.group("geometry")
    links = whole.parameters.among_free[estimated]
    squares = float((density.scaled(ended)[0, links] ** 2).sum())
    information = density.slopes(ended).information[0]
    if not np.isfinite(information).all():
        return None
    # Of the links, with all else estimated: the inverse of their block of the covariance.
    marginal = np.linalg.inv(np.linalg.inv(information)[np.ix_(links, links)])
    freed = float(len(links) - np.trace(np.linalg.inv(marginal)))
    # Directions of the links that the measurements determine better than the tolerances do.
    own_rank = int((np.linalg.eigvalsh(marginal - np.eye(len(links))) >= 1.0).sum())
    rank = left.numbers - left.dof - own_rank
    return replace(
        left,
        cause="geometry",
        chi2=left.chi2 + squares,
        dof=max(left.numbers - max(rank, 0), 0),
        freed=max(freed, 1e-3),
    )
