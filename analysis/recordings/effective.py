"""The effective number of measurements: how many independent ones would say as much.

Residuals that follow each other in a recording are alike where something drifts slowly: temperature, a socket
that settles, an arm whose errors change slowly along a row of postures. n measurements with lag-1 correlation
rho then say as much as n / kappa independent ones, kappa = (1 + rho) / (1 - rho) (Bayley & Hammersley 1946,
for an autoregressive process of order 1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from ...model.arrays import Matrix
from ..estimation.fit import LikelihoodFit
from .recordings import Recorded, covariance, recording_rows, recordings, traces

CHANCE = 0.01  # p-value below which a correlation is used
_FEWEST = 4  # measurements of a recording with a correlation of its own
_GRID = np.array([-0.9, -0.6, -0.3, -0.1, 0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9])
LARGE = 600  # residuals of a recording whose covariance is no longer written out
_LEFT = 1e-3  # of the variance of an error: a recording with less left of all its errors is not tested
_HALVINGS = 60  # of an interval, to the last digit


@dataclass(frozen=True)
class RecordingCorrelation:
    """The correlation of the residuals that follow each other in a recording.

    `first_shot` and `last_shot` are its measurements' numbers. `rho` is without the bias that the fit's
    residuals have, `kappa` what it makes of the number of measurements, `p_value` the probability of a
    correlation as large if there is none (one-sided). None where a recording is too short.
    """

    target: str
    first_shot: int
    last_shot: int
    shots: int
    rho: float | None
    kappa: float | None
    p_value: float | None


@dataclass(frozen=True)
class Effective:
    """The effective number of measurements: `shots` / `divisor`.

    `rho`, `kappa` and `p_value` of all recordings together, None where none is long enough. `divisor` is what
    the information of the measurements is to be divided by: `kappa` where the correlation is positive beyond
    chance, else 1.
    """

    recordings: tuple[RecordingCorrelation, ...]
    shots: int
    rho: float | None
    kappa: float | None
    p_value: float | None
    divisor: float

    @property
    def number(self) -> float:
        """How many independent measurements would say as much."""
        return self.shots / self.divisor


def effective(fit: LikelihoodFit, rival: Matrix | None = None) -> Effective:
    """The lag-1 correlations of the residuals at a mode, per recording and of all; `rival` as of
    `recordings`."""
    problem, numbers = fit.problem, fit.problem.shot_numbers
    every = recording_rows(problem)
    found: dict[int, RecordingLag] = {}
    if fit.converged and any(len(own) >= _FEWEST for own in every):
        found = lags(recordings(fit, rival))
    alone, rows = {i: correlation([own]) for i, own in found.items()}, []
    for i, own in enumerate(every):
        rho, p_value = alone.get(i, (None, None))
        kappa = None if rho is None else _kappa(rho)
        target, first, last = problem.targets[problem.target_index[own[0]]], numbers[own[0]], numbers[own[-1]]
        rows.append(RecordingCorrelation(target, first, last, len(own), rho, kappa, p_value))
    shots = problem.shots
    if not found:
        return Effective(tuple(rows), shots, None, None, None, 1.0)
    if len(alone) == 1:
        ((rho, p_value),) = alone.values()
    else:
        rho, p_value = correlation(equalised(list(found.values())))
    kappa = _kappa(rho)
    return Effective(tuple(rows), shots, rho, kappa, p_value, max(kappa, 1.0) if p_value < CHANCE else 1.0)


def _kappa(rho: float) -> float:
    return (1 + rho) / (1 - rho)


class RecordingLag(NamedTuple):
    """Of a recording: `product` the sum over its neighbours of the products of their residuals, `square` the
    sum of squares; `products` and `squares` (grid,) what they are expected to be for the correlations of the
    grid; `size` n d. Of the covariance of the residuals without correlation: its trace `left`, that of
    neighbours as a share of it `bias`, and `forms`: `square` as a sum of chi-squares by its weights (n d,),
    `product` in the same errors by its matrix (n d, n d); None of a long recording."""

    shots: int
    product: float
    square: float
    products: Matrix
    squares: Matrix
    size: int
    left: float
    bias: float
    forms: tuple[Matrix, Matrix] | None


def lags(recorded: Recorded) -> dict[int, RecordingLag]:
    """Of the recordings that are long enough, by their place."""
    by_rho = [(float(rho), recorded.shared(float(rho))) for rho in _GRID]
    none = int(np.argmin(np.abs(_GRID)))
    result = {}
    for i, own in enumerate(recorded.every):
        d, residual = own.residual.shape[1], own.residual
        left, neighbours = traces(own, *by_rho[none])
        # A fit that takes up all errors leaves rounding.
        if own.shots < _FEWEST or left < _LEFT * own.shots * d:
            continue
        expected = [traces(own, *at) for at in by_rho]
        result[i] = RecordingLag(
            own.shots,
            float((residual[1:] * residual[:-1]).sum()),
            float((residual**2).sum()),
            np.array([products for _, products in expected]),
            np.array([squares for squares, _ in expected]),
            own.shots * d,
            left,
            neighbours / left,
            _forms(covariance(own, *by_rho[none]), d) if own.shots * d <= LARGE else None,
        )
    return result


def _forms(white: Matrix, d: int) -> tuple[Matrix, Matrix]:
    """Sum of squares and sum of products of neighbours (d apart) of normal residuals with that covariance, in
    independent errors: the weights of their squares, and a matrix."""
    values, vectors = np.linalg.eigh(white)
    values = np.maximum(values, 0.0)
    root = vectors * np.sqrt(values)
    half = root[d:].T @ root[:-d] / 2
    return values, np.asarray(half + half.T)


def equalised(found: Sequence[RecordingLag]) -> list[RecordingLag]:
    """The same, with residuals larger than in the middle one of the recordings scaled down to its.

    A target that slips while it is measured makes large residuals that are all alike: by the plain sums that
    one recording would speak for all.
    """
    mean_square = np.array([own.square / own.left for own in found])
    middle = float(np.median(mean_square))
    times = [middle / value if value > middle else 1.0 for value in mean_square]
    return [
        own._replace(product=own.product * by, square=own.square * by)
        for own, by in zip(found, times, strict=True)
    ]


def correlation(found: Sequence[RecordingLag]) -> tuple[float, float]:
    """The lag-1 correlation of some recordings together and the one-sided p-value of one as large by chance.

    The correlation is the one for which the ratio of the expected sums is the ratio that was found: so the
    bias of residuals of a fit (about -1 / n for a mean alone) is out. The p-value is that of a ratio of
    quadratic forms of normal errors, by the saddle point (Kuonen, Biometrika 86, 1999, eq. 3), and does not
    depend on the size of the noise.
    """
    ratio = _ratio(found)
    return rho_of(found), _chance(np.concatenate([_values(own, ratio) for own in found]))


def rho_of(found: Sequence[RecordingLag]) -> float:
    """`correlation` without its p-value."""
    expected = sum(own.products for own in found) / sum(own.squares for own in found)
    return float(np.interp(_ratio(found), expected, _GRID))


def _ratio(found: Sequence[RecordingLag]) -> float:
    return sum(own.product for own in found) / max(sum(own.square for own in found), 1e-300)


def _values(own: RecordingLag, ratio: float) -> Matrix:
    """Weights of the chi-squares of which product - ratio * square is the sum."""
    if own.forms is None:
        # Of a long recording: those of independent errors, shifted by the bias.
        angles = np.pi * np.arange(1, own.shots + 1) / (own.shots + 1)
        return np.repeat(np.cos(angles) - (ratio - own.bias), own.size // own.shots)
    squares, products = own.forms
    return np.asarray(np.linalg.eigvalsh(products - ratio * np.diag(squares)))


def _chance(weights: Matrix) -> float:
    """That a sum of chi-squares of one degree of freedom each, times `weights`, is above 0."""
    scale = float(np.abs(weights).max(initial=0.0))
    if scale == 0.0:
        return 1.0
    weights = weights[np.abs(weights) > 1e-10 * scale] / scale
    if weights.min() > 0 or weights.max() < 0:
        return float(weights.min() > 0)
    low, high = 0.5 / weights.min(), 0.5 / weights.max()
    for _ in range(_HALVINGS):  # to where the slope, which rises all the way, is 0
        t = (low + high) / 2
        if (weights / (1 - 2 * t * weights)).sum() < 0:
            low = t
        else:
            high = t
    open_part = 1 - 2 * t * weights
    bend = float((2 * (weights / open_part) ** 2).sum())
    height = max(float(np.log(open_part).sum()), 0.0)
    w, v = np.sign(t) * np.sqrt(height), t * np.sqrt(bend)
    if abs(w) < 1e-4:
        skew = float(8 * (weights**3).sum()) / float(2 * (weights**2).sum()) ** 1.5
        return float(0.5 - skew / (6 * np.sqrt(2 * np.pi)))
    return float(scipy.special.ndtr(-(w + np.log(v / w) / w)))
