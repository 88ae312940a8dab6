"""Do the intervals hold if the arm deviates from nominal geometry? Random arms, solved in several ways.

Every simulated arm has offsets and links of its own, and measures a plan once, with noise. Its measurements
are solved with the geometry estimated, and with nominal geometry: with the uncertainty of the consider
analysis, and with that of the noise alone, which is the control that must fail. The fits and statuses are
those of `analyse` (`fit_each`, `judge`).
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ....analysis.observability.check import Check, check
from ....analysis.observability.identifiability import identify
from ....analysis.status import Status, known, versions
from ....model.arrays import NORMAL_95, Progress
from ....model.likelihood.geometry import NOMINAL
from ....model.likelihood.parameters import Parameter
from ....model.likelihood.problem import Problem
from ....words.wording import label, listed
from ..answer import NoiseLevel
from ..binomial import Accuracy, accuracy, held_share
from ..case_store import each_piece
from .answer import (
    CheckedOffset,
    EstimatorName,
    GeometryEstimator,
    GeometryParameter,
    GeometryPlan,
    GeometrySettings,
    GeometryStudy,
)
from .arms import Stated, arms, freed, nominal, understated
from .plans import CANDIDATES, StudiedPlan, studied_plans, with_tolerance

_LEVEL = 0.95
_CHANCE = 0.01  # of a false alarm over the offsets of an estimator
_OFFSET_DEG = 1.0  # of the simulated arms
_UNDERSTATED = 3.0


_WORDS: dict[EstimatorName, str] = {
    "freed": "geometry estimated, its tolerances as priors",
    "considered": "nominal geometry, its uncertainty by the consider analysis",
    "nominal": "control: nominal geometry, its uncertainty by the noise alone",
    "tolerances understated by 3": "control: geometry estimated, its tolerances stated as a third",
}
_CONTROLS: tuple[EstimatorName, ...] = ("nominal", "tolerances understated by 3")


def geometry_study(
    count: int,
    seed: int,
    progress: Progress,
    *,
    candidates: int = CANDIDATES,
    store: Path | None = None,
    processes: int | None = None,
) -> GeometryStudy:
    """Carry out the whole study with `count` arms for each plan.

    It agrees if the intervals with estimated geometry and those of the consider analysis hold the truth as
    often as stated on every plan, and every control is detected. With a `store` the answer of each plan is
    kept in that file at once, and a study that was stopped goes on from there.
    """
    began = time.perf_counter()
    heading = {
        "study": "geometry",
        "seed": seed,
        "arms": count,
        "candidates": candidates,
        "versions": versions(),
    }
    pieces = [(k, count, seed, candidates) for k in range(len(studied_plans(seed, candidates)))]
    answers = each_piece(store, heading, GeometryPlan, _piece, pieces, progress, processes)
    estimators = [own for answer in answers for own in answer.estimators]
    return GeometryStudy(
        study="geometry",
        title="Do the intervals hold if the arm deviates from nominal geometry?",
        headline=_headline(count, answers),
        agrees=all(own.agrees is not own.control for own in estimators),
        settings=GeometrySettings(
            arms=count,
            seed=seed,
            level=_LEVEL,
            chance=_CHANCE,
            candidates=candidates,
            offset_deg=_OFFSET_DEG,
        ),
        seconds=time.perf_counter() - began,
        versions=versions(),
        plans=tuple(answers),
        notes=(
            f"Every arm has offsets of {_OFFSET_DEG:g}° (one standard deviation), links off by the stated"
            " tolerances, and noise of its own. Gravity and harmonics are neither simulated nor estimated.",
            "An interval is estimate ± 1.96 u, from the curvature at the mode. It counts where the arm's own"
            " answer determines the offset; where that says misfit, its numbers count as well: the control"
            " shows what they are worth.",
            f"An estimator agrees if the p-value of none of its shares is below {_CHANCE:.0%} over its"
            " offsets together (exact binomial test, Bonferroni). The intervals shown are 95 % (Clopper and"
            " Pearson).",
            "z is the root mean square of the errors in standard uncertainties: 1 if u is right.",
            "Tolerances are standard deviations of normal distributions, independent for each link"
            " parameter. Where an arm's deviations are of another kind, nothing here applies.",
        ),
    )


def _piece(asked: tuple[int, int, int, int]) -> GeometryPlan:
    k, count, seed, candidates = asked
    return answer_of(studied_plans(seed, candidates)[k](), count, seed)


def answer_of(plan: StudiedPlan, count: int, seed: int) -> GeometryPlan:
    """One plan of the study."""
    problem = Problem.from_plan(plan.plan)
    checks = _checks(plan)
    data = arms(problem, count, _OFFSET_DEG, np.random.default_rng([seed, *plan.name.encode()]))
    stated: dict[EstimatorName, Stated] = {"freed": freed(data)}
    own, weighed = nominal(data)
    stated |= {"considered": weighed, "nominal": own}
    stated["tolerances understated by 3"] = understated(data, _UNDERSTATED)
    return GeometryPlan(
        name=plan.name,
        words=plan.words,
        chosen_for=plan.chosen_for,
        robot=problem.robot.name,
        shots=problem.shots,
        noise=NoiseLevel(float(np.degrees(problem.noise.joint[0])), float(problem.noise.spot)),
        tolerance=plan.tolerance,
        arms=len(data.truths),
        failed=data.failed,
        efficiency=None if plan.proposal is None else plan.proposal.efficiency,
        checked=checks,
        estimators=tuple(_estimator(name, own, problem, checks) for name, own in stated.items()),
    )


def _checks(plan: StudiedPlan) -> tuple[CheckedOffset, ...]:
    """What `check` says of the plan, with the key `geometry` and without."""
    own = plan.plan
    header = with_tolerance(own.header, None)
    postures = own.postures * own.robot.display
    without = type(own).of_postures(header, own.robot, postures, own.targets, "study")
    return tuple(_checked(check(own), check(without)))


def _checked(with_key: Check, without: Check) -> Iterator[CheckedOffset]:
    for row, plain in zip(with_key.parameters, without.parameters, strict=False):
        if row.group == "offset" and not row.held:
            if plain.name != row.name:
                raise ValueError(f"{plain.name} is not {row.name}")
            considered = with_key.geometry.consider.get(row.name) if known(plain.status) else None
            yield CheckedOffset(row.name, row.unit, plain.std, considered, row.std)


def _estimator(
    name: EstimatorName, stated: Stated, problem: Problem, checks: Sequence[CheckedOffset]
) -> GeometryEstimator:
    solved = problem.with_geometry(NOMINAL) if name in ("considered", "nominal") else problem
    status = identify(solved, solved.nominal()).status
    free = np.flatnonzero(solved.parameters.free & solved.parameters.group("offset"))
    control = name in _CONTROLS
    judged = [known(status[i]) for i in free]
    alarm = _CHANCE / max(sum(judged), 1)
    rows = []
    for j, (i, checked) in enumerate(zip(free, checks, strict=True)):
        item = solved.parameters.items[i]
        kept = stated.converged & np.isfinite(stated.std[:, j]) if judged[j] else np.zeros(0, dtype=bool)
        rows.append(_parameter(name, item, status[i], stated, j, kept, checked, alarm))
    agrees = all(share.agrees for row in rows for share in row.shares) and any(row.shares for row in rows)
    converged, misfit = int(stated.converged.sum()), int(stated.misfit.sum())
    return GeometryEstimator(
        name=name,
        words=_WORDS[name],
        control=control,
        agrees=agrees,
        converged=converged,
        misfit=misfit,
        sentence=_sentence(rows, agrees, control, converged, misfit),
        parameters=tuple(rows),
    )


def _parameter(
    name: EstimatorName,
    item: Parameter,
    status: Status,
    stated: Stated,
    j: int,
    kept: NDArray[np.bool_],
    checked: CheckedOffset,
    alarm: float,
) -> GeometryParameter:
    if kept.sum() < 2:
        return GeometryParameter(item.name, item.unit, status, *Accuracy())
    error, std = stated.error[kept, j], stated.std[kept, j]
    off = np.abs(error) / std
    squares, count = float((off**2).sum()), len(off)
    low, high = (float(np.sqrt(squares / stats.chi2.ppf(tail, count))) for tail in (0.975, 0.025))
    predicted = {"freed": checked.freed, "considered": checked.considered, "nominal": checked.noise_only}
    return GeometryParameter(
        item.name,
        item.unit,
        status,
        *accuracy(error, std),
        coverage=held_share(int((off <= NORMAL_95).sum()), count, _LEVEL, alarm),
        z=float(np.sqrt(squares / count)),
        z_low=low,
        z_high=high,
        checked_std=predicted.get(name),
    )


def _sentence(
    rows: Sequence[GeometryParameter], agrees: bool, control: bool, converged: int, misfit: int
) -> str:
    found = [
        (row.name, row.coverage, row.z) for row in rows if row.coverage is not None and row.z is not None
    ]
    if not found:
        return "All offsets are unidentifiable"
    name, worst, _ = max(found, key=lambda own: abs(own[1].share - _LEVEL))
    zs = [z for _, _, z in found]
    text = (
        f"{100 * _LEVEL:g} % intervals hold the truth in {100 * worst.share:.1f} % at the worst"
        f" ({label(name)}), z {min(zs):.2f} to {max(zs):.2f}: "
    )
    if control:
        text += "not detected" if agrees else "detected as wrong"
    else:
        text += "as stated" if agrees else "not as stated"
    return f"{text}. {misfit} of {converged} answers say misfit"


def _headline(count: int, plans: Sequence[GeometryPlan]) -> str:
    def of(name: EstimatorName) -> list[tuple[GeometryPlan, GeometryEstimator]]:
        return [(plan, own) for plan in plans for own in plan.estimators if own.name == name]

    def said(name: EstimatorName, words: str) -> str:
        short = [plan.name for plan, own in of(name) if not own.agrees]
        where = f" ({listed(short)})" if short else ""
        return f"{words} {'do not hold' if short else 'hold'} the truth as often as stated{where}"

    zs = [row.z for _, own in of("nominal") for row in own.parameters if row.z is not None]
    controls = [f"{own.name} on {plan.name}" for name in _CONTROLS for plan, own in of(name) if own.agrees]
    parts = [
        f"Over {count} simulated arms of each plan, the 95 % intervals "
        + said("freed", "with the geometry estimated")
        + f"; {said('considered', 'those of the consider analysis')}.",
        f"With nominal geometry and the noise alone errors are {min(zs):.1f} to {max(zs):.1f} u."
        if zs
        else "",
        f"Not detected: {listed(controls)}." if controls else "Every control is detected.",
    ]
    return " ".join(part for part in parts if part)
