"""What every kind of instrument says of itself: its unknowns, its reading, its words.

A kind is a class, an instrument one of its instances with the numbers that a header states. Nothing outside
a kind's own file asks which kind it is: it asks for the facts below.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import casadi as ca
import numpy as np

from ..arrays import Matrix


class Unknown(NamedTuple):
    """An unknown of an instrument: its name, its unit, and its prior's mean and std, rad or mm."""

    axis: str
    unit: Literal["deg", "mm"]
    mean: float
    std: float


@dataclass(frozen=True)
class Words:
    """How a reader is told of a kind.

    `part` is what may lie on the axis of a joint, `motion` what of it a rotation of the last joint is
    equivalent to (in `unit`); `reading` the source of its reading's noise, `method` what a certificate says
    was measured with, `posture` what is drawn at a posture besides the arm, `to_do` what an operator does
    there, `fields` what else is written down; `traced` the instruments that a certificate names: for each
    entry the keys of a run's provenance.
    """

    is_: str
    part: str
    motion: str
    unit: Literal["deg", "mm"]
    reading: str
    method: str
    posture: str
    to_do: str
    fields: tuple[str, ...]
    traced: tuple[tuple[str, tuple[str, ...]], ...]


@dataclass(frozen=True, eq=False)
class Instrument(ABC):
    """An instrument on the flange, as a header states it, in the flange frame.

    `point` (3,) mm on the beam, or the tip; `direction` (3,) unit of a beam, else None. `tilt_std` (rad) and
    `shift_std` (mm) are the prior stds of how far it is from that; of a calibrated one only if it is
    `tolerated`: else it is exact, and has no unknowns.

    Of the kind: `name` is the header's `kind`, `also_called` what else people call it; `columns` are the
    readings that a measurement records, none where it is taken when the residual is zero; `residual_size` is
    the number d of components of a residual. `target` is what a target is called where nobody names it,
    `free_sigma` the tilt (degrees, of a beam) and shift (mm) of one that is not calibrated. A `beam` has a
    direction and a length, and is steered by the wrist onto a detector; what is none has all joints to meet
    its target. Where a free one `turns` about the last axis as that joint does, the last offset is held.
    """

    name: ClassVar[str]
    also_called: ClassVar[tuple[str, ...]]
    columns: ClassVar[tuple[str, ...]]
    residual_size: ClassVar[int]
    target: ClassVar[str]
    free_sigma: ClassVar[tuple[float, float]]
    beam: ClassVar[bool]
    turns: ClassVar[bool]
    words: ClassVar[Words]

    calibrated: bool
    point: Matrix
    direction: Matrix | None
    tilt_std: float
    shift_std: float
    tolerated: bool = False

    @property
    def exact(self) -> bool:
        """Whether it is as stated, and no part of it is estimated."""
        return self.calibrated and not self.tolerated

    @property
    def key(self) -> bytes:
        """The same for all whose functions are the same."""
        numbers = self.point if self.direction is None else np.concatenate([self.point, self.direction])
        return f"{self.name} {self.exact} ".encode() + np.asarray(numbers, dtype=float).tobytes()

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The k that are estimated: none if it is exact."""
        return () if self.exact else tuple(self._free())

    @abstractmethod
    def _free(self) -> Iterator[Unknown]: ...

    @property
    @abstractmethod
    def known_to(self) -> float:
        """Prior std, in the unit of `words`, of what a rotation of the last joint is equivalent to."""

    @abstractmethod
    def ray(self, unknowns: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Point (3, 1) mm and unit direction (3, 1) in the flange frame, the direction 0 where it is no beam;
        `unknowns` (k, 1), or empty if it is exact."""

    def nominal_beam(self) -> tuple[Matrix, Matrix, Matrix]:
        """Point (3,) mm, unit direction (3,) and basis (3, 2) across it of the beam as stated, in the flange
        frame; ValueError for what is no beam."""
        raise ValueError(f"a {self.name} has no beam")

    @abstractmethod
    def predict(self, target: ca.SX, unknowns: ca.SX) -> ca.SX:
        """The reading (d, 1) of a `target` (3, 1) mm in the flange frame."""
