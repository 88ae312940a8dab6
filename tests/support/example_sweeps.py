"""Studies over settings made up for tests of their pages, one for each form of the axes, and hostile ones."""

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from example_results import HOSTILE_NAMES

from zerobeam.experiments.studies.answer import share_interval
from zerobeam.experiments.studies.sweeps.grid_answer import (
    CaseParameter,
    GridAxis,
    GridCase,
    GridSettings,
    GridStudy,
    LikelihoodErrors,
    RunErrors,
)

RUNS, TOLERANCE = 200, 0.1
_STDS = (0.031, 0.042, 0.036, 0.058, 0.074)  # of δ2 … δ6 for four shots at 0.01° of joint noise


@functools.cache
def shots_sweep() -> GridStudy:
    """One axis of numbers: 3 to 30 shots; three shots determine no offset, four not δ4."""
    rng = np.random.default_rng(2)
    values = (3, 4, 5, 7, 14, 30)
    cases = []
    for i, shots in enumerate(values):
        stds = [math.nan if shots == 3 else std * math.sqrt(2 / (shots - 3)) for std in _STDS[:3]]
        stds[2] = math.nan if shots <= 4 else stds[2]
        cases.append(_case(rng, (i,), f"{shots} measurements by A-optimality", stds, shots))
    return _answer(
        "shots", "How many measurements are needed?", [_axis("plan.shots", "measurements", "", values)], cases
    )


@functools.cache
def patterns_sweep() -> GridStudy:
    """One axis of words: the X-Pattern does not identify δ2, and for the last there is no plan."""
    rng = np.random.default_rng(3)
    plans = (
        ("x-pattern", "postures along x: the second joint hardly moves", (math.nan, 0.21, 0.164, 0.55, 1.9)),
        ("y-pattern", "the paper's seven postures", (0.021, 0.034, 0.029, 0.041, 0.087)),
        ("optimal", "seven measurements chosen by A-optimality", (0.011, 0.014, 0.010, 0.022, 0.043)),
    )  # fmt: skip
    cases = [_case(rng, (i,), words, stds, 7, midpoint=1.6) for i, (_, words, stds) in enumerate(plans)]
    cases.append(GridCase((3,), "a ring about the PSD", reason="only 3 of 400 candidates see the PSD"))
    axis = _axis("plan.kind", "pattern", "", (*(name for name, *_ in plans), "ring"))
    return _answer("patterns", "Which pattern identifies the offsets best?", [axis], cases)


@functools.cache
def map_sweep() -> GridStudy:
    """Two axes of numbers, nothing simulated: positions of the PSD, some degenerate, some out of reach."""
    across, along = (800, 1000, 1400, 1600), (-600, 0, 600)
    cases = []
    for i, x in enumerate(across):
        for j, y in enumerate(along):
            words = f"PSD at x {x} mm, y {y} mm"
            far = math.hypot(x - 1100, y) / 400
            stds = [std * (0.3 + far**2) for std in _STDS]
            if x == 800 and abs(y) < 400:
                stds[0] = math.nan
            if math.hypot(x, y) > 1650:
                cases.append(GridCase((i, j), words, reason="the arm does not reach around the PSD"))
            else:
                cases.append(_case(None, (i, j), words, stds, 7))
    return _answer("psd-position", "Where to place the PSD?", _positions(across, along), cases)


@functools.cache
def geometry_sweep() -> GridStudy:
    """Four axes of numbers, nothing simulated, with cases beside them; more cases than a table has."""
    lines = [
        _axis("target.xyz_mm.z", "PSD height", "mm", (0, 400, 800)),
        _axis("plan.distance_mm", "distance", "mm", (300, 600, 900)),
        _axis("plan.width_mm", "width", "mm", (400, 800, 1600)),
        _axis("plan.roll_deg", "roll", "deg", (-45, 0, 45)),
    ]
    cases = []
    for at in itertools.product(range(3), repeat=4):
        high, near, wide, roll = at
        stds = [std * 40 / (1 + high) / (1 + wide) ** 2 * (1 + near) for std in _STDS]
        if wide == 0 and near == 2:
            stds[0] = math.nan
        if roll == 0 and wide == 2:
            cases.append(GridCase(at, "out of reach", reason=f"no such pattern: at {high}{near}"))
        else:
            cases.append(_case(None, at, "a Y-Pattern", stds, 7))
    study = _answer("y-patterns", "Which Y-Pattern?", lines, cases)
    beside = (
        _case(None, (), "X-Pattern", (math.nan, *_STDS[1:]), 7),
        _case(None, (), "optimal", [std / 4 for std in _STDS], 7),
        GridCase((), "a ring", reason="only 3 of 400 candidates see the PSD"),
    )
    return replace(study, beside=beside)


@functools.cache
def pattern_shots_sweep() -> GridStudy:
    """An axis of words by one of numbers."""
    rng = np.random.default_rng(4)
    patterns, counts = ("x-pattern", "optimal"), (4, 7, 20)
    cases = []
    for i, pattern in enumerate(patterns):
        for j, shots in enumerate(counts):
            factor = (8, 0.7)[i] * math.sqrt(2 / (shots - 3))
            stds = [factor * std for std in _STDS[:2]]
            if i == 0:
                stds[0] = math.nan
            cases.append(
                _case(rng, (i, j), f"{shots} measurements of the {pattern}", stds, shots, midpoint=1.5)
            )
    axes = [_axis("plan.kind", "pattern", "", patterns), _axis("plan.shots", "measurements", "", counts)]
    return _answer("my patterns", "Patterns by measurements", axes, cases)


@functools.cache
def pattern_map_sweep() -> GridStudy:
    """An axis of words by two of numbers, simulated."""
    rng = np.random.default_rng(6)
    patterns, across, along = ("x-pattern", "y-pattern"), (800, 1000), (0, 300)
    cases = []
    for i, pattern in enumerate(patterns):
        for j, x in enumerate(across):
            for k, y in enumerate(along):
                stds = [(6, 1)[i] * std * (0.3 + ((x - 900) / 400) ** 2 + (y / 500) ** 2) for std in _STDS]
                if i == 0 and y == 0:
                    stds[0] = math.nan
                cases.append(_case(rng, (i, j, k), f"{pattern} at {x}, {y}", stds, 7))
    axes = [_axis("plan.kind", "plan", "", patterns), *_positions(across, along)]
    return _answer("patterns", "Where is which pattern best?", axes, cases)


def hostile_sweep() -> GridStudy:
    """Names, words and units that would do harm if they were markup, a path or a command."""
    study = patterns_sweep()
    cases = []
    for i, name in enumerate(HOSTILE_NAMES):
        of = study.cases[i % len(study.cases)]
        parameters = tuple(
            replace(one, name=name) if k == 1 else one for k, one in enumerate(of.parameters[:3])
        )
        cases.append(replace(of, at=(i,), words=name, parameters=parameters))
    cases[0] = replace(
        cases[0],
        parameters=(*cases[0].parameters[:2], replace(cases[0].parameters[2], unit=HOSTILE_NAMES[9])),
    )
    cases[3] = GridCase((3,), HOSTILE_NAMES[3], reason=HOSTILE_NAMES[0])
    axis = _axis(HOSTILE_NAMES[0], HOSTILE_NAMES[1], HOSTILE_NAMES[3], HOSTILE_NAMES)
    settings = study.settings.model_copy(
        update={"robot": HOSTILE_NAMES[4], "held": (HOSTILE_NAMES[6], "x"), "file": HOSTILE_NAMES[0]}
    )
    return replace(
        study,
        study=HOSTILE_NAMES[2],
        title=HOSTILE_NAMES[0],
        headline=HOSTILE_NAMES[1],
        notes=tuple(HOSTILE_NAMES),
        settings=settings,
        axes=(axis,),
        cases=tuple(cases),
    )


def hostile_lines() -> GridStudy:
    """The same along an axis of numbers, by one of words."""
    study = pattern_shots_sweep()
    words, shots = (
        replace(axis, key=name, label=name, unit=HOSTILE_NAMES[4])
        for axis, name in zip(study.axes, HOSTILE_NAMES, strict=False)
    )
    cases = []
    for case in study.cases:
        first, second = case.parameters
        parameters = (replace(first, name=HOSTILE_NAMES[3]), replace(second, name=HOSTILE_NAMES[5]))
        cases.append(replace(case, words=HOSTILE_NAMES[0], parameters=parameters))
    return replace(
        study,
        study=HOSTILE_NAMES[0],
        title=HOSTILE_NAMES[1],
        axes=(replace(words, values=tuple(HOSTILE_NAMES[3:5])), shots),
        cases=tuple(cases),
    )


def hostile_map() -> GridStudy:
    study = map_sweep()
    axes = tuple(
        replace(axis, key=HOSTILE_NAMES[6], label=name, unit=HOSTILE_NAMES[0])
        for axis, name in zip(study.axes, HOSTILE_NAMES, strict=False)
    )
    cases = tuple(replace(case, reason=HOSTILE_NAMES[1]) if case.reason else case for case in study.cases)
    return replace(study, study=HOSTILE_NAMES[6], axes=axes, cases=cases)


def long_sweep(count: int = 200) -> GridStudy:
    """One axis of so many words."""
    study = patterns_sweep()
    names = tuple(f"plan {i}" for i in range(count))
    cases = tuple(replace(study.cases[1], at=(i,), words=name) for i, name in enumerate(names))
    return replace(study, axes=(replace(study.axes[0], values=names),), cases=cases)


def with_parameter(study: GridStudy, case: int, parameter: int, **changes: object) -> GridStudy:
    """The study with something changed of one parameter of one case."""
    of = study.cases[case]
    parameters = list(of.parameters)
    parameters[parameter] = replace(parameters[parameter], **changes)  # type: ignore[arg-type]
    cases = list(study.cases)
    cases[case] = replace(of, parameters=tuple(parameters))
    return replace(study, cases=tuple(cases))


def _axis(key: str, label: str, unit: str, values: Sequence[int | str]) -> GridAxis:
    return GridAxis(key, label, unit, tuple(values), tuple({key: value} for value in values))


def _positions(across: Sequence[int], along: Sequence[int]) -> list[GridAxis]:
    return [_axis("target.xyz_mm.x", "PSD x", "mm", across), _axis("target.xyz_mm.y", "PSD y", "mm", along)]


def _answer(name: str, title: str, axes: list[GridAxis], cases: list[GridCase]) -> GridStudy:
    settings = GridSettings.model_validate(
        {
            "robot": "irb1600",
            "tool": {"kind": "laser", "point_mm": [0, 0, 65], "direction": [1, 0, 0]},
            "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
            "target": {"xyz_mm": [900, 0, 0]},
            "runs": RUNS,
            "seed": 0,
            "level": 0.95,
            "chance": 0.01,
            "file": "study.yaml",
            "sha256": "0" * 64,
        }
    )
    return GridStudy(
        study=name,
        title=title,
        headline="What was predicted is what the simulated runs show.",
        agrees=True,
        settings=settings,
        seconds=12.34,
        versions={"zerobeam": "0.1.0", "numpy": "2.3.4"},
        notes=("delta1 is held: it defines the base frame, and no data determine it.",),
        axes=tuple(axes),
        cases=tuple(cases),
    )


def _case(
    rng: np.random.Generator | None,
    at: tuple[int, ...],
    words: str,
    stds: Sequence[float],
    shots: int,
    midpoint: float | None = None,
) -> GridCase:
    """A case with the stds of δ2, δ3, …, NaN where unidentifiable; without `rng` nothing is simulated."""
    worst = None if any(map(math.isnan, stds)) else max(stds)
    return GridCase(
        at,
        words,
        shots=shots,
        verdict="degenerate" if worst is None else "weak" if worst > TOLERANCE else "pass",
        worst_std=worst,
        parameters=tuple(_parameter(rng, f"delta{i}", std, midpoint) for i, std in enumerate(stds, start=2)),
    )


def _parameter(
    rng: np.random.Generator | None, name: str, std: float, midpoint: float | None
) -> CaseParameter:
    if math.isnan(std):
        return CaseParameter(name, "deg", "unidentifiable", "offset")
    one = CaseParameter(name, "deg", "weak" if std > TOLERANCE else "identified", "offset", std)
    if rng is None:
        return one
    held = int(rng.binomial(RUNS, 0.95))
    low, high = share_interval(held, RUNS)
    likelihood = LikelihoodErrors(*_errors(rng, std), held / RUNS, low, high, 1.0, True)
    other = RunErrors(*_errors(rng, midpoint * std)) if midpoint else None
    return replace(one, likelihood=likelihood, midpoint=other)


def _errors(rng: np.random.Generator, std: float) -> tuple[int, float, float, float]:
    rmse = std * (1 + rng.normal() / math.sqrt(2 * RUNS))
    bias_std = rmse / math.sqrt(RUNS)
    return RUNS, rmse, rng.normal() * bias_std, bias_std
