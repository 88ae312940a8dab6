"""What the placements and recordings of a run say, beside the fit of all measurements together."""

from __future__ import annotations

from dataclasses import dataclass

from ...model.arrays import Matrix
from ..placements import placements
from ..recordings.effective import Effective
from ..recordings.steps import Steps, steps
from ..solution import Solution
from .leave_one_out import Jackknife, LeaveOneOut, fits_without, jackknife, leave_one_out


@dataclass(frozen=True)
class PlacementResult:
    """Placements by `names`; each left out in turn (None for one placement, or without an answer), the
    jackknife (None for less than three); correlation of the recordings, by which the measurements count, and
    their steps."""

    names: tuple[str, ...]
    leave_one_out: LeaveOneOut | None
    jackknife: Jackknife | None
    effective: Effective
    steps: Steps


def placement_result(
    solution: Solution, effective: Effective, rival: Matrix | None = None
) -> PlacementResult:
    """Of a solution's measurements at their `effective` number; `rival` is what else may explain their
    residuals (`link_columns`)."""
    fits = fits_without(solution)
    return PlacementResult(
        tuple(placement.name for placement in placements(solution.problem)),
        leave_one_out(solution, fits),
        jackknife(solution, fits),
        effective,
        steps(solution.fit, rival),
    )
