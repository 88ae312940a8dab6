"""Outliers: long residuals in a robust fit, the one measurement that contradicts the others, values far from
the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np
import scipy

from ...model.arrays import Matrix
from ...model.records import internal, it, record, worded
from ..estimation.fit import LikelihoodFit, fit_likelihood
from ..row import ParameterRow
from ..solution import ParameterResult, Solution
from .influence import Loss, fit_robust, outlying

OUTLYING = 1e-3  # p-value, over all measurements together, of an outlying residual
FEWEST_VALUES = 15  # from here on the level of `outlying_values` holds (Rosner 1983, table 3)
_MOST_OUTLYING = 0.1  # of all values: more are no outliers but another population
_SIGNIFICANT = 1e-3  # of a single outlier, after Bonferroni's correction
_MEDIAN_WORTH = 0.48  # a scale from the median is as good as one from so large a share of the numbers


@record
class Robust:
    """A fit in which a large residual weighs less; outliers are beyond `OUTLYING`. `with_uncertainty` is
    False where a measurement has leverage 1, or there are no more numbers than unknowns."""

    loss: Annotated[Loss, it("the loss function")]
    tuning: Annotated[
        float,
        it(
            "of `huber` the normalised residual beyond which the weight falls; of `student` the "
            "degrees of freedom"
        ),
    ]
    converged: Annotated[bool, it("whether the weights converged; if not, no parameter has a number")]
    reason: Annotated[str, it("termination, in words")]
    noise_scale: Annotated[
        float | None,
        it(
            "the noise as a multiple of the stated one, from the median residual; null unless "
            "`noise.scale: estimated`"
        ),
    ]
    parameters: Annotated[
        tuple[ParameterRow, ...],
        it(
            "by the robust fit; `std` and `interval95` by a sandwich covariance, from the residuals as they"
            " are: null with a measurement of leverage 1"
        ),
    ]
    weights: Annotated[
        tuple[float, ...],
        it(
            "of the measurements, in the order of `shots`: with 1 a measurement counts as in the "
            "likelihood fit (Student: a little more than 1 for a small residual)"
        ),
    ]
    outliers: Annotated[
        tuple[int, ...], it("numbers of the outlying measurements, the largest residual first")
    ]
    with_uncertainty: Annotated[bool, internal]
    message: Annotated[str | None, worded("the same in words")] = field(default=None, kw_only=True)


def robust_result(solution: Solution, loss: Loss) -> Robust:
    """The robust fit of a solution's measurements."""
    problem, fit = solution.problem, solution.fit
    robust = fit_robust(problem, fit, loss)
    parameters = problem.with_noise_of(fit.x)[0].parameters
    std = np.full(len(parameters), np.nan)
    if robust.covariance is not None:
        std = parameters.unscaled(np.sqrt(np.diag(robust.covariance)))
    numbers = problem.data_size - int(parameters.free.sum())
    quantile = float(scipy.special.stdtrit(max(numbers, 1), 0.975))

    def row(parameter: ParameterResult, i: int) -> ParameterRow:
        item, value, spread = parameters.items[i], float(robust.x[i]), float(std[i])
        determined = parameter.estimate is not None and robust.converged
        with_std = determined and bool(np.isfinite(spread)) and numbers > 0
        ends = (item.shown(value - quantile * spread), item.shown(value + quantile * spread))
        return ParameterRow(
            name=parameter.name,
            unit=parameter.unit,
            status=parameter.status,
            estimate=item.shown(value) if determined else None,
            std=item.shown_std(value, spread) if with_std else None,
            interval95=ends if with_std else None,
        )

    dof = max(1, int(_MEDIAN_WORTH * numbers)) if problem.noise.estimated else None
    off = outlying(robust.whitened, problem.sizes, OUTLYING, dof)
    return Robust(
        loss=loss,
        tuning=robust.tuning,
        converged=robust.converged,
        reason=robust.reason,
        noise_scale=robust.scale if problem.noise.estimated else None,
        parameters=tuple(
            row(parameter, i)
            for i, parameter in enumerate(solution.parameters[: len(parameters)])
            if not parameter.held
        ),
        weights=tuple(float(weight) for weight in robust.weights),
        outliers=tuple(problem.shot_numbers[i] for i in off) if robust.converged else (),
        with_uncertainty=robust.covariance is not None and numbers > 0,
    )


@dataclass(frozen=True)
class SingleOutlier:
    """A measurement without which chi-squared falls by more than noise explains; its residual at the fit of
    the others is `residual_mm` long. `p_value` is corrected for the number of measurements."""

    shot: int
    p_value: float
    residual_mm: float


def single_outlier(fit: LikelihoodFit, dof: int) -> SingleOutlier | None:
    """The measurement that contradicts the others most, None where none does significantly.

    Only by a stated noise, and where the others leave numbers over (`dof` with it) to contradict it.
    """
    problem, sizes = fit.problem, fit.problem.sizes
    if not problem.noise.known or dof <= sizes.max():
        return None

    def cost(candidate: LikelihoodFit) -> float:
        residual = candidate.whitened.residual
        return float(residual @ residual + candidate.z @ candidate.z)

    rows = np.arange(problem.shots)
    others = [fit_likelihood(problem.select(np.delete(rows, i)), starts=0) for i in rows]
    i = int(np.argmin([cost(rest) for rest in others]))
    drop = max(cost(fit) - cost(others[i]), 0.0)
    p_value = min(1.0, problem.shots * float(scipy.special.chdtrc(sizes[i], drop)))
    residual_mm = problem.select(rows[[i]]).whiten(others[i].x).residual_mm[0]
    if p_value >= _SIGNIFICANT:
        return None
    length = problem.select(rows[[i]]).length_mm(residual_mm[None])[0]
    return SingleOutlier(problem.shot_numbers[i], p_value, float(length))


class OutlyingValue(NamedTuple):
    """The value with the index `row`; `deviation` from the mean of the others, in their standard
    deviations."""

    row: int
    deviation: float


def outlying_values(values: Sequence[float] | Matrix, level: float) -> list[OutlyingValue]:
    """The outliers among normal `values`, the furthest first; none among fewer than `FEWEST_VALUES`.

    The generalised extreme Studentised deviate test (Rosner, Technometrics 25, 1983), of a number of outliers
    that is not known beforehand. With no outlier it names one with a probability of `level` at most; several
    do not hide each other.
    """
    all_values = np.asarray(values, dtype=float)
    count, left = len(all_values), np.arange(len(all_values))
    if count < FEWEST_VALUES:
        return []
    removed: list[int] = []
    count_outlying = 0
    for k in range(1, max(1, int(_MOST_OUTLYING * count)) + 1):
        rest = all_values[left]
        off, std = np.abs(rest - rest.mean()), float(rest.std(ddof=1))
        if not std > 0:
            break
        furthest = int(np.argmax(off))
        removed.append(int(left[furthest]))
        left = np.delete(left, furthest)
        if off[furthest] / std > _critical(count, k, level):
            count_outlying = k
    others = np.setdiff1d(np.arange(count), removed[:count_outlying])
    mean, std = float(all_values[others].mean()), float(all_values[others].std(ddof=1))
    return [OutlyingValue(row, float((all_values[row] - mean) / std)) for row in removed[:count_outlying]]


def _critical(count: int, k: int, level: float) -> float:
    """Rosner's lambda of the k-th deviate of so many values."""
    dof = count - k - 1
    t = float(scipy.special.stdtrit(dof, 1 - level / (2 * (count - k + 1))))
    return (count - k) * t / float(np.sqrt((dof + t * t) * (count - k + 1)))
