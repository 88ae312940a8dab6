"""Do the intervals hold if the arm deviates from nominal geometry? Random arms, solved in several ways.

Every simulated arm has offsets and links of its own, and measures a plan once, with noise. Its measurements
are solved with the geometry estimated, and with nominal geometry: with the uncertainty of the consider
analysis, and with that of the noise alone, which is the control that must fail. The fits and statuses are
those of `analyse` (`fit_each`, `judge`). The plans are of the laser of the demo run, and of a probe with
several targets.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Literal, NamedTuple, get_args

import numpy as np
from scipy import stats

from ...analysis.estimation.fit import fit_each, single
from ...analysis.observability.check import check
from ...analysis.observability.geometry_result import considered
from ...analysis.solution import Solution, judge
from ...analysis.status import has_numbers
from ...model.arrays import Matrix
from ...model.files.from_arrays import Probe
from ...model.files.header import EXACT, Header
from ...model.files.plan import Plan
from ...model.kinematics.robot import Robot
from ...model.likelihood.problem import Problem
from ...model.records import it
from ...words.numbers import percent
from ...words.wording import listed
from ..plans.candidates import Planned, candidates
from ..plans.optimal import Planner
from .answer import (
    ALARM,
    JudgedEstimator,
    NoiseLevel,
    ObservedParameter,
    PlanOfStudy,
    StudyAnswer,
    estimated,
    judged_shares,
    observed,
)
from .cases import Engine
from .data_sets import DataSets, drawn, laser_header, planner, robot_of

ChosenFor = Literal["nominal", "freed"]

MEASUREMENTS = (7, 12, 20, 40)
CLOSE_MEASUREMENTS = (7, 12)
CANDIDATES = 10_000  # as `zerobeam plan optimal`
_SOCKETS_APART_MM, _PER_SOCKET = 50.0, 10
_PLACEMENTS = {"front": (500.0, 0.0, 100.0), "left": (300.0, 450.0, 250.0), "right": (350.0, -400.0, 20.0)}
_TIP_MM = 2.0  # of a free tip from where the header has it: far less than its prior
_LEVEL = 0.95
_OFFSET_DEG = 1.0  # of the simulated arms
_UNDERSTATED = 3.0
# Words of each estimator, and what `check` predicts for it.
_ESTIMATORS = {
    "freed": ("geometry estimated, its tolerances as priors", "freed"),
    "considered": ("nominal geometry, its uncertainty by the consider analysis", "considered"),
    "nominal": ("control: nominal geometry, its uncertainty by the noise alone", "noise_only"),
    "tolerances understated by 3": ("control: geometry estimated, its tolerances stated as a third", ""),
}


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


class GeometryPlanStudied(NamedTuple):
    """A plan with `geometry` in its header; its certified `efficiency`, None where nothing was chosen."""

    words: str
    plan: Plan
    efficiency: float | None = None


def with_tolerance(header: Header, tolerance: ToleranceLevel | None) -> Header:
    """The header with link geometry as uncertain as that, without gravity and harmonics; exact for None."""
    content = header.model_dump(by_alias=True, exclude_none=True, exclude_unset=True)
    content["geometry"] = EXACT
    if tolerance is not None:
        content["geometry"] = {"tolerance": vars(tolerance), "gravity": False, "harmonics": False}
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
    return GeometryPlanStudied(words, plan, proposal.efficiency)


def _probe(case: PlanCase, seed: int) -> GeometryPlanStudied:
    """Pairs of sockets at a stated distance, each met from random postures; the tip is free."""
    targets, distances = {}, []
    for name, (x, y, z) in _PLACEMENTS.items():
        pair = [f"{name}_{k}" for k in range(2)]
        for k, socket in enumerate(pair):
            targets[socket] = {"guess_mm": [x + k * _SOCKETS_APART_MM, y, z], "sigma_mm": 30.0}
        distances.append({"between": pair, "mm": _SOCKETS_APART_MM, "sigma_mm": 0.1})
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
        at, measured = np.array(target["guess_mm"]), Planned(header.labels[0], target=name)
        postures.append(candidates(header, robot, at, _PER_SOCKET, seed=seed + k, planned=measured).postures)
        names += [name] * len(postures[-1])
    header = with_tolerance(Header.model_validate({**content, "distances": distances}), case.tolerance)
    words = (
        f"probe with a free tip, {len(_PLACEMENTS)} pairs of sockets, {_PER_SOCKET} random postures at each"
    )
    return GeometryPlanStudied(words, _plan(header, robot, np.concatenate(postures), names))


def _plan(header: Header, robot: Robot, postures: Matrix, targets: list[str]) -> Plan:
    return Plan.of_postures(header, robot, np.round(postures * robot.display, 6), targets, "study")


def exact(plan: Plan) -> Plan:
    """The plan of an arm and a calibrated tool that are as stated."""
    postures = plan.postures * plan.robot.display
    return Plan.of_postures(with_tolerance(plan.header, None), plan.robot, postures, plan.targets, "study")


def checks(plan: Plan) -> tuple[CheckedOffset, ...]:
    """The prediction of `check` for a plan, of an uncertain arm and of an exact one, by the offset."""
    with_key, without = check(plan), check(exact(plan))
    rows = []
    for row, plain in zip(with_key.parameters, without.parameters, strict=False):
        if row.group == "offset" and not row.held:
            if plain.name != row.name:
                raise ValueError(f"{plain.name} is not {row.name}")
            with_tolerances = with_key.geometry.consider.get(row.name) if has_numbers(plain.status) else None
            rows.append(CheckedOffset(row.name, row.unit, plain.std, with_tolerances, row.std))
    return tuple(rows)


def arms(problem: Problem, count: int, offset_deg: float, rng: np.random.Generator) -> DataSets:
    """So many arms with random offsets (and a free tip that is a little off), and links off by their
    tolerances, each measured once."""
    parameters = problem.parameters
    spread = np.where(parameters.group("offset"), offset_deg / parameters.display, 0.0)
    spread = np.where(parameters.group("tool"), np.minimum(parameters.prior_std, _TIP_MM), spread)
    spread = np.where(parameters.group("geometry"), parameters.prior_std, spread)
    return drawn(problem, count, rng, spread)


Weigh = Callable[[Solution, Problem], Matrix]  # the std (p,) stated with a solution, internal units


def _stated_std(solution: Solution, whole: Problem) -> Matrix:
    return solution.std


def _considered_std(solution: Solution, whole: Problem) -> Matrix:
    parameters = whole.parameters
    x = parameters.with_values(parameters.prior_mean, solution.problem.parameters, solution.fit.x)
    at = [parameters.index(name) for name in solution.problem.parameters.names]
    return np.where([has_numbers(status) for status in solution.status], considered(whole, x)[at], np.nan)


def geometry_study(
    count: int, engine: Engine, *, candidates: int = CANDIDATES, cases: Sequence[PlanCase] = PLAN_CASES
) -> GeometryStudy:
    """Carry out the whole study with `count` arms for each plan.

    It agrees if the intervals with estimated geometry and those of the consider analysis contain the true
    value as often as stated on every plan, and every control is detected.
    """
    pieces = [ArmsOfPlan(case, count, engine.seed, candidates) for case in cases]
    answers = engine.each("geometry", GeometryPlan, answer_of, pieces, arms=count, candidates=candidates)
    return GeometryStudy(
        study="geometry",
        title="Do the intervals hold if the arm deviates from nominal geometry?",
        headline=_headline(count, answers),
        agrees=all(one.agrees is not one.control for answer in answers for one in answer.estimators),
        settings=GeometrySettings(count, engine.seed, _LEVEL, ALARM, candidates, _OFFSET_DEG),
        plans=tuple(answers),
        notes=(
            f"Every arm has offsets of {_OFFSET_DEG:g}° (one standard deviation), links off by the stated"
            " tolerances, and noise of its own. Gravity and harmonics are neither simulated nor estimated.",
            "An interval is estimate ± 1.96 u, from the curvature at the mode. It counts where the arm's own"
            " answer determines the offset; where that says misfit, its numbers count as well: the control"
            " shows what they are worth.",
            f"An estimator agrees if the p-value of none of its shares is below {percent(ALARM)} over its"
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
    problem, checked = Problem.from_plan(plan.plan), checks(plan.plan)
    rng = np.random.default_rng([piece.seed, *piece.case.name.encode()])
    data = arms(problem, piece.arms, _OFFSET_DEG, rng)
    closer = problem.with_geometry(problem.geometry.scaled(1 / _UNDERSTATED, 1 / _UNDERSTATED))
    nominal = Problem.from_plan(exact(plan.plan))
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
        efficiency=plan.efficiency,
        checked=checked,
        estimators=(
            _estimator("freed", data, problem, _stated_std, checked),
            _estimator("considered", data, nominal, _considered_std, checked),
            _estimator("nominal", data, nominal, _stated_std, checked),
            _estimator("tolerances understated by 3", data, closer, _stated_std, checked),
        ),
    )


def _estimator(
    name: str, data: DataSets, solved: Problem, weigh: Weigh, checked: Sequence[CheckedOffset]
) -> GeometryEstimator:
    """By the fits of `solved`, with the stds that `weigh` has of them, nan where an arm's own answer does not
    determine an offset."""
    fits, at = fit_each(solved, data.joints, data.spots), estimated(solved)
    std, misfit = np.full((len(fits.x), len(at)), np.nan), 0
    for i, (joints, spots) in enumerate(zip(data.joints, data.spots, strict=True)):
        solution = judge(single(solved.moved(joints, spots), fits, i))
        misfit += solution.misfit is not None
        std[i] = weigh(solution, data.problem.moved(joints, spots))[at]
    display = solved.parameters.display[at]
    error = (fits.x[:, at] - data.truths[:, at]) * display  # offsets come first, whatever the geometry
    error, std = np.where(np.isnan(std), np.nan, error), std * display
    words, of_check = _ESTIMATORS[name]
    rows, zs = list[GeometryParameter](), list[float]()
    for j, plain in enumerate(observed(solved, error, std, fits.converged)):
        row = GeometryParameter(**vars(plain))
        if row.shares:
            # The root mean square of the errors in standard uncertainties, with its 95 % interval.
            kept = fits.converged & np.isfinite(std[:, j])
            squares, count = float(((error[kept, j] / std[kept, j]) ** 2).sum()), int(kept.sum())
            quantiles = (count, *(stats.chi2.ppf(tail, count) for tail in (0.975, 0.025)))
            z, low, high = (float(np.sqrt(squares / over)) for over in quantiles)
            u = getattr(checked[j], of_check, None)
            row = GeometryParameter(**vars(plain), z=z, z_low=low, z_high=high, checked_std=u)
            zs.append(z)
        rows.append(row)
    control, converged = words.startswith("control"), int(fits.converged.sum())
    more = f", z {min(zs):.2f} to {max(zs):.2f}" if zs else ""
    agrees, sentence = judged_shares(rows, control, more=more)
    return GeometryEstimator(
        name=name,
        words=words,
        control=control,
        agrees=agrees,
        converged=converged,
        misfit=misfit,
        sentence=f"{sentence}. {misfit} of {converged} answers say misfit" if zs else sentence,
        parameters=tuple(rows),
    )


def _headline(count: int, plans: Sequence[GeometryPlan]) -> str:
    every = [(plan, one) for plan in plans for one in plan.estimators]

    def verdict(name: str, words: str) -> str:
        short = [plan.name for plan, one in every if one.name == name and not one.agrees]
        where = f" ({listed(short)})" if short else ""
        return f"{words} {'do not contain' if short else 'contain'} the true value as often as stated{where}"

    zs = [row.z for _, one in every if one.name == "nominal" for row in one.parameters if row.z is not None]
    controls = [
        f"{one.name} on {plan.name}"
        for name in _ESTIMATORS
        for plan, one in every
        if one.name == name and one.control and one.agrees
    ]
    parts = [
        f"Over {count} simulated arms of each plan, the 95 % intervals"
        f" {verdict('freed', 'with the geometry estimated')};"
        f" {verdict('considered', 'those of the consider analysis')}.",
        f"With nominal geometry and the noise alone errors are {min(zs):.1f} to {max(zs):.1f} u."
        if zs
        else "",
        f"Not detected: {listed(controls)}." if controls else "Every control is detected.",
    ]
    return " ".join(part for part in parts if part)
