"""What a person reads off the instrument at a posture: its numbers, and whether they are metres."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

import numpy as np

from ....model.arrays import Index, Matrix
from ....model.errors import BadInput
from ....model.files.plan import Plan
from ....model.instruments.kind import Instrument, Measurement
from ....model.likelihood.problem import Problem
from ....model.parsing.reading import shown
from ...procedure.events import EnteredReading

Entered = Mapping[str, float | tuple[float, ...]]  # as a measurement records it, by column

_DELIMITERS = re.compile(r"[\s,;|]+")
_NUMBER = re.compile(r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?")
_LENGTHS, _TURNS = "_mm", "_quat"  # how the keys of columns end
_LEAST_MM = 30.0  # a length that is predicted shorter may be a thousandth of another as well
_NEAR = 3.0  # times the predicted length: a reading in metres is nearer than that
_OFF_UNIT = 0.01  # of the length of a quaternion: what rounding does to it


def entered_readings(kind: type[Instrument]) -> tuple[EnteredReading, ...]:
    """What a person enters besides the joints, in its order."""
    return tuple(
        EnteredReading(key, kind.entered.get(key, key), size) for key, size in kind.read_off().items()
    )


class InstrumentReadings:
    """The readings of a plan's measurements, by their number: `reads` is empty where there is none to
    enter."""

    def __init__(self, plan: Plan, problem: Problem) -> None:
        self._plan, self._problem = plan, problem
        self._reads = {label: entered_readings(kind) for label, kind in plan.header.kinds.items()}
        postures = list(dict.fromkeys(item.posture for item in plan.measurements))
        self.rows = [postures.index(item.posture) for item in plan.measurements]

    def reads(self, number: int) -> tuple[EnteredReading, ...]:
        return self._reads[self._measurement(number).instrument]

    def _measurement(self, number: int) -> Measurement:
        return self._plan.measurements[number % len(self._plan.postures)]

    def row(self, number: int) -> Index:
        """(1,) the shot of the plan's problem that a measurement belongs to."""
        return np.array([self.rows[number % len(self.rows)]])

    def typed(self, number: int, text: str) -> Entered:
        """All numbers of a measurement, in the order of `reads`; BadInput for anything else."""
        reads = self.reads(number)
        count = sum(read.numbers for read in reads)
        parts = [part for part in re.split(r"[\s;]+", text.strip()) if part]
        if len(parts) != count or not all(map(_NUMBER.fullmatch, parts)):
            parts = [part for part in _DELIMITERS.split(text.strip()) if part]
        if len(parts) != count or not all(map(_NUMBER.fullmatch, parts)):
            raise BadInput(
                "this is not what the instrument reads",
                found=f"{shown(text.strip()) or 'nothing'} ({count} numbers are asked for)",
            )
        numbers = [float(part.replace(",", ".")) for part in parts]
        values: dict[str, float | tuple[float, ...]] = {}
        for read in reads:
            row, numbers = tuple(numbers[: read.numbers]), numbers[read.numbers :]
            if read.key.endswith(_TURNS) and abs(math.hypot(*row) - 1) > _OFF_UNIT:
                raise BadInput("this is no quaternion: its length is not 1", found=f"{math.hypot(*row):.4g}")
            values[read.key] = row if read.numbers > 1 else row[0]
        return values

    def of_metres(self, reading: Entered) -> Entered:
        """The reading whose lengths were typed in metres."""
        scaled: dict[str, float | tuple[float, ...]] = {}
        for key, value in reading.items():
            by = 1000.0 if key.endswith(_LENGTHS) else 1.0
            scaled[key] = tuple(v * by for v in value) if isinstance(value, tuple) else value * by
        return scaled

    def doubt(self, number: int, joints: Matrix, reading: Entered) -> str | None:
        """Whether the lengths look like metres where the arm is at `joints` (n,) deg or mm, as a sentence.

        By the size of a reading alone: where the instrument stands may not be known.
        """
        predicted = self._predicted(number, joints)
        for key, value in reading.items():
            if not key.endswith(_LENGTHS):
                continue
            size, expected = float(np.linalg.norm(value)), float(np.linalg.norm(predicted[key]))
            if expected < _LEAST_MM or not 0 < size < expected / _NEAR:
                continue
            if expected / _NEAR < 1000 * size < expected * _NEAR:
                return f"{size:.4g} mm where about {expected:.0f} mm is expected: this looks like metres"
        return None

    def _predicted(self, number: int, joints: Matrix) -> Entered:
        """By the nominal arm, and the instrument about where it is stated."""
        row = self._problem.select(self.row(number)).moved(joints[None] / self._problem.robot.display)
        read = row.at_predicted(row.nominal())
        measurement = self._measurement(number)
        part = next(
            part
            for part in read.tool.read_at(read.readings[0])
            if (part.instrument.label, part.variant) == (measurement.instrument, measurement.variant)
        )
        return part.instrument.recorded(part.reading, np.zeros(part.instrument.residual_size))
