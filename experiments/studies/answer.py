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
import scipy

from ...analysis.observability.identifiability import identify
from ...analysis.status import Status, has_numbers, require_no_more_than
from ...analysis.status import versions as installed_versions
from ...model.arrays import Index, Mask, Matrix, normal_half_width
from ...model.likelihood.problem import Problem
from ...words.wording import label

SCHEMA: Final = "zerobeam/study/1"
ALARM = 0.01  # probability of a false alarm over all intervals of a part that is judged


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
        return (self.coverage,) if isinstance(self.coverage, Share) else self.coverage or ()


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


def estimated(problem: Problem) -> Index:
    """(m,) indices of the offsets that are estimated."""
    parameters = problem.parameters
    return np.flatnonzero(parameters.free & parameters.group("offset"))


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
    agrees = bool(scipy.stats.binomtest(held, of, level).pvalue >= alarm)
    return Share(level, held, of, held / of, *share_interval(held, of), agrees)


def share_interval(held: int, of: int) -> tuple[float, float]:
    """The exact 95 % interval of a share (Clopper and Pearson 1934), by quantiles of beta distributions."""
    low = scipy.special.betaincinv(held, of - held + 1, 0.025) if held > 0 else 0.0
    high = scipy.special.betaincinv(held + 1, of - held, 0.975) if held < of else 1.0
    return float(low), float(high)


def by_stds(off: Matrix, level: float) -> int:
    """How many intervals of a level contain the true value; `off` (R,) are the errors in u."""
    return int((np.abs(off) <= normal_half_width(level)).sum())


def observed(
    problem: Problem,
    error: Matrix,
    std: Matrix,
    kept: Mask,
    *,
    claims: bool = False,
    levels: Sequence[float] = (0.95,),
    held: Callable[[int, Mask, float], int] | None = None,
) -> tuple[ObservedParameter, ...]:
    """The rows of the m offsets of a problem over R runs with `error` and `std` (R, m), deg or mm, nan where
    a run does not determine the offset, of the runs `kept` (R,).

    What the nominal arm does not determine has no number, even if single runs were lucky enough to claim one,
    unless the part `claims` it: a control is judged by the numbers that it would have given. ALARM is over
    all. `held` counts the intervals of offset j in runs of a level that contain the true value (by default
    ± k u).
    """
    which, statuses = estimated(problem), identify(problem, problem.nominal()).status
    judged = [claims or has_numbers(statuses[i]) for i in which]
    alarm, rows = ALARM / max(sum(judged) * len(levels), 1), []
    for j, i in enumerate(which):
        item, some = problem.parameters.items[i], kept & np.isfinite(std[:, j])
        shares, errors = tuple[Share, ...](), ErrorStatistics()
        if judged[j] and some.any():
            off = error[some, j] / std[some, j]
            errors = accuracy(error[some, j], std[some, j])
            counts = [by_stds(off, at) if held is None else held(j, some, at) for at in levels]
            shares = tuple(held_share(n, len(off), at, alarm) for n, at in zip(counts, levels, strict=True))
        coverage = shares if len(levels) > 1 else shares[0] if shares else None
        rows.append(ObservedParameter(item.name, item.unit, statuses[i], *errors, coverage))
    return tuple(rows)


def judged_shares(
    rows: Iterable[ObservedParameter], control: bool, *, level: float = 0.95, more: str = ""
) -> tuple[bool, str]:
    """Whether there are shares and all agree; and the share farthest from its level in words, with whether
    the intervals are as stated, of a control whether it is detected."""
    shares = [(row.name, one) for row in rows for one in row.shares]
    agrees = bool(shares) and all(one.agrees for _, one in shares)
    if not shares:
        return agrees, "All offsets are unidentifiable"
    name, worst = max(
        (entry for entry in shares if entry[1].level == level), key=lambda entry: abs(entry[1].share - level)
    )
    verdict = ("as stated", "not as stated", "not detected", "detected as wrong")[2 * control + (not agrees)]
    return agrees, (
        f"{100 * level:g} % intervals contain the true value in {100 * worst.share:.1f} % at the worst"
        f" ({label(name)}){more}: {verdict}"
    )
