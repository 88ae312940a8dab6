"""The results of an arm over time, and the exact smoother of their random walk for many drift rates at once.

    x[t+1] = x[t] + w[t],  w[t] ~ N(0, diag(rate^2) gap[t]);   information J[t], J[t] y[t] of each result

with nothing known of x[0], in information form. The precision of all states is block tridiagonal: forward
elimination, backward substitution (Rauch, Tung and Striebel). A result that does not determine a direction
has no information in it and adds nothing. Where a jump is allowed, the walk has no information: 0 in place of
1 / (rate^2 gap)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from ...model.arrays import Matrix
from ...model.errors import UnsoundResult


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
        return np.asarray(
            np.maximum(np.diff([observation.at for observation in self.observations]), 1 / 8766)
        )

    @property
    def observed(self) -> Matrix:
        """(T, m) whether a result determines an offset."""
        return np.array(
            [[name in observation.names for name in self.names] for observation in self.observations]
        )

    @property
    def determined(self) -> Matrix:
        """(T, m) whether a result since the last reset, or until the next, determines an offset: where none
        does, nothing is known of it."""
        result = np.zeros((len(self.observations), len(self.names)), dtype=bool)
        ends = [0, *(t + 1 for t in sorted(self.reset)), len(result)]
        for begin, end in pairwise(ends):
            result[begin:end] = self.observed[begin:end].any(axis=0)
        return result

    def information(self) -> tuple[Matrix, Matrix]:
        """(T, m, m) and (T, m): the information of each result, 0 in every direction that it does not
        determine, and its product with the values.

        Where an offset is not `determined` between two resets, the first result of these has 1: it affects
        nothing else, and the states of the offset there mean nothing.
        """
        return self._information

    @cached_property
    def _information(self) -> tuple[Matrix, Matrix]:
        count, size = len(self.observations), len(self.names)
        matrix, vector = np.zeros((count, size, size)), np.zeros((count, size))
        for t, observation in enumerate(self.observations):
            at = [self.names.index(name) for name in observation.names]
            inverse = np.linalg.inv(observation.covariance + observation.shared)
            matrix[t][np.ix_(at, at)] = (inverse + inverse.T) / 2
            vector[t, at] = inverse @ observation.values
        nowhere = np.logical_not(self.determined)
        for begin in (0, *(t + 1 for t in self.reset)):
            matrix[begin, nowhere[begin], nowhere[begin]] = 1.0
        return matrix, vector


def series_of(
    observations: Sequence[Observation], units: dict[str, str], reset: Sequence[int] = ()
) -> Series:
    """A series over every offset that any of the observations determines, joint 1 first."""
    ordered = tuple(sorted(observations, key=lambda observation: observation.at))
    names = sorted(
        {name for observation in ordered for name in observation.names}, key=lambda name: (len(name), name)
    )
    return Series(tuple(names), tuple(units[name] for name in names), ordered, tuple(reset))


@dataclass(frozen=True, eq=False)
class Smoothed:
    """For each of K rates: states `mean` (K, T, m) and `covariance` (K, T, m, m); `log_likelihood` (K,) up to
    a constant; of each interval and offset the `score` (K, T - 1, m), r / sqrt(N) of de Jong and Penzer
    (1998), standard normal if there is no jump, and `power` (K, T - 1, m), the information N about a jump;
    `step_variance` (K, T - 1, m) of the change in the interval."""

    mean: Matrix
    covariance: Matrix
    log_likelihood: Matrix
    score: Matrix
    power: Matrix
    step_variance: Matrix


def smooth(series: Series, rates: Matrix, jumps: Matrix) -> Smoothed:
    """The states for `rates` (K, m) per root year; `jumps` (T - 1, m) says where a jump is allowed."""
    information, vector = series.information()
    count, size = vector.shape
    gaps = series.gaps
    variance = rates[:, None, :] ** 2 * gaps[:, None]  # (K, T - 1, m)
    step_precision = np.where(jumps, 0.0, 1 / variance)
    diagonal = np.arange(size)
    rows = len(rates)
    left = np.empty((rows, count, size, size))  # the inverse of each eliminated block
    reduced = np.empty((rows, count, size))
    known = np.zeros((rows, count, size, size))  # of each state by the results until then, F
    known[:] = information
    log_det = np.zeros(rows)
    pulled = np.zeros((rows, size))
    for t in range(count):
        block = known[:, t].copy()
        if t < count - 1:
            block[:, diagonal, diagonal] += step_precision[:, t]
        reduced[:, t] = vector[t] + pulled
        left[:, t] = np.linalg.inv(block)
        log_det += np.linalg.slogdet(block)[1]
        if t < count - 1:
            # What is left of F after the step: W - W (F + W)^-1 W without the difference, of which rounding
            # leaves nothing where the walk is slow.
            carried = step_precision[:, t, :, None] * left[:, t]
            passed = carried @ known[:, t]
            known[:, t + 1] += (passed + passed.transpose(0, 2, 1)) / 2
            pulled = _times(carried, reduced[:, t])
    mean, covariance = np.empty((rows, count, size)), np.empty((rows, count, size, size))
    score, power, changed = (np.zeros((rows, count - 1, size)) for _ in range(3))
    mean[:, -1] = _times(left[:, -1], reduced[:, -1])
    covariance[:, -1] = left[:, -1]
    for t in range(count - 2, -1, -1):
        w = step_precision[:, t]
        gain = left[:, t] * w[:, None, :]
        pull = reduced[:, t] + w * mean[:, t + 1]
        mean[:, t] = _times(left[:, t], pull)
        covariance[:, t] = left[:, t] + gain @ covariance[:, t + 1] @ gain.transpose(0, 2, 1)
        # x[t+1] - x[t] = (F + W)^-1 (F x[t+1] - what F y is), again without the difference.
        stay = left[:, t] @ known[:, t]
        of_step = ((stay @ covariance[:, t + 1]) * stay).sum(axis=2)
        changed[:, t] = left[:, t][:, diagonal, diagonal] + of_step
        jump_information = w * stay[:, diagonal, diagonal] - w**2 * of_step
        power[:, t] = np.maximum(jump_information, 0.0)
        moved = _times(known[:, t], mean[:, t + 1]) - reduced[:, t]
        step = w * _times(left[:, t], moved)
        score[:, t] = np.where(
            power[:, t] > 0, step / np.sqrt(np.where(power[:, t] > 0, jump_information, 1.0)), 0.0
        )
    walked = np.where(jumps, 0.0, np.log(variance)).sum(axis=(1, 2))
    quadratic = (vector * mean).sum(axis=(1, 2))
    return Smoothed(mean, covariance, (quadratic - log_det - walked) / 2, score, power, changed)


def _times(matrices: Matrix, vectors: Matrix) -> Matrix:
    """(K, m) of (K, m, m) and (K, m)."""
    return np.asarray((matrices @ vectors[:, :, None])[:, :, 0])
