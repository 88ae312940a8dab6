"""Studies over a grid of settings: in every case a plan is made and judged, and runs of it are simulated.

What is predicted of a plan is what `zerobeam check` says of it. The runs have an arm each, drawn from the
priors, and are fitted by the likelihood and, if asked for, by the paper's midpoint cost; their errors are
held against the prediction.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from ...analysis.estimation.fit import CONTRADICTED, MANY_STARTS, Fits, chance, fit_likelihood
from ...analysis.observability.aim import aim, servo_joints
from ...analysis.observability.identifiability import identify
from ...analysis.observability.outlook import predicted_std
from ...analysis.observability.verdict import verdict
from ...analysis.versions import versions
from ...model.errors import BadInput
from ...model.kernel import Index
from ...model.problem import Problem
from ...model.robot import Matrix
from ..plans.candidates import View, candidates
from ..plans.patterns import pattern
from ..plans.planning import Planner
from ..processes import side_by_side
from .binomial import held_share
from .case_store import CaseStore
from .coverage import DataSets, Estimates, drawn, fitted, likelihood, midpoint
from .sweep_file import TARGET, Case, NamedChange, StatedStudy, told_value
from .sweep_words import findings, headline

LEVEL = 0.95
CHANCE = 0.01  # of a false alarm over the whole study
_LEAST_RUNS = 2  # that say anything of a scatter

Json = dict[str, Any]
Progress = Callable[[str, float], None]  # the stage, and the share of the whole that is done


def sweep(
    study: StatedStudy,
    seed: int,
    told: Progress,
    *,
    store: Path | None = None,
    processes: int | None = None,
) -> Json:
    """The whole study, as plain JSON types (docs/files.md, `zerobeam/study/1`).

    With a `store` each finished case is kept in that file at once, and cases that it has are not computed
    again: the answer is the same. It agrees if no case's simulated runs contradict what was predicted.
    """
    began = time.perf_counter()
    if store is None:
        answers = _answered(study, seed, told, {}, None, processes)
    else:
        with CaseStore(store, heading(study, seed)) as kept:
            answers = _answered(study, seed, told, kept.done, kept, processes)
    judged = _judged(answers)
    content = study.content
    axes = [
        {
            "key": axis.key,
            "label": axis.label or axis.key,
            "unit": axis.unit,
            "values": [told_value(value) for value in axis.values],
            "set": [
                dict(value.set_) if isinstance(value, NamedChange) else axis.changes(j)
                for j, value in enumerate(axis.values)
            ],
        }
        for axis in content.axes
    ]
    settings = content.base.model_dump(mode="json", by_alias=True)
    return {
        "schema": "zerobeam/study/1",
        "study": content.study,
        "title": content.title,
        "headline": headline(axes, answers),
        "agrees": judged,
        "settings": {
            **settings,
            "seed": seed,
            "level": LEVEL,
            "chance": CHANCE,
            "file": study.file,
            "sha256": study.sha256,
        },
        "seconds": time.perf_counter() - began,
        "versions": versions(),
        "notes": [*findings(axes, answers), *_notes(study)],
        "axes": axes,
        "cases": answers,
    }


def heading(study: StatedStudy, seed: int) -> Json:
    """What finished cases must have in common to belong together."""
    prints = "\n".join(case.fingerprint for case in study.cases)
    return {
        "study": study.content.study,
        "seed": seed,
        "settings": hashlib.sha256(prints.encode()).hexdigest(),
        "versions": versions(),
    }


def _answered(
    study: StatedStudy,
    seed: int,
    told: Progress,
    done: dict[int, Json],
    kept: CaseStore | None,
    processes: int | None,
) -> list[Json]:
    """The answers of all cases in their order, without a judgement."""
    total, found = len(study.cases), dict(done)
    left = [number for number in range(total) if number not in found]
    told("cases", len(found) / total)
    for job, answer in side_by_side(_case_of, [(study.cases[number], seed) for number in left], processes):
        found[left[job]] = answer
        if kept is not None:
            kept.add(left[job], answer)
        told("cases", len(found) / total)
    return [found[number] for number in range(total)]


def _case_of(job: tuple[Case, int]) -> Json:
    return studied_case(*job)


def studied_case(case: Case, seed: int) -> Json:
    """One case: its plan, what is predicted of it, and what came of the runs.

    It depends on the case's own settings and the seed alone, not on the other cases.
    """
    told: Json = {"at": list(case.at), "words": case.words, "reason": None, "shots": None, "verdict": None}
    told |= {"worst_std": None, "failed": 0, "unmet": 0, "parameters": []}
    try:
        problem = _planned(case, seed)
    except BadInput as error:
        return {**told, "reason": _reason(error)}
    x = problem.supposed()
    identified = identify(problem, x)
    parameters = problem.parameters
    std = parameters.unscaled(predicted_std(problem, x))
    which = np.flatnonzero(parameters.free & (parameters.group("offset") | parameters.group("tool")))
    known = [i for i in which if identified.status[i] in ("identified", "weak")]
    offsets = [i for i in which if parameters.items[i].group == "offset"]
    data, estimates = _estimated(case, seed, problem, np.array(known, dtype=np.intp))
    if data is not None:
        told |= {"failed": int((~estimates["likelihood"].kept).sum()), "unmet": data.failed}
    rows = []
    for i in which:
        item = parameters.items[i]
        row: Json = {"name": item.name, "unit": item.unit, "status": identified.status[i]}
        row |= {"std": None, "likelihood": None, "midpoint": None}
        if i in known:
            row["std"] = float(std[i]) * item.display
            for cost, of in estimates.items():
                assert data is not None
                j = known.index(i)
                off = (of.value[:, j] - data.truths[:, i])[of.kept] * item.display
                row[cost] = _scatter(off)
                if cost == "likelihood" and row[cost] is not None:
                    row[cost] |= _held(off, of.std[of.kept, j] * item.display)
        rows.append(row)
    complete = all(i in known for i in offsets)
    degrees = [
        row["std"] for row, i in zip(rows, which, strict=True) if i in offsets and row["unit"] == "deg"
    ]
    return {
        **told,
        "shots": problem.shots,
        "verdict": verdict(problem, identified),
        "worst_std": max(degrees) if degrees and complete else None,
        "parameters": rows,
    }


def _planned(case: Case, seed: int) -> Problem:
    """The shots of the case's plan, turned onto the target; BadInput says why there is no plan."""
    settings, header, robot = case.settings, case.header, case.robot
    target, made = np.array(settings.target.xyz_mm), case.settings.plan
    if made.kind == "optimal":
        view = View(
            facing=made.facing,
            acceptance=float(np.radians(made.acceptance_deg)),
            beam=made.beam_mm,
            margin=float(np.radians(made.margin_deg)),
        )
        found = candidates(header, robot, target, made.candidates, view=view, seed=seed, name=TARGET)
        planner = Planner(header, robot, target, found, name=TARGET)
        postures = planner.optimal(made.shots, made.criterion, seed=seed).postures
    else:
        postures = pattern(header, robot, target, made.kind, made.shots, name=TARGET, span=made.span)
    problem = Problem.build(header, robot, postures, [TARGET] * len(postures))
    return aim(problem, problem.supposed(), servo_joints(problem)).problem


def _reason(error: BadInput) -> str:
    return error.what if error.found is None else f"{error.what}: {error.found}"


def _estimated(
    case: Case, seed: int, problem: Problem, known: Index
) -> tuple[DataSets | None, dict[str, Estimates]]:
    """The case's runs and what the fits say of the parameters `known` (m,); None where there are no runs."""
    settings = case.settings
    if settings.runs < _LEAST_RUNS or not len(known):
        return None, {}
    # Of its own settings, so that a case is the same in whatever study it stands.
    rng = np.random.default_rng([seed, int(case.fingerprint[:32], 16)])
    data = drawn(problem, settings.runs, rng)
    if not len(data.truths):
        return None, {}
    found = {"likelihood": likelihood(data, refitted(data, fitted(data)), known)}
    if "midpoint" in settings.costs and problem.shots > 2:  # two beams cost nothing, wherever they are
        found["midpoint"] = midpoint(data, known)
    return data, found


def refitted(data: DataSets, fits: Fits) -> Fits:
    """The same with those fits anew, from many starts, that contradict noise and priors; one that does so
    even then has failed.

    The few starts of many fits side by side can all end in a basin that is not the best. At the mode the
    whitened misses and the scaled parameters have, squared and summed, the chi-squared of as many degrees of
    freedom as there are data: no truth is needed to see it.
    """
    x, z, covariance = fits.x.copy(), fits.z.copy(), fits.covariance.copy()
    converged = fits.converged.copy()
    for row, (joints, spots) in enumerate(zip(data.joints, data.spots, strict=True)):
        problem = data.problem.moved(joints, spots)
        if chance(problem.whiten(x[row]).residual, z[row]) < CONTRADICTED:
            fit = fit_likelihood(problem, starts=MANY_STARTS)
            x[row], z[row], covariance[row] = fit.x, fit.z, fit.covariance
            converged[row] = fit.converged and chance(fit.whitened.residual, fit.z) >= CONTRADICTED
    return replace(fits, x=x, z=z, covariance=covariance, converged=converged)


def _scatter(error: Matrix) -> Json | None:
    """Of errors (R,): estimate minus truth."""
    if len(error) < _LEAST_RUNS:
        return None
    return {
        "runs": len(error),
        "rmse": float(np.sqrt((error**2).mean())),
        "bias": float(error.mean()),
        "bias_std": float(error.std(ddof=1) / np.sqrt(len(error))),
    }


def _held(error: Matrix, std: Matrix) -> Json:
    held = int((np.abs(error) <= stats.norm.ppf((1 + LEVEL) / 2) * std).sum())
    share = held_share(held, len(error), LEVEL, CHANCE)
    return {
        "held": share["share"],
        "held_low": share["low"],
        "held_high": share["high"],
        "rms_in_stds": float(np.sqrt(((error / std) ** 2).mean())),
    }


def _judged(answers: Sequence[Json]) -> bool:
    """Whether all cases that are not degenerate agree; enters `agrees` at every row that has runs.

    A row agrees if its share of intervals that hold the truth and its scatter are what chance allows (exact
    binomial test; chi-squared, both sides; Bonferroni over the study). Where all offsets are identified a
    parameter must scatter as predicted before any shot; elsewhere, since over what is open the misses are
    not linear, as each fit says of itself. Where an offset cannot be told at all even that is no promise.
    """
    chances = [
        (answer["verdict"], row["likelihood"], _chances(answer["verdict"], row))
        for answer in answers
        for row in answer["parameters"]
        if row["likelihood"] is not None
    ]
    alarm = CHANCE / max(sum(len(own) for _, _, own in chances), 1)
    for _, told, own in chances:
        told["agrees"] = min(own) >= alarm
    return all(told["agrees"] for verdict, told, _ in chances if verdict != "degenerate")


def _chances(verdict: str, row: Json) -> list[float]:
    """The chance of what the runs came to, if the prediction holds: a p-value for each test of the row."""
    told = row["likelihood"]
    runs = told["runs"]
    squares = runs * (told["rmse"] / row["std"] if verdict == "pass" else told["rms_in_stds"]) ** 2
    return [
        float(stats.binomtest(round(told["held"] * runs), runs, LEVEL).pvalue),
        2 * float(min(stats.chi2.cdf(squares, runs), stats.chi2.sf(squares, runs))),
    ]


def _notes(study: StatedStudy) -> list[str]:
    settings = study.content.base
    notes = [
        "The std of a parameter is what the fit of one run would state, priors included; a case's worst std"
        " is the largest over its offsets. Where an offset cannot be told there is none.",
    ]
    if any(case.settings.runs >= _LEAST_RUNS for case in study.cases):
        notes += [
            "Every simulated run has an arm of its own, drawn from the priors: offsets of"
            f" {settings.prior.offset_deg:g}° (one standard deviation), the target"
            f" {settings.target.sigma_mm:g} mm about its guess, if no axis says otherwise. A case's draws"
            " follow from its settings and the seed.",
            f"A case agrees if its shares of {LEVEL:.0%} intervals that hold the truth and its scatter are"
            f" within what a chance of {CHANCE:.0%} over the whole study allows (exact binomial test,"
            " chi-squared, Bonferroni). Where all offsets are identified a parameter must scatter as"
            " predicted; where one is weak the misses are not linear over what is open, and it must scatter"
            " as the fits of the runs say of themselves. Degenerate cases are judged likewise, but the study"
            " agrees without them: intervals from the curvature are no promise there.",
            "Runs whose fit did not converge, or contradicts noise and priors (chance below"
            f" {CONTRADICTED:g}) even from {MANY_STARTS} starts, are counted; the figures are without them.",
        ]
    if any("midpoint" in case.settings.costs for case in study.cases):
        notes.append(
            "The midpoint fit uses no spot reading and no prior, and starts from zero offsets as in the"
            " paper: where it ends in another minimum its error is large, and the rmse holds those runs too."
        )
    return notes
