"""The answer of a study over a grid of settings: axes, cases and, of each case, its parameters.

Units are those that people read (deg, mm). What a case does not identify has no number: the dataclasses
refuse to be made otherwise.
"""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from ....analysis.status import Status, StatusRow, Verdict
from ....model.errors import UnsoundResult
from ....model.likelihood.parameters import Group
from ....model.records import record
from ..answer import StudyAnswer
from .study_file import Settings, SettingValues

Fit = Literal["likelihood", "midpoint"]


@dataclass(frozen=True)
class RunErrors:
    """Errors (estimate minus truth) of one parameter in fits to simulated runs; `bias_std` is the Monte Carlo
    standard error of the bias."""

    runs: int
    rmse: float
    bias: float
    bias_std: float


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


def _over_cases(name: str, unit: str, stds: list[float]) -> OffsetOverCases:
    known, middle = [std for std in stds if math.isfinite(std)], statistics.median(stds)
    return OffsetOverCases(
        name,
        unit,
        cases=len(stds),
        without=len(stds) - len(known),
        least=min(known, default=None),
        median=middle if math.isfinite(middle) else None,
        largest=max(known, default=None),
    )


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
        return tuple(_over_cases(*key, row) for key, row in rows.items())

    def has(self, fit: Fit) -> bool:
        """Whether there are errors of this fit."""
        return any(one.errors(fit) is not None for one in self.parameters)
