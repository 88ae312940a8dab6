"""New measurements as a calibration has them: what is carried over by name, and what is placed anew.

Targets and free frames may have been moved since the calibration, so their places are those where the new
measurements fit best. So is a part of an instrument that the calibration never read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ...model.arrays import Index, Mask, Matrix
from ...model.likelihood.problem import Problem
from ..diagnostics.hold_out import known_factors
from ..diagnostics.predicted_run import carrying

_STEPS = 5  # Gauss and Newton's, for the places
_STEPS_FROM_FAR = 15  # the same of what an instrument read, with no start that is near


@dataclass(frozen=True, eq=False)
class NewMeasurements:
    """A `problem` with the noise, functions and priors of a calibration; `placed` (p,) is what is placed."""

    problem: Problem
    placed: Mask

    @classmethod
    def of(cls, solved: Problem, x: Matrix, recorded: Problem) -> NewMeasurements:
        """Of a problem of the same robot, with instruments of the calibration: its problem `solved`, its mode
        `x` (p,)."""
        known, _ = known_factors(solved, x)
        carried = carrying(known, replace(recorded, ties=()), set())
        parameters = carried.parameters
        new = np.array([name not in known.parameters.names for name in parameters.names], dtype=bool)
        frames = (parameters.group("frame") | new) & parameters.free
        problem = replace(carried, weights=np.ones(carried.shots))
        return cls(problem, parameters.group("target") | frames)

    def with_places(self, x: Matrix, whitened: Callable[[Matrix], tuple[Matrix, Matrix]]) -> Matrix:
        """x (p,) with the places where the measurements fit best. `whitened` gives the residual (M,) at x and
        its scaled Jacobian (M, p)."""
        tried = []
        for start in self._starts(x):
            there = start.copy()
            for _ in range(_STEPS_FROM_FAR if self.problem.recorded else _STEPS):
                residual, jacobian = whitened(there)
                step = np.linalg.lstsq(jacobian[:, self.placed], residual, rcond=None)[0]
                there[self.placed] -= step * self.problem.parameters.prior_std[self.placed]
            residual, _ = whitened(there)
            tried.append((float(residual @ residual), there))
        return min(tried, key=lambda one: one[0])[1]

    def _starts(self, x: Matrix) -> Iterator[Matrix]:
        """Where the places may be, at x (p,) for all else: as the measurements alone have them, and where an
        instrument has read, at x as well."""
        there = x.copy()
        if not self.problem.recorded:
            target = self.problem.parameters.group("target")
            there[target] = self.problem.nearest_targets(x[None])[0]
            yield there
            return
        yield x
        there[self.placed] = self.problem.started(x[None])[0][self.placed]
        yield there


def of_rows(problem: Problem, rows: Index | list[int]) -> Problem:
    """Some of the measurements, with the targets that these have; one at least, where there are any."""
    some = problem.select(np.asarray(rows, dtype=np.int64))
    kept = {some.targets[k] for k in some.target_index.tolist()}
    if not any(name in kept for name in some.targets[: len(some.targets) - some.stations]):
        kept |= set(some.targets[:1])
    return replace(some, ties=()).without_targets(set(some.targets) - kept)
