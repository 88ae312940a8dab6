"""Several instruments as one: what of them reads at a posture, each with its own residual.

A run is a sum of kinds. The residual of a posture has the components of every part, an instrument with one
of its variants; the components of parts that do not read there are 0, and `ResidualLayout.active` says which
do. Parts that read at one posture share the errors of its recorded joints.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Literal, NamedTuple, Self

import casadi as ca
import numpy as np

from ..arrays import Matrix
from .kind import (
    Assumption,
    Flange,
    Instrument,
    Measurement,
    Misread,
    PartRead,
    ReadingNoise,
    ResidualLayout,
    TargetEntry,
    Unknown,
    Words,
)


class Part(NamedTuple):
    """An instrument, by its index, and a variant of what it reads."""

    instrument: int
    variant: str


class _PartOfRun(NamedTuple):
    """A part by its `number`: the instrument with its index `source`, the places of its unknowns among all,
    and where its own numbers are in a reading and its components in a residual."""

    number: int
    source: int
    instrument: Instrument
    variant: str
    unknowns: list[int]
    reading: slice
    rows: slice


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

    @property
    def noises(self) -> tuple[ReadingNoise, ...]:
        return tuple(one for each in self.instruments for one in each.noises)

    @property
    def taken_as_known(self) -> tuple[Assumption, ...]:
        return tuple(one for each in self.instruments for one in each.taken_as_known)

    def freed(self) -> tuple[Self, Mapping[str, float]]:
        every = [each.freed() for each in self.instruments]
        values = {name: value for _, some in every for name, value in some.items()}
        return replace(self, instruments=tuple(each for each, _ in every)), values

    @cached_property
    def residual_size(self) -> int:
        return sum(part.instrument.residual_size for part in self._parts)

    @cached_property
    def reading_size(self) -> int:
        return len(self.parts) + sum(part.instrument.reading_size for part in self._parts)

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        return tuple(unknown for _, unknown in self._unknowns)

    @cached_property
    def _unknowns(self) -> list[tuple[int, Unknown]]:
        """Those of all instruments with the index of each one's, the tools' before the frames'."""
        every = [(k, unknown) for k, each in enumerate(self.instruments) for unknown in each.unknowns]
        return sorted(every, key=lambda entry: entry[1].group == "frame")

    @cached_property
    def _parts(self) -> list[_PartOfRun]:
        made, reading, row = [], len(self.parts), 0
        for number, (source, variant) in enumerate(self.parts):
            one = self.instruments[source]
            unknowns = [at for at, (k, _) in enumerate(self._unknowns) if k == source]
            readings = slice(reading, reading := reading + one.reading_size)
            rows = slice(row, row := row + one.residual_size)
            made.append(_PartOfRun(number, source, one, variant, unknowns, readings, rows))
        return made

    @property
    def key(self) -> bytes:
        parts = " ".join(f"{part.instrument}{part.variant}" for part in self.parts)
        return b"".join([parts.encode(), *(instrument.key for instrument in self.instruments)])

    @property
    def point(self) -> Matrix:
        return self.instruments[0].point

    def ray(self, unknowns: ca.SX) -> tuple[ca.SX, ca.SX]:
        """That of the beam, if there is one, else of the first."""
        first = next((part for part in self._parts if part.instrument.beam), self._parts[0])
        return first.instrument.ray(unknowns[first.unknowns])

    def read_at(self, reading: Matrix) -> Iterator[PartRead]:
        for part in self._parts:
            if reading[part.number]:
                numbers = reading[part.reading]
                yield PartRead(part.instrument, part.variant, part.unknowns, numbers, part.rows)

    @cached_property
    def layout(self) -> ResidualLayout:
        relative, active, source, noise = [], [], [], []
        before = np.cumsum([0, *(len(each.noises) for each in self.instruments)])
        for part in self._parts:
            columns = part.instrument.layout.relative
            relative.append(np.where(columns < 0, -1, columns + part.reading.start))
            active.append(np.full(len(columns), part.number))
            source.append(np.full(len(columns), part.source))
            noise.append(before[part.source] + part.instrument.layout.noise)
        return ResidualLayout(*map(np.concatenate, (relative, active, source, noise)))

    @property
    def lengths(self) -> list[list[int]]:
        return [
            [part.rows.start + k for some in part.instrument.lengths for k in some] for part in self._parts
        ]

    def row(self, some: Sequence[Measurement], target: TargetEntry | None) -> tuple[Matrix, Matrix]:
        """Reading (w,) and shift (d,) of what is measured at one posture."""
        # Of what does not read any numbers do, with which its functions stay finite.
        reading, shift = np.ones(self.reading_size), np.zeros(self.residual_size)
        reading[: len(self.parts)] = 0.0
        by_part = {(item.instrument, item.variant): item for item in some}
        for part in self._parts:
            if item := by_part.get((part.instrument.label, part.variant)):
                reading[part.number] = 1.0
                reading[part.reading] = part.instrument.reading(item.measured, item.sigma_mm, target)
                shift[part.rows] = part.instrument.shift(item.measured)
        return reading, shift

    @property
    def stands_at(self) -> Matrix:
        return np.concatenate([each.stands_at for each in self.instruments])

    def placed(self, rng: np.random.Generator) -> Matrix:
        return np.concatenate([each.placed(rng) for each in self.instruments])

    def misread(self, readings: Matrix) -> Iterator[Misread]:
        """Of each instrument, in all its parts at once."""
        for source, instrument in enumerate(self.instruments):
            parts = [part for part in self._parts if part.source == source]
            for every in zip(*(instrument.misread(readings[:, part.reading]) for part in parts), strict=True):
                right = readings.copy()
                for part, one in zip(parts, every, strict=True):
                    reads = readings[:, [part.number]] > 0
                    right[:, part.reading] = np.where(reads, one.readings, readings[:, part.reading])
                yield every[0]._replace(readings=right)

    def residual(self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str) -> ca.SX:
        every = [
            part.instrument.residual(
                flange, target, unknowns[part.unknowns], reading[part.reading], part.variant
            )
            for part in self._parts
        ]
        return ca.vertcat(*(reading[part.number] * one for part, one in zip(self._parts, every, strict=True)))

    def predicted(
        self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str
    ) -> ca.SX:
        every = [
            part.instrument.predicted(
                flange, target, unknowns[part.unknowns], reading[part.reading], part.variant
            )
            for part in self._parts
        ]
        return ca.vertcat(reading[: len(self.parts)], *every)

    def start_unknowns(
        self, poses: Matrix, readings: Matrix, unknowns: Matrix, variants: Sequence[str]
    ) -> Matrix:
        started = unknowns.copy()
        for source, instrument in enumerate(self.instruments):
            reads = [
                (part, np.flatnonzero(readings[:, part.number]))
                for part in self._parts
                if part.source == source
            ]
            at = reads[0][0].unknowns
            if any(len(rows) for _, rows in reads):
                started[at] = instrument.start_unknowns(
                    np.concatenate([poses[rows] for _, rows in reads]),
                    np.concatenate([readings[rows, part.reading] for part, rows in reads]),
                    unknowns[at],
                    [part.variant for part, rows in reads for _ in rows],
                )
        return started

    def start_target(self, poses: Matrix, readings: Matrix, unknowns: Matrix) -> Matrix | None:
        for part in self._parts:
            reads = readings[:, part.number] > 0
            if reads.any() and part.instrument.target_is != "nothing":
                return part.instrument.start_target(
                    poses[reads], readings[reads, part.reading], unknowns[part.unknowns]
                )
        return None
