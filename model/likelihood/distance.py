"""Stated distances between targets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..files.shot import check_distances

if TYPE_CHECKING:
    from ..files.header import Header


@dataclass(frozen=True)
class Distance:
    """A stated distance between two targets (by their index), mm."""

    first: int
    second: int
    mm: float
    sigma: float


def distances(header: Header, targets: Sequence[str]) -> tuple[Distance, ...]:
    """Those of a header between the `targets` of some measurements; BadInput for one to another target."""
    check_distances(header, targets, file=None, line=None)
    return tuple(
        Distance(
            targets.index(stated.between[0]), targets.index(stated.between[1]), stated.mm, stated.sigma_mm
        )
        for stated in header.distances
    )
