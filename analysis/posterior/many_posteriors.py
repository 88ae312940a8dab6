"""The posteriors of many data sets side by side: a few draws of each."""

from __future__ import annotations

import math
from typing import Self

import numpy as np

from ...model.arrays import Index, Mask, Matrix
from ...model.likelihood.density import Density
from ..estimation.coordinates import flange_coordinates
from ..estimation.fit import Fits
from .convergence import Weights
from .sampler import MANY_SHARE, ROUND, IndependenceProposal, Moves, degrees_of_freedom, possible_density
from .sheet import Whitening

PROPOSED = 6  # for each draw, where their weights serve
_REFITS = 3  # the proposal is fitted anew at most so often, while they do not:
_WIDER = 1.1  # so much wider than the spread of the draws,
_HEAVY = 5.0  # and its nu this, for the tails
_LEAST_STEPS, _MOST_STEPS = 10, 400  # of walkers, over the square of their acceptance, and at most
TOGETHER = 50  # data sets whose rows a core keeps near


def drawn_together(
    density: Density, fits: Fits, draws: int, rng: np.random.Generator
) -> tuple[Matrix, float]:
    """(W, draws, f) draws of the scaled free parameters of every data set of a density, and which share of
    what was proposed a chain accepts; `fits` are theirs, at most `TOGETHER` at a time.

    Density, coordinates, whitening by the fit, sheet and first proposal are those of `sample_posterior`. The
    draws are chosen among independent draws of the proposal, by their weights. Where these do not serve
    (`Weights`) the proposal is fitted anew to them (Cappé et al. 2004, population Monte Carlo); where that
    does not help either, the draws are where the walkers of emcee's moves end, one for each.
    """
    left = np.arange(len(fits.x))
    x, accepted = np.empty((len(left), draws, fits.x.shape[1])), np.zeros(len(left))
    posteriors = _Posteriors.around(density, fits)
    for _ in range(1 + _REFITS):
        x[left], served, accepted[left] = posteriors.chosen(draws, rng)
        left, posteriors = left[~served], posteriors.some(~served)
        if len(left) == 0:
            break
    else:
        x[left], accepted[left] = posteriors.walked(draws, rng)
    scaled = density.scaled(x.reshape(-1, x.shape[-1]))
    return scaled.reshape(*x.shape[:2], -1), float(accepted.mean())


class _Posteriors:
    """Those of the data sets `which` (W,) of a density side by side, in coordinates w (W * …, f) in which
    each is nearly a unit normal: as many rows of each, one set after the other.

    u of each set's `whitenings` is `where` (W, f) + `spread` (W, f, f) w.
    """

    def __init__(
        self,
        density: Density,
        which: Index,
        whitenings: list[Whitening],
        where: Matrix,
        spread: Matrix,
        nu: float,
    ) -> None:
        self._density, self._which, self._whitenings = density, which, whitenings
        self._where, self._spread = where, spread
        size = density.size
        self._proposal = IndependenceProposal(np.zeros(size), np.eye(size), nu)
        self._coordinates = flange_coordinates(density)

    @classmethod
    def around(cls, density: Density, fits: Fits) -> Self:
        """Of all data sets, around their fits."""
        count, size = len(fits.x), density.size
        whitenings = [Whitening(density, fits.x[k], fits.covariance[k], k) for k in range(count)]
        unit = np.tile(np.eye(size), (count, 1, 1))
        return cls(
            density, np.arange(count), whitenings, np.zeros((count, size)), unit, degrees_of_freedom(size)
        )

    def some(self, mask: Mask) -> Self:
        """Of these data sets (W,) alone, of which the proposal has been fitted anew."""
        whitenings = [self._whitenings[k] for k in np.flatnonzero(mask)]
        return type(self)(
            self._density, self._which[mask], whitenings, self._where[mask], self._spread[mask], _HEAVY
        )

    def chosen(self, draws: int, rng: np.random.Generator) -> tuple[Matrix, Mask, Matrix]:
        """(W, draws, p) x of draws chosen by weight among `PROPOSED` times as many, (W,) whether the weights
        serve, and (W,) which share of what was proposed a chain accepts. The proposal is fitted anew where
        they do not.

        By systematic resampling in the order of the proposals, which are independent: none comes twice unless
        its weight is above `PROPOSED`.
        """
        sets, count, size = len(self._which), PROPOSED * draws, self._density.size
        w = self._proposal.draw(sets * count, rng)
        log_weights = (self._log_density(w) - self._proposal.log_density(w)).reshape(sets, count)
        w = w.reshape(sets, count, size)
        taken = np.zeros((sets, draws), dtype=int)
        served, accepted = np.zeros(sets, dtype=bool), np.zeros(sets)
        poor: dict[int, Matrix] = {}
        for k in np.flatnonzero(np.isfinite(log_weights).any(axis=1)).tolist():
            weights = Weights.of(log_weights[k])
            marks = (np.arange(draws) + rng.random()) / draws
            taken[k] = np.searchsorted(np.cumsum(weights.values) / count, marks)
            served[k], accepted[k] = weights.serve, weights.acceptance
            if not weights.serve:
                poor[k] = weights.values / count
        x = self._parameters(np.take_along_axis(w, taken[..., None], axis=1).reshape(-1, size))
        for k, shares in poor.items():
            self._refit(k, w[k], shares)
        return x.reshape(sets, draws, -1), served, accepted

    def _refit(self, k: int, w: Matrix, shares: Matrix) -> None:
        """The k-th set's proposal, to the centre and spread of w (N, f), each of its share (N,)."""
        centre = shares @ w
        around = (w - centre) * np.sqrt(shares)[:, None]
        try:
            factor = _WIDER * np.linalg.cholesky(around.T @ around)
        except np.linalg.LinAlgError:
            return
        self._where[k] += self._spread[k] @ centre
        self._spread[k] = self._spread[k] @ factor

    def walked(self, draws: int, rng: np.random.Generator) -> tuple[Matrix, float]:
        """(W, draws, p) x where walkers end, and the acceptance.

        The moves and the length of a round are those of `sample_posterior`. Many walkers are in place of long
        chains, so that no R-hat is taken.
        """
        sets = len(self._which)
        moves = Moves(self._proposal, rng, MANY_SHARE, groups=sets)

        def advanced(w: Matrix, steps: int) -> Matrix:
            return moves.advance(self._log_density, w, steps, last=True)[:, 0]

        w = advanced(self._proposal.draw(sets * draws, rng), ROUND)
        accepted = moves.independence.accepted / max(moves.independence.proposed, 1)
        w = advanced(w, min(math.ceil(_LEAST_STEPS / max(accepted, 1e-3) ** 2), _MOST_STEPS))
        return self._parameters(w).reshape(sets, draws, -1), accepted

    def _parameters(self, w: Matrix) -> Matrix:
        """x (W * …, p) of w."""
        rows = w.reshape(len(self._which), -1, self._density.size)
        u = self._where[:, None] + rows @ self._spread.transpose(0, 2, 1)
        v = [whitening.coordinates(each) for whitening, each in zip(self._whitenings, u, strict=True)]
        return self._coordinates.to_parameters(np.concatenate(v), self._of(w))

    def _of(self, w: Matrix) -> Index:
        return np.repeat(self._which, len(w) // len(self._which))

    def _log_density(self, w: Matrix) -> Matrix:
        return possible_density(lambda w: self._density.log_posterior(self._parameters(w), self._of(w)), w)
