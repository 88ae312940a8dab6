"""Studies made up for the tests of their pages: coverage, cell, table2, geometry; each with a hostile one."""

import functools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from example_results import HOSTILE_NAMES
from pydantic import TypeAdapter
from scipy.stats import chi2, chisquare, norm

from zerobeam.experiments.studies.answer import (
    JudgedEstimator,
    NoiseLevel,
    ObservedParameter,
    StudyAnswer,
    accuracy,
    by_stds,
    held_share,
)
from zerobeam.experiments.studies.cell import CellPlan, CellSettings, CellStudy, PhaseSeconds, ShotsUsed
from zerobeam.experiments.studies.coverage import (
    CoveragePlan,
    CoverageSettings,
    CoverageStudy,
    RankCalibration,
    RankedParameter,
)
from zerobeam.experiments.studies.geometry_coverage import (
    CheckedOffset,
    GeometryEstimator,
    GeometryParameter,
    GeometryPlan,
    GeometrySettings,
    GeometryStudy,
    ToleranceLevel,
)
from zerobeam.experiments.studies.table2 import (
    EXPERIMENTS,
    OFFSETS,
    PRINTED_MEAN,
    PRINTED_STD,
    PaperTable,
    ScatterParameter,
    SimulatedStd,
    Table2Plan,
    Table2Settings,
    Table2Study,
)
from zerobeam.model.records import to_json

Json = dict[str, Any]

LEVELS = (0.5, 0.9, 0.95, 0.99)
DATA_SETS, DRAWS, BINS, RUNS, ARMS = 1000, 99, 20, 200, 200
# A bias and a spread that no report may show where a data set cannot tell the parameter.
FORBIDDEN = 1.23456789
NOISE = NoiseLevel(0.01, 0.05)
NAMES = [f"delta{i}" for i in range(2, 7)]
ABOUT: Json = {"agrees": True, "seconds": 9.83, "versions": {"zerobeam": "0.1.0", "numpy": "2.3.4"}}
NOTE = ("delta1 is held: it is the base frame, and no data tell it.",)
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


def _harmful(answer: Json) -> Json:
    harm = {"title": HOSTILE_NAMES[0], "headline": HOSTILE_NAMES[1], "notes": [*HOSTILE_NAMES]}
    for plan, name, robot in zip(answer["plans"], HOSTILE_NAMES, reversed(HOSTILE_NAMES), strict=False):
        plan |= {"name": name, "words": name} | ({"robot": robot} if "robot" in plan else {})
        for part in plan.get("estimators", [plan]):
            part["sentence"] = HOSTILE_NAMES[7]
        plan.get("estimators", [plan])[0]["parameters"][1]["name"] = HOSTILE_NAMES[0]
    return answer | harm


def _row(
    rng: np.random.Generator,
    name: str,
    true: float,
    u: float,
    runs: int,
    levels: Sequence[float] = (0.95,),
    claims: bool = False,
) -> ObservedParameter:
    """Errors of the spread `true` with intervals of `u`; an undetermined one (NaN) may have a claim."""
    many = len(levels) > 1
    if math.isnan(u):
        if not claims:
            return ObservedParameter(name, "deg", "unidentifiable", coverage=() if many else None)
        true, u = 1.0, 0.002
    error = rng.normal(size=runs) * true
    alarm = 0.01 / (5 * len(levels))
    shares = tuple(held_share(by_stds(error / u, level), runs, level, alarm) for level in levels)
    status: Any = "weak" if u > 0.05 else "identified"
    errors = accuracy(error, np.full(runs, u))
    return ObservedParameter(name, "deg", status, *errors, shares if many else shares[0])


# ── coverage ──────────────────────────────────────────────────────────────────────────────────

_GOOD = (0.0101, 0.0123, 0.0098, 0.0214, 0.0431)
_DEGENERATE = (math.nan, 0.21, 0.164, 0.55, 1.9)
_PLANS = (
    ("good", "seven shots chosen by A-optimality", 7, _GOOD),
    ("weak", "five shots within a narrow cone", 5, (0.143, 0.0871, 0.0642, 0.312, 0.927)),
    ("nearly degenerate", "an X-Pattern: the second joint hardly moves", 4, _DEGENERATE),
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
    return to_json(_coverage())


def disagreeing() -> Json:
    """The same, but the midpoint fit's intervals of the weak plan contain the true value too seldom."""
    answer, rng = agreeing(), np.random.default_rng(3)
    estimator = answer["plans"][1]["estimators"][1]
    estimator["agrees"] = answer["agrees"] = False
    estimator["sentence"] = "The 95 % intervals of delta2 contain the true value too seldom."
    estimator["parameters"][0] = to_json(_row(rng, "delta2", 0.2, 0.16, DATA_SETS, LEVELS))
    answer["headline"] = "The midpoint fit's intervals do not hold what they promise for the plan weak."
    return answer


def hostile() -> Json:
    """Names and words that would do harm if they were markup, a path or a command; one plan is enough."""
    answer = agreeing()
    del answer["plans"][:2]
    answer = _harmful(answer)
    answer["versions"][HOSTILE_NAMES[0]] = HOSTILE_NAMES[1]
    (plan,) = answer["plans"]
    plan["estimators"][3]["name"] = plan["robot"] = HOSTILE_NAMES[9]
    plan["words"] = HOSTILE_NAMES[1]
    plan["sbc"][0]["sentence"] = HOSTILE_NAMES[7]
    plan["sbc"][0]["parameters"][1]["name"] = HOSTILE_NAMES[4]
    return answer


@functools.cache
def _coverage() -> CoverageStudy:
    rng = np.random.default_rng(1)
    plans = []
    for name, words, shots, stds in _PLANS:
        estimators = []
        for kind, about, control, width, spread in _ESTIMATORS:
            share = 100 * (2 * norm.cdf(1.96 * width) - 1)
            sentence = f"{share:.0f} % of its 95 % intervals contain the true value."
            rows = tuple(
                _row(rng, offset, std * spread, std * spread * width, DATA_SETS, LEVELS, "pseudo" in kind)
                for offset, std in zip(NAMES, stds, strict=True)
            )
            head = {"name": kind, "words": about, "control": control, "agrees": not control}
            estimators.append(
                JudgedEstimator(**head, converged=DATA_SETS, sentence=sentence, parameters=rows)
            )
        sbc = (_ranks(rng, "posterior", False, 1.0), _ranks(rng, "noise understated by 2", True, 0.5))
        about_plan: Json = {"name": name, "words": words, "robot": "irb1600", "shots": shots, "noise": NOISE}
        made = {"data_sets": DATA_SETS, "failed": 3 if name == "nearly degenerate" else 0, "acceptance": 0.7}
        plans.append(CoveragePlan(**about_plan, **made, estimators=tuple(estimators), sbc=sbc))
    posterior = "importance-weighted draws from a multivariate t about each fit"
    return CoverageStudy(
        study="coverage",
        title="Do the intervals hold what they promise?",
        headline="Every interval contains the true value as often as stated, and both controls fail visibly.",
        settings=CoverageSettings(DATA_SETS, 0, LEVELS, DRAWS, BINS, 0.01, posterior),
        plans=tuple(plans),
        notes=NOTE,
        **ABOUT,
    )


def _ranks(rng: np.random.Generator, name: str, control: bool, width: float) -> RankCalibration:
    """Ranks of a standard normal truth among draws that are `width` times as wide as they should be."""
    rows = []
    for offset in NAMES:
        shares = norm.cdf(rng.normal(size=DATA_SETS) / width)
        ranks = np.bincount(rng.binomial(DRAWS, shares) * BINS // (DRAWS + 1), minlength=BINS)
        rows.append(RankedParameter(offset, "deg", tuple(ranks.tolist()), *map(float, chisquare(ranks))))
    return RankCalibration(
        name=name,
        control=control,
        agrees=not control,
        sentence="The truth lies in the tails far too often." if control else "The ranks are uniform.",
        parameters=tuple(rows),
        power="a std too small by 10 % would be seen with probability 0.97",
    )


# ── cell ──────────────────────────────────────────────────────────────────────────────────────

_Y = (0.021, 0.034, 0.029, 0.041, 0.087)
# name, words, control, stds, the intervals' width, mean seconds by phase, spread of the total, shots saved
_CELL_PLANS: tuple[tuple[Any, ...], ...] = (
    ("y-pattern", "the paper's seven postures", False, _Y, 1.0, (38.2, 61.7, 92.4, 14.0), 21.3, None),
    ("optimal", "seven by A-optimality", False, _GOOD, 1.0, (52.6, 70.3, 88.1, 14.0), 24.8, None),
    ("adaptive", "the next one chosen after each shot", False, _Y, 1.0, (41.9, 50.8, 66.5, 10.6), 33.5, 1.74),
    ("x-pattern", "joint 2 hardly moves", False, _DEGENERATE, 1.0, (36.3, 58.2, 90.8, 14.0), 20.2, None),
    ("noise understated", "told half the noise", True, _Y, 0.5, (38.4, 61.2, 92.9, 14.0), 21.9, None),
)  # fmt: skip


def cell_study() -> Json:
    """Five plans through the whole chain; one cannot tell delta2, one is a control that fails."""
    return to_json(_cell())


def hostile_cell() -> Json:
    """Harmful names; a plan without any result, one beyond the limit, a control that is not seen to fail."""
    answer = _harmful(cell_study()) | {"agrees": False}
    answer["plans"][4]["agrees"] = True
    late, empty = answer["plans"][1], answer["plans"][0]
    late["seconds"]["total"]["max"], late["within_limit"] = 402.5, False
    empty |= {"agrees": False, "failed": RUNS, "failures": ["the beam is lost", HOSTILE_NAMES[0]]}
    empty |= dict.fromkeys(("within_limit", "computing_s"))
    empty["shots_used"] = dict.fromkeys(("mean", "min", "max"))
    empty["seconds"] = {phase: {"mean": None, "max": None} for phase in empty["seconds"]}
    for row in empty["parameters"]:
        row |= dict.fromkeys(("bias", "bias_mcse", "rmse", "predicted_std", "coverage"))
    return answer


@functools.cache
def _cell() -> CellStudy:
    rng, plans = np.random.default_rng(5), []
    for name, words, control, stds, width, means, spread, saved in _CELL_PLANS:
        phases = dict(zip(("move", "search", "servo", "settle", "total"), (*means, sum(means)), strict=True))
        longest = phases["total"] + 3 * spread
        rows = [_row(rng, offset, std, std * width, RUNS) for offset, std in zip(NAMES, stds, strict=True)]
        plans.append(
            CellPlan(
                name=name,
                words=words,
                control=control,
                agrees=not control,
                sentence="Far too few." if control else "All shares lie within the binomial error.",
                robot="irb1600",
                shots=7,
                noise=NOISE,
                runs=RUNS,
                failed=0,
                failures=(),
                refused=3,
                contradicted=2,
                parameters=tuple(rows),
                seconds={
                    key: PhaseSeconds(mean, longest * mean / phases["total"]) for key, mean in phases.items()
                },
                within_limit=longest <= 360,
                shots_used=ShotsUsed(7 - (saved or 0), 5 if saved else 7, 7),
                saved=saved,
                computing_s=1.83,
            )
        )
    return CellStudy(
        study="cell",
        title="Does the automated cell keep its promises?",
        headline="The intervals contain the true value as often as they promise, and the control is wrong.",
        settings=CellSettings(RUNS, 0, 0.95, True, 0.01, 360.0, 0.02),
        plans=tuple(plans),
        notes=NOTE,
        **ABOUT,
    )


# ── table 2 ───────────────────────────────────────────────────────────────────────────────────

# name, words, std of each offset for 1° of joint noise (NaN: not determined), joint noise, interval, p-value
_TABLE_2_PLANS: tuple[tuple[Any, ...], ...] = (
    ("y-pattern", "the paper's seven postures", (2.1, 3.4, 2.9, 4.1, 8.7), 0.0112, (0.0079, 0.0193), 0.0007),
    ("optimal", "seven shots by A-optimality", (1.1, 1.4, 1.0, 2.2, 4.3), 0.0214, (0.015, 0.037), 0.002),
    ("x-pattern", "joint 2 hardly moves", (math.nan, 21, 16.4, 55, 190), 0.0015, (0.001, 0.003), 0.031),
)  # fmt: skip


def table2_study() -> Json:
    """The paper's three runs against three plans, of which one cannot tell delta2."""
    return to_json(_table2())


def hostile_table2() -> Json:
    """Harmful names; a plan for which no joint noise could be found, and nothing was simulated."""
    answer = _harmful(table2_study()) | {"agrees": False}
    answer["paper"]["offsets"][1], answer["paper"]["notes"] = HOSTILE_NAMES[3], [*HOSTILE_NAMES]
    empty = answer["plans"][0]
    empty |= dict.fromkeys(("joint_deg", "low", "high", "p_value", "chi2", "chance")) | {"agrees": False}
    answer["plans"][1] |= {"low": 0.0, "agrees": False}
    for row in empty["parameters"]:
        row |= dict.fromkeys(("predicted_std", "alone_deg", "simulated_std", "simulated"))
    return answer


@functools.cache
def _table2() -> Table2Study:
    rng, std, plans = np.random.default_rng(7), EXPERIMENTS.std(axis=0, ddof=1), []

    def of_three(probability: float) -> float:
        return math.sqrt(chi2.ppf(probability, 2) / 2)

    for name, words, gains, joint_deg, bounds, p_value in _TABLE_2_PLANS:
        rows = []
        for offset, of_paper, gain in zip(OFFSETS, std.tolist(), gains, strict=True):
            paper = (of_paper, of_paper / of_three(0.975), of_paper / of_three(0.025))
            if math.isnan(gain):
                rows.append(ScatterParameter(offset, "deg", "unidentifiable", *paper))
                continue
            at = gain * joint_deg
            sets = SimulatedStd(*(at * of_three(p) for p in (0.025, 0.5, 0.975)))
            observed = at * of_three(rng.uniform(0.1, 0.9))
            ours = (at, of_paper / gain, observed, sets)
            rows.append(ScatterParameter(offset, "deg", "identified", *paper, *ours))
        plans.append(
            Table2Plan(
                name,
                words,
                7,
                0.05,
                joint_deg,
                *bounds,
                p_value,
                True,
                9.82,
                10,
                0.9123,
                "No one joint noise explains all five standard deviations.",
                (),
                tuple(rows),
            )
        )
    runs = tuple(map(tuple, EXPERIMENTS.tolist()))
    means = tuple(EXPERIMENTS.mean(axis=0).tolist())
    notes = ("The printed means and standard deviations follow from the printed runs.",)
    return Table2Study(
        study="table2",
        title="What does the scatter of the paper's three runs say?",
        headline="One joint noise does not explain all five standard deviations: delta6 repeats too well.",
        settings=Table2Settings(0, 3, 2000, 0.01),
        paper=PaperTable(OFFSETS, runs, means, tuple(std.tolist()), PRINTED_MEAN, PRINTED_STD, notes),
        plans=tuple(plans),
        notes=NOTE,
        **ABOUT,
    )


# ── geometry ──────────────────────────────────────────────────────────────────────────────────

# name, measurements, u of δ2 … δ6 by noise, considered, freed (NaN: not determined)
_GEOMETRY_PLANS = (
    ("7, nominal", 7, (0.0089, 0.0071, 0.0062, 0.0068, 0.0061), (0.083, 0.041, 0.022, 0.057, 0.021),
     (0.031, 0.030, 0.011, 0.019, 0.012)),
    ("12, nominal", 12, (0.0068, 0.0061, 0.0054, 0.0058, 0.0052), (0.061, 0.039, 0.031, 0.044, 0.026),
     (0.015, 0.012, 0.0081, 0.0093, 0.0066)),
    ("probe", 60, (0.0029, 0.0032, 0.0041, 0.0064, math.nan), (0.024, 0.12, 0.041, 0.12, math.nan),
     (0.0043, 0.017, 0.0081, 0.011, math.nan)),
)  # fmt: skip


@functools.cache
def geometry_study() -> GeometryStudy:
    """Three plans; the last does not determine δ6."""
    rng, plans = np.random.default_rng(11), []
    for name, shots, noise, considered, freed in _GEOMETRY_PLANS:
        of_kinds = {
            "freed": (freed, freed),
            "considered": (considered, considered),
            "nominal": (noise, considered),
            "tolerances understated by 3": (tuple(u / 2 for u in freed), freed),
        }
        estimators = []
        for kind, (us, trues) in of_kinds.items():
            control = kind in ("nominal", "tolerances understated by 3")
            rows = [_geometry_row(rng, *of) for of in zip(NAMES, trues, us, strict=True)]
            head: Json = {"name": kind, "words": f"by {kind}", "control": control, "agrees": not control}
            misfit = ARMS if kind in ("nominal", "considered") else 1
            counts = {"converged": ARMS, "misfit": misfit, "sentence": "Far too few." if control else "All."}
            estimators.append(GeometryEstimator(**head, **counts, parameters=tuple(rows)))
        checked = tuple(
            CheckedOffset(offset, "deg", *(None if math.isnan(u) else u for u in us))
            for offset, *us in zip(NAMES, noise, considered, freed, strict=True)
        )
        of_laser = name != "probe"
        plans.append(
            GeometryPlan(
                name=name,
                words=f"laser, {shots} A-optimal measurements",
                chosen_for="nominal" if of_laser else None,
                robot="irb1600",
                shots=shots,
                noise=NOISE,
                tolerance=ToleranceLevel(0.3, 0.1),
                arms=ARMS,
                failed=0,
                efficiency=0.912 if of_laser else None,
                checked=checked,
                estimators=tuple(estimators),
            )
        )
    return GeometryStudy(
        study="geometry",
        title="Do the intervals hold if the arm deviates from nominal geometry?",
        headline="With the geometry estimated the 95 % intervals contain the true value as often as stated.",
        settings=GeometrySettings(ARMS, 0, 0.95, 0.01, 1000, 1.0),
        plans=tuple(plans),
        notes=("Gravity and harmonics are neither simulated nor estimated.",),
        **ABOUT,
    )


def _geometry_row(rng: np.random.Generator, name: str, true: float, u: float) -> GeometryParameter:
    row = _row(rng, name, true, u, ARMS)
    if row.rmse is None:
        return GeometryParameter(**vars(row))
    z = row.rmse / u
    low, high = (z * math.sqrt(ARMS / chi2.ppf(tail, ARMS)) for tail in (0.975, 0.025))
    return GeometryParameter(**vars(row), z=z, z_low=low, z_high=high, checked_std=u)


def hostile_geometry() -> GeometryStudy:
    """Names and words that would do harm; a plan without any result."""
    answer: GeometryStudy = typed(_harmful(to_json(geometry_study())))
    first, *others = answer.plans
    nothing = tuple(replace(row, noise_only=None, considered=None, freed=None) for row in first.checked)
    none = tuple(
        replace(
            part,
            agrees=False,
            converged=0,
            parameters=tuple(
                GeometryParameter(row.name, row.unit, "unidentifiable") for row in part.parameters
            ),
        )
        for part in first.estimators
    )
    plans = (replace(first, checked=nothing, estimators=none), *others)
    return replace(answer, agrees=False, plans=plans)
