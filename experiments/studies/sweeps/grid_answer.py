"""The answer of a study over a grid of settings: axes, cases and, of each case, its parameters; and what it
finds, in sentences made of its numbers.

Units are those that people read (deg, mm). What a case does not identify has no number: the dataclasses
refuse to be made otherwise.
"""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field

from ....analysis.estimation.fit import CONTRADICTED, MANY_STARTS
from ....analysis.row import StatusRow
from ....analysis.status import Status, Verdict
from ....model.arrays import Matrix, normal_half_width
from ....model.errors import UnsoundResult
from ....model.likelihood.parameters import Group
from ....model.records import record
from ....words.numbers import exact, percent, significant, spread
from ....words.wording import listed
from ..answer import StudyAnswer, share_interval
from .study_file import Settings, SettingValues

Fit = Literal["likelihood", "midpoint"]
LEVEL = 0.95  # of the intervals
LEAST_RUNS = 2  # that have a scatter
_MOST_NAMED = 3  # cases that contradict their prediction


@dataclass(frozen=True)
class RunErrors:
    """Errors (estimate minus truth) of one parameter in fits to simulated runs; `bias_std` is the Monte Carlo
    standard error of the bias."""

    runs: int
    rmse: float
    bias: float
    bias_std: float

    @classmethod
    def of(cls, error: Matrix, *more: float) -> Self | None:
        """Of errors (R,); None where they have no scatter."""
        if len(error) < LEAST_RUNS:
            return None
        rmse, bias_std = np.sqrt((error**2).mean()), error.std(ddof=1) / np.sqrt(len(error))
        return cls(len(error), float(rmse), float(error.mean()), float(bias_std), *more)


@dataclass(frozen=True)
class LikelihoodErrors(RunErrors):
    """The same for the likelihood fit, with the share of its intervals that hold the truth and the 95 %
    binomial interval of that share; `rms_in_stds` is the rms of error over stated standard uncertainty.

    `agrees` says whether share and scatter agree with the prediction, which is for the nominal arm,
    `as_stated` whether they agree with what the fits of the runs state; None until the study is judged.
    """

    held: float
    held_low: float
    held_high: float
    rms_in_stds: float
    agrees: bool | None = None
    as_stated: bool | None = None

    @classmethod
    def by_fits(cls, error: Matrix, std: Matrix) -> LikelihoodErrors | None:
        """Of errors (R,) and the standard uncertainties (R,) that the fits state."""
        if len(error) < LEAST_RUNS:
            return None
        held = int((np.abs(error) <= normal_half_width(LEVEL) * std).sum())
        in_stds = float(np.sqrt(((error / std) ** 2).mean()))
        return cls.of(error, held / len(error), *share_interval(held, len(error)), in_stds)


@record(repr=False)
class CaseParameter(StatusRow):
    """An offset or a tool parameter of a case: its status, predicted standard uncertainty and errors."""

    claims = ("std", "likelihood", "midpoint")
    absent: ClassVar[tuple[str, ...]] = ("held",)

    status: Status
    group: Group
    std: float | None = None
    likelihood: LikelihoodErrors | None = None
    midpoint: RunErrors | None = None

    @property
    def is_angular_offset(self) -> bool:
        """Whether it is one of those that a case's `worst_std` is of."""
        return self.group == "offset" and self.unit == "deg"

    def errors(self, fit: Fit) -> RunErrors | None:
        return self.likelihood if fit == "likelihood" else self.midpoint


@dataclass(frozen=True)
class GridCase:
    """One point of the grid: `at` is the index of its value on each axis; a case beside the grid has none.

    `reason` says why there is no plan, else None. `worst_std` (deg) is the largest predicted standard
    uncertainty of an offset; None where an offset is not identified. `failed` counts fits, `unmet` true arms
    drawn again because they cannot hit the target. Raises UnsoundResult where a case without a plan, or a
    degenerate one, has a `worst_std`.
    """

    at: tuple[int, ...]
    words: str
    reason: str | None = None
    shots: int | None = None
    verdict: Verdict | None = None
    worst_std: float | None = None
    failed: int = 0
    unmet: int = 0
    parameters: tuple[CaseParameter, ...] = ()

    def __post_init__(self) -> None:
        if self.worst_std is not None and self.verdict in (None, "degenerate"):
            raise UnsoundResult(
                f"the study is unsound: {self.words!r} does not identify all offsets, but has a worst one"
            )

    @cached_property
    def worst(self) -> CaseParameter | None:
        """The offset that `worst_std` is of."""
        if self.worst_std is None:
            return None
        stds = [(one.std, one) for one in self.parameters if one.is_angular_offset and one.std is not None]
        return max(stds, key=lambda pair: pair[0])[1] if stds else None

    @property
    def unidentifiable(self) -> tuple[CaseParameter, ...]:
        """The parameters that the plan does not identify."""
        return tuple(one for one in self.parameters if one.status == "unidentifiable")

    @property
    def not_determined(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(one.name for one in self.unidentifiable)

    @property
    def agrees(self) -> bool | None:
        """Whether the runs agree with the prediction of every parameter; None without runs."""
        verdicts = [one.likelihood.agrees for one in self.parameters if one.likelihood is not None]
        return all(verdicts) if verdicts else None

    @property
    def as_stated(self) -> bool:
        """Whether the errors of every parameter are as the fits of the runs state."""
        return all(one.likelihood.as_stated for one in self.parameters if one.likelihood is not None)


@dataclass(frozen=True)
class GridAxis:
    """An axis of the grid; `changes` are the settings of each of its values, by their dotted names."""

    key: str
    label: str
    unit: str
    values: tuple[int | float | str, ...]
    changes: Annotated[tuple[SettingValues, ...], Field(serialization_alias="set")]

    @property
    def numeric(self) -> tuple[float, ...] | None:
        """The values if all are numbers, else None."""
        numbers = tuple(value for value in self.values if not isinstance(value, str))
        return numbers if len(numbers) == len(self.values) else None


@dataclass(frozen=True)
class OffsetOverCases:
    """The smallest, median and largest u (deg or mm) of an offset over the cases that have a plan; None where
    no case determines it. `without` of the `cases` do not: in the median they count as larger than any u."""

    name: str
    unit: str
    cases: int
    without: int
    least: float | None
    median: float | None
    largest: float | None


class GridSettings(Settings):
    """The base of all cases, and how the study was carried out and judged."""

    seed: int
    level: float  # of the intervals
    chance: float  # of a false alarm over the whole study
    file: str
    sha256: str


@dataclass(frozen=True, kw_only=True)
class GridStudy(StudyAnswer):
    """The whole answer; it agrees if no case that is not degenerate contradicts its prediction. `beside` are
    single cases to compare with, which are on no axis."""

    settings: GridSettings
    axes: tuple[GridAxis, ...]
    cases: tuple[GridCase, ...]
    beside: tuple[GridCase, ...] = ()

    @property
    def parameters(self) -> tuple[CaseParameter, ...]:
        """Those of all cases, in order."""
        return tuple(one for case in self.cases for one in case.parameters)

    def over_cases(self, axis: int | None = None, value: int = 0) -> tuple[OffsetOverCases, ...]:
        """Each offset over all cases of the grid, or over those at one `value` (index) of an `axis`."""
        rows: dict[tuple[str, str], list[float]] = {}
        for case in self.cases:
            for one in case.parameters if axis is None or case.at[axis] == value else ():
                if one.group == "offset" and one.status != "held":
                    std = math.inf if one.std is None else one.std
                    rows.setdefault((one.name, one.unit), []).append(std)
        answer = []
        for (name, unit), stds in rows.items():
            known, middle = [std for std in stds if math.isfinite(std)], statistics.median(stds)
            ends = min(known, default=None), middle if known and math.isfinite(middle) else None
            count = len(stds), len(stds) - len(known)
            answer.append(OffsetOverCases(name, unit, *count, *ends, max(known, default=None)))
        return tuple(answer)

    def has(self, fit: Fit) -> bool:
        """Whether there are errors of this fit."""
        return any(one.errors(fit) is not None for one in self.parameters)


# ── findings ──────────────────────────────────────────────────────────────────────────────────


_ON_GEOMETRY = (
    "The links of every simulated arm deviate from nominal geometry by random draws from the tolerances,"
    " and so do gravity and harmonics unless they are false; the likelihood estimates them. The midpoint"
    " fit takes the geometry as nominal"
)


def headline(axes: Sequence[GridAxis], cases: Sequence[GridCase], beside: Sequence[GridCase] = ()) -> str:
    """The best and the worst case, the cases without a number, and whether the runs agree."""
    degenerate = [case for case in cases if case.verdict == "degenerate"]
    without_plan = [case for case in cases if case.reason is not None]
    parts = [
        _range(cases),
        _counted(axes, cases, degenerate, "degenerate: not all offsets are identifiable"),
        _counted(axes, cases, without_plan, "without a plan"),
        *_agreement((*cases, *beside)),
    ]
    return " ".join(part for part in parts if part)


def findings(axes: Sequence[GridAxis], cases: Sequence[GridCase]) -> list[str]:
    """The effect of each axis, and what the midpoint fit costs; a sentence each, without the full stop."""
    by_axis = [
        _by_word(i, axis, cases) if axis.numeric is None else _trend(i, axis, axis.numeric, cases)
        for i, axis in enumerate(axes)
    ]
    return [sentence for sentence in (*by_axis, _midpoint(cases)) if sentence]


def notes(settings: GridSettings, cases: Sequence[GridCase]) -> list[str]:
    """How the numbers were made and judged."""
    sentences = [
        "The predicted standard uncertainty u of a parameter is that of the fit of one run, priors included."
        " The least certain offset of a case is the one with the largest u; a case with an unidentifiable"
        " offset has none"
    ]
    parameters = [one for case in cases for one in case.parameters]
    if any(one.likelihood for one in parameters):
        sentences += [
            "Every simulated run has an arm of its own, a random draw from the priors: offsets with a"
            f" standard deviation of {exact(settings.prior.offset_deg, 'deg')}, the target with"
            f" {exact(settings.target.sigma_mm, 'mm')} in each direction about its nominal position, unless"
            " an axis changes them. The random numbers of a case follow from its settings and the seed",
            *([] if settings.header().arm is None else [_ON_GEOMETRY]),
            f"A case agrees if the share of {percent(settings.level)} intervals that contain the true value"
            f" and the scatter are consistent with the prediction, at a false-alarm probability of"
            f" {percent(settings.chance)} over the whole study (exact binomial test, chi-squared test,"
            " Bonferroni). Where all offsets are identified the errors must scatter as predicted; where one"
            " is weakly observable the model is not linear along its direction, and they must scatter as the"
            " fits of the runs state. Degenerate cases are judged likewise, but do not count for the study:"
            " intervals from the curvature need not hold there",
            "Fits that did not converge, or contradict noise and priors (p-value below"
            f" {CONTRADICTED:g}) even from {MANY_STARTS} starts, are counted as failed and left out of the"
            " errors",
        ]
    if any(one.midpoint for one in parameters):
        sentences.append(
            "The midpoint fit uses neither spot readings nor priors and starts from zero offsets, as in the"
            " paper. Where it converges to another local optimum its error is large; the RMSE includes those"
            " runs"
        )
    return sentences


def _range(cases: Sequence[GridCase]) -> str:
    stds = [(case.worst_std, case.words) for case in cases if case.worst_std is not None]
    if not stds:
        return "In no case are all offsets identifiable."
    (low, best), (high, worst) = min(stds), max(stds)
    text = "The standard uncertainty of the least certain offset is"
    if best == worst:
        return f"{text} {spread(low, 'deg')} ({best})."
    least, most = f"{spread(low, 'deg')} ({best})", f"{spread(high, 'deg')} ({worst})"
    return f"{text} smallest at {least} and largest at {most}."


def _by_word(i: int, axis: GridAxis, cases: Sequence[GridCase]) -> str:
    """The range of the worst std at each value of an axis of words."""
    parts = []
    for j, value in enumerate(axis.values):
        stds = [case.worst_std for case in cases if case.at[i] == j and case.worst_std is not None]
        ends = dict.fromkeys(spread(pick(stds)) for pick in (min, max)) if stds else ()
        parts.append(f"{value} {' to '.join(ends) + '°' if ends else 'never all offsets identifiable'}")
    some = len(parts) > 1 and any(case.worst_std is not None for case in cases)
    text = f"Standard uncertainty of the least certain offset by {axis.label}: {'; '.join(parts)}"
    return text if some else ""


def _trend(i: int, axis: GridAxis, values: Sequence[float], cases: Sequence[GridCase]) -> str:
    """By what factor the worst std changes from the lowest to the highest value of an axis of numbers."""
    rows: dict[tuple[int, ...], dict[int, float]] = {}
    for case in cases:
        if case.worst_std is not None:
            rows.setdefault(case.at[:i] + case.at[i + 1 :], {})[case.at[i]] = case.worst_std
    ends = {
        others: (min(row, key=values.__getitem__), max(row, key=values.__getitem__))
        for others, row in rows.items()
        if len(row) > 1
    }
    if not ends:
        return ""
    (first, last), _ = Counter(ends.values()).most_common(1)[0]
    factors = [
        rows[others][last] / rows[others][first] for others, pair in ends.items() if pair == (first, last)
    ]
    return (
        f"With {axis.label} from {exact(values[first])} to {exact(values[last], axis.unit)} the standard"
        " uncertainty of the least certain offset changes by a factor of"
        f" {_quantiles(factors, 'the other settings')}"
    )


def _midpoint(cases: Sequence[GridCase]) -> str:
    ratios = [
        one.midpoint.rmse / one.likelihood.rmse
        for case in cases
        for one in case.parameters
        if one.midpoint is not None and one.likelihood is not None
    ]
    if not ratios:
        return ""
    factor = _quantiles(ratios, "cases and parameters")
    return f"The RMSE of the midpoint fit is that of the likelihood fit times {factor}"


def _quantiles(values: Sequence[float], over: str) -> str:
    low, middle, high = (significant(float(np.quantile(values, q)), 2) for q in (0, 0.5, 1))
    return middle if low == high else f"{middle} (median; {low} to {high} over {over})"


def _counted(
    axes: Sequence[GridAxis], cases: Sequence[GridCase], those: Sequence[GridCase], what: str
) -> str:
    """'4 of 8 cases are …, including all with …': the values of axes at which every case is one of those."""
    if not those:
        return ""
    names = []
    for i, axis in enumerate(axes):
        for j, value in enumerate(axis.values):
            count = sum(case.at[i] == j for case in cases)
            if len(those) < len(cases) and 1 < count == sum(case.at[i] == j for case in those):
                names.append(value if isinstance(value, str) else f"{axis.label} {exact(value, axis.unit)}")
    including = f" (including all with {listed(names)})" if names else ""
    is_are = "is" if len(those) == 1 else "are"
    return f"{len(those)} of {len(cases)} cases{including} {is_are} {what}."


def _agreement(cases: Sequence[GridCase]) -> list[str]:
    judged, parts = [case for case in cases if case.agrees is not None], list[str]()
    degenerate = [case for case in judged if case.verdict == "degenerate"]
    counting = [case for case in judged if case.verdict != "degenerate"]
    for those, which in ((counting, "cases"), (degenerate, "degenerate cases")):
        off = [case.words for case in those if not case.agrees]
        if off:
            named = f"{len(off)} of {len(those)} {which}: {listed(off, _MOST_NAMED)}"
            parts.append(f"The simulated runs contradict the prediction in {named}.")
            if those is counting and all(case.agrees or case.as_stated for case in those):
                parts.append(
                    "There the errors are as the fits of the runs state: the prediction is for the nominal"
                    " arm, and these arms are far from it."
                )
        elif those and those is counting:
            which = " that are not degenerate" if degenerate else ""
            parts.append(f"The simulated runs agree with the prediction in all {len(those)} cases{which}.")
    failed = sum(case.failed for case in cases)
    return [*parts, f"Failed fits: {failed}."] if judged and failed else parts
