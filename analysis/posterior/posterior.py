"""The posterior around a fit: sampled by `sampler`, in the units that people read.

The walkers live in the coordinates of `coordinates`, whitened by the fit: near it a unit normal.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from statistics import NormalDist
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...model.arrays import Matrix, ShareDone
from ...model.likelihood.density import Density
from ...model.likelihood.parameters import Parameter
from ...model.likelihood.problem import Problem
from ..estimation.coordinates import FlangeCoordinates
from ..estimation.fit import LikelihoodFit
from ..estimation.threads import threads
from ..solution import Solution
from ..status import Status, UnsoundResult, has_numbers, require_no_more_than
from .convergence import error_of_mean
from .ends import Ends, MarginalT, weighted_ends
from .sampler import (
    RHAT_GATE,
    IndependenceProposal,
    Proposed,
    Sampled,
    degrees_of_freedom,
    sample_density,
)

_KEPT_PER_WALKER = 400


@dataclass(frozen=True)
class PosteriorParameter:
    """Summary of one parameter's draws. Where `source` is `prior` (the data do not determine it) mean, std
    and quantiles are those of its own prior and nothing else; only the diagnostics are the draws'."""

    name: str
    unit: str
    source: Literal["data", "prior"]
    mean: float
    std: float
    q2_5: float
    q50: float
    q97_5: float
    ess_bulk: float
    ess_tail: float
    rhat: float
    mcse_mean: float

    @property
    def ends(self) -> Ends:
        return Ends(self.std, self.q2_5, self.q97_5, self.ess_tail)


@dataclass(frozen=True)
class Omitted:
    """Nobody asked for draws. The curvature at the mode is a poor approximation of the posterior for the
    parameters in `poor`: their profile likelihood has other intervals. Not `tested` where there is no profile
    (separate noise factors)."""

    poor: tuple[str, ...]
    tested: bool

    @property
    def enough(self) -> bool:
        """Whether the curvature describes the posterior."""
        return self.tested and not self.poor


@dataclass(frozen=True)
class PosteriorSummary:
    """Diagnostics of the sampling; `parameters` is None unless it converged.

    `drifts`: the ensembles agree, but their draws still drift. Without any draws it was not sampled:
    `useless` says why nobody needs it, it was `omitted`, or the fit did not converge.
    """

    converged: bool
    drifts: bool
    draws: int
    ensembles: int
    walkers: int
    ess_min: float | None
    rhat_max: float | None
    acceptance: float | None
    seconds: float
    parameters: tuple[PosteriorParameter, ...] | None
    useless: Literal["nothing known", "misfit"] | None = None
    omitted: Omitted | None = None

    def __post_init__(self) -> None:
        if self.parameters is not None and not self.converged:
            raise UnsoundResult("an unconverged posterior has values")


UNSAMPLED = PosteriorSummary(False, False, 0, 0, 0, None, None, None, 0.0, None)
# All of a posterior that may be shown are the priors, and few numbers for many unknowns mix worst.
NOTHING_KNOWN = replace(UNSAMPLED, useless="nothing known")
OF_A_MISFIT = replace(UNSAMPLED, useless="misfit")


@dataclass(frozen=True)
class PriorOnly:
    """A parameter that the data do not determine: all that is known of it is its prior, in the units that
    people read. A noise factor's is log-normal: `mean` and `std` are of its logarithm if `logarithmic`."""

    name: str
    unit: str
    mean: float
    std: float
    logarithmic: bool

    def draws(self, rng: np.random.Generator, size: tuple[int, ...]) -> Matrix:
        """Independent draws of the prior."""
        values = self.mean + self.std * rng.normal(size=size)
        return np.exp(values) if self.logarithmic else values


@dataclass(frozen=True, eq=False)
class Draws:
    """Posterior draws of the m parameters that the data determine, and of nothing else.

    The draws of an unidentifiable parameter can be narrow by what the priors of others make of it, and would
    pass for knowledge.

    Attributes
    ----------
    names, units, status : tuple of str
        (m,) of each parameter; units are deg, mm, or 1 for a noise factor.
    values : ndarray
        (ensembles, walkers, steps, m). The walkers of one ensemble are not independent of each other.
    prior_only : tuple of PriorOnly
        The free parameters that the data do not determine, with their priors.
    converged : bool
        False: the draws are no posterior and must not be used as one.
    ends : mapping
        By name, of each known offset and tool parameter the ends of its 95 % interval: by the draws or, where
        that is sharper, by what was proposed to them.

    Raises
    ------
    UnsoundResult
        A parameter is of a status that allows no draws.

    Examples
    --------
    >>> import numpy as np
    >>> import zerobeam as zb
    >>> zb.Draws(("delta2",), ("deg",), ("identified",), np.zeros((4, 32, 100, 1)), (), True).values.shape
    (4, 32, 100, 1)
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    status: tuple[Status, ...]
    values: Matrix
    prior_only: tuple[PriorOnly, ...]
    converged: bool
    ends: Mapping[str, Ends] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, status in zip(self.names, self.status, strict=True):
            require_no_more_than(name, status, draws=self.values)
        if self.values.shape[-1] != len(self.names):
            raise UnsoundResult(f"draws of {len(self.names)} parameters have the shape {self.values.shape}")

    def __repr__(self) -> str:
        count = self.values[..., 0].size if self.names else 0
        how = "converged" if self.converged else "not converged: no posterior"
        return f"<Draws: {count} of {len(self.names)} parameters, {how}>"


class Whitening:
    """w = L^-1 (v - centre): near the fit a unit normal, where the walkers live."""

    def __init__(self, centre: Matrix, factor: Matrix) -> None:
        self.centre, self.factor = centre, factor

    @classmethod
    def around(cls, fit: LikelihoodFit, coordinates: FlangeCoordinates) -> Whitening:
        """By the covariance of a fit."""
        covariance = coordinates.covariance(fit.x[None], fit.covariance[None])[0]
        factor = np.asarray(np.linalg.cholesky(covariance), dtype=float)
        return cls(coordinates.from_parameters(fit.x[None])[0], factor)

    def undo(self, w: Matrix) -> Matrix:
        return self.centre + w @ self.factor.T


def sample_posterior(
    solution: Solution,
    *,
    seed: int,
    ess: float = 1000.0,
    short_by: Callable[[Mapping[str, Ends]], float] | None = None,
    progress: ShareDone | None = None,
) -> tuple[PosteriorSummary, Draws]:
    """The posterior around a fit: its summary, gated by R-hat and ESS, and the draws in the units that people
    read.

    `short_by` says of the ends of the known offsets and tool parameters, by name, how many times as many
    draws they need (`sample_density`).
    """
    began = time.perf_counter()
    problem, fit = solution.problem, solution.fit
    density = Density(problem)
    coordinates = FlangeCoordinates(density)
    whitening = Whitening.around(fit, coordinates)

    def log_density(w: Matrix) -> Matrix:
        return density.log_posterior(coordinates.to_parameters(whitening.undo(w)))

    def shown(values: Matrix) -> Matrix:
        """Draws (…, f) of the sampler in the units that people read."""
        x = coordinates.to_parameters(whitening.undo(values.reshape(-1, len(fit.z))))
        return np.asarray(problem.parameters.shown(x)[:, problem.parameters.free].reshape(values.shape))

    def sharp(proposed: Proposed, j: int, item: Parameter) -> Ends | None:
        """By what was proposed: offsets and tool parameters are straight in the sampler's coordinates."""
        scale = item.prior_std * item.display
        along = whitening.factor[j] * scale
        of_mean = item.prior_mean * item.display + whitening.centre[j] * scale
        of_proposal = proposed.proposal
        marginal = MarginalT(
            float(of_mean + along @ of_proposal.location),
            float(np.linalg.norm(along @ of_proposal.factor)),
            of_proposal.nu,
        )
        return weighted_ends(of_mean + proposed.points @ along, proposed.log_weights, marginal)

    ends: dict[str, Ends] = {}  # of the draws so far

    def short(judged: Matrix, proposed: Proposed | None) -> float:
        for j, (item, state) in enumerate(_free(problem, solution.status)):
            if has_numbers(state) and item.group in ("offset", "tool"):
                of_draws = Ends.of_draws(_chains(judged[..., j]))
                better = None if proposed is None else sharp(proposed, j, item)
                # Another mode, which the draws have found, is not among the proposals.
                ends[item.name] = of_draws if better is None or better.contradict(of_draws) else better
        return 0.0 if short_by is None else short_by(ends)

    size = len(fit.z)
    proposal = IndependenceProposal(np.zeros(size), np.eye(size), degrees_of_freedom(size))
    # The kernel lets go of Python's lock, so that the cores that are there share its rows.
    sampled = sample_density(
        log_density,
        proposal,
        seed=seed,
        ess=ess,
        threads=threads(),
        judged=shown,
        short_by=short,
        progress=progress,
    )
    summary, draws = _summarised(problem, sampled, solution.status, ess, time.perf_counter() - began)
    return summary, replace(draws, ends=ends)


def _summarised(
    problem: Problem, sampled: Sampled, status: tuple[Status, ...], ess: float, seconds: float
) -> tuple[PosteriorSummary, Draws]:
    """Draws and summary in the units that people read."""
    shown = sampled.judged
    ensembles, walkers, steps, _ = shown.shape
    rhat, bulk = sampled.rhat, sampled.ess_bulk
    free = _free(problem, status)
    converged = bool(sampled.settled and rhat.max() <= RHAT_GATE and bulk.min() >= min(ess, 400.0))
    by_parameter = np.moveaxis(shown, -1, 0).copy()
    items, unidentifiable = zip(*((item, state == "unidentifiable") for item, state in free), strict=True)
    with ThreadPoolExecutor(threads()) as pool:
        rows = tuple(pool.map(_row, items, unidentifiable, by_parameter, rhat.tolist(), bulk.tolist()))
    summary = PosteriorSummary(
        converged=converged,
        drifts=not sampled.settled and bool(rhat.max() <= RHAT_GATE),
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
    determined = [j for j, (_, state) in enumerate(free) if has_numbers(state)]
    kept = [free[j] for j in determined]
    draws = Draws(
        tuple(item.name for item, _ in kept),
        tuple(item.unit for item, _ in kept),
        tuple(state for _, state in kept),
        shown[:, :, ::thin][..., determined],
        tuple(_prior_only(item) for item, state in free if not has_numbers(state)),
        converged,
    )
    return summary, draws


def _free(problem: Problem, status: tuple[Status, ...]) -> list[tuple[Parameter, Status]]:
    return [
        (item, state) for item, state in zip(problem.parameters.items, status, strict=True) if not item.held
    ]


def _chains(draws: Matrix) -> Matrix:
    """(ensembles, walkers, steps) as (chains, steps)."""
    return draws.reshape(-1, draws.shape[2])


def _prior_only(item: Parameter) -> PriorOnly:
    logarithmic = item.group == "noise"
    display = 1.0 if logarithmic else item.display
    return PriorOnly(item.name, item.unit, item.prior_mean * display, item.prior_std * display, logarithmic)


def _row(
    item: Parameter, unidentifiable: bool, draws: NDArray[np.float64], rhat: float, bulk: float
) -> PosteriorParameter:
    chains = _chains(draws)
    ends = Ends.of_draws(chains)
    if unidentifiable:
        # The draws may be narrow for all that: what the priors of other parameters make of this one. Only
        # its own prior is stated, and exactly, so that no spread can be taken for knowledge from the data.
        prior = NormalDist(item.prior_mean, item.prior_std)
        low, middle, high = (item.shown(prior.inv_cdf(q)) for q in (0.025, 0.5, 0.975))
        mean, std = item.shown_prior
        ends = ends._replace(std=std, q2_5=low, q97_5=high)
        mcse = 0.0
    else:
        mean, middle = float(chains.mean()), float(np.median(chains))
        mcse = error_of_mean(chains)
    return PosteriorParameter(
        name=item.name,
        unit=item.unit,
        source="prior" if unidentifiable else "data",
        mean=mean,
        std=ends.std,
        q2_5=ends.q2_5,
        q50=middle,
        q97_5=ends.q97_5,
        ess_bulk=bulk,
        ess_tail=ends.ess_tail,
        rhat=rhat,
        mcse_mean=mcse,
    )
