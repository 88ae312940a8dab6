"""The whole analysis of a run: fit, judgement, posterior, diagnostics, result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ..model.arrays import Progress
from ..model.errors import BadInput, located
from ..model.files.run import Run
from ..model.kernel import one_blas_thread
from ..model.likelihood.geometry import NOMINAL
from ..model.likelihood.parameters import Tie
from ..model.likelihood.problem import Problem
from ..model.options import Sampling
from .answer.findings import findings
from .answer.result import (
    AngleResult,
    DistanceResult,
    FitSummaries,
    Inputs,
    LikelihoodSummary,
    Result,
)
from .diagnostics.accuracy import accuracy
from .diagnostics.budget import budget, more_draws
from .diagnostics.diagnosis import Explanation, diagnose
from .diagnostics.hold_out import HoldOut, hold_out, placement_result
from .diagnostics.null_motion import motion_of_run
from .diagnostics.outliers import Loss, robust_result, shot_results
from .diagnostics.scene_data import scene
from .diagnostics.values_to_enter import Entered, entered
from .estimation.fit import as_small, start_at
from .estimation.midpoint import MidpointFit, fit_midpoint
from .ladder import solve_run
from .observability.better_postures import kept, usual_constraints
from .observability.geometry_result import bases
from .observability.outlook import MedianAnd95, Outlook, Prospect, Prospects
from .posterior.posterior import (
    UNSAMPLED,
    Draws,
    Intervals,
    Omitted,
    PosteriorSummary,
    intervals,
    not_worth_sampling,
    sample_posterior,
)
from .prediction import PredictedRun, predict_run, require_predictable
from .repeatability.consistency import offsets_without_prior
from .solution import ParameterTable, Solution, require_noise_data, undecided_names
from .status import has_numbers, versions
from .tcp_region import judged_axis, region_of

MOST_ESS = 1e5  # quantiles have three digits long before; the draws of more do not go into memory


@dataclass(frozen=True)
class Options:
    """What an analysis was asked for besides the run: the arguments of `Analysis.of` that change the answer.

    `held_out` are names, or the SHA-256 of another run."""

    seed: int
    ess: float
    robust: Loss | None
    held_out: tuple[str, ...] | str
    sampling: Sampling


@dataclass(frozen=True, eq=False, kw_only=True)
class Analysis(Solution):
    """The solution of a recorded `run` with the whole `result`, and the posterior's `draws` (None where the
    fit did not converge).

    Two are equal if run, options and versions are: the last digits of a fit depend on what was compiled
    before it."""

    run: Run
    result: Result
    draws: Draws | None
    options: Options

    @classmethod
    def of(
        cls,
        run: Run,
        *,
        seed: int = 0,
        ess: float = 1000.0,
        robust: Loss | None = None,
        held_out: Sequence[str] | Run = (),
        sampling: Sampling = "always",
        progress: Progress | None = None,
    ) -> Self:
        """Everything that can be said of a recorded run: fits, identifiability, posterior, verdict.

        `ess` is the effective sample size that every parameter must have; `robust` adds a fit with that loss,
        `held_out` a fit without the targets of these names (* and ? as in file names) and a look at how it
        does there, or another run of the same header, which is predicted. The posterior is sampled
        `always`, `never`, or `where needed`: where the profile likelihood shows that the curvature at the
        mode does not describe it. `progress` gets the stage and its share.
        """
        if not 0 < ess <= MOST_ESS:
            raise BadInput(
                "the effective sample size cannot be used",
                found=f"{ess:g}",
                allowed=f"a number above 0, up to {MOST_ESS:g}",
                argument="ess",
            )
        with one_blas_thread(), located(run.path, run.header_line):
            report = progress or (lambda stage, share: None)
            solution, result, draws = _analyse(run, seed, ess, robust, held_out, sampling, report)
        return cls(
            fit=solution.fit,
            identified=solution.identified,
            effective=solution.effective,
            ladder=solution.ladder,
            factors=solution.factors,
            run=run,
            result=result,
            draws=draws,
            options=Options(
                seed, ess, robust, held_out.sha256 if isinstance(held_out, Run) else tuple(held_out), sampling
            ),
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Analysis):
            return NotImplemented
        return self is other or self._made_from() == other._made_from()

    def __hash__(self) -> int:
        return hash((self.run, self.options))

    def _made_from(self) -> tuple[object, ...]:
        return self.run, self.options, self.result.inputs.versions


analyse = Analysis.of


def _analyse(
    run: Run,
    seed: int,
    ess: float,
    loss: Loss | None,
    held_out: Sequence[str] | Run,
    sampling: Sampling,
    report: Progress,
) -> tuple[Solution, Result, Draws | None]:
    run.require_analysable()
    problem = Problem.from_run(run)
    require_noise_data(problem)
    report("fit", 0.0)
    # A name that is none of a target, and a run of another header, are refused before the long part.
    held_out_fit: HoldOut | PredictedRun | None = None
    if isinstance(held_out, Run):
        require_predictable(run, held_out)
    elif held_out:
        held_out_fit = hold_out(problem, held_out, seed)
    solution = solve_run(problem, run.header, seed=seed, progress=lambda share: report("fit", 0.7 * share))
    assert solution.effective is not None
    report("fit", 0.7)
    midpoint = fit_midpoint(problem.with_geometry(NOMINAL))
    report("fit", 1.0)
    report("identifiability", 0.0)
    problem = solution.problem
    report("identifiability", 1.0)
    posterior, draws, between = UNSAMPLED, None, None
    useless = not_worth_sampling(solution) if solution.converged else None
    if useless is not None:
        posterior = useless
    elif solution.converged:
        if sampling != "always":
            posterior, between = _omitted(solution)
        if posterior.omitted is None or (sampling == "where needed" and not posterior.omitted.enough):
            report("posterior", 0.0)
            posterior, draws = sample_posterior(
                solution,
                seed=seed,
                ess=ess,
                short_by=lambda ends: more_draws(solution, ends),
                progress=lambda share: report("posterior", share),
            )
            report("posterior", 1.0)
    report("diagnostics", 0.0)
    shots = shot_results(solution.fit)
    robust = robust_result(solution, loss) if loss is not None and solution.converged else None
    report("diagnostics", 0.3)
    placed = placement_result(solution, solution.effective)
    report("diagnostics", 0.6)
    if isinstance(held_out, Run):
        held_out_fit = predict_run(solution, held_out)
    to_enter, with_links, conformity = entered(solution, run.header.required)
    geometry = solution.geometry(run.header)
    result = Result(
        verdict=solution.verdict,
        parameters=_with_midpoint(solution, midpoint),
        identifiability=solution.facts,
        fits=FitSummaries(_likelihood(solution), midpoint),
        geometry=geometry,
        posterior=posterior,
        shots=shots,
        distances=_distances(solution),
        angles=_angles(solution),
        intervals=intervals(solution, posterior) if between is None or draws is not None else between,
        accuracy=accuracy(solution, values=None if to_enter is None else to_enter.values),
        budget=budget(solution, posterior, None if draws is None else draws.ends),
        robust=robust,
        hold_out=held_out_fit,
        placements=placed,
        scene=scene(solution),
        null_motion=motion_of_run(solution),
        misfit=solution.misfit,
        findings=findings(solution, posterior, shots, robust, held_out_fit, run.warnings),
        inputs=_inputs(run, problem, seed),
        diagnosis=_with_sources(diagnose(solution), run),
        entered=to_enter,
        entered_geometry=with_links,
        conformity=conformity,
        region=region_of(problem.workspace, judged_axis(problem, solution.status)),
        power=solution.power,
        coverage_factor=solution.coverage_factor,
        without_prior=offsets_without_prior(solution),
        outlook=_outlook(solution, run, to_enter, with_links),
        taken_as_known=bases(solution.problem, solution.fit.covariance, solution.status, run.header),
    )
    report("diagnostics", 1.0)
    return solution, result, draws


def _outlook(
    solution: Solution, run: Run, to_enter: Entered | None, with_links: Entered | None
) -> Outlook | None:
    """What would make the answer better; None where it has no answer, or a wrong model."""
    if not solution.converged or solution.misfit is not None:
        return None
    problem, x, entries = solution.problem, solution.fit.x, run.header.targets
    constraints = usual_constraints(problem, x)
    return Prospect(
        header=run.header,
        problem=problem,
        x=x,
        status=solution.status,
        rests_on=solution.identified.rests_on,
        covariance=solution.fit.covariance,
        estimated=True,
        prospects=Prospects(constraints, lambda shots: kept(constraints, shots, x, entries)),
        weight=1 / solution.noise_scale**2,
        dof=solution.dof if problem.noise.estimated and solution.dof else None,
        minutes_each=_minutes_each(run),
        tcp=_median_and_95(to_enter),
        tcp_with_links=_median_and_95(with_links),
    ).outlook()


def _median_and_95(entered: Entered | None) -> MedianAnd95 | None:
    tcp = None if entered is None else entered.tcp_after
    return None if tcp is None else (tcp.median_mm, tcp.p95_mm)


def _minutes_each(run: Run) -> float | None:
    """What a measurement took, the median; None where the run does not say when they were made."""
    times = [shot.time_s for shot in run.shots if shot.time_s is not None]
    between = np.diff(sorted(set(times)))
    return float(np.median(between)) / 60 if len(times) == len(run.shots) and len(between) else None


def _omitted(solution: Solution) -> tuple[PosteriorSummary, tuple[Intervals, ...]]:
    """A posterior without draws, with what says whether it needs them, and the intervals without them."""
    rows = intervals(solution, UNSAMPLED)
    poor = tuple(row.name for row in rows if row.differ)
    tested = not solution.problem.noise.separate
    return replace(UNSAMPLED, omitted=Omitted(poor, tested)), rows


def _with_midpoint(solution: Solution, fit: MidpointFit) -> ParameterTable:
    """The rows of the solution, with the paper's estimates beside them."""
    if not (fit.available and fit.converged):
        return solution.parameters
    items, estimates = solution.problem.parameters.items, dict(zip(fit.names, fit.x, strict=True))
    return ParameterTable(
        replace(row, midpoint=item.shown(float(estimates[row.name])))
        if has_numbers(row.status) and row.group != "noise" and row.name in estimates
        else row
        for row, item in zip(solution.parameters, items, strict=True)
    )


def _likelihood(solution: Solution) -> LikelihoodSummary:
    problem, fit = solution.problem, solution.fit
    before, _ = problem.linearise(start_at(problem, np.zeros((1, len(fit.z))))[0])
    chi2, dof, p_value = solution.against_noise
    return LikelihoodSummary(
        converged=fit.converged,
        reason=fit.reason,
        iterations=fit.iterations,
        cost=chi2 / 2,
        rms_mm=problem.rms_mm(fit.whitened.residual_mm),
        rms_before_mm=problem.rms_mm(before),
        rms_deg=problem.rms_deg(fit.whitened.residual_mm),
        rms_before_deg=problem.rms_deg(before),
        chi2=chi2,
        dof=dof,
        p_value=p_value,
        p_small=as_small(fit) if fit.converged else None,
        noise_scale=solution.noise_scale if problem.noise.estimated else None,
        noise_known=problem.noise.known,
        other_basins=fit.other_basins,
    )


def _distances(solution: Solution) -> tuple[DistanceResult, ...]:
    """Each stated distance next to what the fit makes of it, with the std of that."""
    problem = solution.problem
    return tuple(
        DistanceResult(_ends(problem, tie), tie.mm, tie.sigma, *_fitted(solution, tie, tie.mm))
        for tie in problem.distances
    )


def _angles(solution: Solution) -> tuple[AngleResult, ...]:
    """The same of each stated angle, degrees."""
    problem, rows = solution.problem, []
    for tie in problem.angles:
        estimate, std = (
            None if number is None else float(np.degrees(number))
            for number in _fitted(solution, tie, tie.rad)
        )
        deg, sigma_deg = float(np.degrees(tie.rad)), float(np.degrees(tie.sigma))
        rows.append(AngleResult(_ends(problem, tie), deg, sigma_deg, estimate, std))
    return tuple(rows)


def _ends(problem: Problem, tie: Tie) -> tuple[str, str]:
    return problem.targets[tie.first], problem.targets[tie.second]


def _fitted(solution: Solution, tie: Tie, value: float) -> tuple[float | None, float | None]:
    """What the fit makes of a tie, and its std; None where the data do not determine it."""
    problem, fit = solution.problem, solution.fit
    parameters, targets = problem.parameters, problem.split(fit.x[None]).targets
    residual, by_first, by_second = tie.missed(targets[:, tie.first], targets[:, tie.second])
    along = np.zeros(len(parameters))
    along[parameters.block("target", tie.first)] = by_first[0] * tie.sigma
    along[parameters.block("target", tie.second)] = by_second[0] * tie.sigma
    ends = {parameters.names[i] for i in np.flatnonzero(along)}
    if not solution.converged or ends & set(undecided_names(solution.identified.facts.null_space)):
        return None, None
    by_free = (along * parameters.prior_std)[parameters.free]
    return value + float(residual[0]) * tie.sigma, float(np.sqrt(by_free @ fit.covariance @ by_free))


def _with_sources(explanations: tuple[Explanation, ...], run: Run) -> tuple[Explanation, ...]:
    """The explanations, with where the measurements are that they name."""
    return tuple(
        replace(one, sources=tuple((n, run.sources[n]) for n in one.measurements if n in run.sources))
        for one in explanations
    )


def _inputs(run: Run, problem: Problem, seed: int) -> Inputs:
    content = run.header.model_dump(
        mode="json", by_alias=True, exclude_none=True, exclude_unset=True, exclude={"provenance"}
    )
    return Inputs(
        run=run.path.name,
        sha256=run.sha256,
        robot=run.robot.name,
        shots=problem.shots,
        targets=problem.targets,
        seed=seed,
        versions=versions(),
        header=run.header.model_dump(mode="json", by_alias=True, exclude_none=True),
        vendor=run.robot.vendor,
        stated=content,
    )
