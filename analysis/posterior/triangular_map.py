"""Triangular map (transport): a polynomial change of coordinates that straightens a curved cloud of draws.

A null-space direction that is a rotation drags the well known ones along an arc: the cloud is a thin curved
sheet on which no normal and no difference of two draws fits. Here each coordinate's mean is a cubic in those
before it (a triangular map, Marzouk et al. 2016, with constant diagonal), so that what is left is nearly
normal. The volume factor is constant, and drops out.
"""

from __future__ import annotations

import numpy as np

from ...model.arrays import Matrix

_DEGREE = 3
_REACH = 4.0  # stds: farther out the polynomials stay what they are there
_RIDGE = 1e-6
_BLOCK = 256  # rows whose terms a core keeps near


class TriangularMap:
    """u (W, f) nearly unit normal, w (W, f) like the draws it is fitted to (N, f)."""

    def __init__(self, draws: Matrix, base: Matrix) -> None:
        """`base` (f, f) is a factor in whose units a straight cloud would be round.

        Curved directions have a larger spread in these units: those of the least spread come first.
        """
        self._centre = draws.mean(axis=0)
        inner = np.linalg.solve(base, (draws - self._centre).T)
        variances, axes = np.linalg.eigh(np.cov(inner).reshape(len(inner), len(inner)))
        scale = np.sqrt(np.maximum(variances, 1e-12 * variances[-1]))
        self._factor = base @ (axes * scale)
        straight = (axes / scale).T @ inner
        terms = _Terms(len(inner), inner.shape[1])
        ends = []
        for row in straight:
            ends.append(len(terms.products))
            terms.append(row)
        # One Gram matrix and one Cholesky factor serve all coordinates: the terms of each are the first few.
        products = terms.products[: ends[-1]]
        gram = products @ products.T + _RIDGE * products.shape[1] * np.eye(len(products))
        lower = np.linalg.cholesky(gram)
        inverse = np.linalg.inv(lower)
        self._coefficients = [
            inverse[:end, :end].T @ (inverse[:end, :end] @ (products[:end] @ row))
            for end, row in zip(ends, straight, strict=True)
        ]
        self._left = [
            max(float(np.std(row - c @ products[: len(c)])), 1e-6)
            for c, row in zip(self._coefficients, straight, strict=True)
        ]

    def forth(self, u: Matrix) -> Matrix:
        """w of u."""
        return np.concatenate([self._forth(u[i : i + _BLOCK]) for i in range(0, len(u), _BLOCK)])

    def back(self, w: Matrix) -> Matrix:
        """u of w."""
        return np.concatenate([self._back(w[i : i + _BLOCK]) for i in range(0, len(w), _BLOCK)])

    def _forth(self, u: Matrix) -> Matrix:
        straight = np.empty(u.T.shape)
        terms = _Terms(u.shape[1], len(u))
        for j, (coefficients, left) in enumerate(zip(self._coefficients, self._left, strict=True)):
            straight[j] = left * u[:, j] + coefficients @ terms.products
            terms.append(straight[j])
        result: Matrix = self._centre + (self._factor @ straight).T
        return result

    def _back(self, w: Matrix) -> Matrix:
        straight = np.linalg.solve(self._factor, (w - self._centre).T)
        result = np.empty(w.shape)
        terms = _Terms(w.shape[1], len(w))
        for j, (coefficients, left) in enumerate(zip(self._coefficients, self._left, strict=True)):
            result[:, j] = (straight[j] - coefficients @ terms.products) / left
            terms.append(straight[j])
        return result


class _Terms:
    """All products of up to three of the coordinates so far, a row each; those of a new one come last."""

    def __init__(self, size: int, count: int) -> None:
        self._sums = [np.ones((1, count))]
        self._counts = [1] * (_DEGREE + 1)
        lengths = [1]
        for degree in range(1, _DEGREE + 1):
            lengths.append(lengths[-1] * (size + degree) // degree)
            self._sums.append(np.empty((lengths[-1], count)))
            self._sums[-1][0] = 1.0

    @property
    def products(self) -> Matrix:
        return self._sums[-1][: self._counts[-1]]

    def append(self, row: Matrix) -> None:
        """With the coordinate (N,) in stds; no term of it is new beyond its reach."""
        row = np.clip(row, -_REACH, _REACH)
        for degree in range(1, _DEGREE + 1):
            lower = self._sums[degree - 1][: self._counts[degree - 1]]
            first = self._counts[degree]
            np.multiply(lower, row, out=self._sums[degree][first : first + len(lower)])
            self._counts[degree] += len(lower)
