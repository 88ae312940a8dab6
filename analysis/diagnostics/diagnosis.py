"""For a misfit: what it could be, and what explains it.

Each hypothesis is fitted with all else as it is, at the stated noise, and judged by what it leaves: it must
agree with the noise, or at least halve the residuals, and its gain must be beyond chance after counting all
that was tried (docs/mathematics.md). Nothing is applied.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from ...model.arrays import Matrix
from ...model.likelihood.constraint import shot_functions
from ...model.likelihood.density import Density
from ...model.likelihood.problem import Problem
from ..solution import Solution
from .hypotheses import (
    SIGNIFICANCE,
    Cause,
    HypothesisFit,
    fits_at,
    fits_from,
    hypothesis_fits,
    with_links_freed,
)

_SLACK = 3.0  # an estimated noise may be so many times the stated
_MOST = 5  # explanations
_BLAMES_THE_DATA: frozenset[Cause] = frozenset({"placement", "measurements", "moved_target"})


@dataclass(frozen=True)
class Explanation:
    """What explains a misfit. `joints` (numbered from 1), `targets` and `measurements` are those concerned
    (of a moved target the last before and the first after); `amount` is what is added to a zero (deg), the
    factor of units, or how many times joint 2 is added to joint 3.

    `factor` is the residual over the noise that it leaves, `before` the same as recorded; `farthest` and
    `farthest_before` the largest distance of an estimate from its prior mean, in prior stds. `freed` counts
    the parameters that it frees (of links within tolerances their effective number), `p_value` is that
    of such a gain after all that was tried, and `agrees` says that what it leaves agrees with the noise.
    """

    cause: Cause
    joints: tuple[int, ...]
    targets: tuple[str, ...]
    measurements: tuple[int, ...]
    amount: float
    factor: float
    before: float
    farthest: float
    farthest_before: float
    freed: float
    p_value: float
    agrees: bool


# One more hypothesis, such as link geometry as an uncertain parameter: what it leaves, None where it does not
# apply. It gets the problem at the stated noise and where the fit as recorded ended there.
Rival = Callable[[Problem, Matrix], HypothesisFit | None]


def diagnose(solution: Solution, *, rivals: Sequence[Rival] = (with_links_freed,)) -> tuple[Explanation, ...]:
    """What explains that a solution contradicts its noise or priors, the best explanation first.

    Empty where nothing does, or where there is nothing to explain. `rivals` are further hypotheses.
    """
    problem, x = _at_stated_noise(solution)
    slack = 1.0 if solution.problem.noise.known else _SLACK
    density = Density(problem)
    (answer,) = fits_at(density, x[None])
    if answer.agrees(slack):  # and so does the best fit at the stated noise
        return ()
    ended, (base,) = fits_from(density, x[None])
    if base.agrees(slack):
        return ()
    fits = [
        *hypothesis_fits(problem, ended[0], base, solution.fit, slack),
        *(left for rival in rivals if (left := rival(problem, ended[0])) is not None),
    ]
    explained = _explanations(base, fits, slack)
    weighted = bool((solution.problem.weights != 1).any())
    if not solution.problem.noise.known or weighted or solution.dof == 0:
        return explained
    # As the answer itself has it: it judges what is determined at measurements that hit.
    before = float(np.sqrt(solution.against_noise.chi2 / solution.dof))
    return tuple(replace(explanation, before=before) for explanation in explained)


def _at_stated_noise(solution: Solution) -> tuple[Problem, Matrix]:
    """The problem with the noise as stated and known, and the fit's x (p,) without noise factors."""
    problem, x = solution.problem, solution.fit.x
    # Each measurement counts once: it is the misfit's own errors that are correlated.
    problem = replace(problem, weights=np.ones(problem.shots))
    noise = replace(problem.noise, estimated=False, separate=False)
    if not problem.noise.separate:
        return replace(problem, noise=noise), x
    functions = shot_functions(problem.robot, problem.tool, geometry=problem.geometry)
    parameters = problem.parameters
    known = replace(problem, noise=noise, parameters=parameters.without("noise"), functions=functions)
    return known, x[~parameters.group("noise")]


# Judgement


def _explanations(
    base: HypothesisFit, fits: Sequence[HypothesisFit], slack: float
) -> tuple[Explanation, ...]:
    """The hypotheses that explain, by the criterion: the residuals, with a price for estimated parameters and
    for the choice among hypotheses."""
    choices = Counter(left.cause for left in fits)
    log_tried = float(np.logaddexp.reduce([0.0, *(left.log_choices for left in fits)]))
    agreeing = {i for i, left in enumerate(fits) if left.agrees(slack)}
    explaining = agreeing or {i for i, left in enumerate(fits) if left.explains(base, slack)}
    # What is left gives the noise its scale where it is more than the stated, or that is not certain.
    free_scale = not agreeing or slack > 1

    def criterion(left: HypothesisFit) -> float:
        # What was chosen to suit the data was chosen among others of its kind.
        count = float(np.log(choices[left.cause])) + left.log_choices if left.freed else 0.0
        price = left.freed * float(np.log(base.numbers)) + 2 * count
        return price - 2 * _log_ratio(base, left, free_scale)

    # Links within tolerances are no fault of the data: whatever blames the data has to be clearly likelier.
    links = min((criterion(fits[i]) for i in explaining if fits[i].cause == "geometry"), default=np.inf)
    claimed = {
        i
        for i in explaining
        if fits[i].cause not in _BLAMES_THE_DATA or criterion(fits[i]) < links + 2 * np.log(SIGNIFICANCE)
    }
    p_values = {i: _p_value(base, fits[i], log_tried, free_scale) for i in claimed}
    rows = sorted((criterion(fits[i]), i) for i in claimed if p_values[i] < SIGNIFICANCE)
    explained = [(fits[i], i) for value, i in rows if value <= rows[0][0] - 2 * np.log(SIGNIFICANCE)]
    return tuple(
        Explanation(
            cause=left.cause,
            joints=left.joints,
            targets=left.targets,
            measurements=left.measurements,
            amount=left.amount,
            factor=left.factor,
            before=base.factor,
            farthest=left.farthest,
            farthest_before=base.farthest,
            freed=left.freed,
            p_value=p_values[i],
            agrees=i in agreeing,
        )
        for left, i in explained[:_MOST]
        if left.cause is not None
    )


def _log_ratio(base: HypothesisFit, left: HypothesisFit, free_scale: bool) -> float:
    """Logarithm of the ratio of the likelihoods, of a hypothesis to the data as recorded."""
    drop = base.cost - left.cost
    if free_scale:
        drop = base.numbers * float(np.log(max(base.cost, 1.0) / max(left.cost, 1.0)))
    return drop / 2 - base.numbers * left.volume


def _p_value(base: HypothesisFit, left: HypothesisFit, log_tried: float, free_scale: bool) -> float:
    """Of the gain of a hypothesis, by Bonferroni's bound over all that was tried.

    Without a freed parameter by the likelihood ratio (Markov's inequality), with some by the drop's
    chi-squared, or its F where the noise has a free scale.
    """
    drop = base.cost - left.cost
    if left.freed == 0:
        log_p = -_log_ratio(base, left, free_scale)
    elif drop <= 0:
        return 1.0
    elif free_scale:
        dof = max(left.dof, 1)
        log_p = _log(
            float(scipy.special.fdtrc(left.freed, dof, drop / left.freed * dof / max(left.cost, 1.0)))
        )
    else:
        log_p = _log(float(scipy.special.chdtrc(left.freed, drop)))
    return float(np.exp(min(log_p + log_tried, 0.0)))


def _log(probability: float) -> float:
    return float(np.log(max(probability, 1e-300)))
