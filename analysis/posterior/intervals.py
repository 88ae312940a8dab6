"""The 95 % interval of a parameter by three methods: curvature, profile likelihood, posterior."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...model.arrays import Index, Matrix
from ...model.likelihood.problem import Problem
from ..estimation.fit import LikelihoodFit
from ..solution import Solution
from ..status import Status, require_no_more_than
from .posterior import PosteriorSummary
from .profiles import Ridge, root_of_drop


def profile_intervals(
    problem: Problem,
    fit: LikelihoodFit,
    which: Index,
    half_width: Matrix | float,
    dof: Matrix | float = math.inf,
) -> Matrix:
    """(len(which), 2) lower and upper ends, in internal units, of parameters `which` (by their index).

    How far each may go while all others do their best to keep the fit (`profiles`).

    The ends are at the distance `half_width` (n,) from the mode, in standard uncertainties of `dof` (n,)
    degrees of freedom: where twice the drop of the log-posterior, all others at their best, is its square
    (1.96 for 95 %), of an estimated noise that of Student's. For a linear fit they are those by the
    curvature. NaN where no end was found. Offsets, tool and noise only: a target's coordinate is no
    coordinate of the fit. Raises ValueError for another.
    """
    parameters = problem.parameters
    if (parameters.group("target") | ~parameters.free)[which].any():
        raise ValueError("profiles are of free offsets, tool and noise parameters")
    column = np.repeat(parameters.among_free[which], 2)
    sign = np.tile([-1.0, 1.0], len(which))
    fixed = np.arange(len(fit.z)) == column[:, None]
    ridge = Ridge(fit, fixed, np.zeros(fixed.shape))
    step = sign * np.sqrt(ridge.covariance[column, column])
    ridge.direction[:] = fixed * step[:, None]
    # How all move with the one, by the curvature.
    along = (ridge.covariance[:, column] / step).T
    half = np.repeat(np.broadcast_to(half_width, which.shape), 2)
    width = root_of_drop(
        half, ridge.curvature(along, np.arange(len(column))), np.repeat(np.broadcast_to(dof, which.shape), 2)
    )
    ends = ridge.mode[column] + step * ridge.farthest(half, along, width)
    prior = np.repeat(which, 2)
    return np.asarray((ends * parameters.prior_std[prior] + parameters.prior_mean[prior]).reshape(-1, 2))


_DIFFERS = 0.1  # of the width of an interval: by so much its ends may differ and still be the same


@dataclass(frozen=True)
class Intervals:
    """The 95 % intervals of one parameter by three methods, where they differ or the parameter is weak.

    `linear` by the curvature at the mode (as `interval95` of the parameter), `profile` by the profile
    likelihood (None where an end was not found), `posterior` between the 2.5 % and 97.5 % quantiles of the
    draws (None without a posterior). `differ` where an end is off by a tenth of the width or more.
    """

    name: str
    unit: str
    status: Status
    linear: tuple[float, float]
    profile: tuple[float, float] | None
    posterior: tuple[float, float] | None
    differ: bool

    def __post_init__(self) -> None:
        require_no_more_than(self.name, self.status, interval95=self.linear)


def intervals(solution: Solution, posterior: PosteriorSummary) -> tuple[Intervals, ...]:
    """Of offsets, tool and noise: where the three methods differ, or the parameter is weak."""
    if not solution.converged:
        return ()
    problem, rows = solution.problem, solution.parameters
    which = np.array([i for i in solution.known if rows[i].group != "target"], dtype=int)
    # With noise factors the fit is at their marginal mode: there is no profile that starts from it.
    ends = np.full((len(which), 2), np.nan)
    if not problem.noise.separate:
        halves, dof = solution.quantiles[which], solution.effective_dof[which]
        ends = profile_intervals(problem, solution.fit, which, halves, dof)
    draws = {row.name: (row.q2_5, row.q97_5) for row in posterior.parameters or ()}
    result = []
    for i, (low, high) in zip(which, ends, strict=True):
        row, item = rows[i], problem.parameters.items[i]
        assert row.interval95 is not None
        profile = (item.shown(low), item.shown(high)) if np.isfinite([low, high]).all() else None
        others = [interval for interval in (profile, draws.get(row.name)) if interval is not None]
        margin = _DIFFERS * (row.interval95[1] - row.interval95[0])
        off = np.abs(np.array(others).reshape(-1, 2) - row.interval95).max(initial=0.0)
        differ = (profile is None and not problem.noise.separate) or bool(off > margin)
        status = solution.identified.status[i]
        wide = status == "assumed" and bool(solution.std[i] > item.tolerance)
        if differ or status == "weak" or wide:
            result.append(
                Intervals(
                    row.name, row.unit, row.status, row.interval95, profile, draws.get(row.name), differ
                )
            )
    return tuple(result)
