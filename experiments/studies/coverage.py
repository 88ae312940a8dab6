"""Do the intervals contain the true value as often as stated? Coverage and simulation-based calibration.

Every simulated data set has true parameters of its own, drawn from the priors. It is solved by the likelihood
fit, by the paper's midpoint fit with its sandwich covariance, and by its posterior. A 95 % interval must hold
the truth in 95 % of the data sets, and the rank of the truth among the posterior's draws must be uniform
(Talts et al. 2018). Two wrong estimators are carried along as negative controls.

The fits are those of `analyse` (`fit_each`, the batch of `fit_likelihood`), and so are density, coordinates
and proposal of the posterior (`drawn_together`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy import stats

from ...analysis.posterior.many_posteriors import PROPOSED, TOGETHER, drawn_together
from ...model.arrays import Index, Mask, Matrix
from ...model.files.header import Header
from ...model.kernel import compiled_at_once, one_blas_thread
from ...model.likelihood.density import Density
from ...model.likelihood.parameters import Parameter
from ...model.likelihood.problem import Problem
from ...model.records import it
from ...words.numbers import percent
from ...words.wording import listed
from .answer import (
    ALARM,
    JudgedEstimator,
    JudgedPart,
    NoiseLevel,
    PlanOfStudy,
    StudyAnswer,
    estimated,
    judged_shares,
    observed,
)
from .cases import Engine
from .data_sets import (
    MEASUREMENTS,
    SIGMA_MM,
    DataSets,
    Estimates,
    StoredMatrix,
    drawn,
    fitted,
    laser_header,
    likelihood,
    midpoint,
    optimal_postures,
    pseudo_inverse,
    robot_of,
    understated,
    y_postures,
)

SIZE = TOGETHER  # data sets of a piece
DRAWS = 199  # of each posterior: central intervals of 50, 90, 95 and 99 % are then exact by ranks
BINS = 20
LEVELS = (0.5, 0.9, 0.95, 0.99)
_CANDIDATES, _SHORT = 2000, 0.4
_POWER_RATIOS = (0.9, 0.8, 0.7)


@dataclass(frozen=True)
class RankedParameter:
    """How often the rank of the truth fell into each bin, and the chi-squared test for uniform ranks; the
    test is None where there are no ranks."""

    name: str
    unit: str
    ranks: tuple[int, ...]
    chi2: float | None
    p_value: float | None


@dataclass(frozen=True, kw_only=True)
class RankCalibration(JudgedPart):
    """The rank histograms of one sampler; `power` says which errors the test would detect."""

    parameters: tuple[RankedParameter, ...]
    power: str


@dataclass(frozen=True, kw_only=True)
class CoveragePlan(PlanOfStudy):
    """One plan: `failed` counts truths drawn again because the arm cannot hit the target, `acceptance` is the
    share of the posteriors' proposals that a chain accepts, `sbc` is simulation-based calibration."""

    data_sets: int
    acceptance: float
    estimators: tuple[JudgedEstimator, ...]
    sbc: tuple[RankCalibration, ...]


@dataclass(frozen=True)
class CoverageSettings:
    """How the study was carried out."""

    data_sets: Annotated[int, it("data sets for each plan")]
    seed: Annotated[int, it("seed")]
    levels: Annotated[tuple[float, ...], it("levels of the intervals")]
    draws: Annotated[int, it("draws behind each rank")]
    bins: Annotated[int, it("bins of the rank histograms")]
    chance: Annotated[float, it("probability of a false alarm of an estimator")]
    posterior: Annotated[str, it("posterior")]


@dataclass(frozen=True, kw_only=True)
class CoverageStudy(StudyAnswer):
    """The whole answer."""

    settings: CoverageSettings
    plans: tuple[CoveragePlan, ...]


@dataclass(frozen=True, eq=False)
class StudiedPlan:
    """A plan of the study. `degenerate`: an offset is unidentifiable; `curved`: its residuals are so far from
    linear that intervals from the curvature at the mode need not hold."""

    name: str
    words: str
    problem: Problem
    degenerate: bool = False
    curved: bool = False


def studied_plans(seed: int) -> list[StudiedPlan]:
    """From good to degenerate, for the built-in arm: a laser, one target, seven measurements."""
    header = laser_header(0.01, 0.05, SIGMA_MM)
    free = header.model_copy(update={"held": ()})
    best = optimal_postures(header, _CANDIDATES, seed)

    def problem(postures: Matrix, of: Header = header) -> Problem:
        return Problem.build(of, robot_of(of), postures, ["psd"] * MEASUREMENTS)

    y_pattern = f"Y-Pattern of {MEASUREMENTS} measurements over"
    optimal = f"{MEASUREMENTS} A-optimal measurements of {_CANDIDATES} postures"
    short = f"{y_pattern} {_SHORT:g} of the reach"
    same = "the good plan with joint 1 free: its offset is equivalent to a rotation of arm and target"
    return [
        StudiedPlan("good", optimal, problem(best)),
        StudiedPlan("weak", f"{y_pattern} the arm's whole reach", problem(y_postures(header))),
        StudiedPlan("nearly degenerate", short, problem(y_postures(header, _SHORT)), curved=True),
        StudiedPlan("degenerate", same, problem(best, free), degenerate=True),
    ]


@dataclass(frozen=True)
class CoveragePieceAnswer:
    """The estimates of a piece, the posterior's second; `ranks` of the truths among the draws; the share of
    proposals that were `accepted`."""

    estimates: tuple[Estimates, ...]
    ranks: StoredMatrix
    accepted: float


def coverage_study(data_sets: int, engine: Engine) -> CoverageStudy:
    """Carry out the whole study.

    It agrees if the intervals of the posterior, those of the likelihood's curvature where the plan is not
    nearly degenerate, and the ranks are as stated, and every control is detected. The midpoint fit is the
    paper's: where its intervals do not hold, that is a finding.
    """
    with one_blas_thread(), compiled_at_once():
        plans = studied_plans(engine.seed)
    answers = studied(plans, data_sets, engine)
    hold, detected, findings = all(part.agrees for answer in answers for part in answer.sbc), True, []
    for plan, answer in zip(plans, answers, strict=True):
        for estimator in answer.estimators:
            if estimator.control:
                detected &= not estimator.agrees
            elif estimator.name == "midpoint" or (estimator.name == "likelihood" and plan.curved):
                findings += [] if estimator.agrees else [f"{estimator.name} on {plan.name}"]
            else:
                hold &= estimator.agrees
    headline = (
        f"Over {data_sets} simulated data sets of each plan, the intervals that zerobeam shows"
        f" {'contain' if hold else 'do not contain'} the true value as often as stated."
        f" {'Every control is detected.' if detected else 'A control is not detected.'}"
    )
    return CoverageStudy(
        study="coverage",
        title="Do the intervals contain the true value as often as stated?",
        headline=headline + (f" Do not rely on the intervals of {listed(findings)}." if findings else ""),
        agrees=hold and detected,
        settings=CoverageSettings(
            data_sets=data_sets,
            seed=engine.seed,
            levels=LEVELS,
            draws=DRAWS,
            bins=BINS,
            chance=ALARM,
            posterior=f"{DRAWS} draws chosen by their weights among {PROPOSED * DRAWS} of the proposal; where"
            " the weights do not serve, by emcee",
        ),
        plans=tuple(answers),
        notes=(
            "Every data set has true parameters of its own, drawn from the priors of the fits: offsets of 5°"
            f" (one standard deviation), the target {SIGMA_MM:g} mm about its guess.",
            f"An estimator agrees if the p-value of none of its shares is below {percent(ALARM)} over all"
            " levels and offsets together (exact binomial test, Bonferroni). The intervals shown are 95 %"
            " (Clopper and Pearson).",
            "Intervals from the curvature at the mode are for plans that are not nearly degenerate: where a"
            " direction is weakly observable a result also shows the intervals of profile and posterior.",
            "The midpoint fit uses no spot reading and no prior, and starts from zero offsets as in the"
            " paper: where it ends in another local optimum its error is large, and the rmse includes those"
            " runs. Its sandwich covariance is linear; on poor plans its errors are not.",
        ),
    )


def studied(plans: Sequence[StudiedPlan], count: int, engine: Engine) -> list[CoveragePlan]:
    """The answers of the plans, `count` data sets each. Data sets and random numbers are those of the seed,
    the plan and the piece, whoever works it out."""
    data, pieces = list[DataSets](), list[tuple[DataSets, bool, np.random.Generator]]()
    counts = []
    for plan in plans:
        rng = np.random.default_rng([engine.seed, *plan.name.encode()])
        with one_blas_thread(), compiled_at_once():
            data.append(drawn(plan.problem, count, rng))
        starts = range(0, len(data[-1].truths), SIZE)
        counts.append(len(starts))
        for start, piece_rng in zip(starts, rng.spawn(len(starts)), strict=True):
            pieces.append((data[-1].some(slice(start, start + SIZE)), plan.degenerate, piece_rng))
    answers = iter(
        engine.each("coverage", CoveragePieceAnswer, answer_of, pieces, data_sets=count, piece=SIZE)
    )
    return [
        _joined(plan, of_plan, [next(answers) for _ in range(number)])
        for plan, of_plan, number in zip(plans, data, counts, strict=True)
    ]


def answer_of(piece: tuple[DataSets, bool, np.random.Generator]) -> CoveragePieceAnswer:
    """All estimators of the data sets of a piece, of a plan that is degenerate or not; the random numbers are
    those of the posteriors."""
    data, degenerate, rng = piece
    problem = data.problem
    which, parameters = estimated(problem), problem.parameters
    fits = fitted(data)
    draws, accepted = drawn_together(Density(problem, data.joints, data.spots), fits, DRAWS, rng)
    draws = draws[:, :, parameters.among_free[which]]
    scale, mean, true = parameters.prior_std[which], parameters.prior_mean[which], data.truths[:, which]
    ranks = (draws < ((true - mean) / scale)[:, None]).sum(axis=1)
    words = f"posterior, intervals between quantiles of {DRAWS} draws"
    value, std = draws.mean(axis=1) * scale + mean, draws.std(axis=1, ddof=1) * scale
    estimates = (
        likelihood(data, fits, which),
        Estimates("posterior", words, False, value, std, fits.converged),
        *(() if degenerate else (midpoint(data, which),)),
        understated(data, which),
        *((pseudo_inverse(data, fits, which),) if degenerate else ()),
    )
    return CoveragePieceAnswer(estimates, ranks.astype(float), accepted)


def _joined(plan: StudiedPlan, data: DataSets, answers: Sequence[CoveragePieceAnswer]) -> CoveragePlan:
    """A plan of the study, by the answers of all its pieces."""
    problem, which = plan.problem, estimated(plan.problem)

    def table(parts: Iterable[Matrix]) -> Matrix:
        """(W, m) of all pieces, whose own shape is not kept."""
        return np.concatenate([part.reshape(-1, len(which)) for part in parts])

    items = [problem.parameters.items[i] for i in which]
    ranks = table(answer.ranks for answer in answers).astype(np.int64)
    sizes = [len(answer.estimates[0].kept) for answer in answers]
    display = np.array([item.display for item in items])

    def held_by_ranks(j: int, some: Mask, level: float) -> int:
        """Of central intervals between draws, of which each level holds a whole number of ranks."""
        cut = round((1 - level) / 2 * (DRAWS + 1))
        return int(((ranks[some, j] >= cut) & (ranks[some, j] <= DRAWS - cut)).sum())

    estimators = []
    for parts in zip(*(answer.estimates for answer in answers), strict=True):
        one, kept = parts[0], np.concatenate([part.kept for part in parts])
        error = (table(part.value for part in parts) - data.truths[:, which]) * display
        std = table(part.std for part in parts) * display
        held = held_by_ranks if one.name == "posterior" else None
        rows = observed(problem, error, std, kept, claims=one.control, levels=LEVELS, held=held)
        agrees, sentence = judged_shares(rows, one.control)
        estimators.append(
            JudgedEstimator(
                name=one.name,
                words=one.words,
                control=one.control,
                agrees=agrees,
                converged=int(kept.sum()),
                sentence=f"{sentence} on this plan" if one.control and agrees else sentence,
                parameters=rows,
            )
        )
    return CoveragePlan(
        name=plan.name,
        words=plan.words,
        robot=problem.robot.name,
        shots=problem.shots,
        noise=NoiseLevel.of_problem(problem),
        data_sets=len(data.truths),
        failed=data.failed,
        acceptance=float(np.average([answer.accepted for answer in answers], weights=sizes)),
        estimators=tuple(estimators),
        sbc=(calibration(items, ranks, ALARM),),
    )


def calibration(items: Sequence[Parameter], ranks: Index, false_alarm: float) -> RankCalibration:
    """The ranks (W, m) of the parameters `items` among DRAWS draws.

    It agrees if no p-value is below `false_alarm` over the number of parameters (Bonferroni).
    """
    rows = []
    for j, item in enumerate(items):
        counts = np.bincount(ranks[:, j] * BINS // (DRAWS + 1), minlength=BINS)
        chi2, p = stats.chisquare(counts)
        rows.append(RankedParameter(item.name, item.unit, tuple(map(int, counts)), float(chi2), float(p)))
    least = min((float(row.p_value or 0.0) for row in rows), default=1.0)
    alarm = false_alarm / max(len(rows), 1)
    powers = [
        f"{percent(1 - ratio)} would be detected with probability {power(len(ranks), alarm, ratio):.2f}"
        for ratio in _POWER_RATIOS
    ]
    return RankCalibration(
        name="posterior",
        control=False,
        agrees=least >= alarm,
        sentence=f"The ranks of the true value among the draws are {'' if least >= alarm else 'not '}uniform"
        f" (smallest p-value {least:.2g} of {len(rows)})",
        parameters=tuple(rows),
        power=f"u too small by {', by '.join(powers)}",
    )


def power(count: int, alarm: float, ratio: float) -> float:
    """Probability that the chi-squared test of `count` ranks detects stds that are `ratio` of the right
    ones."""
    edges = stats.norm.cdf(stats.norm.ppf(np.linspace(0, 1, BINS + 1)) * ratio)
    excess = float(count * BINS * ((np.diff(edges) - 1 / BINS) ** 2).sum())
    return float(stats.ncx2.sf(stats.chi2.isf(alarm, BINS - 1), BINS - 1, excess))
