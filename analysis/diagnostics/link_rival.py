"""Link geometry as an explanation of a misfit: typical tolerances freed in the fit, and what that leaves.

The tolerances are priors, so that not each of the parameters counts as one that was chosen to suit the data:
the effective number is the trace of the reduction, the sum of l / (1 + l) over the eigenvalues l of the
information that the measurements have on the links, in units of their tolerances, when all else is estimated.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...model.arrays import Matrix
from ...model.likelihood.density import Density
from ...model.likelihood.problem import Problem
from ..observability.consider import with_links
from .trials import Left, lefts

_FEW_STEPS = 60


def with_links_freed(problem: Problem, x: Matrix) -> Left | None:
    """What is left with the links free within typical tolerances; the fit with nominal geometry ended at
    x (p,), at known noise. None where the problem has geometry parameters already.

    The deviations of the links count as residuals, by their tolerances: with geometry marginalised both
    together have the degrees of freedom that the residuals have with nominal geometry.
    """
    if len(problem.tolerated):
        return None
    whole, start = with_links(problem, x)
    density = Density(whole)
    ended, (left,) = lefts(density, start[None], most_steps=_FEW_STEPS)
    links = whole.parameters.among_free[whole.tolerated]
    squares = float((density.scaled(ended)[0, links] ** 2).sum())
    information = density.slopes(ended).information[0]
    if not np.isfinite(information).all():
        return None
    # Of the links, with all else estimated: the inverse of their block of the covariance.
    marginal = np.linalg.inv(np.linalg.inv(information)[np.ix_(links, links)])
    freed = float(len(links) - np.trace(np.linalg.inv(marginal)))
    # Directions of the links that the measurements determine better than the tolerances do.
    own_rank = int((np.linalg.eigvalsh(marginal - np.eye(len(links))) >= 1.0).sum())
    rank = left.numbers - left.dof - own_rank
    return replace(
        left,
        cause="geometry",
        chi2=left.chi2 + squares,
        dof=max(left.numbers - max(rank, 0), 0),
        freed=max(freed, 1e-3),
    )
