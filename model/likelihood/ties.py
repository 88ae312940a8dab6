"""What a header states between two targets: distances of points, angles of planes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..arrays import Matrix
from ..files.shot import check_ties
from ..instruments.tips import normals_at, unit_normal

if TYPE_CHECKING:
    from ..files.header import Header

Vector = tuple[float, float, float]
_NO_LENGTH = 1e-9  # mm, or the sine of an angle: below it a distance or an angle has no direction


class Missed(NamedTuple):
    """By how many of its standard deviations a tie is missed (W,), and the slopes (W, 3) of that by the
    unknowns of its first and of its second target."""

    residual: Matrix
    by_first: Matrix
    by_second: Matrix


@dataclass(frozen=True)
class Distance:
    """A stated distance between two points (by their index), mm."""

    first: int
    second: int
    mm: float
    sigma: float

    def missed(self, first: Matrix, second: Matrix) -> Missed:
        """At positions (W, 3) of both, mm."""
        between = second - first
        length = np.maximum(np.linalg.norm(between, axis=1), _NO_LENGTH)
        along = between / length[:, None] / self.sigma
        return Missed((length - self.mm) / self.sigma, -along, along)


@dataclass(frozen=True)
class Angle:
    """A stated angle between the outward normals of two planes (by their index), rad; `normals` are those
    that the header states, about which the planes tilt."""

    first: int
    second: int
    rad: float
    sigma: float
    normals: tuple[Vector, Vector]

    def missed(self, first: Matrix, second: Matrix) -> Missed:
        """At unknowns (W, 3) of both planes: distance, mm, and tilts, rad."""
        (one, by_one), (two, by_two) = (
            normals_at(plane, np.array(nominal))
            for plane, nominal in zip((first, second), self.normals, strict=True)
        )
        cosine, sine = (one * two).sum(axis=1), np.linalg.norm(np.cross(one, two), axis=1)
        slope = -1 / (np.maximum(sine, _NO_LENGTH) * self.sigma)[:, None]
        return Missed(
            (np.arctan2(sine, cosine) - self.rad) / self.sigma,
            slope * (two[:, None] @ by_one)[:, 0],
            slope * (one[:, None] @ by_two)[:, 0],
        )


Tie = Distance | Angle


def ties(header: Header, targets: Sequence[str]) -> tuple[Tie, ...]:
    """Those of a header between the `targets` of some measurements; BadInput for one to another target."""
    check_ties(header, targets, file=None, line=None)
    between = [
        Distance(
            targets.index(distance.between[0]),
            targets.index(distance.between[1]),
            distance.mm,
            distance.sigma_mm,
        )
        for distance in header.distances
    ]
    return (*between, *(_angle(header, targets, i) for i in range(len(header.angles))))


def _angle(header: Header, targets: Sequence[str], i: int) -> Angle:
    angle = header.angles[i]
    one, two = (unit_normal(header.targets[name]).tolist() for name in angle.between)
    return Angle(
        targets.index(angle.between[0]),
        targets.index(angle.between[1]),
        float(np.radians(angle.deg)),
        float(np.radians(angle.sigma_deg)),
        ((one[0], one[1], one[2]), (two[0], two[1], two[2])),
    )
