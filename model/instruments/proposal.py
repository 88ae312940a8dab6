"""What a new calibration states of an instrument that nobody has set up yet.

Lengths grow with the arm's reach, so that an arm of any size gets a plan; nothing is taken as calibrated that
nobody has calibrated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..arrays import Matrix

Point = tuple[float, float, float]
Keys = dict[str, object]  # of a header, or a part of it

TARGET_SIGMA_MM = 30.0  # how well a person states where a target is
TARGET_OUT = 0.6  # of the reach: where a target stands in front of the arm
ON_FLANGE: Point = (60.0, 0.0, 60.0)  # off the last axis, so that the last joint moves it
TIP: Point = (60.0, 0.0, 120.0)
ON_THE_FLANGE = ("point_mm", "tip_mm", "direction")  # keys that say how an instrument is mounted there
_STATION_OUT = 2.2  # of the reach: where an instrument stands that looks at the flange
_NORMALS: Mapping[str, tuple[Point, Point]] = {  # of the faces of a block, and where each is on it
    "top": ((0.0, 0.0, 1.0), (0.0, 0.0, 50.0)),
    "back": ((-1.0, 0.0, 0.0), (-50.0, 0.0, 0.0)),
    "side": ((0.0, -1.0, 0.0), (0.0, -50.0, 0.0)),
}


class ProposedHeader(NamedTuple):
    """The keys of a `header` that state the instrument and its targets. One that `turns` with the last joint
    is not calibrated: the sum of both alone is determined. A measurement reads so many `numbers`."""

    header: Keys
    numbers: int
    turns: bool = False


def whole_point(point: Sequence[float] | Matrix) -> Point:
    """A point to the millimetre, as a person states it."""
    x, y, z = (round(float(number)) + 0.0 for number in point)
    return x, y, z


def target_at(point: Sequence[float] | Matrix) -> Keys:
    """What is stated of a target about there, to the micrometre: decimals that a person states are kept."""
    return {"guess_mm": [round(float(number), 3) + 0.0 for number in point], "sigma_mm": TARGET_SIGMA_MM}


def station_at(reach: float) -> list[float]:
    """Where an instrument stands that looks at the flange."""
    return list(whole_point((_STATION_OUT * reach, 0.35 * reach, 0.5 * reach)))


def faces_at(target: Point, names: Sequence[str]) -> dict[str, Keys]:
    """Faces of a block, by name."""
    faces = {}
    for name in names:
        normal, offset = _NORMALS[name]
        faces[name] = {"kind": "plane", "normal": list(normal)} | target_at(np.add(target, offset))
    return faces
