"""Studies over a grid of settings: each case makes a plan, predicts its uncertainties and simulates runs.

The prediction is that of `zerobeam check`. Every run has an arm of its own, a random draw from the priors. It
is fitted by the likelihood and, if the study has it, by the paper's midpoint cost; the errors are compared
with the prediction.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import stats

from ....analysis.estimation.fit import CONTRADICTED, MANY_STARTS, Fits, fit_likelihood, fit_p_value
from ....analysis.observability.aim import aim, servo_joints
from ....analysis.observability.clearance import Clearance
from ....analysis.observability.identifiability import identify
from ....analysis.observability.predictions import predicted_std
from ....analysis.status import has_numbers, verdict_of
from ....model.arrays import Index, Matrix
from ....model.errors import BadInput
from ....model.files.header import Header
from ....model.likelihood.problem import Problem
from ...plans.candidates import candidates, reason_of
from ...plans.constraints import Conditions, View
from ...plans.optimal import Planner
from ...plans.patterns import Line, pattern
from ..cases import Engine
from ..data_sets import DataSets, drawn, fitted, likelihood, midpoint
from .grid_answer import (
    LEAST_RUNS,
    LEVEL,
    CaseParameter,
    GridAxis,
    GridCase,
    GridSettings,
    GridStudy,
    LikelihoodErrors,
    RunErrors,
    findings,
    headline,
    notes,
)
from .study_file import TARGET, Case, SettingsStudy

FALSE_ALARM = 0.01  # probability over the whole study


def sweep(study: SettingsStudy, engine: Engine) -> GridStudy:
    """Carry out the whole study.

    The study agrees if no case's simulated runs contradict the prediction.
    """
    every, content = (*study.cases, *study.beside), study.content
    prints = "\n".join(case.fingerprint for case in every)
    settings_hash, work = hashlib.sha256(prints.encode()).hexdigest(), partial(studied_case, seed=engine.seed)
    answers = judged(engine.each(content.study, GridCase, work, every, called="case", settings=settings_hash))
    cases, beside = answers[: len(study.cases)], answers[len(study.cases) :]
    axes = tuple(
        GridAxis(
            one.key, one.name, one.unit, one.shown_values, tuple(map(one.changes, range(len(one.values))))
        )
        for one in content.axes
    )
    settings = GridSettings(
        **dict(content.base),
        seed=engine.seed,
        level=LEVEL,
        chance=FALSE_ALARM,
        file=study.file,
        sha256=study.sha256,
    )
    return GridStudy(
        study=content.study,
        title=content.title,
        headline=headline(axes, cases, beside),
        agrees=all(case.agrees is not False for case in answers if case.verdict != "degenerate"),
        settings=settings,
        notes=(*findings(axes, cases), *notes(settings, answers)),
        axes=axes,
        cases=cases,
        beside=beside,
    )


def studied_case(case: Case, seed: int) -> GridCase:
    """One case: its plan, the prediction, and the errors of the runs.

    It depends on the case's own settings and the seed alone, not on the other cases.
    """
    try:
        problem = _planned(case, seed)
    except BadInput as error:
        reason = error.what if error.found is None else f"{error.what}: {error.found}"
        return GridCase(case.at, case.words, reason=reason)
    x, parameters = problem.nominal(), problem.parameters
    status, std = identify(problem, x).status, parameters.unscaled(predicted_std(problem, x))
    rows = list[CaseParameter]()
    free = parameters.free & ~parameters.tolerated & (parameters.group("offset") | parameters.group("tool"))
    known = np.array([i for i in np.flatnonzero(free) if has_numbers(status[i])], dtype=np.intp)
    runs = _simulated(case, seed, problem, known)
    for i in np.flatnonzero(free):
        item = parameters.items[i]
        row = CaseParameter(item.name, item.unit, status[i], item.group)
        if i in known:
            j, display = int(np.searchsorted(known, i)), item.display
            row = replace(row, std=float(std[i]) * display)
            if runs is not None:
                off, u = runs.likelihood[:, j] * display, runs.std[:, j] * display
                other = None if runs.midpoint is None else RunErrors.of(runs.midpoint[:, j] * display)
                row = replace(row, likelihood=LikelihoodErrors.by_fits(off, u), midpoint=other)
        rows.append(row)
    offsets = [row for row in rows if row.group == "offset"]
    degrees = [row.std for row in offsets if row.unit == "deg" and row.std is not None]
    return GridCase(
        case.at,
        case.words,
        shots=problem.shots,
        verdict=verdict_of(status[parameters.block("offset")]),
        worst_std=max(degrees) if degrees and all(row.has_numbers for row in offsets) else None,
        failed=0 if runs is None else runs.failed,
        unmet=0 if runs is None else runs.unmet,
        parameters=tuple(rows),
    )


def _planned(case: Case, seed: int) -> Problem:
    """The postures of the case's plan, aimed at the target; BadInput says why there is no plan."""
    settings, header, robot = case.settings, case.header, case.robot
    target, made = np.array(settings.target.xyz_mm), case.settings.plan
    view = View(
        facing=made.facing,
        acceptance=float(np.radians(made.acceptance_deg)),
        beam=made.beam_mm,
        margin=float(np.radians(made.margin_deg)),
    )
    if made.kind == "optimal":
        postures = candidates(header, robot, target, made.candidates, view=view, seed=seed)
        planner = Planner(header, robot, {TARGET: target}, [postures])
        chosen = planner.optimal(made.shots, made.criterion, seed=seed).postures
    else:
        chosen = _patterned(case)
    problem = Problem.build(header, robot, chosen, [TARGET] * len(chosen))
    x = problem.nominal()
    aimed = aim(problem, x, servo_joints(problem)).problem
    if made.kind != "optimal":
        _require_view(aimed, x, view, header)
    return aimed


def _require_view(problem: Problem, x: Matrix, view: View, header: Header) -> None:
    """BadInput for a pattern that breaks a condition that an optimal plan keeps."""
    conditions = Conditions(problem, x, view, Clearance(problem, None), header.targets)
    for broken, breaks in conditions.in_order():
        count = int(breaks(np.arange(problem.shots)).sum())
        if count:
            raise BadInput(
                f"postures of the pattern {reason_of(broken)}", found=f"{count} of {problem.shots}"
            )


_patterns: dict[str, Matrix] = {}  # of this process, by what they depend on
_MOST_PATTERNS = 1000


def _patterned(case: Case) -> Matrix:
    """The postures of the case's pattern, searched once for all cases that differ in noise alone, say."""
    key, made = case.pattern_print, case.settings.plan
    if made.kind == "optimal":
        raise ValueError("an optimal plan is no pattern")
    if key not in _patterns:
        if len(_patterns) >= _MOST_PATTERNS:
            _patterns.clear()
        target, roll = np.array(case.settings.target.xyz_mm), made.roll_deg
        turned = None if roll is None else float(np.radians(roll))
        line = Line(made.distance_mm, made.height_mm, made.width_mm, turned)
        _patterns[key] = pattern(
            case.header, case.robot, target, made.kind, made.shots, name=TARGET, span=made.span, line=line
        )
    return _patterns[key]


@dataclass(frozen=True, eq=False)
class _RunFits:
    """Errors (estimate minus truth) of fits to simulated runs (R, m) and the standard uncertainties (R, m)
    that the likelihood states, internal units; without those that have no fit."""

    likelihood: Matrix
    std: Matrix
    midpoint: Matrix | None
    failed: int
    unmet: int


def _simulated(case: Case, seed: int, problem: Problem, known: Index) -> _RunFits | None:
    """The case's runs, for the parameters `known` (m,); None where there are no runs."""
    settings = case.settings
    if settings.runs < LEAST_RUNS or not len(known):
        return None
    # Of its own settings, so that a case is the same in every study.
    rng = np.random.default_rng([seed, int(case.fingerprint[:32], 16)])
    data = drawn(problem, settings.runs, rng)
    if not len(data.truths):
        return None
    fits, true = [likelihood(data, refitted(data, fitted(data)), known)], data.truths[:, known]
    # The midpoints of two beams have no cost, whatever the offsets.
    if "midpoint" in settings.costs and problem.shots > 2:
        fits.append(midpoint(data, known))
    fit, errors = fits[0], [np.asarray((one.value - true)[one.kept]) for one in fits]
    failed = int((~fit.kept).sum())
    other = errors[1] if len(errors) > 1 else None
    return _RunFits(errors[0], fit.std[fit.kept], other, failed, data.failed)


def refitted(data: DataSets, fits: Fits) -> Fits:
    """Fits that contradict noise and priors repeated from many starts; one that does so even then has failed.

    The few starts of many fits side by side can all converge to a local optimum that is not the best. At the
    mode the squares of the normalised residuals and of the scaled parameters sum to chi-squared with as many
    degrees of freedom as there are data: the test needs no truth.
    """
    x, z, covariance = fits.x.copy(), fits.z.copy(), fits.covariance.copy()
    converged = fits.converged.copy()
    for row, (joints, spots) in enumerate(zip(data.joints, data.spots, strict=True)):
        problem = data.problem.moved(joints, spots)
        if fit_p_value(problem, problem.whiten(x[row]).residual, z[row]) < CONTRADICTED:
            fit = fit_likelihood(problem, starts=MANY_STARTS)
            x[row], z[row], covariance[row] = fit.x, fit.z, fit.covariance
            converged[row] = (
                fit.converged and fit_p_value(problem, fit.whitened.residual, fit.z) >= CONTRADICTED
            )
    return replace(fits, x=x, z=z, covariance=covariance, converged=converged)


def judged(cases: Sequence[GridCase]) -> tuple[GridCase, ...]:
    """The same cases, `agrees` entered for every parameter that has runs.

    A parameter agrees if its share of intervals that hold the truth and its scatter are consistent with the
    prediction (exact binomial test; two-sided chi-squared; Bonferroni over the study). Where all offsets are
    identified a parameter must scatter as predicted before the measurements. Elsewhere the model is not
    linear over the weakly observable directions, and it must scatter as each fit states of itself.
    """
    rows = [one for case in cases for one in case.parameters if one.likelihood and one.std is not None]
    alarm = FALSE_ALARM / max(2 * len(rows), 1)  # two tests of each

    def with_judgement(case: GridCase, one: CaseParameter) -> CaseParameter:
        of = one.likelihood
        if of is None or one.std is None:
            return one
        share = float(stats.binomtest(round(of.held * of.runs), of.runs, LEVEL).pvalue)
        predicted, by_fits = _scatter_p(of, of.rmse / one.std), _scatter_p(of, of.rms_in_stds)
        scatter = predicted if case.verdict == "pass" else by_fits
        verdicts = {"agrees": min(share, scatter) >= alarm, "as_stated": min(share, by_fits) >= alarm}
        return replace(one, likelihood=replace(of, **verdicts))

    return tuple(
        replace(case, parameters=tuple(with_judgement(case, row) for row in case.parameters))
        for case in cases
    )


def _scatter_p(of: LikelihoodErrors, ratio: float) -> float:
    """The p-value of an rms of errors that is `ratio` of what it should be."""
    squares = of.runs * ratio**2
    return 2 * float(min(stats.chi2.cdf(squares, of.runs), stats.chi2.sf(squares, of.runs)))
