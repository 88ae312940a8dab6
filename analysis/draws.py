"""Normal vectors at random, by their covariance, which may be singular."""

from __future__ import annotations

import numpy as np

from ..model.arrays import Matrix


def drawn_by_covariance(covariance: Matrix, count: int, rng: np.random.Generator) -> Matrix:
    """(count, m) normal at random with that covariance (m, m)."""
    root = root_of(covariance)
    return rng.normal(size=(count, len(root))) @ root.T


def root_of(covariance: Matrix) -> Matrix:
    """(m, m) R with R R' = C."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
