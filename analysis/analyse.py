"""The street: a run goes in, the whole answer comes out."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.special import stdtrit
from threadpoolctl import threadpool_limits

from ..model.errors import BadInput
from ..model.files.run import Run
from ..model.parameters import Parameter
from ..model.problem import Problem, rms_length
from ..model.robot import Matrix
from .diagnostics.accuracy import accuracy
from .diagnostics.budget import budget
from .diagnostics.displacement import displacement
from .diagnostics.hold_out import hold_out
from .diagnostics.influence import influence
from .diagnostics.notes import OUTLYING, misfit, notes
from .diagnostics.scene import scene
from .estimation.fit import CONTRADICTED, LikelihoodFit, fit_likelihood, start_at
from .estimation.midpoint import MidpointFit, fit_midpoint
from .estimation.profile import profile_intervals
from .estimation.robust import Loss, fit_robust, outlying
from .observability.identifiability import Identified, identify_at
from .observability.verdict import listed, reason_for, verdict, verdict_sentence
from .posterior.posterior import sample_posterior
from .result import (
    DistanceResult,
    Draws,
    FitSummary,
    Inputs,
    Intervals,
    ParameterResult,
    PosteriorSummary,
    Result,
    Robust,
    RobustParameter,
    ShotResult,
    Status,
    versions,
)

Progress = Callable[[str, float], None]

_DIFFERS = 0.1  # of the width of an interval: by so much its ends may differ and still be the same
_MEDIAN_WORTH = 0.48  # a scale from the median tells as much as one from so large a share of the numbers
_NORMAL_95 = 1.959963984540054  # half width of the central 95 % of a unit normal


def analyse(
    run: Run,
    *,
    seed: int = 0,
    ess: float = 1000.0,
    robust: Loss | None = None,
    held_out: Sequence[str] = (),
    progress: Progress | None = None,
) -> tuple[Result, Draws | None]:
    """Everything that a recorded run tells: fits, identifiability, posterior, influence, verdict.

    `ess` is the effective sample size asked of every parameter; `robust` asks for a fit with that loss
    beside the others, `held_out` for a fit without the targets of these names (* and ? as in file names)
    and a look at how it does there. `progress` is told the stage and its share. Draws are None where the
    fit did not converge.
    """
    # Small matrices: threads in the linear algebra cost more than they give, and change the last bits.
    with threadpool_limits(limits=1, user_api="blas"):
        try:
            return _analyse(run, seed, ess, robust, held_out, progress or (lambda stage, share: None))
        except BadInput as error:
            raise error.at(run.path, run.header_line) from error


def _analyse(
    run: Run, seed: int, ess: float, loss: Loss | None, held_out: Sequence[str], tell: Progress
) -> tuple[Result, Draws | None]:
    run.require_analysable()
    problem = Problem.from_run(run)
    require_noise_data(problem)
    tell("fit", 0.0)
    # What was asked for in vain is said before the long part.
    unseen = hold_out(problem, held_out, seed) if held_out else None
    fit = fit_likelihood(problem, seed=seed)
    tell("fit", 0.7)
    midpoint = fit_midpoint(problem)
    tell("fit", 1.0)
    tell("identifiability", 0.0)
    identified = identify_at(fit)
    tool = accuracy(problem, fit, identified)
    std = problem.parameters.unscaled(fit.std)
    tell("identifiability", 1.0)
    draws: Draws | None = None
    if fit.converged:
        tell("posterior", 0.0)
        posterior, draws = sample_posterior(
            problem,
            fit,
            identified.status,
            seed=seed,
            ess=ess,
            progress=lambda share: tell("posterior", share),
        )
        tell("posterior", 1.0)
    else:
        posterior = PosteriorSummary(
            False, "not sampled: the fit did not converge", 0, 0, 0, None, None, None, 0.0, None
        )
    likelihood = _likelihood_summary(problem, fit, identified)
    shots = _shots(problem, fit)
    rows = _parameters(problem, identified, fit, std, midpoint, likelihood)
    robust = _robust(problem, fit, rows, loss) if loss is not None and fit.converged else None
    result = Result(
        verdict=verdict(problem, identified) if fit.converged else "degenerate",
        headline=_headline(problem, identified, likelihood),
        parameters=rows,
        identifiability=identified.facts,
        likelihood=likelihood,
        midpoint=_midpoint_summary(midpoint),
        posterior=posterior,
        shots=shots,
        distances=_distances(problem, fit),
        intervals=_intervals(problem, fit, rows, posterior, likelihood) if fit.converged else (),
        accuracy=tool,
        budget=budget(problem, fit, identified, posterior),
        robust=robust,
        hold_out=unseen,
        scene=scene(fit, identified),
        notes=notes(
            likelihood,
            fit.chance is not None and fit.chance < CONTRADICTED,
            posterior,
            displacement(fit) if fit.converged else None,
            shots,
            robust,
            unseen,
            run.warnings,
        ),
        inputs=_inputs(run, problem, seed),
    )
    return result, draws


def require_noise_data(problem: Problem) -> None:
    """Raise BadInput where the noise scale is to be estimated from no more numbers than unknowns."""
    if not problem.tells_noise:
        free = int(problem.parameters.free.sum())
        raise BadInput(
            "the noise scale cannot be estimated from so few shots",
            found=f"{problem.data_size} numbers from {problem.shots} shots for {free} unknowns",
            allowed="more numbers than unknowns",
            remedy="record more shots, or state noise.scale: known",
        )


def _parameters(
    problem: Problem,
    identified: Identified,
    fit: LikelihoodFit,
    std: Matrix,
    midpoint: MidpointFit,
    summary: FitSummary,
) -> tuple[ParameterResult, ...]:
    parameters = problem.parameters
    quantile = _quantile(problem, summary)
    rows = []
    for i, item in enumerate(parameters.items):
        # A fit that did not converge leaves nothing that could be called identified.
        status: Status = identified.status[i] if fit.converged or item.held else "unidentifiable"
        value, spread = float(fit.x[i]), float(std[i])
        known = status in ("identified", "weak")
        data_std = item.shown_std(value, float(identified.data_std[i]))
        rows.append(
            ParameterResult(
                name=item.name,
                unit=item.unit,
                group=item.group,
                status=status,
                held=item.held,
                estimate=item.shown(value) if known or item.held else None,
                std=item.shown_std(value, spread) if known else None,
                data_std=data_std if np.isfinite(data_std) else None,
                interval95=_interval(item, value, quantile * spread) if known else None,
                prior_std=item.shown_prior[1],
                midpoint=item.shown(float(midpoint.x[i]))
                if known and midpoint.available and midpoint.converged and item.group != "noise"
                else None,
                reason=reason_for(identified, item, status)
                if fit.converged or item.held
                else "the fit did not converge",
            )
        )
    return tuple(rows)


def _interval(item: Parameter, value: float, half: float) -> tuple[float, float]:
    return item.shown(value - half), item.shown(value + half)


def _intervals(
    problem: Problem,
    fit: LikelihoodFit,
    rows: Sequence[ParameterResult],
    posterior: PosteriorSummary,
    summary: FitSummary,
) -> tuple[Intervals, ...]:
    """Of offsets, tool and noise: where the three ways to an interval differ, or the parameter is weak."""
    which = np.array([i for i, row in enumerate(rows) if row.interval95 and row.group != "target"], dtype=int)
    # With noise factors the fit is at their marginal mode: there is no profile that starts from it.
    ends = np.full((len(which), 2), np.nan)
    if not problem.noise.separate:
        ends = profile_intervals(problem, fit, which, _profile_width(problem, summary))
    draws = {row.name: (row.q2_5, row.q97_5) for row in posterior.parameters or ()}
    told = []
    for i, (low, high) in zip(which, ends, strict=True):
        row, item = rows[i], problem.parameters.items[i]
        assert row.interval95 is not None
        profile = (item.shown(low), item.shown(high)) if np.isfinite([low, high]).all() else None
        others = [interval for interval in (profile, draws.get(row.name)) if interval is not None]
        margin = _DIFFERS * (row.interval95[1] - row.interval95[0])
        off = np.abs(np.array(others).reshape(-1, 2) - row.interval95).max(initial=0.0)
        differ = (profile is None and not problem.noise.separate) or bool(off > margin)
        if differ or row.status == "weak":
            told.append(Intervals(row.name, row.unit, row.interval95, profile, draws.get(row.name), differ))
    return tuple(told)


def _robust(problem: Problem, fit: LikelihoodFit, rows: Sequence[ParameterResult], loss: Loss) -> Robust:
    found = fit_robust(problem, fit, loss)
    parameters = problem.with_noise_of(fit.x)[0].parameters
    std = np.full(len(parameters), np.nan)
    if found.covariance is not None:
        std = parameters.unscaled(np.sqrt(np.diag(found.covariance)))
    numbers = problem.data_size - int(parameters.free.sum())
    quantile = float(stdtrit(max(numbers, 1), 0.975))
    told = []
    of = {row.name: row for row in rows}
    for item, value, spread in zip(parameters.items, found.x.tolist(), std.tolist(), strict=True):
        if item.held:
            continue
        row = of[item.name]
        known = row.estimate is not None and found.converged
        spread_known = known and bool(np.isfinite(spread)) and numbers > 0
        told.append(
            RobustParameter(
                name=row.name,
                unit=row.unit,
                estimate=item.shown(value) if known else None,
                std=item.shown_std(value, spread) if spread_known else None,
                interval95=_interval(item, value, quantile * spread) if spread_known else None,
            )
        )
    dof = max(1, int(_MEDIAN_WORTH * numbers)) if problem.noise.estimated else None
    off = outlying(found.whitened, problem.tool.miss_size, OUTLYING, dof)
    outliers = tuple(problem.shot_numbers[i] for i in off) if found.converged else ()
    return Robust(
        loss=loss,
        tuning=found.tuning,
        converged=found.converged,
        reason=found.reason,
        noise_scale=found.scale if problem.noise.estimated else None,
        parameters=tuple(told),
        weights=tuple(float(weight) for weight in found.weights),
        outliers=outliers,
        message=_robust_message(found.covariance is not None and numbers > 0, outliers),
    )


def _robust_message(with_spread: bool, outliers: Sequence[int]) -> str:
    named = "no shot is too far off for chance"
    if outliers:
        one = len(outliers) == 1
        named = (
            f"shot{'' if one else 's'} {listed([str(n) for n in outliers])} {'is' if one else 'are'} too far"
        )
        named += " off for chance"
    if with_spread:
        return named
    return (
        f"{named}; no uncertainty: a shot decides something alone, or there are no more numbers than unknowns"
    )


def _quantile(problem: Problem, summary: FitSummary) -> float:
    """Half width of a 95 % interval in stds: Student-t where the noise scale is estimated."""
    if problem.noise.estimated and summary.dof:
        return float(stdtrit(summary.dof, 0.975))
    return _NORMAL_95


def _profile_width(problem: Problem, summary: FitSummary) -> float:
    """The root of twice the drop at the ends of a 95 % profile interval: with an estimated scale the one that
    gives Student's interval for a linear fit, whose log-density is -M log(1 + t^2 / dof) / 2."""
    if problem.noise.estimated and summary.dof:
        numbers = problem.shots * problem.tool.miss_size
        return float(np.sqrt(numbers * np.log1p(_quantile(problem, summary) ** 2 / summary.dof)))
    return _NORMAL_95


def _likelihood_summary(problem: Problem, fit: LikelihoodFit, identified: Identified) -> FitSummary:
    before, _ = problem.linearise(start_at(problem, np.zeros((1, len(fit.z))))[0])
    chi2, dof, p_value = fit.against_noise(identified.facts.rank)
    message = None
    if dof == 0:
        message = "as many unknowns as numbers: the fit cannot be checked against the noise"
    elif not problem.noise.known:
        message = "the noise is estimated from these misses, so they cannot contradict it"
    return FitSummary(
        available=True,
        converged=fit.converged,
        reason=fit.reason,
        iterations=fit.iterations,
        cost=chi2 / 2,
        rms_mm=rms_length(fit.whitened.miss),
        rms_before_mm=rms_length(before),
        chi2=chi2,
        dof=dof,
        p_value=p_value,
        noise_scale=float(1 / np.sqrt(fit.weight)) if problem.noise.estimated else None,
        other_basins=fit.other_basins,
        message=message,
    )


def _midpoint_summary(fit: MidpointFit) -> FitSummary:
    return FitSummary(
        available=fit.available,
        converged=fit.converged,
        reason=fit.reason,
        iterations=fit.iterations,
        cost=fit.cost if fit.available else None,
        rms_mm=fit.rms if fit.available else None,
        rms_before_mm=None,
        chi2=None,
        dof=None,
        p_value=None,
        noise_scale=None,
        other_basins=0,
        message=fit.message,
    )


def _shots(problem: Problem, fit: LikelihoodFit) -> tuple[ShotResult, ...]:
    effect = influence(problem, fit)
    return tuple(
        ShotResult(
            shot=number,
            target=problem.targets[problem.target_index[i]],
            miss_mm=tuple(float(v) for v in fit.whitened.miss[i]),
            whitened=float(effect.whitened[i]),
            leave_one_out=_finite(effect.leave_one_out[i]),
            cooks=_finite(effect.cooks[i]),
        )
        for i, number in enumerate(problem.shot_numbers)
    )


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _distances(problem: Problem, fit: LikelihoodFit) -> tuple[DistanceResult, ...]:
    """Each stated distance next to what the fit makes of it, with the std of that."""
    rows = []
    targets, parameters = problem.split(fit.x).targets, problem.parameters
    for stated in problem.distances:
        between = targets[stated.second] - targets[stated.first]
        length = float(np.linalg.norm(between))
        along = np.zeros(len(parameters))
        along[parameters.block("target", stated.second)] = between / length
        along[parameters.block("target", stated.first)] = -between / length
        along = (along * parameters.prior_std)[parameters.free]
        rows.append(
            DistanceResult(
                between=(problem.targets[stated.first], problem.targets[stated.second]),
                mm=stated.mm,
                sigma_mm=stated.sigma,
                estimate=length if fit.converged else None,
                std=float(np.sqrt(along @ fit.covariance @ along)) if fit.converged else None,
            )
        )
    return tuple(rows)


def _headline(problem: Problem, identified: Identified, fit: FitSummary) -> str:
    if not fit.converged:
        return f"The fit did not converge ({fit.reason}): no offset is reported."
    factor = misfit(fit)
    doubt = (
        ""
        if factor is None
        else f" But the model does not fit: the misses are {factor:.1f} times what the stated noise explains."
    )
    return verdict_sentence(problem, identified) + doubt


def _inputs(run: Run, problem: Problem, seed: int) -> Inputs:
    return Inputs(
        run=run.path.name,
        sha256=run.sha256,
        robot=run.robot.name,
        shots=problem.shots,
        targets=problem.targets,
        seed=seed,
        versions=versions(),
        header=run.header.model_dump(mode="json", by_alias=True, exclude_none=True),
    )
