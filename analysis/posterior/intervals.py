"""The 95 % interval of a parameter by three methods: curvature, profile likelihood, posterior."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...model.arrays import NORMAL_95, Index, Matrix
from ...model.likelihood.density import Density
from ...model.likelihood.problem import Problem
from ..estimation.climb import Climb
from ..estimation.coordinates import FlangeCoordinates
from ..estimation.fit import LikelihoodFit
from ..solution import Solution
from ..status import Status, require_no_more_than
from .posterior import PosteriorSummary

_ROUNDS = 25
_REACHED = 1e-3  # stds: the root of the drop is as wanted
_LONGEST = 3.0  # how many times a step may lengthen the way


def profile_intervals(problem: Problem, fit: LikelihoodFit, which: Index, half_width: float) -> Matrix:
    """(len(which), 2) lower and upper ends, in internal units, of parameters `which` (by their index).

    How far each may go while all others do their best to keep the fit: this follows the ridge (Venzon &
    Moolgavkar 1988), where the residuals are far from linear and the curvature at the mode is not to be
    trusted. The priors of all parameters take part, as in the other intervals.

    The ends are where twice the drop of the log-posterior, all others at their best, is `half_width`
    squared (1.96 for 95 %). NaN where no end was found. Offsets, tool and noise only: a target's
    coordinate is no coordinate of the fit. Raises ValueError for another.
    """
    parameters = problem.parameters
    if (parameters.group("target") | ~parameters.free)[which].any():
        raise ValueError("profiles are of free offsets, tool and noise parameters")
    density = Density(problem)
    coordinates = FlangeCoordinates(density)
    column = np.repeat(parameters.among_free[which], 2)
    sign = np.tile([-1.0, 1.0], len(which))
    mode = coordinates.from_parameters(fit.x[None])[0]
    covariance = coordinates.covariance(fit.x[None], fit.covariance[None])[0]
    along = (
        covariance[:, column] / covariance[column, column]
    ).T  # how all move with the one, by the curvature
    std = np.sqrt(covariance[column, column])

    way = half_width * std  # from the mode to where it is fixed, by rows
    near = mode + (sign * way)[:, None] * along
    shorter, longer = np.zeros_like(way), np.full_like(way, np.inf)
    active, ends = np.arange(len(column)), np.full(len(column), np.nan)
    for _ in range(_ROUNDS):
        near[active, column[active]] = mode[column[active]] + sign[active] * way[active]
        held = np.arange(len(mode)) == column[active, None]
        minima = Climb(density, np.zeros(len(active), dtype=int), len(active), held).up(near[active])
        near[active] = minima.x
        root = np.sqrt(np.maximum(2 * (fit.log_posterior + minima.cost), 0.0))
        reached = (np.abs(root - half_width) < _REACHED * half_width) & minima.converged
        ends[active[reached]] = way[active[reached]]
        below = root < half_width
        shorter[active[below]] = way[active[below]]
        longer[active[~below]] = way[active[~below]]
        # The root of the drop is nearly linear in the way; where that leads outside the bracket, halve.
        step = np.clip(half_width / np.maximum(root, 1e-12), 1 / _LONGEST, _LONGEST)
        proposed = way[active] * step
        outside = (proposed <= shorter[active]) | (proposed >= longer[active])
        middle = np.where(
            np.isfinite(longer[active]), (shorter[active] + longer[active]) / 2, _LONGEST * way[active]
        )
        way[active] = np.where(outside, middle, proposed)
        active = active[~reached]
        if len(active) == 0:
            break
    ends = (mode[column] + sign * ends) * parameters.prior_std[np.repeat(which, 2)]
    return np.asarray((ends + parameters.prior_mean[np.repeat(which, 2)]).reshape(-1, 2))


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
        ends = profile_intervals(problem, solution.fit, which, _profile_width(solution))
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
        if differ or solution.identified.status[i] == "weak":
            result.append(
                Intervals(
                    row.name, row.unit, row.status, row.interval95, profile, draws.get(row.name), differ
                )
            )
    return tuple(result)


def _profile_width(solution: Solution) -> float:
    """The root of twice the drop at the ends of a 95 % profile interval: with an estimated scale the one that
    gives Student's interval for a linear fit, whose log-density is -M log(1 + t^2 / dof) / 2."""
    problem, dof = solution.problem, solution.dof
    if problem.noise.estimated and dof:
        numbers = float(problem.weights @ problem.sizes)
        return float(np.sqrt(numbers * np.log1p(solution.quantile**2 / dof)))
    return NORMAL_95
