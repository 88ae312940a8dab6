"""Hypotheses on what is wrong with a recording, a robot file or a cell, and what a fit of each leaves.

There are two sorts. What changes everything (columns exchanged, signs, zeros, units, another arm) is screened
with nominal geometry, all at once (`screening`); what changes little is screened by its evidence at the mode
as recorded, linearised (`suspects`). The best few of both are fitted with all else as it is, at the stated
noise. Nothing is applied.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations, permutations, product
from pathlib import Path

import numpy as np
import scipy

from ...model.arrays import Index, Mask, Matrix
from ...model.files.robot_file import built_in_robots, load_robot
from ...model.instruments.flange_tool import LaserBeam
from ...model.kinematics.dh import DHRow, along_z, as_row, with_fixed
from ...model.kinematics.robot import Robot
from ...model.likelihood.constraint import shot_functions
from ...model.likelihood.density import Density
from ...model.likelihood.parameters import Parameters
from ...model.likelihood.problem import Problem
from ...model.parsing.confinement import BUILT_IN
from ..estimation.fit import CONTRADICTED, modes
from ..observability.geometry_result import with_links
from ..recordings.recordings import placements
from .screening import screened
from .suspects import Cause, Linear, Suspect, suspects

_VENDOR = re.compile(r"^vendor: *([\w-]+)", re.MULTILINE)


@dataclass(frozen=True, eq=False)
class Change:
    """One thing that may be wrong, and the positions `recorded` (N, n) or the `robot` that would be there
    without it (None: as they are).

    `joints` are numbered from 1: those concerned; of a twist the joints before and behind the link, or the
    last one for the link that ends in the flange. `amount` is what is added to a zero (deg), the factor of
    units, or how many times joint 2 is added to joint 3. `of` names the arm or the convention, `gone` the
    places of measurements that are left out. `volume` is the
    logarithm of the factor by which positions shrink, `occam` the price of what is chosen to suit the data.
    """

    cause: Cause
    joints: tuple[int, ...] = ()
    recorded: Matrix | None = None
    amount: float = 0.0
    of: str = ""
    robot: Robot | None = None
    gone: tuple[int, ...] = ()
    targets: tuple[str, ...] = ()
    volume: float = 0.0
    occam: float = 0.0


def file_variants(robot: Robot) -> Iterator[Change]:
    """Twists, and the other convention of the rows."""
    robot = along_z(robot)
    first, *ends = (*(joint.fixed for joint in robot.joints), robot.flange)
    rows = [as_row(end) for end in ends]
    for k, row in enumerate(rows):
        if row is None or abs(np.sin(row.alpha)) <= 1e-6:
            continue
        link = replace(row, alpha=-row.alpha).matrix()
        joints = (k + 1, k + 2) if k + 1 < robot.n else (k + 1,)
        yield Change("twist", joints, robot=with_fixed(robot, [first, *ends[:k], link, *ends[k + 1 :]]))
    yield from _conventions(robot, first, [row for row in rows if row is not None])


def _beam_axes(problem: Problem) -> Iterator[Change]:
    """A beam along another axis of the flange than stated: components exchanged and negated, each line once.
    The flange is rotated about the point of the beam, which moves the beam alone."""
    tool = problem.tool
    if not isinstance(tool, LaserBeam) or tool.direction is None:
        return
    robot = along_z(problem.robot)
    fixed, along = [*(joint.fixed for joint in robot.joints), robot.flange], tool.direction
    axes = {
        tuple((np.array(signs) * along[list(order)] + 0.0).tolist())
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    }
    lines = [axis for axis in sorted(axes) if axis > (0.0, 0.0, 0.0)]
    for direction in lines:
        if abs(np.array(direction) @ along) > 1 - _SAME_AXIS:
            continue
        turn, _ = scipy.spatial.transform.Rotation.align_vectors([direction], [along])
        turned = np.eye(4)
        turned[:3, :3] = turn.as_matrix()
        turned[:3, 3] = tool.point - turn.apply(tool.point)
        of = f"[{', '.join(f'{value:g}' for value in np.round(direction, 4).tolist())}]"
        moved = with_fixed(robot, [*fixed[:-1], fixed[-1] @ turned])
        yield Change("tool", of=of, robot=moved)


def _conventions(robot: Robot, first: Matrix, rows: Sequence[DHRow]) -> Iterator[Change]:
    """Rows of standard Denavit-Hartenberg parameters that were read as modified ones, and the reverse.

    Between joints i and i + 1 both have theta and d of row i; a and alpha are those of row i by the standard,
    of row i + 1 by the modified convention.
    """
    if len(rows) < robot.n:
        return
    links = [(row.a, row.alpha) for row in rows]
    before = as_row(first)
    if before is not None and (before.d, before.theta) == links[-1] == (0.0, 0.0):
        moved = _with_links(rows, [(before.a, before.alpha), *links[:-1]])
        yield Change("convention", of="standard", robot=with_fixed(robot, [np.eye(4), *moved]))
    moved = _with_links(rows, [*links[1:], (0.0, 0.0)])
    before_first = first @ DHRow(*links[0], 0.0, 0.0).matrix()
    yield Change("convention", of="modified", robot=with_fixed(robot, [before_first, *moved]))


def _with_links(rows: Sequence[DHRow], links: Sequence[tuple[float, float]]) -> list[Matrix]:
    """(4, 4) of each row with another a and alpha."""
    return [DHRow(*link, row.d, row.theta).matrix() for link, row in zip(links, rows, strict=True)]


def other_arms(robot: Robot, *, siblings: bool) -> Iterator[Change]:
    """Built-in arms with joints of the same kinds: those of the same maker, or all others."""
    kinds = [joint.kind for joint in robot.joints]
    names = [name for name, vendor in _vendors() if (vendor == robot.vendor) == siblings]
    arms = [arm for arm in map(_built_in, names) if arm.name != robot.name]
    arms = [arm for arm in arms if [joint.kind for joint in arm.joints] == kinds]
    for arm in arms:
        yield Change("arm", of=arm.name, robot=arm, occam=float(np.log(len(arms))))


@cache
def _vendors() -> tuple[tuple[str, str], ...]:
    """Names and makers of the built-in arms: to read the files whole takes longer than to look for a line."""
    texts = ((name, (BUILT_IN / f"{name}.yaml").read_text(encoding="utf-8")) for name in built_in_robots())
    return tuple((name, match[1] if (match := _VENDOR.search(text)) else "") for name, text in texts)


@cache
def _built_in(name: str) -> Robot:
    return load_robot(name, Path())


_TWO_TURNS = 4 * np.pi  # rad: further no arm goes, and no angle is recorded
_SAME_AXIS = 1e-9  # of the cosine
_QUARTERS = (90.0, -90.0, 180.0)
SIGNIFICANCE = 1e-3  # p-value of residuals by noise and of a gain by chance; likelihood ratio to a rival
HALVED = 0.5  # what does not agree with the noise has to leave no more than this share of the residuals
REDUCED = 0.75  # the same of link geometry: beyond it arms deflect, by as much again
_FAR = 4.0  # prior stds beyond which an estimate contradicts its prior
_FEW_STEPS = 60  # of a first try
_REFITS = 2  # of a suspect: its effect is linearised at each
_ROUNDS = 10  # of leaving outliers out
_EXACT = 60  # measurements up to which outliers are tried one by one
_SCREENED = 60  # measurements on which recordings and robots are screened, where there are more
_CONFIRMED = 4  # recordings and robots that go on to a whole fit
_SUSPECTS = 10  # the same of what changes little
_WORTH = 8.0  # of log evidence: a suspect so much below the best is not fitted
_OFF_MM = 1.0  # a measurement that is wrong is off by no less
_LARGEST = 1e300


def changes(problem: Problem, x: Matrix) -> Iterator[Change]:
    """All changes worth trying, but for arms of other makers; `x` (p,) is where the fit as recorded ended."""
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
    order = problem.order
    for steps in (1, -1):
        neighbours = recorded.copy()
        neighbours[order] = np.roll(recorded[order], steps, axis=0)
        yield Change("rows", (), neighbours, float(steps))
    if problem.shots <= _EXACT:
        for i in range(problem.shots):
            yield Change("measurements", gone=(i,), targets=(problem.targets[problem.target_index[i]],))
    every = placements(problem)
    for placement in every if len(every) > 1 else ():
        yield Change("placement", gone=tuple(placement.rows.tolist()), targets=placement.targets)
    yield from file_variants(robot)
    yield from other_arms(robot, siblings=True)


def _added(recorded: Matrix, joint: int, what: Matrix | float) -> Matrix:
    result = recorded.copy()
    result[:, joint] += what
    return result


def _far_zeros(problem: Problem, x: Matrix, revolute: list[int]) -> Iterator[Change]:
    """Zeros as far off as the fit as recorded has them, where that is beyond the prior and no quarter."""
    for i, (off, std) in _beyond_priors(problem, x).items():
        quarter = np.pi / 2 * np.round(off / (np.pi / 2))
        near = quarter != 0 and abs(off - quarter) <= _FAR * std
        if i in revolute and not near:
            occam = float(np.log(2 * np.pi / std))
            degrees = float(np.degrees(off))
            yield Change("zero", (i + 1,), _added(problem.joints, i, off), degrees, occam=occam)


def _beyond_priors(problem: Problem, x: Matrix) -> dict[int, tuple[float, float]]:
    """By joint, from 0: the offsets that the fit has beyond their priors, and the stds of these."""
    parameters = problem.parameters
    block = parameters.block("offset")
    rows = zip(x[block].tolist(), parameters.prior_std[block].tolist(), strict=True)
    free = parameters.free[block]
    return {i: (off, std) for i, (off, std) in enumerate(rows) if free[i] and abs(off) > _FAR * std}


def _is_estimated(change: Change, beyond: Mapping[int, tuple[float, float]]) -> bool:
    """Whether the change is a zero that is off as far as the fit has it `beyond` its prior."""
    if change.cause != "zero" or change.joints[0] - 1 not in beyond:
        return False
    off, std = beyond[change.joints[0] - 1]
    apart = np.remainder(off - np.radians(change.amount) + np.pi, 2 * np.pi) - np.pi
    return bool(abs(apart) <= _FAR * std)


def _units(recorded: Matrix, revolute: list[int]) -> Iterator[Change]:
    """Radians that were taken for degrees, or degrees that were converted to degrees once more."""
    largest = float(np.abs(recorded[:, revolute]).max(initial=0.0))
    everywhere = tuple(i + 1 for i in revolute)
    for factor in (np.degrees(1.0), np.radians(1.0)):
        if revolute and (largest * factor <= _TWO_TURNS if factor > 1 else largest > _TWO_TURNS):
            scaled = recorded.copy()
            scaled[:, revolute] *= factor
            yield Change("units", everywhere, scaled, float(factor), volume=-float(np.log(factor)))


# Fits


@dataclass(frozen=True)
class HypothesisFit:
    """What a hypothesis leaves: `chi2` of the residuals at the stated noise and of what has a tolerance, with
    `dof`; `cost` the squares of residuals and of all estimates in prior stds; `numbers` counts the residuals,
    and `farthest` is the largest distance of an estimate from its prior mean in prior stds. `log_det` is that
    of the information. `freed` parameters are chosen to suit the data (their effective number), at the price
    `occam`; the hypothesis is one of exp(`log_choices`), and `volume` is that of a `Change`. `u` is the
    standard uncertainty of an `amount` that was estimated, where that is one number."""

    cause: Cause | None
    chi2: float
    cost: float
    numbers: int
    dof: int
    farthest: float
    log_det: float = 0.0
    joints: tuple[int, ...] = ()
    targets: tuple[str, ...] = ()
    measurements: tuple[int, ...] = ()
    of: str = ""
    amount: float = 0.0
    freed: float = 0
    occam: float = 0.0
    log_choices: float = 0.0
    volume: float = 0.0
    u: float = 0.0

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

    def log_evidence(self, base: HypothesisFit, free_scale: bool) -> float:
        """Logarithm of the ratio of marginal likelihoods to the model as recorded, by Laplace's formula, less
        the price of the choice; with `free_scale` the noise is up to a common factor."""
        drop = base.cost - self.cost
        if free_scale:
            drop = base.numbers * float(np.log(max(base.cost, 1.0) / max(self.cost, 1.0)))
        gain = (drop - self.log_det + base.log_det) / 2
        return gain - self.occam - self.log_choices - base.numbers * self.volume


def fits_from(
    density: Density, start: Matrix, *, most_steps: int = 200
) -> tuple[Matrix, list[HypothesisFit]]:
    """The modes x (W, p) from each start, and what is left there, of no cause yet."""
    x = modes(density, start, most_steps=most_steps).x
    return x, fits_at(density, x)


def fits_at(density: Density, x: Matrix) -> list[HypothesisFit]:
    """What is left at each x (W, p), of no cause yet."""
    parameters = density.problem.parameters
    slopes = density.slopes(x)
    z = density.scaled(x)
    numbers = np.broadcast_to(density.numbers(), len(x)) + len(density.problem.ties)
    finite: Mask = np.asarray(np.isfinite(slopes.information).all(axis=(1, 2)))
    information = np.where(finite[:, None, None], slopes.information, np.eye(density.size))
    wide = np.asarray(~parameters.tolerated[parameters.free])
    by_wide = information[:, wide][:, :, wide] - np.eye(int(wide.sum()))
    rank = (np.linalg.eigvalsh(by_wide) >= 1.0).sum(axis=1)
    log_det = np.linalg.slogdet(information)[1]
    cost = np.nan_to_num(-2 * slopes.value, nan=_LARGEST, posinf=_LARGEST)
    squares = (z[:, wide] ** 2).sum(axis=1)
    return [
        HypothesisFit(
            cause=None,
            chi2=max(float(cost[w] - squares[w]), 0.0),
            cost=float(cost[w]),
            numbers=int(numbers[w]),
            dof=max(int(numbers[w] - rank[w]), 0),
            farthest=float(np.abs(z[w]).max(initial=0.0)),
            log_det=float(log_det[w]),
        )
        for w in range(len(x))
    ]


def hypothesis_fits(problem: Problem, x: Matrix, slack: float) -> Iterator[HypothesisFit]:
    """What the best hypotheses leave of a problem at known noise. The fit as recorded ended at x (p,);
    `slack` is that of `HypothesisFit.agrees`."""
    every, axes = list(changes(problem, x)), list(_beam_axes(problem))
    # Far zeros leave the residuals as they are: only the prior speaks against them.
    beyond = _beyond_priors(problem, x)
    far = [i for i, change in enumerate(every) if _is_estimated(change, beyond)]
    fits = [
        *_of_changes(problem, every, len(every), always=far),
        *(_of_changes(problem, axes, len(every) + len(axes), most=1) if axes else ()),
        *of_readings(problem),
        *_of_suspects(problem, x),
    ]
    if not any(fit.agrees(slack) for fit in fits):
        arms = list(other_arms(problem.robot, siblings=False))
        fits += _of_changes(problem, arms, len(every) + len(arms), most=1)
    yield from fits


# What changes everything


def _of_changes(
    problem: Problem,
    every: Sequence[Change],
    tried: int,
    most: int = _CONFIRMED,
    always: Sequence[int] = (),
) -> list[HypothesisFit]:
    """The best of the changes by their fit with nominal geometry, and those `always` to try, fitted whole."""
    rows = _thinned(problem, _SCREENED)
    few = problem.select(rows)
    recorded = [
        few.joints,
        *(few.joints if change.recorded is None else change.recorded[rows] for change in every),
    ]
    robots = [problem.robot, *(change.robot or problem.robot for change in every)]
    weights = [few.weights, *(_weights(problem, change)[rows] for change in every)]
    x, cost = screened(few, robots, np.array(recorded), np.array(weights))
    criterion = cost[1:] + 2 * few.data_size * np.array([change.volume for change in every])
    best = [int(i) for i in np.argsort(criterion, kind="stable")[:most] if criterion[i] < cost[0]]
    best += [i for i in always if i not in best]
    nominal = problem.parameters.without("geometry")
    return [
        left
        for i in best
        if (left := _of_change(problem, every[i], nominal, x[1 + i], float(np.log(tried)))).dof > 0
        or not left.freed  # else nothing is left that could contradict it
    ]


def _of_change(
    problem: Problem, change: Change, nominal: Parameters, x: Matrix, log_tried: float
) -> HypothesisFit:
    """Fitted whole, from x of the nominal parameters."""
    changed = _changed(problem, change)
    start = changed.parameters.with_values(changed.parameters.prior_mean, nominal, x)
    moved, (left,) = fits_from(Density(changed), start[None], most_steps=_FEW_STEPS)
    if change.gone:
        left = _left_without(problem, moved[0], left, np.array(change.gone))
    return replace(
        left,
        cause=change.cause,
        joints=change.joints,
        targets=change.targets,
        amount=change.amount,
        of=change.of,
        measurements=left.measurements if change.cause == "measurements" else (),
        occam=left.occam + change.occam,
        volume=change.volume,
        log_choices=log_tried,
    )


def _weights(problem: Problem, change: Change) -> Matrix:
    weights = problem.weights.copy()
    weights[list(change.gone)] = 0.0
    return weights


def _changed(problem: Problem, change: Change) -> Problem:
    """The problem without what may be wrong."""
    if change.robot is not None:
        geometry = problem.geometry.of_robot(change.robot)
        functions = shot_functions(change.robot, problem.tool, geometry=geometry)
        parameters = problem.parameters.with_geometry(geometry, change.robot, problem.tool)
        problem = replace(problem, robot=change.robot, parameters=parameters, functions=functions)
    if change.gone:
        problem = replace(problem, weights=_weights(problem, change))
    return problem if change.recorded is None else problem.moved(change.recorded)


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


def of_readings(problem: Problem) -> Iterator[HypothesisFit]:
    """All readings of an instrument in another unit, or in a left-handed frame: its start is found anew."""
    if not problem.recorded:
        return
    every = list(problem.tool.misread(problem.readings))
    for misread in every:
        right = replace(problem, readings=misread.readings)
        _, (left,) = fits_from(Density(right), right.nominal()[None], most_steps=_FEW_STEPS)
        yield replace(
            left,
            cause=misread.wrong,
            of=misread.label,
            amount=float(misread.axis),
            log_choices=float(np.log(len(every))),
        )


# What changes little


def _of_suspects(problem: Problem, x: Matrix) -> Iterator[HypothesisFit]:
    """The best suspects by their evidence at the mode x (p,), each fitted whole."""
    problem, x = _with_held_links(problem, x)
    linear = Linear(problem, x)
    every = suspects(linear)
    least = every[0].evidence - _WORTH
    chosen = [suspect for suspect in every[:_SUSPECTS] if suspect.evidence > max(least, 0.0)]
    for suspect in chosen:
        left = suspect_fit(linear, suspect)
        if left.dof > 0 or not left.freed:  # else nothing is left that could contradict it
            yield left
    if problem.shots > _EXACT:
        yield from _without_outlying(problem, x)


def _with_held_links(problem: Problem, x: Matrix) -> tuple[Problem, Matrix]:
    """The problem with the links of an exact arm as parameters that are held, and x (p,) there."""
    if problem.geometry:
        return problem, x
    whole, start = with_links(problem, x)
    held = whole.parameters.holding(whole.parameters.group("geometry"))
    return replace(whole, parameters=held), start


def suspect_fit(linear: Linear, suspect: Suspect) -> HypothesisFit:
    """What is left with what a suspect frees at its mode, from the model as recorded."""
    values: Matrix = np.zeros(0)
    occam = 0.0
    for _ in range(_REFITS):
        columns = suspect.columns(linear)
        step: Matrix = np.zeros(columns.shape[1])
        if len(step):
            values = np.zeros_like(step) if not len(values) else values
            tried = linear.of(columns)
            whole = tried.gram[0] + np.eye(len(step)) / suspect.size**2
            step[:] = -np.linalg.solve(whole, tried.y[0] + values / suspect.size**2)
            values = values + step
            occam = (
                float(np.linalg.slogdet(suspect.size**2 * whole)[1] + (values @ values) / suspect.size**2) / 2
            )
        corrected = suspect.corrected(linear, step)
        moved, (fit,) = fits_from(Density(corrected), linear.x[None], most_steps=_FEW_STEPS)
        linear = Linear(corrected, moved[0])
        if not len(step):
            break
    freed = suspect.freed
    if len(values):
        freed = float(len(values) - np.trace(np.linalg.inv(suspect.size**2 * whole)))
    amount = suspect.fixed_amount
    if amount is None:
        amount = float(values[0] if len(values) == 1 else np.linalg.norm(values)) * suspect.unit
    u = float(whole[0, 0] ** -0.5) * suspect.unit if len(values) == 1 else 0.0
    if suspect.cause == "noise":  # at the noise as stated
        occam += fit.numbers * float(np.log(amount))
    return replace(
        fit,
        cause=suspect.cause,
        joints=suspect.joints,
        targets=suspect.targets,
        measurements=suspect.measurements,
        of=suspect.of,
        amount=amount,
        freed=freed,
        dof=max(fit.dof - round(freed), 0) if len(values) else fit.dof,
        occam=occam,
        log_choices=suspect.log_choices,
        u=u,
    )


def _without_outlying(problem: Problem, x: Matrix) -> Iterator[HypothesisFit]:
    """Of many measurements: without the outliers, again and again until there are no more."""
    density, gone = Density(problem), np.zeros(problem.shots, dtype=bool)
    sizes, left = problem.sizes, None
    for _ in range(_ROUNDS):
        quads = density.quads(x)
        # One far off pulls all: an outlier is judged by the scale of the rest, as long as that is too large.
        scale = max(1.0, float(np.median((quads / scipy.special.chdtri(sizes, 0.5))[~gone])))
        off = scipy.special.chdtrc(sizes, quads / scale) * problem.shots < SIGNIFICANCE
        if not (off & ~gone).any() or (off | gone).sum() > max(3, problem.shots // 10):
            break
        gone |= off
        moved, (left,) = fits_from(density.weighted(1.0 - gone[None]), x[None])
        x = moved[0]
    if left is not None:
        n, m = problem.shots, int(gone.sum())
        gamma = scipy.special.gammaln
        ways = float(gamma(n + 1) - gamma(m + 1) - gamma(n - m + 1))
        numbers = _left_without(problem, x, left, np.flatnonzero(gone))
        names = tuple(dict.fromkeys(problem.targets[k] for k in problem.target_index[gone]))
        yield replace(numbers, cause="measurements", targets=names, log_choices=ways)


def _left_without(problem: Problem, x: Matrix, left: HypothesisFit, gone: Index) -> HypothesisFit:
    """The same with the price of leaving measurements out: each is off by a normal amount, as wide as all of
    them are off."""
    whitened = problem.whiten(x)
    off = whitened.residual_mm[gone][problem.active[gone] > 0]
    size = max(float(np.sqrt((off**2).mean())), _OFF_MM)
    factors = np.diagonal(whitened.factor[gone], axis1=1, axis2=2)[problem.active[gone] > 0]
    return replace(
        left,
        measurements=tuple(sorted(problem.shot_numbers[i] for i in gone)),
        freed=float(off.size),
        occam=float(np.log(size / factors).sum() + (off**2).sum() / size**2 / 2),
    )
