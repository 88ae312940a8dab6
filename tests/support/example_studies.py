"""Studies made up for the tests of their pages: coverage, cell, table2; each with a hostile one."""

from __future__ import annotations

import copy
import functools
import math
from typing import Any

import numpy as np
from example_results import HOSTILE_NAMES
from pydantic import TypeAdapter
from scipy.special import chdtrc
from scipy.stats import binomtest, chi2, norm

from zerobeam.experiments.studies.answer import StudyAnswer, share_interval
from zerobeam.experiments.studies.cell import CellStudy
from zerobeam.experiments.studies.coverage import CoverageStudy
from zerobeam.experiments.studies.geometry_coverage import GeometryStudy
from zerobeam.experiments.studies.table2 import Table2Study

Json = dict[str, Any]

LEVELS = (0.5, 0.9, 0.95, 0.99)
DATA_SETS, DRAWS, BINS = 1000, 99, 20
# A bias and a spread that no report may show where a data set cannot tell the parameter.
FORBIDDEN = 1.23456789

_PLANS: tuple[tuple[str, str, int, tuple[float, ...]], ...] = (
    ("good", "seven shots chosen by A-optimality", 7, (0.0101, 0.0123, 0.0098, 0.0214, 0.0431)),
    ("weak", "five shots within a narrow cone", 5, (0.143, 0.0871, 0.0642, 0.312, 0.927)),
    (
        "nearly degenerate",
        "an X-Pattern: the second joint hardly moves",
        4,
        (math.nan, 0.21, 0.164, 0.55, 1.9),
    ),
)
# name, words, control, the intervals' width as a multiple of the right one, rmse over the likelihood's
_ESTIMATORS = (
    ("likelihood", "likelihood fit, intervals from the curvature", False, 1.0, 1.0),
    ("midpoint", "the paper's cost (eq. 8), sandwich covariance", False, 1.0, 1.37),
    ("posterior", "posterior, central intervals of the draws", False, 1.0, 1.0),
    ("noise understated by 2", "likelihood fit that is told half the noise", True, 0.5, 1.0),
    ("pseudo-inverse covariance", "likelihood fit, covariance by a pseudo-inverse", True, 0.71, 1.0),
)


_KINDS: dict[str, type[StudyAnswer]] = {
    "coverage": CoverageStudy,
    "cell": CellStudy,
    "table2": Table2Study,
    "geometry": GeometryStudy,
}


def typed(content: Json | StudyAnswer) -> Any:
    """The answer that a study.json is of."""
    if isinstance(content, StudyAnswer):
        return content
    answer = {key: value for key, value in content.items() if key != "schema"}
    return TypeAdapter(_KINDS[content["study"]]).validate_python(answer, strict=False)


def agreeing() -> Json:
    """Three plans of five offsets; the last cannot tell delta2, and all that must agree agrees."""
    return copy.deepcopy(_agreeing())


def disagreeing() -> Json:
    """The same, but the midpoint fit's intervals of the weak plan hold the truth too seldom."""
    answer = agreeing()
    rng = np.random.default_rng(3)
    estimator = answer["plans"][1]["estimators"][1]
    estimator["agrees"] = answer["agrees"] = False
    estimator["sentence"] = "The 95 % intervals of delta2 hold the truth too seldom."
    for row in estimator["parameters"][0]["coverage"]:
        row |= _coverage(rng, row["level"], width=0.8)
    answer["headline"] = "The midpoint fit's intervals do not hold what they promise for the plan weak."
    return answer


def _harmful(answer: Json) -> Json:
    harm = {"title": HOSTILE_NAMES[0], "headline": HOSTILE_NAMES[1], "notes": [*HOSTILE_NAMES]}
    return answer | harm


def hostile() -> Json:
    """Names and words that would do harm if they were markup, a path or a command; one plan is enough."""
    answer = _harmful(agreeing())
    del answer["plans"][:2]
    answer["versions"][HOSTILE_NAMES[0]] = HOSTILE_NAMES[1]
    (plan,) = answer["plans"]
    plan["name"], plan["robot"], plan["words"] = HOSTILE_NAMES[0], HOSTILE_NAMES[9], HOSTILE_NAMES[1]
    plan["estimators"][3]["name"] = HOSTILE_NAMES[9]
    plan["estimators"][3]["sentence"] = HOSTILE_NAMES[7]
    plan["estimators"][0]["parameters"][1]["name"] = HOSTILE_NAMES[0]
    plan["sbc"][0]["sentence"] = HOSTILE_NAMES[7]
    plan["sbc"][0]["parameters"][1]["name"] = HOSTILE_NAMES[4]
    return answer


@functools.cache
def _agreeing() -> Json:
    rng = np.random.default_rng(1)
    return {
        "schema": "zerobeam/study/1",
        "study": "coverage",
        "title": "Do the intervals hold what they promise?",
        "headline": "Every interval holds the truth as often as it promises, and both controls fail visibly.",
        "agrees": True,
        "settings": {
            "data_sets": DATA_SETS,
            "seed": 0,
            "levels": list(LEVELS),
            "draws": DRAWS,
            "bins": BINS,
            "chance": 0.01,
            "posterior": "importance-weighted draws from a multivariate t about each fit",
        },
        "seconds": 9.83,
        "versions": {"zerobeam": "0.1.0", "numpy": "2.3.4"},
        "plans": [_plan(rng, *plan) for plan in _PLANS],
        "notes": ["delta1 is held: it is the base frame, and no data tell it."],
    }


def _plan(rng: np.random.Generator, name: str, words: str, shots: int, stds: tuple[float, ...]) -> Json:
    failed = 3 if name == "nearly degenerate" else 0
    return {
        "name": name,
        "words": words,
        "robot": "irb1600",
        "shots": shots,
        "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
        "data_sets": DATA_SETS,
        "failed": failed,
        "acceptance": 0.7,
        "estimators": [_estimator(rng, stds, *estimator) for estimator in _ESTIMATORS],
        "sbc": [_sbc(rng, "posterior", False, 1.0), _sbc(rng, "noise understated by 2", True, 0.5)],
    }


def _estimator(
    rng: np.random.Generator,
    stds: tuple[float, ...],
    name: str,
    words: str,
    control: bool,
    width: float,
    spread: float,
) -> Json:
    sentence = (
        "All 20 shares lie within the binomial error."
        if not control
        else f"Its 95 % intervals hold the truth {2 * norm.cdf(1.96 * width) - 1:.0%} of the time."
    )
    return {
        "name": name,
        "words": words,
        "control": control,
        "agrees": not control,
        "converged": DATA_SETS,
        "sentence": sentence,
        "parameters": [
            _parameter(rng, f"delta{i + 2}", std, width, spread, name.startswith("pseudo"))
            for i, std in enumerate(stds)
        ],
    }


def _parameter(
    rng: np.random.Generator, name: str, std: float, width: float, spread: float, claims: bool
) -> Json:
    if math.isnan(std):
        # A pseudo-inverse claims to know even this, to 0.1 mrad: its intervals never hold the truth.
        coverage = [_coverage(rng, level, 0.002) for level in LEVELS] if claims else []
        row: Json = dict.fromkeys(("bias", "bias_mcse", "rmse", "predicted_std"))
        return {"name": name, "unit": "deg", "status": "unidentifiable", **row, "coverage": coverage}
    rmse = std * spread * (1 + rng.normal() / math.sqrt(2 * DATA_SETS))
    mcse = rmse / math.sqrt(DATA_SETS)
    return {
        "name": name,
        "unit": "deg",
        "status": "weak" if std > 0.05 else "identified",
        "bias": rng.normal() * mcse,
        "bias_mcse": mcse,
        "rmse": rmse,
        "predicted_std": std * spread * width,
        "coverage": [_coverage(rng, level, width) for level in LEVELS],
    }


def _coverage(rng: np.random.Generator, level: float, width: float) -> Json:
    """How often intervals `width` times as wide as the right ones hold the truth of a normal error."""
    share = 2 * norm.cdf(norm.ppf((1 + level) / 2) * width) - 1
    held = int(rng.binomial(DATA_SETS, share))
    low, high = share_interval(held, DATA_SETS)
    apart = abs(held / DATA_SETS - level) / math.sqrt(level * (1 - level) / DATA_SETS)
    return {
        "level": level,
        "held": held,
        "of": DATA_SETS,
        "share": held / DATA_SETS,
        "low": low,
        "high": high,
        "agrees": bool(apart < 3.7),  # 1 in 20 by chance among some 200 shares
    }


def _sbc(rng: np.random.Generator, name: str, control: bool, width: float) -> Json:
    """Ranks of a standard normal truth among draws that are `width` times as wide as they should be."""
    rows = []
    for i in range(5):
        shares = norm.cdf(rng.normal(size=DATA_SETS) / width)
        ranks = np.bincount(rng.binomial(DRAWS, shares) * BINS // (DRAWS + 1), minlength=BINS)
        expected = DATA_SETS / BINS
        chi2 = float(((ranks - expected) ** 2 / expected).sum())
        p = float(chdtrc(BINS - 1, chi2))
        rows.append(
            {"name": f"delta{i + 2}", "unit": "deg", "ranks": ranks.tolist(), "chi2": chi2, "p_value": p}
        )
    return {
        "name": name,
        "control": control,
        "agrees": not control,
        "sentence": "The ranks are uniform." if not control else "The truth lies in the tails far too often.",
        "parameters": rows,
        "power": "a std too small by 10 % would be seen with probability 0.97",
    }


RUNS = 200
# name, words, control, shots, stds of δ2 … δ6 (NaN: not determined), the intervals' width, mean seconds by
# phase, spread of the total, shots saved by the adaptive order
_CELL_PLANS: tuple[tuple[Any, ...], ...] = (
    ("y-pattern", "the paper's seven postures", False, 7, (0.021, 0.034, 0.029, 0.041, 0.087), 1.0,
     (38.2, 61.7, 92.4, 14.0), 21.3, None),
    ("optimal", "seven shots chosen by A-optimality", False, 7, (0.011, 0.014, 0.010, 0.022, 0.043), 1.0,
     (52.6, 70.3, 88.1, 14.0), 24.8, None),
    ("adaptive", "the same candidates, the next one chosen after each shot", False, 7,
     (0.015, 0.019, 0.014, 0.027, 0.048), 1.0, (41.9, 50.8, 66.5, 10.6), 33.5, 1.74),
    ("x-pattern", "the second joint hardly moves", False, 7, (math.nan, 0.21, 0.164, 0.55, 1.9), 1.0,
     (36.3, 58.2, 90.8, 14.0), 20.2, None),
    ("noise understated", "the y-pattern, told half the noise of joints and spot", True, 7,
     (0.021, 0.034, 0.029, 0.041, 0.087), 0.5, (38.4, 61.2, 92.9, 14.0), 21.9, None),
)  # fmt: skip


def cell_study() -> Json:
    """Five plans through the whole chain; one cannot tell delta2, one is a control that fails."""
    return copy.deepcopy(_cell())


def hostile_cell() -> Json:
    """Harmful names; a plan without any result, one beyond the limit, a control that is not seen to fail."""
    answer = _harmful(cell_study()) | {"agrees": False}
    for plan, name, robot in zip(answer["plans"], HOSTILE_NAMES, reversed(HOSTILE_NAMES), strict=False):
        plan["name"], plan["robot"], plan["words"], plan["sentence"] = name, robot, name, HOSTILE_NAMES[7]
        plan["parameters"][1]["name"] = HOSTILE_NAMES[0]
    answer["plans"][4]["agrees"] = True
    late = answer["plans"][1]
    late["seconds"]["total"]["max"], late["within_limit"] = 402.5, False
    empty = answer["plans"][0]
    empty |= {
        "agrees": False,
        "failed": RUNS,
        "failures": ["the beam is lost", HOSTILE_NAMES[0]],
        "within_limit": None,
        "computing_s": None,
    }
    empty["shots_used"] = dict.fromkeys(("mean", "min", "max"))
    empty["seconds"] = {phase: {"mean": None, "max": None} for phase in empty["seconds"]}
    for row in empty["parameters"]:
        row |= dict.fromkeys(("bias", "bias_mcse", "rmse", "predicted_std", "coverage"))
    return answer


@functools.cache
def _cell() -> Json:
    rng = np.random.default_rng(5)
    return {
        "schema": "zerobeam/study/1",
        "study": "cell",
        "title": "Does the automated cell keep its promises?",
        "headline": "Through images, PSD and encoders the 95 % intervals hold the truth as often as they"
        " promise, and the control is seen to be wrong.",
        "agrees": True,
        "settings": {
            "runs": RUNS, "seed": 0, "level": 0.95, "camera": True, "chance": 0.01, "limit_s": 360.0,
            "tolerance_deg": 0.02,
        },
        "seconds": 1874.2,
        "versions": {"zerobeam": "0.1.0", "numpy": "2.3.4"},
        "plans": [_cell_plan(rng, *plan) for plan in _CELL_PLANS],
        "notes": ["delta1 is held: it is the base frame, and no data tell it."],
    }  # fmt: skip


def _cell_plan(
    rng: np.random.Generator,
    name: str,
    words: str,
    control: bool,
    shots: int,
    stds: tuple[float, ...],
    width: float,
    means: tuple[float, ...],
    spread: float,
    saved: float | None,
) -> Json:
    phases = dict(zip(("move", "search", "servo", "settle", "total"), (*means, sum(means)), strict=True))
    longest = phases["total"] + 3 * spread
    return {
        "name": name,
        "words": words,
        "control": control,
        "agrees": not control,
        "sentence": "All shares lie within the binomial error."
        if not control
        else "Far too few hold the truth.",
        "robot": "irb1600",
        "shots": shots,
        "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
        "runs": RUNS,
        "failed": 0,
        "failures": [],
        "refused": 3,
        "contradicted": 2,
        "parameters": [_cell_parameter(rng, f"delta{i + 2}", std, width) for i, std in enumerate(stds)],
        "seconds": {
            phase: {"mean": mean, "max": longest * mean / phases["total"]} for phase, mean in phases.items()
        },
        "within_limit": longest <= 360,
        "shots_used": {"mean": float(shots - (saved or 0)), "min": 5 if saved else shots, "max": shots},
        "saved": saved,
        "computing_s": 1.83,
    }


def _cell_parameter(rng: np.random.Generator, name: str, std: float, width: float) -> Json:
    row: Json = dict.fromkeys(("bias", "bias_mcse", "rmse", "predicted_std", "coverage"))
    if math.isnan(std):
        return {"name": name, "unit": "deg", "status": "unidentifiable", **row}
    rmse = std * (1 + rng.normal() / math.sqrt(2 * RUNS))
    mcse = rmse / math.sqrt(RUNS)
    share = 2 * norm.cdf(1.959964 * width) - 1
    held = int(rng.binomial(RUNS, share))
    low, high = share_interval(held, RUNS)
    return {
        "name": name,
        "unit": "deg",
        "status": "weak" if std > 0.05 else "identified",
        "bias": rng.normal() * mcse,
        "bias_mcse": mcse,
        "rmse": rmse,
        "predicted_std": std * width,
        "coverage": {
            "level": 0.95, "held": held, "of": RUNS, "share": held / RUNS,
            "low": low, "high": high,
            "agrees": bool(binomtest(held, RUNS, 0.95).pvalue > 0.01 / 25),
        },
    }  # fmt: skip


_TABLE_2 = (
    (-1.136002, -0.653953, 0.133136, 0.065242, -0.040463),
    (-1.217583, -0.735420, 0.116557, 0.016004, -0.040011),
    (-1.296875, -0.689902, 0.088857, -0.065201, -0.034254),
)
_PRINTED_STD = (0.0804, 0.0408, 0.0224, 0.0659, 0.0035)
# name, words, std of each offset for 1° of joint noise (NaN: not determined), joint noise, interval, p-value
_TABLE_2_PLANS: tuple[tuple[Any, ...], ...] = (
    ("y-pattern", "the paper's seven postures", (2.1, 3.4, 2.9, 4.1, 8.7), 0.0112, (0.0079, 0.0193), 0.0007),
    ("optimal", "seven shots by A-optimality", (1.1, 1.4, 1.0, 2.2, 4.3), 0.0214, (0.015, 0.037), 0.002),
    ("x-pattern", "joint 2 hardly moves", (math.nan, 21, 16.4, 55, 190), 0.0015, (0.001, 0.003), 0.031),
)  # fmt: skip


def table2_study() -> Json:
    """The paper's three runs against three plans, of which one cannot tell delta2."""
    return copy.deepcopy(_table2())


def hostile_table2() -> Json:
    """Harmful names; a plan for which no joint noise could be found, and nothing was simulated."""
    answer = _harmful(table2_study()) | {"agrees": False}
    answer["paper"]["offsets"][1], answer["paper"]["notes"] = HOSTILE_NAMES[3], [*HOSTILE_NAMES]
    for plan, name in zip(answer["plans"], HOSTILE_NAMES, strict=False):
        plan["name"], plan["words"], plan["sentence"] = name, name, HOSTILE_NAMES[7]
        plan["parameters"][1]["name"] = HOSTILE_NAMES[0]
    empty = answer["plans"][0]
    empty |= dict.fromkeys(("joint_deg", "low", "high", "p_value", "chi2", "chance")) | {"agrees": False}
    answer["plans"][1] |= {"low": 0.0, "agrees": False}
    for row in empty["parameters"]:
        row |= dict.fromkeys(("predicted_std", "alone_deg", "simulated_std", "simulated"))
    return answer


@functools.cache
def _table2() -> Json:
    runs = np.array(_TABLE_2)
    std = runs.std(axis=0, ddof=1)
    return {
        "schema": "zerobeam/study/1",
        "study": "table2",
        "title": "What does the scatter of the paper's three runs say?",
        "headline": "One joint noise does not explain all five standard deviations: delta6 repeats too well.",
        "agrees": True,
        "settings": {"seed": 0, "runs": 3, "simulated": 2000, "chance": 0.01},
        "seconds": 12.7,
        "versions": {"zerobeam": "0.1.0", "numpy": "2.3.4"},
        "paper": {
            "offsets": [f"delta{i}" for i in range(2, 7)],
            "experiments": [list(run) for run in _TABLE_2],
            "mean": runs.mean(axis=0).tolist(),
            "std": std.tolist(),
            "printed_mean": [-1.2168, -0.6931, 0.1129, 0.0053, -0.0382],
            "printed_std": list(_PRINTED_STD),
            "notes": ["The printed means and standard deviations follow from the printed runs."],
        },
        "plans": [_table2_plan(np.random.default_rng(7), std, *plan) for plan in _TABLE_2_PLANS],
        "notes": ["delta1 is held: it is the base frame, and no data tell it."],
    }


def _table2_plan(
    rng: np.random.Generator,
    paper: Any,
    name: str,
    words: str,
    gains: tuple[float, ...],
    joint_deg: float,
    bounds: tuple[float, float],
    p_value: float,
) -> Json:
    def of_three(probability: float) -> float:
        return math.sqrt(chi2.ppf(probability, 2) / 2)

    rows = []
    for i, (std, gain) in enumerate(zip(paper.tolist(), gains, strict=True)):
        sure = {"paper_std": std, "low": std / of_three(0.975), "high": std / of_three(0.025)}
        row: Json = {"name": f"delta{i + 2}", "unit": "deg", "status": "identified", **sure}
        if math.isnan(gain):
            ours: Json = dict.fromkeys(("predicted_std", "alone_deg", "simulated_std", "simulated"))
            row["status"] = "unidentifiable"
        else:
            predicted = gain * joint_deg
            ours = {
                "predicted_std": predicted,
                "alone_deg": std / gain,
                "simulated_std": predicted * of_three(rng.uniform(0.1, 0.9)),
                "simulated": {
                    key: predicted * of_three(p)
                    for key, p in (("q2_5", 0.025), ("median", 0.5), ("q97_5", 0.975))
                },
            }
        rows.append(row | ours)
    return {
        "name": name,
        "words": words,
        "shots": 7,
        "spot_mm": 0.05,
        "joint_deg": joint_deg,
        "low": bounds[0],
        "high": bounds[1],
        "p_value": p_value,
        "agrees": True,
        "chi2": 9.82,
        "dof": 10,
        "chance": 0.9123,
        "sentence": "No one joint noise explains all five standard deviations.",
        "axes": [],
        "parameters": rows,
    }
