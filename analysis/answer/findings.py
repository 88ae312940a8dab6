"""What a reader must see of an answer, as data: sentences are made in `words`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ..diagnostics.hold_out import HoldOut, LeaveOneOut, fits_without, leave_one_out
from ..diagnostics.outliers import OUTLYING, Robust, ShotResult, shot_results
from ..left_over import holm
from ..misfit import Criterion, ExactDoubted, exact_doubted
from ..observability.changes import RepeatsDiffer, repeats_differ
from ..posterior.posterior import PosteriorSummary
from ..prediction import PredictedRun
from ..solution import Solution, undecided_names
from ..status import LACK_OF_FIT


@dataclass(frozen=True)
class NotConverged:
    """The fit did not converge; `reason` is the optimiser's."""

    reason: str


@dataclass(frozen=True)
class OtherBasins:
    """So many more sets of offsets fit nearly as well; `undecided` are the parameters that have no number
    because of them."""

    count: int
    undecided: tuple[str, ...] = ()


@dataclass(frozen=True)
class NoPosterior:
    """The posterior has not converged: its draws are not shown."""

    posterior: PosteriorSummary


@dataclass(frozen=True)
class HeldOutMisfit:
    """Residuals at held-out targets, or of the held-out `run`, are `factor` times what noise and fit
    explain; of poses with what is expected of lengths and of angles."""

    targets: tuple[str, ...]
    rms_mm: float
    factor: float
    run: str | None = None
    expected_mm: float | None = None
    rms_deg: float | None = None
    expected_deg: float | None = None


@dataclass(frozen=True)
class RobustNotConverged:
    """The robust fit did not converge."""

    reason: str


@dataclass(frozen=True)
class PoorCurvature:
    """The posterior was not sampled although the intervals by the curvature may not hold: those of these
    `parameters` (of all if not `tested`)."""

    parameters: tuple[str, ...]
    tested: bool


@dataclass(frozen=True)
class Outlying:
    """Measurements whose residuals are too large for chance: by the robust fit, or by the likelihood."""

    measurements: tuple[int, ...]
    robust: bool


@dataclass(frozen=True)
class RoundedAngles:
    """Angles of the robot are right angles rounded: a sentence each."""

    sentences: tuple[str, ...]


@dataclass(frozen=True)
class FileWarning:
    """What the reader of the file noticed, in its words."""

    text: str


Finding = (
    NotConverged
    | Criterion
    | OtherBasins
    | ExactDoubted
    | NoPosterior
    | PoorCurvature
    | HeldOutMisfit
    | RobustNotConverged
    | Outlying
    | RepeatsDiffer
    | RoundedAngles
    | FileWarning
)


def on_the_model(solution: Solution) -> Iterator[Finding]:
    """Findings against a fit as a whole."""
    if not solution.fit.converged:
        yield NotConverged(solution.fit.reason)
    yield from solution.contradictions
    if rounded := solution.problem.robot.rounded:
        yield RoundedAngles(rounded)
    if solution.fit.other_basins:
        undecided = undecided_names(solution.identified.facts.null_space)
        yield OtherBasins(solution.fit.other_basins, undecided)
    if solution.converged and solution.misfit is None:
        doubted = exact_doubted(solution.fit), repeats_differ(solution.problem, solution.fit.x)
        yield from (one for one in doubted if one is not None)


def without_a_result(solution: Solution, held_out: PredictedRun | None = None) -> Iterator[Finding | HoldOut]:
    """What a result would say against the values of a solution, but for what the posterior shows; of a misfit
    what is said of the model alone."""
    yield from on_the_model(solution)
    yield from on_held_out(held_out)
    if solution.converged and solution.misfit is None:
        yield from _on_shots(solution, shot_results(solution.fit))
        yield from off_placements(leave_one_out(solution, fits_without(solution)))


def off_placements(left_out: LeaveOneOut | None) -> tuple[HoldOut, ...]:
    """The placements that the others do not predict, by Holm's method, the clearest first."""
    rows = () if left_out is None else left_out.rows
    adjusted = holm([1.0 if row.p_value is None else row.p_value for row in rows])
    off = sorted((p, k) for k, p in enumerate(adjusted) if p < LACK_OF_FIT)
    return tuple(rows[k] for _, k in off)


def findings(
    solution: Solution,
    posterior: PosteriorSummary,
    shots: Sequence[ShotResult],
    robust: Robust | None,
    held_out: HoldOut | PredictedRun | None,
    warnings: Sequence[str],
) -> tuple[Finding, ...]:
    """All of a result, the gravest first; `warnings` are those of the run's file."""
    omitted = posterior.omitted
    return (
        *on_the_model(solution),
        *((NoPosterior(posterior),) if posterior.draws and not posterior.converged else ()),
        *((PoorCurvature(omitted.poor, omitted.tested),) if omitted and not omitted.enough else ()),
        *on_held_out(held_out),
        *(_on_shots(solution, shots) if robust is None else _on_robust(robust)),
        *(FileWarning(text) for text in warnings if text not in solution.problem.robot.rounded),
    )


def on_held_out(held_out: HoldOut | PredictedRun | None) -> Iterator[Finding]:
    """Residuals at held-out targets, or of a held-out run, that noise and fit do not explain."""
    if held_out is None or held_out.p_value is None or held_out.p_value >= LACK_OF_FIT:
        return
    assert held_out.factor is not None
    assert held_out.rms_mm is not None
    run = held_out.run if isinstance(held_out, PredictedRun) else None
    expected = held_out.expected_mm, held_out.rms_deg, held_out.expected_deg
    yield HeldOutMisfit(held_out.targets, held_out.rms_mm, held_out.factor, run, *expected)


def prediction_failed(found: Sequence[object]) -> str | None:
    """The name of the held-out run that the analysed one does not predict; None without one."""
    runs = (each.run for each in found if isinstance(each, HeldOutMisfit))
    return next((run for run in runs if run is not None), None)


def _on_robust(robust: Robust) -> Iterator[Finding]:
    if not robust.converged:
        yield RobustNotConverged(robust.reason)
    elif robust.outliers:
        yield Outlying(robust.outliers, robust=True)


def _on_shots(solution: Solution, shots: Sequence[ShotResult]) -> Iterator[Finding]:
    """Single measurements that stand out, unless so many do that it is the model that does not fit."""
    if solution.against_noise.p_value is None:
        return
    whitened = np.array([shot.whitened for shot in shots])
    sizes = np.array([shot.size for shot in shots])
    p_values = scipy.special.chdtrc(sizes, whitened**2) * len(shots)
    outlying = [int(i) for i in np.argsort(-whitened) if p_values[i] < OUTLYING]
    if 0 < len(outlying) <= max(3, len(shots) // 10):
        yield Outlying(tuple(shots[i].shot for i in outlying), robust=False)
