"""Do the intervals hold the truth as often as stated? Coverage and simulation-based calibration.

Every simulated data set has true parameters of its own, drawn from the priors. It is solved by the likelihood
fit, by the paper's midpoint fit with its sandwich covariance, and by its posterior. A 95 % interval must hold
the truth in 95 % of the data sets, and the rank of the truth among the posterior's draws must be uniform
(Talts et al. 2018). Two wrong estimators are carried along as negative controls.

The fits are those of `analyse` (`fit_each`, the batch of `fit_likelihood`), and so are density, coordinates,
moves and walk of the posterior (`drawn_together` says what is not).
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ...analysis.estimation.threads import one_blas_thread
from ...analysis.observability.identifiability import identify
from ...analysis.posterior.many_posteriors import LEAST_STEPS
from ...analysis.posterior.sampler import ROUND
from ...analysis.status import Status, known, versions
from ...model.arrays import Index, Matrix, Progress
from ...model.files.header import Header
from ...model.files.robot_file import load_robot
from ...model.likelihood.kernel import compiled_at_once
from ...model.likelihood.parameters import Parameter
from ...model.likelihood.problem import Problem
from ...words.wording import label, listed
from ..plans.candidates import candidates
from ..plans.optimal import Planner
from ..plans.patterns import pattern
from ..processes import side_by_side
from .answer import NoiseLevel, ObservedParameter, Share, StudyAnswer, require_sound
from .binomial import Accuracy, accuracy, held_share
from .case_store import CaseStore
from .coverage_pieces import SIZE, Piece, PieceAnswer, answer_of, estimated, joined
from .data_sets import DataSets, drawn
from .estimators import Estimates
from .ranks import BINS, DRAWS, Calibration, calibration

_TARGET, _SIGMA_MM = (950.0, 150.0, 100.0), 30.0
_SHOTS, _CANDIDATES, _SHORT = 7, 2000, 0.4
_HEADER = {
    "robot": "irb1600",
    "tool": {"kind": "laser", "calibrated": True, "point_mm": [0, 0, 65], "direction": [1, 0, 0]},
    "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
    "targets": {"psd": {"guess_mm": list(_TARGET), "sigma_mm": _SIGMA_MM}},
}

LEVELS = (0.5, 0.9, 0.95, 0.99)
_SENTENCE_LEVEL = 0.95
_CHANCE = 0.01  # of a false alarm over all levels and parameters of an estimator


@dataclass(frozen=True)
class CoveredParameter(ObservedParameter):
    """A parameter of an estimator, with the shares of its intervals at each level."""

    coverage: tuple[Share, ...] = ()

    @property
    def shares(self) -> tuple[Share, ...]:
        return self.coverage


@dataclass(frozen=True)
class Estimator:
    """What an estimator came to on a plan; `converged` counts its data sets with a fit.

    Raises UnsoundResult where an unidentifiable parameter has a number, unless it is a control.
    """

    name: str
    words: str
    control: bool
    agrees: bool
    converged: int
    sentence: str
    parameters: tuple[CoveredParameter, ...]

    def __post_init__(self) -> None:
        require_sound(self.name, self.control, self.parameters)


@dataclass(frozen=True)
class CoveragePlan:
    """One plan: `failed` counts truths drawn again because the arm cannot hit the target, `acceptance` is the
    share of the posteriors' proposals that were accepted, `sbc` is simulation-based calibration."""

    name: str
    words: str
    robot: str
    shots: int
    noise: NoiseLevel
    data_sets: int
    failed: int
    acceptance: float
    estimators: tuple[Estimator, ...]
    sbc: tuple[Calibration, ...]


@dataclass(frozen=True)
class CoverageSettings:
    """How the study was carried out; `chance` is that of a false alarm, for each estimator."""

    data_sets: int
    seed: int
    levels: tuple[float, ...]
    draws: int
    bins: int
    chance: float
    posterior: str


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
    header = Header.model_validate(_HEADER)
    robot = load_robot(header.robot, Path())
    place = np.array(_TARGET)

    def planned(postures: Matrix, own: Header = header) -> Problem:
        return Problem.build(own, robot, postures, ["psd"] * len(postures))

    found = candidates(header, robot, place, _CANDIDATES, seed=seed)
    best = Planner(header, robot, place, found).optimal(_SHOTS, seed=seed).postures
    freed = header.model_copy(update={"held": ()})
    return [
        StudiedPlan("good", f"{_SHOTS} A-optimal measurements of {_CANDIDATES} postures", planned(best)),
        StudiedPlan(
            "weak",
            f"Y-Pattern of {_SHOTS} measurements over the arm's whole reach",
            planned(pattern(header, robot, place, "y", _SHOTS)),
        ),
        StudiedPlan(
            "nearly degenerate",
            f"Y-Pattern of {_SHOTS} measurements over {_SHORT:g} of the reach",
            planned(pattern(header, robot, place, "y", _SHOTS, span=_SHORT)),
            curved=True,
        ),
        StudiedPlan(
            "degenerate",
            "the good plan with joint 1 free: its offset is equivalent to a rotation of arm and target",
            planned(best, freed),
            degenerate=True,
        ),
    ]


def coverage_study(
    data_sets: int,
    seed: int,
    progress: Progress,
    *,
    store: Path | None = None,
    processes: int | None = None,
) -> CoverageStudy:
    """Carry out the whole study.

    It agrees if the intervals of the posterior, those of the likelihood's curvature where the plan is not
    nearly degenerate, and the ranks are as stated, and every control is detected. The midpoint fit is the
    paper's: where its intervals do not hold, that is a finding. With a `store` the answer of each piece (some
    data sets of a plan) is kept in that file at once, and a study that was stopped goes on from there.
    """
    began = time.perf_counter()
    with one_blas_thread(), compiled_at_once():
        plans = studied_plans(seed)
    heading = {
        "study": "coverage",
        "seed": seed,
        "data_sets": data_sets,
        "piece": SIZE,
        "versions": versions(),
    }
    with nullcontext() if store is None else CaseStore(store, heading, PieceAnswer) as kept:
        answers = studied(plans, data_sets, seed, progress, kept, processes)
    must, findings, detected = [part.agrees for answer in answers for part in answer.sbc], [], []
    for plan, answer in zip(plans, answers, strict=True):
        for own in answer.estimators:
            if own.control:
                detected.append(not own.agrees)
            elif own.name == "midpoint" or (own.name == "likelihood" and plan.curved):
                findings += [] if own.agrees else [f"{own.name} on {plan.name}"]
            else:
                must.append(own.agrees)
    return CoverageStudy(
        study="coverage",
        title="Do the intervals hold the truth as often as stated?",
        headline=_headline(data_sets, all(must), all(detected), findings),
        agrees=all((*must, *detected)),
        settings=CoverageSettings(
            data_sets=data_sets,
            seed=seed,
            levels=LEVELS,
            draws=DRAWS,
            bins=BINS,
            chance=_CHANCE,
            posterior=f"at least {ROUND + LEAST_STEPS} steps for each of {DRAWS} walkers",
        ),
        seconds=time.perf_counter() - began,
        versions=versions(),
        plans=tuple(answers),
        notes=(
            "Every data set has true parameters of its own, drawn from the priors of the fits: offsets of 5°"
            f" (one standard deviation), the target {_SIGMA_MM:g} mm about its guess.",
            f"An estimator agrees if the p-value of none of its shares is below {_CHANCE:.0%} over all levels"
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
        f" {'hold' if hold else 'do not hold'} the truth as often as stated.",
        "Every control is detected." if detected else "A control is not detected.",
    ]
    if findings:
        parts.append(f"Do not rely on the intervals of {listed(list(findings))}.")
    return " ".join(parts)


def studied(
    plans: Sequence[StudiedPlan],
    count: int,
    seed: int,
    progress: Progress,
    kept: CaseStore[PieceAnswer] | None = None,
    processes: int | None = None,
) -> list[CoveragePlan]:
    """The answers of the plans, `count` data sets each. Data sets and random numbers are those of the seed,
    the plan and the piece, whoever works it out."""
    pieces = -(-count // SIZE)
    found = {} if kept is None else kept.done
    numbers: list[int] = []
    data: list[DataSets] = []

    def tell() -> None:
        progress(f"piece {len(found)}/{pieces * len(plans)}", len(found) / (pieces * len(plans)))

    def left() -> Iterator[Piece]:
        for k, plan in enumerate(plans):
            rng = np.random.default_rng([seed, *plan.name.encode()])
            with one_blas_thread(), compiled_at_once():
                drawn_sets = drawn(plan.problem, count, rng)
            data.append(drawn_sets)
            for c, own in enumerate(rng.spawn(-(-len(drawn_sets.truths) // SIZE))):
                if k * pieces + c not in found:
                    numbers.append(k * pieces + c)
                    yield Piece(drawn_sets.some(slice(c * SIZE, (c + 1) * SIZE)), plan.degenerate, own)

    tell()
    processes = min(processes or os.cpu_count() or 1, pieces * len(plans))
    with closing(side_by_side(answer_of, left(), processes)) as answers:
        for job, answer in answers:
            found[numbers[job]] = answer
            if kept is not None:
                kept.add(numbers[job], answer)
            tell()
    return [
        _joined(plan, own, [found[k * pieces + c] for c in range(-(-len(own.truths) // SIZE))])
        for k, (plan, own) in enumerate(zip(plans, data, strict=True))
    ]


def _joined(plan: StudiedPlan, data: DataSets, answers: Sequence[PieceAnswer]) -> CoveragePlan:
    problem, which = plan.problem, estimated(plan.problem)
    items = [problem.parameters.items[i] for i in which]
    nominal = identify(problem, problem.nominal()).status
    status, true = [nominal[i] for i in which], data.truths[:, which]
    estimates, ranks = joined(answers, len(which))
    sizes = [len(answer.estimates[0].kept) for answer in answers]
    return CoveragePlan(
        name=plan.name,
        words=plan.words,
        robot=problem.robot.name,
        shots=problem.shots,
        noise=NoiseLevel(float(np.degrees(problem.noise.joint[0])), float(problem.noise.spot)),
        data_sets=len(data.truths),
        failed=data.failed,
        acceptance=float(np.average([answer.accepted for answer in answers], weights=sizes)),
        estimators=tuple(
            _estimator(own, items, status, true, ranks if own.name == "posterior" else None)
            for own in estimates
        ),
        sbc=(calibration(items, ranks, _CHANCE),),
    )


def _estimator(
    estimates: Estimates,
    items: Sequence[Parameter],
    status: Sequence[Status],
    truth: Matrix,
    ranks: NDArray[np.int64] | None = None,
) -> Estimator:
    """Bias, rmse and coverage of one estimator; by `ranks` among the draws where they are given.

    An unidentifiable offset has no interval in any result, so it has none here; but a control is judged by
    the numbers that it would have given.
    """
    kept = estimates.kept
    error = (estimates.value - truth)[kept]
    judged = [estimates.control or known(own) for own in status]
    alarm = _CHANCE / max(sum(judged) * len(LEVELS), 1)
    rows = []
    for j, item in enumerate(items):
        errors = Accuracy()
        shares: tuple[Share, ...] = ()
        if judged[j]:
            errors = accuracy(error[:, j] * item.display, estimates.std[kept, j] * item.display)
            shares = tuple(
                held_share(held, len(error), level, alarm)
                for level, held in zip(
                    LEVELS,
                    _held(np.abs(error[:, j]) / estimates.std[kept, j])
                    if ranks is None
                    else _held_by_ranks(ranks[kept, j]),
                    strict=True,
                )
            )
        rows.append(CoveredParameter(item.name, item.unit, status[j], *errors, coverage=shares))
    agrees = all(share.agrees for row in rows for share in row.coverage)
    return Estimator(
        name=estimates.name,
        words=estimates.words,
        control=estimates.control,
        agrees=agrees,
        converged=int(kept.sum()),
        sentence=_sentence(rows, agrees, estimates.control),
        parameters=tuple(rows),
    )


def _held(off: Matrix) -> list[int]:
    """How many intervals of each level hold the truth; `off` are the errors in standard uncertainties."""
    return [int((off <= stats.norm.ppf((1 + level) / 2)).sum()) for level in LEVELS]


def _held_by_ranks(ranks: Index) -> list[int]:
    """The same for central intervals between draws, of which each level holds a whole number of ranks."""
    cuts = [round((1 - level) / 2 * (DRAWS + 1)) for level in LEVELS]
    return [int(((ranks >= cut) & (ranks <= DRAWS - cut)).sum()) for cut in cuts]


def _sentence(rows: Sequence[CoveredParameter], agrees: bool, control: bool) -> str:
    shares = [
        (abs(share.share - _SENTENCE_LEVEL), row.name, share.share)
        for row in rows
        for share in row.coverage
        if share.level == _SENTENCE_LEVEL
    ]
    if not shares:
        return "All offsets are unidentifiable"
    _, name, share = max(shares)
    worst = f"95 % intervals hold the truth in {share:.1%} at the worst ({label(name)})"
    if control:
        return f"{worst}: {'not detected on this plan' if agrees else 'detected as wrong'}"
    return f"{worst}: {'as stated' if agrees else 'not as stated'}"
