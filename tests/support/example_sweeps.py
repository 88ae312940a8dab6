"""Sweeps made up for the tests of their pages, one for each form of the axes, and a hostile one."""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from example_results import HOSTILE_NAMES
from scipy.stats import binomtest

Json = dict[str, Any]

RUNS, TOLERANCE = 200, 0.1
# What no page may show where a case cannot tell the offset.
FORBIDDEN = 1.23456789
_STDS = (0.031, 0.042, 0.036, 0.058, 0.074)  # of δ2 … δ6 for four shots at 0.01° of joint noise


def shots_sweep() -> Json:
    """One axis of numbers: 3 to 30 shots; three shots determine no offset, four not δ4."""
    return copy.deepcopy(_shots())


def patterns_sweep() -> Json:
    """One axis of words: the X-Pattern cannot tell δ2, and for the last there is no plan."""
    return copy.deepcopy(_patterns())


def map_sweep() -> Json:
    """Two axes of numbers, nothing simulated: places of the PSD, some degenerate, some out of reach."""
    return copy.deepcopy(_map())


def pattern_shots_sweep() -> Json:
    """An axis of words by one of numbers."""
    return copy.deepcopy(_pattern_shots())


def pattern_map_sweep() -> Json:
    """An axis of words by two of numbers, simulated."""
    return copy.deepcopy(_pattern_map())


def hostile_sweep() -> Json:
    """Names, words and units that would do harm if they were markup, a path or a command."""
    answer = patterns_sweep()
    answer["study"], answer["title"], answer["headline"] = HOSTILE_NAMES[2], *HOSTILE_NAMES[:2]
    answer["notes"] = list(HOSTILE_NAMES)
    answer["settings"][HOSTILE_NAMES[0]] = {HOSTILE_NAMES[4]: [HOSTILE_NAMES[6], 1.5]}
    (axis,) = answer["axes"]
    axis |= {"key": HOSTILE_NAMES[0], "label": HOSTILE_NAMES[1], "unit": HOSTILE_NAMES[3]}
    axis["values"] = list(HOSTILE_NAMES)
    told = answer["cases"]
    answer["cases"] = [
        {
            **(of := copy.deepcopy(told[i % len(told)])),
            "at": [i],
            "words": name,
            "parameters": of["parameters"][:3],
        }
        for i, name in enumerate(HOSTILE_NAMES)
    ]
    answer["cases"][3]["reason"] = HOSTILE_NAMES[0]
    for case, name in zip(answer["cases"], HOSTILE_NAMES, strict=True):
        for row in case["parameters"][1:2]:
            row["name"] = name
    answer["cases"][0]["parameters"][2]["unit"] = HOSTILE_NAMES[9]
    return answer


def hostile_lines() -> Json:
    """The same along an axis of numbers, by one of words."""
    answer = pattern_shots_sweep()
    answer["study"], answer["title"] = HOSTILE_NAMES[0], HOSTILE_NAMES[1]
    for axis, name in zip(answer["axes"], HOSTILE_NAMES, strict=False):
        axis |= {"key": name, "label": name, "unit": HOSTILE_NAMES[4]}
    answer["axes"][0]["values"] = list(HOSTILE_NAMES[3:5])
    for case in answer["cases"]:
        case["words"] = HOSTILE_NAMES[0]
        case["parameters"][0]["name"] = HOSTILE_NAMES[3]
        case["parameters"][1]["name"] = HOSTILE_NAMES[5]
    return answer


def hostile_map() -> Json:
    answer = map_sweep()
    answer["study"] = HOSTILE_NAMES[6]
    for axis, name in zip(answer["axes"], HOSTILE_NAMES, strict=False):
        axis |= {"key": HOSTILE_NAMES[6], "label": name, "unit": HOSTILE_NAMES[0]}
    for case in answer["cases"]:
        if case["reason"] is not None:
            case["reason"] = HOSTILE_NAMES[1]
    return answer


def long_sweep(count: int = 200) -> Json:
    """One axis of so many words."""
    answer = patterns_sweep()
    told = answer["cases"][1]
    answer["axes"][0]["values"] = [f"plan {i}" for i in range(count)]
    answer["cases"] = [{**copy.deepcopy(told), "at": [i], "words": f"plan {i}"} for i in range(count)]
    return answer


@functools.cache
def _shots() -> Json:
    rng = np.random.default_rng(2)
    values = [3, 4, 5, 7, 14, 30]
    cases = []
    for i, shots in enumerate(values):
        stds = [math.nan if shots == 3 else std * math.sqrt(2 / (shots - 3)) for std in _STDS[:3]]
        stds[2] = math.nan if shots <= 4 else stds[2]
        cases.append(_case(rng, (i,), f"{shots} shots by A-optimality", stds, shots))
    axes = [{"key": "plan.shots", "label": "shots", "unit": "", "values": values}]
    return _answer("shots", "How many shots are needed?", axes, cases)


@functools.cache
def _patterns() -> Json:
    rng = np.random.default_rng(3)
    plans = (
        ("x-pattern", "postures along x: the second joint hardly moves", (math.nan, 0.21, 0.164, 0.55, 1.9)),
        ("y-pattern", "the paper's seven postures", (0.021, 0.034, 0.029, 0.041, 0.087)),
        ("optimal", "seven shots chosen by A-optimality", (0.011, 0.014, 0.010, 0.022, 0.043)),
    )  # fmt: skip
    cases = [_case(rng, (i,), words, stds, 7, midpoint=1.6) for i, (_, words, stds) in enumerate(plans)]
    cases.append(_no_plan((3,), "a ring about the PSD", "only 3 of 400 candidates see the PSD"))
    values = [*(name for name, *_ in plans), "ring"]
    axes = [{"key": "plan.kind", "label": "pattern", "unit": "", "values": values}]
    return _answer("patterns", "Which pattern tells the offsets best?", axes, cases)


@functools.cache
def _map() -> Json:
    across, along = [800, 1000, 1400, 1600], [-600, 0, 600]
    cases = []
    for i, x in enumerate(across):
        for j, y in enumerate(along):
            words = f"PSD at x {x} mm, y {y} mm"
            far = math.hypot(x - 1100, y) / 400
            stds = [std * (0.3 + far**2) for std in _STDS]
            if x == 800 and abs(y) < 400:
                stds[0] = math.nan
            if math.hypot(x, y) > 1650:
                cases.append(_no_plan((i, j), words, "the arm does not reach around the PSD"))
            else:
                cases.append(_case(None, (i, j), words, stds, 7))
    axes = [
        {"key": "target.xyz_mm.x", "label": "PSD x", "unit": "mm", "values": across},
        {"key": "target.xyz_mm.y", "label": "PSD y", "unit": "mm", "values": along},
    ]
    return _answer("psd-position", "Where should the PSD stand?", axes, cases)


@functools.cache
def _pattern_shots() -> Json:
    rng = np.random.default_rng(4)
    patterns, counts = ["x-pattern", "optimal"], [4, 7, 20]
    cases = []
    for i, pattern in enumerate(patterns):
        for j, shots in enumerate(counts):
            factor = (8, 0.7)[i] * math.sqrt(2 / (shots - 3))
            stds = [factor * std for std in _STDS[:2]]
            if i == 0:
                stds[0] = math.nan
            cases.append(_case(rng, (i, j), f"{shots} shots of the {pattern}", stds, shots, midpoint=1.5))
    axes = [
        {"key": "plan.kind", "label": "pattern", "unit": "", "values": patterns},
        {"key": "plan.shots", "label": "shots", "unit": "", "values": counts},
    ]
    return _answer("my patterns", "Patterns by shots", axes, cases)


@functools.cache
def _pattern_map() -> Json:
    rng = np.random.default_rng(6)
    across, along = [800, 1000], [0, 300]
    cases = []
    for i, pattern in enumerate(("x-pattern", "y-pattern")):
        for j, x in enumerate(across):
            for k, y in enumerate(along):
                stds = [(6, 1)[i] * std * (0.3 + ((x - 900) / 400) ** 2 + (y / 500) ** 2) for std in _STDS]
                if i == 0 and y == 0:
                    stds[0] = math.nan
                cases.append(_case(rng, (i, j, k), f"{pattern} at {x}, {y}", stds, 7))
    axes = [
        {"key": "plan.kind", "label": "plan", "unit": "", "values": ["x-pattern", "y-pattern"]},
        {"key": "target.xyz_mm.x", "label": "PSD x", "unit": "mm", "values": across},
        {"key": "target.xyz_mm.y", "label": "PSD y", "unit": "mm", "values": along},
    ]
    return _answer("patterns", "Where is which pattern best?", axes, cases)


def _answer(name: str, title: str, axes: list[Json], cases: list[Json]) -> Json:
    return {
        "schema": "zerobeam/study/1",
        "study": name,
        "title": title,
        "headline": "What was predicted is what the simulated runs show.",
        "agrees": True,
        "settings": {
            "robot": "irb1600",
            "plan": {"kind": "optimal", "shots": 7, "facing": [0.0, 0.0, 1.0], "span": None},
            "runs": RUNS,
            "costs": ["likelihood"],
            "seed": 0,
            "level": 0.95,
            "tolerance": {"offset_deg": TOLERANCE, "length_mm": 1.0, "tilt_deg": 0.1},
        },
        "seconds": 12.34,
        "versions": {"zerobeam": "0.1.0", "numpy": "2.3.4"},
        "notes": ["delta1 is held: it is the base frame, and no data tell it."],
        "axes": [{**axis, "set": [{axis["key"]: value} for value in axis["values"]]} for axis in axes],
        "cases": cases,
    }


def _case(
    rng: np.random.Generator | None,
    at: Sequence[int],
    words: str,
    stds: Sequence[float],
    shots: int,
    midpoint: float | None = None,
) -> Json:
    """A case with the stds of δ2, δ3, …, NaN where it cannot tell; without `rng` nothing is simulated."""
    rows = [_parameter(rng, f"delta{i}", std, midpoint) for i, std in enumerate(stds, start=2)]
    untold = any(math.isnan(std) for std in stds)
    worst = None if untold else max(stds)
    return {
        "at": list(at),
        "words": words,
        "reason": None,
        "shots": shots,
        "failed": 0,
        "unmet": 0,
        "verdict": "degenerate" if worst is None else "weak" if worst > TOLERANCE else "pass",
        "worst_std": worst,
        "parameters": rows,
    }


def _no_plan(at: Sequence[int], words: str, reason: str) -> Json:
    told: Json = {"at": list(at), "words": words, "reason": reason, "parameters": []}
    return told | {"failed": 0, "unmet": 0} | dict.fromkeys(("shots", "verdict", "worst_std"))


def _parameter(rng: np.random.Generator | None, name: str, std: float, midpoint: float | None) -> Json:
    row: Json = {"name": name, "unit": "deg"}
    if math.isnan(std):
        return {**row, "status": "unidentifiable", "std": None, "likelihood": None, "midpoint": None}
    row |= {"status": "weak" if std > TOLERANCE else "identified", "std": std}
    if rng is None:
        return {**row, "likelihood": None, "midpoint": None}
    held = int(rng.binomial(RUNS, 0.95))
    low, high = binomtest(held, RUNS).proportion_ci(0.95)
    likelihood = {
        **_errors(rng, std),
        "held": held / RUNS,
        "held_low": float(low),
        "held_high": float(high),
        "agrees": True,
    }
    return {**row, "likelihood": likelihood, "midpoint": _errors(rng, midpoint * std) if midpoint else None}


def _errors(rng: np.random.Generator, std: float) -> Json:
    rmse = std * (1 + rng.normal() / math.sqrt(2 * RUNS))
    bias_std = rmse / math.sqrt(RUNS)
    return {"runs": RUNS, "rmse": rmse, "bias": rng.normal() * bias_std, "bias_std": bias_std}
