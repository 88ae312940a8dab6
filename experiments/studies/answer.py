"""Fields common to the answers of all studies (`study.json`, docs/files-studies.md), and how intervals are
judged.

Units are those that people read (deg, mm, s). What a plan does not identify has no number, save in a
control, which is wrong on purpose: the dataclasses refuse to be made otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from scipy import special, stats

from ...analysis.status import Status, require_no_more_than
from ...analysis.status import versions as installed_versions
from ...model.arrays import Mask, Matrix, normal_half_width
from ...model.likelihood.parameters import Parameter
from ...model.likelihood.problem import Problem
from ...words.wording import label

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
    seconds: float = 0.0  # that it took
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
    """How many of the intervals of `level` contain the true value: the share, with its 95 % binomial interval
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
    `bias_mcse`, rmse, the root mean square of the standard uncertainties that the runs state, and the share
    of its intervals of one level or of each; None, or no shares, where no run determines the parameter."""

    name: str
    unit: str
    status: Status
    bias: float | None = None
    bias_mcse: float | None = None
    rmse: float | None = None
    predicted_std: float | None = None
    coverage: Share | tuple[Share, ...] | None = None

    @property
    def shares(self) -> tuple[Share, ...]:
        """The shares that there are, one a level."""
        if isinstance(self.coverage, Share):
            return (self.coverage,)
        return self.coverage or ()


@dataclass(frozen=True, kw_only=True)
class JudgedPart:
    """A part of a study with numbers that must agree with what they should be, and a sentence on them. A
    `control` is wrong on purpose, and must not agree.

    Raises UnsoundResult where a parameter that is not determined has a number, unless it is a control.
    """

    name: str
    control: bool
    agrees: bool
    sentence: str
    parameters: tuple[Any, ...]

    def __post_init__(self) -> None:
        for row in () if self.control else self.parameters:
            if isinstance(row, ObservedParameter):
                numbers = {one.name: getattr(row, one.name) or None for one in fields(row)[3:]}
                require_no_more_than(f"{row.name} of {self.name}", row.status, **numbers)


@dataclass(frozen=True, kw_only=True)
class JudgedEstimator(JudgedPart):
    """An estimator on a plan; `converged` counts what it has a fit of."""

    words: str
    converged: int
    parameters: tuple[ObservedParameter, ...]


@dataclass(frozen=True, kw_only=True)
class PlanOfStudy:
    """A plan and what was made of it; `failed` counts what was drawn again, or did not end."""

    name: str
    words: str
    robot: str
    shots: int
    noise: NoiseLevel
    failed: int


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
    """The share of intervals of `level` that contain the true value.

    It agrees unless the p-value of the exact binomial test is below `alarm`.
    """
    agrees = bool(stats.binomtest(held, of, level).pvalue >= alarm)
    return Share(level, held, of, held / of, *share_interval(held, of), agrees)


def share_interval(held: int, of: int) -> tuple[float, float]:
    """The exact 95 % interval of a share (Clopper and Pearson 1934), by quantiles of beta distributions."""
    low = special.betaincinv(held, of - held + 1, 0.025) if held > 0 else 0.0
    high = special.betaincinv(held + 1, of - held, 0.975) if held < of else 1.0
    return float(low), float(high)


def by_stds(off: Matrix, level: float) -> int:
    """How many intervals of a level contain the true value; `off` (R,) are the errors in u."""
    return int((np.abs(off) <= normal_half_width(level)).sum())


def observed(
    items: Sequence[Parameter],
    status: Sequence[Status],
    judged: Sequence[bool],
    error: Matrix,
    std: Matrix,
    kept: Mask,
    alarm: float,
    levels: Sequence[float] = (0.95,),
    held: Callable[[int, Mask, float], int] | None = None,
) -> tuple[ObservedParameter, ...]:
    """The rows of m parameters over R runs with `error` and `std` (R, m), deg or mm, nan where a run does not
    determine the parameter, of the runs `kept` (R,).

    Those that are not `judged` have no number. `alarm` is the probability of a false alarm over all. `held`
    counts the intervals of parameter j in runs of a level that contain the true value (by default ± k u).
    """
    alarm /= max(sum(judged) * len(levels), 1)
    rows = []
    for j, item in enumerate(items):
        shares: tuple[Share, ...] = ()
        errors, some = ErrorStatistics(), kept & np.isfinite(std[:, j])
        if judged[j] and some.any():
            off = error[some, j] / std[some, j]
            errors = accuracy(error[some, j], std[some, j])
            counts = [by_stds(off, at) if held is None else held(j, some, at) for at in levels]
            shares = tuple(
                held_share(count, len(off), at, alarm) for count, at in zip(counts, levels, strict=True)
            )
        coverage = shares if len(levels) > 1 else shares[0] if shares else None
        rows.append(ObservedParameter(item.name, item.unit, status[j], *errors, coverage))
    return tuple(rows)


def all_agree(rows: Iterable[ObservedParameter]) -> bool:
    """Whether there are shares and all agree."""
    shares = [share for row in rows for share in row.shares]
    return bool(shares) and all(share.agrees for share in shares)


def worst_share(
    rows: Iterable[ObservedParameter], agrees: bool, control: bool, *, level: float = 0.95, more: str = ""
) -> str:
    """The share farthest from its level in words, and whether the intervals are as stated; of a control,
    whether it is detected."""
    shares = [(abs(one.share - level), row.name, one) for row in rows for one in row.shares]
    shares = [entry for entry in shares if entry[-1].level == level]
    if not shares:
        return "All offsets are unidentifiable"
    _, name, worst = max(shares, key=lambda entry: entry[0])
    verdict = ("as stated", "not as stated", "not detected", "detected as wrong")[2 * control + (not agrees)]
    return (
        f"{100 * level:g} % intervals contain the true value in {100 * worst.share:.1f} % at the worst"
        f" ({label(name)}){more}: {verdict}"
    )
