"""Coordinates that straighten a posterior on a thin curved sheet.

A poorly known direction that is a rotation drags the well known ones along an arc: the cloud is a thin curved
sheet, on which no normal and no difference of two draws fits, and walkers that start beside it fall to its
middle. The few directions along which the information changes (the curved ones, a) are found at the mode. All
others, b, are nearly normal given a, about the ridge b*(a) where the density is highest: Gauss-Newton steps
at a few a give it, a polynomial goes through them. The map (a, e) -> (a, b*(a) + S e) is triangular (Marzouk
et al. 2016) with S constant, so that its volume factor is constant, and drops out; a and e are nearly
normal.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np

from ...model.arrays import Index, Matrix
from ...model.likelihood.density import Density
from ..estimation.coordinates import flange_coordinates

_CURVED = 0.1  # sum of the squared changes of the information over a std, in units of itself
_MOST = 3  # curved directions
_DEGREE = 4  # of the polynomials,
_REACH = 4.0  # fitted, and used, up to so many stds; farther out the ridge stays where it is there
_STEP = 0.5  # stds, of the differences
_POINTS = 4  # on the ridge for each term
_ROUNDS = (0.25, 0.5, 0.75, 1.0)  # of the way out, each from where the last has ended
_STEPS, _LAST_STEPS, _HALVINGS = 4, 12, 5
_STILL, _ON_RIDGE = 1e-4, 1e-2  # stds: the last step of all, and of what is on the ridge
_ENOUGH = 0.8  # of the places on the ridge; with fewer there is no polynomial through it


class Local(NamedTuple):
    """A log-density at many points: `value` (W,), `gradient` (W, f), `information` (W, f, f)."""

    value: Matrix
    gradient: Matrix
    information: Matrix


LocalDensity = Callable[[Matrix], Local]


class Sheet:
    """Maps u (W, f) nearly unit normal, to w (W, f), which is so but for the bend.

    `axes` (f, f) has the `curved` directions first; `coefficients` (t, f - k) are those of the ridge by the
    products of a, `factor` (f - k, f - k) is S.
    """

    def __init__(self, axes: Matrix, curved: int, coefficients: Matrix, factor: Matrix) -> None:
        self.curved = curved
        self._axes, self._coefficients, self._factor = axes, coefficients, factor

    def forth(self, u: Matrix) -> Matrix:
        """w of u."""
        along = u[:, : self.curved]
        across = _products(along) @ self._coefficients + u[:, self.curved :] @ self._factor.T
        return np.asarray(np.hstack([along, across]) @ self._axes.T)


def sheet_of(local: LocalDensity, size: int) -> Sheet | None:
    """The sheet of a density of `size` numbers w, a unit normal near its mode at 0 but for the bend; None
    where nothing is curved, or so much that no ridge is found."""
    curvature, axes = _curved(local, size)
    count = int((curvature[:_MOST] > _CURVED).sum())
    if count == 0:
        return None
    along = _places(count)
    across, factor, on_ridge = _ridge(local, axes, along)
    if on_ridge.mean() < _ENOUGH:
        return None
    terms = _products(along)
    # Places in the tails count less.
    weights = np.where(on_ridge, np.exp(-(along**2).sum(axis=1) / 8), 0.0)[:, None]
    coefficients = np.linalg.lstsq(terms * weights, across * weights, rcond=None)[0]
    return Sheet(axes, count, np.asarray(coefficients, dtype=float), factor)


def _curved(local: LocalDensity, size: int) -> tuple[Matrix, Matrix]:
    """(f,) how the information changes along each of the axes (f, f), largest first."""
    ways = _STEP * np.eye(size)
    information = local(np.concatenate([ways, -ways])).information
    change = (information[:size] - information[size:]) / (2 * _STEP)
    flat = np.nan_to_num(change.reshape(size, -1))
    curvature, axes = np.linalg.eigh(flat @ flat.T)
    return curvature[::-1], np.ascontiguousarray(axes[:, ::-1])


def _places(count: int) -> Matrix:
    """(P, k) where the ridge is looked for: the mode first, along the axes and in between."""
    radii = np.linspace(-_REACH, _REACH, 9)
    on_axes = np.concatenate([radii[radii != 0, None] * axis for axis in np.eye(count)])
    places = [np.zeros((1, count)), on_axes]
    if count > 1:
        rng = np.random.default_rng(0)
        ways = rng.normal(size=(_POINTS * _products(on_axes).shape[1] - len(on_axes), count))
        share = rng.random(len(ways)) ** (1 / count)
        places.append(ways / np.linalg.norm(ways, axis=1)[:, None] * _REACH * share[:, None])
    return np.concatenate(places)


def _ridge(local: LocalDensity, axes: Matrix, along: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """(P, f - k) where the density is highest at each of `along` (P, k), its factor (f - k, f - k) of the
    covariance at the first of them, and (P,) whether it is on the ridge."""
    count = along.shape[1]
    into, out = axes[:, :count].T, axes[:, count:]

    def at(share: float, across: Matrix) -> Local:
        value, gradient, information = local(share * along @ into + across @ out.T)
        return Local(value, gradient @ out, out.T @ information @ out)

    across = np.zeros((len(along), axes.shape[0] - count))
    on_ridge = np.ones(len(along), dtype=bool)
    for share in _ROUNDS:
        here = at(share, across)
        for _ in range(_LAST_STEPS if share == 1 else _STEPS):
            # Where the density is 0 there is no way on: the place is left out.
            on_ridge &= np.isfinite(here.value)
            step = np.zeros_like(across)
            step[on_ridge] = np.linalg.solve(here.information[on_ridge], here.gradient[on_ridge, :, None])[
                ..., 0
            ]
            for _ in range(_HALVINGS):
                there = at(share, across + step)
                worse = on_ridge & ~(there.value >= here.value - _STILL)
                if not worse.any():
                    break
                step[worse] /= 2
            across, here = across + step, there
            left = np.abs(step).max(axis=1)
            if left.max() < _STILL:
                break
        if (on_ridge & (left < _ON_RIDGE)).mean() < _ENOUGH:
            break
    on_ridge &= left < _ON_RIDGE
    return across, np.linalg.cholesky(np.linalg.inv(here.information[0])), on_ridge


def _products(along: Matrix) -> Matrix:
    """(W, t) all products of up to so many of the curved directions."""
    along = np.clip(along, -_REACH, _REACH)
    return np.column_stack(
        [np.ones(len(along))]
        + [
            along[:, list(chosen)].prod(axis=1)
            for degree in range(1, _DEGREE + 1)
            for chosen in combinations_with_replacement(range(along.shape[1]), degree)
        ]
    )


class Whitening:
    """u (W, f) of the posterior of data set `of` of a density, around its fit (x (p,), covariance (f, f)).

    w = L^-1 (v - centre) whitens the coordinates v by the fit: near it a unit normal. Where the posterior is
    a curved sheet it is straightened besides: `curved` is by how many directions.
    """

    def __init__(self, density: Density, x: Matrix, covariance: Matrix, of: int = 0) -> None:
        self._density, self._of = density, of
        self._coordinates = flange_coordinates(density)
        rows = self._rows(x[None])
        of_v = self._coordinates.covariance(x[None], covariance[None], rows)[0]
        self.centre: Matrix = self._coordinates.from_parameters(x[None], rows)[0]
        self.factor = np.asarray(np.linalg.cholesky(of_v), dtype=float)
        self._sheet = sheet_of(self._local, len(self.centre))
        self.curved = 0 if self._sheet is None else self._sheet.curved

    def coordinates(self, u: Matrix) -> Matrix:
        """v (W, f) of u (W, f)."""
        return self._undone(u if self._sheet is None else self._sheet.forth(u))

    def parameters(self, u: Matrix) -> Matrix:
        """x (W, p) of u (W, f)."""
        return self._coordinates.to_parameters(self.coordinates(u), self._rows(u))

    def log_density(self, u: Matrix) -> Matrix:
        """(W,) up to a constant."""
        return self._density.log_posterior(self.parameters(u), self._rows(u))

    def _rows(self, points: Matrix) -> Index:
        return np.full(len(points), self._of)

    def _undone(self, w: Matrix) -> Matrix:
        return np.asarray(self.centre + w @ self.factor.T)

    def _local(self, w: Matrix) -> Local:
        rows = self._rows(w)
        at = self._coordinates.at(self._undone(w), rows)
        slopes = self._density.slopes(at.x, rows)
        information = self.factor.T @ at.information(slopes.information) @ self.factor
        return Local(slopes.value, at.gradient(slopes.gradient) @ self.factor, information)
