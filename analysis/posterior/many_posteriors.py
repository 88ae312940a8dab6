"""The posteriors of many data sets side by side: a few draws of each."""

from __future__ import annotations

import math

import numpy as np

from ...model.arrays import Index, Matrix
from ...model.likelihood.density import Density
from ..estimation.coordinates import flange_coordinates
from ..estimation.fit import Fits
from .sampler import (
    GOOD,
    MANY_SHARE,
    ROUND,
    SHARE,
    IndependenceProposal,
    Moves,
    degrees_of_freedom,
    possible_density,
)
from .sheet import Whitening

_REFITS = 4  # the proposal is fitted anew at most so often, while less than GOOD are accepted;
LEAST_STEPS, _MOST_STEPS = 10, 400  # then so many steps over the square of the acceptance, and at most
_WIDER = 1.3  # a refitted proposal is so much wider than the walkers' spread,
_HEAVY = 5.0  # and its nu this: for the tails
TOGETHER = 50  # data sets whose walkers go together


def drawn_together(
    density: Density, fits: Fits, draws: int, rng: np.random.Generator
) -> tuple[Matrix, float]:
    """(W, draws, f) draws of the scaled free parameters of every data set of a density, and the acceptance;
    `fits` are theirs. `TOGETHER` data sets are what a core keeps near.

    One walker for each draw; where it ends is the draw. Density, coordinates, whitening by the fit, sheet,
    first proposal, moves, their shares and the length of a round are those of `sample_posterior`. A batch has
    many walkers in place of long chains, so that no R-hat is taken; and where the proposal is poor it is
    fitted anew to the walkers of each data set.
    """
    size, count = density.size, len(fits.x)
    every = np.arange(count)
    coordinates = flange_coordinates(density)
    whitenings = [Whitening(density, fits.x[k], fits.covariance[k], k) for k in range(count)]
    # What is fitted anew: u of the walkers is where + spread w.
    where, spread = np.zeros((count, size)), np.broadcast_to(np.eye(size), (count, size, size))

    def at(w: Matrix) -> Matrix:
        """u (count, …, f) of walkers (count * …, f): as many of each data set, one set after the other."""
        return np.asarray(where[:, None] + w.reshape(count, -1, size) @ spread.transpose(0, 2, 1))

    def of(w: Matrix) -> Index:
        return np.repeat(every, len(w) // count)

    def parameters(w: Matrix) -> Matrix:
        """x (count * …, p)."""
        v = np.concatenate([each.coordinates(u) for each, u in zip(whitenings, at(w), strict=True)])
        return coordinates.to_parameters(v, of(w))

    def log_density(w: Matrix) -> Matrix:
        return possible_density(lambda w: density.log_posterior(parameters(w), of(w)), w)

    proposal = IndependenceProposal(np.zeros(size), np.eye(size), degrees_of_freedom(size))
    moves = Moves(proposal, rng, SHARE, groups=count)

    def advanced(w: Matrix, steps: int) -> Matrix:
        return moves.advance(log_density, w, steps, last=True)[:, 0]

    w = advanced(proposal.draw(count * draws, rng), ROUND)
    for _ in range(_REFITS):
        if _accepted(moves) >= GOOD:
            break
        u = at(w)
        where = u.mean(axis=1)
        around = u - where[:, None]
        spread = _WIDER * np.linalg.cholesky(around.transpose(0, 2, 1) @ around / (draws - 1))
        moves = Moves(
            IndependenceProposal(np.zeros(size), np.eye(size), _HEAVY), rng, MANY_SHARE, groups=count
        )
        w = np.linalg.solve(spread, around.transpose(0, 2, 1)).transpose(0, 2, 1).reshape(-1, size)
        w = advanced(w, ROUND)
    steps = min(math.ceil(LEAST_STEPS / max(_accepted(moves), 1e-3) ** 2), _MOST_STEPS)
    scaled = density.scaled(parameters(advanced(w, steps)))
    return scaled.reshape(count, draws, size), _accepted(moves)


def _accepted(moves: Moves) -> float:
    """The share of the proposal's draws that were accepted."""
    return moves.independence.accepted / max(moves.independence.proposed, 1)
