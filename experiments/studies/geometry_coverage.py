"""Do the intervals hold if the arm deviates from nominal geometry? Random arms, solved in several ways.

Every simulated arm has offsets and links of its own, and measures a plan once, with noise. Its measurements
are solved with the geometry estimated, and with nominal geometry: with the uncertainty of the consider
analysis, and with that of the noise alone, which is the control that must fail. The fits and statuses are
those of `analyse` (`fit_each`, `judge`). The plans are of the laser of the demo run, and of a probe with
several targets.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any, Literal, NamedTuple, get_args

import numpy as np
from scipy import stats

from ...analysis.estimation.fit import fit_each, single
from ...analysis.observability.check import Check, check
from ...analysis.observability.geometry_result import considered
from ...analysis.observability.identifiability import identify
from ...analysis.solution import Solution, judge
from ...analysis.status import has_numbers
from ...model.arrays import Mask, Matrix
from ...model.files.from_arrays import Probe
from ...model.files.header import EXACT, Header
from ...model.files.plan import Plan
from ...model.kinematics.robot import Robot
from ...model.likelihood.problem import Problem
from ...model.records import it
from ...words.wording import listed
from ..plans.candidates import Planned, candidates
from ..plans.optimal import Planner, Proposal
from .answer import (
    JudgedEstimator,
    NoiseLevel,
    ObservedParameter,
    PlanOfStudy,
    StudyAnswer,
    all_agree,
    observed,
    worst_share,
)
from .cases import Engine
from .data_sets import DataSets, drawn
from .laser_plans import laser_header, planner, robot_of

EstimatorName = Literal["freed", "considered", "nominal", "tolerances understated by 3"]
ChosenFor = Literal["nominal", "freed"]

MEASUREMENTS = (7, 12, 20, 40)
CLOSE_MEASUREMENTS = (7, 12)
CANDIDATES = 10_000  # as `zerobeam plan optimal`
_SOCKETS_APART_MM, _PER_SOCKET = 50.0, 10
_PLACEMENTS = {"front": (500.0, 0.0, 100.0), "left": (300.0, 450.0, 250.0), "right": (350.0, -400.0, 20.0)}
_TIP_MM = 2.0  # of a free tip from where the header has it: far less than its prior
_LEVEL = 0.95
_ALARM = 0.01  # probability of a false alarm over the offsets of an estimator
_OFFSET_DEG = 1.0  # of the simulated arms
_UNDERSTATED = 3.0
_WORDS: dict[EstimatorName, str] = {
    "freed": "geometry estimated, its tolerances as priors",
    "considered": "nominal geometry, its uncertainty by the consider analysis",
    "nominal": "control: nominal geometry, its uncertainty by the noise alone",
    "tolerances understated by 3": "control: geometry estimated, its tolerances stated as a third",
}
_CHECKED: dict[EstimatorName, str] = {"freed": "freed", "considered": "considered", "nominal": "noise_only"}
_CONTROLS: tuple[EstimatorName, ...] = ("nominal", "tolerances understated by 3")


@dataclass(frozen=True)
class GeometryParameter(ObservedParameter):
    """An offset by one estimator over many arms.

    `z` is the root mean square of its errors in standard uncertainties, with the 95 % interval `z_low` to
    `z_high` (chi-squared); `checked_std` the prediction of `check` for the plan.
    """

    z: float | None = None
    z_low: float | None = None
    z_high: float | None = None
    checked_std: float | None = None


@dataclass(frozen=True, kw_only=True)
class GeometryEstimator(JudgedEstimator):
    """One way to treat the geometry, on a plan; `misfit` counts the arms whose answer says that the model
    does not describe the measurements."""

    misfit: int
    parameters: tuple[GeometryParameter, ...]


@dataclass(frozen=True)
class ToleranceLevel:
    """The tolerances of all links: one standard deviation of the simulated arms."""

    length_mm: float
    angle_deg: float


TYPICAL, CLOSE = ToleranceLevel(0.3, 0.1), ToleranceLevel(0.1, 0.03)


@dataclass(frozen=True)
class CheckedOffset:
    """The u that `check` predicts for one offset, None where the plan does not determine it: with nominal
    geometry and an arm of nominal geometry (`noise_only`), with nominal geometry and an arm that has the
    tolerances (`considered`), with the geometry estimated (`freed`)."""

    name: str
    unit: str
    noise_only: float | None
    considered: float | None
    freed: float | None


@dataclass(frozen=True, kw_only=True)
class GeometryPlan(PlanOfStudy):
    """One plan: `chosen_for` the geometry that it was made for, None where it was not chosen; `failed` counts
    arms drawn again because they cannot hit the target."""

    chosen_for: ChosenFor | None
    tolerance: ToleranceLevel
    arms: int
    efficiency: float | None
    checked: tuple[CheckedOffset, ...]
    estimators: tuple[GeometryEstimator, ...]


@dataclass(frozen=True)
class GeometrySettings:
    """How the study was carried out."""

    arms: Annotated[int, it("arms for each plan")]
    seed: Annotated[int, it("seed")]
    level: Annotated[float, it("level of the intervals")]
    chance: Annotated[float, it("probability of a false alarm over the offsets of an estimator")]
    candidates: Annotated[int, it("candidates of a plan")]
    offset_deg: Annotated[float, it("offsets of the arms, one standard deviation", unit="deg")]


@dataclass(frozen=True, kw_only=True)
class GeometryStudy(StudyAnswer):
    """The whole answer."""

    settings: GeometrySettings
    plans: tuple[GeometryPlan, ...]


class PlanCase(NamedTuple):
    """A plan of the study: so many measurements of the laser, chosen for a geometry; or, without any, those
    of the probe."""

    measurements: int | None = None
    chosen_for: ChosenFor | None = None
    tolerance: ToleranceLevel = TYPICAL

    @property
    def name(self) -> str:
        close = "" if self.tolerance == TYPICAL else ", close tolerances"
        return "sockets" if self.measurements is None else f"{self.measurements}, {self.chosen_for}{close}"


PLAN_CASES = (
    *(PlanCase(count, geometry) for geometry in get_args(ChosenFor) for count in MEASUREMENTS),
    *(PlanCase(count, "nominal", CLOSE) for count in CLOSE_MEASUREMENTS),
    PlanCase(),
)


@dataclass(frozen=True, eq=False)
class GeometryPlanStudied:
    """A plan with `geometry` in its header; `proposal` as `plan optimal` made it, None where it did not."""

    case: PlanCase
    words: str
    plan: Plan
    proposal: Proposal | None = None


def with_tolerance(header: Header, tolerance: ToleranceLevel | None) -> Header:
    """The header with link geometry as uncertain as that, without gravity and harmonics; exact for None."""
    content = header.model_dump(by_alias=True, exclude_none=True, exclude_unset=True)
    content["geometry"] = EXACT
    if tolerance is not None:
        sizes = {"length_mm": tolerance.length_mm, "angle_deg": tolerance.angle_deg}
        content["geometry"] = {"tolerance": sizes, "gravity": False, "harmonics": False}
    return Header.model_validate(content)


@lru_cache(maxsize=2)  # the candidates are kept: every piece is one of the plans of a study
def _planner(chosen_for: ChosenFor, seed: int, count: int) -> Planner:
    tolerance = TYPICAL if chosen_for == "freed" else None
    return planner(with_tolerance(laser_header(0.01, 0.05), tolerance), count, seed)


def studied_plan(case: PlanCase, seed: int, count: int = CANDIDATES) -> GeometryPlanStudied:
    """A plan of the study, chosen among `count` candidates: that takes as long as its arms do."""
    if case.measurements is None or case.chosen_for is None:
        return _probe(case, seed)
    proposal = _planner(case.chosen_for, seed, count).optimal(case.measurements, seed=seed)
    header = with_tolerance(laser_header(0.01, 0.05), case.tolerance)
    words = (
        f"laser, {case.measurements} A-optimal measurements of {count} postures, chosen for"
        f" {'nominal' if case.chosen_for == 'nominal' else 'uncertain'} geometry"
    )
    plan = _plan(header, robot_of(header), proposal.postures, ["psd"] * case.measurements)
    return GeometryPlanStudied(case, words, plan, proposal)


def _probe(case: PlanCase, seed: int) -> GeometryPlanStudied:
    """Pairs of sockets at a stated distance, each met from random postures; the tip is free."""
    targets, distances = {}, []
    for name, (x, y, z) in _PLACEMENTS.items():
        for k in range(2):
            targets[f"{name}_{k}"] = {"guess_mm": [x + k * _SOCKETS_APART_MM, y, z], "sigma_mm": 30.0}
        between = [f"{name}_0", f"{name}_1"]
        distances.append({"between": between, "mm": _SOCKETS_APART_MM, "sigma_mm": 0.1})
    content = {
        "robot": "panda",
        "tool": Probe(point_mm=(0, 0, 130), calibrated=False).content(),
        "noise": {"joint_deg": 0.01, "spot_mm": 0.1},
        "targets": targets,
        "geometry": EXACT,
    }
    header = Header.model_validate(content)
    robot = robot_of(header)
    postures, names = [], []
    for k, (name, target) in enumerate(targets.items()):
        at = np.array(target["guess_mm"])
        measured = Planned(header.labels[0], target=name)
        random_postures = candidates(header, robot, at, _PER_SOCKET, seed=seed + k, planned=measured).postures
        postures.append(random_postures)
        names += [name] * len(random_postures)
    with_distances = Header.model_validate({**content, "distances": distances})
    return GeometryPlanStudied(
        case,
        f"probe with a free tip, {len(_PLACEMENTS)} pairs of sockets, {_PER_SOCKET} random postures at each",
        _plan(with_tolerance(with_distances, case.tolerance), robot, np.concatenate(postures), names),
    )


def _plan(header: Header, robot: Robot, postures: Matrix, targets: list[str]) -> Plan:
    return Plan.of_postures(header, robot, np.round(postures * robot.display, 6), targets, "study")


Weigh = Callable[[Solution, Problem], Matrix]  # the std (p,) stated with a solution, internal units


@dataclass(frozen=True, eq=False)
class ArmErrors:
    """The answers of W arms for m offsets: `error` (estimate minus truth) and `std` (W, m), deg or mm, nan
    where an arm's own answer does not determine it; `converged`, `misfit` (W,) of each answer."""

    error: Matrix
    std: Matrix
    converged: Mask
    misfit: Mask


def arms(problem: Problem, count: int, offset_deg: float, rng: np.random.Generator) -> DataSets:
    """So many arms with random offsets (and a free tip that is a little off), and links off by their
    tolerances, each measured once."""
    parameters = problem.parameters
    spread = np.where(parameters.group("offset"), offset_deg / _display(problem), 0.0)
    spread = np.where(parameters.group("tool"), np.minimum(parameters.prior_std, _TIP_MM), spread)
    spread = np.where(parameters.group("geometry"), parameters.prior_std, spread)
    return drawn(problem, count, rng, spread)


def _stated_std(solution: Solution, whole: Problem) -> Matrix:
    return solution.std


def _considered_std(solution: Solution, whole: Problem) -> Matrix:
    parameters = whole.parameters
    x = parameters.with_values(parameters.prior_mean, solution.problem.parameters, solution.fit.x)
    at = [parameters.index(name) for name in solution.problem.parameters.names]
    return np.where([has_numbers(status) for status in solution.status], considered(whole, x)[at], np.nan)


def _errors(data: DataSets, problem: Problem, weigh: Weigh) -> ArmErrors:
    """By the fits of `problem`, with the stds that `weigh` has of them."""
    fits = fit_each(problem, data.joints, data.spots)
    at = np.flatnonzero(problem.parameters.group("offset") & problem.parameters.free)
    std = np.full((len(fits.x), len(at)), np.nan)
    misfit = np.zeros(len(fits.x), dtype=bool)
    for row, (joints, spots) in enumerate(zip(data.joints, data.spots, strict=True)):
        solution = judge(single(problem.moved(joints, spots), fits, row))
        misfit[row] = solution.misfit is not None
        std[row] = weigh(solution, data.problem.moved(joints, spots))[at]
    display = _display(problem)[at]
    error = (fits.x[:, at] - data.truths[:, at]) * display  # offsets come first, whatever the geometry
    return ArmErrors(np.where(np.isnan(std), np.nan, error), std * display, fits.converged, misfit)


def _display(problem: Problem) -> Matrix:
    return np.array([item.display for item in problem.parameters.items])


def geometry_study(
    count: int,
    engine: Engine,
    *,
    candidates: int = CANDIDATES,
    cases: Sequence[PlanCase] = PLAN_CASES,
) -> GeometryStudy:
    """Carry out the whole study with `count` arms for each plan.

    It agrees if the intervals with estimated geometry and those of the consider analysis contain the true
    value as often as stated on every plan, and every control is detected.
    """
    pieces = [ArmsOfPlan(case, count, engine.seed, candidates) for case in cases]
    answers = engine.each("geometry", GeometryPlan, answer_of, pieces, arms=count, candidates=candidates)
    estimators = [estimator for answer in answers for estimator in answer.estimators]
    return GeometryStudy(
        study="geometry",
        title="Do the intervals hold if the arm deviates from nominal geometry?",
        headline=_headline(count, answers),
        agrees=all(estimator.agrees is not estimator.control for estimator in estimators),
        settings=GeometrySettings(count, engine.seed, _LEVEL, _ALARM, candidates, _OFFSET_DEG),
        plans=tuple(answers),
        notes=(
            f"Every arm has offsets of {_OFFSET_DEG:g}° (one standard deviation), links off by the stated"
            " tolerances, and noise of its own. Gravity and harmonics are neither simulated nor estimated.",
            "An interval is estimate ± 1.96 u, from the curvature at the mode. It counts where the arm's own"
            " answer determines the offset; where that says misfit, its numbers count as well: the control"
            " shows what they are worth.",
            f"An estimator agrees if the p-value of none of its shares is below {_ALARM:.0%} over its"
            " offsets together (exact binomial test, Bonferroni).",
            "z is the root mean square of the errors in standard uncertainties: 1 if u is right.",
            "Tolerances are standard deviations of normal distributions, independent for each link"
            " parameter. Where an arm's deviations are of another kind, nothing here applies.",
        ),
    )


class ArmsOfPlan(NamedTuple):
    """A piece: so many arms of a plan."""

    case: PlanCase
    arms: int
    seed: int
    candidates: int


def answer_of(piece: ArmsOfPlan) -> GeometryPlan:
    """One plan of the study."""
    plan = studied_plan(piece.case, piece.seed, piece.candidates)
    problem = Problem.from_plan(plan.plan)
    checks = _checks(plan)
    rng = np.random.default_rng([piece.seed, *piece.case.name.encode()])
    data = arms(problem, piece.arms, _OFFSET_DEG, rng)
    closer = problem.with_geometry(problem.geometry.scaled(1 / _UNDERSTATED, 1 / _UNDERSTATED))
    exact = Problem.from_plan(_exact(plan.plan))
    models: dict[EstimatorName, tuple[Problem, Weigh]] = {
        "freed": (problem, _stated_std),
        "considered": (exact, _considered_std),
        "nominal": (exact, _stated_std),
        "tolerances understated by 3": (closer, _stated_std),
    }
    return GeometryPlan(
        name=piece.case.name,
        words=plan.words,
        chosen_for=piece.case.chosen_for,
        robot=problem.robot.name,
        shots=problem.shots,
        noise=NoiseLevel.of_problem(problem),
        tolerance=piece.case.tolerance,
        arms=len(data.truths),
        failed=data.failed,
        efficiency=None if plan.proposal is None else plan.proposal.efficiency,
        checked=checks,
        estimators=tuple(
            _estimator(name, _errors(data, model, weigh), model, checks)
            for name, (model, weigh) in models.items()
        ),
    )


def _exact(plan: Plan) -> Plan:
    """The plan of an arm and a calibrated tool that are as stated."""
    postures = plan.postures * plan.robot.display
    return Plan.of_postures(with_tolerance(plan.header, None), plan.robot, postures, plan.targets, "study")


def _checks(plan: GeometryPlanStudied) -> tuple[CheckedOffset, ...]:
    """The prediction of `check` for the plan, of an uncertain arm and of an exact one."""
    return tuple(_checked(check(plan.plan), check(_exact(plan.plan))))


def _checked(with_key: Check, without: Check) -> Iterator[CheckedOffset]:
    for row, plain in zip(with_key.parameters, without.parameters, strict=False):
        if row.group == "offset" and not row.held:
            if plain.name != row.name:
                raise ValueError(f"{plain.name} is not {row.name}")
            with_tolerances = with_key.geometry.consider.get(row.name) if has_numbers(plain.status) else None
            yield CheckedOffset(row.name, row.unit, plain.std, with_tolerances, row.std)


def _estimator(
    name: EstimatorName, errors: ArmErrors, solved: Problem, checks: Sequence[CheckedOffset]
) -> GeometryEstimator:
    free = np.flatnonzero(solved.parameters.free & solved.parameters.group("offset"))
    items = [solved.parameters.items[i] for i in free]
    nominal = identify(solved, solved.nominal()).status
    status, control = [nominal[i] for i in free], name in _CONTROLS
    known = [has_numbers(one) for one in status]
    plain = observed(items, status, known, errors.error, errors.std, errors.converged, _ALARM)
    of_check = _CHECKED.get(name, "")
    rows = tuple(
        GeometryParameter(**vars(row), **_z_of(errors, j), checked_std=getattr(checked, of_check, None))
        if row.shares
        else GeometryParameter(**vars(row))
        for j, (row, checked) in enumerate(zip(plain, checks, strict=True))
    )
    agrees = all_agree(rows)
    converged, misfit = int(errors.converged.sum()), int(errors.misfit.sum())
    zs = [row.z for row in rows if row.z is not None]
    more = f", z {min(zs):.2f} to {max(zs):.2f}" if zs else ""
    sentence = worst_share(rows, agrees, control, more=more)
    return GeometryEstimator(
        name=name,
        words=_WORDS[name],
        control=control,
        agrees=agrees,
        converged=converged,
        misfit=misfit,
        sentence=f"{sentence}. {misfit} of {converged} answers say misfit" if zs else sentence,
        parameters=rows,
    )


def _z_of(errors: ArmErrors, j: int) -> Any:
    """The root mean square of the errors of an offset in standard uncertainties, with its 95 % interval."""
    kept = errors.converged & np.isfinite(errors.std[:, j])
    off = errors.error[kept, j] / errors.std[kept, j]
    squares, count = float((off**2).sum()), len(off)
    low, high = (float(np.sqrt(squares / stats.chi2.ppf(tail, count))) for tail in (0.975, 0.025))
    return {"z": float(np.sqrt(squares / count)), "z_low": low, "z_high": high}


def _headline(count: int, plans: Sequence[GeometryPlan]) -> str:
    def of(name: EstimatorName) -> list[tuple[GeometryPlan, GeometryEstimator]]:
        return [(plan, one) for plan in plans for one in plan.estimators if one.name == name]

    def verdict(name: EstimatorName, words: str) -> str:
        short = [plan.name for plan, estimator in of(name) if not estimator.agrees]
        where = f" ({listed(short)})" if short else ""
        return f"{words} {'do not contain' if short else 'contain'} the true value as often as stated{where}"

    zs = [row.z for _, one in of("nominal") for row in one.parameters if row.z is not None]
    controls = [f"{one.name} on {plan.name}" for name in _CONTROLS for plan, one in of(name) if one.agrees]
    parts = [
        f"Over {count} simulated arms of each plan, the 95 % intervals "
        + verdict("freed", "with the geometry estimated")
        + f"; {verdict('considered', 'those of the consider analysis')}.",
        f"With nominal geometry and the noise alone errors are {min(zs):.1f} to {max(zs):.1f} u."
        if zs
        else "",
        f"Not detected: {listed(controls)}." if controls else "Every control is detected.",
    ]
    return " ".join(part for part in parts if part)
