"""The posteriors of many data sets side by side: a few draws of each."""

from __future__ import annotations

import math

import numpy as np

from ...model.arrays import Matrix
from ...model.likelihood.density import Density
from ..estimation.coordinates import FlangeCoordinates
from ..estimation.fit import Fits
from .sampler import (
    GOOD,
    MAPPED_SHARE,
    ROUND,
    SHARE,
    IndependenceProposal,
    Moves,
    degrees_of_freedom,
    possible_density,
)

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

    One walker for each draw; where it ends is the draw. Density, coordinates, whitening by the fit, first
    proposal, moves, their shares and the length of a round are those of `sample_posterior`. A batch has many
    walkers in place of long chains, so that no R-hat is taken; and where the proposal is poor it is fitted
    anew to the walkers of each data set, in place of a triangular map.
    """
    size, count = density.size, len(fits.x)
    every = np.arange(count)
    coordinates = FlangeCoordinates(density)
    centre = coordinates.from_parameters(fits.x, every)
    factor = np.linalg.cholesky(coordinates.covariance(fits.x, fits.covariance, every))

    def mapped(w: Matrix) -> Matrix:
        """v (count, …, f) of walkers (count * …, f): as many of each data set, one set after the other."""
        return np.asarray(centre[:, None] + w.reshape(count, -1, size) @ factor.transpose(0, 2, 1))

    def log_posterior(w: Matrix) -> Matrix:
        of = np.repeat(every, len(w) // count)
        return density.log_posterior(coordinates.to_parameters(mapped(w).reshape(-1, size), of), of)

    def log_density(w: Matrix) -> Matrix:
        return possible_density(log_posterior, w)

    proposal = IndependenceProposal(np.zeros(size), np.eye(size), degrees_of_freedom(size))
    moves = Moves(proposal, rng, SHARE, groups=count)

    def advanced(w: Matrix, steps: int) -> Matrix:
        return moves.advance(log_density, w, steps, last=True)[:, 0]

    w = advanced(proposal.draw(count * draws, rng), ROUND)
    for _ in range(_REFITS):
        if _accepted(moves) >= GOOD:
            break
        # The whitening, and with it the proposal, is fitted anew to where the walkers are.
        v = mapped(w)
        centre = v.mean(axis=1)
        around = v - centre[:, None]
        factor = _WIDER * np.linalg.cholesky(around.transpose(0, 2, 1) @ around / (draws - 1))
        moves = Moves(
            IndependenceProposal(np.zeros(size), np.eye(size), _HEAVY), rng, MAPPED_SHARE, groups=count
        )
        w = np.linalg.solve(factor, around.transpose(0, 2, 1)).transpose(0, 2, 1).reshape(-1, size)
        w = advanced(w, ROUND)
    steps = min(math.ceil(LEAST_STEPS / max(_accepted(moves), 1e-3) ** 2), _MOST_STEPS)
    v = mapped(advanced(w, steps))
    scaled = density.scaled(coordinates.to_parameters(v.reshape(-1, size), np.repeat(every, draws)))
    return scaled.reshape(count, draws, size), _accepted(moves)


def _accepted(moves: Moves) -> float:
    """The share of the proposal's draws that were accepted."""
    return moves.independence.accepted / max(moves.independence.proposed, 1)
