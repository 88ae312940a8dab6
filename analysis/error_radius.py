"""The radius of the ball that holds 95 % of an error in three dimensions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Self

import numpy as np
import scipy
from numpy.polynomial.chebyshev import chebpts1, chebvander
from numpy.polynomial.legendre import leggauss

from ..model.arrays import NORMAL_95, Index, Matrix

COVERAGE = 0.95
_NODES = 12  # of each ratio of stds
_LENGTHS = 80  # at which the law of a pooled length is worked out
_ONE_SIDED = 1.6448536269514722  # 95 % of a normal


def radius95(covariance: Matrix, dof: int | None = None) -> Matrix:
    """(P,) the radius of the ball that holds 95 % of a normal error of covariance (P, 3, 3), or of Student's
    t with `dof` and that matrix for a scale.

    In units of the largest principal std it depends on the ratios of the three alone, and smoothly: it is
    worked out at the Chebyshev points of two ratios, and interpolated: in a hundredth of the time of the
    integral for each. Good to 1e-4 of itself.
    """
    third, second, first = np.sqrt(np.maximum(_eigenvalues(covariance), 0.0))
    by_second = chebvander(2 * second / np.where(first > 0, first, 1.0) - 1, _NODES - 1)
    by_third = chebvander(2 * third / np.where(second > 0, second, 1.0) - 1, _NODES - 1)
    return np.asarray(first * (by_second @ _coefficients(dof) * by_third).sum(axis=1))


@dataclass(frozen=True, eq=False)
class LengthLaw:
    """The lengths of P normal errors in three dimensions with a mean, about, to 3 %.

    The square of a length is a weighted sum of noncentral chi-squared: a central one, shifted and scaled,
    with the same three moments (Pearson 1959): its mean is `first` (P,), its variance 2 `second`, `freedom`
    its degrees of freedom; by Wilson and Hilferty's cube."""

    first: Matrix
    second: Matrix
    freedom: Matrix

    @classmethod
    def about(cls, mean: Matrix, covariance: Matrix, dof: int | None = None) -> Self:
        """Of errors with the mean (P, 3) and covariance (P, 3, 3), or of Student's t with `dof`."""
        if dof is not None:
            covariance = covariance * (scipy.special.stdtrit(dof, 0.975) / NORMAL_95) ** 2
        once = np.einsum("pij,pj->pi", covariance, mean)
        twice = covariance @ covariance
        first = np.trace(covariance, axis1=1, axis2=2) + (mean**2).sum(axis=1)
        second = np.trace(twice, axis1=1, axis2=2) + 2 * (mean * once).sum(axis=1)
        third = np.einsum("pij,pji->p", twice, covariance) + 3 * (once**2).sum(axis=1)
        return cls(
            first, second, np.divide(second**3, third**2, out=np.full(len(first), np.inf), where=third > 0)
        )

    def of(self, rows: slice) -> LengthLaw:
        return LengthLaw(self.first[rows], self.second[rows], self.freedom[rows])

    def quantile(self) -> Matrix:
        """(P,) the radius of the ball that holds 95 %."""
        share = 2 / (9 * self.freedom)
        quantile = (1 - share + _ONE_SIDED * np.sqrt(share)) ** 3 - 1  # over its degrees of freedom, less 1
        at_infinity = np.where(
            np.isinf(self.freedom), 0.0, quantile * np.sqrt(np.minimum(self.freedom, 1e300))
        )
        return np.asarray(np.sqrt(self.first + np.sqrt(self.second) * at_infinity))

    def pooled_quantile(self, groups: Index) -> Matrix:
        """(G,) the length that 95 % of the errors of each group together stay below, `groups` (P,) from 0;
        nan of a group without any."""
        logs, inside = self._table
        count = np.bincount(groups)
        pooled = np.array([np.bincount(groups, row) for row in inside]) / np.maximum(count, 1)
        after = (pooled < COVERAGE).sum(axis=0).clip(1, _LENGTHS - 1)
        group = np.arange(len(count))
        low, high = pooled[after - 1, group], pooled[after, group]
        share = np.clip((COVERAGE - low) / np.maximum(high - low, 1e-12), 0.0, 1.0)
        lengths = np.exp(logs[after - 1] + share * (logs[after] - logs[after - 1]))
        return np.where(count > 0, lengths, np.nan)

    @cached_property
    def _table(self) -> tuple[Matrix, Matrix]:
        """(L,) logarithms of lengths, and (L, P) the probability that each error is shorter."""
        radius = self.quantile()
        high = max(float(radius.max()), 1e-9) * (1 + 1e-9)
        logs = np.linspace(np.log(max(float(radius.min()) / 8, high * 1e-4)), np.log(high), _LENGTHS)
        squares = np.exp(2 * logs)[:, None]
        share = np.maximum(2 / (9 * self.freedom), 1e-12)
        scale = np.sqrt(np.maximum(self.second * np.minimum(self.freedom, 1e300), 1e-300))
        normal = (np.cbrt(1 + (squares - self.first) / scale) - 1 + share) / np.sqrt(share)
        return logs, np.where(np.isinf(self.freedom), squares >= self.first, scipy.special.ndtr(normal))


def _eigenvalues(matrix: Matrix) -> Matrix:
    """(3, P) of symmetric matrices (P, 3, 3), the least first, by the cosines of Cardano's formula (Smith
    1961): a fifth of the time of LAPACK, for thousands of them at once. Good to 1e-8 of the largest."""
    mean = np.trace(matrix, axis1=1, axis2=2) / 3
    a, b, c = (matrix[:, i, i] - mean for i in range(3))
    d, e, f = matrix[:, 0, 1], matrix[:, 0, 2], matrix[:, 1, 2]
    size = np.sqrt((a**2 + b**2 + c**2 + 2 * (d**2 + e**2 + f**2)) / 6)
    scale = np.where(size > 0, size, 1.0)
    a, b, c, d, e, f = (entry / scale for entry in (a, b, c, d, e, f))
    half = (a * (b * c - f**2) - d * (d * c - f * e) + e * (d * f - b * e)) / 2  # of the determinant
    angle = np.arccos(np.clip(half, -1.0, 1.0)) / 3
    most, least = 2 * np.cos(angle), 2 * np.cos(angle + 2 * np.pi / 3)
    middle = -most - least
    # Of two that are equal rounding may make the wrong one the less.
    in_order = (np.minimum(least, middle), np.maximum(least, middle), most)
    return np.stack([mean + size * root for root in in_order])


@lru_cache(maxsize=64)
def _coefficients(dof: int | None) -> Matrix:
    """(k, k) of the Chebyshev polynomials of the two ratios."""
    points = chebpts1(_NODES)
    ratio = (points + 1) / 2
    exact = _radius(np.repeat(ratio, _NODES), np.outer(ratio, ratio).reshape(-1), dof)
    from_values = np.linalg.inv(chebvander(points, _NODES - 1))
    return np.asarray(from_values @ exact.reshape(_NODES, _NODES) @ from_values.T)


def _radius(second: Matrix, third: Matrix, dof: int | None) -> Matrix:
    """(P,) the same for principal stds of 1, `second` and `third` (P,).

    An error is C^(1/2) u times a length s: u even over the sphere, s^2 chi-squared of 3 (of Student's t:
    s^2 / 3 is F of 3 and dof). So P(|e| < R) is the mean over u of P(s < R / w), w^2 = u' C u: over Gauss
    points in one octant. The root is found by Newton's method on the logarithm of what is outside.
    """
    z, weight = leggauss(24)
    z, weight = np.repeat((z + 1) / 2, 8), np.repeat(weight / 16, 8)
    # Midpoints: over the period of an angle they are as good as Gauss's.
    angle = np.tile((np.arange(8) + 0.5) * np.pi / 16, 24)
    across = [second[:, None] * np.cos(angle), third[:, None] * np.sin(angle)]
    w = np.sqrt(z**2 + (1 - z**2) * (across[0] ** 2 + across[1] ** 2))
    radius = np.full(len(w), 1.96)  # of a normal error along a line: all others need more
    for _ in range(60):
        inside, density = _length_law(radius[:, None] / w, dof)
        outside = np.maximum(1 - inside @ weight, 1e-12)
        step = outside / ((density / w) @ weight) * np.log(outside / (1 - COVERAGE))
        radius = radius + step
        if np.abs(step).max() < 1e-7:
            break
    return radius


def _length_law(s: Matrix, dof: int | None) -> tuple[Matrix, Matrix]:
    """Of the length s, in stds, of an error in three dimensions: distribution function and density."""
    if dof is None:
        density = np.sqrt(2 / np.pi) * np.exp(-(s**2) / 2)
        return scipy.special.erf(s / np.sqrt(2)) - s * density, s**2 * density
    scale = 2 * np.exp(-scipy.special.betaln(1.5, dof / 2)) / dof**1.5
    return scipy.special.fdtr(3, dof, s**2 / 3), scale * s**2 * (1 + s**2 / dof) ** (-(dof + 3) / 2)
