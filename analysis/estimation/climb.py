"""The way up the log-posterior, for many rows side by side: Levenberg-Marquardt, then Newton.

Levenberg and Marquardt's steps are by Fisher's information on the exact log-posterior; Newton's by
differences of the exact gradient, whose curvature at the top also gives the covariance.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...model.arrays import Index, Matrix
from ...model.c_source import GridInput, Offsets, columns
from ...model.kernel import compiled_library
from ...model.likelihood.density import Density
from .coordinates import FlangeCoordinates, flange_coordinates
from .levenberg_marquardt import (
    DAMPING,
    NO_LOWER,
    NO_STEP,
    NOT_FINITE,
    TOLERANCE,
    Minima,
    Minimised,
    Quadratic,
    levenberg_marquardt,
)

_SOURCE = Path(__file__).parent / "climb.c"


class CompiledClimb:
    """The climb of one density's rows, all steps in one call of C (climb.c).

    For what most runs are: known noise, no stated distances or angles. From Python a step of a few
    measurements takes ten times as long as what it computes. Everything else climbs in Python, by the same
    formulas; up to rounding the numbers are the same.
    """

    def __init__(self, library: ctypes.CDLL, density: Density, coordinates: FlangeCoordinates) -> None:
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
            columns_of_shot = parameters.of_shot(k)
            local = np.flatnonzero(parameters.free[columns_of_shot])
            shots = np.flatnonzero(problem.target_index == k)
            inputs = density.inputs(nothing, shots, k)
            targets += [self._call(slopes.address, inputs, nothing, len(shots)), slopes.size_out, sum(sizes)]
            targets += [len(local), self._at(local), self._at(parameters.among_free[columns_of_shot[local]])]
            moved = coordinates.moved(k)
            if moved is None:
                targets += [0] * 8
                continue
            first, moves, column, by, scale = moved
            inputs = [first, arm, GridInput(nothing, 3, first.offsets, 0)]
            targets += [self._call(placed.address, inputs, nothing, 1, in_flange=True), placed.size_out]
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
        self, function: int, inputs: Sequence[GridInput], x: Matrix, inner: int, *, in_flange: bool = False
    ) -> int:
        """The address of a kernel's call as climb.c reads it."""
        numbers = [len(inputs), inner, function]
        for k, grid_input in enumerate(inputs):
            self._kept.append(grid_input)
            by_set = 3 if grid_input.step else 0
            kind = 2 if in_flange and k == 2 else 1 if grid_input.values is x else by_set
            numbers += [kind, grid_input.address, grid_input.step, grid_input.offsets.address]
        return self._at(np.array(numbers))

    def slopes(self, v: Matrix, of: Index, *, with_information: bool = True) -> Quadratic:
        """Minus the log-posterior at v (W, f) of data sets `of` (W,), its gradient and information in v;
        where that was not asked for, of no rows."""
        v, of, rows = np.ascontiguousarray(v), np.ascontiguousarray(of), len(v)
        quadratic = self._empty(rows, rows if with_information else 0)
        work = np.empty(rows * (self._wide + self._width))
        self._library.zb_slopes(
            self._head, self._targets, rows, v.ctypes.data, of.ctypes.data, work.ctypes.data,
            quadratic.cost.ctypes.data, quadratic.gradient.ctypes.data,
            quadratic.curvature.ctypes.data if with_information else None,
            work.ctypes.data + 8 * rows * self._width,
        )  # fmt: skip
        return quadratic

    def up(self, v: Matrix, of: Index, most: int, absolute: float, longest: Matrix) -> Minima:
        """As `levenberg_marquardt`."""
        v, of, rows = np.array(v, order="C"), np.ascontiguousarray(of), len(v)
        quadratic = self._empty(rows, rows)
        iterations, ended = np.empty((2, rows), dtype=np.int64)
        self._library.zb_climb(
            self._head, self._targets, rows, v.ctypes.data, of.ctypes.data, most, DAMPING, TOLERANCE,
            absolute, longest.ctypes.data, self._wide, *(part.ctypes.data for part in quadratic),
            iterations.ctypes.data, ended.ctypes.data,
        )  # fmt: skip
        if rows and ended[0] < 0:
            raise MemoryError
        reasons = (f"no convergence in {most} iterations", NO_LOWER, NO_STEP, NOT_FINITE)
        return Minima(iterations, ended == 1, [reasons[k] for k in ended.tolist()], v, *quadratic)

    def polish(
        self, minima: Minima, of: Index, most: int, end: float, flat: float, difference: float, still: float
    ) -> tuple[Matrix, Matrix, Matrix, Matrix, Index, NDArray[np.bool_]]:
        """As `Climb.polished`: v (W, f), covariance (W, f, f), value (W,), size of the gradient (W,), steps
        taken (W,), and for which rows (W,) these hold: not where a step is to be shortened, or a curvature
        is not above `flat`."""
        v, of, rows = np.array(minima.x, order="C"), np.ascontiguousarray(of), len(minima.x)
        cost, size = np.array(minima.cost), np.full(rows, np.inf)
        start, information = np.ascontiguousarray(minima.slope), np.ascontiguousarray(minima.curvature)
        covariance = np.empty((rows, self._size, self._size))
        iterations, whole = np.array(minima.iterations), np.empty(rows, dtype=np.int64)
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
    density: Density, coordinates: FlangeCoordinates, *, compile: bool | None = None
) -> CompiledClimb | None:
    """That of a density; None where Python is to climb. It serves as soon as the kernel of the slopes is
    compiled, `compile` being as for that."""
    problem = density.problem
    plain = problem.noise.known and not problem.ties and problem.functions.log_det == "none"
    if not (plain and density.size and problem.functions.kernel("slopes", compile=compile).compiled):
        return None
    return _made(density, coordinates)


@lru_cache(maxsize=8)
def _made(density: Density, coordinates: FlangeCoordinates) -> CompiledClimb | None:
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
    return compiled_library("climb", _SOURCE.read_text, functions, make=True, flags=["-O2"])


_CLIMBED = 1e-7  # log-posterior units: from here Newton's steps finish
MOST_STEPS = 200
_POLISH = 60
_TURN, _SHIFT = 0.2, 200.0  # rad, mm: the longest step of an offset, beyond which nothing is linear
_FLAT = 1e-3  # curvature, as a share of Fisher's, below which a direction is no ridge to trust
_DIFFERENCE = 1e-3  # step of the differences, in posterior stds
_CONVERGED = 1e-3  # size of the gradient, in posterior stds: no estimate is farther from the top than that
_FINE = 1e-7  # to be reached where rounding allows it
NOT_POSITIVE = "the information of the measurements is not positive definite to rounding"
_STILL = 3e-3  # posterior stds: after a shorter way the curvature is as it was


@dataclass(frozen=True, eq=False)
class Optima(Minimised):
    """Where the rows ended, in the coordinates v: `v` (W, f), `covariance` (W, f, f) from the curvature,
    `value` (W,) the log-posterior, `gradient` (W,) its size in posterior stds."""

    v: Matrix
    covariance: Matrix
    value: Matrix
    gradient: Matrix


class Climb:
    """The log-posterior in the coordinates v, for the rows of a fit: `of` (W,) names the data set of each
    (default: one for each), `held` (W, f) coordinates that stay where they are."""

    def __init__(
        self, density: Density, of: Index | None, rows: int, held: NDArray[np.bool_] | None = None
    ) -> None:
        self._density = density
        self.coordinates = flange_coordinates(density)
        self.of = np.arange(rows) if of is None else of
        self._held = held
        self._compiled = compiled_climb(density, self.coordinates) if held is None else None
        self._noise, self._longest = _noise_and_longest(density)

    def up(self, v: Matrix, most: int = MOST_STEPS) -> Minima:
        """From v (W, f) to where no step promises more than rounding of the log-posterior, in at most so many
        steps."""
        if self._noise.any() and self._held is None:
            # Far from the mode the residuals ask for any noise: first the rest, at the noise of the start.
            v = Climb(self._density, self.of, len(v), np.tile(self._noise, (len(v), 1))).up(v, most).x
        if self._compiled is not None:
            return self._compiled.up(v, self.of, most, _CLIMBED, self._longest)
        return levenberg_marquardt(
            self._model, v, max_iterations=most, absolute=_CLIMBED, longest=self._longest
        )

    def _model(self, v: Matrix, rows: Index) -> Quadratic:
        """Minus the log-posterior at v (W, f) of these rows, in v."""
        of = self.of[rows]
        point = self.coordinates.at(v, of)
        value, gradient, information = self._density.slopes(point.x, of)
        gradient, information = point.gradient(gradient), point.information(information)
        if self._held is not None:
            row, column = np.nonzero(self._held[rows])
            gradient[row, column] = 0.0
            information[row, column] = 0.0
            information[row, :, column] = 0.0
            information[row, column, column] = 1.0
        return Quadratic(-value, -gradient, information)

    def polished(self, minima: Minima) -> Optima:
        """Newton's steps on the exact log-posterior, log det included, in whitened coordinates."""
        if self._compiled is None:
            v, covariance, value, size, iterations = self._newton(minima, np.arange(len(minima.x)))
        else:
            v, covariance, value, size, iterations, whole = self._compiled.polish(
                minima, self.of, _POLISH, _FINE, _FLAT, _DIFFERENCE, _STILL
            )
            left = np.flatnonzero(~whole)
            for data_set in np.unique(self.of[left]):  # so that no run's bits depend on those beside it
                rows = left[self.of[left] == data_set]
                by_newton = self._newton(minima, rows)
                for part, part_left in zip((v, covariance, value, size, iterations), by_newton, strict=True):
                    part[rows] = part_left
        converged, reason = minima.converged.copy(), list(minima.reason)
        for row, length in enumerate(size.tolist()):
            if length < _CONVERGED:
                converged[row], reason[row] = (
                    True,
                    f"the gradient is {length:.1e} posterior standard deviations",
                )
            elif converged[row] and not np.isfinite(length):
                converged[row], reason[row] = False, NOT_POSITIVE
            elif converged[row]:
                converged[row] = False
                reason[row] = f"the gradient stays at {length:.1e} posterior standard deviations"
        return Optima(iterations, converged, reason, v, covariance, value, size)

    def _newton(self, minima: Minima, rows: Index) -> tuple[Matrix, Matrix, Matrix, Matrix, Index]:
        """Of these rows where Newton's steps end: v, covariance, value, size of the gradient, iterations."""
        v, iterations, of = minima.x[rows], minima.iterations[rows], self.of[rows]
        sound = np.isfinite(minima.cost[rows]) & _positive(minima.curvature[rows])
        curvature = np.tile(np.eye(v.shape[1]), (len(v), 1, 1))
        information = np.where(sound[:, None, None], minima.curvature[rows], curvature)
        # Of the information, not of its inverse, which rounding may leave indefinite.
        root = np.asarray(np.linalg.inv(np.linalg.cholesky(information)).transpose(0, 2, 1), dtype=float)
        active = np.flatnonzero(sound)
        value, slope = -minima.cost[rows], -_times(root.transpose(0, 2, 1), minima.slope[rows])
        slope[~sound] = np.inf
        curvature[active] = self._curvature(v[active], of[active], root[active])
        way = np.zeros(len(v))  # since the curvature was taken
        for _ in range(_POLISH):
            active = active[_length(slope[active]) >= _FINE]
            if len(active) == 0:
                break
            step = _uphill(curvature[active], slope[active])
            taken, v[active], new_value, new_slope = self._search(v, value, slope, of, active, root, step)
            size, before = _length(new_slope), _length(slope[active])
            slow = size > 0.1 * before
            taken &= (size < 0.5 * before) | (size > _CONVERGED)  # else rounding is all that is left
            value[active], slope[active] = new_value, new_slope
            way[active] += _length(step)
            iterations[active] += 1
            active = active[taken]
            again = active[slow[taken]]
            if len(again):
                curvature[again] = self._curvature(v[again], of[again], root[again])
                way[again] = 0.0
        moved = np.flatnonzero(way > _STILL)
        if len(moved):
            curvature[moved] = self._curvature(v[moved], of[moved], root[moved])
        # Where there is no maximum Fisher's information is used.
        if not _steep(curvature):
            curvature[np.linalg.eigvalsh(curvature)[:, 0] <= _FLAT] = np.eye(v.shape[1])
        covariance = root @ np.linalg.inv(curvature) @ root.transpose(0, 2, 1)
        covariance[~sound] = np.nan
        return v, covariance, value, _length(slope), iterations

    def _search(
        self, v: Matrix, value: Matrix, slope: Matrix, of: Index, active: Index, root: Matrix, step: Matrix
    ) -> tuple[NDArray[np.bool_], Matrix, Matrix, Matrix]:
        """Along the steps (of the whitened coordinates), shortened until the way leads up: for the active
        rows whether a step was taken, and v, value and slope after it."""
        taken = np.zeros(len(active), dtype=bool)
        result, values, slopes = v[active].copy(), value[active].copy(), slope[active].copy()
        length = 1.0
        while length > 1e-4 and not taken.all():
            left = np.flatnonzero(~taken)
            rows = active[left]
            trial = v[rows] + length * _times(root[rows], step[left])
            trial_value, by_v = self._slope(trial, of[rows])
            trial_slope = _times(root[rows].transpose(0, 2, 1), by_v)
            # Near the top the values differ by rounding only: there the slope decides.
            size, before = _length(trial_slope), _length(slope[rows])
            good = (trial_value > value[rows]) | ((size < 0.5 * before) & (before < 2e-3))
            at = left[good]
            taken[at] = True
            result[at], values[at], slopes[at] = trial[good], trial_value[good], trial_slope[good]
            length /= 4
        return taken, result, values, slopes

    def _slope(self, v: Matrix, of: Index) -> tuple[Matrix, Matrix]:
        """(W,) log-posterior and (W, f) its gradient in v, of data sets `of` (W,)."""
        if self._compiled is not None:
            cost, slope, _ = self._compiled.slopes(v, of, with_information=False)
            return -cost, -slope
        point = self.coordinates.at(v, of)
        value, gradient, _ = self._density.slopes(point.x, of, with_information=False)
        return value, point.gradient(gradient)

    def _curvature(self, v: Matrix, of: Index, root: Matrix) -> Matrix:
        """(W, f, f) negative Hessian in the coordinates w, by central differences of the exact gradient."""
        count, size = v.shape
        steps = _DIFFERENCE * root.transpose(0, 2, 1)  # row j: the step along w_j
        points = np.concatenate([v[:, None] - steps, v[:, None] + steps], axis=1).reshape(-1, size)
        _, slopes = self._slope(points, np.repeat(of, 2 * size))
        slopes = slopes.reshape(count, 2, size, size)
        hessian = (slopes[:, 0] - slopes[:, 1]) @ root / (2 * _DIFFERENCE)
        return np.asarray((hessian + hessian.transpose(0, 2, 1)) / 2)


@lru_cache(maxsize=8)
def _noise_and_longest(density: Density) -> tuple[NDArray[np.bool_], Matrix]:
    """(f,) which of a density's free parameters are noise, and the longest step of each."""
    parameters = density.problem.parameters
    local = np.where(np.array([item.unit for item in parameters.items]) == "deg", _TURN, _SHIFT)
    local = np.where(parameters.group("offset"), local, np.inf)
    return parameters.group("noise")[parameters.free], (local / parameters.prior_std)[parameters.free]


def _uphill(curvature: Matrix, slope: Matrix) -> Matrix:
    """Newton's steps (W, f), turned uphill along every direction whose curvature has the wrong sign."""
    if _steep(curvature):
        return np.asarray(np.linalg.solve(curvature, slope[:, :, None])[:, :, 0])
    values, vectors = np.linalg.eigh(curvature)
    along = (slope[:, None, :] @ vectors)[:, 0] / np.maximum(np.abs(values), _FLAT)
    step: Matrix = (vectors @ along[:, :, None])[:, :, 0]
    return step


def _steep(curvature: Matrix) -> bool:
    """Whether all eigenvalues of all (W, f, f) are above _FLAT: by Cholesky's factors, far sooner known than
    the eigenvalues."""
    try:
        np.linalg.cholesky(curvature - _FLAT * np.eye(curvature.shape[1]))
    except np.linalg.LinAlgError:
        return False
    return True


def _positive(information: Matrix) -> NDArray[np.bool_]:
    """(W,) which of (W, f, f) have Cholesky's factor. Of residuals that are 1e10 of their noise rounding may
    leave an information without one."""
    result = np.ones(len(information), dtype=bool)
    try:
        np.linalg.cholesky(information)
    except np.linalg.LinAlgError:
        for row, matrix in enumerate(information):
            try:
                np.linalg.cholesky(matrix)
            except np.linalg.LinAlgError:
                result[row] = False
    return result


def _length(vectors: Matrix) -> Matrix:
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))


def _times(matrices: Matrix, vectors: Matrix) -> Matrix:
    return np.asarray((matrices @ vectors[:, :, None])[:, :, 0])
