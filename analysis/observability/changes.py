"""Has the zero of a joint changed during the run? A test for that: the squares of all residuals say little.

For a jump of each joint's zero between any two measurements, a steady drift of it, and a steady drift of a
target: the residuals are moved by B b. With r at the mode and M as in `biases`, y = B'r has the covariance
G = B'M B where nothing changed, priors included, and y'G^-1 y is chi-squared: the likelihood ratio test of a
linear model, Bonferroni over all that is tested. A jump of a target has a test of its own (`displacement`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field
from typing import Annotated, Literal, NamedTuple

import numpy as np
import scipy

from ...model.arrays import Index, Matrix
from ...model.likelihood.problem import Problem
from ...model.records import internal, record, worded
from .biases import Linearised
from .geometry import with_links

# p-value of the clearest change of a run, after all that is tested. With the price of its size, a factor of
# some 30, such a change is 20 times as likely as none.
SIGNIFICANT = 1e-4
FEWEST = 2  # measurements before and after a change
# A change that the measurements determine no better is not tested: of a joint by 1 degree (10 mm).
_DETERMINED_MM = 10.0
_EXCLUDES = 20.0  # likelihood ratio by which one explanation excludes another

How = Literal["jump", "drift"]


class ChangeAt(NamedTuple):
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
class RunChange:
    """The clearest change of a run. `p_value` is that of one as clear among all that is tested;
    `elsewhere` are other joints, targets and ways that explain the residuals nearly as well (likelihood ratio
    within 20)."""

    kind: Literal["change"] = field(default="change", kw_only=True)

    how: How
    joint: int | None
    target: str | None
    after_shot: int
    before_shot: int
    amount: float
    std: float
    unit: str
    p_value: float
    elsewhere: Annotated[tuple[ChangeAt, ...], internal]
    sentence: Annotated[str | None, worded("in words")] = field(default=None, kw_only=True)


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
    fit, parameters = Linearised(whole, start), whole.parameters
    z = ((start - parameters.prior_mean) / parameters.prior_std)[parameters.free]
    fit.residual = fit.residual - fit.free @ (fit.covariance @ (fit.free.T @ fit.residual + z))
    return _change(fit)


def _change(fit: Linearised) -> RunChange | None:
    problem = fit.problem
    tried = sorted(_Changes(fit).clearest(), key=lambda row: row.p_value)
    p_value = tried[0].p_value * _tests(problem) if tried else 1.0
    if p_value >= SIGNIFICANT:
        return None
    best, near = tried[0], tried[0].score - 2 * np.log(_EXCLUDES)
    return RunChange(*best.of, p_value, tuple(row.of for row in tried[1:] if row.score > near))


class _Tried(NamedTuple):
    """A change, the p-value of it alone, and twice its log-likelihood ratio less Akaike's price."""

    of: ChangeAt
    p_value: float
    score: float


class _Changes:
    """All changes that are tested, at a mode."""

    def __init__(self, fit: Linearised) -> None:
        self._fit = fit

    def clearest(self) -> Iterator[_Tried]:
        """The clearest jump and the drift of each joint, and the drift of each target."""
        problem, order = self._fit.problem, self._fit.order
        for joint in range(problem.robot.n):
            yield from self._of_joint(joint)
        for target in range(len(problem.targets)):
            mine = order[problem.target_index[order] == target]
            if len(mine) >= 2 * FEWEST:
                yield from self._of_target(problem.targets[target], mine)

    def _of_joint(self, joint: int) -> Iterator[_Tried]:
        fit, order, numbers = self._fit, self._fit.order, self._fit.problem.shot_numbers
        turns = fit.problem.robot.joints[joint].kind == "revolute"
        unit, size, shown = ("deg", np.radians(1.0), 1.0) if turns else ("mm", 10.0, 10.0)
        parts: Matrix = fit.by_joints[:, :, [joint]] * size
        y, gram = after(parts[order], fit.roots[order], fit.shots_residual[order], fit.covariance)
        slopes, information = y[:, 0], gram[:, 0, 0]
        drift, of_drift = fit.normal(fit.rows(parts * elapsed(order, len(order))[:, None, None]))
        best = int(np.argmax(slopes**2 / np.maximum(information, 1.0)))
        ends = numbers[order[best + FEWEST - 1]], numbers[order[best + FEWEST]]
        whole = numbers[order[0]], numbers[order[-1]]
        rows: list[tuple[How, float, float, tuple[int, int]]] = [
            ("jump", slopes[best], information[best], ends),
            ("drift", drift[0], of_drift[0, 0], whole),
        ]
        for how, slope, g, (first, second) in rows:
            if g > 1:
                amount, std = -slope / g * shown, shown / float(np.sqrt(g))
                one = ChangeAt(how, joint + 1, None, first, second, float(amount), std, unit)
                yield _tried(one, float(slope**2 / g), 1)

    def _of_target(self, name: str, mine: Index) -> Iterator[_Tried]:
        fit, numbers = self._fit, self._fit.problem.shot_numbers
        course = elapsed(mine, len(fit.order))
        y, gram = fit.normal(fit.rows(fit.by_target * course[:, None, None]))
        values, vectors = np.linalg.eigh(gram)
        known = values * _DETERMINED_MM**2 > 1
        values, along = values[known], (vectors.T @ y)[known]
        chi2, shift = float((along**2 / values).sum()), along / values
        size = float(np.linalg.norm(shift))
        if size > 0:
            std = float(np.sqrt((shift**2 / values).sum())) / size
            ends = numbers[mine[0]], numbers[mine[-1]]
            yield _tried(ChangeAt("drift", None, name, *ends, size, std, "mm"), chi2, int(known.sum()))


def _tried(one: ChangeAt, chi2: float, rank: int) -> _Tried:
    return _Tried(one, float(scipy.special.chdtrc(rank, chi2)), chi2 - 2 * rank)


def elapsed(rows: Index, count: int) -> Matrix:
    """(count,) from 0 at the first of `rows`, in their order, to 1 at the last; 0 elsewhere."""
    result = np.zeros(count)
    result[rows] = np.linspace(0.0, 1.0, len(rows))
    return result


def after(parts: Matrix, roots: Matrix, residual: Matrix, covariance: Matrix) -> tuple[Matrix, Matrix]:
    """y (C, k) and G (C, k, k) of a change at each place between measurements in their order, by columns
    (n, d, k), their Jacobians (n, d, f), residuals (n, d) and the parameters' covariance."""
    squares = parts.transpose(0, 2, 1) @ parts
    cross = roots.transpose(0, 2, 1) @ parts
    slopes = np.einsum("ndk,nd->nk", parts, residual)
    first, last = FEWEST, len(parts) - FEWEST
    square, through, slope = (
        np.cumsum(part[::-1], axis=0)[::-1][first : last + 1] for part in (squares, cross, slopes)
    )
    return slope, square - through.transpose(0, 2, 1) @ covariance @ through
