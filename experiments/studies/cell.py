"""Does the whole chain hold what it states? Runs in the simulated cell, from a plan to the offsets.

Every run has an arm of its own and goes the whole way: pictures, PSD, encoders, servo, identification. Its
offsets are compared with the truth, and its time with the paper's six minutes. Two negative controls are
carried along. A run depends on its seed alone: the arm that is drawn, where its PSD is, all noise.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from ...analysis.observability.identifiability import identify
from ...analysis.solution import Solution
from ...model.arrays import Matrix
from ...model.errors import ZerobeamError
from ...model.files.header import Header
from ...model.files.plan import Plan, planned
from ...model.files.shot import Shot
from ...model.likelihood.problem import Problem
from ...model.records import it
from ...words.numbers import percent
from ...words.wording import label, listed
from ..procedure.beam_ports import PHASES, BeamPorts
from ..procedure.session import Adaptive, InTurn, Session, state_of
from ..rigs.simulated.cell_file import ArmInCell, CameraInCell, CellFile
from ..rigs.simulated.simulator import SimulatedRig
from .answer import (
    ALARM,
    JudgedPart,
    NoiseLevel,
    ObservedParameter,
    PlanOfStudy,
    StudyAnswer,
    estimated,
    judged_shares,
    observed,
)
from .cases import Engine
from .data_sets import (
    MEASUREMENTS,
    SIGMA_MM,
    candidate_postures,
    laser_header,
    optimal_postures,
    robot_of,
    with_half_the_noise,
    y_postures,
)

CANDIDATES = 1000
Y_PATTERN = f"Y-Pattern of {MEASUREMENTS} measurements over the arm's whole reach"
OPTIMAL = f"{MEASUREMENTS} A-optimal measurements of {CANDIDATES} postures"
_POOL = 24  # postures that the adaptive run may choose from
_TOLERANCE_DEG = 0.02
_BACKLASH_DEG = 0.1  # of the control: ten times the joint noise
_LEVEL = 0.95
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


# ── runs ──────────────────────────────────────────────────────────────────────────────────────


@dataclass(frozen=True, eq=False)
class Repeated:
    """A plan, and the cell that it is carried out in many times; with a `tolerance` (deg; mm) in the adaptive
    order. Where it is `halved`, each run is solved once more with half of the noise. A `control` must not
    agree."""

    plan: Plan
    cell: CellFile
    tolerance: float | None = None
    halved: bool = False
    name: str = ""
    words: str = ""
    control: bool = False


@dataclass(frozen=True)
class RunEstimates:
    """What a run states: estimate and standard uncertainty of each offset that it determines, deg, and
    whether it contradicts the model."""

    offsets: dict[str, tuple[float, float]]
    contradicted: bool

    @classmethod
    def of_state(cls, state: Solution | None) -> RunEstimates | None:
        if state is None:
            return None
        rows = [(row.name, row.estimate, row.std) for row in state.offsets]
        known = {name: (value, std) for name, value, std in rows if value is not None and std is not None}
        return cls(known, not state.consistent)


@dataclass(frozen=True)
class CellRun:
    """A simulated run.

    `truth` has the true offsets and tool by name, deg and mm; `used` and `refused` count measurements;
    `seconds` of the cell's clock by phase. `estimates` is None where no measurement was recorded or the rig
    stopped, and `failure` says why; `halved` are those with half of the noise. `computing` is the time that
    it took, s: the only thing that differs from one computer to another.
    """

    seed: int
    truth: dict[str, float]
    used: int
    refused: int
    estimates: RunEstimates | None
    seconds: dict[str, float]
    failure: str | None
    computing: float
    halved: RunEstimates | None = None


class MemoryJournal:
    """The shots of a run that needs no file."""

    def __init__(self) -> None:
        self._shots: list[Shot] = []

    @property
    def shots(self) -> tuple[Shot, ...]:
        return tuple(self._shots)

    def append(self, shot: Shot) -> None:
        self._shots.append(shot)

    def withdraw(self, number: int) -> None:
        self._shots = [shot for shot in self._shots if shot.shot != number]


def seeds_of(seed: int, count: int) -> tuple[int, ...]:
    """One for each run; the first of many are those of fewer."""
    return tuple(int(np.random.SeedSequence([seed, run]).generate_state(1)[0]) for run in range(count))


def carried(run: tuple[Repeated, int]) -> CellRun:
    """One run, in memory, with a seed."""
    began = time.perf_counter()
    repeated, seed = run
    plan, tolerance = repeated.plan, repeated.tolerance
    order = InTurn(len(plan.postures)) if tolerance is None else Adaptive(plan, tolerance)
    journal, truth, seconds, refused = MemoryJournal(), dict[str, float](), dict[str, float](), 0
    state: Solution | None = None
    failure: str | None = None
    try:
        rig = SimulatedRig(plan, repeated.cell, seed)
        truth = rig.truth.values()
        ports = BeamPorts(plan, rig, lambda event: None)
        seconds = ports.seconds
        session = Session(ports, journal, order).carry_out()
        refused, state = len(session.refused), session.state
        if state is None:
            failure = "; ".join(dict.fromkeys(refusal.found for refusal in session.refused))
    except ZerobeamError as error:
        failure = str(error)
    halved = None
    if repeated.halved and state is not None:
        halved = state_of(plan.header, with_half_the_noise(Problem.from_plan(plan)), journal.shots)
    return CellRun(
        seed,
        truth,
        len(journal.shots),
        refused,
        RunEstimates.of_state(state),
        seconds,
        failure,
        time.perf_counter() - began,
        RunEstimates.of_state(halved),
    )


# ── the study ─────────────────────────────────────────────────────────────────────────────────


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


def studied_plans(seed: int, camera: bool) -> list[Repeated]:
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
    backlash = f"control: the optimal plan on an arm with a backlash of {_BACKLASH_DEG:g}°"
    return [
        Repeated(paper_plan(header), cell, name="y-pattern", words=Y_PATTERN),
        Repeated(best, cell, halved=True, name="optimal", words=OPTIMAL),
        Repeated(pool, cell, _TOLERANCE_DEG, name="adaptive", words=adaptive),
        Repeated(best, loose, name="backlash", words=backlash, control=True),
    ]


def _needed_in_turn(plan: Plan) -> int | None:
    """How many of the plan's measurements, in their order, reach the tolerance by prediction."""
    problem = Problem.from_plan(plan)
    offsets = estimated(problem)
    for count in range(2, problem.shots + 1):
        some = problem.select(np.arange(count))
        if np.degrees(identify(some, some.nominal()).data_std[offsets].max()) <= _TOLERANCE_DEG:
            return count
    return None


def cell_study(runs: int, engine: Engine, *, camera: bool = True) -> CellStudy:
    """Carry out the whole study.

    It agrees if the intervals of every plan contain the true value as often as stated, and every control is
    detected.
    """
    engine.progress("plans", 0.0)
    plans = studied_plans(engine.seed, camera)
    pieces = [(plan, one) for plan in plans for one in seeds_of(engine.seed, runs)]
    made = engine.each("cell", CellRun, carried, pieces, called="run", runs=runs, camera=camera)
    answers, controls = [], []
    for k, plan in enumerate(plans):
        of_plan = made[k * runs : (k + 1) * runs]
        answers.append(judged(plan, of_plan))
        if plan.halved:
            words = f"control: the {plan.name} plan's runs, the noise stated as half of what it is"
            understated = replace(plan, name="noise understated by 2", words=words, control=True)
            halves = [replace(run, estimates=run.halved) for run in of_plan]
            controls.append(judged(understated, halves))
    every = (*answers, *controls)
    return CellStudy(
        study="cell",
        title="Does the whole chain hold what it states?",
        headline=_headline(runs, every),
        agrees=all(plan.agrees is not plan.control for plan in every),
        settings=CellSettings(runs, engine.seed, _LEVEL, camera, ALARM, _LIMIT_S, _TOLERANCE_DEG),
        plans=every,
        notes=(
            f"Every run has an arm of its own, with offsets of {plans[0].cell.arm.drawn_deg:g}°"
            " (one standard deviation), a PSD some 20 mm away from its guess, and noise of its own; the"
            f" priors of the fits are 5° and {SIGMA_MM:g} mm. All plans have the same seeds and arms.",
            "An interval is estimate ± 1.96 u, from the curvature of the likelihood. It counts where the run"
            " itself calls the offset identified or weak; a run that does not has no interval there, and"
            " lowers the number of runs that the share is of.",
            "Two assumptions of the intervals do not hold exactly where an offset is weakly observable: the"
            " residuals are not linear over them, which makes them a little short, and the priors are wider"
            " than the distribution of the true offsets, which makes them a little long.",
            f"A plan agrees if the p-value of none of its shares is below {percent(ALARM)} over its offsets"
            " together (exact binomial test, Bonferroni). The intervals shown are 95 % (Clopper and"
            " Pearson).",
            "Seconds are those of the simulated cell's clock: a quarter of the arm's top speeds, pictures,"
            " PSD samples, settling. They depend on the settings of the cell file.",
        ),
    )


def judged(plan: Repeated, runs: Sequence[CellRun]) -> CellPlan:
    """One plan of the study, by what its runs state."""
    problem = Problem.from_plan(plan.plan)
    names = [problem.parameters.names[i] for i in estimated(problem)]
    error, stds = np.full((2, len(runs), len(names)), np.nan)
    for r, run in enumerate(runs):
        for j, name in enumerate(names):
            if run.estimates is not None and name in run.estimates.offsets:
                value, std = run.estimates.offsets[name]
                error[r, j], stds[r, j] = value - run.truth[name], std
    rows = observed(problem, error, stds, np.ones(len(runs), dtype=bool), claims=plan.control)
    agrees, sentence = judged_shares(rows, plan.control)
    ended = [run for run in runs if run.estimates is not None]
    contradicted = sum(run.estimates is not None and run.estimates.contradicted for run in runs)
    missing = {row.name: len(ended) - sum(share.of for share in row.shares) for row in rows}
    without = [f"{label(name)} in {count} runs" for name, count in missing.items() if count]
    if plan.control:
        sentence += (
            f". {contradicted} of {len(ended)} runs state by themselves that they contradict the model"
        )
    elif without and any(row.shares for row in rows):
        sentence += f". Unidentifiable, so without an interval: {listed(without)}"
    count, used = len(plan.plan.postures), [run.used for run in ended]
    saved = [count - run.used - run.refused for run in ended]
    totals = [sum(run.seconds.values()) for run in ended]
    times = {phase: [run.seconds[phase] for run in ended] for phase in PHASES} | {"total": totals}
    return CellPlan(
        name=plan.name,
        words=plan.words,
        control=plan.control,
        agrees=agrees,
        sentence=sentence,
        robot=plan.plan.robot.name,
        shots=count,
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
        saved=float(np.mean(saved)) if plan.tolerance is not None and saved else None,
        computing_s=float(np.mean([run.computing for run in runs])),
    )


def _headline(runs: int, plans: Sequence[CellPlan]) -> str:
    shown = [plan for plan in plans if not plan.control]
    short = [plan.name for plan in shown if not plan.agrees]
    undetected = [plan.name for plan in plans if plan.control and plan.agrees]
    longest = max((plan.seconds["total"].max or 0.0 for plan in shown), default=0.0)
    hold = f"{'do not ' if short else ''}contain the true value as often as stated"
    within = longest <= _LIMIT_S
    limit = " of the six minutes that the paper allows" if within else ", more than the paper's six minutes"
    return (
        f"Over {runs} runs of each plan through the whole chain, the intervals that a run shows"
        f" {hold}{f' ({listed(short)})' if short else ''}."
        f" {f'Not detected: {listed(undetected)}.' if undetected else 'Every control is detected.'}"
        f" The longest run takes {longest:.0f} s{limit}."
    )
