"""Coverage studies made up for the tests of their report: agreeing, disagreeing, hostile."""

from __future__ import annotations

import copy
import functools
import math
from typing import Any

import numpy as np
from example_results import HOSTILE_NAMES
from scipy.special import chdtrc
from scipy.stats import binomtest, norm

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


def hostile() -> Json:
    """Names and words that would do harm if they were markup, a path or a command."""
    answer = agreeing()
    answer["title"] = HOSTILE_NAMES[0]
    answer["headline"] = HOSTILE_NAMES[1]
    answer["notes"] = list(HOSTILE_NAMES)
    answer["versions"][HOSTILE_NAMES[0]] = HOSTILE_NAMES[1]
    for plan, name, robot in zip(answer["plans"], HOSTILE_NAMES, reversed(HOSTILE_NAMES), strict=False):
        plan["name"], plan["robot"], plan["words"] = name, robot, HOSTILE_NAMES[1]
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
    low, high = binomtest(held, DATA_SETS).proportion_ci(0.95)
    apart = abs(held / DATA_SETS - level) / math.sqrt(level * (1 - level) / DATA_SETS)
    return {
        "level": level,
        "held": held,
        "of": DATA_SETS,
        "share": held / DATA_SETS,
        "low": float(low),
        "high": float(high),
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
        rows.append({"name": f"delta{i + 2}", "ranks": ranks.tolist(), "chi2": chi2, "p_value": p})
    return {
        "name": name,
        "control": control,
        "agrees": not control,
        "sentence": "The ranks are uniform." if not control else "The truth lies in the tails far too often.",
        "parameters": rows,
        "power": "a std too small by 10 % would be seen with probability 0.97",
    }
