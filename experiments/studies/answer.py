"""Fields common to the answers of all studies (`study.json`, docs/files-studies.md).

Units are those that people read (deg, mm, s). What a plan does not identify has no number, save in a
control, which is wrong on purpose: the dataclasses refuse to be made otherwise.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from scipy import special, stats

from ...analysis.status import Status, require_no_more_than
from ...analysis.status import versions as installed_versions
from ...model.arrays import Matrix
from ...model.likelihood.problem import Problem

SCHEMA: Final = "zerobeam/study/1"


@dataclass(frozen=True, kw_only=True)
class StudyAnswer:
    """The question, the answer in a sentence, and whether all that must agree agrees."""

    schema: Literal["zerobeam/study/1"] = SCHEMA
    study: str
    title: str
    headline: str
    agrees: bool
    settings: Any
    seconds: float
    versions: dict[str, str] = field(default_factory=installed_versions)
    notes: tuple[str, ...]


@dataclass(frozen=True)
class NoiseLevel:
    """The stated noise of a plan."""

    joint_deg: float
    spot_mm: float

    @classmethod
    def of_problem(cls, problem: Problem) -> NoiseLevel:
        return cls(float(np.degrees(problem.noise.joint[0])), float(problem.noise.spot))


@dataclass(frozen=True)
class Share:
    """How many of the intervals of `level` hold the truth: the share, with its 95 % binomial interval
    (Clopper and Pearson), and whether it agrees with the level."""

    level: float
    held: int
    of: int
    share: float
    low: float
    high: float
    agrees: bool


class ErrorStatistics(NamedTuple):
    """Bias with its Monte Carlo standard error, rmse and predicted standard uncertainty, or None for each."""

    bias: float | None = None
    bias_mcse: float | None = None
    rmse: float | None = None
    predicted_std: float | None = None


@dataclass(frozen=True)
class ObservedParameter:
    """Errors (estimate minus truth) of one parameter over many runs: bias with its Monte Carlo standard error
    `bias_mcse`, rmse, and the root mean square of the standard uncertainties that the runs state."""

    name: str
    unit: str
    status: Status
    bias: float | None
    bias_mcse: float | None
    rmse: float | None
    predicted_std: float | None

    @property
    def shares(self) -> tuple[Share, ...]:
        """The shares that there are, one a level."""
        raise NotImplementedError


@dataclass(frozen=True)
class ParameterWithShare(ObservedParameter):
    """The same with the share of its intervals of one level; None where no run determines the parameter."""

    coverage: Share | None = None

    @property
    def shares(self) -> tuple[Share, ...]:
        return () if self.coverage is None else (self.coverage,)


@dataclass(frozen=True, kw_only=True)
class JudgedPart:
    """A part of a study with numbers that must agree with what they should be, and a sentence on them. A
    `control` is wrong on purpose, and must not agree."""

    name: str
    control: bool
    agrees: bool
    sentence: str


@dataclass(frozen=True, kw_only=True)
class JudgedEstimator(JudgedPart):
    """An estimator on a plan; `converged` counts what it has a fit of.

    Raises UnsoundResult where an unidentifiable parameter has a number, unless it is a control.
    """

    words: str
    converged: int
    parameters: tuple[ObservedParameter, ...]

    def __post_init__(self) -> None:
        require_sound(self.name, self.control, self.parameters)


@dataclass(frozen=True, kw_only=True)
class PlanOfStudy:
    """A plan and what was made of it; `failed` counts what was drawn again, or did not end."""

    name: str
    words: str
    robot: str
    shots: int
    noise: NoiseLevel
    failed: int


def require_sound(subject: str, control: bool, parameters: Iterable[ObservedParameter]) -> None:
    """Raise UnsoundResult if a parameter of `subject` that is not determined has a number, and it is no
    control."""
    for row in () if control else parameters:
        require_no_more_than(
            f"{row.name} of {subject}",
            row.status,
            bias=row.bias,
            bias_mcse=row.bias_mcse,
            rmse=row.rmse,
            predicted_std=row.predicted_std,
            coverage=row.shares or None,
        )


def accuracy(error: Matrix, std: Matrix) -> ErrorStatistics:
    """Of R estimates of one parameter: `error` (R,) is estimate minus truth, `std` (R,) the standard
    uncertainty stated with each; without any number where there are fewer than two."""
    if len(error) < 2:
        return ErrorStatistics()
    return ErrorStatistics(
        bias=float(error.mean()),
        bias_mcse=float(error.std(ddof=1) / np.sqrt(len(error))),
        rmse=float(np.sqrt((error**2).mean())),
        predicted_std=float(np.sqrt((std**2).mean())),
    )


def held_share(held: int, of: int, level: float, alarm: float) -> Share:
    """The share of intervals of `level` that hold the truth.

    It agrees unless the p-value of the exact binomial test is below `alarm`.
    """
    agrees = bool(stats.binomtest(held, of, level).pvalue >= alarm)
    return Share(level, held, of, held / of, *share_interval(held, of), agrees)


def share_interval(held: int, of: int) -> tuple[float, float]:
    """The exact 95 % interval of a share (Clopper and Pearson 1934), by quantiles of beta distributions."""
    low = special.betaincinv(held, of - held + 1, 0.025) if held > 0 else 0.0
    high = special.betaincinv(held + 1, of - held, 0.975) if held < of else 1.0
    return float(low), float(high)


def agreement_words(agrees: bool, control: bool) -> str:
    """The verdict on intervals: as stated, or not; on a control: detected, or not."""
    if control:
        return "not detected" if agrees else "detected as wrong"
    return "as stated" if agrees else "not as stated"
