"""What an answer says of the arm's geometry: tolerances, the model ladder, the worth of nominal geometry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...model.files.header import Header
from ...model.problem import Problem
from ...model.robot import Matrix
from ..estimation.tolerance_factors import Factors
from ..status import Status, known
from .consider import TYPICAL_DEG, TYPICAL_MM, considered, with_tolerances

Tolerance = float | tuple[float, ...]
RungName = Literal["offsets", "geometry", "gravity", "harmonics"]


@dataclass(frozen=True)
class Rung:
    """One model of the ladder: how many parameters it frees, the root mean square of the residuals at
    placements that it has not seen (None with a single placement), its log evidence, and whether the answer
    keeps it."""

    rung: RungName
    parameters: int
    held_out_rms_mm: float | None
    log_evidence: float
    kept: bool


@dataclass(frozen=True)
class GeometryResult:
    """The geometry of an answer; offsets that the data do not determine have no numbers here.

    `length_mm` and `angle_deg` are the tolerances of the links, `stated` whether by the header; `factors` by
    what the data multiply them, None where they are known. `ladder` has the models that were tried.
    `consider` is the standard uncertainty (deg; mm) of each offset if it is estimated with nominal geometry
    while the arm has these tolerances; `at_half` and `at_twice` what u would be at half and at twice the
    tolerances, empty for nominal geometry.
    """

    stated: bool
    length_mm: Tolerance
    angle_deg: Tolerance
    factors: Factors | None
    ladder: tuple[Rung, ...]
    consider: dict[str, float | None]
    at_half: dict[str, float | None]
    at_twice: dict[str, float | None]


def geometry_result(
    header: Header,
    problem: Problem,
    x: Matrix,
    covariance: Matrix,
    status: tuple[Status, ...],
    *,
    weight: float = 1.0,
    ladder: tuple[Rung, ...] = (),
    factors: Factors | None = None,
) -> GeometryResult:
    """Of a problem at x (p,) with the covariance (f, f) of its scaled free parameters."""
    parameters = problem.parameters

    def of_offsets(std: Matrix) -> dict[str, float | None]:
        return {
            item.name: float(std[i]) * item.display if known(status[i]) else None
            for i, item in enumerate(parameters.items)
            if item.group == "offset" and not item.held
        }

    def at(factor: float) -> dict[str, float | None]:
        if not len(problem.tolerated):
            return {}
        return of_offsets(parameters.unscaled(with_tolerances(problem, covariance, factor)))

    stated = header.geometry
    tolerance = None if stated is None else stated.tolerance
    return GeometryResult(
        stated=stated is not None,
        length_mm=TYPICAL_MM if tolerance is None else tolerance.length_mm,
        angle_deg=TYPICAL_DEG if tolerance is None else tolerance.angle_deg,
        factors=factors,
        ladder=ladder,
        consider=of_offsets(considered(problem, x, weight)),
        at_half=at(0.5),
        at_twice=at(2.0),
    )


def worst(uncertainties: dict[str, float | None]) -> float | None:
    """The largest of them; None where there is none."""
    values = [value for value in uncertainties.values() if value is not None]
    return float(np.max(values)) if values else None
