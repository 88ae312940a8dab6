"""What does an answer say when something is wrong? Many wrong models, each with random arms, analysed.

Each arm has deviations of typical sizes and one thing that is wrong (`wrong_arms`); it is solved and
judged as `analyse` does with a header that states nothing of the geometry. Counted are verdicts, errors of
the offsets of those that pass, and whether the diagnosis of a misfit names the cause. The first scenario is
the control.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ...analysis.diagnostics.diagnosis import Explanation, diagnose
from ...analysis.ladder import solve_run
from ...analysis.observability.changes import Displacement, RunChange
from ...analysis.solution import Solution
from ...model.arrays import Matrix
from ...model.files.header import Header
from ...model.instruments.flange_tool import flange_tool
from ...model.kernel import one_blas_thread
from ...model.likelihood.problem import Problem
from ...model.records import it
from ...words.wording import listed
from .answer import StudyAnswer
from .cases import Engine
from .data_sets import laser_header, planner, robot_of
from .wrong_arms import Course, Scenario, recorded, scenarios, typical

MEASUREMENTS = (7, 12, 30)
LIMIT_U = 4.0
MOST_BEYOND = 0.01  # of the arms of a scenario
LEAST_NAMED = 0.9  # of the misfits that the measurements decide
DECIDED = 20.0  # evidence ratio to the next best from which on they do
_FEWEST_TO_NAME = 12
_CANDIDATES = 400
_JOINT_DEG, _SPOT_MM = 0.01, 0.05
_TARGETS = {
    "irb1600": (950.0, 150.0, 100.0),
    "kr6_r900_2": (600.0, 100.0, 100.0),
    "irb120": (420.0, 80.0, 80.0),
}


@dataclass(frozen=True)
class WrongModelsSettings:
    """How the study was carried out."""

    arms: Annotated[int, it("arms of each scenario")]
    seed: Annotated[int, it("seed")]
    measurements: Annotated[tuple[int, ...], it("measurements")]
    limit_u: Annotated[float, it("error of an offset that a pass must not have, in its u")]
    decided: Annotated[float, it("evidence ratio from which on a cause counts as decided")]


@dataclass(frozen=True)
class WrongModel:
    """One scenario with so many measurements: of `arms`, those that pass, are a misfit, or neither (`weak`).

    Of those that pass: `z` the root mean square and `largest_u` the largest error of an offset in its
    standard uncertainty, and how many have one `beyond` the limit; `unsaid` those of them whose pass is not
    subject to the absence of just this. `nameable` says that there is a cause by
    which it can be named; `named` counts the misfits that have it as their best explanation, `decided` those
    whose best explanation the measurements decide, `decided_right` those where it is the right one.
    `noticeable` is false where no measurement of this kind could show it.
    """

    scenario: str
    measurements: int
    arms: int
    passes: int
    misfits: int
    weak: int
    z: float | None
    largest_u: float | None
    beyond: int
    unsaid: int
    nameable: bool
    noticeable: bool
    named: int
    decided: int
    decided_right: int

    @property
    def holds(self) -> bool:
        """No pass that is not subject to its absence has an offset beyond the limit, but for one arm in a
        hundred."""
        return self.unsaid <= MOST_BEYOND * self.arms


@dataclass(frozen=True, kw_only=True)
class WrongModelsStudy(StudyAnswer):
    """The whole answer."""

    settings: WrongModelsSettings
    models: tuple[WrongModel, ...]


def wrong_models_study(
    arms: int,
    engine: Engine,
    *,
    names: Sequence[str] | None = None,
    measurements: Sequence[int] = MEASUREMENTS,
) -> WrongModelsStudy:
    """Carry the study out, of all scenarios or of those with these `names`."""
    chosen = [one for one in scenarios() if names is None or one.name in names]
    engine.progress("plans", 0.0)
    robots = dict.fromkeys(one.measured for one in chosen)
    plans = {(robot, count): plan_of(robot, count, engine.seed) for robot in robots for count in measurements}
    pieces = [
        (one.name, plans[one.measured, count], arms, engine.seed) for one in chosen for count in measurements
    ]
    counts, of = list(measurements), len(chosen)
    models = engine.each(
        "wrong-models", WrongModel, _model_of, pieces, arms=arms, measurements=counts, scenarios=of
    )
    broken = list(dict.fromkeys(one.scenario for one in models if not one.holds))
    # Whose cause is named wrong in more than one of ten decided misfits.
    nameable = [one for one in models if one.nameable and one.measurements >= _FEWEST_TO_NAME]
    wrong = [one.scenario for one in nameable if one.decided_right < LEAST_NAMED * one.decided]
    unnamed = list(dict.fromkeys(wrong))
    right, decided = (sum(getattr(one, key) for one in nameable) for key in ("decided_right", "decided"))
    parts = [
        f"{len({one.scenario for one in models})} scenarios: of {decided} misfits whose cause"
        f" {_FEWEST_TO_NAME} measurements or more decide, {right} name the right one.",
        f"Passes with an offset beyond {LIMIT_U:g} u and without a warning: {listed(broken, 12)}."
        if broken
        else "In no scenario do more than 1 % of the arms pass with an offset beyond"
        f" {LIMIT_U:g} u and without a warning.",
        *([f"Named wrong too often: {listed(unnamed, 8)}."] if unnamed else []),
    ]
    return WrongModelsStudy(
        study="wrong-models",
        title="What does an answer say when something is wrong?",
        headline=" ".join(parts),
        agrees=not broken and not unnamed,
        notes=(
            "Each arm has links, gravity, harmonics and a tool that deviate by the default tolerances, a"
            " backlash of 0.01° and offsets of 0.5°, by a simulator of the study's own. The header states no"
            " geometry.",
            "Where something changes during the run, the true offsets are those at its beginning.",
        ),
        settings=WrongModelsSettings(arms, engine.seed, tuple(measurements), LIMIT_U, DECIDED),
        models=tuple(models),
    )


def header_of(robot: str) -> Header:
    """The header of a run of this arm with the laser and the PSD of the study: nothing of the geometry."""
    return laser_header(_JOINT_DEG, _SPOT_MM, 30.0, robot=robot, target=_TARGETS[robot], exact=False)


def plan_of(robot: str, count: int, seed: int) -> Matrix:
    """(count, n) rad: the best of some random postures."""
    return planner(header_of(robot), _CANDIDATES, seed).optimal(count, seed=seed).postures


def _model_of(piece: tuple[str, Matrix, int, int]) -> WrongModel:
    """A scenario by its name with the postures of a plan; so many arms, with a seed."""
    name, postures, arms, seed = piece
    (scenario,) = (one for one in scenarios() if one.name == name)
    with one_blas_thread():
        judged = [
            (course, solution, diagnose(solution))
            for course, solution in _solved(scenario, postures, arms, seed)
        ]
    passes = [(_errors(course, one), one) for course, one, _ in judged if one.verdict == "pass"]
    # The wrong models without which a pass is stated.
    beyond = [
        {row.wrong for row in one.power if row.dangerous}
        for off, one in passes
        if (np.abs(off) > LIMIT_U).any()
    ]
    misfits = [_named(solution, explained) for _, solution, explained in judged if solution.misfit]
    right = [decided for cause, joints, decided in misfits if scenario.is_named_by(cause, joints)]
    errors = np.concatenate([off for off, _ in passes]) if passes else np.zeros(0)
    return WrongModel(
        scenario=scenario.name,
        measurements=len(postures),
        arms=len(judged),
        passes=len(passes),
        misfits=len(misfits),
        weak=len(judged) - len(passes) - len(misfits),
        z=float(np.sqrt((errors**2).mean())) if len(errors) else None,
        largest_u=float(np.abs(errors).max()) if len(errors) else None,
        beyond=len(beyond),
        unsaid=sum(scenario.condition not in subject_to for subject_to in beyond),
        nameable=bool(scenario.named),
        noticeable=scenario.noticeable,
        named=len(right),
        decided=sum(decided for _, _, decided in misfits),
        decided_right=sum(right),
    )


def _named(solution: Solution, explained: Sequence[Explanation]) -> tuple[str, tuple[int, ...], bool]:
    """Cause and joints by which a misfit is named first, and whether the measurements decide that: the best
    explanation leaves its rivals of other causes behind."""
    if explained:
        best = explained[0]
        rivals = [one.odds for one in explained if (one.cause, one.joints) != (best.cause, best.joints)]
        return best.cause, best.joints, max(rivals, default=0.0) * DECIDED < 1
    assert solution.misfit is not None
    for one in solution.misfit.criteria:
        if isinstance(one, RunChange):
            return one.how, () if one.joint is None else (one.joint,), not one.elsewhere
        if isinstance(one, Displacement):
            return one.kind, (), not one.elsewhere and one.alone is None
    return "", (), False


def _solved(scenario: Scenario, postures: Matrix, arms: int, seed: int) -> list[tuple[Course, Solution]]:
    """So many arms of a scenario, measured and solved."""
    count, header = len(postures), header_of(scenario.measured)
    robot = robot_of(header)
    nominal = Problem.build(header, robot, postures, ["psd"] * count)
    tool, target = flange_tool(nominal.tool), np.array(_TARGETS[scenario.measured])
    wrong, solved = scenario.robot(robot), list[tuple[Course, Solution]]()
    for tried in range(3 * arms):
        rng = np.random.default_rng([seed, count, tried])
        course = scenario.course(typical(robot, nominal.geometry, tool, target, count, rng))
        readings = recorded(course, postures, nominal.noise.joint, nominal.noise.spot, tool, rng)
        if readings is not None:
            joints, spots = scenario.readings(*readings)
            problem = Problem.build(header, wrong, joints, ["psd"] * count, spots)
            solved.append((course, solve_run(problem, header)))
        if len(solved) == arms:
            break
    return solved


def _errors(course: Course, solution: Solution) -> Matrix:
    """Errors of the offsets in their standard uncertainties."""
    true = np.degrees(course.offsets[0])
    return np.array(
        [
            (row.estimate - true[int(row.name.removeprefix("delta")) - 1]) / row.std
            for row in solution.offsets
            if row.estimate is not None and row.std is not None and not row.held
        ]
    )
