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
from ...model.likelihood.problem import Problem
from ...model.records import internal, record
from ..left_over import DETERMINED_MM, EXCLUDES, Contradiction, Hypotheses
from .biases import Linearised
from .geometry_result import with_links

# p-value of the clearest change of a run, after all that is tested. With the price of its size, a factor of
# some 30, such a change is 20 times as likely as none.
SIGNIFICANT = 1e-4
FEWEST = 2  # measurements before and after a change

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


def _clearest(fit: Linearised) -> Iterator[_Tried]:
    """The clearest jump and the drift of each joint, and the drift of each target."""
    problem, order = fit.problem, fit.order
    numbers = [problem.shot_numbers[i] for i in order]
    passed = elapsed(order, len(order))[:, None, None]
    for i, joint in enumerate(problem.robot.joints):
        turns = joint.kind == "revolute"
        unit, size, shown = ("deg", np.radians(1.0), 1.0) if turns else ("mm", 10.0, 10.0)
        parts: Matrix = fit.by_joints[:, :, [i]] * size
        ends = [*zip(numbers[FEWEST - 1 :], numbers[FEWEST : len(numbers) - FEWEST + 1], strict=False)]
        yield from _best(fit, fit.after(parts, order, FEWEST), "jump", i + 1, None, ends, unit, shown)
        whole = [(numbers[0], numbers[-1])]
        yield from _best(fit, fit.of(fit.rows(parts * passed)), "drift", i + 1, None, whole, unit, shown)
    for k, name in enumerate(problem.targets):
        mine = order[problem.target_index[order] == k]
        if len(mine) >= 2 * FEWEST:
            course = elapsed(mine, len(order))[:, None, None]
            drift = fit.of(fit.rows(fit.by_target * course * DETERMINED_MM))
            whole = [(problem.shot_numbers[mine[0]], problem.shot_numbers[mine[-1]])]
            yield from _best(fit, drift, "drift", None, name, whole, "mm", DETERMINED_MM)


def _best(
    fit: Linearised,
    hypotheses: Hypotheses,
    how: How,
    joint: int | None,
    target: str | None,
    ends: Sequence[tuple[int, int]],
    unit: str,
    shown: float,
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
    amount = size if joint is None else -float(explained.vectors[best][0, 0] * shift[0])
    std = float(np.sqrt((shift**2 / values).sum())) / size
    one = ChangeAt(how, joint, target, *ends[best], amount * shown, std * shown, unit)
    yield _Tried(one, fit.p_value(explained, best), float(explained.score[best]))


def elapsed(rows: Index, count: int) -> Matrix:
    """(count,) from 0 at the first of `rows`, in their order, to 1 at the last; 0 elsewhere."""
    result = np.zeros(count)
    result[rows] = np.linspace(0.0, 1.0, len(rows))
    return result
