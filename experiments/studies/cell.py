"""Does the whole chain hold what it states? Runs in the simulated cell, from a plan to the offsets.

Every run has an arm of its own and goes the whole way: pictures, PSD, encoders, servo, identification. Its
offsets are compared with the truth, and its time with the paper's six minutes. Two negative controls are
carried along.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from ...analysis.observability.identifiability import identify
from ...model.arrays import Matrix
from ...model.files.header import Header
from ...model.files.plan import Plan, planned
from ...model.likelihood.problem import Problem
from ...model.records import it
from ...words.wording import label, listed
from ..procedure.session import PHASES
from ..rigs.simulated.cell_file import ArmInCell, CameraInCell, CellFile
from .answer import (
    JudgedPart,
    NoiseLevel,
    ObservedParameter,
    PlanOfStudy,
    StudyAnswer,
    all_agree,
    observed,
    worst_share,
)
from .campaign import CellRun, Repeated, SeededRun, carried, seeds_of
from .cases import Engine
from .laser_plans import (
    MEASUREMENTS,
    SIGMA_MM,
    candidate_postures,
    laser_header,
    optimal_postures,
    robot_of,
    y_postures,
)

CANDIDATES = 1000
_POOL = 24  # postures that the adaptive run may choose from
_TOLERANCE_DEG = 0.02
_BACKLASH_DEG = 0.1  # of the control: ten times the joint noise
_LEVEL = 0.95
_ALARM = 0.01  # probability of a false alarm over all offsets of a plan
_LIMIT_S = 360.0  # "no more than 6 minutes" (section 4.1)


@dataclass(frozen=True)
class PhaseSeconds:
    """Time of a run in one phase, on the cell's clock: mean and longest; None where no run has ended."""

    mean: float | None = None
    max: float | None = None


@dataclass(frozen=True)
class ShotsUsed:
    """Measurements of a run; None where no run has ended."""

    mean: float | None = None
    min: int | None = None
    max: int | None = None


@dataclass(frozen=True, kw_only=True)
class CellPlan(JudgedPart, PlanOfStudy):
    """One plan: `failed` runs without a result and why, `refused` measurements over all runs, `contradicted`
    runs that contradict the model; `seconds` by phase and in `total`; `saved` is the mean number of postures
    that an adaptive run did without, `computing_s` the real time of a run."""

    runs: int
    failures: tuple[str, ...]
    refused: int
    contradicted: int
    parameters: tuple[ObservedParameter, ...]
    seconds: dict[str, PhaseSeconds]
    within_limit: bool | None
    shots_used: ShotsUsed
    saved: float | None
    computing_s: float | None


@dataclass(frozen=True)
class CellSettings:
    """How the study was carried out."""

    runs: Annotated[int, it("runs of each plan")]
    seed: Annotated[int, it("seed")]
    level: Annotated[float, it("level of the intervals")]
    camera: Annotated[bool, it("search by camera images")]
    chance: Annotated[float, it("probability of a false alarm over the offsets of a plan")]
    limit_s: Annotated[float, it("limit of a run’s time", unit="s")]
    tolerance_deg: Annotated[float, it("tolerance of the adaptive run", unit="deg")]


@dataclass(frozen=True, kw_only=True)
class CellStudy(StudyAnswer):
    """The whole answer."""

    settings: CellSettings
    plans: tuple[CellPlan, ...]


@dataclass(frozen=True, eq=False)
class CellPlanStudied:
    """A plan of the study, and the cell that it is carried out in. A `control` must not agree."""

    name: str
    words: str
    repeated: Repeated
    control: bool = False


def paper_plan(header: Header) -> Plan:
    """Our Y-Pattern of seven measurements; the paper does not print its postures."""
    return _plan(header, y_postures(header))


def optimal_plan(header: Header, seed: int) -> Plan:
    """The A-optimal seven of many candidates."""
    return _plan(header, optimal_postures(header, CANDIDATES, seed))


def _plan(header: Header, postures: Matrix) -> Plan:
    robot, lines = robot_of(header), tuple(range(1, len(postures) + 1))
    shots = planned(postures * robot.display, ("psd",) * len(postures))
    return Plan(header, robot, shots, lines, Path(), "", ())


def studied_plans(seed: int, camera: bool) -> list[CellPlanStudied]:
    """The paper's plan, the optimal one, an adaptive run, and the optimal one on an arm with backlash."""
    header = laser_header(0.01, 0.05, SIGMA_MM)
    cell = CellFile(camera=CameraInCell() if camera else None)
    loose = cell.model_copy(update={"arm": ArmInCell(backlash_deg=_BACKLASH_DEG)})
    best = optimal_plan(header, seed)
    pool = _plan(header, candidate_postures(header, CANDIDATES, seed).postures[:_POOL])
    needed = _needed_in_turn(pool)
    in_turn = f"{needed} are needed" if needed else "they are not enough"
    adaptive = (
        f"adaptive: the best next one of {_POOL} postures, until the largest u is within {_TOLERANCE_DEG:g}°;"
        f" in their own order {in_turn} by prediction"
    )
    y_pattern = f"Y-Pattern of {MEASUREMENTS} measurements over the arm's whole reach"
    optimal = f"{MEASUREMENTS} A-optimal measurements of {CANDIDATES} postures"
    backlash = f"control: the optimal plan on an arm with a backlash of {_BACKLASH_DEG:g}°"
    return [
        CellPlanStudied("y-pattern", y_pattern, Repeated(paper_plan(header), cell)),
        CellPlanStudied("optimal", optimal, Repeated(best, cell, halved=True)),
        CellPlanStudied("adaptive", adaptive, Repeated(pool, cell, _TOLERANCE_DEG)),
        CellPlanStudied("backlash", backlash, Repeated(best, loose), control=True),
    ]


def _needed_in_turn(plan: Plan) -> int | None:
    """How many of the plan's measurements, in their order, reach the tolerance by prediction."""
    problem = Problem.from_plan(plan)
    offsets = problem.parameters.free & problem.parameters.group("offset")
    for count in range(2, problem.shots + 1):
        some = problem.select(np.arange(count))
        if np.degrees(identify(some, some.nominal()).data_std[offsets].max()) <= _TOLERANCE_DEG:
            return count
    return None


def cell_study(
    runs: int,
    engine: Engine,
    *,
    camera: bool = True,
) -> CellStudy:
    """Carry out the whole study.

    It agrees if the intervals of every plan contain the true value as often as stated, and every control is
    detected.
    """
    engine.progress("plans", 0.0)
    plans = studied_plans(engine.seed, camera)
    pieces = [SeededRun(plan.repeated, one) for plan in plans for one in seeds_of(engine.seed, runs)]
    made = engine.each("cell", CellRun, carried, pieces, called="run", runs=runs, camera=camera)
    answers, controls = [], []
    for k, plan in enumerate(plans):
        of_plan = made[k * runs : (k + 1) * runs]
        answers.append(judged(plan, of_plan))
        if plan.repeated.halved:
            words = f"control: the {plan.name} plan's runs, the noise stated as half of what it is"
            understated = replace(plan, name="noise understated by 2", words=words, control=True)
            controls.append(judged(understated, [run.of_half for run in of_plan]))
    every = (*answers, *controls)
    return CellStudy(
        study="cell",
        title="Does the whole chain hold what it states?",
        headline=_headline(runs, every),
        agrees=all(plan.agrees is not plan.control for plan in every),
        settings=CellSettings(runs, engine.seed, _LEVEL, camera, _ALARM, _LIMIT_S, _TOLERANCE_DEG),
        plans=every,
        notes=(
            f"Every run has an arm of its own, with offsets of {plans[0].repeated.cell.arm.drawn_deg:g}°"
            " (one standard deviation), a PSD some 20 mm away from its guess, and noise of its own; the"
            f" priors of the fits are 5° and {SIGMA_MM:g} mm. All plans have the same seeds and arms.",
            "An interval is estimate ± 1.96 u, from the curvature of the likelihood. It counts where the run"
            " itself calls the offset identified or weak; a run that does not has no interval there, and"
            " lowers the number of runs that the share is of.",
            "Two assumptions of the intervals do not hold exactly where an offset is weakly observable: the"
            " residuals are not linear over them, which makes them a little short, and the priors are wider"
            " than the distribution of the true offsets, which makes them a little long.",
            f"A plan agrees if the p-value of none of its shares is below {_ALARM:.0%} over its offsets"
            " together (exact binomial test, Bonferroni). The intervals shown are 95 % (Clopper and"
            " Pearson).",
            "Seconds are those of the simulated cell's clock: a quarter of the arm's top speeds, pictures,"
            " PSD samples, settling. They depend on the settings of the cell file.",
        ),
    )


def judged(plan: CellPlanStudied, runs: Sequence[CellRun]) -> CellPlan:
    """One plan of the study, by what its runs state."""
    carried_plan = plan.repeated.plan
    problem = Problem.from_plan(carried_plan)
    free = np.flatnonzero(problem.parameters.free & problem.parameters.group("offset"))
    items = [problem.parameters.items[i] for i in free]
    nominal = identify(problem, problem.nominal()).status
    status = [nominal[i] for i in free]
    error = np.full((len(runs), len(items)), np.nan)
    stds = error.copy()
    for r, run in enumerate(runs):
        for j, item in enumerate(items):
            if run.estimates is not None and item.name in run.estimates.offsets:
                value, std = run.estimates.offsets[item.name]
                error[r, j], stds[r, j] = value - run.truth[item.name], std
    # An unidentifiable offset has no number, even if single runs were lucky enough to claim one.
    determined = [plan.control or one != "unidentifiable" for one in status]
    rows = observed(items, status, determined, error, stds, np.ones(len(runs), dtype=bool), _ALARM)
    agrees = all_agree(rows)
    ended = [run for run in runs if run.estimates is not None]
    contradicted = sum(run.estimates is not None and run.estimates.contradicted for run in runs)
    used = [run.used for run in ended]
    saved = [len(carried_plan.postures) - run.used - run.refused for run in ended]
    totals = [sum(run.seconds.values()) for run in ended]
    times = {phase: [run.seconds[phase] for run in ended] for phase in PHASES} | {"total": totals}
    return CellPlan(
        name=plan.name,
        words=plan.words,
        control=plan.control,
        agrees=agrees,
        sentence=_sentence(rows, agrees, plan.control, len(ended), contradicted),
        robot=carried_plan.robot.name,
        shots=len(carried_plan.postures),
        noise=NoiseLevel.of_problem(problem),
        runs=len(runs),
        failed=len(runs) - len(ended),
        failures=tuple(sorted({run.failure for run in runs if run.failure is not None})),
        refused=sum(run.refused for run in runs),
        contradicted=contradicted,
        parameters=rows,
        seconds={
            phase: PhaseSeconds(float(np.mean(spent)), max(spent)) if spent else PhaseSeconds()
            for phase, spent in times.items()
        },
        within_limit=max(totals) <= _LIMIT_S if totals else None,
        shots_used=ShotsUsed(float(np.mean(used)), min(used), max(used)) if used else ShotsUsed(),
        saved=float(np.mean(saved)) if plan.repeated.tolerance is not None and saved else None,
        computing_s=float(np.mean([run.computing for run in runs])),
    )


def _sentence(
    rows: Sequence[ObservedParameter], agrees: bool, control: bool, ended: int, contradicted: int
) -> str:
    text = worst_share(rows, agrees, control)
    if control:
        return f"{text}. {contradicted} of {ended} runs state by themselves that they contradict the model"
    missing = {row.name: ended - sum(share.of for share in row.shares) for row in rows}
    without = [f"{label(name)} in {count} runs" for name, count in missing.items() if count]
    known = any(row.shares for row in rows)
    return text + (
        f". Unidentifiable, so without an interval: {listed(without)}" if without and known else ""
    )


def _headline(runs: int, plans: Sequence[CellPlan]) -> str:
    shown, controls = ([plan for plan in plans if plan.control is of] for of in (False, True))
    short = [plan.name for plan in shown if not plan.agrees]
    undetected = [plan.name for plan in controls if plan.agrees]
    longest = max((plan.seconds["total"].max or 0.0 for plan in shown), default=0.0)
    hold = (
        f"do not contain the true value as often as stated ({listed(short)})"
        if short
        else "contain the true value as often as stated"
    )
    within = (
        " of the six minutes that the paper allows"
        if longest <= _LIMIT_S
        else ", more than the paper's six minutes"
    )
    return (
        f"Over {runs} runs of each plan through the whole chain, the intervals that a run shows {hold}."
        f" {f'Not detected: {listed(undetected)}.' if undetected else 'Every control is detected.'}"
        f" The longest run takes {longest:.0f} s{within}."
    )
