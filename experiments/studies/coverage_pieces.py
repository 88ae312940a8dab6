"""The coverage study in pieces: some data sets of a plan, solved by all estimators."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...analysis.posterior.many_posteriors import TOGETHER, drawn_together
from ...model.arrays import Index, Matrix
from ...model.likelihood.density import Density
from ...model.likelihood.problem import Problem
from .data_sets import DataSets, fitted
from .estimators import Estimates, likelihood, midpoint, pseudo_inverse, understated
from .ranks import DRAWS

SIZE = TOGETHER  # data sets of a piece


@dataclass(frozen=True, eq=False)
class Piece:
    """Data sets of one plan, and the random numbers of their posteriors."""

    data: DataSets
    degenerate: bool
    rng: np.random.Generator


@dataclass(frozen=True)
class PieceEstimates:
    """`Estimates` of a piece; of the arrays their bytes, so that they are kept to the last bit."""

    name: str
    words: str
    control: bool
    value: str
    std: str
    kept: tuple[bool, ...]


@dataclass(frozen=True)
class PieceAnswer:
    """What a piece came to: all estimators, the posterior's second; `ranks` of the truths among the draws;
    the share of proposals that were `accepted`."""

    estimates: tuple[PieceEstimates, ...]
    ranks: str
    accepted: float


def estimated(problem: Problem) -> Index:
    """(m,) the places of the offsets that are estimated."""
    parameters = problem.parameters
    return np.flatnonzero(parameters.free & parameters.group("offset"))


def answer_of(piece: Piece) -> PieceAnswer:
    """All estimators of the data sets of a piece."""
    data, problem = piece.data, piece.data.problem
    which, parameters = estimated(problem), problem.parameters
    fits = fitted(data)
    found = [likelihood(data, fits, which), understated(data, which)]
    if piece.degenerate:
        found.append(pseudo_inverse(data, fits, which))
    else:
        found.insert(1, midpoint(data, which))
    draws, accepted = drawn_together(Density(problem, data.joints, data.spots), fits, DRAWS, piece.rng)
    draws = draws[:, :, parameters.among_free[which]]
    scale, mean, true = parameters.prior_std[which], parameters.prior_mean[which], data.truths[:, which]
    ranks = (draws < ((true - mean) / scale)[:, None]).sum(axis=1)
    of_draws = Estimates(
        "posterior",
        f"posterior, intervals between quantiles of {DRAWS} draws",
        False,
        draws.mean(axis=1) * scale + mean,
        draws.std(axis=1, ddof=1) * scale,
        fits.converged,
    )
    found.insert(1, of_draws)
    return PieceAnswer(tuple(map(_packed, found)), _bytes(ranks.astype(float)), accepted)


def joined(answers: Sequence[PieceAnswer], offsets: int) -> tuple[list[Estimates], Index]:
    """The estimators of all pieces of a plan with so many `offsets`, and the ranks (W, m)."""

    def table(texts: Sequence[str]) -> Matrix:
        return np.concatenate([_array(text).reshape(-1, offsets) for text in texts])

    estimates = []
    for own in zip(*(answer.estimates for answer in answers), strict=True):
        first = own[0]
        value, std = table([part.value for part in own]), table([part.std for part in own])
        kept = np.concatenate([np.array(part.kept, dtype=bool) for part in own])
        estimates.append(Estimates(first.name, first.words, first.control, value, std, kept))
    return estimates, table([answer.ranks for answer in answers]).astype(np.int64)


def _packed(own: Estimates) -> PieceEstimates:
    kept = tuple(bool(one) for one in own.kept)
    return PieceEstimates(own.name, own.words, own.control, _bytes(own.value), _bytes(own.std), kept)


def _bytes(values: Matrix) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f8").tobytes()).decode()


def _array(text: str) -> Matrix:
    return np.frombuffer(base64.b64decode(text), dtype="<f8").astype(float)
