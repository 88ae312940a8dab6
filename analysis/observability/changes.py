"""Has something changed during the run: the zero of a joint, or the place of a target that someone bumped?

Tests for just that, by what is left of the residuals (`left_over`): the squares of all of them say little.

A jump of each joint's zero between any two measurements, a steady drift of it, and a steady drift of a target
move the residuals by B b. With y = B'r and its covariance G = B'M B where nothing changed, priors included,
y'G^-1 y is chi-squared: the likelihood ratio test of a linear model, Bonferroni over all that is tested.

A jump of a target, between two of its measurements, is tested without priors: residuals count only as far as
no offset, target or tool can explain them, whatever the priors. What a rival of stated size can do, such as
links within their tolerance, is taken out too, as far as it is that small.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import field
from itertools import pairwise
from typing import Annotated, Literal, NamedTuple

import numpy as np
import scipy

from ...model.arrays import Index, Matrix
from ...model.likelihood.problem import Problem, Whitened
from ...model.records import internal, record
from ..estimation.fit import LikelihoodFit
from ..left_over import DETERMINED_MM, EXCLUDES, Contradiction, Hypotheses, LeftOver, Linearised, by_targets
from .geometry_result import with_links

# p-value of the clearest change of a run, after all that is tested. With the price of its size, a factor of
# some 30, such a change is 20 times as likely as none.
SIGNIFICANT = 1e-4
FEWEST = 2  # measurements before and after a change

# p-value of the clearest change by what was measured again: one run in a hundred is doubted for nothing, and
# the remedy is to measure those postures once more.
DOUBTFUL = 0.01
# rad, mm: of one posture. A servo turns the wrist by what has changed: where a zero jumped by 1 degree, the
# repeats of 60 % of arms are this near, of none within 0.3. No pattern's last posture is, to its first.
_SAME = {"revolute": np.radians(3.0), "prismatic": 10.0}
_MOST = 1000  # measurements, of which those that end where they began are looked for

MOST_OF = 0.5  # of the squares of all residuals, from which repeats are what is wrong

How = Literal["jump", "drift"]


@record
class ChangeAt:
    """The zero of `joint` (from 1), or a `target`, jumped between two measurements or drifted from the first
    to the last of them (`after_shot`, `before_shot`), by `amount` with the standard uncertainty `std` (deg,
    mm)."""

    how: How
    joint: int | None
    target: str | None
    after_shot: int
    before_shot: int
    amount: float
    std: float
    unit: str


@record
class RunChange(Contradiction, ChangeAt):
    """The clearest change of a run. `p_value` is that of one as clear among all that is tested;
    `elsewhere` are other joints, targets and ways that explain the residuals nearly as well (likelihood ratio
    within 20)."""

    kind: Literal["change"] = field(default="change", kw_only=True)

    p_value: float
    elsewhere: Annotated[tuple[ChangeAt, ...], internal]


@record
class RepeatsDiffer(ChangeAt):
    """The measurements `again` do not agree with those that they repeat: not so clearly that the run is
    refuted. `p_value` is that of a difference as clear among all that is tested; `repeated` are those that
    they repeat."""

    p_value: float
    again: tuple[int, ...]
    repeated: tuple[int, ...]


@record
class RepeatsApart(Contradiction):
    """The measurements `again` are `size_mm` (rms) apart from those that they repeat, whatever the model is;
    `p_value` is that of such differences by the stated noise. They are most of what the model leaves."""

    kind: Literal["repeats"] = field(default="repeats", kw_only=True)

    again: tuple[int, ...]
    size_mm: float
    p_value: float


def repeated(problem: Problem) -> Index:
    """The places of the measurements with which a run ends as it began: each in a posture of its first half,
    but for how a servo turns the wrist, at the same target. Empty where it does not."""
    return repeated_pairs(problem)[:, 1]


def repeated_pairs(problem: Problem) -> Index:
    """(r, 2) the place of what is repeated, and that of its repeat (`repeated`)."""
    order, count = problem.order, problem.shots
    near = np.array([_SAME[joint.kind] for joint in problem.robot.joints])
    joints, targets = problem.joints[order], problem.target_index[order]
    again, pairs = 0, np.zeros((0, 2), dtype=int)
    while FEWEST < count - again <= _MOST:
        last, first = count - 1 - again, min((count - again) // 2, count - again - FEWEST)
        same = (np.abs(joints[:first] - joints[last]) < near).all(axis=1) & (targets[:first] == targets[last])
        if not same.any():
            break
        pairs = np.vstack([[np.argmax(same), last], pairs])
        again += 1
    return np.asarray(order[pairs])


def repeats_apart(problem: Problem, whitened: Whitened) -> RepeatsApart | None:
    """Whether what was measured again is what contradicts the noise of a fit: no model of the arm, right or
    wrong, makes two readings in one posture differ. None where it is not, and where the noise is unknown."""
    first, again = repeated_pairs(problem).T
    if not problem.noise.known or not len(again):
        return None
    residual, residual_mm = whitened.residual, whitened.residual_mm
    by_shots = residual[: residual_mm.size].reshape(residual_mm.shape)
    squares = float(((by_shots[again] - by_shots[first]) ** 2).sum() / 2)
    p_value = float(scipy.special.chdtrc(problem.active[again].sum(), squares))
    if p_value >= SIGNIFICANT or squares < MOST_OF * float(residual @ residual):
        return None
    size = problem.select(again).rms_mm(residual_mm[again] - residual_mm[first])
    numbers = tuple(problem.shot_numbers[i] for i in again)
    return RepeatsApart(numbers, size, p_value)


def repeats_differ(problem: Problem, x: Matrix) -> RepeatsDiffer | None:
    """What changed by what was measured again, at the mode x (p,): before it, halfway or steadily; None where
    nothing did, where nothing was measured again, and where the noise is not known."""
    pairs = repeated_pairs(problem)
    first, again = pairs.T
    if not problem.noise.known or not len(again):
        return None
    fit = Linearised(problem, x)
    tried = sorted(_by_repeats(fit, again), key=lambda row: row.p_value)
    p_value = tried[0].p_value * _repeat_tests(problem) if tried else 1.0
    if p_value >= DOUBTFUL:
        return None
    firsts, numbers = (tuple(problem.shot_numbers[i] for i in places) for places in (first, again))
    return RepeatsDiffer(**vars(tried[0].of), p_value=p_value, again=numbers, repeated=firsts)


def repeat_limit(problem: Problem, rank: int = 1) -> float:
    """The chi-squared of this rank beyond which what was measured again differs; infinite where nothing
    was."""
    if not len(repeated(problem)):
        return float("inf")
    return float(scipy.special.chdtri(rank, DOUBTFUL / _repeat_tests(problem)))


def _repeat_tests(problem: Problem) -> int:
    return 3 * (problem.robot.n + len(problem.targets))


def change_limit(problem: Problem, rank: int = 1) -> float:
    """The chi-squared of this rank beyond which a change counts as significant; infinite where none is
    tested."""
    if _places(problem.shots) == 0:
        return float("inf")
    return float(scipy.special.chdtri(rank, SIGNIFICANT / _tests(problem)))


def _tests(problem: Problem) -> int:
    return problem.robot.n * (_places(problem.shots) + 1) + len(problem.targets)


def _places(shots: int) -> int:
    return max(0, shots - 2 * FEWEST + 1)


def run_change(problem: Problem, x: Matrix, rival: Matrix | None = None) -> RunChange | None:
    """The significant change at the mode x (p,); None without one, and where the noise is not known. `rival`
    as of `Linearised`, such as the common errors of joints that rested."""
    if not problem.noise.known or _places(problem.shots) == 0:
        return None
    return _change(Linearised(problem, x, rival))


def run_change_with_links(problem: Problem, x: Matrix) -> RunChange | None:
    """The same of an exact arm whose links may deviate within typical tolerances, by one step from the mode
    x (p,): what they explain is no change."""
    whole, start = with_links(problem, x)
    return _change(Linearised(whole, start, settled=True))


def _change(fit: Linearised) -> RunChange | None:
    tried = sorted(_clearest(fit), key=lambda row: row.p_value)
    p_value = tried[0].p_value * _tests(fit.problem) if tried else 1.0
    if p_value >= SIGNIFICANT:
        return None
    near = tried[0].score - 2 * np.log(EXCLUDES)
    return RunChange(
        **vars(tried[0].of), p_value=p_value, elsewhere=tuple(row.of for row in tried[1:] if row.score > near)
    )


class _Tried(NamedTuple):
    """A change, the p-value of it alone, and twice its log-likelihood ratio less Akaike's price."""

    of: ChangeAt
    p_value: float
    score: float


class _Moves(NamedTuple):
    """By how much a unit of the zero of `joint` (from 1), or of where a `target` is, moves the whitened
    residuals of each measurement, (N, d, k); `shown` is that unit in `unit`."""

    parts: Matrix
    joint: int | None
    target: str | None
    unit: str
    shown: float


def _moves(fit: Linearised) -> Iterator[_Moves]:
    """Of each joint and target; an amount of one unit is determined where its information is 1."""
    problem = fit.problem
    for i, joint in enumerate(problem.robot.joints):
        turns = joint.kind == "revolute"
        unit, size, shown = ("deg", np.radians(1.0), 1.0) if turns else ("mm", 10.0, 10.0)
        yield _Moves(fit.by_joints[:, :, [i]] * size, i + 1, None, unit, shown)
    for k, name in enumerate(problem.targets):
        mine = (problem.target_index == k)[:, None, None]
        yield _Moves(mine * fit.by_target * DETERMINED_MM, None, name, "mm", DETERMINED_MM)


def _clearest(fit: Linearised) -> Iterator[_Tried]:
    """The clearest jump and the drift of each joint, and the drift of each target."""
    problem, order = fit.problem, fit.order
    numbers = [problem.shot_numbers[i] for i in order]
    ends = [*zip(numbers[FEWEST - 1 :], numbers[FEWEST : len(numbers) - FEWEST + 1], strict=False)]
    for moves in _moves(fit):
        mine = order
        if moves.target is not None:
            mine = order[problem.target_index[order] == problem.targets.index(moves.target)]
            if len(mine) < 2 * FEWEST:
                continue
        else:
            yield from _best(fit, fit.after(moves.parts, order, FEWEST), "jump", moves, ends)
        drift = fit.of(fit.rows(moves.parts * elapsed(mine, len(order))[:, None, None]))
        yield from _best(
            fit, drift, "drift", moves, [(problem.shot_numbers[mine[0]], problem.shot_numbers[mine[-1]])]
        )


def _by_repeats(fit: Linearised, again: Index) -> Iterator[_Tried]:
    """The clearest jump, halfway or before what is measured again, and the drift of each joint and target."""
    order, count = fit.order, len(fit.order)
    numbers, jumps = [fit.problem.shot_numbers[i] for i in order], (count // 2, count - len(again))
    after = np.zeros((len(jumps), count, 1, 1))
    for course, first in zip(after, jumps, strict=True):
        course[order[first:]] = 1.0
    ends = [(numbers[first - 1], numbers[first]) for first in jumps]
    passed = elapsed(order, count)[:, None, None]
    for moves in _moves(fit):
        either = Hypotheses.stacked([fit.of(fit.rows(moves.parts * course)) for course in after])
        yield from _best(fit, either, "jump", moves, ends)
        drift = fit.of(fit.rows(moves.parts * passed))
        yield from _best(fit, drift, "drift", moves, [(numbers[0], numbers[-1])])


def _best(
    fit: Linearised,
    hypotheses: Hypotheses,
    how: How,
    moves: _Moves,
    ends: Sequence[tuple[int, int]],
) -> Iterator[_Tried]:
    """The clearest of changes between these measurements, in units of what is tested; none where the
    measurements do not determine it."""
    explained = fit.explained(hypotheses, 1.0)
    best = int(np.argmax(explained.drop))
    if explained.rank[best] == 0 or explained.drop[best] == 0:
        return
    known = explained.values[best] > 1
    values, along = explained.values[best][known], explained.along[best][known]
    shift = along / values
    size = float(np.linalg.norm(shift))
    _, joint, target, unit, shown = moves
    amount = size if joint is None else -float(explained.vectors[best][0, 0] * shift[0])
    std = float(np.sqrt((shift**2 / values).sum())) / size
    one = ChangeAt(how, joint, target, *ends[best], amount * shown, std * shown, unit)
    yield _Tried(one, fit.p_value(explained, best), float(explained.score[best]))


def elapsed(rows: Index, count: int) -> Matrix:
    """(count,) from 0 at the first of `rows`, in their order, to 1 at the last; 0 elsewhere."""
    result = np.zeros(count)
    result[rows] = np.linspace(0.0, 1.0, len(rows))
    return result


_SIGNIFICANCE = 1e-3  # that a run without a displacement is said to have one; that what is left is not noise
_DECIDES = 1e-4  # leverage 1: the fit leaves no more of the measurement's residual than this share
_ROUNDING = 1e-12  # of the information that all shots together have on a place


class ChangePoint(NamedTuple):
    """Between two shots at one target that follow each other there, by their numbers."""

    target: str
    after_shot: int
    before_shot: int


@record
class Displacement(Contradiction):
    """The most likely displacement of a run: of `target`, between two shots.

    `p_value` is that of one as clear anywhere in the run, by Bonferroni's bound over the change points.
    `shift_mm` (base frame) and its `std_mm` have None for an undetermined component; `size_mm` and
    `size_std_mm` are None while one is. `elsewhere` are the change points that explain the residuals nearly
    as well (likelihood ratio within 20), `alone` is the measurement that does so if it alone is off, and
    `better_alone` says that it does so better. `rest_agrees` says that with the displacement the residuals
    agree with the stated noise (True where its scale is estimated). Of a `station` it is the instrument that
    moved relative to the base.
    """

    kind: Literal["moved_target"] = field(default="moved_target", kw_only=True)

    target: str
    after_shot: int
    before_shot: int
    p_value: float
    shift_mm: Annotated[tuple[float | None, ...], internal]
    std_mm: Annotated[tuple[float | None, ...], internal]
    size_mm: float | None
    size_std_mm: float | None
    elsewhere: Annotated[tuple[ChangePoint, ...], internal]
    alone: Annotated[int | None, internal]
    better_alone: Annotated[bool, internal]
    rest_agrees: Annotated[bool, internal]
    station: Annotated[bool, internal] = False

    @property
    def significant(self) -> bool:
        """Beyond noise, not better explained by one measurement that is off, and enough to explain the
        residuals: where the model does not fit, a displacement takes up a part of that too."""
        return self.p_value < _SIGNIFICANCE and not self.better_alone and self.rest_agrees


def displacement(fit: LikelihoodFit, rival: Matrix | None = None) -> Displacement | None:
    """The most likely displacement in the run of `fit`, whether it is significant or not.

    `rival` (M, g) are whitened columns of another explanation of the residuals, times the prior stds of its
    parameters (`link_columns`): it is marginalised.

    None where no change point can be tested: no target has two shots, or the shots are so few that offsets,
    places and tool explain whatever a displacement would do.
    """
    left = left_over(fit, rival)
    points, hypotheses, floor = displacements(fit, left)
    if not points:
        return None
    moved = left.explained(hypotheses, floor)
    best = int(np.argmax(moved.score))
    if moved.rank[best] == 0:
        return None
    problem = fit.problem
    read = np.eye(problem.tool.residual_size) * problem.active[:, :, None]
    single = left.explained(left.alone(read), _DECIDES)
    off = int(np.argmax(single.score))
    near = moved.score[best] - 2 * np.log(EXCLUDES)
    shift, covariance = left.estimate(moved, best)
    std = np.sqrt(np.diag(covariance))
    determined = std < DETERMINED_MM
    size = float(np.linalg.norm(shift)) if determined.all() else None
    return Displacement(
        **points[best]._asdict(),
        p_value=min(1.0, left.p_value(moved, best) * int((moved.rank > 0).sum())),
        shift_mm=tuple(float(v) if known else None for v, known in zip(shift, determined, strict=True)),
        std_mm=tuple(float(v) if known else None for v, known in zip(std, determined, strict=True)),
        size_mm=size,
        size_std_mm=float(np.sqrt(shift @ covariance @ shift)) / size if size else None,
        elsewhere=tuple(points[i] for i in np.flatnonzero(moved.score > near) if i != best),
        alone=problem.shot_numbers[off] if single.score[off] > near else None,
        # One shot before or after it is the same as that shot off alone: equal, but for rounding.
        better_alone=bool(single.score[off] > moved.score[best] + 1e-6 * left.chi2),
        rest_agrees=_agrees(left, *left.rest(moved, best)),
        station=problem.is_station(points[best].target),
    )


def _agrees(left: LeftOver, rest: float, dof: int) -> bool:
    """Whether the rest is no more than the noise (if it is known)."""
    return not left.known or dof <= 0 or bool(scipy.special.chdtrc(dof, rest) >= _SIGNIFICANCE)


def left_over(fit: LikelihoodFit, rival: Matrix | None = None) -> LeftOver:
    """What is left of the residuals once all that offsets, targets and tool can do is taken out; what has a
    tolerance, and the `rival`, within that."""
    problem, whitened = fit.problem, fit.whitened
    residual, columns = whitened.residual, whitened.jacobian[:, problem.parameters.free]
    tolerated = problem.parameters.among_free[problem.tolerated]
    # Least squares with a row for each prior, in units of the stated noise as well.
    root = 1 / np.sqrt(fit.weight)
    if len(tolerated):
        columns = np.vstack([columns, np.eye(columns.shape[1])[tolerated] * root])
        residual = np.append(residual, fit.z[tolerated] * root)
    if rival is not None:
        count = rival.shape[1]
        priors = np.hstack([np.zeros((count, columns.shape[1])), np.eye(count) * root])
        beside = np.vstack([rival, np.zeros((len(columns) - len(rival), count))])  # of no tolerance's row
        columns = np.vstack([np.hstack([columns, beside]), priors])
        residual = np.append(residual, np.zeros(count))
    numbers = problem.measured_size + len(residual) - len(whitened.residual)
    shape = problem.shots, problem.tool.residual_size
    return LeftOver.without_priors(residual, columns, shape, numbers, known=problem.noise.known)


def displacements(fit: LikelihoodFit, left: LeftOver) -> tuple[list[ChangePoint], Hypotheses, float]:
    """All change points (C,), displacements there (mm), and the information (1 / mm^2) below which a
    direction is not determined."""
    problem = fit.problem
    by_place = by_targets(problem, fit.whitened)
    order = problem.order
    points: list[ChangePoint] = []
    every = [Hypotheses(np.empty((0, 3)), np.empty((0, 3, 3)))]
    for k, target in enumerate(problem.targets):
        mine = order[problem.target_index[order] == k]
        every.append(left.after(by_place, mine))
        numbers = [problem.shot_numbers[i] for i in mine]
        points += [ChangePoint(target, a, b) for a, b in pairwise(numbers)]
    # What the fit takes out leaves rounding of the size of what was there.
    floor = max(DETERMINED_MM**-2, _ROUNDING * float((by_place**2).sum()))
    return points, Hypotheses.stacked(every), floor
