"""A run solved as its header asks: the model that the ladder keeps, measurements at their effective number.

`analyse`, the exporters and `compare` begin here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..model.files.header import Header
from ..model.likelihood.problem import Problem
from .estimation.fit import LikelihoodFit, fit_from
from .estimation.tolerance_factors import Factors, with_open_factors
from .ladder import climb_ladder
from .observability.geometry import Rung, link_columns
from .recordings.recordings import Effective, effective
from .solution import Solution, judge, too_few_for_noise


@dataclass(frozen=True, eq=False)
class Solved:
    """The `solution`; the `effective` number of measurements by which it weighs them; the models that were
    tried (none for nominal geometry), and by what the data multiply the tolerances (None where they are
    known)."""

    solution: Solution
    effective: Effective
    ladder: tuple[Rung, ...]
    factors: Factors | None


def solved(
    problem: Problem,
    header: Header,
    *,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    fit: LikelihoodFit | None = None,
) -> Solved:
    """Fit and judge; `progress` gets the share that is done, `fit` is that of `problem` if there is one.

    BadInput where a noise scale is to be estimated and no degree of freedom is left.
    """
    climbed = climb_ladder(problem, header, seed, progress or (lambda share: None), fit)
    fit, factors = climbed.fit, climbed.factors
    number = effective(fit, link_columns(fit.problem, fit.x))
    solution = _weighted(fit, number.divisor, factors)
    if problem.noise.estimated and solution.dof < 1:  # as few as correlated measurements count for
        raise too_few_for_noise(solution.problem)
    return Solved(solution, number, climbed.ladder, factors)


def _weighted(fit: LikelihoodFit, divisor: float, factors: Factors | None) -> Solution:
    """The fit judged with its measurements' information divided by `divisor`, as neighbouring ones that are
    correlated ask; the uncertainty of estimated `factors` of the tolerances stays in.

    Not where nominal geometry does not describe the measurements, or nothing would be left to judge a misfit
    by: the errors of the model are then what is correlated, and no number is validated.
    """
    problem = fit.problem
    if divisor == 1:
        return judge(fit)
    weighted = problem.weighted(np.full(problem.shots, 1 / divisor))
    if len(problem.tolerated) == 0 or weighted.data_size <= int(problem.parameters.free.sum()):
        as_it_is = judge(fit)
        if as_it_is.misfit is not None:
            return as_it_is
    again = replace(fit_from(weighted, fit.x), others=fit.others)
    return judge(again if factors is None else with_open_factors(again, factors))
