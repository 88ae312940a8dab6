"""The model ladder: nominal geometry, link geometry, gravity deflection, first harmonics; which rungs hold.

A rung of which the header leaves the choice open (`auto`) is kept only if targets that were held out are
predicted better, and the evidence rises. The evidence of a model is its marginal likelihood by Laplace's
formula (MacKay 1992): the log-posterior at the mode with half the log-determinant of the covariance there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..model.files.header import Header
from ..model.likelihood.density import Density
from ..model.likelihood.geometry import NOMINAL, Geometry
from ..model.likelihood.problem import Problem
from .estimation.fit import LikelihoodFit, fit_from, fit_likelihood, reweighted
from .estimation.tolerance_factors import Factors, with_factors
from .observability.geometry import Rung, RungName
from .placements import placements


@dataclass(frozen=True, eq=False)
class Climbed:
    """The fit of the highest rung that holds; `ladder` has all that were tried."""

    fit: LikelihoodFit
    ladder: tuple[Rung, ...]
    factors: Factors | None


def climb_ladder(
    problem: Problem,
    header: Header,
    seed: int,
    progress: Callable[[float], None],
    fit: LikelihoodFit | None = None,
) -> Climbed:
    """Fit what the header states of the geometry; without that key nominal geometry, without a ladder.
    `progress` gets the share that is done; `fit` is that of `problem` if it is there already."""
    stated, whole = header.geometry, problem.geometry
    if stated is None:
        return Climbed(fit_likelihood(problem, seed=seed) if fit is None else fit, (), None)
    links = whole.without("gravity").without("harmonics")
    nominal = fit_likelihood(problem.with_geometry(NOMINAL), starts=0, seed=seed)
    fit = fit_likelihood(problem.with_geometry(links), seed=seed)
    rungs = [_rung("offsets", nominal, kept=False), _rung("geometry", fit, kept=True)]
    kept, best = links, rungs[-1]
    tries: list[tuple[RungName, bool, Geometry]] = []
    if whole.gravity is not None:
        tries.append(("gravity", stated.gravity is True, Geometry(gravity=whole.gravity)))
    if whole.harmonics:
        tries.append(("harmonics", stated.harmonics is True, Geometry(harmonics=whole.harmonics)))
    for k, (name, asked, more) in enumerate(tries):
        progress((k + 1) / (len(tries) + 1))
        tried = from_near(problem.with_geometry(kept.joined(more)), fit)
        own = _rung(name, tried, kept=False)
        own = replace(own, kept=asked or _better(own, best))
        rungs.append(own)
        if own.kept:
            kept, best, fit = tried.problem.geometry, own, tried
    factors = None
    if stated.scale == "estimated" and fit.converged:
        fit, factors = with_factors(fit)
    return Climbed(fit, tuple(rungs), factors)


def _better(own: Rung, best: Rung) -> bool:
    predicted = (own.held_out_rms_mm, best.held_out_rms_mm)
    if predicted[0] is None or predicted[1] is None:
        return False
    return predicted[0] < predicted[1] and own.log_evidence > best.log_evidence


def _rung(name: RungName, fit: LikelihoodFit, *, kept: bool) -> Rung:
    free = int(fit.problem.parameters.free.sum())
    return Rung(name, free, held_out_rms(fit), log_evidence(fit), kept)


def from_near(problem: Problem, near: LikelihoodFit) -> LikelihoodFit:
    """The fit of `problem`, begun at the mode of one that has some of its parameters."""
    known = near.problem.parameters
    x = problem.parameters.prior_mean.copy()
    for name, value in zip(known.names, near.x, strict=True):
        if name in problem.parameters.names:
            x[problem.parameters.index(name)] = value
    return fit_from(problem, x)


def log_evidence(fit: LikelihoodFit) -> float:
    """Log marginal likelihood by Laplace's formula, up to what all models of the same data share."""
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
        own = parameters.targets(set(group.targets))[free]
        theirs, left = jacobian[rows], residual[rows]
        # The targets of this placement have nothing but their own measurements: they are left as they are.
        rest = ~own
        information = (total - theirs.T @ theirs)[np.ix_(rest, rest)]
        step = -np.linalg.solve(information, (missing - theirs.T @ left)[rest])
        left = left + theirs[:, rest] @ step
        columns = theirs[:, own]
        left = left - columns @ np.linalg.lstsq(columns, left, rcond=None)[0]
        miss = whitened.factor[group.rows] @ left.reshape(-1, d, 1) / np.sqrt(fit.weight)
        squares += float((miss**2).sum())
    return float(np.sqrt(squares / problem.shots))
