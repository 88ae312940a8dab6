"""The exact smoother of a random walk, in information form, for many walk rates at once.

    x[t+1] = x[t] + w[t],  w[t] ~ N(0, diag(rate^2) gap[t]);   information J[t], J[t] y[t] of each result

with nothing known of x[0]. The precision of all states is block tridiagonal: forward elimination, backward
substitution (Rauch, Tung and Striebel in information form). A result that does not determine a direction has
no information in it and adds nothing. Where a jump is allowed, the walk has no information: 0 in place of
1 / (rate^2 gap).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...model.arrays import Matrix
from .series import Series


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
    walk = np.where(jumps, 0.0, 1 / variance)
    diagonal = np.arange(size)
    rows = len(rates)
    left = np.empty((rows, count, size, size))  # the inverse of each eliminated block
    reduced = np.empty((rows, count, size))
    log_det = np.zeros(rows)
    before, pulled = np.zeros((rows, size, size)), np.zeros((rows, size))
    for t in range(count):
        block = information[t] + before
        if t < count - 1:
            block = block.copy()
            block[:, diagonal, diagonal] += walk[:, t]
        reduced[:, t] = vector[t] + pulled
        left[:, t] = np.linalg.inv(block)
        log_det += np.linalg.slogdet(block)[1]
        if t < count - 1:
            carried = walk[:, t, :, None] * left[:, t]
            before = -carried * walk[:, t, None, :]
            before[:, diagonal, diagonal] += walk[:, t]
            pulled = np.einsum("kij,kj->ki", carried, reduced[:, t])
    mean, covariance = np.empty((rows, count, size)), np.empty((rows, count, size, size))
    score, power, changed = (np.zeros((rows, count - 1, size)) for _ in range(3))
    mean[:, -1] = np.einsum("kij,kj->ki", left[:, -1], reduced[:, -1])
    covariance[:, -1] = left[:, -1]
    for t in range(count - 2, -1, -1):
        gain = left[:, t] * walk[:, t, None, :]
        pull = reduced[:, t] + walk[:, t] * mean[:, t + 1]
        mean[:, t] = np.einsum("kij,kj->ki", left[:, t], pull)
        along = gain @ covariance[:, t + 1]
        covariance[:, t] = left[:, t] + along @ gain.transpose(0, 2, 1)
        of_step = covariance[:, t] + covariance[:, t + 1] - along - along.transpose(0, 2, 1)
        changed[:, t] = of_step[:, diagonal, diagonal]
        w = walk[:, t]
        own = w - w**2 * changed[:, t]
        power[:, t] = np.maximum(own, 0.0)
        step = w * (mean[:, t + 1] - mean[:, t])
        score[:, t] = np.where(power[:, t] > 0, step / np.sqrt(np.where(power[:, t] > 0, own, 1.0)), 0.0)
    walked = np.where(jumps, 0.0, np.log(variance)).sum(axis=(1, 2))
    quadratic = (vector * mean).sum(axis=(1, 2))
    return Smoothed(mean, covariance, (quadratic - log_det - walked) / 2, score, power, changed)
