"""Where the walkers live: coordinates in which a posterior is nearly a unit normal."""

from __future__ import annotations

import numpy as np

from ...model.arrays import Index, Matrix
from ...model.likelihood.density import Density
from ..estimation.coordinates import flange_coordinates
from .sheet import Local, sheet_of


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
