"""The results of an arm over time, as the state-space model takes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...model.arrays import Matrix
from ..status import UnsoundResult


@dataclass(frozen=True, eq=False)
class Observation:
    """One result: `at` in years, the offsets that it determines without any prior (m of them), their
    `covariance` (m, m) in full, and what the tolerances of the geometry add to it, the same in all results of
    the arm (`shared`, m x m; 0 for nominal geometry)."""

    at: float
    names: tuple[str, ...]
    values: Matrix
    covariance: Matrix
    shared: Matrix

    def __post_init__(self) -> None:
        size = len(self.names)
        if self.values.shape != (size,) or not self.covariance.shape == self.shared.shape == (size, size):
            raise UnsoundResult("values and covariance of a result are not of the offsets that it names")


@dataclass(frozen=True, eq=False)
class Series:
    """Results in the order of time. `reset` are the intervals (number of the result before) after which every
    offset begins anew: the controller got new zeros."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    observations: tuple[Observation, ...]
    reset: tuple[int, ...] = ()

    @property
    def gaps(self) -> Matrix:
        """(T - 1,) years between the results; at least an hour, so that two at one time may differ."""
        return np.asarray(np.maximum(np.diff([own.at for own in self.observations]), 1 / 8766))

    @property
    def observed(self) -> Matrix:
        """(T, m) whether a result determines an offset."""
        return np.array([[name in own.names for name in self.names] for own in self.observations])

    @property
    def determined(self) -> Matrix:
        """(T, m) whether a result since the last reset, or until the next, determines an offset: where none
        does, nothing is known of it."""
        found = np.zeros((len(self.observations), len(self.names)), dtype=bool)
        ends = [0, *(t + 1 for t in sorted(self.reset)), len(found)]
        for begin, end in pairwise(ends):
            found[begin:end] = self.observed[begin:end].any(axis=0)
        return found

    def information(self) -> tuple[Matrix, Matrix]:
        """(T, m, m) and (T, m): the information of each result, 0 in every direction that it does not
        determine, and its product with the values.

        Where an offset is not `determined` between two resets, 1 stands at the first result of these: it
        bears on nothing else, and the states of the offset there mean nothing.
        """
        count, size = len(self.observations), len(self.names)
        matrix, vector = np.zeros((count, size, size)), np.zeros((count, size))
        for t, own in enumerate(self.observations):
            at = [self.names.index(name) for name in own.names]
            inverse = np.linalg.inv(own.covariance + own.shared)
            matrix[t][np.ix_(at, at)] = (inverse + inverse.T) / 2
            vector[t, at] = inverse @ own.values
        nowhere = np.logical_not(self.determined)
        for begin in (0, *(t + 1 for t in self.reset)):
            matrix[begin, nowhere[begin], nowhere[begin]] = 1.0
        return matrix, vector


def series_of(
    observations: Sequence[Observation], units: dict[str, str], reset: Sequence[int] = ()
) -> Series:
    """A series over every offset that any of the observations determines, joint 1 first."""
    ordered = tuple(sorted(observations, key=lambda own: own.at))
    found = sorted({name for own in ordered for name in own.names}, key=lambda name: (len(name), name))
    return Series(tuple(found), tuple(units[name] for name in found), ordered, tuple(reset))
