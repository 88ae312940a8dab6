"""Has a target been displaced during the run: did someone bump the PSD between two shots?

For each target and each change point between two of its shots the likelihood-ratio test of two places against
one, at the linearised fit. Residuals count there only as far as no offset, target or tool can explain them,
whatever the priors: the drop of their sum of squares is then exactly chi-squared (or an F ratio, where the
noise scale is estimated; Seber & Lee, Linear Regression Analysis, 2003, section 4.3). What a rival of stated
size can do, such as links within their tolerance, is taken out too, as far as it is that small.
"""

from __future__ import annotations

from dataclasses import field
from itertools import pairwise
from typing import Annotated, Literal, NamedTuple

import numpy as np
import scipy

from ..model.arrays import Matrix
from ..model.records import internal, record
from .estimation.fit import LikelihoodFit
from .left_over import DETERMINED_MM, EXCLUDES, Contradiction, Hypotheses, LeftOver
from .recordings.recordings import by_targets

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
