"""What may be wrong by a small amount: each suspect adds columns to the residuals, with a normal prior.

At the mode of the model as recorded a suspect that adds B b to the residuals, b normal with the standard
deviation s, has the evidence of `left_over`. Nothing is fitted to know it. How large the error may be is not
known to a factor: the best of a few sizes s counts, at the price of a choice among them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from ...model.arrays import Index, Matrix
from ...model.likelihood.geometry import ANGLES, BENDING
from ...model.likelihood.parameters import Parameter, Parameters
from ...model.likelihood.problem import Problem
from ..left_over import Hypotheses, Linearised, revolute
from ..observability.changes import FEWEST, elapsed, repeated

Cause = Literal[
    "swapped_joints",
    "sign",
    "zero",
    "units",
    "coupling",
    "metres",
    "mirrored",
    "quaternion",
    "inverse",
    "inverse_pose",
    "rows",
    "twist",
    "convention",
    "arm",
    "length",
    "tool",
    "spot",
    "placement",
    "measurements",
    "repeats",
    "moved_target",
    "jump",
    "drift",
    "lag",
    "backlash",
    "gain",
    "noise",
    "geometry",
    "gravity",
    "harmonics",
]


# Standard deviations that are tried, from a little more than what is typical upwards.
_ANGLES = (0.05, 0.5, 5.0)  # deg, of a jump, a drift
_MM = (1.0, 10.0, 100.0)
_BACKLASH = (0.03, 0.1, 0.3)  # deg
_SHARES = (1e-4, 1e-3, 1e-2, 1e-1)  # of a motion, of a gain
_TILTS = (0.3, 3.0)  # deg
_TIMES = (2.0, 3.0, 5.0, 10.0)  # the tolerances
_NOISE_TIMES = (1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 7.0, 10.0)
_MOST_OUTLIERS = 3

_TURNED: dict[str, list[list[int]]] = {
    "exchanged": [[0, 1], [1, 0]],
    "rotated by 90°": [[0, -1], [1, 0]],
    "rotated by −90°": [[0, 1], [-1, 0]],
    "negated": [[-1, 0], [0, -1]],
    "first negated": [[-1, 0], [0, 1]],
    "second negated": [[1, 0], [0, -1]],
    "exchanged and negated": [[0, -1], [-1, 0]],
}

Columns = Callable[["Linear"], Matrix]
Corrected = Callable[["Linear", Matrix], Problem]


@dataclass(frozen=True, eq=False)
class Suspect:
    """One suspect: `columns` (M, k) of whitened residuals by what it frees, at a linearised fit, and the
    problem `corrected` by values (k,) of that. `size` is the prior std of these, `evidence` the log ratio to
    the model as recorded, less `log_choices` among its kind. `unit` is what an amount is shown in: so many
    internal units."""

    cause: Cause
    columns: Columns
    corrected: Corrected
    size: float = 0.0
    evidence: float = 0.0
    log_choices: float = 0.0
    joints: tuple[int, ...] = ()
    targets: tuple[str, ...] = ()
    measurements: tuple[int, ...] = ()
    of: str = ""
    unit: float = 1.0
    fixed_amount: float | None = None
    freed: float = 0.0  # where it has no columns


class Linear(Linearised):
    """A fit at known noise, linearised at its mode x (p,), the measurements in their order in time."""

    def __init__(self, problem: Problem, x: Matrix) -> None:
        super().__init__(problem, x, settled=True)
        self.x = x

    @cached_property
    def at_prior_means(self) -> Matrix:
        """(M,) r0, the residuals at the prior means: r = (I - A C A') r0."""
        return np.asarray(self.residual + self.free @ (self.free.T @ self.residual))

    def motions(self) -> Matrix:
        """(N, n) of each measurement from the one before; 0 of the first."""
        result = np.zeros_like(self.problem.joints)
        result[self.order[1:]] = np.diff(self.problem.joints[self.order], axis=0)
        return result


def suspects(linear: Linear) -> list[Suspect]:
    """The best of each kind, not yet fitted, the one with the largest evidence first."""
    every = [
        *_jumps(linear),
        *_moved_targets(linear),
        *_outliers(linear),
        *_repeats(linear),
        *_of_motion(linear),
        *_drifts(linear),
        *_of_parameters(linear),
        *_tolerances(linear),
        *_noise(linear),
        *_spots(linear),
    ]
    return sorted(every, key=lambda suspect: -suspect.evidence)


# Evidence


def _best(tried: Hypotheses, sizes: Sequence[float]) -> list[tuple[float, int, float]]:
    """Evidence, index and size of the best two."""
    rows = []
    for size in sizes:
        values = tried.log_evidence(size)
        rows += [(float(values[i]), int(i), size) for i in np.argsort(-values)[:2]]
    best: dict[int, tuple[float, int, float]] = {}
    for row in sorted(rows, reverse=True):
        best.setdefault(row[1], row)
    return list(best.values())[:2]


def _suspects(
    tried: Hypotheses, sizes: Sequence[float], made: Suspect | Callable[[int], Suspect], unit: float = 1.0
) -> Iterator[Suspect]:
    """The best two of a kind, all the same suspect or each made by its index; sizes in units of `unit`."""
    count = len(tried.y)
    if not count:
        return
    price = float(np.log(count * len(sizes)))
    for evidence, index, size in _best(tried, [size * unit for size in sizes]):
        suspect = made if isinstance(made, Suspect) else made(index)
        yield replace(suspect, size=size, evidence=evidence - price, log_choices=price, unit=1 / unit)


# Changes between two measurements


def _jumps(linear: Linear) -> Iterator[Suspect]:
    """The zero of a joint at another place from some measurement on."""
    problem, order = linear.problem, linear.order
    changes = len(order) - 2 * FEWEST + 1
    for kind, unit in (("revolute", np.radians(1.0)), ("prismatic", 1.0)):
        joints = [i for i, joint in enumerate(problem.robot.joints) if joint.kind == kind]
        if changes < 1 or not joints:
            continue
        parts = [linear.after(linear.by_joints[:, :, [i]], order, FEWEST) for i in joints]

        def made(index: int, joints: list[int] = joints) -> Suspect:
            joint, at = joints[index // changes], index % changes + FEWEST
            late = np.zeros(problem.shots)
            late[order[at:]] = 1.0
            return _of_joint("jump", joint, late[:, None], measurements=_around(problem, order, at))

        sizes = _ANGLES if kind == "revolute" else _MM
        yield from _suspects(Hypotheses.stacked(parts), sizes, made, unit)


def _around(problem: Problem, rows: Index, at: int) -> tuple[int, int]:
    return problem.shot_numbers[rows[at - 1]], problem.shot_numbers[rows[at]]


def _of_joint(cause: Cause, joint: int, course: Matrix, **more: Any) -> Suspect:
    """What adds b times `course` (N, 1) to the position of a joint (from 0)."""

    def columns(linear: Linear) -> Matrix:
        return linear.rows(linear.by_joints[:, :, [joint]] * course[:, :, None])

    def corrected(linear: Linear, values: Matrix) -> Problem:
        joints = linear.problem.joints.copy()
        joints[:, joint] += course @ values
        return linear.problem.moved(joints)

    return Suspect(cause, columns, corrected, joints=(joint + 1,), **more)


def of_one_value(problem: Problem, joint: int, at: int) -> Suspect:
    """The position of a joint (from 0) in one measurement, by its place."""
    course = np.zeros((problem.shots, 1))
    course[at] = 1.0
    return _of_joint("measurements", joint, course, measurements=(problem.shot_numbers[at],))


def _of_place(cause: Cause, course: Matrix, **more: Any) -> Suspect:
    """What adds b times `course` (N,) to the place of the targets: b in mm, base frame."""

    def shifted(linear: Linear) -> Matrix:
        return np.asarray(linear.by_target * course[:, None, None])

    return _of_spots(cause, shifted, **more)


def _of_spots(cause: Cause, parts: Callable[[Linear], Matrix], **more: Any) -> Suspect:
    """What moves the residuals by whitened columns (N, d, k), as the spots do."""

    def columns(linear: Linear) -> Matrix:
        return linear.rows(parts(linear))

    def corrected(linear: Linear, values: Matrix) -> Problem:
        problem = linear.problem
        moved = (linear.factor @ (parts(linear) @ values)[..., None])[..., 0]
        return replace(problem, spots=problem.spots - moved / np.sqrt(problem.weights)[:, None])

    return Suspect(cause, columns, corrected, **more)


def _moved_targets(linear: Linear) -> Iterator[Suspect]:
    problem = linear.problem
    for k, name in enumerate(problem.targets):
        rows = linear.order[problem.target_index[linear.order] == k]
        if len(rows) < 2 * FEWEST:
            continue
        tried = linear.after(linear.by_target, rows, FEWEST)

        def made(index: int, rows: Index = rows, name: str = name) -> Suspect:
            late = np.zeros(problem.shots)
            late[rows[index + FEWEST :]] = 1.0
            around = _around(problem, rows, index + FEWEST)
            return _of_place("moved_target", late, targets=(name,), measurements=around)

        for suspect in _suspects(tried, _MM, made):
            yield replace(suspect, log_choices=suspect.log_choices + np.log(len(problem.targets)))


# Measurements that are wrong


def _outliers(linear: Linear) -> Iterator[Suspect]:
    """One measurement off, and a few: each more is the one that explains most beside the others."""
    gone: list[int] = []
    count = linear.problem.shots
    for _ in range(min(_MOST_OUTLIERS, max(1, count // 6))):
        tried = _with_each(linear, gone)
        price = float(sum(np.log((count - k) / (k + 1)) for k in range(len(gone) + 1)) + np.log(len(_MM)))
        evidence, index, size = _best(tried, _MM)[0]
        gone = [*gone, index]
        yield replace(_without(linear, gone), size=size, evidence=evidence - price, log_choices=price)


def _repeats(linear: Linear) -> Iterator[Suspect]:
    """All that was measured again off: something changed after the first measurements, in whatever way."""
    again = repeated(linear.problem)
    if len(again) < FEWEST:
        return
    suspect = replace(_without(linear, again.tolist()), cause="repeats")
    tried = linear.of(suspect.columns(linear))
    yield from _suspects(tried, _MM, suspect)


def _with_each(linear: Linear, gone: list[int]) -> Hypotheses:
    """Each measurement off together with those `gone`."""
    parts, d, count = linear.by_spot, linear.size, linear.problem.shots
    residual, roots = linear.by_shots
    through = roots.transpose(0, 2, 1) @ parts  # (N, f, d)
    slopes = np.einsum("ndk,nd->nk", parts, residual)
    k = d * (len(gone) + 1)
    y, every = np.zeros((count, k)), np.zeros((count, roots.shape[2], k))
    gram = np.zeros((count, k, k))
    for index, i in enumerate([*gone, None]):
        at = slice(d * index, d * index + d)
        y[:, at] = slopes if i is None else slopes[i]
        every[:, :, at] = through if i is None else through[i]
        square = parts.transpose(0, 2, 1) @ parts
        gram[:, at, at] = square if i is None else square[i]
    gram -= every.transpose(0, 2, 1) @ every
    if gone:  # one that is off already is not off again
        y[gone], gram[gone] = 0.0, 0.0
    return Hypotheses(y, gram)


def _without(linear: Linear, gone: Sequence[int]) -> Suspect:
    problem, d = linear.problem, linear.size
    names = tuple(dict.fromkeys(problem.targets[problem.target_index[i]] for i in sorted(gone)))
    numbers = tuple(sorted(problem.shot_numbers[i] for i in gone))

    def parts(linear: Linear) -> Matrix:
        result = np.zeros((problem.shots, d, d * len(gone)))
        for index, i in enumerate(gone):
            result[i, :, d * index : d * index + d] = linear.by_spot[i]
        return result

    return _of_spots("measurements", parts, targets=names, measurements=numbers)


# Errors that follow the motion


def _of_motion(linear: Linear) -> Iterator[Suspect]:
    """A gain of a joint, a lag behind the motion, backlash: of one joint, and of all alike."""
    problem = linear.problem
    turning, motions = revolute(problem), linear.motions()
    gains = np.stack(
        [(linear.by_joints[:, :, i] * problem.joints[:, [i]]) for i in range(problem.robot.n)], axis=-1
    )
    tried = linear.each(linear.rows(gains))
    yield from _suspects(tried, _SHARES, lambda i: _of_joint("gain", i, problem.joints[:, [i]]))
    lag = np.einsum("ndi,ni->nd", linear.by_joints, motions)[:, :, None]
    tried = linear.of(linear.rows(lag))
    yield from _suspects(tried, _SHARES, _of_all_joints("lag", motions[:, :, None]))
    sides = np.sign(motions)
    slack = linear.by_joints[:, :, turning] * sides[:, None, turning]
    unit = float(np.radians(1.0))
    yield from _suspects(
        linear.each(linear.rows(slack)),
        _BACKLASH,
        lambda k: _of_joint("backlash", turning[k], sides[:, [turning[k]]]),
        unit,
    )
    courses = np.zeros((problem.shots, problem.robot.n, len(turning)))
    for k, i in enumerate(turning):
        courses[:, i, k] = sides[:, i]
    together = linear.of(linear.rows(slack))
    yield from _suspects(together, _BACKLASH, _of_all_joints("backlash", courses), unit)


def _of_all_joints(cause: Cause, courses: Matrix) -> Suspect:
    """What adds `courses` (N, n, k) b to the positions of all joints."""

    def columns(linear: Linear) -> Matrix:
        return linear.rows(linear.by_joints @ courses)

    def corrected(linear: Linear, values: Matrix) -> Problem:
        return linear.problem.moved(linear.problem.joints + courses @ values)

    return Suspect(cause, columns, corrected)


# Drift over the run


def _drifts(linear: Linear) -> Iterator[Suspect]:
    problem, passed = linear.problem, elapsed(linear.order, linear.problem.shots)
    for kind, unit in (("revolute", float(np.radians(1.0))), ("prismatic", 1.0)):
        joints = [i for i, joint in enumerate(problem.robot.joints) if joint.kind == kind]
        if joints:
            tried = linear.each(linear.rows(linear.by_joints[:, :, joints] * passed[:, None, None]))
            made = lambda k, joints=joints: _of_joint("drift", joints[k], passed[:, None])  # noqa: E731
            yield from _suspects(tried, _ANGLES if kind == "revolute" else _MM, made, unit)
    parts = []
    for k in range(len(problem.targets)):
        course = passed * (problem.target_index == k)
        parts.append(linear.of(linear.rows(linear.by_target * course[:, None, None])))
    if parts:

        def of_target(k: int) -> Suspect:
            course = passed * (problem.target_index == k)
            return _of_place("drift", course, targets=(problem.targets[k],))

        yield from _suspects(Hypotheses.stacked(parts), _MM, of_target)


# Parameters beyond their tolerances


def _of_parameters(linear: Linear) -> Iterator[Suspect]:
    """The point of the tool, the direction of the beam, one length or angle of the links."""
    parameters = linear.problem.parameters
    items = list(enumerate(parameters.items))
    unit = float(np.radians(1.0))
    if linear.problem.tool.calibrated:
        known = [(i, item.unit) for i, item in items if item.group == "tool" and item.tolerated]
        shifts, tilts = ([i for i, its in known if its == each] for each in ("mm", "deg"))
        for which, sizes, of, scale in ((shifts, _MM[:2], "point", 1.0), (tilts, _TILTS, "direction", unit)):
            if which:
                tried = linear.of(linear.by_parameters(which))
                suspect = _of_prior(which, "tool", of=of)
                yield from _suspects(tried, sizes, suspect, scale)
    for angle in (False, True):
        which = [
            i
            for i, item in items
            if item.group == "geometry"
            and item.of.startswith("link")
            and (item.axis in ANGLES) == angle
            and item.held_by not in ("first link", "free tool")
            # What the last link is off the tool may be off as well: it is called that.
            and item.of != f"link{linear.problem.robot.n}"
        ]
        if which:
            tried = linear.each(linear.by_parameters(which))

            def made(k: int, which: list[int] = which) -> Suspect:
                item = parameters.items[which[k]]
                number = int(item.of.removeprefix("link"))
                return _of_prior([which[k]], "length", joints=(number,), of=item.name)

            yield from _suspects(tried, _TILTS if angle else _MM, made, unit if angle else 1.0)


def _of_prior(which: list[int], cause: Cause, **more: Any) -> Suspect:
    """What moves the prior means of some parameters."""

    def columns(linear: Linear) -> Matrix:
        return linear.by_parameters(which)

    def corrected(linear: Linear, values: Matrix) -> Problem:
        by = dict(zip(which, values.tolist(), strict=True))
        return _with(linear, which, lambda i, item: replace(item, prior_mean=item.prior_mean + by[i]))

    return Suspect(cause, columns, corrected, **more)


def _with(linear: Linear, which: list[int], other: Callable[[int, Parameter], Parameter]) -> Problem:
    """The problem with the parameters `which`, by their places, replaced."""
    items = list(linear.problem.parameters.items)
    for i in which:
        items[i] = other(i, items[i])
    return replace(linear.problem, parameters=Parameters(tuple(items)))


def _tolerances(linear: Linear) -> Iterator[Suspect]:
    """Links, gravity or harmonics by so many times their tolerances."""
    parameters = linear.problem.parameters
    held = [i for i, item in enumerate(parameters.items) if item.group == "geometry" and item.held_by is None]
    if held and all(parameters.items[i].held for i in held):
        yield from _links_freed(linear, held)
    groups: list[tuple[Cause, list[int]]] = [
        (cause, [i for i, item in _free_geometry(parameters) if item in axes])
        for cause, axes in BENDING.items()
    ]
    bending = frozenset().union(*BENDING.values())
    others = [i for i, axis in _free_geometry(parameters) if axis not in bending]
    for cause, which in (("geometry", others), *groups):
        if not which:
            continue
        tried = linear.of(linear.jacobian[:, which])
        evidence, times = max(
            (float(tried.log_evidence(float(np.sqrt(times**2 - 1)))[0]), times) for times in _TIMES
        )
        price = float(np.log(len(_TIMES)))

        def corrected(linear: Linear, _: Matrix, which: list[int] = which, times: float = times) -> Problem:
            return _with(linear, which, lambda _, item: replace(item, prior_std=item.prior_std * times))

        suspect = Suspect(cause, _no_columns, corrected)
        freed = tried.freed(float(np.sqrt(times**2 - 1)))
        yield replace(suspect, evidence=evidence - price, log_choices=price, fixed_amount=times, freed=freed)


def _links_freed(linear: Linear, which: list[int]) -> Iterator[Suspect]:
    """Links of an exact arm within their typical tolerances."""
    tried = linear.of(linear.jacobian[:, which])
    evidence = float(tried.log_evidence(1.0)[0])

    def corrected(linear: Linear, _: Matrix) -> Problem:
        return _with(linear, which, lambda _, item: replace(item, held=False))

    suspect = Suspect("geometry", _no_columns, corrected)
    yield replace(suspect, evidence=evidence, fixed_amount=1.0, freed=tried.freed(1.0))


def _noise(linear: Linear) -> Iterator[Suspect]:
    """All readings scatter so many times as much as stated: the marginal likelihood at that noise."""
    at_means = linear.at_prior_means
    values, vectors = np.linalg.eigh(linear.gram)
    values = np.maximum(values, 0.0)
    along = (vectors.T @ (linear.free.T @ at_means)) ** 2

    def log_marginal(times: float) -> float:
        square = at_means @ at_means / times**2 - (along / (times**4 * (1 + values / times**2))).sum()
        log_det = np.log1p(values / times**2).sum() + 2 * len(at_means) * np.log(times)
        return float(-(square + log_det) / 2)

    evidence, times = max((log_marginal(times) - log_marginal(1.0), times) for times in _NOISE_TIMES)
    price = float(np.log(len(_NOISE_TIMES)))

    def corrected(linear: Linear, _: Matrix) -> Problem:
        noise = linear.problem.noise
        return replace(linear.problem, noise=noise.times(times))

    suspect = Suspect("noise", _no_columns, corrected)
    yield replace(suspect, evidence=evidence - price, log_choices=price, fixed_amount=times)


def _spots(linear: Linear) -> Iterator[Suspect]:
    """Other axes of the spots: exact, as residuals are linear in them."""
    problem = linear.problem
    if not problem.tool.columns or not problem.spots.any():
        return
    price = float(np.log(len(_TURNED)))
    for name, axes in _TURNED.items():
        spots = problem.spots @ np.array(axes, dtype=float)
        columns = linear.rows(linear.by_spot * (spots - problem.spots)[:, None, :]).sum(axis=1)
        tried = linear.of(columns[:, None])

        def corrected(linear: Linear, _: Matrix, spots: Matrix = spots) -> Problem:
            return replace(linear.problem, spots=spots)

        suspect = Suspect("spot", _no_columns, corrected, of=name)
        evidence = -float(tried.y[0, 0] + tried.gram[0, 0, 0] / 2) - price
        yield replace(suspect, evidence=evidence, log_choices=price, fixed_amount=0.0)


def _no_columns(linear: Linear) -> Matrix:
    return np.zeros((len(linear.residual), 0))


def _free_geometry(parameters: Parameters) -> list[tuple[int, str]]:
    return [
        (i, item.axis)
        for i, item in enumerate(parameters.items)
        if item.group == "geometry" and not item.held
    ]
