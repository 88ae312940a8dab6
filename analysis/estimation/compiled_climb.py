"""The climb of `levenberg_marquardt` from many starts, all steps in one call of C; Newton's in another.

For what most runs are: known noise, no stated distances. From Python a step of a few measurements takes ten
times as long as what it computes. Everything else climbs in Python, by the same formulas; up to rounding the
numbers are the same.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...model.arrays import Index, Matrix
from ...model.likelihood.c_source import GridInput, Offsets, columns
from ...model.likelihood.density import Density
from ...model.likelihood.kernel import compiled_library
from .climb_source import SOURCE
from .coordinates import SeenCoordinates
from .levenberg_marquardt import DAMPING, NO_LOWER, NO_STEP, NOT_FINITE, TOLERANCE, Minima, Quadratic


class CompiledClimb:
    """The climb of one density's rows."""

    def __init__(self, library: ctypes.CDLL, density: Density, coordinates: SeenCoordinates) -> None:
        self._library = library
        self._kept: list[Any] = [density, coordinates]
        problem = density.problem
        parameters, functions = problem.parameters, problem.functions
        slopes, placed = (functions.kernel(name, compile=True) for name in ("slopes", "placed"))
        sizes = [slopes.function.numel_out(k) for k in range(5)]
        self._size, self._width = density.size, len(parameters)
        nothing = np.zeros((1, self._width))
        (arm,) = columns(nothing, Offsets.of(np.array([parameters.arm.start])))
        targets: list[int] = []
        wide = 0
        for k in range(len(problem.targets)):
            own = parameters.of_shot(k)
            local = np.flatnonzero(parameters.free[own])
            shots = np.flatnonzero(problem.target_index == k)
            inputs = density.inputs(nothing, shots, k)
            targets += [self._call(slopes.address, inputs, nothing, len(shots)), slopes.size_out, sum(sizes)]
            targets += [len(local), self._at(local), self._at(parameters.among_free[own[local]])]
            moved = coordinates.moved(k)
            if moved is None:
                targets += [0] * 8
                continue
            first, moves, column, by, scale = moved
            inputs = [first, arm, GridInput(nothing, 3, first.offsets, 0)]
            targets += [self._call(placed.address, inputs, nothing, 1, seen=True), placed.size_out]
            targets += [parameters.block("target", k).start, len(moves), self._at(moves), self._at(column)]
            targets += [self._at(by), self._at(np.array([scale]))]
            wide += 3 * len(moves)
        self._wide = wide + 3 * len(problem.targets) + slopes.size_out + placed.size_out
        free = np.flatnonzero(parameters.free)
        head = [self._size, self._width, len(problem.targets), self._at(free)]
        head += [self._at(parameters.prior_mean), self._at(parameters.prior_std[free])]
        self._head, self._targets = self._at(np.array(head)), self._at(np.array(targets))

    def _at(self, values: Matrix | Index) -> int:
        """The address of an array that is kept."""
        self._kept.append(np.ascontiguousarray(values))
        return int(self._kept[-1].ctypes.data)

    def _call(
        self, function: int, inputs: Sequence[GridInput], x: Matrix, inner: int, *, seen: bool = False
    ) -> int:
        """The address of what C takes as a kernel's call."""
        numbers = [len(inputs), inner, function]
        for k, given in enumerate(inputs):
            self._kept.append(given)
            by_set = 3 if given.step else 0
            kind = 2 if seen and k == 2 else 1 if given.values is x else by_set
            numbers += [kind, given.address, given.step, given.offsets.address]
        return self._at(np.array(numbers))

    def slopes(self, v: Matrix, of: Index, *, with_information: bool = True) -> Quadratic:
        """Minus the log-posterior at v (W, f) of data sets `of` (W,), its gradient and information in v;
        where that was not asked for, of no rows."""
        v, of, rows = np.ascontiguousarray(v), np.ascontiguousarray(of), len(v)
        found = self._empty(rows, rows if with_information else 0)
        work = np.empty(rows * (self._wide + self._width))
        self._library.zb_slopes(
            self._head, self._targets, rows, v.ctypes.data, of.ctypes.data, work.ctypes.data,
            found.cost.ctypes.data, found.gradient.ctypes.data,
            found.curvature.ctypes.data if with_information else None,
            work.ctypes.data + 8 * rows * self._width,
        )  # fmt: skip
        return found

    def up(self, v: Matrix, of: Index, most: int, absolute: float, longest: Matrix) -> Minima:
        """As `levenberg_marquardt`."""
        v, of, rows = np.array(v, order="C"), np.ascontiguousarray(of), len(v)
        found = self._empty(rows, rows)
        iterations, ended = np.empty((2, rows), dtype=np.int64)
        self._library.zb_climb(
            self._head, self._targets, rows, v.ctypes.data, of.ctypes.data, most, DAMPING, TOLERANCE,
            absolute, longest.ctypes.data, self._wide, *(part.ctypes.data for part in found),
            iterations.ctypes.data, ended.ctypes.data,
        )  # fmt: skip
        if rows and ended[0] < 0:
            raise MemoryError
        reasons = (f"no convergence in {most} iterations", NO_LOWER, NO_STEP, NOT_FINITE)
        return Minima(v, *found, iterations, ended == 1, [reasons[k] for k in ended.tolist()])

    def polish(
        self, found: Minima, of: Index, most: int, end: float, flat: float, difference: float, still: float
    ) -> tuple[Matrix, Matrix, Matrix, Matrix, Index, NDArray[np.bool_]]:
        """As `Climb.polished`: v (W, f), covariance (W, f, f), value (W,), size of the gradient (W,), steps
        taken (W,), and for which rows (W,) these hold: not where a step is to be shortened, or a curvature
        is not above `flat`."""
        v, of, rows = np.array(found.x, order="C"), np.ascontiguousarray(of), len(found.x)
        cost, size = np.array(found.cost), np.full(rows, np.inf)
        start, information = np.ascontiguousarray(found.slope), np.ascontiguousarray(found.curvature)
        covariance = np.empty((rows, self._size, self._size))
        iterations, whole = np.array(found.iterations), np.empty(rows, dtype=np.int64)
        self._library.zb_polish(
            self._head, self._targets, rows, v.ctypes.data, of.ctypes.data, most, end, flat, difference,
            still, self._wide, *(part.ctypes.data for part in (cost, start, information, size, covariance)),
            iterations.ctypes.data, whole.ctypes.data,
        )  # fmt: skip
        if rows and whole[0] < 0:
            raise MemoryError
        return v, covariance, -cost, size, iterations, whole == 1

    def _empty(self, rows: int, informations: int) -> Quadratic:
        size = self._size
        return Quadratic(np.empty(rows), np.empty((rows, size)), np.empty((informations, size, size)))


def compiled_climb(
    density: Density, coordinates: SeenCoordinates, *, compile: bool | None = None
) -> CompiledClimb | None:
    """That of a density; None where Python is to climb. It serves as soon as the kernel of the slopes is
    compiled, `compile` being as for that."""
    problem = density.problem
    plain = problem.noise.known and not problem.distances and problem.functions.log_det == "none"
    if not (plain and density.size and problem.functions.kernel("slopes", compile=compile).compiled):
        return None
    return _made(density, coordinates)


@lru_cache(maxsize=8)
def _made(density: Density, coordinates: SeenCoordinates) -> CompiledClimb | None:
    library = _library()
    kernels = [density.problem.functions.kernel(name, compile=True) for name in ("slopes", "placed")]
    ready = library is not None and all(kernel.compiled for kernel in kernels)
    return CompiledClimb(library, density, coordinates) if library is not None and ready else None


@cache
def _library() -> ctypes.CDLL | None:
    pointer, whole, number = ctypes.c_void_p, ctypes.c_longlong, ctypes.c_double
    slopes = [pointer, pointer, whole, *([pointer] * 7)]
    climb = [pointer, pointer, whole, pointer, pointer, whole, number, number, number, pointer, whole]
    polish = [pointer, pointer, whole, pointer, pointer, whole, number, number, number, number, whole]
    functions = {
        "zb_slopes": slopes,
        "zb_climb": [*climb, *([pointer] * 5)],
        "zb_polish": [*polish, *([pointer] * 7)],
    }
    # Loops written by hand, and compiled once for all arms: unlike a kernel's lines they gain a fifth.
    return compiled_library("climb", lambda: SOURCE, functions, make=True, flags=["-O2"])
