"""Profile likelihood: how far a parameter may go while all others do their best to keep the fit.

Where the residuals are far from linear (weak directions) the interval from the curvature at the mode is not
to be trusted; this one follows the ridge (Venzon & Moolgavkar 1988). It is the profile of the posterior: the
priors of all parameters take part, as in the other intervals.
"""

from __future__ import annotations

import numpy as np

from ...model.arrays import Index, Matrix
from ...model.likelihood.density import Density
from ...model.likelihood.problem import Problem
from .climb import Climb
from .coordinates import SeenCoordinates
from .fit import LikelihoodFit

_ROUNDS = 25
_REACHED = 1e-3  # stds: the root of the drop is as wanted
_LONGEST = 3.0  # how many times a step may lengthen the way


def profile_intervals(problem: Problem, fit: LikelihoodFit, which: Index, half_width: float) -> Matrix:
    """(len(which), 2) lower and upper ends, in internal units, of parameters `which` (by their index).

    The ends are where twice the drop of the log-posterior, all others at their best, is `half_width`
    squared (1.96 for 95 %). NaN where no end was found. Offsets, tool and noise only: a target's
    coordinate is no coordinate of the fit. Raises ValueError for another.
    """
    parameters = problem.parameters
    if (parameters.group("target") | ~parameters.free)[which].any():
        raise ValueError("profiles are of free offsets, tool and noise parameters")
    density = Density(problem)
    coordinates = SeenCoordinates(density)
    place = np.repeat(parameters.among_free[which], 2)
    sign = np.tile([-1.0, 1.0], len(which))
    mode = coordinates.from_parameters(fit.x[None])[0]
    covariance = coordinates.covariance(fit.x[None], fit.covariance[None])[0]
    along = (covariance[:, place] / covariance[place, place]).T  # how all move with the one, by the curvature
    std = np.sqrt(covariance[place, place])

    way = half_width * std  # from the mode to where it is fixed, by rows
    near = mode + (sign * way)[:, None] * along
    shorter, longer = np.zeros_like(way), np.full_like(way, np.inf)
    active, ends = np.arange(len(place)), np.full(len(place), np.nan)
    for _ in range(_ROUNDS):
        near[active, place[active]] = mode[place[active]] + sign[active] * way[active]
        held = np.arange(len(mode)) == place[active, None]
        found = Climb(density, np.zeros(len(active), dtype=int), len(active), held).up(near[active])
        near[active] = found.x
        root = np.sqrt(np.maximum(2 * (fit.log_posterior + found.cost), 0.0))
        reached = (np.abs(root - half_width) < _REACHED * half_width) & found.converged
        ends[active[reached]] = way[active[reached]]
        below = root < half_width
        shorter[active[below]] = way[active[below]]
        longer[active[~below]] = way[active[~below]]
        # The root of the drop is nearly linear in the way; where that leads outside the bracket, halve.
        step = np.clip(half_width / np.maximum(root, 1e-12), 1 / _LONGEST, _LONGEST)
        wanted = way[active] * step
        outside = (wanted <= shorter[active]) | (wanted >= longer[active])
        middle = np.where(
            np.isfinite(longer[active]), (shorter[active] + longer[active]) / 2, _LONGEST * way[active]
        )
        way[active] = np.where(outside, middle, wanted)
        active = active[~reached]
        if len(active) == 0:
            break
    ends = (mode[place] + sign * ends) * parameters.prior_std[np.repeat(which, 2)]
    return np.asarray((ends + parameters.prior_mean[np.repeat(which, 2)]).reshape(-1, 2))
