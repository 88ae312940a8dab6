"""The posterior by emcee: an independence move from a multivariate t at the fit, and differential evolution.

The walkers live in the coordinates of `coordinates`, whitened by the fit: near it a unit normal.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..model.parameters import Parameter
from ..model.problem import Problem
from ..model.robot import Matrix
from .coordinates import SeenCoordinates
from .fit import LikelihoodFit
from .result import Draws, PosteriorParameter, PosteriorSummary, Status

ENSEMBLES = 4
RHAT_GATE = 1.01
_BURN_IN = 40
_BLOCKS = (25, 25, 50, 100, 200, 400)  # steps between looks at the diagnostics
_THREADS_FROM = 50  # shots
_KEPT_PER_WALKER = 400

Progress = Callable[[float], None]
LogDensity = Callable[[Matrix], Matrix]


class Whitening:
    """w = L^-1 (v - centre): near the fit a unit normal, where the walkers live."""

    def __init__(self, centre: Matrix, factor: Matrix) -> None:
        self.centre, self.factor = centre, factor

    def undo(self, w: Matrix) -> Matrix:
        return self.centre + w @ self.factor.T


class IndependenceProposal:
    """Independence proposal from a multivariate t: location (f,), lower Cholesky factor (f, f), nu.

    emcee's MHMove wants (q, factors) with factors = ln g(x) - ln g(q).
    """

    def __init__(self, location: Matrix, factor: Matrix, nu: float) -> None:
        self.location, self.factor, self.nu = location, factor, nu
        self._inverse = np.linalg.inv(factor)

    def log_density(self, points: Matrix) -> Matrix:
        """(W,) up to a constant."""
        inner = (points - self.location) @ self._inverse.T
        size = len(self.location)
        result: Matrix = -(self.nu + size) / 2 * np.log1p((inner**2).sum(axis=1) / self.nu)
        return result

    def draw(self, count: int, random: Any) -> Matrix:
        normal = random.randn(count, len(self.location))
        chi2 = random.chisquare(self.nu, size=count)
        result: Matrix = self.location + (normal * np.sqrt(self.nu / chi2)[:, None]) @ self.factor.T
        return result

    def __call__(self, coords: Matrix, random: Any) -> tuple[Matrix, Matrix]:
        proposed = self.draw(len(coords), random)
        return proposed, self.log_density(coords) - self.log_density(proposed)


def degrees_of_freedom(size: int) -> float:
    """nu of the proposal: heavy tails (6) in few dimensions, lighter in many, where the radius of a t
    with few degrees of freedom would scatter far more than the posterior's."""
    return max(6.0, float(size))


@dataclass(frozen=True, eq=False)
class Sampled:
    """What the ensembles left: `values` (ensembles, walkers, steps, f) in the sampler's coordinates."""

    values: Matrix
    acceptance: float
    rhat: Matrix
    ess_bulk: Matrix
    seconds: float


def sample_density(
    log_density: LogDensity,
    proposal: IndependenceProposal,
    *,
    seed: int,
    ess: float,
    threads: int = 1,
    progress: Progress | None = None,
) -> Sampled:
    """Sample a vectorised log-density (W, f) -> (W,) by independent ensembles until `ess` is reached.

    The proposal is refitted to the burn-in's draws, then frozen. Stops at a fixed number of steps; the
    caller judges convergence by the returned diagnostics. `threads` share the ensembles; the draws are the
    same for any number of them.
    """
    import emcee

    began = time.perf_counter()
    size = len(proposal.location)
    walkers = max(32, 2 * (size + 1))
    seeds = np.random.SeedSequence(seed).spawn(ENSEMBLES)
    randoms = [np.random.RandomState(np.random.MT19937(s)) for s in seeds]
    states = []
    for random in randoms:
        points = proposal.draw(walkers, random)
        bad = ~np.isfinite(log_density(points))
        points[bad] = proposal.location + 1e-3 * (points[bad] - proposal.location)
        states.append(emcee.State(points, random_state=random.get_state()))

    def sampler(current: IndependenceProposal) -> Any:
        moves = [(emcee.moves.MHMove(current), 0.8), (emcee.moves.DEMove(), 0.2)]
        return emcee.EnsembleSampler(walkers, size, log_density, moves=moves, vectorize=True)

    def run(chains: list[Any], steps: int) -> None:
        advance = [
            pool.submit(c.run_mcmc, s, steps, skip_initial_state_check=True)
            for c, s in zip(chains, states, strict=True)
        ]
        states[:] = [done.result() for done in advance]

    pool = ThreadPoolExecutor(max_workers=threads)
    burning = [sampler(proposal) for _ in range(ENSEMBLES)]
    run(burning, _BURN_IN)
    proposal = _refitted(
        proposal, np.concatenate([c.get_chain(discard=_BURN_IN // 2, flat=True) for c in burning])
    )

    chains = [sampler(proposal) for _ in range(ENSEMBLES)]
    values = np.empty((ENSEMBLES, walkers, 0, size))
    rhat = bulk = np.full(size, np.nan)
    for steps in _BLOCKS:
        run(chains, steps)
        values = np.stack([chain.get_chain().transpose(1, 0, 2) for chain in chains])
        rhat, bulk = diagnostics(values)
        reached = float(bulk.min()) if np.isfinite(bulk).all() else 0.0
        if progress is not None:
            progress(min(reached / ess, 0.99))
        if reached >= ess and float(rhat.max()) <= RHAT_GATE:
            break
    pool.shutdown()
    acceptance = float(np.mean([chain.acceptance_fraction for chain in chains]))
    return Sampled(values, acceptance, rhat, bulk, time.perf_counter() - began)


def _refitted(proposal: IndependenceProposal, draws: Matrix) -> IndependenceProposal:
    """The proposal with the centre and spread of the burn-in's draws (kept if they are too few)."""
    size = len(proposal.location)
    if len(np.unique(draws[:, 0])) < 10 * size:
        return proposal
    factor = np.asarray(np.linalg.cholesky(np.cov(draws.T).reshape(size, size)), dtype=float)
    return IndependenceProposal(draws.mean(axis=0), factor, proposal.nu)


def diagnostics(values: Matrix) -> tuple[Matrix, Matrix]:
    """Nested rank R-hat and bulk ESS (f,) of draws (ensembles, walkers, steps, f).

    R-hat compares the ensembles: walkers of one ensemble are not independent chains (Margossian et al. 2024).
    """
    from arviz_stats.base import array_stats

    ensembles, walkers, steps, size = values.shape
    rhat, bulk = np.empty(size), np.empty(size)
    superchains = np.repeat(np.arange(ensembles), walkers)
    for j in range(size):
        chains = values[..., j].reshape(ensembles * walkers, steps)
        if np.ptp(chains) == 0:
            rhat[j], bulk[j] = np.inf, 0.0
            continue
        rhat[j] = float(array_stats.rhat_nested(chains, superchain_ids=superchains, method="rank"))
        bulk[j] = float(array_stats.ess(chains, method="bulk"))
    return rhat, bulk


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
    coordinates = SeenCoordinates(problem)
    from_z = np.linalg.inv(coordinates.jacobian(fit.x))
    covariance = from_z @ fit.covariance @ from_z.T
    whitening = Whitening(coordinates.from_parameters(fit.x), np.linalg.cholesky(covariance))

    def log_density(w: Matrix) -> Matrix:
        x = coordinates.to_parameters(whitening.undo(w))
        return problem.log_likelihood(x) + problem.log_prior(x)

    size = len(fit.z)
    proposal = IndependenceProposal(np.zeros(size), np.eye(size), degrees_of_freedom(size))
    # The kernel lets go of Python's lock: with many shots the ensembles use the cores that are there. With
    # few shots the lock is what they would wait for.
    threads = min(ENSEMBLES, os.cpu_count() or 1) if problem.shots > _THREADS_FROM else 1
    sampled = sample_density(log_density, proposal, seed=seed, ess=ess, threads=threads, progress=progress)
    return _told(problem, coordinates, whitening, sampled, status, ess, time.perf_counter() - began)


def _told(
    problem: Problem,
    coordinates: SeenCoordinates,
    whitening: Whitening,
    sampled: Sampled,
    status: tuple[Status, ...],
    ess: float,
    seconds: float,
) -> tuple[PosteriorSummary, Draws]:
    """Draws and summary in the units that people read."""
    parameters = problem.parameters
    ensembles, walkers, steps, size = sampled.values.shape
    x = coordinates.to_parameters(whitening.undo(sampled.values.reshape(-1, size)))
    shown = (x * parameters.display)[:, parameters.free].reshape(ensembles, walkers, steps, size)
    free = [(item, state) for item, state in zip(parameters.items, status, strict=True) if not item.held]
    rhat, bulk = diagnostics(shown)
    converged = bool(rhat.max() <= RHAT_GATE and bulk.min() >= min(ess, 400.0))
    if converged:
        message = (
            f"{ensembles} independent ensembles agree: R-hat {rhat.max():.3f},"
            f" at least {bulk.min():.0f} effective draws"
        )
    else:
        message = (
            f"the posterior has not converged (R-hat {rhat.max():.3f}, smallest effective sample size"
            f" {bulk.min():.0f}): its draws are not shown. Record more varied shots, or hold what the data"
            " cannot tell"
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
        mean, std = item.prior_mean * item.display, item.prior_std * item.display
        low, middle, high = (NormalDist(mean, std).inv_cdf(q) for q in (0.025, 0.5, 0.975))
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
