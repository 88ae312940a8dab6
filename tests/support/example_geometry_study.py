"""A study of arms that deviate from nominal geometry, made up for its page; and a hostile one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from example_results import HOSTILE_NAMES
from scipy.stats import chi2

from zerobeam.experiments.studies.answer import NoiseLevel, held_share
from zerobeam.experiments.studies.geometry_coverage import (
    CheckedOffset,
    EstimatorName,
    GeometryEstimator,
    GeometryParameter,
    GeometryPlan,
    GeometrySettings,
    GeometryStudy,
    ToleranceLevel,
)

ARMS = 200
# name, measurements, u of δ2 … δ6 by noise, considered, freed (NaN: not determined)
_PLANS = (
    ("7, nominal", 7, (0.0089, 0.0071, 0.0062, 0.0068, 0.0061), (0.083, 0.041, 0.022, 0.057, 0.021),
     (0.031, 0.030, 0.011, 0.019, 0.012)),
    ("12, nominal", 12, (0.0068, 0.0061, 0.0054, 0.0058, 0.0052), (0.061, 0.039, 0.031, 0.044, 0.026),
     (0.015, 0.012, 0.0081, 0.0093, 0.0066)),
    ("probe", 60, (0.0029, 0.0032, 0.0041, 0.0064, math.nan), (0.024, 0.12, 0.041, 0.12, math.nan),
     (0.0043, 0.017, 0.0081, 0.011, math.nan)),
)  # fmt: skip


def geometry_study() -> GeometryStudy:
    """Three plans; the last does not determine δ6."""
    rng = np.random.default_rng(11)
    return GeometryStudy(
        study="geometry",
        title="Do the intervals hold if the arm deviates from nominal geometry?",
        headline="With the geometry estimated the 95 % intervals hold the truth as often as stated.",
        agrees=True,
        settings=GeometrySettings(
            arms=ARMS, seed=0, level=0.95, chance=0.01, candidates=1000, offset_deg=1.0
        ),
        seconds=214.6,
        versions={"zerobeam": "0.1.0", "numpy": "2.3.4"},
        notes=("Gravity and harmonics are neither simulated nor estimated.",),
        plans=tuple(_plan(rng, *plan) for plan in _PLANS),
    )


def hostile_geometry() -> GeometryStudy:
    """Names and words that would do harm; a plan without any result."""
    answer = geometry_study()
    plans = []
    for plan, name, robot in zip(answer.plans, HOSTILE_NAMES, reversed(HOSTILE_NAMES), strict=False):
        estimators = [replace(one, sentence=HOSTILE_NAMES[7], words=name) for one in plan.estimators]
        rows = tuple(
            replace(row, name=HOSTILE_NAMES[0]) if k == 1 else row
            for k, row in enumerate(estimators[0].parameters)
        )
        estimators[0] = replace(estimators[0], parameters=rows)
        plans.append(replace(plan, name=name, robot=robot, words=name, estimators=tuple(estimators)))
    nothing = [replace(row, noise_only=None, considered=None, freed=None) for row in plans[0].checked]
    none = [
        replace(
            estimators,
            agrees=False,
            parameters=tuple(_empty(row) for row in estimators.parameters),
            converged=0,
        )
        for estimators in plans[0].estimators
    ]
    plans[0] = replace(plans[0], checked=tuple(nothing), estimators=tuple(none))
    return replace(
        answer,
        title=HOSTILE_NAMES[0],
        headline=HOSTILE_NAMES[1],
        notes=tuple(HOSTILE_NAMES),
        agrees=False,
        plans=tuple(plans),
    )


def _empty(row: GeometryParameter) -> GeometryParameter:
    return GeometryParameter(row.name, row.unit, "unidentifiable", None, None, None, None)


def _plan(
    rng: np.random.Generator, name: str, shots: int, noise: tuple[float, ...], *more: tuple[float, ...]
) -> GeometryPlan:
    considered, freed = more
    names = [f"delta{i + 2}" for i in range(5)]
    close = tuple(u / 2 for u in freed)
    by_name: dict[EstimatorName, tuple[tuple[float, ...], tuple[float, ...]]] = {
        "freed": (freed, freed),
        "considered": (considered, considered),
        "nominal": (noise, considered),
        "tolerances understated by 3": (close, freed),
    }
    return GeometryPlan(
        name=name,
        words=f"laser, {shots} A-optimal measurements",
        chosen_for="nominal" if name != "probe" else None,
        robot="irb1600",
        shots=shots,
        noise=NoiseLevel(0.01, 0.05),
        tolerance=ToleranceLevel(0.3, 0.1),
        arms=ARMS,
        failed=0,
        efficiency=0.912 if name != "probe" else None,
        checked=tuple(
            CheckedOffset(name_of_offset, "deg", *(None if math.isnan(u) else u for u in us))
            for name_of_offset, *us in zip(names, noise, considered, freed, strict=True)
        ),
        estimators=tuple(_estimator(rng, kind, names, *us) for kind, us in by_name.items()),
    )


def _estimator(
    rng: np.random.Generator,
    kind: EstimatorName,
    names: list[str],
    u_stated: tuple[float, ...],
    true: tuple[float, ...],
) -> GeometryEstimator:
    control = kind in ("nominal", "tolerances understated by 3")
    return GeometryEstimator(
        name=kind,
        words=f"by {kind}",
        control=control,
        agrees=not control,
        converged=ARMS,
        misfit=ARMS if kind in ("nominal", "considered") else 1,
        sentence="All shares lie within the binomial error." if not control else "Far too few.",
        parameters=tuple(map(lambda offset, u, s: _row(rng, offset, u, s), names, u_stated, true)),
    )


def _row(rng: np.random.Generator, name: str, u: float, true: float) -> GeometryParameter:
    if math.isnan(u):
        return GeometryParameter(name, "deg", "unidentifiable", None, None, None, None)
    error = rng.normal(size=ARMS) * true
    off = np.abs(error) / u
    squares = float((off**2).sum())
    low, high = (float(np.sqrt(squares / chi2.ppf(tail, ARMS))) for tail in (0.975, 0.025))
    return GeometryParameter(
        name,
        "deg",
        "identified",
        float(error.mean()),
        float(error.std(ddof=1) / math.sqrt(ARMS)),
        float(np.sqrt((error**2).mean())),
        u,
        coverage=held_share(int((off <= 1.959964).sum()), ARMS, 0.95, 0.01 / 5),
        z=float(np.sqrt(squares / ARMS)),
        z_low=low,
        z_high=high,
        checked_std=u,
    )
