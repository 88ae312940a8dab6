"""A robust fit besides the likelihood's, and the measurements that it finds to be outliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from ..estimation.robust import Loss, fit_robust, outlying
from ..solution import ParameterResult, Solution
from ..status import Status, UnsoundResult, require_no_more_than

OUTLYING = 1e-3  # chance, over all measurements together, of a residual as long as an outlying one
_MEDIAN_WORTH = 0.48  # a scale from the median is as good as one from so large a share of the numbers


@dataclass(frozen=True)
class RobustParameter:
    """One parameter of a robust fit; `std` and `interval95` are None without a sandwich covariance, all
    three where the data do not determine the parameter (UnsoundResult otherwise)."""

    name: str
    unit: str
    status: Status
    estimate: float | None
    std: float | None
    interval95: tuple[float, float] | None

    def __post_init__(self) -> None:
        require_no_more_than(
            self.name, self.status, estimate=self.estimate, std=self.std, interval95=self.interval95
        )
        if self.std is not None and self.estimate is None:
            raise UnsoundResult(f"{self.name!r} has a std without an estimate")


@dataclass(frozen=True)
class Robust:
    """A fit in which a large residual weighs less: `loss` with its `tuning` (Huber's threshold in stds,
    Student's nu), `weights` of the measurements in their order, `outliers` the numbers of those too far off
    for chance.

    `with_uncertainty` is False where a measurement has leverage 1, or there are no more numbers than
    unknowns.
    """

    loss: Loss
    tuning: float
    converged: bool
    reason: str
    noise_scale: float | None
    parameters: tuple[RobustParameter, ...]
    weights: tuple[float, ...]
    outliers: tuple[int, ...]
    with_uncertainty: bool


def robust_result(solution: Solution, loss: Loss) -> Robust:
    """The robust fit of a solution's measurements."""
    problem, fit = solution.problem, solution.fit
    found = fit_robust(problem, fit, loss)
    parameters = problem.with_noise_of(fit.x)[0].parameters
    std = np.full(len(parameters), np.nan)
    if found.covariance is not None:
        std = parameters.unscaled(np.sqrt(np.diag(found.covariance)))
    numbers = problem.data_size - int(parameters.free.sum())
    quantile = float(scipy.special.stdtrit(max(numbers, 1), 0.975))

    def row(own: ParameterResult, i: int) -> RobustParameter:
        item, value, spread = parameters.items[i], float(found.x[i]), float(std[i])
        determined = own.estimate is not None and found.converged
        with_std = determined and bool(np.isfinite(spread)) and numbers > 0
        ends = (item.shown(value - quantile * spread), item.shown(value + quantile * spread))
        return RobustParameter(
            name=own.name,
            unit=own.unit,
            status=own.status,
            estimate=item.shown(value) if determined else None,
            std=item.shown_std(value, spread) if with_std else None,
            interval95=ends if with_std else None,
        )

    dof = max(1, int(_MEDIAN_WORTH * numbers)) if problem.noise.estimated else None
    off = outlying(found.whitened, problem.tool.residual_size, OUTLYING, dof)
    return Robust(
        loss=loss,
        tuning=found.tuning,
        converged=found.converged,
        reason=found.reason,
        noise_scale=found.scale if problem.noise.estimated else None,
        parameters=tuple(
            row(own, i) for i, own in enumerate(solution.parameters[: len(parameters)]) if not own.held
        ),
        weights=tuple(float(weight) for weight in found.weights),
        outliers=tuple(problem.shot_numbers[i] for i in off) if found.converged else (),
        with_uncertainty=found.covariance is not None and numbers > 0,
    )
