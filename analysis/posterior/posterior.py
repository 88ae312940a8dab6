"""The posterior around a fit: sampled by `sampler`, told in the units that people read.

The walkers live in the coordinates of `coordinates`, whitened by the fit: near it a unit normal.
"""

from __future__ import annotations

import os
import time
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from ...model.density import Density
from ...model.parameters import Parameter
from ...model.problem import Problem
from ...model.robot import Matrix
from ..estimation.coordinates import SeenCoordinates
from ..estimation.fit import LikelihoodFit
from ..result import Draws, PosteriorParameter, PosteriorSummary, Status
from .moves import IndependenceProposal, degrees_of_freedom
from .sampler import RHAT_GATE, Progress, Sampled, diagnostics, sample_density

_THREADS_FROM = 50  # shots
_KEPT_PER_WALKER = 400


class Whitening:
    """w = L^-1 (v - centre): near the fit a unit normal, where the walkers live."""

    def __init__(self, centre: Matrix, factor: Matrix) -> None:
        self.centre, self.factor = centre, factor

    @classmethod
    def around(cls, fit: LikelihoodFit, coordinates: SeenCoordinates) -> Whitening:
        """By the covariance of a fit."""
        covariance = coordinates.covariance(fit.x[None], fit.covariance[None])[0]
        factor = np.asarray(np.linalg.cholesky(covariance), dtype=float)
        return cls(coordinates.from_parameters(fit.x[None])[0], factor)

    def undo(self, w: Matrix) -> Matrix:
        return self.centre + w @ self.factor.T


def sample_posterior(
    problem: Problem,
    fit: LikelihoodFit,
    status: tuple[Status, ...],
    *,
    seed: int,
    ess: float = 1000.0,
    progress: Progress | None = None,
) -> tuple[PosteriorSummary, Draws]:
    """The posterior around a fit: its summary, gated by R-hat and ESS, and the draws in display units."""
    began = time.perf_counter()
    density = Density(problem)
    coordinates = SeenCoordinates(density)
    whitening = Whitening.around(fit, coordinates)

    def log_density(w: Matrix) -> Matrix:
        return density.log_posterior(coordinates.to_parameters(whitening.undo(w)))

    def shown(values: Matrix) -> Matrix:
        """Draws (…, f) of the sampler in the units that people read."""
        x = coordinates.to_parameters(whitening.undo(values.reshape(-1, len(fit.z))))
        return np.asarray(problem.parameters.shown(x)[:, problem.parameters.free].reshape(values.shape))

    size = len(fit.z)
    proposal = IndependenceProposal(np.zeros(size), np.eye(size), degrees_of_freedom(size))
    # The kernel lets go of Python's lock: with many shots the ensembles use the cores that are there. With
    # few shots the lock is what they would wait for.
    threads = os.cpu_count() or 1 if problem.shots > _THREADS_FROM else 1
    sampled = sample_density(
        log_density, proposal, seed=seed, ess=ess, threads=threads, judged=shown, progress=progress
    )
    return _told(problem, shown(sampled.values), sampled, status, ess, time.perf_counter() - began)


def _told(
    problem: Problem,
    shown: Matrix,
    sampled: Sampled,
    status: tuple[Status, ...],
    ess: float,
    seconds: float,
) -> tuple[PosteriorSummary, Draws]:
    """Draws and summary in the units that people read."""
    parameters = problem.parameters
    ensembles, walkers, steps, _ = shown.shape
    rhat, bulk = diagnostics(shown)
    free = [(item, state) for item, state in zip(parameters.items, status, strict=True) if not item.held]
    converged = bool(sampled.settled and rhat.max() <= RHAT_GATE and bulk.min() >= min(ess, 400.0))
    if converged:
        message = (
            f"{ensembles} independent ensembles agree: R-hat {rhat.max():.3f},"
            f" at least {bulk.min():.0f} effective draws"
        )
    else:
        drifts = "" if sampled.settled or rhat.max() > RHAT_GATE else ", and its draws still drift"
        message = (
            f"the posterior has not converged (R-hat {rhat.max():.3f}, smallest effective sample size"
            f" {bulk.min():.0f}{drifts}): its draws are not shown. Record more varied shots, or hold what the"
            " data cannot tell"
        )
    names = tuple(item.name for item, _ in free)
    units = tuple(item.unit for item, _ in free)
    from_prior = tuple(state == "unidentifiable" for _, state in free)
    rows = tuple(
        _row(item, state == "unidentifiable", shown[..., j], float(rhat[j]), float(bulk[j]))
        for j, (item, state) in enumerate(free)
    )
    summary = PosteriorSummary(
        converged=converged,
        message=message,
        draws=ensembles * walkers * steps,
        ensembles=ensembles,
        walkers=walkers,
        ess_min=float(bulk.min()),
        rhat_max=float(rhat.max()) if np.isfinite(rhat.max()) else None,
        acceptance=sampled.acceptance,
        seconds=seconds,
        parameters=rows if converged else None,
    )
    thin = max(1, steps // _KEPT_PER_WALKER)
    return summary, Draws(names, units, from_prior, shown[:, :, ::thin], converged)


def _row(
    item: Parameter, unidentifiable: bool, draws: NDArray[np.float64], rhat: float, bulk: float
) -> PosteriorParameter:
    from arviz_stats.base import array_stats

    chains = draws.reshape(-1, draws.shape[2])
    tail = float(array_stats.ess(chains, method="tail", prob=(0.05, 0.95)))
    if unidentifiable:
        # The draws may be narrow for all that: what the priors of other parameters make of this one. Only
        # its own prior is told, and exactly, so that no spread can be taken for knowledge from the data.
        prior = NormalDist(item.prior_mean, item.prior_std)
        low, middle, high = (item.shown(prior.inv_cdf(q)) for q in (0.025, 0.5, 0.975))
        mean, std = item.shown_prior
        mcse = 0.0
    else:
        mean, std = float(chains.mean()), float(chains.std(ddof=1))
        low, middle, high = (float(q) for q in np.quantile(chains, [0.025, 0.5, 0.975]))
        mcse = float(array_stats.mcse(chains, method="mean"))
    return PosteriorParameter(
        name=item.name,
        unit=item.unit,
        source="prior" if unidentifiable else "data",
        mean=mean,
        std=std,
        q2_5=low,
        q50=middle,
        q97_5=high,
        ess_bulk=bulk,
        ess_tail=tail,
        rhat=rhat,
        mcse_mean=mcse,
    )
