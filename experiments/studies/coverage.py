"""Do the intervals contain the true value as often as stated? Coverage and simulation-based calibration.

Every simulated data set has true parameters of its own, drawn from the priors. It is solved by the likelihood
fit, by the paper's midpoint fit with its sandwich covariance, and by its posterior. A 95 % interval must hold
the truth in 95 % of the data sets, and the rank of the truth among the posterior's draws must be uniform
(Talts et al. 2018). Two wrong estimators are carried along as negative controls.

The fits are those of `analyse` (`fit_each`, the batch of `fit_likelihood`), and so are density, coordinates,
moves and steps of the posterior (`drawn_together` says what is not).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Annotated

import numpy as np
from scipy import stats

from ...analysis.estimation.threads import one_blas_thread
from ...analysis.observability.identifiability import identify
from ...analysis.posterior.many_posteriors import LEAST_STEPS, TOGETHER, drawn_together
from ...analysis.posterior.sampler import ROUND
from ...analysis.status import has_numbers
from ...model.arrays import Index, Mask, Matrix
from ...model.likelihood.density import Density
from ...model.likelihood.kernel import compiled_at_once
from ...model.likelihood.parameters import Parameter
from ...model.likelihood.problem import Problem
from ...model.records import it
from ...words.wording import listed
from .answer import (
    JudgedEstimator,
    JudgedPart,
    NoiseLevel,
    PlanOfStudy,
    StudyAnswer,
    all_agree,
    observed,
    worst_share,
)
from .cases import Engine
from .data_sets import (
    DataSets,
    Estimates,
    StoredMatrix,
    drawn,
    fitted,
    likelihood,
    midpoint,
    pseudo_inverse,
    understated,
)
from .laser_plans import MEASUREMENTS, SIGMA_MM, laser_header, optimal_postures, robot_of, y_postures

SIZE = TOGETHER  # data sets of a piece
DRAWS = 199  # of each posterior: central intervals of 50, 90, 95 and 99 % are then exact by ranks
BINS = 20
LEVELS = (0.5, 0.9, 0.95, 0.99)
_CANDIDATES, _SHORT = 2000, 0.4
_ALARM = 0.01  # probability of a false alarm over all levels and parameters of an estimator
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
    share of the posteriors' proposals that were accepted, `sbc` is simulation-based calibration."""

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
    robot, psd = robot_of(header), ["psd"] * MEASUREMENTS
    best = optimal_postures(header, _CANDIDATES, seed)
    return [
        StudiedPlan(
            "good",
            f"{MEASUREMENTS} A-optimal measurements of {_CANDIDATES} postures",
            Problem.build(header, robot, best, psd),
        ),
        StudiedPlan(
            "weak",
            f"Y-Pattern of {MEASUREMENTS} measurements over the arm's whole reach",
            Problem.build(header, robot, y_postures(header), psd),
        ),
        StudiedPlan(
            "nearly degenerate",
            f"Y-Pattern of {MEASUREMENTS} measurements over {_SHORT:g} of the reach",
            Problem.build(header, robot, y_postures(header, _SHORT), psd),
            curved=True,
        ),
        StudiedPlan(
            "degenerate",
            "the good plan with joint 1 free: its offset is equivalent to a rotation of arm and target",
            Problem.build(header.model_copy(update={"held": ()}), robot, best, psd),
            degenerate=True,
        ),
    ]


@dataclass(frozen=True, eq=False)
class CoveragePiece:
    """Data sets of one plan, and the random numbers of their posteriors."""

    data: DataSets
    degenerate: bool
    rng: np.random.Generator


@dataclass(frozen=True)
class CoveragePieceAnswer:
    """The estimates of a piece, the posterior's second; `ranks` of the truths among the draws; the share of
    proposals that were `accepted`."""

    estimates: tuple[Estimates, ...]
    ranks: StoredMatrix
    accepted: float


def coverage_study(
    data_sets: int,
    engine: Engine,
) -> CoverageStudy:
    """Carry out the whole study.

    It agrees if the intervals of the posterior, those of the likelihood's curvature where the plan is not
    nearly degenerate, and the ranks are as header, and every control is detected. The midpoint fit is the
    paper's: where its intervals do not hold, that is a finding.
    """
    with one_blas_thread(), compiled_at_once():
        plans = studied_plans(engine.seed)
    answers = studied(plans, data_sets, engine)
    must, findings, detected = [part.agrees for answer in answers for part in answer.sbc], [], []
    for plan, answer in zip(plans, answers, strict=True):
        for estimator in answer.estimators:
            if estimator.control:
                detected.append(not estimator.agrees)
            elif estimator.name == "midpoint" or (estimator.name == "likelihood" and plan.curved):
                findings += [] if estimator.agrees else [f"{estimator.name} on {plan.name}"]
            else:
                must.append(estimator.agrees)
    return CoverageStudy(
        study="coverage",
        title="Do the intervals contain the true value as often as stated?",
        headline=_headline(data_sets, all(must), all(detected), findings),
        agrees=all((*must, *detected)),
        settings=CoverageSettings(
            data_sets=data_sets,
            seed=engine.seed,
            levels=LEVELS,
            draws=DRAWS,
            bins=BINS,
            chance=_ALARM,
            posterior=f"at least {ROUND + LEAST_STEPS} steps of emcee for each of {DRAWS} walkers",
        ),
        plans=tuple(answers),
        notes=(
            "Every data set has true parameters of its own, drawn from the priors of the fits: offsets of 5°"
            f" (one standard deviation), the target {SIGMA_MM:g} mm about its guess.",
            f"An estimator agrees if the p-value of none of its shares is below {_ALARM:.0%} over all levels"
            " and offsets together (exact binomial test, Bonferroni). The intervals shown are 95 % (Clopper"
            " and Pearson).",
            "Intervals from the curvature at the mode are for plans that are not nearly degenerate: where a"
            " direction is weakly observable a result also shows the intervals of profile and posterior.",
            "The midpoint fit uses no spot reading and no prior, and starts from zero offsets as in the"
            " paper: where it ends in another local optimum its error is large, and the rmse includes those"
            " runs. Its sandwich covariance is linear; on poor plans its errors are not.",
        ),
    )


def _headline(data_sets: int, hold: bool, detected: bool, findings: Sequence[str]) -> str:
    parts = [
        f"Over {data_sets} simulated data sets of each plan, the intervals that zerobeam shows"
        f" {'contain' if hold else 'do not contain'} the true value as often as stated.",
        "Every control is detected." if detected else "A control is not detected.",
    ]
    if findings:
        parts.append(f"Do not rely on the intervals of {listed(list(findings))}.")
    return " ".join(parts)


def studied(
    plans: Sequence[StudiedPlan],
    count: int,
    engine: Engine,
) -> list[CoveragePlan]:
    """The answers of the plans, `count` data sets each. Data sets and random numbers are those of the seed,
    the plan and the piece, whoever works it out."""
    data: list[DataSets] = []
    pieces: list[list[CoveragePiece]] = []
    for plan in plans:
        rng = np.random.default_rng([engine.seed, *plan.name.encode()])
        with one_blas_thread(), compiled_at_once():
            data_sets = drawn(plan.problem, count, rng)
        starts = range(0, len(data_sets.truths), SIZE)
        data.append(data_sets)
        pieces.append(
            [
                CoveragePiece(data_sets.some(slice(start, start + SIZE)), plan.degenerate, piece_rng)
                for start, piece_rng in zip(starts, rng.spawn(len(starts)), strict=True)
            ]
        )
    every = [*chain(*pieces)]
    answers = iter(
        engine.each("coverage", CoveragePieceAnswer, answer_of, every, data_sets=count, piece=SIZE)
    )
    return [
        _joined(plan, data_sets, [next(answers) for _ in of_plan])
        for plan, data_sets, of_plan in zip(plans, data, pieces, strict=True)
    ]


def estimated(problem: Problem) -> Index:
    """(m,) indices of the offsets that are estimated."""
    parameters = problem.parameters
    return np.flatnonzero(parameters.free & parameters.group("offset"))


def answer_of(piece: CoveragePiece) -> CoveragePieceAnswer:
    """All estimators of the data sets of a piece."""
    data, problem = piece.data, piece.data.problem
    which, parameters = estimated(problem), problem.parameters
    fits = fitted(data)
    estimates = [likelihood(data, fits, which), understated(data, which)]
    if piece.degenerate:
        estimates.append(pseudo_inverse(data, fits, which))
    else:
        estimates.insert(1, midpoint(data, which))
    draws, accepted = drawn_together(Density(problem, data.joints, data.spots), fits, DRAWS, piece.rng)
    draws = draws[:, :, parameters.among_free[which]]
    scale, mean, true = parameters.prior_std[which], parameters.prior_mean[which], data.truths[:, which]
    ranks = (draws < ((true - mean) / scale)[:, None]).sum(axis=1)
    of_draws = Estimates(
        "posterior",
        f"posterior, intervals between quantiles of {DRAWS} draws",
        False,
        draws.mean(axis=1) * scale + mean,
        draws.std(axis=1, ddof=1) * scale,
        fits.converged,
    )
    estimates.insert(1, of_draws)
    return CoveragePieceAnswer(tuple(estimates), ranks.astype(float), accepted)


def joined(answers: Sequence[CoveragePieceAnswer], offsets: int) -> tuple[list[Estimates], Index]:
    """The estimators of all pieces of a plan with so many `offsets`, and the ranks (W, m)."""

    def table(parts: Sequence[Matrix]) -> Matrix:
        return np.concatenate([part.reshape(-1, offsets) for part in parts])

    estimates = [
        replace(
            parts[0],
            value=table([part.value for part in parts]),
            std=table([part.std for part in parts]),
            kept=np.concatenate([part.kept for part in parts]),
        )
        for parts in zip(*(answer.estimates for answer in answers), strict=True)
    ]
    return estimates, table([answer.ranks for answer in answers]).astype(np.int64)


def _joined(plan: StudiedPlan, data: DataSets, answers: Sequence[CoveragePieceAnswer]) -> CoveragePlan:
    problem, which = plan.problem, estimated(plan.problem)
    items = [problem.parameters.items[i] for i in which]
    nominal = identify(problem, problem.nominal()).status
    status, true = [nominal[i] for i in which], data.truths[:, which]
    estimates, ranks = joined(answers, len(which))
    sizes = [len(answer.estimates[0].kept) for answer in answers]
    judged = [has_numbers(one) for one in status]
    display = np.array([item.display for item in items])

    def held_by_ranks(j: int, some: Mask, level: float) -> int:
        """Of central intervals between draws, of which each level holds a whole number of ranks."""
        cut = round((1 - level) / 2 * (DRAWS + 1))
        return int(((ranks[some, j] >= cut) & (ranks[some, j] <= DRAWS - cut)).sum())

    estimators = []
    for one in estimates:
        # An unidentifiable offset has no interval in any result; but a control is judged by the numbers that
        # it would have given.
        claimed = [True] * len(items) if one.control else judged
        by_ranks = held_by_ranks if one.name == "posterior" else None
        error, std = (one.value - true) * display, one.std * display
        rows = observed(items, status, claimed, error, std, one.kept, _ALARM, LEVELS, by_ranks)
        agrees = all_agree(rows)
        more = " on this plan" if one.control and agrees else ""
        estimators.append(
            JudgedEstimator(
                name=one.name,
                words=one.words,
                control=one.control,
                agrees=agrees,
                converged=int(one.kept.sum()),
                sentence=worst_share(rows, agrees, one.control) + more,
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
        sbc=(calibration(items, ranks, _ALARM),),
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
    return RankCalibration(
        name="posterior",
        control=False,
        agrees=least >= alarm,
        sentence=f"The ranks of the true value among the draws are {'' if least >= alarm else 'not '}uniform"
        f" (smallest p-value {least:.2g} of {len(rows)})",
        parameters=tuple(rows),
        power=power_sentence(len(ranks), alarm),
    )


def power(count: int, alarm: float, ratio: float) -> float:
    """Probability that the chi-squared test of `count` ranks detects stds that are `ratio` of the right
    ones."""
    edges = stats.norm.cdf(stats.norm.ppf(np.linspace(0, 1, BINS + 1)) * ratio)
    excess = float(count * BINS * ((np.diff(edges) - 1 / BINS) ** 2).sum())
    return float(stats.ncx2.sf(stats.chi2.isf(alarm, BINS - 1), BINS - 1, excess))


def power_sentence(count: int, alarm: float) -> str:
    return "u too small by " + ", by ".join(
        f"{1 - ratio:.0%} would be detected with probability {power(count, alarm, ratio):.2f}"
        for ratio in _POWER_RATIOS
    )
