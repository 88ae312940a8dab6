"""Several instruments as one: what of them reads at a posture, each with its own residual.

A run is a sum of kinds. The residual of a posture has the components of every part, an instrument with one
of its variants; the components of parts that do not read there are 0, and `ResidualLayout.active` says which
do. Parts that read at one posture share the errors of its recorded joints.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar, Literal, NamedTuple, Self

import casadi as ca
import numpy as np

from ..arrays import Matrix
from .kind import Flange, Instrument, Measurement, ResidualLayout, TargetEntry, Unknown, Words


class Part(NamedTuple):
    """An instrument, by its index, and a variant of what it reads."""

    instrument: int
    variant: str


@dataclass(frozen=True, eq=False)
class Together(Instrument):
    """`instruments` (I,) of which each has `parts`; a reading is (w,): for each part whether it reads, then
    what each part reads."""

    name = "together"
    also_called: ClassVar[tuple[str, ...]] = ()
    columns: ClassVar[Mapping[str, int]] = {}
    target = ""

    instruments: tuple[Instrument, ...]
    parts: tuple[Part, ...]

    @classmethod
    def of(cls, label: str, entry: Any, *, exact: bool) -> Self:
        raise NotImplementedError("it is made of instruments")

    @property
    def target_is(self) -> Literal["point", "plane", "nothing"]:  # type: ignore[override]
        """Nothing where no part has a target."""
        every = [instrument.target_is for instrument in self.instruments]
        return next((kind for kind in every if kind != "nothing"), "nothing")

    @property
    def met(self) -> bool:  # type: ignore[override]
        return any(instrument.met for instrument in self.instruments)

    @property
    def words(self) -> Words:  # type: ignore[override]
        return self.instruments[0].words

    @property
    def turns(self) -> bool:
        """Not where one instrument determines the last offset: it does so for all."""
        return all(instrument.turns for instrument in self.instruments)

    @property
    def grounded(self) -> bool:
        return any(instrument.grounded for instrument in self.instruments)

    @property
    def calibrated(self) -> bool:
        """One that is known determines what the last link does."""
        return any(instrument.calibrated for instrument in self.instruments)

    @property
    def each(self) -> tuple[Instrument, ...]:
        return self.instruments

    @cached_property
    def residual_size(self) -> int:
        return sum(instrument.residual_size for instrument in self._of_parts)

    @cached_property
    def reading_size(self) -> int:
        return len(self.parts) + sum(instrument.reading_size for instrument in self._of_parts)

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        every = [unknown for instrument in self.instruments for unknown in instrument.unknowns]
        return tuple(sorted(every, key=lambda unknown: unknown.group == "frame"))

    @property
    def key(self) -> bytes:
        parts = " ".join(f"{part.instrument}{part.variant}" for part in self.parts)
        return b"".join([parts.encode(), *(instrument.key for instrument in self.instruments)])

    @property
    def point(self) -> Matrix:
        return self.instruments[0].point

    def ray(self, unknowns: ca.SX) -> tuple[ca.SX, ca.SX]:
        return self.instruments[0].ray(unknowns[self.takes[0]])

    @cached_property
    def takes(self) -> list[list[int]]:
        """Of each instrument the places of its unknowns among all."""
        labels = [k for k, instrument in enumerate(self.instruments) for _ in instrument.unknowns]
        every = [unknown for instrument in self.instruments for unknown in instrument.unknowns]
        order = sorted(range(len(every)), key=lambda k: every[k].group == "frame")
        return [
            [at for at, k in enumerate(order) if labels[k] == number]
            for number in range(len(self.instruments))
        ]

    @cached_property
    def layout(self) -> ResidualLayout:
        relative, active, source = [], [], []
        for number, (part, instrument, at) in enumerate(
            zip(self.parts, self._of_parts, self.slices, strict=True)
        ):
            columns = instrument.layout.relative
            relative.append(np.where(columns < 0, -1, columns + at.start))
            active.append(np.full(instrument.residual_size, number))
            source.append(np.full(instrument.residual_size, part.instrument))
        return ResidualLayout(np.concatenate(relative), np.concatenate(active), np.concatenate(source))

    @cached_property
    def slices(self) -> list[slice]:
        """Where in a reading each part's own is."""
        sizes = [instrument.reading_size for instrument in self._of_parts]
        ends = np.cumsum([len(self.parts), *sizes]).tolist()
        return [slice(start, stop) for start, stop in pairwise(ends)]

    @property
    def rows(self) -> list[slice]:
        """The components of the residual that are each part's."""
        ends = np.cumsum([0, *(instrument.residual_size for instrument in self._of_parts)]).tolist()
        return [slice(start, stop) for start, stop in pairwise(ends)]

    @property
    def lengths(self) -> list[list[int]]:
        return [
            [rows.start + k for some in instrument.lengths for k in some]
            for instrument, rows in zip(self._of_parts, self.rows, strict=True)
        ]

    @property
    def _of_parts(self) -> list[Instrument]:
        return [self.instruments[part.instrument] for part in self.parts]

    def row(self, some: Sequence[Measurement], target: TargetEntry | None) -> tuple[Matrix, Matrix]:
        """Reading (w,) and shift (d,) of what is measured at one posture."""
        reading, shift = np.zeros(self.reading_size), np.zeros(self.residual_size)
        by_part = {(item.instrument, item.variant): item for item in some}
        for number, (part, instrument) in enumerate(zip(self.parts, self._of_parts, strict=True)):
            item = by_part.get((instrument.label, part.variant))
            reading[number] = item is not None
            # Of what does not read any numbers do, with which its functions stay finite.
            reading[self.slices[number]] = 1.0
            if item is not None:
                reading[self.slices[number]] = instrument.reading(item.measured, item.sigma_mm, target)
                shift[self.rows[number]] = instrument.shift(item.measured)
        return reading, shift

    def recorded_by(self, reading: Matrix, shift: Matrix) -> list[tuple[Part, dict[str, tuple[float, ...]]]]:
        """What each part that reads records."""
        return [
            (part, instrument.recorded(reading[at], shift[rows]))
            for number, (part, instrument, at, rows) in enumerate(
                zip(self.parts, self._of_parts, self.slices, self.rows, strict=True)
            )
            if reading[number]
        ]

    def residual(self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str) -> ca.SX:
        return ca.vertcat(
            *(
                reading[number]
                * instrument.residual(flange, target, unknowns[take], reading[at], part.variant)
                for number, part, instrument, take, at in self._each_part()
            )
        )

    def predicted(
        self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str
    ) -> ca.SX:
        rows = [
            instrument.predicted(flange, target, unknowns[take], reading[at], part.variant)
            for _, part, instrument, take, at in self._each_part()
        ]
        return ca.vertcat(reading[: len(self.parts)], *rows)

    def _each_part(self) -> Iterator[tuple[int, Part, Instrument, list[int], slice]]:
        for number, (part, at) in enumerate(zip(self.parts, self.slices, strict=True)):
            yield number, part, self.instruments[part.instrument], self.takes[part.instrument], at

    def start_unknowns(
        self, poses: Matrix, readings: Matrix, unknowns: Matrix, variants: Sequence[str]
    ) -> Matrix:
        started = unknowns.copy()
        for k, instrument in enumerate(self.instruments):
            own_poses, own_readings, own_variants = [], [], []
            for number, part, _, _, at in self._each_part():
                reads = readings[:, number] > 0
                if part.instrument == k and reads.any():
                    own_poses.append(poses[reads])
                    own_readings.append(readings[reads, at])
                    own_variants += [part.variant] * int(reads.sum())
            if own_poses:
                started[self.takes[k]] = instrument.start_unknowns(
                    np.concatenate(own_poses),
                    np.concatenate(own_readings),
                    unknowns[self.takes[k]],
                    own_variants,
                )
        return started

    def start_target(self, poses: Matrix, readings: Matrix, unknowns: Matrix) -> Matrix | None:
        for number, _, instrument, take, at in self._each_part():
            reads = readings[:, number] > 0
            if reads.any() and instrument.target_is != "nothing":
                return instrument.start_target(poses[reads], readings[reads, at], unknowns[take])
        return None
