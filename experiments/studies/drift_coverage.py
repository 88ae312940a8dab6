"""Do the intervals and alarms of `history drift` hold? Arms with known drift and jumps, simulated and judged.

Each arm has results at equal intervals with the covariance of a real plan, some without one of the offsets.
Every other arm has one jump. The control ignores the correlation of the offsets of a result.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import numpy as np
from scipy import stats

from ...analysis.drift.drift import ALARM, LEVEL, MEDIAN, SPREAD, Drift, drift
from ...analysis.drift.smoother import Observation, Series, series_of
from ...analysis.ladder import solve_run
from ...analysis.repeatability.consistency import offsets_without_prior
from ...model.arrays import Matrix
from ...model.files.header import EXACT
from ...model.files.run import read_run
from ...model.kernel import compiled_at_once, one_blas_thread
from ...model.likelihood.problem import Problem
from ...model.records import it
from ..demos import demo_runs
from .answer import Share, StudyAnswer, held_share, share_interval
from .cases import Engine

_RESULTS, _QUARTER = 12, 0.25  # results of an arm, years between two
_LOST = 0.1  # share of the results that do not determine the first offset
_BETTER, _WORSE = 0.5, 2.0  # a result's standard uncertainties over those of the plan
_SIZES = (2.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0)  # of a jump, in u of the plan
_FALSE_ALARM = 0.001  # of a false alarm of each comparison of this study
_SIZE = 5  # arms of a piece: a second or two of work


@dataclass(frozen=True)
class DriftSettings:
    """How the study was carried out."""

    arms: Annotated[int, it("arms")]
    results: Annotated[int, it("results of an arm")]
    years_between: Annotated[float, it("years between two results")]
    alarm: Annotated[float, it("stated probability of a false alarm of an arm")]
    level: Annotated[float, it("level of the intervals")]
    rate_median: Annotated[float, it("median drift of an offset, ° per root year (log-normal)")]
    rate_spread: Annotated[float, it("standard deviation of the logarithm of the drift")]
    chance: Annotated[float, it("probability of a false alarm of each comparison of this study")]
    seed: Annotated[int, it("seed")]


@dataclass(frozen=True)
class Alarms:
    """Arms without a jump, and those of them with an alarm; `p_uniform` of the p-values of single tests
    (Kolmogorov and Smirnov)."""

    arms: int
    alarms: int
    share: float
    low: float
    high: float
    p_uniform: float
    agrees: bool


@dataclass(frozen=True)
class Power:
    """Jumps of one size, in standard uncertainties of the plan: how many were found at their offset and
    interval; the 95 % binomial interval of the share."""

    size_u: float
    found: int
    of: int
    share: float
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class DriftStudy(StudyAnswer):
    """The whole answer, of a random result of each arm. `intervals`: of a random combination of the offsets;
    `along_axis`: of the combination that the plan determines worst (the first principal axis of its
    correlations); `control`: of that one by the control."""

    settings: DriftSettings
    intervals: Share
    along_axis: Share
    control: Share
    alarms: Alarms
    power: tuple[Power, ...]


@dataclass(frozen=True)
class JudgedArm:
    """Whether the intervals hold, and whether there was an alarm; of an arm without a jump one p-value, else
    the size of the jump in u and whether it was found."""

    held: bool
    on_axis: bool
    by_control: bool
    alarmed: bool
    p_value: float | None
    size_u: float | None
    found: bool


class _Piece(NamedTuple):
    """Some arms by their numbers, and the plan by which all are measured."""

    seed: int
    numbers: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    covariance: Matrix


def drift_study(arms: int, engine: Engine) -> DriftStudy:
    """Simulate and judge so many arms."""
    with one_blas_thread(), compiled_at_once():
        plan = _plan()
    firsts = range(0, arms, _SIZE)
    pieces = [_Piece(engine.seed, tuple(range(at, min(at + _SIZE, arms))), *plan) for at in firsts]
    answers = engine.each("drift", tuple[JudgedArm, ...], _answer_of, pieces, arms=arms, piece=_SIZE)
    judged = [arm for answer in answers for arm in answer]
    intervals, along_axis, control = (
        held_share(sum(getattr(arm, name) for arm in judged), arms, LEVEL, _FALSE_ALARM)
        for name in ("held", "on_axis", "by_control")
    )
    still = [arm for arm in judged if arm.p_value is not None]
    quiet, alarmed = len(still), sum(arm.alarmed for arm in still)
    p_uniform = float(stats.kstest([arm.p_value for arm in still], "uniform").pvalue)
    too_many = stats.binomtest(alarmed, quiet, ALARM, alternative="greater").pvalue < _FALSE_ALARM
    rare = bool(not too_many and p_uniform >= _FALSE_ALARM)
    hold = intervals.agrees and along_axis.agrees
    power = []
    for size in _SIZES:
        detected = [arm.found for arm in judged if arm.size_u == size]
        if detected:
            power.append(Power(size, *_share(sum(detected), len(detected))))
    alarm_share = _share(alarmed, quiet)
    return DriftStudy(
        study="drift",
        title="Do intervals and alarms of a drift hold?",
        headline=f"The intervals {'hold' if hold else 'do not hold'}, false alarms are"
        f" {'at most as often as stated' if rare else 'not as stated'}; the control without correlations"
        f" {'is not found wrong' if control.agrees else 'is found wrong'}.",
        agrees=hold and rare and not control.agrees,
        notes=(),
        settings=DriftSettings(
            arms, _RESULTS, _QUARTER, ALARM, LEVEL, MEDIAN, SPREAD, _FALSE_ALARM, engine.seed
        ),
        intervals=intervals,
        along_axis=along_axis,
        control=control,
        alarms=Alarms(quiet, alarmed, *alarm_share[2:], p_uniform, rare),
        power=tuple(power),
    )


def _share(count: int, of: int) -> tuple[int, int, float, float, float]:
    """So many of so many, the share, and its 95 % interval."""
    return count, of, count / of, *share_interval(count, of)


def _answer_of(piece: _Piece) -> tuple[JudgedArm, ...]:
    axis = _principal_axis(piece.covariance)
    return tuple(_judged_arm(piece, number, axis) for number in piece.numbers)


def _judged_arm(piece: _Piece, number: int, axis: Matrix) -> JudgedArm:
    random = np.random.default_rng([piece.seed, number])
    series, true, jump = _simulated(random, piece, number)
    alone = tuple(replace(one, covariance=np.diag(np.diag(one.covariance))) for one in series.observations)
    judged = drift(series, seed=number)
    control = drift(replace(series, observations=alone), seed=number)  # as if nothing were correlated
    t, along = int(random.integers(_RESULTS)), random.normal(size=len(piece.names))
    held = (
        _holds(judged, t, along, true[t]),
        _holds(judged, t, axis, true[t]),
        _holds(control, t, axis, true[t]),
    )
    if jump is None:
        p_value = float(random.choice(judged.p_first[np.isfinite(judged.p_first)]))
        return JudgedArm(*held, bool(judged.jumps), p_value, None, False)
    after, joint, size = jump
    detected = any((one.place, one.offset) == (after, piece.names[joint]) for one in judged.jumps)
    return JudgedArm(*held, bool(judged.jumps), None, size, detected)


def _plan() -> tuple[tuple[str, ...], tuple[str, ...], Matrix]:
    """Offsets of the demo's good run with their whole covariance, by the noise alone: of an exact arm."""
    run = read_run(next(demo.path for demo in demo_runs() if demo.name == "good"))
    exact = run.header.model_copy(update={"geometry": EXACT})
    alone = offsets_without_prior(solve_run(Problem.from_run(replace(run, header=exact)), exact))
    assert alone is not None
    return alone.names, alone.units, np.array(alone.covariance)


def _principal_axis(covariance: Matrix) -> Matrix:
    """(m,) the combination of the offsets, each over its u, with the largest variance."""
    std = np.sqrt(np.diag(covariance))
    _, axes = np.linalg.eigh(covariance / np.outer(std, std))
    return np.asarray(axes[:, -1] / std)


def _simulated(
    random: np.random.Generator, piece: _Piece, number: int
) -> tuple[Series, Matrix, tuple[int, int, float] | None]:
    """The results of an arm, its true offsets (T, m), and its jump, if it has one: after which result, of
    which offset, size in u."""
    covariance, size = piece.covariance, len(piece.names)
    rates = MEDIAN * np.exp(SPREAD * random.normal(size=size))
    steps = random.normal(size=(_RESULTS - 1, size)) * rates * np.sqrt(_QUARTER)
    true = np.cumsum(np.vstack([random.normal(size=size), steps]), axis=0)
    jump = None
    if number % 2:
        after, joint = int(random.integers(_RESULTS - 1)), int(random.integers(size))
        jump = after, joint, _SIZES[number // 2 % len(_SIZES)]
        true[after + 1 :, joint] += jump[2] * np.sqrt(covariance[joint, joint])
    observations = []
    for t in range(_RESULTS):
        scaled = covariance * random.uniform(_BETTER, _WORSE) ** 2
        values = random.multivariate_normal(true[t], scaled)
        kept = np.arange(int(random.random() < _LOST), size)
        named, part = tuple(piece.names[i] for i in kept), scaled[np.ix_(kept, kept)]
        observations.append(Observation(t * _QUARTER, named, values[kept], part, np.zeros_like(part)))
    return series_of(observations, dict(zip(piece.names, piece.units, strict=True))), true, jump


def _holds(judged: Drift, t: int, along: Matrix, true: Matrix) -> bool:
    low, high = judged.interval(t, along)
    return bool(low <= along @ true <= high)
