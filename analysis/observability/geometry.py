"""What an answer says of the arm's geometry: tolerances, the model ladder, the worth of nominal geometry."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from ...model.arrays import Matrix
from ...model.files.header import Header
from ...model.likelihood.problem import Problem
from ..status import Status, known
from .consider import TYPICAL_DEG, TYPICAL_MM, considered, with_tolerances

if TYPE_CHECKING:
    from ..estimation.tolerance_factors import Factors

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
class Confounded:
    """The posterior `correlation` of an offset with a geometry or tool parameter that is estimated with it.
    The data need not determine that parameter: it may be the reason why the offset is known no better."""

    offset: str
    parameter: str
    correlation: float


@dataclass(frozen=True)
class GeometryResult:
    """The geometry of an answer; offsets that the data do not determine have no numbers here.

    `length_mm` and `angle_deg` are the tolerances of the links, `stated` whether by the header; `factors` by
    what the data multiply them, None where they are known. `ladder` has the models that were tried.
    `consider` is the standard uncertainty (deg; mm) of each offset if it is estimated with nominal geometry
    while the arm has these tolerances; `at_half` and `at_twice` what u would be at half and at twice the
    tolerances, empty for nominal geometry, None where the curvature at the mode does not say. `confounded`
    has for each offset the geometry parameter, and the parameter of a free tool, with which it is correlated
    most; likewise empty.
    """

    stated: bool
    length_mm: Tolerance
    angle_deg: Tolerance
    factors: Factors | None
    ladder: tuple[Rung, ...]
    consider: dict[str, float]
    at_half: dict[str, float | None]
    at_twice: dict[str, float | None]
    confounded: tuple[Confounded, ...] = ()


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

    def of_offsets(std: Matrix) -> dict[str, float]:
        return {
            item.name: float(std[i]) * item.display
            for i, item in enumerate(parameters.items)
            if item.group == "offset" and known(status[i])
        }

    def at(factor: float) -> dict[str, float | None]:
        if not len(problem.tolerated):
            return {}
        found = of_offsets(parameters.unscaled(with_tolerances(problem, covariance, factor)))
        return {name: std if np.isfinite(std) else None for name, std in found.items()}

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
        confounded=tuple(_confounded(problem, covariance, status)),
    )


def _confounded(problem: Problem, covariance: Matrix, status: tuple[Status, ...]) -> Iterator[Confounded]:
    """Of each offset that is determined, among free geometry: the largest correlation, by group."""
    if not len(problem.tolerated):
        return
    parameters = problem.parameters
    std = np.sqrt(np.diag(covariance))
    for i, item in enumerate(parameters.items):
        if item.group != "offset" or item.held or not known(status[i]):
            continue
        own = int(parameters.among_free[i])
        correlation = covariance[own] / (std * std[own])
        for group in ("geometry", "tool"):
            rivals = np.flatnonzero(parameters.free & parameters.group(group))
            if len(rivals):
                found = correlation[parameters.among_free[rivals]]
                k = int(np.argmax(np.abs(found)))
                yield Confounded(item.name, parameters.names[rivals[k]], float(found[k]))
