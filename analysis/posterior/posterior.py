"""The posterior around a fit: sampled by `sampler` in the coordinates of `whitening`, told in the units that
people read; and the 95 % intervals of parameters by three methods."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from statistics import NormalDist
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from ...model.arrays import Matrix, ShareDone
from ...model.errors import UnsoundResult
from ...model.kernel import threads
from ...model.likelihood.density import Density
from ...model.likelihood.parameters import Parameter
from ...model.likelihood.problem import Problem
from ...model.records import internal, it, record, worded
from ..solution import Solution, undecided_names
from ..status import Status, has_numbers, require_no_more_than
from .convergence import Ends, MarginalT, Weights, error_of_mean, weighted_ends
from .profiles import profile_ends
from .sampler import RHAT_GATE, IndependenceProposal, Proposed, Sampled, degrees_of_freedom, sample_density
from .sheet import Whitening

_KEPT_PER_WALKER = 400
_WEIGHED = 20_000  # proposals, at most, to compare draws with
APART = 0.05  # of its width: by so much a 95 % interval of draws may be off that of another method


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
class Agreement:
    """Whether another method than the chains has the same intervals of what the data determine.

    `by` importance sampling, where its weights serve (`pareto_k` of their tail, effective `share` of the
    independent draws), else by the profile likelihood; None where neither is to be had. `name` is the
    parameter whose interval of draws is off most, by `off` of the width (0 where chance explains it).
    """

    by: Literal["importance", "profile"] | None
    pareto_k: float | None
    share: float | None
    name: str | None
    off: float

    @property
    def holds(self) -> bool:
        return self.by is not None and self.off <= APART


@record(needed=("converged", "message"))
class PosteriorSummary:
    """Diagnostics of the sampling. `drifts`: the ensembles agree, but their draws still drift. Without any
    draws it was not sampled: `useless` says why nobody needs it, it was `omitted`, or the fit did not
    converge.
    """

    converged: Annotated[bool, it("whether the draws may be used")]
    drifts: Annotated[bool, internal]
    draws: Annotated[int, it("how many")]
    ensembles: Annotated[int, it("independent ones")]
    walkers: Annotated[int, it("of each ensemble")]
    ess_min: Annotated[float | None, it("smallest effective sample size")]
    rhat_max: Annotated[float | None, it("largest nested R-hat, of the ensembles")]
    acceptance: Annotated[float | None, it("share of the proposed moves that were accepted")]
    seconds: Annotated[float, it("that it took")]
    parameters: Annotated[
        tuple[PosteriorParameter, ...] | None,
        it(
            "null unless converged; nothing is sampled of a misfit, or where no parameter is "
            "identifiable. A list of `name`, `unit`, `source` (`data`, or `prior` for an "
            "unidentifiable parameter: the numbers are then those of its own prior), `mean`, `std`, "
            "`q2_5`, `q50`, `q97_5`, `ess_bulk`, `ess_tail`, `rhat`, `mcse_mean`"
        ),
    ]
    agreement: Annotated[
        Agreement | None,
        it(
            "whether another method confirms the draws, null where they did not get so far: `by` "
            "(`importance`: sampling weighted by the density, or `profile`: the profile likelihood; "
            "null where neither serves), `pareto_k` of the weights and their effective `share`, and "
            "`name`, the parameter whose 95 % interval of draws is off most, by `off` of its width "
            "beyond chance. More than 0.05 is not converged"
        ),
    ] = None
    useless: Annotated[Literal["nothing known", "little known", "misfit"] | None, internal] = None
    omitted: Annotated[Omitted | None, internal] = None
    message: Annotated[str | None, worded("why there are none, or why not, in words")] = field(
        default=None, kw_only=True
    )

    def __post_init__(self) -> None:
        if self.parameters is not None and not self.converged:
            raise UnsoundResult("an unconverged posterior has values")


UNSAMPLED = PosteriorSummary(False, False, 0, 0, 0, None, None, None, 0.0, None)
# All of a posterior that may be shown are the priors, and few numbers for many unknowns mix worst.
NOTHING_KNOWN = replace(UNSAMPLED, useless="nothing known")
# The draws would be spread along what the data leave open, turns of a whole revolution among it: a million of
# them say nothing of the few parameters that the curvature and the profiles do not.
LITTLE_KNOWN = replace(UNSAMPLED, useless="little known")
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


def not_worth_sampling(solution: Solution) -> PosteriorSummary | None:
    """The summary of a posterior that nobody needs draws of: of a misfit, or where the data determine nothing
    or less than half of the offsets. None of any other; several optima are what draws are for."""
    if solution.misfit is not None:
        return OF_A_MISFIT
    if not solution.known:
        return NOTHING_KNOWN
    undecided = undecided_names(solution.null_space)
    free = [row for row in solution.offsets if not row.held]
    offsets = [has_numbers(row.status) or row.name in undecided for row in free]
    return LITTLE_KNOWN if 2 * sum(offsets) < len(offsets) else None


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
    target = _Target(solution)
    ends: dict[str, Ends] = {}  # of the draws so far
    agreements: list[Agreement] = []

    def short(judged: Matrix, proposed: Proposed | None) -> float:
        ends.update(target.ends(judged, proposed))
        return 0.0 if short_by is None else short_by(ends)

    def agrees(judged: Matrix, proposed: Proposed | None) -> bool:
        agreements.append(target.agreement(judged, proposed))
        return agreements[-1].holds

    size = len(solution.fit.z)
    proposal = IndependenceProposal(np.zeros(size), np.eye(size), degrees_of_freedom(size))
    # The kernel lets go of Python's lock, so that the cores that are there share its rows.
    sampled = sample_density(
        target.log_density,
        proposal,
        seed=seed,
        ess=ess,
        threads=threads(),
        judged=target.shown,
        short_by=short,
        agrees=agrees,
        progress=progress,
    )
    agreement = agreements[-1] if agreements else None
    seconds = time.perf_counter() - began
    summary, draws = _summarised(solution.problem, sampled, solution.status, ess, seconds, agreement)
    return summary, replace(draws, ends=ends)


class _Target:
    """The posterior in the sampler's coordinates u (W, f), and what is said of draws in them."""

    def __init__(self, solution: Solution) -> None:
        self._solution, self._problem = solution, solution.problem
        self._whitening = Whitening(Density(solution.problem), solution.fit.x, solution.fit.covariance)
        self.log_density = self._whitening.log_density
        free = _free(solution.problem, solution.status)
        self._known = [(j, item) for j, (item, state) in enumerate(free) if has_numbers(state)]

    def shown(self, u: Matrix) -> Matrix:
        """Draws (…, f) in the units that people read."""
        parameters = self._problem.parameters
        x = self._whitening.parameters(u.reshape(-1, u.shape[-1]))
        return np.asarray(parameters.shown(x)[:, parameters.free].reshape(u.shape))

    def ends(self, judged: Matrix, proposed: Proposed | None) -> dict[str, Ends]:
        """By name, of each known offset and tool parameter: those of the draws or, where they are sharper, of
        what was proposed to them."""
        of_arm = [(j, item) for j, item in self._known if item.group in ("offset", "tool")]
        result = {item.name: Ends.of_draws(_chains(judged[..., j])) for j, item in of_arm}
        if proposed is not None and (weights := Weights.of(proposed.log_weights)).serve:
            for name, sharper in self._weighed(proposed, weights, of_arm).items():
                # Another mode, which the draws have found, is not among the proposals.
                if sharper.ess_tail > result[name].ess_tail and not result[name].off(sharper):
                    result[name] = sharper
        return result

    def agreement(self, judged: Matrix, proposed: Proposed | None) -> Agreement:
        """Of draws and of what was proposed to them."""
        draws = {item.name: Ends.of_draws(_chains(judged[..., j])) for j, item in self._known}
        other: dict[str, Ends] = {}
        by: Literal["importance", "profile"] | None = None
        weights = None
        if proposed is not None:
            some = proposed._replace(
                points=proposed.points[:_WEIGHED], log_weights=proposed.log_weights[:_WEIGHED]
            )
            weights = Weights.of(some.log_weights)
            if weights.serve:
                by, other = "importance", self._weighed(some, weights, self._known)
        if by is None:
            other = self._profiled(draws)
            by = "profile" if other else None
        off = {name: draws[name].off(ends) for name, ends in other.items()}
        name = max(off, key=lambda name: off[name], default=None)
        finite = weights is not None and np.isfinite(weights.pareto_k)
        return Agreement(
            by,
            weights.pareto_k if weights is not None and finite else None,
            None if weights is None else weights.share,
            name,
            0.0 if name is None else off[name],
        )

    def _weighed(
        self, proposed: Proposed, weights: Weights, which: list[tuple[int, Parameter]]
    ) -> dict[str, Ends]:
        """By what was proposed, of the free parameters `which`. Without a sheet offsets and tool parameters
        are straight in the sampler's coordinates, so that they are proposed by a t."""
        shown = self.shown(proposed.points)
        whitening, of = self._whitening, proposed.proposal
        result = {}
        for j, item in which:
            marginal = None
            if not whitening.curved and item.group in ("offset", "tool"):
                scale = item.prior_std * item.display
                along = whitening.factor[j] * scale
                middle = item.prior_mean * item.display + whitening.centre[j] * scale + along @ of.location
                marginal = MarginalT(float(middle), float(np.linalg.norm(along @ of.factor)), of.nu)
            result[item.name] = weighted_ends(shown[:, j], weights, marginal)
        return result

    def _profiled(self, draws: Mapping[str, Ends]) -> dict[str, Ends]:
        """By the profile likelihood, with the std of the draws; empty unless there is one of every offset."""
        items = [item for _, item in self._known if item.group in ("offset", "tool")]
        which = np.array([self._problem.parameters.index(item.name) for item in items], dtype=int)
        ends = profile_ends(self._solution, which)
        if not np.isfinite(ends).all():
            return {}
        return {
            item.name: Ends(draws[item.name].std, item.shown(low), item.shown(high), np.inf)
            for item, (low, high) in zip(items, ends, strict=True)
        }


def _summarised(
    problem: Problem,
    sampled: Sampled,
    status: tuple[Status, ...],
    ess: float,
    seconds: float,
    agreement: Agreement | None,
) -> tuple[PosteriorSummary, Draws]:
    """Draws and summary in the units that people read."""
    shown = sampled.judged
    ensembles, walkers, steps, _ = shown.shape
    rhat, bulk = sampled.rhat, sampled.ess_bulk
    free = _free(problem, status)
    mixed = bool(sampled.settled and rhat.max() <= RHAT_GATE and bulk.min() >= min(ess, 400.0))
    converged = mixed and sampled.agrees
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
        agreement=agreement if mixed else None,
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


_DIFFERS = 0.1  # of the width of an interval: by so much its ends may differ and still be the same


@record
class Intervals:
    """The 95 % intervals of one parameter by three methods, where they differ or the parameter is weak."""

    name: Annotated[str, it("of an offset, tool or noise parameter")]
    unit: Annotated[str, it("of its ends")]
    status: Annotated[Status, internal]
    linear: Annotated[
        tuple[float, float], it("the `interval95` of the parameter, by the curvature at the mode")
    ]
    profile: Annotated[
        tuple[float, float] | None, it("by the profile likelihood; null where an end was not found")
    ]
    posterior: Annotated[
        tuple[float, float] | None, it("between the quantiles of the draws; null without a posterior")
    ]
    differ: Annotated[bool, it("whether an end is off by a tenth of the width or more")]

    def __post_init__(self) -> None:
        require_no_more_than(self.name, self.status, interval95=self.linear)


def intervals(solution: Solution, posterior: PosteriorSummary) -> tuple[Intervals, ...]:
    """Of offsets, tool and noise: where the three methods differ, or the parameter is weak."""
    if not solution.converged:
        return ()
    problem, rows = solution.problem, solution.parameters
    which = np.array([i for i in solution.known if rows[i].group != "target"], dtype=int)
    ends = profile_ends(solution, which)
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
        status = solution.identified.status[i]
        wide = status == "assumed" and bool(solution.std[i] > item.tolerance)
        if differ or status == "weak" or wide:
            result.append(
                Intervals(
                    row.name, row.unit, row.status, row.interval95, profile, draws.get(row.name), differ
                )
            )
    return tuple(result)
