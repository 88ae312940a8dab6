"""Has the zero of a joint changed during the run? A test for that: the squares of all residuals say little.

For a jump of each joint's zero between any two measurements, a steady drift of it, and a steady drift of a
target: the residuals are moved by B b. With r at the mode and M as in `biases`, y = B'r has the covariance
G = B'M B where nothing changed, priors included, and y'G^-1 y is chi-squared: the likelihood ratio test of a
linear model, Bonferroni over all that is tested. A jump of a target has a test of its own (`displacement`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import field
from typing import Annotated, Literal, NamedTuple

import numpy as np
import scipy

from ...model.arrays import Index, Matrix
from ...model.likelihood.problem import Problem, Whitened
from ...model.records import internal, record
from ..left_over import DETERMINED_MM, EXCLUDES, Contradiction, Hypotheses
from .biases import Linearised
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
