"""The way up the log-posterior, for many rows side by side: Levenberg-Marquardt, then Newton.

Levenberg and Marquardt's steps are by Fisher's information on the exact log-posterior; Newton's by
differences of the exact gradient, whose curvature at the top also gives the covariance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...model.arrays import Index, Matrix
from ...model.likelihood.density import Density
from .compiled_climb import compiled_climb
from .coordinates import seen_coordinates
from .levenberg_marquardt import Minima, Quadratic, levenberg_marquardt

_CLIMBED = 1e-7  # log-posterior units: from here Newton's steps finish
MOST_STEPS = 200
_POLISH = 60
_TURN, _SHIFT = 0.2, 200.0  # rad, mm: the longest step of an offset, beyond which nothing is linear
_FLAT = 1e-3  # curvature, as a share of Fisher's, below which a direction is no ridge to trust
_DIFFERENCE = 1e-3  # step of the differences, in posterior stds
_CONVERGED = 1e-4  # size of the gradient, in posterior stds
_STILL = 3e-3  # posterior stds: after a shorter way the curvature is as it was


@dataclass(frozen=True, eq=False)
class Optima:
    """Where the rows ended, in the coordinates v: `v` (W, f), `covariance` (W, f, f) from the curvature,
    `value` (W,) the log-posterior, `gradient` (W,) its size in posterior stds."""

    v: Matrix
    covariance: Matrix
    value: Matrix
    gradient: Matrix
    iterations: Index
    converged: NDArray[np.bool_]
    reason: tuple[str, ...]


class Climb:
    """The log-posterior in the coordinates v, for the rows of a fit: `of` (W,) names the data set of each
    (default: one for each), `held` (W, f) coordinates that stay where they are."""

    def __init__(
        self, density: Density, of: Index | None, rows: int, held: NDArray[np.bool_] | None = None
    ) -> None:
        self._density = density
        self.coordinates = seen_coordinates(density)
        self.of = np.arange(rows) if of is None else of
        self._held = held
        self._compiled = compiled_climb(density, self.coordinates) if held is None else None
        parameters = density.problem.parameters
        local = np.where(np.array([item.unit for item in parameters.items]) == "deg", _TURN, _SHIFT)
        local = np.where(parameters.group("offset"), local, np.inf)
        self._noise = parameters.group("noise")[parameters.free]
        self._longest = (local / parameters.prior_std)[parameters.free]

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
        place = self.coordinates.at(v, of)
        value, gradient, information = self._density.slopes(place.x, of)
        gradient, information = place.gradient(gradient), place.information(information)
        if self._held is not None:
            row, own = np.nonzero(self._held[rows])
            gradient[row, own] = 0.0
            information[row, own] = 0.0
            information[row, :, own] = 0.0
            information[row, own, own] = 1.0
        return Quadratic(-value, -gradient, information)

    def polished(self, found: Minima) -> Optima:
        """Newton's steps on the exact log-posterior, log det included, in whitened coordinates."""
        if self._compiled is None:
            v, covariance, value, size, iterations = self._newton(found, np.arange(len(found.x)))
        else:
            v, covariance, value, size, iterations, whole = self._compiled.polish(
                found, self.of, _POLISH, 1e-3 * _CONVERGED, _FLAT, _DIFFERENCE, _STILL
            )
            left = np.flatnonzero(~whole)
            for data_set in np.unique(self.of[left]):  # so that no run's bits depend on those beside it
                rows = left[self.of[left] == data_set]
                own = self._newton(found, rows)
                for part, part_left in zip((v, covariance, value, size, iterations), own, strict=True):
                    part[rows] = part_left
        converged, reason = found.converged.copy(), list(found.reason)
        for row, length in enumerate(size.tolist()):
            if length < _CONVERGED:
                converged[row], reason[row] = (
                    True,
                    f"the gradient is {length:.1e} posterior standard deviations",
                )
            elif converged[row]:
                converged[row] = False
                reason[row] = f"the gradient stays at {length:.1e} posterior standard deviations"
        return Optima(v, covariance, value, size, iterations, converged, tuple(reason))

    def _newton(self, found: Minima, rows: Index) -> tuple[Matrix, Matrix, Matrix, Matrix, Index]:
        """Of these rows where Newton's steps end: v, covariance, value, size of the gradient, iterations."""
        v, iterations, of = found.x[rows], found.iterations[rows], self.of[rows]
        sound = np.isfinite(found.cost[rows])
        curvature = np.tile(np.eye(v.shape[1]), (len(v), 1, 1))
        information = np.where(sound[:, None, None], found.curvature[rows], curvature)
        # Of the information, not of its inverse, which rounding may leave indefinite.
        root = np.asarray(np.linalg.inv(np.linalg.cholesky(information)).transpose(0, 2, 1), dtype=float)
        active = np.flatnonzero(sound)
        value, slope = -found.cost[rows], -_times(root.transpose(0, 2, 1), found.slope[rows])
        slope[~sound] = np.inf
        curvature[active] = self._curvature(v[active], of[active], root[active])
        way = np.zeros(len(v))  # since the curvature was taken
        for _ in range(_POLISH):
            active = active[_length(slope[active]) >= 1e-3 * _CONVERGED]
            if len(active) == 0:
                break
            step = _uphill(curvature[active], slope[active])
            taken, v[active], new_value, new_slope = self._search(v, value, slope, of, active, root, step)
            slow = _length(new_slope) > 0.1 * _length(slope[active])
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
            trial_value, trial_slope = self._value_and_slope(trial, of[rows], root[rows])
            # Near the top the values differ by rounding only: there the slope decides.
            size, before = _length(trial_slope), _length(slope[rows])
            good = (trial_value > value[rows]) | ((size < 0.5 * before) & (before < 2e-3))
            at = left[good]
            taken[at] = True
            result[at], values[at], slopes[at] = trial[good], trial_value[good], trial_slope[good]
            length /= 4
        return taken, result, values, slopes

    def _value_and_slope(self, v: Matrix, of: Index, root: Matrix) -> tuple[Matrix, Matrix]:
        """(W,) log-posterior and (W, f) its gradient in the coordinates w of v = v0 + root w."""
        value, slope = self._slope(v, of)
        return value, _times(root.transpose(0, 2, 1), slope)

    def _slope(self, v: Matrix, of: Index) -> tuple[Matrix, Matrix]:
        """(W,) log-posterior and (W, f) its gradient in v, of data sets `of` (W,)."""
        if self._compiled is not None:
            cost, slope, _ = self._compiled.slopes(v, of, with_information=False)
            return -cost, -slope
        place = self.coordinates.at(v, of)
        value, gradient, _ = self._density.slopes(place.x, of, with_information=False)
        return value, place.gradient(gradient)

    def _curvature(self, v: Matrix, of: Index, root: Matrix) -> Matrix:
        """(W, f, f) negative Hessian in the coordinates w, by central differences of the exact gradient."""
        count, size = v.shape
        steps = _DIFFERENCE * root.transpose(0, 2, 1)  # row j: the step along w_j
        points = np.concatenate([v[:, None] - steps, v[:, None] + steps], axis=1).reshape(-1, size)
        _, slopes = self._slope(points, np.repeat(of, 2 * size))
        slopes = slopes.reshape(count, 2, size, size)
        hessian = (slopes[:, 0] - slopes[:, 1]) @ root / (2 * _DIFFERENCE)
        return np.asarray((hessian + hessian.transpose(0, 2, 1)) / 2)


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


def _length(vectors: Matrix) -> Matrix:
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))


def _times(matrices: Matrix, vectors: Matrix) -> Matrix:
    return np.asarray((matrices @ vectors[:, :, None])[:, :, 0])
