"""A run solved, and its model ladder: nominal geometry, link geometry, gravity deflection, first harmonics.

Every rung that the header does not leave out counts with its prior: where the data cannot decide whether an
arm bends, its answer is as uncertain as an arm that may. How much each is worth is said by how targets that
were held out are predicted, and by its evidence: the marginal likelihood by Laplace's formula (MacKay 1992),
the log-posterior at the mode with half the log-determinant of the covariance there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from ..model.files.header import Header
from ..model.likelihood.density import Density
from ..model.likelihood.geometry import BENDING
from ..model.likelihood.problem import Problem
from .estimation.fit import LikelihoodFit, fit_from, fit_likelihood, reweighted
from .estimation.tolerance_factors import Factors, with_factors, with_open_factors
from .observability.geometry_result import Rung, RungName, link_columns
from .recordings.recordings import Effective, effective, placements
from .solution import Solution, judge, too_few_for_noise


def solve_run(
    problem: Problem,
    header: Header,
    *,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Solution:
    """A run solved as its header asks: the model that the ladder keeps, measurements at their effective
    number. `progress` gets the share that is done.

    BadInput where a noise scale is to be estimated and no degree of freedom is left.
    """
    fit, ladder, factors = climb_ladder(problem, header, seed, progress or (lambda share: None))
    number = effective(fit, link_columns(fit.problem, fit.x))
    solution = _weighted(fit, number, ladder, factors)
    if problem.noise.estimated and solution.dof < 1:  # as few as correlated measurements count for
        raise too_few_for_noise(solution.problem)
    return solution


def _weighted(
    fit: LikelihoodFit, number: Effective, ladder: tuple[Rung, ...], factors: Factors | None
) -> Solution:
    """The fit judged with its measurements at their effective number, as neighbouring ones that are
    correlated ask; the uncertainty of estimated `factors` of the tolerances stays in.

    Not where nominal geometry does not describe the measurements, or nothing would be left to judge a misfit
    by: the errors of the model are then what is correlated, and no number is validated.
    """
    judged, problem = partial(judge, effective=number, ladder=ladder, factors=factors), fit.problem
    if number.divisor == 1:
        return judged(fit)
    weighted = problem.weighted(np.full(problem.shots, 1 / number.divisor))
    if not problem.geometry or weighted.data_size <= int(problem.parameters.free.sum()):
        unweighted = judged(fit)
        if unweighted.misfit is not None:
            return unweighted
    again = replace(fit_from(weighted, fit.x), others=fit.others)
    return judged(again if factors is None else with_open_factors(again, factors))


def climb_ladder(
    problem: Problem, header: Header, seed: int, progress: Callable[[float], None]
) -> tuple[LikelihoodFit, tuple[Rung, ...], Factors | None]:
    """The fit of the highest rung, all rungs below it, and by what the data multiply the tolerances (None
    where they are known). An exact arm has no ladder, nor has a run where a rung has no mode to compare.
    `progress` gets the share that is done."""
    declared, whole = header.arm, problem.geometry
    if declared is None:
        return fit_likelihood(problem, seed=seed), (), None
    nominal = fit_likelihood(_up_to(problem, "offsets"), starts=0, seed=seed)
    fit = fit_likelihood(_up_to(problem, "geometry"), seed=seed)
    rungs = [_rung("offsets", nominal, kept=False), _rung("geometry", fit, kept=True)]
    more: list[RungName] = ["gravity"] if whole.gravity is not None else []
    more += ["harmonics"] if whole.harmonics else []
    for k, name in enumerate(more):
        progress((k + 1) / (len(more) + 1))
        fit = fit_from(_up_to(problem, name), fit.x)
        rungs.append(_rung(name, fit, kept=True))
    factors = None
    if declared.scale == "estimated" and fit.converged:
        fit, factors = with_factors(fit)
    comparable = all(np.isfinite(rung.log_evidence) for rung in rungs)
    return fit, tuple(rungs) if comparable else (), factors


def _up_to(problem: Problem, rung: RungName) -> Problem:
    """The problem with what the rungs above add held at 0: all share the functions of the whole geometry."""
    gravity, harmonics = BENDING["gravity"], BENDING["harmonics"]
    above = {"geometry": gravity | harmonics, "gravity": harmonics, "harmonics": frozenset[str]()}
    places = problem.parameters.group("geometry")
    if rung != "offsets":
        places &= np.array([item.axis in above[rung] for item in problem.parameters.items])
    return replace(problem, parameters=problem.parameters.holding(places)) if places.any() else problem


def _rung(name: RungName, fit: LikelihoodFit, *, kept: bool) -> Rung:
    free = int(fit.problem.parameters.free.sum())
    return Rung(name, free, held_out_rms(fit), log_evidence(fit), kept)


def log_evidence(fit: LikelihoodFit) -> float:
    """Log marginal likelihood by Laplace's formula, up to what all models of the same data share; nan where
    there is no covariance."""
    if not np.isfinite(fit.covariance).all():
        return float("nan")
    density, x = Density(fit.problem), fit.x[None]
    # The curvature at the mode itself, where the scale of the noise is that of the mode.
    ratio = density.noise_weight(x) / fit.weight
    log_det = float(np.linalg.slogdet(reweighted(density, x, fit.covariance[None], ratio))[1][0])
    return fit.log_posterior + log_det / 2


def held_out_rms(fit: LikelihoodFit) -> float | None:
    """Root mean square, mm, of the residuals at each placement, were it not among the data but for its own
    targets; None with a single placement.

    All but the targets comes from the other placements by one Gauss-Newton step from the mode: what one of
    many placements changes there is small.
    """
    problem = fit.problem
    groups = placements(problem)
    if len(groups) < 2 or not fit.converged:
        return None
    parameters, d = problem.parameters, problem.tool.residual_size
    free = parameters.free & ~parameters.group("noise")
    whitened = fit.whitened
    jacobian, residual = whitened.jacobian[:, free], whitened.residual.copy()
    jacobian[: problem.shots * d] *= np.sqrt(fit.weight)
    residual[: problem.shots * d] *= np.sqrt(fit.weight)
    prior = (fit.x - parameters.prior_mean)[free] / parameters.prior_std[free]
    total, missing = jacobian.T @ jacobian + np.eye(jacobian.shape[1]), jacobian.T @ residual + prior
    squares = 0.0
    for group in groups:
        rows = (group.rows[:, None] * d + np.arange(d)).ravel()
        its_targets = parameters.targets(set(group.targets))[free]
        theirs, left = jacobian[rows], residual[rows]
        # The targets of this placement have nothing but their own measurements: they are left as they are.
        rest = ~its_targets
        information = (total - theirs.T @ theirs)[np.ix_(rest, rest)]
        step = -np.linalg.solve(information, (missing - theirs.T @ left)[rest])
        left = left + theirs[:, rest] @ step
        columns = theirs[:, its_targets]
        left = left - columns @ np.linalg.lstsq(columns, left, rcond=None)[0]
        residual_mm = whitened.factor[group.rows] @ left.reshape(-1, d, 1) / np.sqrt(fit.weight)
        squares += float(problem.select(group.rows).length_squares(residual_mm[:, :, 0] ** 2).sum())
    return float(np.sqrt(squares / problem.shots))
