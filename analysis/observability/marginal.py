"""What has a tolerance as noise that the measurements share: the information on all else, without it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...model.arrays import Mask, Matrix


class Marginal(NamedTuple):
    """A (M, f) with t of its columns eliminated, those of what has a tolerance; m are left.

    `root` (k, m) is A of those left: `root.T @ root` is their information, the tolerances as noise (a Schur
    complement). `response` (t, m) is by how many tolerances the eliminated move with each of them, `std` (t,)
    their std in tolerances, were the others known.
    """

    root: Matrix
    response: Matrix
    std: Matrix

    @classmethod
    def of(cls, jacobian: Matrix, tolerated: Mask) -> Marginal:
        """By a QR factorisation with the eliminated columns first; their tolerances are rows of A."""
        count = int(tolerated.sum())
        if not count:
            return cls(jacobian, np.zeros((0, jacobian.shape[1])), np.zeros(0))
        ordered = np.hstack([jacobian[:, tolerated], jacobian[:, ~tolerated]])
        factor: Matrix = np.asarray(np.linalg.qr(ordered, mode="r"))
        right = np.hstack([-factor[:count, count:], np.eye(count)])
        solved = np.asarray(np.linalg.solve(factor[:count, :count], right), dtype=float)
        left = jacobian.shape[1] - count
        return cls(factor[count:, count:], solved[:, :left], np.linalg.norm(solved[:, left:], axis=1))

    def shares(self, direction: Matrix) -> Matrix:
        """(t,) the part of a direction's variance that each tolerance sets; `direction` (m,)."""
        variance = float(((self.root @ direction) ** 2).sum())
        return np.asarray((self.response @ direction) ** 2 / max(variance, np.finfo(float).tiny))
