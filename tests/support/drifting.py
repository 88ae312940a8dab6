"""A made-up arm with a known walk and a known jump."""

import numpy as np

from zerobeam.analysis.drift.smoother import Observation, Series, series_of

NAMES = ("delta2", "delta3")
COVARIANCE = np.array([[4.0, 3.4], [3.4, 4.0]]) * 1e-4  # deg^2: u of 0.02 degrees, correlated by 0.85


def steady(jump: float = 0.0, *, results: int = 12, walk: float = 0.0) -> Series:
    """Quarterly results of an arm; delta3 jumps by so much after result 5."""
    random, state, found = np.random.default_rng(3), np.zeros(2), []
    for t in range(results):
        values = random.multivariate_normal(state, COVARIANCE)
        found.append(Observation(t / 4, NAMES, values, COVARIANCE, np.zeros((2, 2))))
        state = state + walk * random.normal(size=2) + (jump if t == 5 else 0.0) * np.array([0.0, 1.0])
    return series_of(found, dict.fromkeys(NAMES, "deg"))
